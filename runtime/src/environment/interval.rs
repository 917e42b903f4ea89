//! From one sampling instant to the next.

use smpl_compiler::ir::Builtin;
use smpl_compiler::layout::{FramePart, Region};
use smpl_compiler::model::{RootAction, Solver};

use super::{Environment, Firing};
use crate::failure::{Cause, Chatter, SolverFailure};
use crate::observe::variate;
use crate::random::Stream;
use crate::solver::{Advance, SolveError, Statistics};

/// End of an interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum IntervalEnd {
    /// At its end.
    Completed,
    /// At an event that is a failure, by its index.
    Event(u32),
    /// At an event that is a success, by its index.
    Success(u32),
    /// Time at which events follow one another without end.
    Chatter,
    /// Place of an update whose state or discrete variable is not finite.
    Broken,
    /// The integrator gave up; the state is as before.
    Solver,
    /// It was not run; the state is as before.
    NotRun,
}

/// An event that comes again within this part of the step, sooner than the last time, accumulates.
const ACCUMULATION: f64 = 1e-9;

/// Number of successive shorter intervals that count as accumulation; rounding does not cause so
/// many.
const EVER_SOONER: u32 = 50;

/// Share of a constraint's derivatives below which a failure of the integrator is put down to it.
const NEARLY: f64 = 0.05;

impl Environment {
    /// Applies a finite action and integrates to the end of the interval, or to what ends it.
    pub(super) fn run_interval(&mut self, action: &[f64]) -> IntervalEnd {
        self.prepare(action);
        // An update may have left nothing to integrate.
        let broken = self.setup.programs.has_start && self.broken_variable().is_some();
        let mut outcome = if broken { IntervalEnd::Broken } else { self.integrate() };
        if outcome == IntervalEnd::Solver && self.may_retry() {
            outcome = self.retry();
        }
        match outcome {
            IntervalEnd::Solver => {
                self.go_back();
                self.stop_at(self.begin);
            }
            IntervalEnd::Broken if broken => self.stop_at(self.begin),
            _ => {
                self.system.region_mut(Region::Quadrature).copy_from_slice(&self.integrals);
                if self.setup.programs.has_end && outcome == IntervalEnd::Completed {
                    self.run_end();
                }
            }
        }
        outcome
    }

    /// Returns whether the other implicit method may take the step: the failure is one of a method,
    /// and the model takes both.
    fn may_retry(&self) -> bool {
        let failure = self.progress.verdict.solver_failure;
        let cause = failure.map(|failure| failure.cause);
        let of_method = match cause {
            Some(Cause::NoConvergence | Cause::Singular | Cause::Inconsistent | Cause::Other(_)) => true,
            // A smaller limit is one of the work that a step may take.
            Some(Cause::TooManySteps) => {
                failure.is_some_and(|f| f.event.is_none()) && self.setup.settings.max_steps >= Solver::default().max_steps
            }
            _ => false,
        };
        of_method && self.trace.is_none() && self.drifts.is_empty() && self.setup.other_method().is_some()
    }

    /// Repeats the step from its start with the other implicit method. If that also fails, the
    /// failure of the first one counts.
    #[cold]
    fn retry(&mut self) -> IntervalEnd {
        let first = self.progress.verdict.solver_failure;
        let Some(mut other) = self.spare.take().or_else(|| self.setup.other_integrator()) else { return IntervalEnd::Solver };
        self.go_back();
        self.system.copy(Region::Previous(FramePart::Disturbance), Region::Disturbance);
        self.progress.verdict.solver_failure = None;
        self.collect_statistics();
        self.statistics.retries += 1;
        std::mem::swap(&mut self.integrator, &mut other);
        self.progress.event_time = None;
        self.firings.clear();
        self.enter();
        let outcome = self.integrate();
        self.collect_statistics();
        std::mem::swap(&mut self.integrator, &mut other);
        self.integrator.forget();
        self.spare = Some(other);
        let says_more = |f: SolverFailure| matches!(f.cause, Cause::Interrupted | Cause::Switching);
        if outcome == IntervalEnd::Solver && !self.progress.verdict.solver_failure.is_some_and(says_more) {
            self.progress.verdict.solver_failure = first;
        }
        outcome
    }

    /// Time at its end, as integrated. Where nothing is left out it is to the last bit the time at
    /// which the next interval begins: an event between the two would be seen by neither.
    pub(super) fn end_time(&self) -> f64 {
        let episode = &self.setup.model().interface().episode;
        let steps = f64::from(self.progress.steps);
        let end = if episode.integrate == episode.step { (steps + 1.0) * episode.step } else { steps * episode.step + episode.integrate };
        if self.share < 1.0 { self.begin + self.share * (end - self.begin) } else { end }
    }

    pub(super) fn prepare(&mut self, action: &[f64]) {
        self.apply(action);
        self.enter();
    }

    /// Disturbances and updates `at start`, at the state and with the action that have been
    /// applied.
    fn enter(&mut self) {
        self.disturb(self.begin);
        let t0 = self.begin;
        let (model, memory) = self.system.parts();
        if self.setup.programs.has_start {
            model.start(memory, t0, &mut self.progress.y);
        }
        model.prepare_step(memory);
        if self.setup.corrections.set_at_start {
            self.project_after_reset(t0);
        }
    }

    /// Keeps what was, and applies the action.
    pub(super) fn apply(&mut self, action: &[f64]) {
        let (t0, steps) = (self.time(), self.progress.steps);
        self.begin = t0;
        self.system.keep(&self.progress.y, Region::Previous);
        self.scratch.copy_from_slice(&self.progress.yp);
        let region = self.system.region_mut(Region::Action);
        let single = self.setup.model().interface().episode.single_precision;
        for (element, &value) in self.setup.catalogue.actions.elements().iter().zip(action) {
            let rounded = || f64::from((value / element.scale) as f32) * element.scale;
            region[element.at] = if single { rounded() } else { value };
        }
        self.progress.event_time = None;
        self.firings.clear();
        self.set_builtins([
            (Builtin::Steps, f64::from(steps)),
            (Builtin::Clock, t0),
            (Builtin::Begin, t0),
            (Builtin::Failed, 0.0),
            (Builtin::ActionExcess, 0.0),
        ]);
    }

    /// New values of the disturbances: drawn, then replaced by recorded ones.
    fn disturb(&mut self, t0: f64) {
        self.draw_disturbances();
        if self.setup.programs.has_disturbances {
            let (model, memory) = self.system.parts();
            model.disturb(memory, t0);
        }
        self.replay_disturbances();
    }

    /// The step's random numbers.
    pub(super) fn draw_disturbances(&mut self) {
        let step = self.progress.steps + 1;
        for draw in self.setup.draws.iter().filter(|d| d.each_step && !self.progress.expected) {
            let stream = Stream::from_hash(self.progress.key, draw.stream);
            let value = variate(&stream, draw.kind, step, draw.element);
            self.system.region_mut(Region::Draw)[draw.at] = value;
        }
    }

    /// Recorded disturbances take the place of drawn ones.
    pub(super) fn replay_disturbances(&mut self) {
        for replay in &self.replay {
            if let Some(&value) = replay.values.get(replay.row(self.progress.steps)).or(replay.values.last()) {
                self.system.region_mut(Region::Disturbance)[replay.at] = value;
            }
        }
    }

    pub(super) fn integrate(&mut self) -> IntervalEnd {
        // What earlier steps left behind would make results depend on history (order of pivots).
        self.collect_statistics();
        self.integrator.forget();
        self.integrator.carry(self.progress.carried);
        self.system.trim_past(self.begin);
        self.integrals.fill(0.0);
        // Switches of the equations are taken as they are.
        let count = self.progress.edges.len();
        self.integrator.edges_mut()[..count].copy_from_slice(&self.progress.edges);
        let end = self.end_time();
        let (mut t, mut events) = (self.begin, 0);
        let outcome = loop {
            match self.advance(t, end) {
                Ok(advance) => {
                    self.take_state();
                    self.add_integrals();
                    if advance == Advance::Reached {
                        break IntervalEnd::Completed;
                    }
                }
                Err(error) => {
                    let mut failure = blame(&error, t);
                    failure.event = failure.event.or_else(|| self.undetermined());
                    self.progress.verdict.solver_failure = Some(failure);
                    return IntervalEnd::Solver;
                }
            }
            // What is left within the rounding of time cannot be integrated.
            let found = self.integrator.time();
            t = if end - found <= 8.0 * f64::EPSILON * (found.abs() + end.abs()) { end } else { found };
            events += 1;
            if let Some(outcome) = self.handle_events(t).or_else(|| self.chatter(t, events)) {
                self.stop_at(t);
                // What the last event changed is seen by the algebraic unknowns.
                let (y, yp) = (&self.progress.y, Some(self.progress.yp.as_slice()));
                if outcome == IntervalEnd::Chatter && self.integrator.restart(&mut self.system, t, y, yp).is_ok() {
                    self.take_state();
                }
                break outcome;
            }
        };
        self.progress.edges.copy_from_slice(&self.integrator.edges()[..count]);
        self.progress.carried = self.integrator.carried();
        outcome
    }

    /// The constraint of a reduced system that hardly determines what follows from it, where the
    /// integrator failed; by its root function.
    fn undetermined(&mut self) -> Option<usize> {
        let setup = std::sync::Arc::clone(&self.setup);
        if setup.model().interface().reduction.guards.is_empty() {
            return None;
        }
        let mut values = vec![f64::NAN; setup.model().watched().len()];
        let (t, y, yp) = (self.integrator.time(), self.integrator.state(), self.integrator.derivative());
        crate::solver::System::roots(&mut self.system, t, y, yp, &mut values);
        let near = (0..setup.model().roots_info().len()).filter(|&event| setup.model().guard(event).is_some() && values[event] > -NEARLY);
        near.max_by(|&a, &b| values[a].total_cmp(&values[b]))
    }

    /// The step ends here, where its state is that of.
    pub(super) fn stop_at(&mut self, t: f64) {
        self.progress.event_time = Some(t);
    }

    fn advance(&mut self, t: f64, end: f64) -> Result<Advance, SolveError> {
        self.integrator.restart(&mut self.system, t, &self.progress.y, Some(&self.progress.yp))?;
        if self.trace.is_some() {
            return self.advance_traced(t, end);
        }
        if self.drifts.is_empty() { self.integrator.advance(&mut self.system, end) } else { self.advance_watched(t, end) }
    }

    pub(super) fn take_state(&mut self) {
        self.progress.y.copy_from_slice(self.integrator.state());
        self.progress.yp.copy_from_slice(self.integrator.derivative());
        self.system.look_back(self.integrator.time(), &self.progress.y, &self.progress.yp);
    }

    /// A restart sets the integrator's quadratures to zero: what they have come to is kept before.
    fn add_integrals(&mut self) {
        for (sum, part) in self.integrals.iter_mut().zip(self.integrator.quadratures()) {
            *sum += part;
        }
    }

    /// Does what the fired events ask for; how the interval ends if they end it.
    fn handle_events(&mut self, t: f64) -> Option<IntervalEnd> {
        let failure = self.fired_failure();
        self.note_events(t);
        self.set_builtin(Builtin::Clock, t);
        let (mut ran, mut moved) = (false, false);
        for index in 0..self.progress.edges.len() {
            let action = self.setup.model().roots_info()[index].action;
            if let (1, RootAction::Run(program)) = (self.integrator.events()[index], action) {
                let (model, memory) = self.system.parts();
                model.event(program as usize, memory, t, &mut self.progress.y);
                ran = true;
                moved |= self.setup.corrections.set_by[index];
            }
        }
        self.set_builtin(Builtin::Clock, self.begin);
        if moved {
            self.project_after_reset(t);
        }
        if ran && self.broken_variable().is_some() {
            return Some(IntervalEnd::Broken);
        }
        if ran || failure.is_none() {
            let (model, memory) = self.system.parts();
            model.prepare_step(memory);
        }
        failure.map(IntervalEnd::Event).or_else(|| self.fired_success().map(IntervalEnd::Success))
    }

    /// The first success among the events that fired.
    fn fired_success(&self) -> Option<u32> {
        let fired = self.integrator.events().iter().zip(self.setup.model().roots_info());
        fired.into_iter().find_map(|(&fired, root)| match root.action {
            RootAction::Succeed(success) if fired > 0 => Some(success),
            _ => None,
        })
    }

    /// The first failure among the events that fired.
    fn fired_failure(&self) -> Option<u32> {
        let fired = self.integrator.events().iter().zip(self.setup.model().roots_info());
        fired.into_iter().find_map(|(&fired, root)| match root.action {
            RootAction::Fail(failure) if fired > 0 => Some(failure),
            _ => None,
        })
    }

    /// Notes which events fired; an end if there are too many of them, or if one accumulates.
    fn chatter(&mut self, t: f64, events: u32) -> Option<IntervalEnd> {
        let soon = ACCUMULATION * self.setup.model().interface().episode.step;
        let mut accumulates = false;
        for (index, firing) in self.firings.each.iter_mut().enumerate().filter(|(index, _)| self.integrator.events()[*index] != 0) {
            self.firings.last = Some(index);
            let gap = t - firing.time;
            if gap > 0.0 && gap <= soon && firing.gap.is_finite() && gap <= firing.gap {
                accumulates = true;
            }
            let sooner = if gap < firing.gap { firing.sooner + 1 } else { 0 };
            *firing = Firing { time: t, gap, sooner };
        }
        if !accumulates && events < self.setup.max_events {
            return None;
        }
        // Another one at the same instant shows two that undo each other.
        let last = self.firings.last;
        let accumulates = accumulates || last.is_some_and(|index| self.firings.each[index].sooner >= EVER_SOONER);
        let other = |&index: &usize| Some(index) != last && self.firings.each[index].time == t;
        let partner = (0..self.firings.each.len()).find(other);
        self.progress.chatter = Some(Chatter { time: t, event: last.unwrap_or_default(), partner, accumulates });
        Some(IntervalEnd::Chatter)
    }

    /// `at end`, and what depends on the states that it changed.
    pub(super) fn run_end(&mut self) {
        let t = self.end_time();
        self.project_before_end(t);
        self.scratch.copy_from_slice(&self.progress.y);
        let (model, memory) = self.system.parts();
        model.end(memory, t, &mut self.progress.y);
        let moved = self.scratch != self.progress.y;
        if moved && (model.unknowns() > model.states() || self.setup.programs.derivatives_at_end) {
            model.prepare_step(memory);
            // A failure to find consistent algebraic variables will show in the restart of the next
            // step.
            if self.integrator.restart(&mut self.system, t, &self.progress.y, Some(&self.progress.yp)).is_ok() {
                self.take_state();
            }
        }
    }

    /// The state as before the step. The action that was given stays, for those who look what it
    /// was.
    fn go_back(&mut self) {
        self.progress.y.copy_from_slice(self.system.region(Region::Previous(FramePart::Y)));
        self.progress.yp.copy_from_slice(&self.scratch);
        self.system.copy(Region::Previous(FramePart::Discrete), Region::Discrete);
        self.system.look_back(self.begin, &self.progress.y, &self.progress.yp);
        let (model, memory) = self.system.parts();
        model.prepare_step(memory);
    }

    pub(super) fn collect_statistics(&mut self) {
        add(&mut self.statistics, &self.integrator.statistics());
    }
}

pub(super) fn add(sum: &mut Statistics, part: &Statistics) {
    sum.steps += part.steps;
    sum.residuals += part.residuals;
    sum.jacobians += part.jacobians;
    sum.factorisations += part.factorisations;
    sum.linear_solves += part.linear_solves;
    sum.error_test_failures += part.error_test_failures;
    sum.nonlinear_failures += part.nonlinear_failures;
    sum.not_finite += part.not_finite;
    sum.restarts += part.restarts;
    sum.retries += part.retries;
}

/// The failure that an error of the solver is; `start` is where the attempt began.
pub(super) fn blame(error: &SolveError, start: f64) -> SolverFailure {
    let (time, cause, unknown) = match error {
        SolveError::TooManySteps { time, unknown, .. } => (*time, Cause::TooManySteps, *unknown),
        SolveError::Switching { time, .. } => (*time, Cause::Switching, None),
        SolveError::StepTooSmall { time, unknown, .. }
        | SolveError::ErrorTestFailures { time, unknown, .. }
        | SolveError::ConvergenceFailures { time, unknown, .. } => (*time, Cause::NoConvergence, *unknown),
        SolveError::NotFinite { time, row } | SolveError::JacobianNotFinite { time, row, .. } => (*time, Cause::NotFinite, Some(*row)),
        SolveError::SingularJacobian { time, column } => (*time, Cause::Singular, *column),
        SolveError::InitialConditions { time, unknown, .. } | SolveError::ImplicitInitialConditions { time, unknown, .. } => {
            (*time, Cause::Inconsistent, *unknown)
        }
        SolveError::Outside { time, unknown } => (*time, Cause::Outside, *unknown),
        SolveError::Negative { time, unknown } => (*time, Cause::Negative, Some(*unknown)),
        SolveError::Interrupted { time } => (*time, Cause::Interrupted, None),
        SolveError::Panicked { time } => (*time, Cause::Panicked, None),
        SolveError::Other { time, flag } => (*time, Cause::Other(flag.value), None),
        SolveError::Setup { flag, .. } => (start, Cause::Other(flag.value), None),
        _ => (start, Cause::Other(0), None),
    };
    let event = if let SolveError::TooManySteps { event, .. } = error { *event } else { None };
    let switches = if let SolveError::Switching { at, .. } = error { *at } else { [None; 2] };
    SolverFailure { time, cause, unknown, event, switches }
}
