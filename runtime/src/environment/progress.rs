//! Data that changes from step to step.

use serde::{Deserialize, Serialize};

use super::StepResult;
use crate::failure::{Chatter, NotFinite, SolverFailure};
use crate::observe::Readings;
use crate::random::EpisodeKey;
use crate::solver::{Carried, Edge};

/// Progress of an instance in its episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Phase {
    /// Before the first reset.
    New,
    Running,
    Over,
}

/// All that changes from step to step, apart from the memory of the compiled model: what a snapshot
/// holds.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Progress {
    pub(super) key: EpisodeKey,
    pub(super) next_key: EpisodeKey,
    /// Random numbers of the steps are at their means.
    pub(super) expected: bool,
    pub(super) steps: u32,
    pub(super) phase: Phase,
    pub(super) y: Vec<f64>,
    pub(super) yp: Vec<f64>,
    pub(super) readings: Readings,
    pub(super) verdict: Verdict,
    /// Truth of the conditions of events.
    pub(super) edges: Vec<Edge>,
    /// Data that the integrator carries along.
    pub(super) carried: Carried,
    /// Time of the state where the last step ended before its end: at an event, or where it began
    /// if nothing was integrated.
    pub(super) event_time: Option<f64>,
    pub(super) chatter: Option<Chatter>,
    pub(super) not_finite: Option<NotFinite>,
}

/// End of the last step. (Encoded within [`Progress`] as if its fields stood there.)
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Verdict {
    /// Rewards, failing ones already replaced.
    pub(super) rewards: Vec<f64>,
    /// Violations: the action box, declared failures, constraints.
    pub(super) violations: Vec<f64>,
    /// Truth of the declared failures.
    pub(super) failing: Vec<bool>,
    /// Sum of the chosen reward over the episode.
    pub(super) sum: f64,
    pub(super) last: Option<StepResult>,
    /// The success condition, counted from 0; beyond them all the end of a batch of fixed length.
    pub(super) met: Option<u32>,
    pub(super) solver_failure: Option<SolverFailure>,
    pub(super) action_excess: f64,
}

impl Verdict {
    /// That of an episode which has just begun, with so many failures, constraints and rewards.
    pub(super) fn blank(failures: usize, constraints: usize, rewards: usize) -> Self {
        Self {
            rewards: vec![0.0; rewards],
            violations: vec![0.0; 1 + failures + constraints],
            failing: vec![false; failures],
            sum: 0.0,
            last: None,
            met: None,
            solver_failure: None,
            action_excess: 0.0,
        }
    }
}

/// When an event fired within the step, how long after the time before, and how many times in
/// succession it came sooner.
#[derive(Clone, Copy)]
pub(super) struct Firing {
    pub(super) time: f64,
    pub(super) gap: f64,
    pub(super) sooner: u32,
}

impl Default for Firing {
    fn default() -> Self {
        Self { time: f64::NEG_INFINITY, gap: f64::INFINITY, sooner: 0 }
    }
}

/// Those of all events within the step, and which was the last.
pub(super) struct Firings {
    pub(super) each: Vec<Firing>,
    pub(super) last: Option<usize>,
}

impl Firings {
    pub(super) fn clear(&mut self) {
        self.each.fill(Firing::default());
        self.last = None;
    }
}

/// A recorded disturbance instead of a drawn one.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Replay {
    /// Place in the region.
    pub(super) at: usize,
    /// Completed steps at its beginning.
    pub(super) first: u32,
    /// One value a step.
    pub(super) values: Vec<f64>,
    /// The last value holds where the record has ended.
    pub(super) holds: bool,
    /// That it holds was asked for by name.
    pub(super) asked_to_hold: bool,
}

impl Replay {
    /// Index of the value for the step after `steps` completed ones.
    pub(super) fn row(&self, steps: u32) -> usize {
        steps.saturating_sub(self.first) as usize
    }
}

impl Progress {
    /// Key of the errors of measurements; `None` without errors.
    pub(super) fn errors(&self) -> Option<EpisodeKey> {
        (!self.expected).then_some(self.key)
    }
}
