//! How well declared invariants hold: along the integration, the change of the value must be the integral of the rate.

use super::Environment;
use crate::solver::{Advance, SolveError};

/// Pieces of an interval between whose ends the rate is integrated by Simpson's rule; even.
const PIECES: usize = 32;

/// Drift of one invariant since the reset.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drift {
    /// Change of the value less the integral of the rate, summed over the intervals.
    pub sum: f64,
    /// Largest absolute sum so far.
    pub largest: f64,
    /// Largest absolute value so far, to compare with.
    pub magnitude: f64,
}

impl Environment {
    /// Evaluates the declared invariants along the integration from now on (slower).
    pub fn watch_invariants(&mut self) {
        let count = self.setup.model().interface().invariants.len();
        self.drifts = vec![Drift::default(); count];
    }

    /// Drift of each declared invariant, if they are watched.
    #[must_use]
    pub fn invariant_drifts(&self) -> &[Drift] {
        &self.drifts
    }

    /// Goes to `end` in pieces, adding to the drifts. What an event cuts short is integrated by the trapezoidal rule.
    pub(super) fn advance_watched(&mut self, begin: f64, end: f64) -> Result<Advance, SolveError> {
        let length = (end - begin) / PIECES as f64;
        let mut points = vec![self.evaluate_invariants(begin)];
        let mut last = begin;
        for piece in 1..=PIECES {
            let target = if piece == PIECES { end } else { begin + length * piece as f64 };
            let outcome = self.integrator.advance(&mut self.system, target)?;
            let at = self.integrator.time();
            points.push(self.evaluate_invariants(at));
            if outcome == Advance::Event {
                self.add_drifts(&points, length, at - last);
                return Ok(outcome);
            }
            last = at;
        }
        self.add_drifts(&points, length, length);
        Ok(Advance::Reached)
    }

    fn evaluate_invariants(&mut self, t: f64) -> Vec<f64> {
        let mut out = vec![0.0; 2 * self.drifts.len()];
        let (y, yp) = (self.integrator.state(), self.integrator.derivative());
        let (model, memory) = self.system.parts();
        model.invariants(memory, t, y, yp, &mut out);
        out
    }

    /// `points` hold value and rate of each invariant, `length` apart but for the last, which is `final_length` from the one before.
    fn add_drifts(&mut self, points: &[Vec<f64>], length: f64, final_length: f64) {
        for (i, drift) in self.drifts.iter_mut().enumerate() {
            let value = |p: usize| points[p][2 * i];
            let rate = |p: usize| points[p][2 * i + 1];
            let last = points.len() - 1;
            // Simpson's rule over pairs of equal pieces, the trapezoidal rule for what is left.
            let equal = if final_length == length { last } else { last - 1 };
            let paired = equal - equal % 2;
            let mut integral: f64 = (0..paired).step_by(2).map(|p| length / 3.0 * (rate(p) + 4.0 * rate(p + 1) + rate(p + 2))).sum();
            for p in paired..last {
                let width = if p + 1 == last { final_length } else { length };
                integral += width / 2.0 * (rate(p) + rate(p + 1));
            }
            drift.sum += value(last) - value(0) - integral;
            drift.largest = drift.largest.max(drift.sum.abs());
            drift.magnitude = (0..=last).map(|p| value(p).abs()).fold(drift.magnitude, f64::max);
        }
    }
}
