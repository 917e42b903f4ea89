//! Course of one try: Newton's method, and the process followed in pseudo-time.

use super::Search;
use crate::newton::{Equations, Try, apply, newton};
use crate::system::CompiledSystem;

/// Pseudo-time steps of one try.
const MAX_PSEUDO: u32 = 1000;
/// Largest change of an unknown, relative to its scale and size, in one pseudo-time step.
const MAX_CHANGE: f64 = 0.3;

/// The equations at rest.
struct AtRest<'a> {
    search: &'a mut Search,
    system: &'a mut CompiledSystem,
}

impl Equations for AtRest<'_> {
    fn places(&self) -> &[usize] {
        &self.search.problem.free
    }

    fn evaluate(&mut self, y: &[f64]) {
        self.search.problem.evaluate(self.system, y);
    }

    fn factorise(&mut self, y: &[f64]) -> Result<(), Option<usize>> {
        self.search.factorise(self.system, y, 0.0)
    }

    fn correction(&mut self, out: &mut [f64]) {
        self.search.problem.correction(out);
    }

    fn norm(&self, step: &[f64]) -> f64 {
        self.search.problem.norm(step)
    }
}

impl Search {
    /// Newton's method, damped; kept inside of the bounds where that is wanted.
    pub(super) fn newton(&mut self, system: &mut CompiledSystem, y: &mut [f64], inside: bool) -> Result<Try, Option<usize>> {
        let bounds = inside.then(|| self.bounds.clone());
        newton(&mut AtRest { search: self, system }, bounds.as_ref(), y)
    }

    /// Follows the process with growing steps of the linearised implicit Euler method until it
    /// hardly moves.
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
            apply(&self.problem.free, &mut trial, &step, 1.0);
            self.problem.evaluate(system, &trial);
            let finite = self.problem.row_places.iter().all(|&row| self.problem.rows[row].is_finite());
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
