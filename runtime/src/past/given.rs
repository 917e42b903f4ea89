//! A past that is given as samples, instead of what follows from the start.

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::layout::{Memory, Region};

use super::{Past, PastError, Point, name_of};

/// States and actions before a start, in physical units and declaration order: a row for each time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Times from the start, which increase and are below zero.
    pub times: Vec<f64>,
    /// States at these times; empty if they are those at the start.
    pub states: Vec<f64>,
    /// Actions from each time to the next one; empty if they are the nominal ones.
    pub actions: Vec<f64>,
}

/// Samples before the start, in internal order: a row for each time.
pub(crate) struct Samples {
    /// Times, which increase and are before the start.
    pub times: Vec<f64>,
    /// States at these times; empty if they are those at the start.
    pub states: Vec<f64>,
    /// Actions from each time to the next one; empty if they are those at the start.
    pub actions: Vec<f64>,
}

impl Past {
    /// Records samples instead of what was before the start, which was recorded at this point.
    ///
    /// # Errors
    /// A delayed expression that does not follow from states and actions.
    pub(crate) fn record_samples(
        &mut self,
        model: &CompiledModel,
        memory: &mut Memory,
        at: Point<'_>,
        rtol: f64,
        samples: &Samples,
    ) -> Result<(), PastError> {
        if self.directly {
            return Err(PastError::History { delay: name_of(model, 0) });
        }
        let begin = at.t - self.reach();
        self.kept.record.clear();
        let present = memory.region(Region::Action).to_vec();
        let inside = samples.times.iter().copied().filter(|&time| time > begin);
        let ends: Vec<f64> = inside.chain([at.t]).collect();
        let (mut from, mut y) = (begin, at.y.to_vec());
        let mut yp = vec![0.0; y.len()];
        for end in ends {
            let row = samples.times.partition_point(|&time| time <= from).saturating_sub(1);
            if !samples.actions.is_empty() {
                memory.region_mut(Region::Action).copy_from_slice(&samples.actions[row * present.len()..(row + 1) * present.len()]);
                model.prepare_step(memory);
            }
            self.record_span((from, end), rtol, &mut |_, t, out| {
                samples.states_at(t, at, &mut y, &mut yp);
                model.delayed(memory, t, &y, &yp, out);
            });
            if from > begin {
                self.kept.marks.add(from, if samples.actions.is_empty() { 2 } else { 0 }, &self.distinct);
            }
            from = end;
        }
        memory.region_mut(Region::Action).copy_from_slice(&present);
        model.prepare_step(memory);
        Ok(())
    }
}

impl Samples {
    /// States and rates at a time: cubics between the samples and the start, whose slopes are those
    /// of parabolas through three of them; constant before the first sample.
    fn states_at(&self, time: f64, start: Point<'_>, y: &mut [f64], yp: &mut [f64]) {
        let count = self.times.len();
        let states = self.states.len() / count.max(1);
        if states == 0 {
            return;
        }
        let time_of = |row: usize| self.times.get(row).copied().unwrap_or(start.t);
        let value = |row: usize, at: usize| if row < count { self.states[row * states + at] } else { start.y[at] };
        let piece = self.times.partition_point(|&known| known <= time);
        for at in 0..states {
            let Some(row) = piece.checked_sub(1) else {
                (y[at], yp[at]) = (value(0, at), 0.0);
                continue;
            };
            let chord = |row: usize| (value(row + 1, at) - value(row, at)) / (time_of(row + 1) - time_of(row));
            let slope = |row: usize| {
                let (before, behind) = (row.max(1) - 1, row.min(count - 1));
                if before == behind {
                    return chord(before);
                }
                let (first, second) = (time_of(before + 1) - time_of(before), time_of(behind + 1) - time_of(behind));
                match row {
                    0 => chord(0),
                    row if row == count => chord(count - 1),
                    _ => (chord(before) * second + chord(behind) * first) / (first + second),
                }
            };
            let length = time_of(row + 1) - time_of(row);
            let x = (time - time_of(row)) / length;
            let change = value(row + 1, at) - value(row, at);
            let (first, last) = (length * slope(row) - change, change - length * slope(row + 1));
            let rest = 1.0 - x;
            y[at] = value(row, at) + x * (change + rest * (rest * first + x * last));
            yp[at] = (change + (rest - x) * (rest * first + x * last) + x * rest * (last - first)) / length;
        }
    }
}
