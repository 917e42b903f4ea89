//! One-step methods behind the [`Integrator`] trait: Rodas5P for what is stiff, DOP853 for what is
//! not (Tsit5 where one step of it will do), or whichever serves.
//!
//! A multistep code begins every control step at order one and works its way up; a one-step method
//! has its order at once. What surrounds the steps is that of IDA: tolerances, breaks, the look at
//! what time moves ([`forcing`](super::forcing)), events, integrals, failures.
//!
//! * `frame`: what a step begins and ends with; `rosenbrock`, `explicit`, `short`: the methods with
//!   their polynomials; `methods`: which of them takes the steps; `control`: step lengths;
//! * `advance`: from step to step; `algebra`: algebraic unknowns at both ends of a step.

mod advance;
mod algebra;
mod control;
mod dop853;
mod explicit;
mod frame;
mod matrix;
mod methods;
mod numbers;
mod rodas5p;
mod rosenbrock;
mod short;
mod tsit5;

#[cfg(test)]
mod tests;

use std::os::raw::c_int;
use std::panic::{AssertUnwindSafe, catch_unwind};

use self::advance::Run;
use self::algebra::Algebra;
use self::control::Control;
use self::frame::Frame;
use self::methods::Methods;
use self::numbers::{Quads, entries, zeros};
use super::enclosure::Enclosure;
use super::forcing::Forcing;
use super::nonnegative::Nonnegative;
use super::quadrature::BySteps;
use super::safe::Safe;
use super::traverse::Traverse;
use super::watch::Watch;
use super::{Advance, Carried, Edge, Integrator, Method, Quadratures, Settings, SolveError, Statistics, System};
use crate::interrupt::Pace;

/// Present point of an instance.
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
/// Everything is allocated when it is made, except for KLU's factors where a large matrix has no
/// pivots on its diagonal. Its fields are the parts of a step, from the equations' side (`frame`,
/// `algebra`, `forcing`) to `events` and `integrals`. Each is a separate type, and a step needs
/// them all at once.
pub struct OneStep {
    settings: Settings,
    frame: Frame,
    methods: Methods,
    control: Control,
    algebra: Option<Algebra>,
    forcing: Forcing,
    nonnegative: Nonnegative,
    events: Events,
    integrals: Option<Integrals>,
    /// Derivatives at the present state.
    derivative: Quads,
    /// A state within a step or a little later, and its derivatives.
    inside: [Quads; 2],
    pace: Pace,
    /// The step that fitted where the control step began, infinite if any would have; zero before
    /// it. What an action moves dies away: the last step is too long for the next beginning.
    first: f64,
    /// Steps since something went wrong.
    since_trouble: u32,
    /// The time at which the last step began.
    step_began: f64,
    time: f64,
    phase: Phase,
    longest_interval: f64,
}

/// The conditions of events and switches, and which of them have become true.
struct Events {
    watch: Watch,
    fired: Box<[c_int]>,
    /// Bounds of root functions over parts of a step are known.
    bounded: bool,
    /// The integration stops at jumps, too.
    reports_jumps: bool,
    /// The unknowns that root functions read, and the fours that they are in.
    unknowns: Box<[u32]>,
    fours: Box<[u32]>,
    /// Bounds of unknowns, in whole fours; only of those that are read are they up to date.
    enclosure: Enclosure,
    safe: Safe,
}

impl Events {
    fn new(system: &dyn System) -> Self {
        let roots = system.root_count();
        let bounded = system.root_kinds().iter().any(|kind| kind.bounded);
        let unknowns = system.watched_unknowns();
        let mut fours: Vec<u32> = unknowns.iter().map(|at| at / 4).collect();
        fours.dedup();
        let space = if bounded { 4 * system.dimension().div_ceil(4) } else { 0 };
        Self {
            watch: Watch::new(roots, system.root_kinds()),
            fired: vec![0; roots].into(),
            bounded,
            reports_jumps: system.reports_jumps(),
            unknowns: unknowns.into(),
            fours: fours.into(),
            enclosure: Enclosure::new(space),
            safe: Safe::new(space, system),
        }
    }
}

/// Integrals over the steps, and what they have come to.
struct Integrals {
    rule: BySteps,
    values: Box<[f64]>,
}

impl OneStep {
    /// An integrator for systems of this one's dimension, pattern and counts.
    ///
    /// # Errors
    /// A setting out of range, a pattern that does not fit, or an unsupported system. A system must
    /// be explicit in its derivatives, and without algebraic unknowns for the explicit method.
    pub fn new(system: &dyn System, settings: Settings) -> Result<Self, SolveError> {
        let n = system.dimension();
        settings.validate(n)?;
        let settings = settings.of_one_step_methods();
        let algebraic = system.differential().iter().position(|differential| !differential);
        check(system, settings.method, algebraic)?;
        let frame = Frame::new(system, &settings);
        let quadratures = system.quadrature_count();
        let tolerances = match settings.quadratures {
            Quadratures::Unchecked => (0.0, f64::INFINITY),
            Quadratures::Checked { rtol, atol } => (rtol, atol),
        };
        Ok(Self {
            methods: Methods::new(system, &settings, algebraic.is_some())?,
            first: 0.0,
            since_trouble: 0,
            step_began: 0.0,
            control: Control::default(),
            algebra: if algebraic.is_some() { Some(Algebra::new(system, &settings)?) } else { None },
            forcing: Forcing::new(system.forcing_count()),
            nonnegative: Nonnegative::new(system, &settings),
            events: Events::new(system),
            integrals: (quadratures > 0)
                .then(|| Integrals { rule: BySteps::new(quadratures, tolerances), values: vec![0.0; quadratures].into() }),
            derivative: zeros(n),
            inside: [zeros(n), zeros(n)],
            pace: Pace::default(),
            time: 0.0,
            phase: Phase::Idle,
            longest_interval: 0.0,
            frame,
            settings,
        })
    }

    /// Method of the steps: [`Method::Rosenbrock`] or [`Method::Explicit`].
    pub fn stepping(&self) -> Method {
        if self.methods.is_stiff() { Method::Rosenbrock } else { Method::Explicit }
    }

    /// Returns `true` if factorisations are a small part of the steps.
    pub(crate) fn is_cheap(&self) -> bool {
        self.methods.is_cheap()
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

/// Returns `true` if the method takes the system.
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
        if self.first > 0.0 {
            // An event: how the control step began says little of what comes.
            self.first = f64::INFINITY;
        }
        self.time = t0;
        self.frame.y_mut().copy_from_slice(y);
        if let Err(unknown) = self.nonnegative.restart(self.frame.y_mut()) {
            return Err(SolveError::Negative { time: t0, unknown });
        }
        if let Some(Integrals { rule, values }) = &mut self.integrals {
            values.fill(0.0);
            rule.restart(t0);
        }
        self.guarded(system, |run| run.initialise(t0, yp.is_none()))?;
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
        self.first = 0.0;
        self.methods.forget();
        self.longest_interval = 0.0;
        self.algebra.iter_mut().for_each(Algebra::forget);
        self.events.watch.edges.fill(Edge::default());
        self.events.watch.undefined = None;
        self.events.watch.forget_ties();
        self.frame.functions.counts = Statistics::default();
    }

    fn carried(&self) -> Carried {
        let step = if self.first > 0.0 { self.first.min(self.control.proposed) } else { self.control.proposed };
        Carried { step, explicit: !self.methods.is_stiff(), reach: self.methods.reach() }
    }

    fn carry(&mut self, carried: Carried) {
        self.control = Control::begin(carried.step);
        if carried.step > 0.0 {
            self.methods.take_up(carried.explicit, carried.reach);
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
        self.integrals.as_ref().map_or(&[], |integrals| &integrals.values)
    }

    fn events(&self) -> &[i32] {
        &self.events.fired
    }

    fn edges(&self) -> &[Edge] {
        &self.events.watch.edges
    }

    fn edges_mut(&mut self) -> &mut [Edge] {
        &mut self.events.watch.edges
    }

    fn undefined_event(&self) -> Option<usize> {
        self.events.watch.undefined
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
