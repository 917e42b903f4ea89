//! The methods, and which of them takes the steps.

use super::super::{Method, Settings, SolveError, System};
use super::control::Growth;
use super::explicit::Explicit;
use super::frame::Frame;
use super::numbers::Quad;
use super::rosenbrock::Rosenbrock;
use super::short::Short;

/// A step of the explicit method times the largest eigenvalue from which on stability bounds it
/// (6.1 on the negative axis, where estimates below are as frequent as above). The number of such
/// steps that decide, and of others in a row that revoke it.
const STABLE: f64 = 5.0;
const MISFITS: u32 = 6;
const CALM: u32 = 6;

/// A step of the Rosenbrock method times a bound of the eigenvalues below which the explicit one
/// takes longer ones.
const LOOSE: f64 = 1.0;

/// Factors of the reach of the short pair: after an error that is too large, and after each
/// suitable step.
const WITHDRAWAL: f64 = 0.5;
const ADVANCE: f64 = 1.1;

/// Error in tolerances above which a kink may have caused a larger one.
const CHANCE: f64 = 0.03;

/// Lengths that differ by rounding of time are equal.
const ROUNDED: f64 = 1.0 + 1e-6;

/// Method of a step.
#[derive(Clone, Copy, PartialEq, Eq)]
enum By {
    Rosenbrock,
    Explicit,
    Short,
}

/// The methods that the settings allow.
pub(super) struct Methods {
    rosenbrock: Option<Rosenbrock>,
    explicit: Option<Explicit>,
    /// The explicit pair of lower order, which takes a step where it covers all that is left.
    short: Option<Short>,
    /// The longest step known to suit it; zero where none is, negative where a longer one did not.
    reach: f64,
    /// The Rosenbrock method takes the steps.
    stiff: bool,
    /// Method of the last step.
    by: By,
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
            // Derivatives grow where states do, whatever absolute tolerances say: what DOP853 has
            // beyond the tolerance is kept for them.
            short: (explicit && system.directions() == 0).then(|| Short::new(system.dimension())),
            reach: 0.0,
            stiff,
            by: if stiff { By::Rosenbrock } else { By::Explicit },
            misfits: 0,
            calm: 0,
            prepared: false,
        })
    }

    /// Leaves all explicit steps to the method of order eight.
    #[cfg(test)]
    pub(crate) fn forgo_short(&mut self) {
        self.short = None;
    }

    /// Returns `true` if factorisations are a small part of the steps.
    pub(crate) fn is_cheap(&self) -> bool {
        self.rosenbrock.as_ref().is_none_or(Rosenbrock::is_cheap)
    }

    /// As before the first step.
    pub(crate) fn forget(&mut self) {
        self.stiff = self.rosenbrock.is_some();
        (self.misfits, self.calm, self.reach) = (0, 0, 0.0);
        self.rosenbrock.iter_mut().for_each(Rosenbrock::forget);
    }

    /// Returns `true` if the Rosenbrock method takes the steps.
    pub(crate) fn is_stiff(&self) -> bool {
        self.stiff
    }

    /// The longest step known to suit the short pair, as in [`Carried`](super::super::Carried).
    pub(crate) fn reach(&self) -> f64 {
        self.reach
    }

    /// Goes on with the explicit method, or with the other, where it is there, and with what is
    /// known of the short pair.
    pub(crate) fn take_up(&mut self, explicit: bool, reach: f64) {
        self.reach = reach;
        self.stiff = if explicit { self.explicit.is_none() } else { self.rosenbrock.is_some() };
    }

    /// Growth of errors with a step.
    pub(crate) fn growth(&self) -> Growth {
        if self.stiff { Growth::Fifth } else { Growth::Eighth }
    }

    /// Row and column of an entry of the Jacobian.
    pub(crate) fn place_of(&self, entry: usize) -> (usize, usize) {
        self.rosenbrock.as_ref().map_or((0, 0), |r| r.place_of(entry))
    }

    /// Returns `true` if a step of this length, all that is left, suits the short pair. Where
    /// forcings turn often, its estimate alone is too little to go by.
    #[inline]
    pub(crate) fn leaps(&self, left: f64, frame: &Frame) -> bool {
        left <= ROUNDED * self.reach.abs() && !self.stiff && !frame.careful && self.short.is_some()
    }

    /// Computes a step by the short pair; its error in tolerances.
    pub(crate) fn leap(&mut self, frame: &mut Frame, system: &mut dyn System) -> f64 {
        let error = self.short.as_mut().map_or(f64::NAN, |short| short.attempt(frame, system));
        self.by = By::Short;
        self.reach = if error <= 1.0 { self.reach.abs().max(frame.h) } else { -WITHDRAWAL * frame.h };
        error
    }

    /// Computes a step; its error in tolerances.
    #[inline]
    pub(crate) fn attempt(&mut self, frame: &mut Frame, system: &mut dyn System) -> f64 {
        self.by = if self.stiff { By::Rosenbrock } else { By::Explicit };
        match (&mut self.rosenbrock, &mut self.explicit) {
            (Some(rosenbrock), _) if self.stiff => rosenbrock.attempt(frame, system),
            (_, Some(explicit)) => explicit.attempt(frame, system),
            _ => f64::NAN,
        }
    }

    /// Returns whether the error of the last step may be small by chance where the step passed a
    /// kink.
    pub(crate) fn may_miss_kinks(&self, frame: &Frame) -> bool {
        match &self.explicit {
            Some(explicit) if self.by == By::Explicit => explicit.careful_error(frame) > 1.0,
            _ => frame.error > CHANCE,
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

    /// Returns `true` if from the step that was accepted on the other method takes the steps,
    /// because it would have served better.
    pub(crate) fn choose(&mut self, frame: &Frame) -> bool {
        let misfit = match (&mut self.rosenbrock, &self.explicit) {
            (Some(rosenbrock), Some(_)) if self.by == By::Rosenbrock => rosenbrock.is_slow(frame, LOOSE / frame.h),
            (Some(_), Some(explicit)) if self.by == By::Explicit => explicit.stiffness(frame) > STABLE,
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

    /// Another step was accepted, whose polynomial is not made yet; it says how far the short pair
    /// would have come.
    pub(crate) fn renew(&mut self, frame: &Frame) {
        self.prepared = false;
        if self.by == By::Explicit && self.explicit.as_ref().is_some_and(|explicit| explicit.suits_less(frame)) {
            let withdrawn = self.reach < 0.0;
            self.reach = if withdrawn { self.reach.min(-frame.h.min(-ADVANCE * self.reach)) } else { self.reach.max(frame.h) };
        }
    }

    /// Makes the polynomial of the step, once.
    pub(crate) fn prepare(&mut self, frame: &mut Frame, system: &mut dyn System) {
        if std::mem::replace(&mut self.prepared, true) {
            return;
        }
        match self.by {
            By::Rosenbrock => self.rosenbrock.iter_mut().for_each(|r| r.prepare(frame)),
            By::Explicit => self.explicit.iter_mut().for_each(|e| e.prepare(frame, system)),
            By::Short => self.short.iter_mut().for_each(|s| s.prepare(frame)),
        }
    }

    /// Degree of the polynomial.
    pub(crate) fn degree(&self) -> usize {
        match self.by {
            By::Rosenbrock | By::Short => 4,
            By::Explicit => 7,
        }
    }

    /// A box around the unknowns in some fours over the last step, found at once.
    #[inline]
    pub(crate) fn surround(&self, frame: &Frame, fours: &[u32], least: &mut [Quad], most: &mut [Quad]) {
        match (self.by, &self.explicit, &self.short) {
            (By::Explicit, Some(method), _) => method.surround(frame, fours, least, most),
            (By::Short, _, Some(method)) => method.surround(frame, fours, least, most),
            _ => self.enclose(frame, fours, least, most),
        }
    }

    /// Bounds of the unknowns in some fours over the last step, without evaluations of the
    /// equations.
    #[inline]
    pub(crate) fn enclose(&self, frame: &Frame, fours: &[u32], least: &mut [Quad], most: &mut [Quad]) {
        match (self.by, &self.rosenbrock, &self.explicit, &self.short) {
            (By::Rosenbrock, Some(method), ..) => method.enclose(frame, fours, least, most),
            (By::Explicit, _, Some(method), _) => method.enclose(frame, fours, least, most),
            (By::Short, .., Some(method)) => method.enclose(frame, fours, least, most),
            _ => {}
        }
    }

    /// Unknowns, and derivatives where they are asked for, on the polynomial.
    pub(crate) fn interpolate(&self, t: f64, y: &mut [Quad], yp: Option<&mut [Quad]>) {
        match (self.by, &self.rosenbrock, &self.explicit, &self.short) {
            (By::Rosenbrock, Some(method), ..) => method.interpolate(t, y, yp),
            (By::Explicit, _, Some(method), _) => method.interpolate(t, y, yp),
            (By::Short, .., Some(method)) => method.interpolate(t, y, yp),
            _ => {}
        }
    }

    /// The same of the Rosenbrock method alone, which has algebraic unknowns.
    pub(crate) fn interpolate_algebraic(&self, t: f64, y: &mut [Quad], yp: &mut [Quad]) {
        self.rosenbrock.iter().for_each(|r| r.interpolate(t, y, Some(&mut *yp)));
    }
}
