//! Results of the `finish` program of a step.

use std::ops::Range;

use smpl_compiler::model::FinishLayout;

/// Its output, whose parts follow one another.
pub(super) struct Finish {
    values: Vec<f64>,
    parts: [Range<usize>; 5],
}

/// A part of the output.
#[derive(Clone, Copy)]
pub(super) enum FinishPart {
    /// For each declared failure whether it holds, and its excess.
    Failures,
    /// For each success condition whether it holds.
    Successes,
    /// The excess of each constraint.
    Constraints,
    /// Rewards as declared.
    Rewards,
    /// Observations as measured.
    Observations,
}

impl Finish {
    /// Space for it, all zero.
    pub(super) fn new(layout: FinishLayout) -> Self {
        let values = vec![0.0; layout.total()];
        let FinishLayout { failures, successes, constraints, rewards, observations } = layout;
        Self { values, parts: [failures, successes, constraints, rewards, observations] }
    }

    /// All of it.
    pub(super) fn all(&self) -> &[f64] {
        &self.values
    }

    /// The same, to be written.
    pub(super) fn all_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// Place of a part in it.
    pub(super) fn start(&self, part: FinishPart) -> usize {
        self.parts[part as usize].start
    }

    /// A part.
    pub(super) fn part(&self, part: FinishPart) -> &[f64] {
        &self.values[self.parts[part as usize].clone()]
    }
}
