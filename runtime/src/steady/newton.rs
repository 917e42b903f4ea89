//! The search: damped Newton iterations and pseudo-transient continuation on the free rows and unknowns.

use super::{SteadyError, equation_name, unknown_name};
use crate::catalogue::Catalogue;
use crate::interrupt::Pace;
use crate::solver::linear::Factorisation;
use crate::solver::{LinearSolver, Pattern, System};
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

/// The problem without its fixed states, and working memory.
pub(super) struct Search {
    /// Places in `y` of the free unknowns.
    free: Vec<usize>,
    /// Places of the reduced Jacobian's entries among all entries.
    kept: Vec<usize>,
    factorisation: Factorisation,
    scales: Vec<f64>,
    /// First step of pseudo-time.
    first_step: f64,
    zero: Vec<f64>,
    rows: Vec<f64>,
    entries: Vec<f64>,
    reduced: Vec<f64>,
    pace: Pace,
    interrupted: bool,
}

/// How one try ended.
enum Try {
    Converged(u32),
    Failed(u32),
}

impl Search {
    pub fn new(system: &CompiledSystem, catalogue: &Catalogue, fixed: &[bool]) -> Result<Self, SteadyError> {
        let pattern = system.pattern();
        let n = pattern.dimension();
        let free: Vec<usize> = (0..n).filter(|&i| !fixed[i]).collect();
        let mut number = vec![usize::MAX; n];
        for (position, &at) in free.iter().enumerate() {
            number[at] = position;
        }
        let (mut starts, mut rows, mut kept) = (vec![0], Vec::new(), Vec::new());
        for &column in &free {
            for entry in pattern.column(column) {
                let row = pattern.rows()[entry];
                if !fixed[row] {
                    rows.push(number[row]);
                    kept.push(entry);
                }
            }
            starts.push(rows.len());
        }
        let reduced = Pattern::new(starts, rows).map_err(crate::solver::SolveError::from)?;
        let factorisation = Factorisation::new(&reduced, LinearSolver::Auto)
            .map_err(|_| SteadyError::Undetermined { unknown: empty_column(&reduced, &free, catalogue) })?;
        let mut scales = vec![1.0; n];
        for element in catalogue.states.elements().iter().chain(catalogue.solved.elements()) {
            if element.scale.is_finite() && element.scale > 0.0 {
                scales[element.at] = element.scale;
            }
        }
        Ok(Self {
            reduced: vec![0.0; kept.len()],
            pace: Pace::default(),
            interrupted: false,
            free,
            kept,
            factorisation,
            scales,
            first_step: 0.1 * system.model().interface().episode.step,
            zero: vec![0.0; n],
            rows: vec![0.0; n],
            entries: vec![0.0; pattern.entries()],
        })
    }

    /// Improves `y` to a steady state; the number of iterations.
    pub fn run(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &mut [f64]) -> Result<u32, SteadyError> {
        if self.free.is_empty() {
            return Ok(0);
        }
        let found = self.search(system, catalogue, y);
        if self.interrupted { Err(SteadyError::Interrupted) } else { found }
    }

    fn search(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &mut [f64]) -> Result<u32, SteadyError> {
        let guess = y.to_vec();
        self.evaluate(system, y);
        if let Some(&row) = self.free.iter().find(|&&row| !self.rows[row].is_finite()) {
            return Err(SteadyError::NotFinite { equation: equation_name(system.model(), catalogue, row) });
        }
        let mut total = 0;
        match self.newton(system, y) {
            Ok(Try::Converged(iterations)) => return Ok(iterations),
            Ok(Try::Failed(iterations)) => total += iterations,
            Err(_) => {}
        }
        y.copy_from_slice(&guess);
        total += self.follow(system, y);
        match self.newton(system, y) {
            Ok(Try::Converged(iterations)) => Ok(total + iterations),
            Ok(Try::Failed(iterations)) => Err(self.not_found(system, catalogue, y, total + iterations)),
            Err(column) => {
                let unknown = column.and_then(|c| self.free.get(c)).and_then(|&at| unknown_name(catalogue, at));
                Err(SteadyError::Undetermined { unknown })
            }
        }
    }

    fn not_found(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &[f64], iterations: u32) -> SteadyError {
        self.evaluate(system, y);
        let size = |row: &usize| self.rows[*row].abs() / self.scales[*row];
        let worst = self.free.iter().copied().max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(0);
        let equation = equation_name(system.model(), catalogue, worst);
        SteadyError::NotFound { iterations, residual: self.rows[worst], equation }
    }

    /// Rows at rest.
    fn evaluate(&mut self, system: &mut CompiledSystem, y: &[f64]) {
        system.residual(0.0, y, &self.zero, &mut self.rows);
    }

    /// Factorises the Jacobian with the weight `cj` of the derivatives. The column without a pivot is the error.
    fn factorise(&mut self, system: &mut CompiledSystem, y: &[f64], cj: f64) -> Result<(), Option<usize>> {
        self.interrupted |= self.pace.stops();
        if self.interrupted {
            return Err(None);
        }
        system.jacobian(0.0, y, &self.zero, cj, &mut self.entries);
        for (value, &entry) in self.reduced.iter_mut().zip(&self.kept) {
            *value = self.entries[entry];
        }
        if self.reduced.iter().any(|v| !v.is_finite()) {
            return Err(None);
        }
        self.factorisation.factorise(&self.reduced).map_err(|singular| singular.column)
    }

    /// Writes the correction that the last factorisation gives for the present rows.
    fn correction(&mut self, out: &mut [f64]) {
        for (value, &at) in out.iter_mut().zip(&self.free) {
            *value = -self.rows[at];
        }
        self.factorisation.solve(out);
    }

    /// Largest entry relative to the scales.
    fn norm(&self, correction: &[f64]) -> f64 {
        let relative = correction.iter().zip(&self.free).map(|(d, &at)| (d / self.scales[at]).abs());
        relative.fold(0.0, |norm, x| if x.is_nan() || x > norm { x } else { norm })
    }

    fn newton(&mut self, system: &mut CompiledSystem, y: &mut [f64]) -> Result<Try, Option<usize>> {
        let (mut step, mut trial_step) = (vec![0.0; self.free.len()], vec![0.0; self.free.len()]);
        let mut trial = y.to_vec();
        let mut last = f64::INFINITY;
        for iteration in 1..=MAX_NEWTON {
            self.evaluate(system, y);
            self.factorise(system, y, 0.0)?;
            self.correction(&mut step);
            let norm = self.norm(&step);
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
            let mut damping = 1.0;
            loop {
                trial.copy_from_slice(y);
                self.apply(&mut trial, &step, damping);
                self.evaluate(system, &trial);
                self.correction(&mut trial_step);
                if self.norm(&trial_step) <= (1.0 - damping / 4.0) * norm {
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
        for (d, &at) in step.iter().zip(&self.free) {
            y[at] += damping * d;
        }
    }

    /// Follows the process with growing steps of the linearised implicit Euler method until it hardly moves.
    fn follow(&mut self, system: &mut CompiledSystem, y: &mut [f64]) -> u32 {
        let mut step = vec![0.0; self.free.len()];
        let mut trial = y.to_vec();
        let mut length = self.first_step;
        for count in 0..MAX_PSEUDO {
            self.evaluate(system, y);
            let change = match self.factorise(system, y, 1.0 / length) {
                Ok(()) => {
                    self.correction(&mut step);
                    self.relative_change(&step, y)
                }
                Err(_) if self.interrupted => return count,
                Err(_) => f64::NAN,
            };
            trial.copy_from_slice(y);
            self.apply(&mut trial, &step, 1.0);
            self.evaluate(system, &trial);
            let finite = self.free.iter().all(|&row| self.rows[row].is_finite());
            if !(change <= MAX_CHANGE && finite) {
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
        let relative = step.iter().zip(&self.free).map(|(d, &at)| d.abs() / (self.scales[at] + y[at].abs()));
        relative.fold(0.0, |norm, x| if x.is_nan() || x > norm { x } else { norm })
    }
}

/// An unknown that no free equation mentions.
fn empty_column(pattern: &Pattern, free: &[usize], catalogue: &Catalogue) -> Option<String> {
    let column = (0..pattern.dimension()).find(|&c| pattern.column(c).is_empty())?;
    unknown_name(catalogue, free[column])
}
