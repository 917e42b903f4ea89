//! The two methods, and which of them takes the steps.

use super::super::{Method, Settings, SolveError, System};
use super::control::Growth;
use super::explicit::Explicit;
use super::frame::Frame;
use super::numbers::Quad;
use super::rosenbrock::Rosenbrock;

/// A step of the explicit method times the largest eigenvalue from which on stability bounds it (6.1 on the negative axis, where an estimate below is as
/// frequent as one above), how many of them tell, and how many others in a row say the contrary.
const STABLE: f64 = 5.0;
const MISFITS: u32 = 6;
const CALM: u32 = 6;

/// A step of the Rosenbrock method times a bound of the eigenvalues below which the explicit one takes longer ones.
const LOOSE: f64 = 1.0;

/// The methods that the settings allow.
pub struct Methods {
    rosenbrock: Option<Rosenbrock>,
    explicit: Option<Explicit>,
    /// The Rosenbrock method takes the steps.
    stiff: bool,
    /// It took the last one.
    by_rosenbrock: bool,
    /// Steps that would have been the other method's.
    misfits: u32,
    /// Steps in a row that are its own.
    calm: u32,
    /// The polynomial is that of the last step.
    prepared: bool,
}

impl Methods {
    /// Those for a system, with algebraic unknowns or without.
    ///
    /// # Errors
    /// A pattern that the linear solvers refuse.
    pub(crate) fn new(system: &dyn System, settings: &Settings, algebraic: bool) -> Result<Self, SolveError> {
        let stiff = settings.method != Method::Explicit;
        let explicit = settings.method != Method::Rosenbrock && !algebraic;
        Ok(Self {
            rosenbrock: if stiff { Some(Rosenbrock::new(system, settings.linear_solver)?) } else { None },
            explicit: explicit.then(|| Explicit::new(system.dimension())),
            stiff,
            by_rosenbrock: stiff,
            misfits: 0,
            calm: 0,
            prepared: false,
        })
    }

    /// As before the first step.
    pub(crate) fn forget(&mut self) {
        self.stiff = self.rosenbrock.is_some();
        (self.misfits, self.calm) = (0, 0);
        self.rosenbrock.iter_mut().for_each(Rosenbrock::forget);
    }

    /// Whether the Rosenbrock method takes the steps.
    pub(crate) fn is_stiff(&self) -> bool {
        self.stiff
    }

    /// Goes on with the explicit method, or with the other, where it is there.
    pub(crate) fn take_up(&mut self, explicit: bool) {
        self.stiff = if explicit { self.explicit.is_none() } else { self.rosenbrock.is_some() };
    }

    /// How errors grow with a step.
    pub(crate) fn growth(&self) -> Growth {
        if self.stiff { Growth::Fifth } else { Growth::Eighth }
    }

    /// Row and column of an entry of the Jacobian.
    pub(crate) fn place_of(&self, entry: usize) -> (usize, usize) {
        self.rosenbrock.as_ref().map_or((0, 0), |r| r.place_of(entry))
    }

    /// Computes a step; its error in tolerances.
    #[inline]
    pub(crate) fn attempt(&mut self, frame: &mut Frame, system: &mut dyn System) -> f64 {
        match (&mut self.rosenbrock, &mut self.explicit) {
            (Some(rosenbrock), _) if self.stiff => rosenbrock.attempt(frame, system),
            (_, Some(explicit)) => explicit.attempt(frame, system),
            _ => f64::NAN,
        }
    }

    /// The unknown with the largest error in the last step that was tried.
    pub(crate) fn unknown_to_blame(&mut self, frame: &mut Frame) -> Option<usize> {
        match (&mut self.rosenbrock, &mut self.explicit) {
            (Some(rosenbrock), _) if self.stiff => frame.largest(rosenbrock.error()),
            (_, Some(explicit)) => frame.largest(explicit.error(frame)),
            _ => None,
        }
    }

    /// Whether from the step that was accepted on the other method takes the steps, because it would have served better.
    pub(crate) fn choose(&mut self, frame: &Frame) -> bool {
        self.by_rosenbrock = self.stiff;
        let misfit = match (&mut self.rosenbrock, &self.explicit) {
            (Some(rosenbrock), Some(_)) if self.stiff => frame.h * rosenbrock.spectral_bound(frame) < LOOSE,
            (Some(_), Some(explicit)) => explicit.stiffness(frame) > STABLE,
            _ => false,
        };
        self.calm = if misfit { 0 } else { self.calm + 1 };
        self.misfits = if self.calm >= CALM { 0 } else { self.misfits + u32::from(misfit) };
        let changes = self.misfits > if self.stiff { 0 } else { MISFITS };
        if changes {
            self.stiff = !self.stiff;
            (self.misfits, self.calm) = (0, 0);
        }
        changes
    }

    /// Another step was accepted, whose polynomial is not made yet.
    pub(crate) fn renew(&mut self) {
        self.prepared = false;
    }

    /// Makes the polynomial of the step, once.
    pub(crate) fn prepare(&mut self, frame: &mut Frame, system: &mut dyn System) {
        if std::mem::replace(&mut self.prepared, true) {
            return;
        }
        match (&mut self.rosenbrock, &mut self.explicit) {
            (Some(rosenbrock), _) if self.by_rosenbrock => rosenbrock.prepare(frame),
            (_, Some(explicit)) => explicit.prepare(frame, system),
            _ => {}
        }
    }

    /// Unknowns and derivatives on the polynomial.
    pub(crate) fn interpolate(&self, t: f64, y: &mut [Quad], yp: &mut [Quad]) {
        match (&self.rosenbrock, &self.explicit) {
            (Some(rosenbrock), _) if self.by_rosenbrock => rosenbrock.interpolate(t, y, yp),
            (_, Some(explicit)) => explicit.interpolate(t, y, yp),
            _ => {}
        }
    }

    /// The same of the Rosenbrock method alone, which has algebraic unknowns.
    pub(crate) fn interpolate_algebraic(&self, t: f64, y: &mut [Quad], yp: &mut [Quad]) {
        self.rosenbrock.iter().for_each(|r| r.interpolate(t, y, yp));
    }
}
