//! How one try goes on: Newton's method, and the process followed in pseudo-time.

use super::{Search, Try};
use crate::system::CompiledSystem;

/// Newton iterations of one try.
const MAX_NEWTON: u32 = 60;
/// Pseudo-time steps of one try.
const MAX_PSEUDO: u32 = 1000;
/// Correction, relative to the scales, that counts as none.
const CONVERGED: f64 = 1e-14;
/// Correction below which an iteration that no longer improves has met rounding.
const ROUNDING: f64 = 1e-8;
/// Smallest damping.
const MIN_DAMPING: f64 = 1e-4;
/// Largest change of an unknown, relative to its scale and size, in one pseudo-time step.
const MAX_CHANGE: f64 = 0.3;
/// Part of the way to a bound that one iteration goes where the search is kept inside.
const TO_THE_BOUND: f64 = 0.9;

impl Search {
    /// Newton's method, damped; kept inside of the bounds where that is wanted.
    pub(super) fn newton(&mut self, system: &mut CompiledSystem, y: &mut [f64], inside: bool) -> Result<Try, Option<usize>> {
        let (mut step, mut trial_step) = (vec![0.0; self.problem.free.len()], vec![0.0; self.problem.free.len()]);
        let mut trial = y.to_vec();
        let mut last = f64::INFINITY;
        for iteration in 1..=MAX_NEWTON {
            self.problem.evaluate(system, y);
            self.factorise(system, y, 0.0)?;
            self.problem.correction(&mut step);
            let norm = self.problem.norm(&step);
            if !norm.is_finite() {
                return Ok(Try::Failed(iteration));
            }
            if norm <= ROUNDING {
                self.apply(y, &step, 1.0);
                if norm <= CONVERGED || norm >= 0.5 * last {
                    return Ok(Try::Converged(iteration));
                }
                last = norm;
                continue;
            }
            last = norm;
            let mut damping = if inside { self.bounds.reach(&self.problem.free, y, &step, TO_THE_BOUND) } else { 1.0 };
            loop {
                trial.copy_from_slice(y);
                self.apply(&mut trial, &step, damping);
                self.problem.evaluate(system, &trial);
                self.problem.correction(&mut trial_step);
                if self.problem.norm(&trial_step) <= (1.0 - damping / 4.0) * norm {
                    break;
                }
                damping *= 0.5;
                if damping < MIN_DAMPING {
                    return Ok(Try::Failed(iteration));
                }
            }
            y.copy_from_slice(&trial);
        }
        Ok(Try::Failed(MAX_NEWTON))
    }

    fn apply(&self, y: &mut [f64], step: &[f64], damping: f64) {
        for (d, &at) in step.iter().zip(&self.problem.free) {
            y[at] += damping * d;
        }
    }

    /// Follows the process with growing steps of the linearised implicit Euler method until it hardly moves.
    pub(super) fn follow(&mut self, system: &mut CompiledSystem, y: &mut [f64]) -> u32 {
        let mut step = vec![0.0; self.problem.free.len()];
        let mut trial = y.to_vec();
        let mut length = self.first_step;
        let confined = self.is_inside(y);
        for count in 0..MAX_PSEUDO {
            self.problem.evaluate(system, y);
            let change = match self.factorise(system, y, 1.0 / length) {
                Ok(()) => {
                    self.problem.correction(&mut step);
                    self.relative_change(&step, y)
                }
                Err(_) if self.interrupted => return count,
                Err(_) => f64::NAN,
            };
            trial.copy_from_slice(y);
            self.apply(&mut trial, &step, 1.0);
            self.problem.evaluate(system, &trial);
            let finite = self.problem.free.iter().all(|&row| self.problem.rows[row].is_finite());
            let left = confined && !self.is_inside(&trial);
            if !(change <= MAX_CHANGE && finite) || left {
                length *= 0.25;
                if length < 1e-12 * self.first_step {
                    return count;
                }
                continue;
            }
            y.copy_from_slice(&trial);
            if change < 1e-9 && length > 1e3 * self.first_step {
                return count;
            }
            length *= (0.5 * MAX_CHANGE / change.max(1e-300)).clamp(1.0, 4.0);
        }
        MAX_PSEUDO
    }

    fn relative_change(&self, step: &[f64], y: &[f64]) -> f64 {
        let relative = step.iter().zip(&self.problem.free).map(|(d, &at)| d.abs() / (self.problem.scales[at] + y[at].abs()));
        relative.fold(0.0, |norm, x| if x.is_nan() || x > norm { x } else { norm })
    }
}
