//! Choice of the states that conditions at the start determine, by numbers: those that move a
//! condition most, each in its own size, while algebraic unknowns follow their equations.

use nalgebra::DMatrix;

use super::problem::Problem;
use crate::catalogue::Element;

/// Unknowns up to which the derivatives are computed: they need a full matrix.
pub(super) const MOST: usize = 400;

/// Part of the largest derivative of a condition above which all states count as equal.
const ALIKE: f64 = 0.1;

/// Part of the largest derivative of a condition that counts as zero.
const ZERO: f64 = 1e-9;

/// Part of its scale below which a value says nothing of the size of a state.
const SMALL: f64 = 1e-6;

/// Newton steps of the algebraic unknowns.
const STEPS: usize = 8;

/// Moves the algebraic unknowns towards their equations, and returns the derivatives of the
/// conditions by the states, each times the size of the state. Returns `None` where the equations
/// do not determine the unknowns.
pub(super) fn slopes(problem: &mut Problem<'_>, algebraic: usize, y: &mut [f64]) -> Option<DMatrix<f64>> {
    let n = problem.len();
    let mut full = full_matrix(problem, y);
    // Without algebraic unknowns there is nothing to solve.
    for _ in 0..if algebraic > 0 { STEPS } else { 0 } {
        problem.evaluate(y);
        let right = DMatrix::from_fn(algebraic, 1, |i, _| problem.out[i]);
        let step = full.view((0, 0), (algebraic, algebraic)).into_owned().lu().solve(&right)?;
        if step.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let places = problem.places[..algebraic].iter();
        places.zip(step.iter()).for_each(|(&at, step)| y[at] -= step);
        full = full_matrix(problem, y);
    }
    let free = n - algebraic;
    let part = |(row, column), size| full.view((row, column), size).into_owned();
    let mut slopes = part((algebraic, algebraic), (free, free));
    if algebraic > 0 {
        let follow = part((0, 0), (algebraic, algebraic)).lu().solve(&part((0, algebraic), (algebraic, free)))?;
        slopes -= part((algebraic, 0), (free, algebraic)) * follow;
    }
    for (j, &at) in problem.places[algebraic..].iter().enumerate() {
        let scale = problem.scales[at];
        let size = if y[at].abs() < SMALL * scale { scale } else { y[at].abs() };
        slopes.column_mut(j).scale_mut(size);
    }
    slopes.iter().all(|x| x.is_finite()).then_some(slopes)
}

fn full_matrix(problem: &mut Problem<'_>, y: &[f64]) -> DMatrix<f64> {
    let n = problem.len();
    let mut full = DMatrix::zeros(n, n);
    for (row, column, value) in problem.jacobian(y) {
        full[(row, column)] += value;
    }
    full
}

/// A condition: the states that it names, and whether it determines no other.
pub(super) struct Wish<'a> {
    pub free: &'a [String],
    pub only: bool,
}

/// A column for each row, by elimination row by row; `None` if a row is left without one. States
/// whose derivatives are alike are taken in their order.
pub(super) fn choose(mut slopes: DMatrix<f64>, wishes: &[Wish<'_>], states: &[&Element]) -> Option<Vec<usize>> {
    let largest: Vec<f64> = wishes.iter().enumerate().map(|(row, _)| slopes.row(row).amax()).collect();
    let mut chosen: Vec<usize> = Vec::with_capacity(wishes.len());
    for (row, wish) in wishes.iter().enumerate() {
        let best = |named: bool| {
            let fits = |j: &usize| !named || wish.free.contains(&states[*j].name);
            let open: Vec<usize> = (0..states.len()).filter(|j| !chosen.contains(j)).filter(fits).collect();
            let most = open.iter().map(|&j| slopes[(row, j)].abs()).fold(0.0, f64::max);
            let alike = |j: &usize| slopes[(row, *j)].abs() >= ALIKE * most;
            open.into_iter().find(alike).filter(|_| most > ZERO * largest[row])
        };
        let named = (!wish.free.is_empty()).then(|| best(true)).flatten();
        let column = named.or_else(|| if wish.only { None } else { best(false) })?;
        chosen.push(column);
        for below in row + 1..wishes.len() {
            let factor = slopes[(below, column)] / slopes[(row, column)];
            let part = slopes.row(row) * factor;
            let mut rest = slopes.row_mut(below);
            rest -= part;
            rest[column] = 0.0;
        }
    }
    Some(chosen)
}
