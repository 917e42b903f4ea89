//! IDA behind the [`Integrator`] trait.

mod breaks;
mod events;
mod setup;
mod start;

use std::os::raw::c_int;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use sundials_sys::{IDA_CONV_FAIL, IDA_ERR_FAIL, IDA_REP_RES_ERR, IDA_SUCCESS, IDA_TOO_MUCH_WORK, IDA_TSTOP_RETURN};

use super::callbacks::{Bridge, Trouble};
use super::consistent::{Consistent, Inconsistent, Start, largest};
use super::forcing::{Course, Forcing};
use super::linear::Method;
use super::quadrature::Integrals;
use super::sundials::{IdaCounts, Memory, Task, check};
use super::traverse::Traverse;
use super::variational::{Stuck, Variational};
use super::vector::{Operations, Vector};
use super::{Advance, Bounds, Edge, FirstStep, IdaFlag, Integrator, Settings, SolveError, Statistics, System};

/// Present point of an instance.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// A restart is needed.
    Idle,
    /// Initial values are set; IDA has not seen them.
    Restarted,
    /// IDA is under way.
    Running,
}

/// SUNDIALS' variable-order, variable-step BDF integrator IDA.
///
/// Each instance owns its SUNDIALS context and memory: instances may be moved to and used on any
/// thread, one at a time. Everything is allocated when it is made, except for KLU's factors, which
/// are allocated at the first factorisation, and again where their pivots no longer serve or are
/// [forgotten](Integrator::forget).
pub struct Ida {
    memory: Memory,
    y: Vector,
    yp: Vector,
    quadratures: Option<Integrals>,
    consistent: Option<Consistent>,
    /// Derivatives along directions, which have their own steps.
    following: Option<Box<Variational>>,
    forcing: Forcing,
    operations: Operations,
    settings: Settings,
    shape: Shape,
    events: Box<[c_int]>,
    /// The integration stops at jumps, too.
    reports_jumps: bool,
    /// A state a little later and its derivatives, where there are events.
    later: Option<(Vector, Vector)>,
    time: f64,
    phase: Phase,
    past: Past,
    /// The system reads its past; and the longest step in the present interval.
    has_past: bool,
    longest_step: f64,
    /// The longest step by what time moves.
    course_step: f64,
}

/// Properties of the system that need no evaluation.
struct Shape {
    differential: Box<[bool]>,
    /// Row and column of each entry of the Jacobian.
    rows: Box<[usize]>,
    columns: Box<[usize]>,
    /// Bounds of the algebraic unknowns, where there are any.
    bounds: Option<Bounds>,
}

/// Data carried over from earlier integrations.
struct Past {
    /// The longest interval since the last time that everything was forgotten.
    longest_interval: f64,
    last_interval: f64,
    /// Counters of IDA since the last restart.
    counted: IdaCounts,
    /// The last step before the restart, zero if none.
    last_step: f64,
}

impl Past {
    /// Nothing was integrated.
    fn none() -> Self {
        Self { longest_interval: 0.0, last_interval: 1.0, counted: IdaCounts::default(), last_step: 0.0 }
    }
}

// SAFETY: all pointers, and all reference counts, are to objects that this instance alone owns and
// does not share, and SUNDIALS keeps no state outside of them. A system is lent during a call only.
unsafe impl Send for Ida {}

impl Ida {
    /// An integrator for systems of this one's dimension, pattern and counts.
    ///
    /// # Errors
    /// A setting out of range, a pattern that does not fit, or SUNDIALS out of memory.
    pub fn new(system: &dyn System, settings: Settings) -> Result<Self, SolveError> {
        Self::with_operations(system, settings, Operations::detect())
    }

    /// As [`new`](Self::new), without the instructions that only some processors have. Same
    /// results, for tests.
    pub fn portable(system: &dyn System, settings: Settings) -> Result<Self, SolveError> {
        Self::with_operations(system, settings, Operations::PORTABLE)
    }

    /// The linear solver in use.
    pub fn method(&self) -> Method {
        self.memory.bridge().factorisation.method()
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    fn bridge(&mut self) -> &mut Bridge {
        self.memory.bridge_mut()
    }

    /// Runs `call` with the system lent to the callbacks.
    fn lending<R>(&mut self, system: &mut dyn System, call: impl FnOnce(&mut Self) -> R) -> R {
        // SAFETY: taken back below, also after a panic.
        unsafe { self.bridge().lend(system) };
        let result = catch_unwind(AssertUnwindSafe(|| call(self)));
        self.bridge().take_back();
        result.unwrap_or_else(|panic| resume_unwind(panic))
    }

    fn flag(&self, value: c_int) -> IdaFlag {
        IdaFlag { value, message: self.memory.message() }
    }

    /// Consistent values; `first` where there were none before, so that the algebraic unknowns are
    /// guesses.
    fn initialise(&mut self, first: bool) -> Result<(), SolveError> {
        self.memory.begin();
        if !self.has_past {
            return self.make_consistent(first);
        }
        let (time, rtol) = (self.time, self.settings.rtol);
        let Self { memory, y, .. } = self;
        memory.bridge_mut().with_past(|system| system.begin(time, y.entries())).map_err(|_| self.fault())?;
        self.make_consistent(first)?;
        let Self { memory, y, yp, .. } = self;
        memory.bridge_mut().with_past(|system| system.begun(time, y.entries(), yp.entries(), rtol)).map_err(|_| self.fault())
    }

    fn make_consistent(&mut self, first: bool) -> Result<(), SolveError> {
        match &mut self.consistent {
            Some(consistent) => consistent
                .begin(self.memory.bridge_mut(), first, self.time, (&mut self.y, &mut self.yp))
                .map_err(|cause| self.inconsistent(cause)),
            None => self.search_initial_condition(first),
        }
    }

    fn inconsistent(&mut self, cause: Inconsistent) -> SolveError {
        let time = self.time;
        match cause {
            _ if self.bridge().trouble == Some(Trouble::Interrupted) => SolveError::Interrupted { time },
            Inconsistent::Callback => self.fault(),
            Inconsistent::Singular(column) => SolveError::SingularJacobian { time, column },
            Inconsistent::Outside { unknown } => SolveError::Outside { time, unknown },
            Inconsistent::Diverged { iterations, correction, unknown } => {
                SolveError::InitialConditions { time, iterations, correction, unknown }
            }
        }
    }

    /// Reason why a callback gave up.
    fn fault(&mut self) -> SolveError {
        let time = self.time;
        self.trouble().unwrap_or(SolveError::Panicked { time })
    }

    /// Error noted by the callbacks.
    fn trouble(&mut self) -> Option<SolveError> {
        let time = self.time;
        Some(match self.bridge().trouble? {
            Trouble::Residual { time, row } => SolveError::NotFinite { time, row },
            Trouble::Jacobian { time, entry } => {
                SolveError::JacobianNotFinite { time, row: self.shape.rows[entry], column: self.shape.columns[entry] }
            }
            Trouble::Singular { time, column } => SolveError::SingularJacobian { time, column },
            Trouble::TinySteps { step } => SolveError::StepTooSmall { time, step, unknown: self.largest_error() },
            Trouble::Negative { time, state } => SolveError::Negative { time, unknown: state },
            Trouble::Panic => SolveError::Panicked { time },
            Trouble::Interrupted => SolveError::Interrupted { time },
        })
    }

    /// Hands the values at the beginning to IDA, with a first step (zero: by IDA's rule).
    fn start(&mut self, step: f64) -> Result<(), SolveError> {
        self.bridge().newton.restart();
        self.memory.set_first_step(step)?;
        check("IDAReInit", self.memory.restart(self.time, &self.y, &self.yp))?;
        if let Some(history) = &mut self.memory.bridge_mut().history {
            history.begin(self.time, self.y.entries());
        }
        if let Some(quadratures) = self.quadratures.as_ref().filter(|q| q.by_steps.is_none()) {
            self.memory.restart_integrals(&quadratures.values)?;
            if let Some(rtol) = quadratures.checked() {
                self.memory.set_integral_tolerances(rtol, &quadratures.tolerances)?;
            }
        }
        self.past.counted = IdaCounts::default();
        self.phase = Phase::Running;
        Ok(())
    }

    /// The first step, or zero for IDA's rule.
    fn first_step(&mut self, interval: f64, course: Course) -> Result<f64, SolveError> {
        let (bridge, time) = (self.memory.bridge_mut(), self.time);
        let longest = if self.has_past { self.longest_step } else { f64::INFINITY };
        if let Some(quadratures) = &mut self.quadratures
            && quadratures.begin(bridge, time, interval, &self.y, &self.yp).is_err()
        {
            return Err(self.fault());
        }
        Ok(match (self.settings.first_step, &mut self.consistent) {
            (FirstStep::Fixed(step), _) => step,
            (FirstStep::Scaled { factor }, _) => factor * self.past.last_step,
            (FirstStep::Estimated { safety }, Some(consistent)) => {
                let mut start = Start { bridge, time, interval, y: &self.y, yp: &mut self.yp, quadratures: self.quadratures.as_mut() };
                let bound = course.longest_first_step(interval).min(interval).min(longest);
                let step = consistent.first_step(&mut start, safety);
                step.map(|step| consistent.look_ahead(&mut start, step.min(bound), bound, course > Course::Flat))
                    .map_err(|cause| self.inconsistent(cause))?
            }
            _ => 0.0,
        })
    }

    /// Steps to a time before the next break, or to an event.
    fn integrate(&mut self, t_end: f64) -> Result<Advance, SolveError> {
        self.memory.begin();
        let (interval, fresh) = (t_end - self.time, self.phase == Phase::Restarted);
        self.past.longest_interval = self.past.longest_interval.max(interval);
        if fresh && self.settle()? {
            return Ok(Advance::Event);
        }
        if interval == 0.0 {
            return Ok(Advance::Reached);
        }
        let course = self.look_inside(interval)?;
        let step = if fresh { self.first_step(interval, course)? } else { self.past.last_step }.min(interval);
        self.past.last_interval = interval;
        let value = self.attempt(t_end, fresh.then_some(step))?;
        if self.has_passed_event(value)? {
            self.locate()?;
            return Ok(Advance::Event);
        }
        if !matches!(value, IDA_SUCCESS | IDA_TSTOP_RETURN) {
            return Err(self.failure(value));
        }
        self.time = t_end;
        self.memory.bridge().nonnegative.clip(self.y.entries_mut());
        if let Some(quadratures) = self.quadratures.as_mut().filter(|q| q.by_steps.is_none()) {
            self.memory.take_integrals(&mut quadratures.values)?;
        }
        Ok(Advance::Reached)
    }

    /// Lets IDA step to `t_end`, anew if a first step is given, and returns its flag.
    fn attempt(&mut self, t_end: f64, first_step: Option<f64>) -> Result<c_int, SolveError> {
        let Some(step) = first_step else { return self.run(t_end) };
        self.start(step)?;
        let value = self.run(t_end)?;
        let stuck = matches!(value, IDA_ERR_FAIL | IDA_CONV_FAIL | IDA_REP_RES_ERR);
        if !stuck || self.past.counted.steps > 0 || self.settings.first_step == FirstStep::Ida {
            return Ok(value);
        }
        // Our first step was too long to be corrected by IDA's few reductions; its own rule is more
        // careful.
        self.start(0.0)?;
        self.run(t_end)
    }

    /// Lets IDA step on to `t_end` and returns its flag.
    fn run(&mut self, t_end: f64) -> Result<c_int, SolveError> {
        self.memory.set_end(t_end)?;
        // After each Newton iteration IDA sets y and y', which its quadratures look at, and events
        // where derivatives follow: a single step ends with those of its last iteration. What else
        // IDA returns is interpolated.
        let integrates = self.quadratures.as_ref().is_some_and(|q| q.by_steps.is_none());
        let by_steps = self.following.is_some() || self.has_past || (self.quadratures.is_some() && !integrates);
        self.discard(!integrates && self.following.is_none() && !self.has_past);
        let value = match by_steps {
            true => self.run_by_steps(t_end),
            false => Ok(self.memory.solve(t_end, &mut self.time, &mut self.y, &mut self.yp, Task::Normal)),
        };
        self.discard(false);
        self.count();
        value
    }

    /// As IDA alone, with a look at each step for the integrals.
    fn run_by_steps(&mut self, t_end: f64) -> Result<c_int, SolveError> {
        for _ in 0..self.settings.max_steps {
            let begin = self.time;
            let value = self.memory.solve(t_end, &mut self.time, &mut self.y, &mut self.yp, Task::OneStep);
            if !matches!(value, IDA_SUCCESS | IDA_TSTOP_RETURN) {
                return Ok(value);
            }
            self.record((begin, self.time))?;
            if self.has_past {
                self.lengthen_steps()?;
            }
            if let Some(quadratures) = &mut self.quadratures {
                quadratures.next_step(begin);
            }
            self.take(self.time)?;
            // Derivatives do not go beyond an event, which IDA's next step would notice.
            if self.following.is_some() && self.looks_passed()? {
                return Ok(value);
            }
            self.follow(self.time, t_end)?;
            if value == IDA_TSTOP_RETURN || self.time >= t_end {
                return Ok(value);
            }
        }
        Ok(IDA_TOO_MUCH_WORK)
    }

    /// Lets a system that reads its past record the last step.
    fn record(&mut self, span: (f64, f64)) -> Result<(), SolveError> {
        if !self.has_past {
            return Ok(());
        }
        let rtol = self.settings.rtol;
        let Self { memory, later, .. } = self;
        let Some((y, yp)) = later else { return Ok(()) };
        memory.bridge_mut().record(span, rtol, (y, yp)).map_err(|_| self.fault())
    }

    /// Takes the integrals up to a time in the last step.
    fn take(&mut self, to: f64) -> Result<(), SolveError> {
        let bridge = self.memory.bridge_mut();
        let taken = self.quadratures.as_mut().map_or(Ok(()), |quadratures| quadratures.take(bridge, to));
        taken.map_err(|_| self.fault())
    }

    /// Lets the derivatives along directions follow the unknowns, as far as their steps fit before
    /// `end`.
    fn follow(&mut self, to: f64, end: f64) -> Result<(), SolveError> {
        let bridge = self.memory.bridge_mut();
        let followed = self.following.as_mut().map_or(Ok(()), |following| following.catch_up(bridge, to, end));
        followed.map_err(|stuck| self.stuck(stuck))
    }

    /// Takes derivatives along directions in, for a system with such, of which this one's is the
    /// leading part.
    pub(super) fn add_following(&mut self, whole: &dyn System, settings: &Settings) -> Result<(), SolveError> {
        self.following = Some(Box::new(Variational::new(whole, settings, self.operations, self.memory.context())?));
        Ok(())
    }

    /// The derivatives along directions.
    pub(super) fn following(&self) -> Option<&Variational> {
        self.following.as_deref()
    }

    /// Begins them at the present state, which is consistent.
    pub(super) fn begin_following(&mut self, system: &mut dyn System, s: &[f64]) -> Result<(), SolveError> {
        self.lending(system, |ida| {
            let (bridge, time) = (ida.memory.bridge_mut(), ida.time);
            let begun = ida.following.as_mut().map_or(Ok(()), |following| following.begin(bridge, time, (&ida.y, &ida.yp), s));
            begun.map_err(|stuck| ida.stuck(stuck))
        })
    }

    fn stuck(&mut self, stuck: Stuck) -> SolveError {
        match stuck {
            Stuck::Callback => self.fault(),
            Stuck::Error(error) => error,
        }
    }

    fn discard(&mut self, discards: bool) {
        self.y.set_discards(discards);
        self.yp.set_discards(discards);
    }

    /// Adds what IDA counted since the last time, and notes the step.
    fn count(&mut self) {
        let (before, now) = (self.past.counted, self.memory.counts());
        self.past.counted = now;
        let bridge = self.bridge();
        bridge.counts.steps += (now.steps - before.steps) as u64;
        bridge.counts.error_test_failures += (now.error_test_failures - before.error_test_failures) as u64;
        bridge.counts.nonlinear_failures += (now.nonlinear_failures - before.nonlinear_failures) as u64;
        // The very last step may be a short one, cut at the stop time; the one before it was free.
        let free = if now.steps > 1 { bridge.last_step() } else { 0.0 };
        self.past.last_step = now.last_step.max(free);
    }

    fn failure(&mut self, value: c_int) -> SolveError {
        if let Some(error) = self.trouble() {
            return error;
        }
        let (time, flag) = (self.time, self.flag(value));
        match value {
            IDA_TOO_MUCH_WORK => {
                SolveError::TooManySteps { time, steps: self.settings.max_steps, unknown: self.largest_error(), event: None }
            }
            IDA_ERR_FAIL => SolveError::ErrorTestFailures { time, flag, unknown: self.largest_error() },
            IDA_CONV_FAIL => SolveError::ConvergenceFailures { time, flag, unknown: self.largest_correction() },
            _ => SolveError::Other { time, flag },
        }
    }

    /// The unknown with the largest local error of the last step that was tried.
    fn largest_error(&self) -> Option<usize> {
        let (mut errors, weights) = (self.unknowns(), self.weights()?);
        self.memory.local_errors(&mut errors).then(|| largest(errors.entries(), weights.entries())).flatten()
    }

    /// The unknown that Newton's method last corrected most.
    fn largest_correction(&self) -> Option<usize> {
        largest(self.memory.bridge().newton.corrections(), self.weights()?.entries())
    }

    /// The unknown whose equation is furthest from holding at the present y and y'.
    fn largest_residual(&mut self) -> Option<usize> {
        let mut out = self.unknowns();
        self.memory.bridge_mut().evaluate(self.time, &self.y, &self.yp, &mut out).ok()?;
        largest(out.entries(), &vec![1.0; self.shape.differential.len()])
    }

    /// The present error weights: reciprocal tolerances.
    fn weights(&self) -> Option<Vector> {
        let mut weights = self.unknowns();
        self.memory.error_weights(&mut weights).then_some(weights)
    }

    /// A vector with a place for each unknown.
    fn unknowns(&self) -> Vector {
        Vector::zeros(self.shape.differential.len(), self.operations, self.memory.context())
    }
}

impl Integrator for Ida {
    fn restart(&mut self, system: &mut dyn System, t0: f64, y: &[f64], yp: Option<&[f64]>) -> Result<(), SolveError> {
        self.phase = Phase::Idle;
        let n = self.shape.differential.len();
        let lengths = [("system", system.dimension()), ("y", y.len()), ("yp", yp.map_or(n, <[f64]>::len))];
        if let Some((name, given)) = lengths.into_iter().find(|&(_, given)| given != n) {
            return Err(SolveError::Length { name, given, expected: n });
        }
        if !t0.is_finite() {
            return Err(SolveError::Interval { from: t0, to: t0 });
        }
        self.time = t0;
        self.y.entries_mut().copy_from_slice(y);
        if let Err(unknown) = self.memory.bridge_mut().nonnegative.restart(self.y.entries_mut()) {
            return Err(SolveError::Negative { time: t0, unknown });
        }
        match yp {
            Some(yp) => self.yp.entries_mut().copy_from_slice(yp),
            None => self.yp.entries_mut().fill(0.0),
        }
        if let Some(quadratures) = &mut self.quadratures {
            quadratures.restart(t0);
        }
        self.lending(system, |ida| ida.initialise(yp.is_none()))?;
        self.bridge().counts.restarts += 1;
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
        let n = self.shape.differential.len();
        if system.dimension() != n {
            return Err(SolveError::Length { name: "system", given: system.dimension(), expected: n });
        }
        let result = self.lending(system, |ida| ida.go_to_event(t_end));
        if result.is_err() {
            self.phase = Phase::Idle;
        }
        result
    }

    fn forget(&mut self) {
        self.phase = Phase::Idle;
        self.past = Past { counted: self.past.counted, ..Past::none() };
        if let Some(consistent) = &mut self.consistent {
            consistent.forget();
        }
        self.following.iter_mut().for_each(|following| following.forget());
        let bridge = self.bridge();
        bridge.factorisation.forget();
        bridge.newton.forget();
        bridge.watch.edges.fill(Edge::default());
        bridge.watch.undefined = None;
        bridge.watch.forget_ties();
        bridge.counts = Statistics::default();
    }

    fn time(&self) -> f64 {
        self.time
    }

    fn state(&self) -> &[f64] {
        self.y.entries()
    }

    fn derivative(&self) -> &[f64] {
        self.yp.entries()
    }

    fn quadratures(&self) -> &[f64] {
        self.quadratures.as_ref().map_or(&[], |quadratures| quadratures.values.entries())
    }

    fn events(&self) -> &[i32] {
        &self.events
    }

    fn edges(&self) -> &[Edge] {
        &self.memory.bridge().watch.edges
    }

    fn edges_mut(&mut self) -> &mut [Edge] {
        &mut self.bridge().watch.edges
    }

    fn undefined_event(&self) -> Option<usize> {
        self.memory.bridge().watch.undefined
    }

    fn statistics(&self) -> Statistics {
        self.memory.bridge().counts
    }
}
