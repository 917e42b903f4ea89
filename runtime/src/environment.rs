//! One instance of an environment: episodes of a model, step by step.
//!
//! A step runs in the order of the language reference, "Sampling instants": the action is applied;
//! disturbances take their values; `at start` programs run. The integrator restarts consistently
//! and goes to the end of the interval, stopping at events; `at end` programs run; then failures,
//! successes, rewards and observations are evaluated. A failure wins over success, success over the
//! time limit. A step allocates nothing. It depends only on the state, the action, the episode's
//! key and, with a one-step method, the last accepted step size.

mod cyclic;
mod finish;
mod following;
mod glance;
mod history;
mod interval;
mod invariants;
mod progress;
mod projection;
mod reset;
mod snapshot;
mod tangent;
mod trace;
mod verdict;

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use smpl_compiler::ir::Builtin;
use smpl_compiler::layout::{FramePart, Region};
use smpl_compiler::model::Interface;

pub use crate::past::History;
pub use invariants::Drift;
pub use reset::{ResetError, ResetOptions, Start, StateInput};
pub use snapshot::{Snapshot, SnapshotError};
pub use tangent::{Direction, FollowError, Follower};
pub use trace::{Followed, Trace};

use self::finish::Finish;
use self::progress::{Firing, Firings, Phase, Progress, Replay, Verdict};
use crate::catalogue::Catalogue;
use crate::failure::{BOX_SLACK, Cause, Failure};
use crate::observe::{Number, Sensors};
use crate::random::EpisodeKey;
use crate::setup::{Setup, SetupError};
use crate::solver::{Absent, Carried, Edge, Integrator, Statistics, System};
use crate::system::CompiledSystem;

/// End of a step. Times are in the model's unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepResult {
    /// The chosen reward (dense or sparse).
    pub reward: f64,
    /// A failure or a success ended the episode.
    pub terminated: bool,
    /// The time limit ended it.
    pub truncated: bool,
    /// A success condition holds, or a batch of fixed length is over.
    pub success: bool,
    /// The first failure, in the order action box, solver, events without end, then as declared,
    /// then what is not finite.
    pub failure: Option<Failure>,
    /// Sum of the violations.
    pub cost: f64,
    /// Time of the state: completed steps times the sampling interval, that of the event at which
    /// the step stopped, or that of before a step that was not integrated.
    pub time: f64,
}

/// Reason why a step cannot be taken. Nothing was stepped.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StepError {
    /// The action has the wrong length.
    #[error("action has {given} entries, expected {expected}")]
    Length {
        /// Its length.
        given: usize,
        /// The number of actions.
        expected: usize,
    },
    /// The action is not a number.
    #[error("action `{name}` is NaN")]
    NotANumber {
        /// Name.
        name: String,
    },
    /// Somebody wanted the step to stop, see [`crate::interrupt`].
    #[error("the step was interrupted")]
    Interrupted,
    /// A recorded disturbance has no value for the step.
    #[error("the recorded disturbance `{name}` ends after step {steps}: record one value a step, or say that the last one holds")]
    RecordEnded {
        /// Name.
        name: String,
        /// Number of values it has.
        steps: usize,
    },
    /// There is no running episode.
    #[error("the episode is over (or has not begun): call reset first")]
    EpisodeOver,
}

/// One instance of an environment.
///
/// It has more methods than other types, because it is what the command, the Python module and
/// batches see of an episode, of which they read one thing each. The rest is the order of a step,
/// in one file a part: `reset`, `interval`, `verdict`, `tangent`. Each owner of numbers is a
/// separate type (`Progress`, `Finish`, `Sensors`, `CompiledSystem`).
pub struct Environment {
    setup: Arc<Setup>,
    system: CompiledSystem,
    integrator: Box<dyn Integrator>,
    /// Of the other implicit method, made where a step fails first.
    spare: Option<Box<dyn Integrator>>,
    progress: Progress,
    sensors: Sensors,
    /// Disturbances that replace drawn ones.
    replay: Vec<Replay>,
    finish: Finish,
    scratch: Vec<f64>,
    /// Integrals over the step, its pieces between events added up.
    integrals: Vec<f64>,
    /// Work since the reset, but for what the integrator still counts.
    statistics: Statistics,
    /// Drifts of the invariants; empty unless they are watched.
    drifts: Vec<Drift>,
    /// Trace within steps, if requested.
    trace: Option<Box<Trace>>,
    /// Stepping goes on after the end of an episode.
    keep_going: bool,
    /// Time at the start of the step.
    begin: f64,
    /// Part of the step that is integrated, see `glance`.
    share: f64,
    firings: Firings,
}

impl Environment {
    /// An instance; it needs a [`reset`](Self::reset) first.
    ///
    /// # Errors
    /// When the solver refuses the system.
    pub fn new(setup: Arc<Setup>) -> Result<Self, SetupError> {
        let integrator = setup.integrator()?;
        Ok(Self { integrator, ..Self::without_integrator(setup) })
    }

    /// An instance that is lent an integrator whenever it is reset or stepped, see
    /// [`with_integrator`](Self::with_integrator).
    pub(crate) fn without_integrator(setup: Arc<Setup>) -> Self {
        let system = setup.system.clone();
        let (unknowns, ends) = (setup.model().unknowns(), &setup.model().interface().finish);
        let sensors = Sensors::new(&ends.observations, &setup.noise);
        let progress = Progress {
            key: EpisodeKey::default(),
            next_key: EpisodeKey::default(),
            expected: false,
            steps: 0,
            phase: Phase::New,
            y: vec![0.0; unknowns],
            yp: vec![0.0; unknowns],
            readings: sensors.blank(),
            verdict: Verdict::blank(ends.failures.len(), ends.constraints.len(), ends.rewards.len()),
            edges: vec![Edge::default(); system.model().roots_info().len()],
            carried: Carried::default(),
            event_time: None,
            chatter: None,
            not_finite: None,
        };
        Self {
            integrals: vec![0.0; system.region(Region::Quadrature).len()],
            integrator: Box::new(Absent),
            spare: None,
            finish: Finish::new(ends.layout()),
            scratch: vec![0.0; unknowns],
            statistics: Statistics::default(),
            drifts: Vec::new(),
            trace: None,
            keep_going: false,
            begin: 0.0,
            share: 1.0,
            firings: Firings { each: vec![Firing::default(); system.model().roots_info().len()], last: None },
            replay: Vec::new(),
            progress,
            sensors,
            system,
            setup,
        }
    }

    /// Does `work` with a shared integrator, which keeps nothing of a step, so that the bits are
    /// those of a separate integrator.
    pub(crate) fn with_integrator<R>(&mut self, integrator: &mut Box<dyn Integrator>, work: impl FnOnce(&mut Self) -> R) -> R {
        /// Gives it back also when the work panics.
        struct Loan<'a>(&'a mut Environment, &'a mut Box<dyn Integrator>);
        impl Drop for Loan<'_> {
            fn drop(&mut self) {
                self.0.collect_statistics();
                self.0.integrator.forget();
                std::mem::swap(&mut self.0.integrator, self.1);
            }
        }
        std::mem::swap(&mut self.integrator, integrator);
        let loan = Loan(self, integrator);
        work(&mut *loan.0)
    }

    /// Takes one step with an action in physical units, in the order of the actions.
    ///
    /// # Errors
    /// A NaN, a wrong length, no running episode, or an interruption; nothing is stepped then.
    pub fn step(&mut self, action: &[f64]) -> Result<StepResult, StepError> {
        self.check(action)?;
        self.step_checked(action)
    }

    /// Takes one step with an action that [`check`](Self::check) has let through.
    pub(crate) fn step_checked(&mut self, action: &[f64]) -> Result<StepResult, StepError> {
        let excess = self.action_excess(action);
        self.progress.chatter = None;
        let outcome = if action.iter().all(|a| a.is_finite()) {
            self.run_interval(action)
        } else {
            // Nothing can be integrated with an infinite input; state and time stay.
            self.stop_at(self.time());
            interval::IntervalEnd::NotRun
        };
        if self.was_interrupted(outcome) {
            self.take_back();
            return Err(StepError::Interrupted);
        }
        Ok(self.judge(outcome, excess))
    }

    fn was_interrupted(&self, outcome: interval::IntervalEnd) -> bool {
        outcome == interval::IntervalEnd::Solver && self.progress.verdict.solver_failure.is_some_and(|f| f.cause == Cause::Interrupted)
    }

    /// Undoes the changes of an interrupted step other than those of the state.
    fn take_back(&mut self) {
        self.progress.verdict.solver_failure = None;
        for (part, present) in [(FramePart::Action, Region::Action), (FramePart::Disturbance, Region::Disturbance)] {
            self.system.copy(Region::Previous(part), present);
        }
        let (model, memory) = self.system.parts();
        model.prepare_step(memory);
    }

    /// Ends the episode without a verdict: the next step needs a reset.
    pub(crate) fn abandon(&mut self) {
        self.progress.phase = Phase::New;
    }

    /// Goes on stepping after the end of an episode (off by default). The step after one that
    /// stopped at an event begins there and ends where it would: nothing of the time course is left
    /// out.
    pub fn set_keep_going(&mut self, keep_going: bool) {
        self.keep_going = keep_going;
    }

    pub(crate) fn check(&self, action: &[f64]) -> Result<(), StepError> {
        let actions = self.setup.catalogue.actions.elements();
        if action.len() != actions.len() {
            return Err(StepError::Length { given: action.len(), expected: actions.len() });
        }
        if let Some(at) = action.iter().position(|a| a.is_nan()) {
            return Err(StepError::NotANumber { name: actions[at].name.clone() });
        }
        match self.progress.phase {
            Phase::Running => {}
            Phase::Over if self.keep_going => {}
            _ => return Err(StepError::EpisodeOver),
        }
        match self.replay.iter().find(|replay| !replay.holds && replay.row(self.progress.steps) >= replay.values.len()) {
            Some(ended) => Err(StepError::RecordEnded { name: self.name_of_disturbance(ended.at), steps: ended.values.len() }),
            None => Ok(()),
        }
    }

    fn name_of_disturbance(&self, at: usize) -> String {
        let mut disturbances = self.setup.catalogue.disturbances.elements().iter();
        disturbances.find(|element| element.at == at).map_or_else(String::new, |element| element.name.clone())
    }

    /// Recorded disturbances that have ended and hold their last value by default, with the number
    /// of their values.
    #[must_use]
    pub fn ended_records(&self) -> Vec<(String, usize)> {
        let ended = |replay: &&Replay| !replay.asked_to_hold && replay.values.len() < replay.row(self.progress.steps);
        self.replay.iter().filter(ended).map(|replay| (self.name_of_disturbance(replay.at), replay.values.len())).collect()
    }

    /// Largest excess of an action over its box, relative to its range; 0 within the slack.
    fn action_excess(&self, action: &[f64]) -> f64 {
        let actions = self.setup.catalogue.actions.elements().iter();
        let beyond = actions.zip(action).map(|(element, &a)| (element, (a - element.high).max(element.low - a)));
        let excess = beyond.filter(|&(_, beyond)| beyond > 0.0).map(|(element, beyond)| beyond / element.range()).fold(0.0, f64::max);
        if excess > BOX_SLACK { excess } else { 0.0 }
    }

    fn set_builtin(&mut self, which: Builtin, value: f64) {
        self.set_builtins([(which, value)]);
    }

    fn set_builtins<const N: usize>(&mut self, values: [(Builtin, f64); N]) {
        let region = self.system.region_mut(Region::Builtin);
        for (which, value) in values {
            region[which as usize] = value;
        }
    }

    /// The setup that this is an instance of.
    #[must_use]
    pub fn setup(&self) -> &Arc<Setup> {
        &self.setup
    }

    /// Names and places.
    #[must_use]
    pub fn catalogue(&self) -> &Catalogue {
        &self.setup.catalogue
    }

    /// The key of the running episode.
    #[must_use]
    pub fn key(&self) -> EpisodeKey {
        self.progress.key
    }

    /// Completed steps.
    #[must_use]
    pub fn steps(&self) -> u32 {
        self.progress.steps
    }

    /// Time of the present state: completed steps times the sampling interval, the time of the
    /// event that ended the last step, or that before a step without integration.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.progress.event_time.unwrap_or_else(|| f64::from(self.progress.steps) * self.setup.model().interface().episode.step)
    }

    /// Numbers of the root functions that fired in the last step.
    pub fn happened(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.firings.each.len()).filter(|&index| self.firings.each[index].time.is_finite())
    }

    /// Returns `true` if a step may be taken without a reset.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.progress.phase == Phase::Running
    }

    /// End of the last step; `None` after a reset.
    #[must_use]
    pub fn last(&self) -> Option<&StepResult> {
        self.progress.verdict.last.as_ref()
    }

    /// Number of the phase in force, from 0, in the order of the interface's phases; `None` without
    /// a schedule.
    #[must_use]
    pub fn phase(&self) -> Option<usize> {
        let number = *self.discretes().get(self.setup.phase?)?;
        Some((number as usize).saturating_sub(1))
    }

    /// All rewards of the last step, as declared; the error reward on a failing step. Zero after a
    /// reset.
    #[must_use]
    pub fn rewards(&self) -> &[f64] {
        &self.progress.verdict.rewards
    }

    /// Violations of the last step, in the order of [`constraint_names`](Self::constraint_names):
    /// the largest excess over the range, 0 when kept.
    #[must_use]
    pub fn violations(&self) -> &[f64] {
        &self.progress.verdict.violations
    }

    /// Names of all limits: `action_box`, the declared failures, the declared constraints.
    pub fn constraint_names(&self) -> impl Iterator<Item = &str> {
        constraint_names(self.setup.model().interface())
    }

    /// Number of observations.
    #[must_use]
    pub fn observation_len(&self) -> usize {
        self.progress.readings.present.len()
    }

    /// Observations without a finite value at the present point; [`observe`](Self::observe) writes
    /// their last reading.
    #[must_use]
    pub fn missing_readings(&self) -> &[bool] {
        &self.progress.readings.missing
    }

    /// Writes the observation, clipped to its box: physical units, or [-1, 1].
    pub fn observe<T: Number>(&self, normalised: bool, out: &mut [T]) {
        self.sensors.write(&self.progress.readings, normalised, out);
    }

    /// The unknowns `y`: states, then solved algebraic variables, in internal order.
    #[must_use]
    pub fn unknowns(&self) -> &[f64] {
        &self.progress.y
    }

    /// Writes the states in declaration order, physical units.
    pub fn state(&self, out: &mut [f64]) {
        for (element, out) in self.setup.catalogue.states.elements().iter().zip(out) {
            *out = self.progress.y[element.at];
        }
    }

    /// Writes the algebraic outputs that belong to the present state and action; after a step that
    /// the solver gave up, those of before it, as the state.
    pub fn algebraics(&mut self, out: &mut [f64]) {
        let t = self.time();
        self.at_the_state(|system, progress| {
            system.look_back(t, &progress.y, &progress.yp);
            let (model, memory) = system.parts();
            model.outputs(memory, t, &progress.y, &progress.yp, out);
        });
    }

    /// Writes the monitored root functions of the present state, in the order of
    /// [`watched`](smpl_compiler::compiled::CompiledModel::watched): conditions of events, then
    /// switches of the equations, which change their form where the sign changes.
    pub fn watched(&mut self, out: &mut [f64]) {
        let t = self.time();
        self.at_the_state(|system, progress| system.roots(t, &progress.y, &progress.yp, out));
    }

    /// Calls `work` with the inputs that belong to the state: those of before the step where the
    /// solver gave it up.
    fn at_the_state(&mut self, work: impl FnOnce(&mut CompiledSystem, &Progress)) {
        let gone_back = self.progress.verdict.solver_failure.is_some();
        if gone_back {
            self.system.exchange_inputs(Region::Previous);
        }
        work(&mut self.system, &self.progress);
        if gone_back {
            self.system.exchange_inputs(Region::Previous);
        }
    }

    /// Discrete variables, by the places of the catalogue; so the following.
    #[must_use]
    pub fn discretes(&self) -> &[f64] {
        self.system.region(Region::Discrete)
    }

    /// Present disturbances.
    #[must_use]
    pub fn disturbances(&self) -> &[f64] {
        self.system.region(Region::Disturbance)
    }

    /// The memory of the instance.
    pub fn memory(&self) -> &smpl_compiler::layout::Memory {
        self.system.memory()
    }

    /// Parameters of the episode.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        self.system.region(Region::Param)
    }

    /// Present actions.
    #[must_use]
    pub fn actions(&self) -> &[f64] {
        self.system.region(Region::Action)
    }

    /// The steady state of the episode's parameters, in the order of `y`.
    #[must_use]
    pub fn steady_state(&self) -> &[f64] {
        self.system.region(Region::Steady(FramePart::Y))
    }

    /// Work done since the last reset, the last step included.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        let mut sum = self.statistics;
        interval::add(&mut sum, &self.integrator.statistics());
        sum
    }

    /// Runs a declared open-loop policy for the coming step; `out` has one number an action, in
    /// their order.
    pub fn policy(&mut self, index: usize, out: &mut [f64]) {
        let (steps, t) = (f64::from(self.progress.steps), self.time());
        self.set_builtin(Builtin::Steps, steps);
        self.set_builtin(Builtin::Clock, t);
        self.system.look_back(t, &self.progress.y, &self.progress.yp);
        let (model, memory) = self.system.parts();
        model.policy(index, memory, t, &self.progress.y, out);
    }

    /// Invariants: value and rate of each, at the present state.
    pub fn invariants(&mut self, out: &mut [f64]) {
        let t = self.time();
        self.system.look_back(t, &self.progress.y, &self.progress.yp);
        let (model, memory) = self.system.parts();
        model.invariants(memory, t, &self.progress.y, &self.progress.yp, out);
    }
}

/// Names of all limits of a model, see [`Environment::constraint_names`].
pub fn constraint_names(interface: &Interface) -> impl Iterator<Item = &str> {
    let failures = interface.finish.failures.iter().map(|f| f.name.as_str());
    std::iter::once(crate::failure::ACTION_BOX).chain(failures).chain(interface.finish.constraints.iter().map(String::as_str))
}
