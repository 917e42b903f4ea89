//! What the equations at rest leave free: null spaces of the Jacobian.
//!
//! A vector of the right null space is a direction along which the states may be moved at rest; one of the left null space that is the same
//! at every point, and under which the rates add up to zero, is a sum that nothing changes. A state determines the rest if the
//! Jacobian without its row and column is regular, which holds where neither null space is zero in it.

use nalgebra::{DMatrix, DVector};

use super::error::{ConservedSum, Freedom};
use super::problem::Problem;
use crate::catalogue::{Catalogue, Element};
use crate::system::CompiledSystem;

/// Singular values are not computed for more unknowns.
pub(super) const LARGE: usize = 500;
/// Singular value, of a matrix with rows of size 1, that counts as none.
const NONE: f64 = 1e-12;
/// Entry of a null vector, relative to the largest, that counts as none.
const SMALL: f64 = 1e-7;
/// Distances from the guess, relative to the scales, of the points at which the equations are looked at.
const DISTANCES: [f64; 3] = [0.0, 0.013, 0.021];

/// The Jacobian and the rates at a point, rows scaled to size 1, columns by the scales of the unknowns.
struct Sample {
    jacobian: DMatrix<f64>,
    rates: DVector<f64>,
    /// Size of each row before.
    sizes: Vec<f64>,
}

/// Null spaces, a vector a column.
struct Null {
    left: DMatrix<f64>,
    right: DMatrix<f64>,
}

/// What is free near `y`; `None` where everything is determined or there are too many unknowns to tell.
pub(super) fn freedom(problem: &mut Problem, system: &mut CompiledSystem, catalogue: &Catalogue, y: &[f64]) -> Option<Freedom> {
    if problem.free.is_empty() || problem.free.len() > LARGE {
        return None;
    }
    let samples: Vec<Sample> = DISTANCES.iter().filter_map(|&d| sample(problem, system, y, d)).collect();
    // Where the guess is a singular point of its own, the points around are not.
    let (at, null) = samples
        .iter()
        .enumerate()
        .map(|(i, s)| Some((i, null(s)?)))
        .collect::<Option<Vec<_>>>()?
        .into_iter()
        .min_by_key(|n| n.1.left.ncols())?;
    if null.left.ncols() == 0 {
        return None;
    }
    let states = system.model().states();
    let chosen = determining(&null, &problem.free, states);
    let element = |i: usize| all(catalogue).find(|e| e.at == problem.free[i]);
    let name = |i: &usize| element(*i).map(|e| e.name.clone());
    if chosen.len() < null.left.ncols() {
        let largest = |i: &usize| null.right.row(*i).amax() > SMALL && problem.free[*i] >= states;
        let algebraics = (0..problem.free.len()).filter(largest).filter_map(|i| name(&i)).take(6).collect();
        return Some(Freedom { algebraics, ..Freedom::default() });
    }
    let mut chosen = chosen;
    chosen.sort_unstable();
    let explicit = system.model().explicit();
    let sums = if explicit { conserved(&null, &samples, at, &problem.free, states) } else { Vec::new() };
    // A state that nothing changes on its own is one that integrates.
    let sums = sums.iter().map(|sum| described(sum, y, &problem.free, catalogue)).filter(|sum| sum.terms.len() > 1).collect();
    let drifts = chosen.iter().filter_map(|&i| Some((name(&i)?, drift(&samples, i)?))).collect();
    Some(Freedom { states: chosen.iter().filter_map(name).collect(), sums, algebraics: Vec::new(), drifts })
}

/// The rate of a state that no unknown moves, where it is not zero.
fn drift(samples: &[Sample], i: usize) -> Option<f64> {
    let rate = samples.first()?.rates[i];
    let constant = samples.iter().all(|s| s.jacobian.row(i).amax() == 0.0 && s.rates[i] == rate);
    (constant && rate != 0.0).then_some(rate)
}

fn all(catalogue: &Catalogue) -> impl Iterator<Item = &Element> {
    catalogue.states.elements().iter().chain(catalogue.solved.elements())
}

/// The equations at a point near `y`.
fn sample(problem: &mut Problem, system: &mut CompiledSystem, y: &[f64], distance: f64) -> Option<Sample> {
    let mut point = y.to_vec();
    for (i, &at) in problem.free.iter().enumerate() {
        // Numbers without a pattern, upwards: rates of what is used up vanish at zero.
        let spread = 0.5 + ((i as f64 + 1.0) * 0.618_033_988_749_895).fract();
        point[at] += distance * spread * (problem.scales[at] + y[at].abs());
    }
    let (mut jacobian, mut rates) = problem.dense(system, &point)?;
    let mut sizes = Vec::with_capacity(rates.len());
    for (i, mut row) in jacobian.row_iter_mut().enumerate() {
        let size = row.amax();
        let size = if size > 0.0 { size } else { 1.0 };
        row /= size;
        rates[i] /= size;
        sizes.push(size);
    }
    Some(Sample { jacobian, rates, sizes })
}

fn null(sample: &Sample) -> Option<Null> {
    let n = sample.rates.len();
    let svd = sample.jacobian.clone().try_svd(true, true, f64::EPSILON, 10_000)?;
    let (u, v) = (svd.u?, svd.v_t?.transpose());
    let largest = svd.singular_values.max();
    let free: Vec<usize> = (0..n).filter(|&i| svd.singular_values[i] <= NONE * largest).collect();
    Some(Null { left: u.select_columns(&free), right: v.select_columns(&free) })
}

/// States that determine the rest, as many as there are null vectors where that is possible.
fn determining(null: &Null, free: &[usize], states: usize) -> Vec<usize> {
    let (mut left, mut right) = (null.left.clone(), null.right.clone());
    let mut chosen = Vec::new();
    for _ in 0..left.ncols() {
        let (l, r) = (left.amax(), right.amax());
        let serves = |i: &usize| left.row(*i).amax() > 0.05 * l && right.row(*i).amax() > 0.05 * r;
        let Some(next) = (0..free.len()).filter(|&i| free[i] < states).find(serves) else { break };
        if l < SMALL || r < SMALL {
            break;
        }
        take_out(&mut left, next);
        take_out(&mut right, next);
        chosen.push(next);
    }
    chosen
}

/// Makes a row of the columns zero by adding one of them to the others, which then is taken away.
fn take_out(columns: &mut DMatrix<f64>, row: usize) {
    let size = |j: &usize| columns[(row, *j)].abs();
    let pivot = (0..columns.ncols()).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(0);
    let column = columns.column(pivot) / columns[(row, pivot)];
    for j in 0..columns.ncols() {
        let factor = columns[(row, j)];
        columns.column_mut(j).axpy(-factor, &column, 1.0);
    }
}

/// Sums of states that nothing changes, as factors of the free unknowns in reduced echelon form.
fn conserved(null: &Null, samples: &[Sample], at: usize, free: &[usize], states: usize) -> Vec<DVector<f64>> {
    // Factors of the rows themselves.
    let mut rows = null.left.clone();
    for (i, mut row) in rows.row_iter_mut().enumerate() {
        row /= samples[at].sizes[i];
    }
    for mut column in rows.column_iter_mut() {
        let largest = column.amax();
        column.apply(|x| *x = if x.abs() < SMALL * largest { 0.0 } else { *x / largest });
    }
    // What is the same at all points: combinations of the vectors under which all Jacobians and rates vanish.
    let mut changes = DMatrix::zeros(rows.ncols(), 0);
    for sample in samples {
        let n = sample.rates.len();
        let raw = DMatrix::from_fn(n, n + 1, |i, j| sample.sizes[i] * if j < n { sample.jacobian[(i, j)] } else { sample.rates[i] });
        let sums = rows.transpose() * &raw;
        let sizes = rows.abs().transpose() * raw.abs();
        let relative = sums.zip_map(&sizes, |sum, size| if size > 0.0 { sum / size } else { 0.0 });
        let before = changes.ncols();
        changes = changes.resize_horizontally(before + n + 1, 0.0);
        changes.columns_mut(before, n + 1).copy_from(&relative);
    }
    let eigen = (&changes * changes.transpose()).symmetric_eigen();
    let kept: Vec<usize> = (0..rows.ncols()).filter(|&i| eigen.eigenvalues[i].abs() < 1e-18).collect();
    let mut sums = &rows * eigen.eigenvectors.select_columns(&kept);
    for (i, mut row) in sums.row_iter_mut().enumerate() {
        if free[i] >= states {
            row.fill(0.0);
        }
    }
    echelon(sums)
}

/// Columns in reduced echelon form, without those that are zero.
fn echelon(mut columns: DMatrix<f64>) -> Vec<DVector<f64>> {
    let mut done = 0;
    for row in 0..columns.nrows() {
        if done == columns.ncols() {
            break;
        }
        let size = |j: &usize| columns[(row, *j)].abs();
        let pivot = (done..columns.ncols()).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(done);
        if columns[(row, pivot)].abs() < SMALL {
            continue;
        }
        columns.swap_columns(done, pivot);
        let column = columns.column(done) / columns[(row, done)];
        for j in (0..columns.ncols()).filter(|&j| j != done) {
            let factor = columns[(row, j)];
            columns.column_mut(j).axpy(-factor, &column, 1.0);
        }
        columns.set_column(done, &column);
        done += 1;
    }
    (0..done).map(|j| columns.column(j).map(|x| if x.abs() < SMALL { 0.0 } else { rounded(x) })).collect()
}

/// A factor without the roundoff of the null space, where it is a ratio of small numbers.
fn rounded(x: f64) -> f64 {
    (1..=12).map(|d| (x * f64::from(d)).round() / f64::from(d)).find(|r| (x - r).abs() < 1e-9 * x.abs().max(1.0)).unwrap_or(x)
}

fn described(sum: &DVector<f64>, y: &[f64], free: &[usize], catalogue: &Catalogue) -> ConservedSum {
    let parts: Vec<(f64, &Element)> =
        sum.iter().zip(free).filter(|(x, _)| **x != 0.0).filter_map(|(&x, &at)| Some((x, all(catalogue).find(|e| e.at == at)?))).collect();
    let unit = parts.first().map(|p| p.1.unit.clone()).filter(|unit| parts.iter().all(|p| p.1.unit == *unit));
    ConservedSum {
        value: parts.iter().map(|(x, e)| x * y[e.at]).sum(),
        terms: parts.iter().map(|(x, e)| (*x, e.name.clone())).collect(),
        unit,
    }
}
