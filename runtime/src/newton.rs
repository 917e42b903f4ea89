//! Newton's method for square systems, damped by the natural monotonicity test (Deuflhard, *Newton
//! Methods for Nonlinear Problems*, 2004, section 3.3).

use crate::solver::Bounds;

/// Iterations of one try.
const MAX_ITERATIONS: u32 = 60;
/// Correction, relative to the scales, that counts as zero.
const CONVERGED: f64 = 1e-14;
/// Correction below which an iteration that no longer improves has met rounding.
const ROUNDING: f64 = 1e-8;
/// Smallest damping.
const MIN_DAMPING: f64 = 1e-4;
/// Part of the way to a bound that one iteration goes where the search is kept inside.
const TO_THE_BOUND: f64 = 0.9;

/// A square system of equations in some of the unknowns `y`.
pub(crate) trait Equations {
    /// Places in `y` of its unknowns.
    fn places(&self) -> &[usize];

    /// Evaluates the equations at `y`.
    fn evaluate(&mut self, y: &[f64]);

    /// Factorises the Jacobian at `y`. The column without a pivot is the error.
    fn factorise(&mut self, y: &[f64]) -> Result<(), Option<usize>>;

    /// Writes the Newton correction of the equations last evaluated, by the last factorisation.
    fn correction(&mut self, out: &mut [f64]);

    /// Largest entry of a correction relative to the scales; NaN where an entry is.
    fn norm(&self, step: &[f64]) -> f64;
}

/// The end of one try, with its iterations.
pub(crate) enum Try {
    Converged(u32),
    Failed(u32),
}

/// Improves `y`, inside of `bounds` where they are given. The column without a pivot is the error.
pub(crate) fn newton(equations: &mut impl Equations, bounds: Option<&Bounds>, y: &mut [f64]) -> Result<Try, Option<usize>> {
    let n = equations.places().len();
    let (mut step, mut trial_step) = (vec![0.0; n], vec![0.0; n]);
    let mut trial = y.to_vec();
    let mut last = f64::INFINITY;
    for iteration in 1..=MAX_ITERATIONS {
        equations.evaluate(y);
        equations.factorise(y)?;
        equations.correction(&mut step);
        let norm = equations.norm(&step);
        if !norm.is_finite() {
            return Ok(Try::Failed(iteration));
        }
        if norm <= ROUNDING {
            apply(equations.places(), y, &step, 1.0);
            if norm <= CONVERGED || norm >= 0.5 * last {
                return Ok(Try::Converged(iteration));
            }
            last = norm;
            continue;
        }
        last = norm;
        let mut damping = bounds.map_or(1.0, |bounds| bounds.reach(equations.places(), y, &step, TO_THE_BOUND));
        loop {
            trial.copy_from_slice(y);
            apply(equations.places(), &mut trial, &step, damping);
            equations.evaluate(&trial);
            equations.correction(&mut trial_step);
            if equations.norm(&trial_step) <= (1.0 - damping / 4.0) * norm {
                break;
            }
            damping *= 0.5;
            if damping < MIN_DAMPING {
                return Ok(Try::Failed(iteration));
            }
        }
        y.copy_from_slice(&trial);
    }
    Ok(Try::Failed(MAX_ITERATIONS))
}

/// Adds a damped step to the unknowns at `places`.
pub(crate) fn apply(places: &[usize], y: &mut [f64], step: &[f64], damping: f64) {
    for (d, &at) in step.iter().zip(places) {
        y[at] += damping * d;
    }
}
