//! Cyclic steady states: the start of an episode to which its states return after a period.
//!
//! The map of a period, from the states and discrete variables at its start to those at its end, is
//! iterated with Anderson's acceleration until they agree. Each mixture of earlier ends has weights
//! with the sum 1, so that conserved amounts are kept. Quantities that only accumulate keep their
//! values at the start.

use smpl_compiler::layout::Region;

use super::reset::ResetError;
use super::{Environment, Snapshot, StepError};
use crate::solver::{Carried, Edge};

/// Most periods that the search simulates.
const MOST_PERIODS: usize = 500;

/// Earlier periods that a mixture takes into account.
const DEPTH: usize = 12;

/// Change over a period, in tolerances of the solver, that counts as none.
const SETTLED: f64 = 10.0;

/// Difference of two periods, in tolerances of the solver, that counts as none.
const ALIKE: f64 = 50.0;

/// Periods after which the search looks for quantities that only accumulate: some do not move in
/// the first periods.
const REVIEWS: [usize; 4] = [0, 6, 30, 150];

/// Start of a period: states and discrete variables, and the conditions of events.
#[derive(Clone)]
struct Point {
    values: Vec<f64>,
    edges: Vec<Edge>,
}

/// A period that was simulated: its end, and the change over it in tolerances.
struct Period {
    end: Vec<f64>,
    change: Vec<f64>,
}

impl Environment {
    /// Replaces the start of the episode by its cyclic steady state under the nominal policy and
    /// mean disturbances.
    ///
    /// # Errors
    /// No period, a dead time, a step that the solver gives up, or states that do not return.
    pub(super) fn begin_cycle(&mut self) -> Result<(), ResetError> {
        let episode = &self.setup.model().interface().episode;
        let Some(period) = episode.cycle else {
            return Err(failure("the model has no period: add `cycle = 24 [h]` to `episode`".into()));
        };
        if self.system.past().is_some() {
            return Err(failure("a model with dead times has no cyclic start".into()));
        }
        let steps = (period / episode.step).round() as u32;
        let (trace, kept) = (self.trace.take(), std::mem::replace(&mut self.keep_going, true));
        let start = self.snapshot();
        let found = self.search(&start, steps);
        (self.trace, self.keep_going) = (trace, kept);
        let point = found?;
        self.place(&start, &point)?;
        self.first_observation()?;
        self.progress.edges.clone_from(&point.edges);
        self.drifts.fill(super::Drift::default());
        Ok(())
    }

    /// Iterates the map of a period to its fixed point.
    fn search(&mut self, start: &Snapshot, steps: u32) -> Result<Point, ResetError> {
        let mut point = Point { values: self.point(), edges: self.progress.edges.clone() };
        let first = point.values.clone();
        let mut mixture = Mixture { held: vec![false; point.values.len()], ..Mixture::default() };
        let mut open = None;
        for number in 0..MOST_PERIODS {
            let begin = point.clone();
            let end = match self.period(start, &mut point, steps) {
                Ok(end) => end,
                Err(ResetError::Interrupted) => return Err(ResetError::Interrupted),
                // A mixture may lead where the model has no solution: the last end does not.
                Err(error) => {
                    point.values = mixture.forget().ok_or(error)?;
                    continue;
                }
            };
            if REVIEWS.contains(&number) {
                let growth = |i: usize| (end[i] - begin.values[i]).abs();
                let moves = |i: &usize| self.alone(*i) && growth(*i) > 0.0 && growth(*i).is_finite();
                let candidates = (0..end.len()).filter(moves).collect();
                mixture.hold(self.accumulators(start, &begin, &end, candidates, steps));
            }
            let period = self.over_period(&point.values, end.clone(), (&mixture.held, &first));
            open = period.change.iter().position(|change| change.abs() > SETTLED || change.is_nan());
            if open.is_none() {
                let held: Vec<usize> = (0..end.len()).filter(|&i| mixture.held[i]).collect();
                let still = self.accumulators(start, &begin, &end, held, steps);
                if still == mixture.held {
                    return Ok(point);
                }
                mixture.hold(still);
                point.values = end;
                continue;
            }
            let next = mixture.next(&point.values, period);
            point.values = self.within_bounds(next, mixture.last_end());
        }
        let worst = open.map_or_else(String::new, |i| format!(": `{}` does not return to its value", self.name_of(i)));
        Err(failure(format!("none was found within {MOST_PERIODS} periods{worst}")))
    }

    /// Marks what only accumulates, as a meter does: other values of it change nothing else, and it
    /// grows as before. It keeps its value at the start.
    fn accumulators(&mut self, start: &Snapshot, begin: &Point, end: &[f64], candidates: Vec<usize>, steps: u32) -> Vec<bool> {
        let mut held = vec![false; end.len()];
        let mut groups = vec![candidates];
        while let Some(group) = groups.pop() {
            if group.is_empty() {
                continue;
            }
            if self.accumulate(start, begin, end, &group, steps) {
                group.iter().for_each(|&i| held[i] = true);
            } else if group.len() > 1 {
                let (first, second) = group.split_at(group.len() / 2);
                groups.extend([first.to_vec(), second.to_vec()]);
            }
        }
        held
    }

    /// Returns whether no equation but its own reads a state, or the number is a discrete variable.
    fn alone(&self, i: usize) -> bool {
        let columns = &self.setup.model().pattern().column_pointers;
        i >= self.setup.model().states() || columns[i + 1] - columns[i] <= 1
    }

    /// Returns whether all of a group accumulate.
    fn accumulate(&mut self, start: &Snapshot, begin: &Point, end: &[f64], group: &[usize], steps: u32) -> bool {
        let mut moved = begin.clone();
        // By other shares each: what follows another quantity is not moved with it.
        for &i in group {
            let share = 1.0 + (i as f64 * 0.618_034).fract();
            moved.values[i] += share * ((end[i] - begin.values[i]).abs() + self.scale(i));
        }
        let from = moved.values.clone();
        let Ok(to) = self.period(start, &mut moved, steps) else { return false };
        (0..to.len()).all(|i| {
            let shift = if from[i] == begin.values[i] { 0.0 } else { from[i] - begin.values[i] };
            shift == 0.0 && to[i] == end[i] || (to[i] - end[i] - shift).abs() <= ALIKE * self.tolerance(i, to[i])
        })
    }

    /// States and discrete variables.
    fn point(&self) -> Vec<f64> {
        let states = &self.progress.y[..self.setup.model().states()];
        states.iter().chain(self.discretes()).copied().collect()
    }

    /// Begins a period at a point.
    fn place(&mut self, start: &Snapshot, point: &Point) -> Result<(), ResetError> {
        self.restore(start).map_err(|error| failure(error.to_string()))?;
        let (states, discretes) = point.values.split_at(self.setup.model().states());
        self.progress.y[..states.len()].copy_from_slice(states);
        self.system.region_mut(Region::Discrete).copy_from_slice(discretes);
        self.progress.carried = Carried::default();
        self.integrator.forget();
        self.make_consistent()?;
        self.progress.edges.clone_from(&point.edges);
        Ok(())
    }

    /// The end of a period that begins at a point, which takes the conditions of events from there.
    fn period(&mut self, start: &Snapshot, point: &mut Point, steps: u32) -> Result<Vec<f64>, ResetError> {
        self.place(start, point)?;
        self.expect();
        let last = self.progress.steps + steps;
        let mut action = vec![0.0; self.setup.catalogue.actions.len()];
        // Events that end an episode stop a step, which the next one completes.
        while self.progress.steps < last || self.progress.event_time.is_some() {
            self.policy(0, &mut action);
            let before = self.time();
            match self.step(&action) {
                Ok(_) => {}
                Err(StepError::Interrupted) => return Err(ResetError::Interrupted),
                Err(error) => return Err(failure(error.to_string())),
            }
            if self.progress.verdict.solver_failure.is_some() || self.time() <= before {
                return Err(failure(format!("a step of the period failed: {}", self.failure_message())));
            }
        }
        let mut end = self.point();
        if let Some(since) = self.since() {
            end[since] -= f64::from(steps) * self.setup.model().interface().episode.step;
        }
        point.edges.clone_from(&self.progress.edges);
        Ok(end)
    }

    /// Place of the time at which the phase began.
    fn since(&self) -> Option<usize> {
        self.setup.phase?;
        Some(self.setup.model().states() + self.setup.catalogue.discretes.find("phase_start")?.at)
    }

    /// The change over a period in tolerances of the solver; `held` quantities go back to their
    /// first values.
    fn over_period(&self, begin: &[f64], mut end: Vec<f64>, (held, first): (&[bool], &[f64])) -> Period {
        (0..end.len()).filter(|&i| held[i]).for_each(|i| end[i] = first[i]);
        let change = begin.iter().zip(&end).enumerate().map(|(i, (a, b))| if a == b { 0.0 } else { (b - a) / self.tolerance(i, *a) });
        let change = change.collect();
        Period { end, change }
    }

    fn tolerance(&self, i: usize, value: f64) -> f64 {
        let solver = &self.setup.model().interface().solver;
        let rtol = solver.rtol.max(solver.one_step_rtol.unwrap_or(0.0));
        let value = if value.is_finite() { value.abs() } else { 0.0 };
        rtol * (value + solver.atol_factor.min(1.0) * self.scale(i)).max(f64::MIN_POSITIVE)
    }

    fn scale(&self, i: usize) -> f64 {
        let states = self.setup.model().states();
        let (family, at) = match i.checked_sub(states) {
            None => (&self.setup.catalogue.states, i),
            Some(at) => (&self.setup.catalogue.discretes, at),
        };
        family.elements().iter().find(|e| e.at == at).map_or(1.0, |e| e.scale)
    }

    fn name_of(&self, i: usize) -> String {
        let states = self.setup.model().states();
        let (family, at) = match i.checked_sub(states) {
            None => (&self.setup.catalogue.states, i),
            Some(at) => (&self.setup.catalogue.discretes, at),
        };
        family.elements().iter().find(|e| e.at == at).map_or_else(|| "a discrete variable".to_owned(), |e| e.name.clone())
    }

    /// A mixture that stays inside of the declared bounds where the last end does.
    fn within_bounds(&self, mut mixed: Vec<f64>, end: &[f64]) -> Vec<f64> {
        for element in self.setup.catalogue.states.elements() {
            let (low, high) = (element.low.min(end[element.at]), element.high.max(end[element.at]));
            mixed[element.at] = mixed[element.at].clamp(low, high);
        }
        mixed
    }
}

fn failure(message: String) -> ResetError {
    ResetError::Cyclic { message }
}

/// Ends and changes of the last periods, for Anderson's acceleration.
#[derive(Default)]
struct Mixture {
    last: Option<Period>,
    /// Quantities that only accumulate.
    held: Vec<bool>,
    /// Differences of successive ends and changes, the newest first.
    ends: Vec<Vec<f64>>,
    changes: Vec<Vec<f64>>,
}

impl Mixture {
    /// Drops all but the last end.
    fn forget(&mut self) -> Option<Vec<f64>> {
        self.ends.clear();
        self.changes.clear();
        self.last.take().map(|period| period.end)
    }

    /// Holds other quantities; the history is that of another map then.
    fn hold(&mut self, held: Vec<bool>) {
        if self.held != held {
            self.held = held;
            self.forget();
        }
    }

    fn last_end(&self) -> &[f64] {
        self.last.as_ref().map_or(&[], |period| &period.end)
    }

    /// The start of the next period: the mixture of earlier ends with the least change.
    fn next(&mut self, begin: &[f64], period: Period) -> Vec<f64> {
        let fixed =
            |i: usize| !begin[i].is_finite() || !period.end[i].is_finite() || (begin[i].fract() == 0.0 && period.end[i].fract() == 0.0);
        if let Some(last) = &self.last {
            let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| if (a - b).is_finite() { a - b } else { 0.0 }).collect();
            self.ends.insert(0, difference(&period.end, &last.end));
            self.changes.insert(0, difference(&period.change, &last.change));
            self.ends.truncate(DEPTH);
            self.changes.truncate(DEPTH);
        }
        let weights = least_squares(&self.changes, &period.change);
        let mut next = period.end.clone();
        for (weight, end) in weights.iter().zip(&self.ends) {
            next.iter_mut().zip(end).for_each(|(x, d)| *x -= weight * d);
        }
        for i in (0..next.len()).filter(|&i| fixed(i)) {
            next[i] = period.end[i];
        }
        self.last = Some(period);
        next
    }
}

/// Weights of columns whose sum is nearest to a vector; columns that add nothing get 0.
fn least_squares(columns: &[Vec<f64>], to: &[f64]) -> Vec<f64> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut rest: Vec<f64> = to.iter().map(|x| if x.is_finite() { *x } else { 0.0 }).collect();
    // Gram-Schmidt: each orthogonal column with its coefficients by the given ones.
    let mut basis: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
    let mut weights = vec![0.0; columns.len()];
    for (k, column) in columns.iter().enumerate() {
        let mut q = column.clone();
        let mut by = vec![0.0; columns.len()];
        by[k] = 1.0;
        let size = dot(&q, &q);
        for _ in 0..2 {
            for (other, theirs) in &basis {
                let share = dot(&q, other);
                q.iter_mut().zip(other).for_each(|(q, o)| *q -= share * o);
                by.iter_mut().zip(theirs).for_each(|(b, t)| *b -= share * t);
            }
        }
        let left = dot(&q, &q);
        if left <= 1e-14 * size || left == 0.0 || !left.is_finite() {
            continue;
        }
        let norm = left.sqrt();
        q.iter_mut().for_each(|x| *x /= norm);
        by.iter_mut().for_each(|x| *x /= norm);
        let share = dot(&rest, &q);
        rest.iter_mut().zip(&q).for_each(|(r, q)| *r -= share * q);
        weights.iter_mut().zip(&by).for_each(|(w, b)| *w += share * b);
        basis.push((q, by));
    }
    weights
}
