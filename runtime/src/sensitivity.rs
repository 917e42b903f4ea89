//! Control steps with their derivatives, many at once: states and actions in, arrays out.
//!
//! A point is a state and an action, or the actions of several steps, which a past joins. Its
//! derivatives by states, actions, parameters, discrete variables and disturbances are integrated
//! with the steps ([`crate::environment::Follower`]), so many directions at once that their numbers
//! stay in the cache. Points and groups of directions are spread over the threads; a result depends
//! on nothing but its own point and group.

pub(crate) mod augmented;
pub(crate) mod tangents;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use crate::environment::{Direction, Environment, FollowError, Follower, ResetError, ResetOptions, Start, StateInput};
use crate::pool::{self, Pool};
use crate::rollout::Given;
use crate::setup::{Setup, SetupError};

/// Numbers of unknowns with derivatives that are integrated at once at most, if there is a choice.
const AT_ONCE: usize = 150_000;

/// Fewest directions of a group.
const FEWEST: usize = 8;

/// Functions and points of a differentiation. Values have one entry for all points, or one for
/// each.
#[derive(Clone)]
pub struct Plan<'a> {
    /// Number of points.
    pub count: usize,
    /// Steps from each point.
    pub horizon: usize,
    /// States in declaration order, a row a point.
    pub states: &'a [f64],
    /// Actions, a row a step.
    pub actions: &'a [f64],
    /// Parameters by name.
    pub parameters: Given<'a>,
    /// Discrete variables at the start.
    pub discrete: Given<'a>,
    /// Disturbances, a value a step.
    pub disturbances: Given<'a>,
    /// Steps that count as completed at the start.
    pub first_step: u32,
}

/// Destination of results, step after step of each point; derivatives are rows of as many numbers
/// as there are directions.
pub struct Arrays<'a> {
    /// States after the step.
    pub states: &'a mut [f64],
    /// Rewards as declared.
    pub rewards: &'a mut [f64],
    /// Observations without noise, delay or clipping.
    pub observations: &'a mut [f64],
    /// Derivatives of the states.
    pub by_states: &'a mut [f64],
    /// Derivatives of the rewards.
    pub by_rewards: &'a mut [f64],
    /// Derivatives of the observations.
    pub by_observations: &'a mut [f64],
}

/// Reason why there are no derivatives.
#[derive(Debug, thiserror::Error)]
pub enum SensitivityError {
    /// A list has another length than it should.
    #[error("{name} has {given} entries, expected {expected}")]
    Length {
        /// Name.
        name: String,
        /// Its length.
        given: usize,
        /// The right one.
        expected: usize,
    },
    /// A point is not finite.
    #[error("point {index}: {error}")]
    Reset {
        /// Its number.
        index: usize,
        /// Reason.
        error: ResetError,
    },
    /// A step that cannot be followed.
    #[error("point {index}: {error}")]
    Follow {
        /// Number of the point.
        index: usize,
        /// Reason.
        error: FollowError,
    },
    /// Somebody wanted it to stop.
    #[error("the computation was interrupted")]
    Interrupted,
    /// No threads.
    #[error("thread pool: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The solver refuses the equations.
    #[error(transparent)]
    Setup(#[from] SetupError),
}

/// An instance, and what follows it: quickly, where that is possible, or surely.
struct Worker {
    environment: Environment,
    quick: Option<Follower>,
    sure: Follower,
}

/// Instances with their derivatives, one a thread.
pub struct Sensitivities {
    workers: Vec<Mutex<Worker>>,
    pool: Option<Pool>,
    stop: Arc<AtomicBool>,
    directions: Vec<Direction>,
    width: usize,
}

/// Result of a task: its group's directions of one point.
type Task<'a> = (usize, usize, Result<(), SensitivityError>, &'a Mutex<Arrays<'a>>);

impl Sensitivities {
    /// Along these directions, on so many threads; 1 runs everything on the caller's.
    ///
    /// # Errors
    /// When the solver refuses the system, or no threads can be made.
    pub fn new(setup: &Arc<Setup>, directions: Vec<Direction>, threads: usize) -> Result<Self, SensitivityError> {
        let stop = Arc::default();
        let threads = pool::useful(threads, usize::MAX);
        let pool = if threads > 1 { Some(Pool::new(threads, &stop)?) } else { None };
        let most = (AT_ONCE / setup.model().unknowns().max(1)).max(FEWEST);
        let groups = directions.len().div_ceil(most).max(1);
        let width = directions.len().div_ceil(groups).max(1);
        let worker = || {
            let (quick, sure) = (Follower::quick(setup, width)?, Follower::new(setup, width)?);
            Ok(Mutex::new(Worker { environment: Environment::new(Arc::clone(setup))?, quick, sure }))
        };
        let workers: Result<Vec<_>, SetupError> = (0..threads).map(|_| worker()).collect();
        Ok(Self { workers: workers?, pool, stop, directions, width })
    }

    /// The directions.
    #[must_use]
    pub fn directions(&self) -> &[Direction] {
        &self.directions
    }

    /// Differentiates at all points.
    ///
    /// # Errors
    /// Wrong lengths, unknown names, a step that does not come to its end or has no derivative:
    /// nothing of the arrays counts then.
    pub fn run(&mut self, plan: &Plan<'_>, arrays: Arrays<'_>) -> Result<(), SensitivityError> {
        self.check(plan)?;
        self.stop.store(false, Ordering::Relaxed);
        if let Some(pool) = self.pool.as_mut().filter(|pool| !pool.is_mine()) {
            *pool = Pool::new(pool.threads(), &self.stop)?;
        }
        let groups = self.directions.len().div_ceil(self.width).max(1);
        let arrays = Mutex::new(arrays);
        let mut tasks: Vec<Task<'_>> =
            (0..plan.count).flat_map(|point| (0..groups).map(move |group| (point, group))).map(|(p, g)| (p, g, Ok(()), &arrays)).collect();
        let (workers, stop, this) = (&self.workers, &*self.stop, &*self);
        let work = |task: &mut Task<'_>| {
            if stop.load(Ordering::Relaxed) {
                return;
            }
            let thread = rayon::current_thread_index().unwrap_or(0) % workers.len();
            let mut worker = workers[thread].lock().unwrap_or_else(PoisonError::into_inner);
            task.2 = this.differentiate(&mut worker, plan, task.0, task.1, task.3);
            if let Err(error) = &task.2 {
                let interrupted = matches!(error, SensitivityError::Follow { error: FollowError::Interrupted, .. })
                    || matches!(error, SensitivityError::Reset { error: ResetError::Interrupted, .. });
                stop.fetch_or(interrupted, Ordering::Relaxed);
            }
        };
        match &self.pool {
            Some(pool) => pool.run(stop, || tasks.par_iter_mut().for_each(work)),
            None => tasks.iter_mut().for_each(work),
        }
        if self.stop.load(Ordering::Relaxed) {
            return Err(SensitivityError::Interrupted);
        }
        tasks.into_iter().try_for_each(|task| task.2)
    }

    fn check(&self, plan: &Plan<'_>) -> Result<(), SensitivityError> {
        let worker = self.workers[0].lock().unwrap_or_else(PoisonError::into_inner);
        let catalogue = worker.environment.catalogue();
        let length = |name: &str, given: usize, width: usize| {
            if given == width || given == width * plan.count {
                return Ok(());
            }
            Err(SensitivityError::Length { name: name.into(), given, expected: width * plan.count })
        };
        length("states", plan.states.len(), catalogue.states.len())?;
        length("actions", plan.actions.len(), plan.horizon * catalogue.actions.len())?;
        plan.disturbances.iter().try_for_each(|(name, values)| length(name, values.len(), plan.horizon))?;
        let named = plan.parameters.iter().chain(&plan.discrete);
        named.into_iter().try_for_each(|(name, values)| length(name, values.len(), 1))
    }

    fn differentiate(
        &self,
        Worker { environment, quick, sure }: &mut Worker,
        plan: &Plan<'_>,
        point: usize,
        group: usize,
        arrays: &Mutex<Arrays<'_>>,
    ) -> Result<(), SensitivityError> {
        let options = plan.options(point, environment);
        let first = group * self.width;
        let directions = &self.directions[first..(first + self.width).min(self.directions.len())];
        let width = environment.catalogue().actions.len();
        let actions = pick(plan.actions, plan.horizon * width, point);
        // Several steps go on behind the end of an episode, as one step after another does.
        environment.set_keep_going(plan.horizon > 1);
        let attempt = |environment: &mut Environment, follower: &mut Follower| {
            environment.reset(Some(0), &options).map_err(|error| SensitivityError::Reset { index: point, error })?;
            for step in 0..plan.horizon {
                let action = &actions[step * width..(step + 1) * width];
                let followed = match step {
                    0 => environment.follow(follower, directions, &options, action),
                    _ => environment.follow_on(follower, action),
                };
                followed.map_err(|error| SensitivityError::Follow { index: point, error })?;
                let mut arrays = arrays.lock().unwrap_or_else(PoisonError::into_inner);
                arrays.keep(environment, follower, point * plan.horizon + step, (first, directions.len(), self.directions.len()));
            }
            Ok(())
        };
        let done = quick.as_mut().is_some_and(|quick| attempt(environment, quick).is_ok());
        if done { Ok(()) } else { attempt(environment, sure) }
    }
}

impl Arrays<'_> {
    fn keep(&mut self, environment: &Environment, follower: &Follower, row: usize, (first, count, all): (usize, usize, usize)) {
        let catalogue = environment.catalogue();
        let states = catalogue.states.elements();
        let (n, rewards, observations) = (states.len(), environment.rewards().len(), environment.measured().len());
        if first == 0 {
            environment.state(&mut self.states[row * n..(row + 1) * n]);
            self.rewards[row * rewards..(row + 1) * rewards].copy_from_slice(environment.rewards());
            self.observations[row * observations..(row + 1) * observations].copy_from_slice(environment.measured());
        }
        let fill = |out: &mut [f64], rows: usize, value: &dyn Fn(usize, usize) -> f64| {
            for of in 0..rows {
                let start = (row * rows + of) * all + first;
                out[start..start + count].iter_mut().enumerate().for_each(|(j, out)| *out = value(of, j));
            }
        };
        fill(self.by_states, n, &|row, j| follower.derivative(states[row].at, j));
        fill(self.by_rewards, rewards, &|row, j| environment.reward_derivative(follower, row, j));
        fill(self.by_observations, observations, &|row, j| environment.observation_derivative(follower, row, j));
    }
}

impl Plan<'_> {
    fn options(&self, point: usize, environment: &Environment) -> ResetOptions {
        let value = |(name, values): &(String, &[f64])| (name.clone(), pick(values, 1, point)[0]);
        ResetOptions {
            start: Start::Nominal,
            state: StateInput::Array(pick(self.states, environment.catalogue().states.len(), point).to_vec()),
            parameters: self.parameters.iter().map(value).collect(),
            discrete: self.discrete.iter().map(value).collect(),
            disturbances: self
                .disturbances
                .iter()
                .map(|(name, values)| (name.clone(), pick(values, self.horizon, point).to_vec()))
                .collect(),
            expected: true,
            first_step: self.first_step,
            ..ResetOptions::default()
        }
    }
}

/// The piece of a point, or the one that is for all.
fn pick(values: &[f64], width: usize, point: usize) -> &[f64] {
    if values.len() == width { values } else { &values[point * width..(point + 1) * width] }
}
