//! One-step methods behind the [`Integrator`] trait: Rodas5P for what is stiff, DOP853 for what is not, or whichever serves.
//!
//! A multistep code begins every control step at order one and works its way up; a one-step method has its order at once. What surrounds the
//! steps is that of IDA: tolerances, breaks, the look at what time moves ([`forcing`](super::forcing)), events, integrals, failures.
//!
//! * `frame`: what a step begins and ends with; `rosenbrock`, `explicit`: the two methods with their polynomials; `control`: step lengths;
//! * `advance`: from step to step; `algebra`: algebraic unknowns at both ends of an advance.

mod advance;
mod algebra;
mod control;
mod dop853;
mod explicit;
mod frame;
mod matrix;
mod numbers;
mod rodas5p;
mod rosenbrock;

#[cfg(test)]
mod tests;

use std::os::raw::c_int;
use std::panic::{AssertUnwindSafe, catch_unwind};

use self::advance::Run;
use self::algebra::Algebra;
use self::control::{Control, Growth};
use self::explicit::Explicit;
use self::frame::Frame;
use self::numbers::{Quads, entries, zeros};
use self::rosenbrock::Rosenbrock;
use super::forcing::Forcing;
use super::quadrature::BySteps;
use super::traverse::Traverse;
use super::watch::Watch;
use super::{Advance, Carried, Edge, Integrator, Method, Quadratures, Settings, SolveError, Statistics, System};
use crate::interrupt::Pace;

/// Where an instance stands.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// A restart is needed.
    Idle,
    /// Initial values are set.
    Restarted,
    /// On the way.
    Running,
}

/// A one-step method.
///
/// Everything is allocated when it is made, except for KLU's factors where a large matrix has no pivots on its diagonal.
pub struct OneStep {
    settings: Settings,
    frame: Frame,
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
    control: Control,
    algebra: Option<Algebra>,
    forcing: Forcing,
    watch: Watch,
    events: Box<[c_int]>,
    integrals: Option<BySteps>,
    values: Box<[f64]>,
    /// Derivatives at the present state.
    derivative: Quads,
    /// A state within a step or a little later, and its derivatives.
    inside: [Quads; 2],
    pace: Pace,
    /// Steps since something went wrong.
    since_trouble: u32,
    time: f64,
    phase: Phase,
    /// The polynomial is that of the last step.
    prepared: bool,
    longest_interval: f64,
}

impl OneStep {
    /// An integrator for systems of this one's dimension, pattern and counts.
    ///
    /// # Errors
    /// A setting out of range, a pattern that does not fit, or a system that the method does not take: one that is not explicit in its
    /// derivatives, and for the explicit method one with algebraic unknowns.
    pub fn new(system: &dyn System, settings: Settings) -> Result<Self, SolveError> {
        let n = system.dimension();
        settings.validate(n)?;
        let algebraic = system.differential().iter().position(|differential| !differential);
        check(system, settings.method, algebraic)?;
        let frame = Frame::new(system, &settings);
        let stiff = settings.method != Method::Explicit;
        let explicit = settings.method != Method::Rosenbrock && algebraic.is_none();
        let (roots, quadratures) = (system.root_count(), system.quadrature_count());
        let tolerances = match settings.quadratures {
            Quadratures::Unchecked => (0.0, f64::INFINITY),
            Quadratures::Checked { rtol, atol } => (rtol, atol),
        };
        Ok(Self {
            rosenbrock: if stiff { Some(Rosenbrock::new(system, settings.linear_solver)?) } else { None },
            explicit: explicit.then(|| Explicit::new(n)),
            stiff,
            by_rosenbrock: stiff,
            since_trouble: 0,
            misfits: 0,
            calm: 0,
            control: Control::default(),
            algebra: if algebraic.is_some() { Some(Algebra::new(system, &settings)?) } else { None },
            forcing: Forcing::new(system.forcing_count()),
            watch: Watch::new(roots, system.root_kinds()),
            events: vec![0; roots].into(),
            integrals: (quadratures > 0).then(|| BySteps::new(quadratures, tolerances)),
            values: vec![0.0; quadratures].into(),
            derivative: zeros(n),
            inside: [zeros(n), zeros(n)],
            pace: Pace::default(),
            time: 0.0,
            phase: Phase::Idle,
            prepared: false,
            longest_interval: 0.0,
            frame,
            settings,
        })
    }

    /// Which of the two methods takes the steps: [`Method::Rosenbrock`] or [`Method::Explicit`].
    pub fn stepping(&self) -> Method {
        if self.stiff { Method::Rosenbrock } else { Method::Explicit }
    }

    fn growth(&self) -> Growth {
        if self.stiff { Growth::Fifth } else { Growth::Eighth }
    }

    /// Runs `work` with the system; no panic gets out.
    fn guarded<R>(&mut self, system: &mut dyn System, work: impl FnOnce(&mut Run<'_>) -> Result<R, SolveError>) -> Result<R, SolveError> {
        let time = self.time;
        self.frame.functions.trouble = None;
        let result = catch_unwind(AssertUnwindSafe(|| work(&mut Run { one: &mut *self, system })));
        let result = result.unwrap_or(Err(SolveError::Panicked { time }));
        if result.is_err() {
            self.phase = Phase::Idle;
        }
        result
    }

    fn check_length(&self, name: &'static str, given: usize) -> Result<(), SolveError> {
        let expected = self.frame.n;
        if given == expected { Ok(()) } else { Err(SolveError::Length { name, given, expected }) }
    }
}

/// Whether the method takes the system.
fn check(system: &dyn System, method: Method, algebraic: Option<usize>) -> Result<(), SolveError> {
    let n = system.dimension();
    let pattern = system.pattern().dimension() * (1 + system.directions());
    let lengths = [("pattern", pattern), ("differential", system.differential().len())];
    if let Some((name, given)) = lengths.into_iter().find(|&(_, given)| given != n) {
        return Err(SolveError::Length { name, given, expected: n });
    }
    match (method, algebraic) {
        _ if !system.is_explicit() => Err(SolveError::Implicit { method }),
        (Method::Explicit, Some(unknown)) => Err(SolveError::Algebraic { unknown }),
        _ => Ok(()),
    }
}

impl Integrator for OneStep {
    fn restart(&mut self, system: &mut dyn System, t0: f64, y: &[f64], yp: Option<&[f64]>) -> Result<(), SolveError> {
        self.phase = Phase::Idle;
        self.check_length("system", system.dimension())?;
        self.check_length("y", y.len())?;
        self.check_length("yp", yp.map_or(self.frame.n, <[f64]>::len))?;
        if !t0.is_finite() {
            return Err(SolveError::Interval { from: t0, to: t0 });
        }
        self.time = t0;
        self.frame.y_mut().copy_from_slice(y);
        self.values.fill(0.0);
        if let Some(integrals) = &mut self.integrals {
            integrals.restart(t0);
        }
        self.guarded(system, |run| run.initialise(t0))?;
        self.frame.functions.counts.restarts += 1;
        self.phase = Phase::Restarted;
        Ok(())
    }

    fn advance(&mut self, system: &mut dyn System, t_end: f64) -> Result<Advance, SolveError> {
        if self.phase == Phase::Idle {
            return Err(SolveError::NotStarted);
        }
        let from = self.time;
        let least = 4.0 * f64::EPSILON * (from.abs() + t_end.abs());
        if !t_end.is_finite() || (t_end != from && t_end - from <= least) {
            return Err(SolveError::Interval { from, to: t_end });
        }
        self.check_length("system", system.dimension())?;
        self.guarded(system, |run| run.go_to_event(t_end))
    }

    fn forget(&mut self) {
        self.phase = Phase::Idle;
        self.control = Control::default();
        self.stiff = self.rosenbrock.is_some();
        (self.misfits, self.calm) = (0, 0);
        self.longest_interval = 0.0;
        self.rosenbrock.iter_mut().for_each(Rosenbrock::forget);
        self.algebra.iter_mut().for_each(Algebra::forget);
        self.watch.edges.fill(Edge::default());
        self.watch.undefined = None;
        self.frame.functions.counts = Statistics::default();
    }

    fn carried(&self) -> Carried {
        Carried { step: self.control.proposed, explicit: !self.stiff }
    }

    fn carry(&mut self, carried: Carried) {
        self.control = Control::begin(carried.step);
        if carried.step > 0.0 {
            self.stiff = if carried.explicit { self.explicit.is_none() } else { self.rosenbrock.is_some() };
        }
    }

    fn time(&self) -> f64 {
        self.time
    }

    fn state(&self) -> &[f64] {
        self.frame.y()
    }

    fn derivative(&self) -> &[f64] {
        entries(&self.derivative, self.frame.n)
    }

    fn quadratures(&self) -> &[f64] {
        &self.values
    }

    fn events(&self) -> &[i32] {
        &self.events
    }

    fn edges(&self) -> &[Edge] {
        &self.watch.edges
    }

    fn edges_mut(&mut self) -> &mut [Edge] {
        &mut self.watch.edges
    }

    fn undefined_event(&self) -> Option<usize> {
        self.watch.undefined
    }

    fn statistics(&self) -> Statistics {
        let mut counts = self.frame.functions.counts;
        if let Some(algebra) = &self.algebra {
            let others = algebra.counts();
            counts.residuals += others.residuals;
            counts.jacobians += others.jacobians;
            counts.factorisations += others.factorisations;
            counts.not_finite += others.not_finite;
        }
        counts
    }
}
