//! Many trajectories at once: states and action sequences in, arrays out.
//!
//! A trajectory is an episode of an [`Environment`] from a given state: the basis of sampling-based
//! control, identification and the generation of data. Trajectory i depends only on its own inputs:
//! results are the same to the bit on any number of threads, and the same as those of single steps.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use crate::environment::{Environment, History, ResetError, ResetOptions, Snapshot, SnapshotError, Start, StateInput, StepError};
use crate::failure::{FailureKind, START};
use crate::pool::{self, Pool};
use crate::setup::{Setup, SetupError};
use crate::steady::SteadyError;

/// Start of trajectories.
#[derive(Clone, Copy)]
pub enum Origin<'a> {
    /// At states in physical units and in declaration order, a row a trajectory, or one for all.
    States(&'a [f64]),
    /// Present point of an episode.
    Snapshot(&'a Snapshot),
}

/// Values that may differ from trajectory to trajectory: one for all, or one for each.
pub type Given<'a> = Vec<(String, &'a [f64])>;

/// Simulation request. All numbers are in physical units.
pub struct Plan<'a> {
    /// Start of trajectories.
    pub origin: Origin<'a>,
    /// Number of trajectories.
    pub count: usize,
    /// Steps of each.
    pub horizon: usize,
    /// Actions, trajectory after trajectory and step after step, or of one trajectory for all.
    pub actions: &'a [f64],
    /// Parameters, by name. Neither these nor the following go with [`Origin::Snapshot`].
    pub parameters: Given<'a>,
    /// Discrete variables at the start, by name.
    pub discrete: Given<'a>,
    /// Recorded disturbances, by name: a value a step, for all trajectories or for each.
    pub disturbances: Given<'a>,
    /// Trajectory i is the episode of seed + i. Without one, random numbers are at their means and
    /// measurements exact.
    pub seed: Option<u64>,
    /// Steps that count as completed at the start.
    pub first_step: u32,
    /// The past of all trajectories, for delayed values. It does not go with [`Origin::Snapshot`].
    pub history: Option<&'a History>,
    /// Instants within steps at which states and measurements are read too: the step, from 0, and
    /// the share of it, from 0 to 1.
    pub instants: &'a [(usize, f64)],
}

/// Destination of results: a row per trajectory and, except for those of the ends, a row per step
/// within it. After its end a trajectory keeps its last states, observations and outputs; its
/// rewards, costs and violations are 0.
pub struct Arrays<'a> {
    /// States in declaration order: count × (horizon + 1) × states.
    pub states: &'a mut [f64],
    /// Observations, physical units: count × (horizon + 1) × observations.
    pub observations: &'a mut [f64],
    /// Algebraic outputs: count × (horizon + 1) × outputs; none if empty.
    pub outputs: &'a mut [f64],
    /// The chosen reward: count × horizon.
    pub rewards: &'a mut [f64],
    /// Sum of the violations: count × horizon.
    pub cost: &'a mut [f64],
    /// Violations in the order of [`Environment::constraint_names`]: count × horizon × constraints.
    pub violations: &'a mut [f64],
    /// Steps taken, the ending one included.
    pub steps: &'a mut [u32],
    /// Ended by failure or success.
    pub terminated: &'a mut [bool],
    /// Ended by the time limit.
    pub truncated: &'a mut [bool],
    /// States at the instants of the plan: count × instants × states; NaN where a trajectory does
    /// not get there.
    pub instant_states: &'a mut [f64],
    /// Measurements at these instants, without noise, sampling, delay or clipping: count × instants
    /// × observations.
    pub measured: &'a mut [f64],
}

/// Failure of a trajectory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct End {
    /// Message, empty without a failure.
    pub failure: String,
    /// Kind of the cause.
    pub kind: FailureKind,
    /// Name of a declared failure, otherwise empty.
    pub name: String,
}

/// Reason why nothing can be simulated.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// An array has the wrong length.
    #[error("{name} has {given} entries, expected {expected}")]
    Length {
        /// Name of the array.
        name: String,
        /// Its length.
        given: usize,
        /// The right length.
        expected: usize,
    },
    /// Values that do not go with the start.
    #[error("{0} cannot be given where trajectories begin at a snapshot: they are those of its episode")]
    Fixed(&'static str),
    /// A step at or beyond the time limit.
    #[error("the first step is {given}, and the time limit {limit} steps")]
    FirstStep {
        /// Given value.
        given: u32,
        /// The limit.
        limit: u32,
    },
    /// An instant is not within the trajectories.
    #[error("an instant is not within the steps")]
    Instant,
    /// A trajectory cannot begin.
    #[error("trajectory {index}: {error}")]
    Reset {
        /// Its number.
        index: usize,
        /// Reason.
        error: ResetError,
    },
    /// A trajectory refuses an action.
    #[error("trajectory {index}: {error}")]
    Step {
        /// Its number.
        index: usize,
        /// Reason.
        error: StepError,
    },
    /// The snapshot is of another model.
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
    /// Somebody wanted the simulation to stop, see [`crate::interrupt`].
    #[error("the simulation was interrupted")]
    Interrupted,
    /// No threads.
    #[error("thread pool: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The environment cannot be made.
    #[error(transparent)]
    Setup(#[from] SetupError),
}

/// Environments that simulate trajectories, one a thread.
pub struct Rollouts {
    environments: Vec<Mutex<Environment>>,
    pool: Option<Pool>,
    stop: Arc<AtomicBool>,
    widths: Widths,
}

/// Numbers of columns.
#[derive(Clone, Copy, Debug)]
pub struct Widths {
    /// Of states.
    pub states: usize,
    /// Of actions.
    pub actions: usize,
    /// Of observations.
    pub observations: usize,
    /// Of algebraic outputs.
    pub outputs: usize,
    /// Of violations.
    pub violations: usize,
}

impl Rollouts {
    /// On that many threads; 1 runs everything on the caller's.
    ///
    /// # Errors
    /// When the solver refuses the system, or no threads can be made.
    pub fn new(setup: &Arc<Setup>, threads: usize) -> Result<Self, RolloutError> {
        let stop = Arc::default();
        let threads = pool::useful(threads, usize::MAX);
        let pool = if threads > 1 { Some(Pool::new(threads, &stop)?) } else { None };
        let environments: Result<Vec<_>, SetupError> = (0..threads).map(|_| Environment::new(Arc::clone(setup))).collect();
        let environments = environments?;
        let widths = environments.first().map_or(Widths::NONE, Widths::of);
        Ok(Self { environments: environments.into_iter().map(Mutex::new).collect(), pool, stop, widths })
    }

    /// Numbers of columns of the arrays.
    #[must_use]
    pub fn widths(&self) -> Widths {
        self.widths
    }

    /// Simulates all trajectories and returns the failure of each. A trajectory that has no
    /// consistent start has the failure `start`, NaN for its states and no steps.
    ///
    /// # Errors
    /// Wrong lengths, unknown names, parameters outside of their bounds, actions that are
    /// not numbers: the arrays are then invalid. An interruption.
    pub fn run(&mut self, plan: &Plan<'_>, arrays: Arrays<'_>) -> Result<Vec<End>, RolloutError> {
        self.check(plan, &arrays)?;
        self.stop.store(false, Ordering::Relaxed);
        if let Some(pool) = self.pool.as_mut().filter(|pool| !pool.is_mine()) {
            *pool = Pool::new(pool.threads(), &self.stop)?;
        }
        let mut rows = arrays.rows(plan, self.widths);
        let (environments, stop, widths) = (&self.environments, &*self.stop, self.widths);
        // Work on trajectories that come next to one another shares the maps of names.
        let size = rows.len().div_ceil(8 * environments.len()).max(1);
        let chunk = |(number, rows): (usize, &mut [Row<'_>])| {
            let thread = rayon::current_thread_index().unwrap_or(0) % environments.len();
            let mut environment = environments[thread].lock().unwrap_or_else(PoisonError::into_inner);
            let mut options = plan.options();
            for (index, row) in (number * size..).zip(rows) {
                if stop.load(Ordering::Relaxed) {
                    return;
                }
                row.outcome = simulate(&mut environment, plan, &mut options, index, row, widths);
                if row.outcome.as_ref().is_err_and(is_interruption) {
                    stop.store(true, Ordering::Relaxed);
                }
            }
        };
        match &self.pool {
            Some(pool) => pool.run(stop, || rows.par_chunks_mut(size).enumerate().for_each(chunk)),
            None => rows.chunks_mut(size).enumerate().for_each(chunk),
        }
        if self.stop.load(Ordering::Relaxed) {
            return Err(RolloutError::Interrupted);
        }
        rows.into_iter().map(|row| row.outcome).collect()
    }

    fn check(&self, plan: &Plan<'_>, arrays: &Arrays<'_>) -> Result<(), RolloutError> {
        let Plan { count, horizon, .. } = *plan;
        let Widths { states, actions, observations, outputs, violations } = self.widths;
        let limit = self.environments.first().map_or(0, |e| e.lock().unwrap_or_else(PoisonError::into_inner).setup().max_steps());
        if plan.first_step >= limit {
            return Err(RolloutError::FirstStep { given: plan.first_step, limit });
        }
        match plan.origin {
            Origin::States(given) => one_or_each("states", given, states, count)?,
            Origin::Snapshot(_) => plan.nothing_given()?,
        }
        one_or_each("actions", plan.actions, horizon * actions, count)?;
        for (name, values) in plan.parameters.iter().chain(&plan.discrete) {
            one_or_each(name, values, 1, count)?;
        }
        for (name, values) in &plan.disturbances {
            one_or_each(name, values, horizon, count)?;
        }
        length("states", arrays.states, count * (horizon + 1) * states)?;
        length("observations", arrays.observations, count * (horizon + 1) * observations)?;
        if !arrays.outputs.is_empty() {
            length("outputs", arrays.outputs, count * (horizon + 1) * outputs)?;
        }
        length("rewards", arrays.rewards, count * horizon)?;
        length("cost", arrays.cost, count * horizon)?;
        length("violations", arrays.violations, count * horizon * violations)?;
        length("steps", arrays.steps, count)?;
        length("terminated", arrays.terminated, count)?;
        length("truncated", arrays.truncated, count)?;
        if plan.instants.iter().any(|&(step, share)| step >= horizon || !(0.0..=1.0).contains(&share)) {
            return Err(RolloutError::Instant);
        }
        length("instant_states", arrays.instant_states, count * plan.instants.len() * states)?;
        length("measured", arrays.measured, count * plan.instants.len() * observations)
    }
}

impl Widths {
    const NONE: Self = Self { states: 0, actions: 0, observations: 0, outputs: 0, violations: 0 };

    fn of(environment: &Environment) -> Self {
        let catalogue = environment.catalogue();
        Self {
            states: catalogue.states.len(),
            actions: catalogue.actions.len(),
            observations: environment.observation_len(),
            outputs: catalogue.algebraics.len(),
            violations: environment.violations().len(),
        }
    }
}

impl Plan<'_> {
    /// Options of a reset, with an entry for all that is given.
    fn options(&self) -> ResetOptions {
        let zero = |given: &Given<'_>| given.iter().map(|(name, _)| (name.clone(), 0.0)).collect();
        ResetOptions {
            start: if self.seed.is_some() { Start::Sampled } else { Start::Nominal },
            state: StateInput::Array(Vec::new()),
            discrete: zero(&self.discrete),
            parameters: zero(&self.parameters),
            disturbances: self.disturbances.iter().map(|(name, _)| (name.clone(), Vec::new())).collect(),
            expected: self.seed.is_none(),
            first_step: self.first_step,
            history: self.history.cloned(),
            ..ResetOptions::default()
        }
    }

    fn nothing_given(&self) -> Result<(), RolloutError> {
        for (what, given) in [("parameters", &self.parameters), ("discrete", &self.discrete), ("disturbances", &self.disturbances)] {
            if !given.is_empty() {
                return Err(RolloutError::Fixed(what));
            }
        }
        if self.history.is_some() {
            return Err(RolloutError::Fixed("history"));
        }
        if self.first_step == 0 { Ok(()) } else { Err(RolloutError::Fixed("first_step")) }
    }
}

/// The arrays of one trajectory.
struct Row<'a> {
    states: &'a mut [f64],
    observations: &'a mut [f64],
    outputs: &'a mut [f64],
    rewards: &'a mut [f64],
    cost: &'a mut [f64],
    violations: &'a mut [f64],
    steps: &'a mut u32,
    terminated: &'a mut bool,
    truncated: &'a mut bool,
    instant_states: &'a mut [f64],
    measured: &'a mut [f64],
    outcome: Result<End, RolloutError>,
}

impl<'a> Arrays<'a> {
    fn rows(self, plan: &Plan<'_>, widths: Widths) -> Vec<Row<'a>> {
        let horizon = plan.horizon;
        let outputs = if self.outputs.is_empty() { 0 } else { widths.outputs };
        let mut states = pieces(self.states, (horizon + 1) * widths.states);
        let mut observations = pieces(self.observations, (horizon + 1) * widths.observations);
        let mut outputs = pieces(self.outputs, (horizon + 1) * outputs);
        let mut rewards = pieces(self.rewards, horizon);
        let mut cost = pieces(self.cost, horizon);
        let mut violations = pieces(self.violations, horizon * widths.violations);
        let mut instant_states = pieces(self.instant_states, plan.instants.len() * widths.states);
        let mut measured = pieces(self.measured, plan.instants.len() * widths.observations);
        let ends = self.steps.iter_mut().zip(self.terminated.iter_mut().zip(self.truncated.iter_mut()));
        ends.map(|(steps, (terminated, truncated))| Row {
            states: states(),
            observations: observations(),
            outputs: outputs(),
            rewards: rewards(),
            cost: cost(),
            violations: violations(),
            steps,
            terminated,
            truncated,
            instant_states: instant_states(),
            measured: measured(),
            outcome: Ok(End::default()),
        })
        .collect()
    }
}

/// Gives away one piece after the other.
fn pieces<'a>(mut rest: &'a mut [f64], width: usize) -> impl FnMut() -> &'a mut [f64] {
    move || {
        let (piece, others) = std::mem::take(&mut rest).split_at_mut(width);
        rest = others;
        piece
    }
}

/// One trajectory.
fn simulate(
    environment: &mut Environment,
    plan: &Plan<'_>,
    options: &mut ResetOptions,
    index: usize,
    row: &mut Row<'_>,
    widths: Widths,
) -> Result<End, RolloutError> {
    match begin(environment, plan, options, index) {
        Err(RolloutError::Reset { error, .. }) if is_infeasible(&error) => {
            for values in [&mut *row.states, row.observations, row.outputs, &mut *row.instant_states, &mut *row.measured] {
                values.fill(f64::NAN);
            }
            for values in [&mut *row.rewards, row.cost, row.violations] {
                values.fill(0.0);
            }
            (*row.steps, *row.terminated, *row.truncated) = (0, true, false);
            return Ok(End { failure: format!("{START}: {error}"), kind: FailureKind::Start, name: String::new() });
        }
        result => result?,
    }
    row.keep(environment, 0, widths);
    (*row.steps, *row.terminated, *row.truncated) = (0, false, false);
    row.instant_states.fill(f64::NAN);
    row.measured.fill(f64::NAN);
    let actions = pick(plan.actions, plan.horizon * widths.actions, index);
    for step in 0..plan.horizon {
        let action = &actions[step * widths.actions..(step + 1) * widths.actions];
        row.glance(environment, plan, (index, step), action, widths)?;
        let result = environment.step(action).map_err(|error| RolloutError::Step { index, error })?;
        row.rewards[step] = result.reward;
        row.cost[step] = result.cost;
        row.violations[step * widths.violations..(step + 1) * widths.violations].copy_from_slice(environment.violations());
        row.keep(environment, step + 1, widths);
        *row.steps = step as u32 + 1;
        if result.terminated || result.truncated {
            (*row.terminated, *row.truncated) = (result.terminated, result.truncated);
            row.finish(step + 1, widths);
            break;
        }
    }
    let (kind, name) = environment.failure_cause();
    let name = name.to_owned();
    Ok(End { failure: environment.failure_message(), kind, name })
}

/// Brings the environment to the start of a trajectory.
fn begin(environment: &mut Environment, plan: &Plan<'_>, options: &mut ResetOptions, index: usize) -> Result<(), RolloutError> {
    let states = match plan.origin {
        Origin::States(states) => states,
        Origin::Snapshot(snapshot) => {
            environment.restore(snapshot)?;
            match plan.seed {
                Some(seed) => environment.draw_anew(seed.wrapping_add(index as u64)),
                None => environment.expect(),
            }
            return Ok(());
        }
    };
    if let StateInput::Array(state) = &mut options.state {
        state.clear();
        state.extend_from_slice(pick(states, environment.catalogue().states.len(), index));
    }
    for (present, given) in [(&mut options.parameters, &plan.parameters), (&mut options.discrete, &plan.discrete)] {
        for (name, values) in given {
            if let (Some(value), [given]) = (present.get_mut(name), pick(values, 1, index)) {
                *value = *given;
            }
        }
    }
    for (name, values) in &plan.disturbances {
        if let Some(sequence) = options.disturbances.get_mut(name) {
            sequence.clear();
            sequence.extend_from_slice(pick(values, plan.horizon, index));
        }
    }
    let seed = plan.seed.map(|seed| seed.wrapping_add(index as u64));
    environment.reset(seed.or(Some(0)), options).map_err(|error| RolloutError::Reset { index, error })
}

impl Row<'_> {
    /// Writes what belongs to a point of the trajectory.
    fn keep(&mut self, environment: &mut Environment, at: usize, widths: Widths) {
        environment.state(&mut self.states[at * widths.states..(at + 1) * widths.states]);
        environment.observe(false, &mut self.observations[at * widths.observations..(at + 1) * widths.observations]);
        if !self.outputs.is_empty() {
            environment.algebraics(&mut self.outputs[at * widths.outputs..(at + 1) * widths.outputs]);
        }
    }

    /// Writes what belongs to the instants within a step.
    fn glance(
        &mut self,
        environment: &mut Environment,
        plan: &Plan<'_>,
        (index, step): (usize, usize),
        action: &[f64],
        Widths { states, observations, .. }: Widths,
    ) -> Result<(), RolloutError> {
        for (at, &(_, share)) in plan.instants.iter().enumerate().filter(|(_, instant)| instant.0 == step) {
            let (reached, seen) = (&mut self.instant_states[at * states..], &mut self.measured[at * observations..]);
            let found = environment.glance(action, share, &mut reached[..states], &mut seen[..observations]);
            found.map_err(|error| RolloutError::Step { index, error })?;
        }
        Ok(())
    }

    /// Repeats what belongs to the last point; nothing is gained or lost any more.
    fn finish(&mut self, last: usize, widths: Widths) {
        let Widths { states, observations, outputs, violations, .. } = widths;
        for (values, width) in [(&mut *self.states, states), (&mut *self.observations, observations), (&mut *self.outputs, outputs)] {
            for at in (last + 1)..values.len().checked_div(width).unwrap_or(0) {
                values.copy_within(last * width..(last + 1) * width, at * width);
            }
        }
        self.rewards[last..].fill(0.0);
        self.cost[last..].fill(0.0);
        self.violations[last * violations..].fill(0.0);
    }
}

/// The piece of a trajectory, or the one that is for all.
fn pick(values: &[f64], width: usize, index: usize) -> &[f64] {
    if values.len() == width { values } else { &values[index * width..(index + 1) * width] }
}

/// There is no start with these values, which may be the question.
fn is_infeasible(error: &ResetError) -> bool {
    match error {
        ResetError::Inconsistent { .. } | ResetError::Cyclic { .. } | ResetError::NotFinite { .. } => true,
        ResetError::Steady(error) => !matches!(error, SteadyError::Interrupted),
        _ => false,
    }
}

fn is_interruption(error: &RolloutError) -> bool {
    match error {
        RolloutError::Step { error, .. } => *error == StepError::Interrupted,
        RolloutError::Reset { error, .. } => matches!(error, ResetError::Interrupted | ResetError::Steady(SteadyError::Interrupted)),
        _ => false,
    }
}

fn one_or_each(name: &str, values: &[f64], width: usize, count: usize) -> Result<(), RolloutError> {
    if values.len() == width || values.len() == width * count {
        return Ok(());
    }
    Err(RolloutError::Length { name: name.into(), given: values.len(), expected: width * count })
}

fn length<T>(name: &str, values: &[T], expected: usize) -> Result<(), RolloutError> {
    if values.len() == expected { Ok(()) } else { Err(RolloutError::Length { name: name.into(), given: values.len(), expected }) }
}
