//! Free unknowns of the equations at rest: null spaces of the Jacobian.
//!
//! A vector of the right null space is a direction along which the states may be moved at rest. A
//! vector of the left null space that is the same at every point is a sum whose rate no state
//! changes. It is conserved if that rate is zero; otherwise there is no steady state. A state
//! determines the rest if the Jacobian without its row and column is regular, which holds where
//! neither null space is zero in it.

use nalgebra::{DMatrix, DVector};

use smpl_compiler::compiled::{Derived, WithRespectTo};

use super::error::{ConservedSum, Drift, Freedom};
use super::problem::Problem;
use crate::catalogue::{Catalogue, Element};
use crate::system::CompiledSystem;

/// Singular values are not computed for more unknowns.
pub(super) const LARGE: usize = 500;
/// Singular value, of a matrix with rows of size 1, that counts as none.
const NONE: f64 = 1e-12;
/// Entry of a null vector, relative to the largest, that counts as none.
const SMALL: f64 = 1e-7;
/// A sum of terms, relative to their sizes, that counts as none; a part of the largest of several
/// numbers that does. A change within a step, relative to the values that it is one of.
const NO_SUM: f64 = 1e-9;
const NO_PART: f64 = 1e-12;
const NO_CHANGE: f64 = 1e-13;
/// Distances from the guess, relative to the scales, of the points at which the equations are
/// looked at.
const DISTANCES: [f64; 3] = [0.0, 0.013, 0.021];

/// The Jacobian and the rates at a point, rows scaled to size 1, columns by the scales of the
/// unknowns.
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

/// Free unknowns near `y`; `None` if all are determined or there are too many unknowns.
pub(super) fn freedom(problem: &mut Problem, system: &mut CompiledSystem, catalogue: &Catalogue, y: &[f64]) -> Option<Freedom> {
    if problem.free.is_empty() || problem.free.len() > LARGE || problem.has_actions() {
        return None;
    }
    let samples: Vec<Sample> = DISTANCES.iter().filter_map(|&d| sample(problem, system, y, d)).collect();
    // If the guess is an isolated singular point, the points around it are not.
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
    let unmoved = if explicit { unmoved(&null, &samples, at, (problem, system), y) } else { Vec::new() };
    let (mut sums, mut drifts, mut moved_by) = (Vec::new(), Vec::new(), Vec::<String>::new());
    for one in &unmoved {
        let sum = described(&one.factors, y, &problem.free, catalogue);
        let acting = catalogue.actions.elements().iter().filter(|e| one.by_actions[e.at] != 0.0).map(|e| &e.name);
        if one.rate != 0.0 {
            let new: Vec<String> = acting.filter(|name| !moved_by.contains(name)).cloned().collect();
            moved_by.extend(new);
            let unit = sum.unit.as_ref().map(|unit| per_time(unit, &system.model().interface().time.unit));
            drifts.push(Drift { terms: sum.terms, rate: one.rate, unit });
        } else if sum.terms.len() > 1 || acting.count() == 0 {
            // What an action moves, though not this one, is a state that integrates.
            sums.push(sum);
        }
    }
    Some(Freedom { states: chosen.iter().filter_map(name).collect(), sums, algebraics: Vec::new(), drifts, moved_by })
}

/// The unit of a rate.
fn per_time(unit: &str, time: &str) -> String {
    if time == "1" || time.is_empty() { unit.to_owned() } else { format!("{unit}/{time}") }
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

/// A sum of states whose rate no state changes.
struct Unmoved {
    /// By free unknown, zero for algebraic ones.
    factors: DVector<f64>,
    rate: f64,
    /// Derivatives of the rate by actions, at their places.
    by_actions: Vec<f64>,
}

/// Sums of states whose rates no state changes, in reduced echelon form.
fn unmoved(null: &Null, samples: &[Sample], at: usize, (problem, system): (&Problem, &mut CompiledSystem), y: &[f64]) -> Vec<Unmoved> {
    // Factors of the rows themselves.
    let mut rows = null.left.clone();
    for (i, mut row) in rows.row_iter_mut().enumerate() {
        row /= samples[at].sizes[i];
    }
    for mut column in rows.column_iter_mut() {
        let largest = column.amax();
        column.apply(|x| *x = if x.abs() < SMALL * largest { 0.0 } else { *x / largest });
    }
    let rows = same_everywhere(rows, samples);
    let (n, states) = (rows.nrows(), system.model().states());
    let rates = DMatrix::from_fn(n, 1, |i, _| samples[at].sizes[i] * samples[at].rates[i]);
    let by_actions = by_actions(problem, system, y);
    let mut whole = DMatrix::zeros(n + 1 + by_actions.ncols(), rows.ncols());
    whole.rows_mut(0, n).copy_from(&rows);
    for i in (0..n).filter(|&i| problem.free[i] >= states) {
        whole.row_mut(i).fill(0.0);
    }
    whole.rows_mut(n, 1).copy_from(&sum(&rates, &rows));
    whole.rows_mut(n + 1, by_actions.ncols()).copy_from(&sum(&by_actions, &rows));
    let largest: Vec<f64> = (n..whole.nrows()).map(|i| if whole.ncols() == 0 { 0.0 } else { whole.row(i).amax() }).collect();
    let step = system.model().interface().episode.step;
    let size = |factors: &DVector<f64>| -> f64 {
        factors.iter().zip(&problem.free).map(|(x, &at)| x.abs() * (problem.scales[at] + y[at].abs())).sum()
    };
    let one = |column: DVector<f64>| {
        let factors = column.rows(0, n).clone_owned();
        let part = |i: usize| if column[n + i].abs() <= NO_PART * largest[i] { 0.0 } else { column[n + i] };
        let rate = if part(0).abs() * step <= NO_CHANGE * size(&factors) { 0.0 } else { part(0) };
        Unmoved { factors, rate, by_actions: (1..largest.len()).map(part).collect() }
    };
    echelon(whole, n).into_iter().map(one).collect()
}

/// Combinations of the columns of `rows` under which the Jacobians of all samples vanish.
fn same_everywhere(mut rows: DMatrix<f64>, samples: &[Sample]) -> DMatrix<f64> {
    let raw: Vec<DMatrix<f64>> = samples
        .iter()
        .map(|sample| DMatrix::from_fn(rows.nrows(), rows.nrows(), |i, j| sample.sizes[i] * sample.jacobian[(i, j)]))
        .collect();
    while rows.ncols() > 0 {
        let sums = raw.iter().map(|raw| sum(raw, &rows)).max_by(|a, b| a.amax().total_cmp(&b.amax()));
        let Some(sums) = sums.filter(|sums| sums.amax() > 0.0) else { break };
        // What moves one of them is taken out of the others, with it.
        let (row, pivot) = sums.iamax_full();
        let column = rows.column(pivot) / sums[(row, pivot)];
        for j in (0..rows.ncols()).filter(|&j| j != pivot) {
            rows.column_mut(j).axpy(-sums[(row, j)], &column, 1.0);
        }
        rows = rows.remove_column(pivot);
    }
    rows
}

/// Sums of the rows of `terms` by each column of factors, a row for each column of `terms`; what
/// rounding leaves is zero.
fn sum(terms: &DMatrix<f64>, factors: &DMatrix<f64>) -> DMatrix<f64> {
    let sizes = terms.abs().transpose() * factors.abs();
    (terms.transpose() * factors).zip_map(&sizes, |sum, size| if sum.abs() <= NO_SUM * size { 0.0 } else { sum })
}

/// Derivatives of the free rows by actions; none where they are not known.
fn by_actions(problem: &Problem, system: &mut CompiledSystem, y: &[f64]) -> DMatrix<f64> {
    let zero = vec![0.0; y.len()];
    let (model, memory) = system.parts();
    let mut out = DMatrix::zeros(problem.free.len(), memory.region(smpl_compiler::layout::Region::Action).len());
    let triplets = model.derivative(Derived::Rows, WithRespectTo::Actions, memory, 0.0, (y, &zero)).unwrap_or_default();
    for (row, column, value) in triplets {
        if let (Some(place), false) = (problem.free.iter().position(|&at| at == row), problem.replaced().any(|at| at == row)) {
            out[(place, column)] += value;
        }
    }
    out
}

/// Columns in reduced echelon form of their first `pivots` rows, without those that are zero there.
fn echelon(mut columns: DMatrix<f64>, pivots: usize) -> Vec<DVector<f64>> {
    let mut done = 0;
    for row in 0..pivots {
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
    let neat = |i: usize, x: f64| match x {
        x if i >= pivots => x,
        x if x.abs() < SMALL => 0.0,
        x => rounded(x),
    };
    (0..done).map(|j| columns.column(j).map_with_location(|i, _, x| neat(i, x))).collect()
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
