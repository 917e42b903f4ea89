//! Many instances of one environment, stepped together into the caller's arrays.
//!
//! Instance i of a batch with seed s is, bit for bit, the single environment with seed s + i, on
//! any number of threads. Instances share only the workspace of an integrator, whose content does
//! not outlast a step. Threads are used only where a step of the batch is faster with them.

mod member;
mod pace;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use rayon::prelude::*;

pub use self::member::Info;
use self::member::{Crew, Fault, Member};
use self::pace::Pace;
use crate::environment::{Environment, ResetError, ResetOptions, Snapshot, SnapshotError, StepError};
use crate::observe::{Normalisation, Number};
use crate::pool::{self, Pool};
use crate::setup::{Setup, SetupError};

/// When an instance whose episode is over begins the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Autoreset {
    /// In the next step, which ignores the action, has reward 0 and no flags.
    #[default]
    NextStep,
    /// In the same step; the final observation and info are kept separately.
    SameStep,
    /// When the caller says so.
    Disabled,
}

/// Settings of a batch.
#[derive(Clone, Debug)]
pub struct BatchOptions {
    /// When episodes begin anew.
    pub autoreset: Autoreset,
    /// Threads; 1 runs everything on the caller's.
    pub threads: usize,
    /// Normalisation of actions and observations.
    pub normalisation: Normalisation,
    /// Options of resets.
    pub reset: ResetOptions,
}

impl Default for BatchOptions {
    fn default() -> Self {
        Self { autoreset: Autoreset::NextStep, threads: 1, normalisation: Normalisation::Box, reset: ResetOptions::default() }
    }
}

/// Reason why a batch cannot be stepped or reset.
#[derive(Debug, thiserror::Error)]
pub enum BatchError {
    /// An array has the wrong length.
    #[error("{name} has {given} entries, expected {expected}")]
    Length {
        /// Name of the array.
        name: &'static str,
        /// Its length.
        given: usize,
        /// The right length.
        expected: usize,
    },
    /// An instance refuses its action; no instance was stepped.
    #[error("environment {index}: {error}")]
    Step {
        /// Number of the instance.
        index: usize,
        /// Its error.
        error: StepError,
    },
    /// An instance cannot begin an episode.
    #[error("environment {index}: {error}")]
    Reset {
        /// Number of the instance.
        index: usize,
        /// Its error.
        error: ResetError,
    },
    /// A snapshot does not fit its instance.
    #[error("environment {index}: {error}")]
    Snapshot {
        /// Number of the instance.
        index: usize,
        /// Its error.
        error: SnapshotError,
    },
    /// The step was interrupted, see [`crate::interrupt`]: some instances were stepped and others
    /// not, so that all need a reset.
    #[error("the step was interrupted: call reset")]
    Interrupted,
    /// No threads.
    #[error("thread pool: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The environment cannot be made.
    #[error(transparent)]
    Setup(#[from] SetupError),
}

/// Arrays that a step writes, instance after instance: n × observations, and n of each other.
pub struct StepArrays<'a, T> {
    /// Observations; after a reset within the step those of the new episode.
    pub observations: &'a mut [T],
    /// Rewards.
    pub rewards: &'a mut [f64],
    /// Ended by failure or success.
    pub terminated: &'a mut [bool],
    /// Ended by the time limit.
    pub truncated: &'a mut [bool],
}

/// Many instances of one environment.
pub struct Batch {
    crews: Vec<Crew>,
    /// Members of a crew; the last one may have fewer.
    size: usize,
    count: usize,
    options: BatchOptions,
    pool: Option<Pool>,
    /// Instances are not stepped any more.
    stop: Arc<AtomicBool>,
    pace: Pace,
}

/// Crews a thread: enough that none waits long for another's last one.
const CREWS: usize = 8;

impl Batch {
    /// `count` instances; they need a [`reset`](Self::reset) first.
    ///
    /// # Errors
    /// When the solver refuses the system, or no threads can be made.
    pub fn new(setup: &Arc<Setup>, count: usize, options: BatchOptions) -> Result<Self, BatchError> {
        let threads = pool::useful(options.threads, count);
        let stop = Arc::default();
        let pool = if threads > 1 { Some(Pool::new(threads, &stop)?) } else { None };
        let size = if threads > 1 { count.div_ceil(CREWS * threads) } else { count.max(1) };
        let crew = |first: usize| {
            let members = (first..count.min(first + size)).map(|_| Member::new(Arc::clone(setup))).collect();
            Ok(Crew { integrator: setup.integrator().map_err(SetupError::from)?, members })
        };
        let crews: Result<Vec<Crew>, SetupError> = (0..count).step_by(size).map(crew).collect();
        Ok(Self { crews: crews?, size, count, options, pool, stop, pace: Pace::default() })
    }

    fn member(&self, index: usize) -> Option<&Member> {
        self.crews.get(index / self.size)?.members.get(index % self.size)
    }

    fn members_mut(&mut self) -> impl Iterator<Item = &mut Member> {
        self.crews.iter_mut().flat_map(|crew| &mut crew.members)
    }

    /// Number of instances.
    #[must_use]
    pub fn len(&self) -> usize {
        self.count
    }

    /// Returns `true` if it is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// An instance.
    #[must_use]
    pub fn environment(&self, index: usize) -> Option<&Environment> {
        self.member(index).map(|m| &m.environment)
    }

    /// Info of the last step (or reset) of an instance.
    #[must_use]
    pub fn info(&self, index: usize) -> Option<&Info> {
        self.member(index).map(|m| &m.info)
    }

    /// With [`Autoreset::SameStep`], observation (as reported) and info of the end of the episode
    /// that ended in the last step.
    #[must_use]
    pub fn final_info(&self, index: usize) -> Option<(&[f64], &Info)> {
        let member = self.member(index).filter(|m| m.ended)?;
        Some((&member.final_observation, &member.final_info))
    }

    /// Present point of each instance, and whether its episode is over, so that its next step
    /// begins another one.
    #[must_use]
    pub fn snapshots(&self) -> Vec<(Snapshot, bool)> {
        self.crews.iter().flat_map(|crew| &crew.members).map(|m| (m.environment.snapshot(), m.pending)).collect()
    }

    /// Goes back to snapshots, one an instance. Infos are those of the next step.
    ///
    /// # Errors
    /// Another number of them, or one of another model: the instances before it are restored then.
    pub fn restore<'a>(&mut self, snapshots: impl ExactSizeIterator<Item = (&'a Snapshot, bool)>) -> Result<(), BatchError> {
        length("snapshots", snapshots.len(), self.count)?;
        for (index, (member, (snapshot, pending))) in self.members_mut().zip(snapshots).enumerate() {
            member.environment.restore(snapshot).map_err(|error| BatchError::Snapshot { index, error })?;
            member.pending = pending;
            member.ended = false;
        }
        Ok(())
    }

    /// Sets the options of later resets.
    pub fn set_reset_options(&mut self, options: ResetOptions) {
        self.options.reset = options;
    }

    /// Resets all instances, or those of the mask; writes the present observations of all. `seeds`
    /// has one entry an instance; without one the instance goes on with its next episode.
    ///
    /// # Errors
    /// Wrong lengths, or an instance that cannot begin.
    pub fn reset<T: Number>(&mut self, seeds: Option<&[u64]>, mask: Option<&[bool]>, observations: &mut [T]) -> Result<(), BatchError> {
        let n = self.count;
        length("seeds", seeds.map_or(n, <[u64]>::len), n)?;
        length("reset_mask", mask.map_or(n, <[bool]>::len), n)?;
        let width = self.observation_len();
        length("observations", observations.len(), n * width)?;
        self.begin()?;
        let (options, stop, size) = (&self.options, &*self.stop, self.size);
        let task = |(number, (crew, out)): (usize, (&mut Crew, &mut [T]))| {
            let Crew { integrator, members } = crew;
            for ((index, member), out) in (number * size..).zip(members).zip(Parts::of(out, width)) {
                if mask.is_none_or(|mask| mask[index]) && !stop.load(Ordering::Relaxed) {
                    member.reset(seeds.map(|s| s[index]), &options.reset, integrator);
                    member.pass_on(stop);
                }
                member.environment.observe(options.normalisation.scales(), out);
            }
        };
        let crews = &mut self.crews;
        match self.pool.as_ref().filter(|_| width > 0) {
            Some(pool) => pool.run(stop, || {
                crews.par_iter_mut().zip(observations.par_chunks_mut(size * width)).enumerate().for_each(task);
            }),
            None => crews.iter_mut().zip(Parts::of(observations, size * width)).enumerate().for_each(task),
        }
        self.finish()
    }

    /// Actions of a declared policy for the coming step of each instance; `actions` has n × actions
    /// entries.
    ///
    /// # Errors
    /// A wrong length.
    pub fn policy(&mut self, index: usize, actions: &mut [f64]) -> Result<(), BatchError> {
        let inputs = self.action_len();
        length("actions", actions.len(), self.count * inputs)?;
        for (member, out) in self.members_mut().zip(Parts::of(actions, inputs)) {
            member.environment.policy(index, out);
        }
        Ok(())
    }

    /// Seeds `seed`, `seed + 1`, ... for all instances.
    #[must_use]
    pub fn seeds(&self, seed: u64) -> Vec<u64> {
        (0..self.count as u64).map(|i| seed.wrapping_add(i)).collect()
    }

    /// Steps all instances. `actions` has n × actions entries.
    ///
    /// # Errors
    /// Wrong lengths, a NaN or an episode that is over with autoreset disabled: then no instance
    /// was stepped. An instance that cannot begin its next episode.
    pub fn step<T: Number>(&mut self, actions: &[f64], arrays: StepArrays<'_, T>) -> Result<(), BatchError> {
        let n = self.count;
        let (width, inputs) = (self.observation_len(), self.action_len());
        length("actions", actions.len(), n * inputs)?;
        length("observations", arrays.observations.len(), n * width)?;
        length("rewards", arrays.rewards.len(), n)?;
        length("terminated", arrays.terminated.len(), n)?;
        length("truncated", arrays.truncated.len(), n)?;
        self.check(actions, inputs)?;
        self.begin()?;
        let (options, stop, size) = (&self.options, &*self.stop, self.size);
        let crews = &mut self.crews;
        let StepArrays { observations, rewards, terminated, truncated } = arrays;
        let task = |((((number, crew), out), rewards), (terminated, truncated)): Slot<'_, T>| {
            let flags = terminated.iter_mut().zip(truncated);
            let slots = Parts::of(out, width).zip(rewards).zip(flags);
            for ((index, member), ((out, reward), (terminated, truncated))) in (number * size..).zip(&mut crew.members).zip(slots) {
                if stop.load(Ordering::Relaxed) {
                    return;
                }
                let result = member.step(&actions[index * inputs..(index + 1) * inputs], options, &mut crew.integrator);
                (*reward, *terminated, *truncated) = result;
                member.pass_on(stop);
                member.environment.observe(options.normalisation.scales(), out);
            }
        };
        let parallel = self.pool.as_ref().filter(|_| width > 0 && self.pace.chooses_threads());
        let begin = Instant::now();
        match parallel {
            Some(pool) => pool.run(stop, || {
                crews
                    .par_iter_mut()
                    .enumerate()
                    .zip(observations.par_chunks_mut(size * width))
                    .zip(rewards.par_chunks_mut(size))
                    .zip(terminated.par_chunks_mut(size).zip(truncated.par_chunks_mut(size)))
                    .for_each(task);
            }),
            None => crews
                .iter_mut()
                .enumerate()
                .zip(Parts::of(observations, size * width))
                .zip(rewards.chunks_mut(size))
                .zip(terminated.chunks_mut(size).zip(truncated.chunks_mut(size)))
                .for_each(task),
        }
        self.pace.note(parallel.is_some(), begin.elapsed());
        self.finish()
    }

    /// Refuses before anything is stepped.
    fn check(&self, actions: &[f64], inputs: usize) -> Result<(), BatchError> {
        for (index, member) in self.crews.iter().flat_map(|crew| &crew.members).enumerate() {
            if member.pending {
                continue;
            }
            let row = &actions[index * inputs..(index + 1) * inputs];
            member.environment.check(row).map_err(|error| BatchError::Step { index, error })?;
        }
        Ok(())
    }

    /// Before instances are reset or stepped: starts missing threads and clears interrupts.
    fn begin(&mut self) -> Result<(), BatchError> {
        self.stop.store(false, Ordering::Relaxed);
        if let Some(pool) = self.pool.as_mut().filter(|pool| !pool.is_mine()) {
            *pool = Pool::new(pool.threads(), &self.stop)?;
        }
        Ok(())
    }

    /// Failure, if any.
    fn finish(&mut self) -> Result<(), BatchError> {
        if !self.stop.load(Ordering::Relaxed) {
            return self.first_fault();
        }
        for member in self.members_mut() {
            member.environment.abandon();
            (member.pending, member.ended, member.fault) = (false, false, None);
        }
        Err(BatchError::Interrupted)
    }

    fn first_fault(&mut self) -> Result<(), BatchError> {
        for (index, member) in self.members_mut().enumerate() {
            match member.fault.take() {
                Some(Fault::Step(error)) => return Err(BatchError::Step { index, error }),
                Some(Fault::Reset(error)) => return Err(BatchError::Reset { index, error }),
                None => {}
            }
        }
        Ok(())
    }

    fn observation_len(&self) -> usize {
        self.member(0).map_or(0, |m| m.environment.observation_len())
    }

    fn action_len(&self) -> usize {
        self.member(0).map_or(0, |m| m.environment.catalogue().actions.len())
    }
}

/// Data of a task of a step: instances, their observations, rewards and flags.
type Slot<'a, T> = ((((usize, &'a mut Crew), &'a mut [T]), &'a mut [f64]), (&'a mut [bool], &'a mut [bool]));

fn length(name: &'static str, given: usize, expected: usize) -> Result<(), BatchError> {
    if given == expected { Ok(()) } else { Err(BatchError::Length { name, given, expected }) }
}

/// Parts of an array, one after another: as many entries each as there are of a thing, which may be
/// none. The parts beyond the end are empty.
struct Parts<'a, T> {
    rest: &'a mut [T],
    size: usize,
}

impl<'a, T> Parts<'a, T> {
    fn of(array: &'a mut [T], size: usize) -> Self {
        Self { rest: array, size }
    }
}

impl<'a, T> Iterator for Parts<'a, T> {
    type Item = &'a mut [T];

    fn next(&mut self) -> Option<Self::Item> {
        let rest = std::mem::take(&mut self.rest);
        let (part, rest) = rest.split_at_mut(self.size.min(rest.len()));
        self.rest = rest;
        Some(part)
    }
}
