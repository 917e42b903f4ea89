//! The tries at one block of a start.

use nalgebra::{DMatrix, DVector};

use super::blocks::Block;
use super::problem::Problem;
use super::trail::{Trail, Tried};
use crate::interrupt::Pace;
use crate::newton::{Equations, Try, newton};
use crate::solver::linear::Factorisation;
use crate::solver::{Bounds, LinearSolver, Pattern};

/// Other guesses that are tried.
const GUESSES: u64 = 8;
/// Intervals between the bounds in which a change of sign is looked for, and halvings.
const GRID: u32 = 64;
const HALVINGS: u32 = 40;
/// First and smallest step of the homotopy.
const FIRST_STEP: f64 = 0.1;
const SMALLEST_STEP: f64 = 1e-4;
/// Iterations of the least squares, and unknowns up to which they are tried.
const SQUARES: u32 = 200;
const MOST_SQUARES: usize = 300;

/// The end of all tries.
pub(super) enum SearchEnd {
    Solved,
    Interrupted,
    Failed(Trail),
}

/// A block with working memory.
pub(super) struct Search<'s, 'p> {
    problem: &'s mut Problem<'p>,
    block: &'s Block,
    pace: &'s mut Pace,
    interrupted: bool,
    /// Places of the unknowns in `y`.
    places: Vec<usize>,
    /// Row and column within the block of each entry of the problem's Jacobian, its place in
    /// `values`.
    row_of: Vec<Option<usize>>,
    column_of: Vec<Option<usize>>,
    factorisation: Option<(Factorisation, Pattern)>,
    values: Vec<f64>,
    /// Part of the equations at the guess that the homotopy has not removed yet.
    offset: Vec<f64>,
    out: Vec<f64>,
}

impl<'s, 'p> Search<'s, 'p> {
    pub(super) fn new(problem: &'s mut Problem<'p>, block: &'s Block, pace: &'s mut Pace) -> Self {
        let n = block.rows.len();
        let number = |list: &[usize], all: usize| {
            let mut out = vec![None; all];
            list.iter().enumerate().for_each(|(i, &at)| out[at] = Some(i));
            out
        };
        Self {
            places: block.unknowns.iter().map(|&u| problem.places[u]).collect(),
            row_of: number(&block.rows, problem.len()),
            column_of: number(&block.unknowns, problem.len()),
            factorisation: None,
            values: Vec::new(),
            offset: vec![0.0; n],
            out: vec![0.0; n],
            interrupted: false,
            problem,
            block,
            pace,
        }
    }

    /// Newton's method from the guess in `y`, once; whether it found a solution inside of the
    /// bounds.
    pub(super) fn guessed(&mut self, y: &mut [f64]) -> bool {
        matches!(newton(self, None, y), Ok(Try::Converged(_))) && self.problem.bounds.outside(&self.places, y).is_none()
    }

    /// Solves the block from the guess in `y`; leaves the nearest point where that fails.
    pub(super) fn run(&mut self, y: &mut [f64]) -> SearchEnd {
        let guess = y.to_vec();
        let mut trail = Trail::default();
        self.evaluate(&guess);
        trail.not_finite = self.out.iter().any(|x| !x.is_finite());
        let bounds = self.problem.bounds.clone();
        let bounded = self.places.iter().any(|&at| bounds.low[at].is_finite() || bounds.high[at].is_finite());
        if self.attempt("Newton's method from the guess", None, y, &mut trail) {
            return SearchEnd::Solved;
        }
        if bounded {
            y.copy_from_slice(&guess);
            bounds.clip(&self.places, y);
            if self.attempt("Newton's method inside of the bounds", Some(&bounds), y, &mut trail) {
                return SearchEnd::Solved;
            }
        }
        if bounded && self.places.len() == 1 {
            y.copy_from_slice(&guess);
            if self.bracket(&bounds, y) && self.attempt("bisection, then Newton's method", None, y, &mut trail) {
                return SearchEnd::Solved;
            }
        }
        for number in 0..GUESSES {
            y.copy_from_slice(&guess);
            bounds.other_guess(number, &self.places, y);
            let name = format!("another guess, {}", number + 1);
            if self.attempt(&name, bounded.then_some(&bounds), y, &mut trail) {
                return SearchEnd::Solved;
            }
        }
        y.copy_from_slice(&guess);
        if self.homotopy(y, &mut trail) {
            return SearchEnd::Solved;
        }
        y.copy_from_slice(&guess);
        self.least_squares(&bounds, y);
        if self.attempt("least squares, then Newton's method", None, y, &mut trail) {
            return SearchEnd::Solved;
        }
        if self.interrupted {
            return SearchEnd::Interrupted;
        }
        y.copy_from_slice(trail.nearest.as_ref().map_or(&guess, |nearest| &nearest.1));
        SearchEnd::Failed(trail)
    }

    /// One try of Newton's method from `y`; whether it found a solution inside of the bounds.
    fn attempt(&mut self, name: &str, bounds: Option<&Bounds>, y: &mut [f64], trail: &mut Trail) -> bool {
        if self.interrupted {
            return false;
        }
        let (iterations, converged) = match newton(self, bounds, y) {
            Ok(Try::Converged(iterations)) => (iterations, true),
            Ok(Try::Failed(iterations)) => (iterations, false),
            Err(column) => {
                if trail.tried.is_empty() {
                    trail.singular = column.map(|c| self.places[c]);
                }
                (0, false)
            }
        };
        self.note(name, (iterations, converged), y, trail)
    }

    /// Notes where a try ended; whether that is a solution inside of the bounds.
    fn note(&mut self, name: &str, (iterations, converged): (u32, bool), y: &[f64], trail: &mut Trail) -> bool {
        self.evaluate(y);
        let residual = self.out.iter().fold(0.0, |most: f64, x| if x.is_nan() { f64::NAN } else { most.max(x.abs()) });
        let outside = self.problem.bounds.outside(&self.places, y);
        if converged && outside.is_none() {
            return true;
        }
        if converged {
            trail.outside.push(y.to_vec());
        }
        if residual.is_finite() && !converged && trail.nearest.as_ref().is_none_or(|nearest| residual < nearest.0) {
            trail.nearest = Some((residual, y.to_vec()));
        }
        let stopped = outside.filter(|_| converged).or_else(|| self.at_bound(y));
        trail.tried.push(Tried { way: name.to_owned(), iterations, residual, solved: converged, at_bound: stopped });
        false
    }

    /// Moves the only unknown to the change of sign of its equation that is nearest to its guess,
    /// found on a grid between its bounds and halved. Returns whether there is one.
    fn bracket(&mut self, bounds: &Bounds, y: &mut [f64]) -> bool {
        let at = self.places[0];
        let (low, high, guess) = (bounds.low[at], bounds.high[at], y[at]);
        if !(low.is_finite() && high.is_finite()) {
            return false;
        }
        let mut value = |search: &mut Self, x: f64| {
            y[at] = x;
            search.evaluate(y);
            search.out[0]
        };
        let points: Vec<(f64, f64)> = (0..=GRID)
            .map(|i| {
                let x = low + (high - low) * f64::from(i) / f64::from(GRID);
                (x, value(self, x))
            })
            .collect();
        let changes = points.windows(2).filter(|pair| pair[0].1 * pair[1].1 <= 0.0);
        let distance = |pair: &&[(f64, f64)]| (pair[0].0 - guess).max(guess - pair[1].0).max(0.0);
        let Some(nearest) = changes.min_by(|a, b| distance(a).total_cmp(&distance(b))) else {
            y[at] = guess;
            return false;
        };
        let ((mut a, fa), (mut b, _)) = (nearest[0], nearest[1]);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (a + b);
            if value(self, middle) * fa > 0.0 { a = middle } else { b = middle }
        }
        y[at] = 0.5 * (a + b);
        true
    }

    /// The unknown that has come to one of its bounds.
    fn at_bound(&self, y: &[f64]) -> Option<usize> {
        let bounds = &self.problem.bounds;
        let room = |at: usize| (y[at] - bounds.low[at]).min(bounds.high[at] - y[at]);
        let width = |at: usize| {
            let width = bounds.high[at] - bounds.low[at];
            if width.is_finite() { width } else { self.problem.scales[at].max(y[at].abs()) }
        };
        self.places.iter().copied().find(|&at| room(at) <= 1e-3 * width(at))
    }

    /// Newton homotopy: the equations less a part of what they are at the guess, which goes from
    /// one to zero.
    fn homotopy(&mut self, y: &mut [f64], trail: &mut Trail) -> bool {
        self.evaluate(y);
        let first = self.out.clone();
        if first.iter().any(|x| !x.is_finite()) || self.interrupted {
            return false;
        }
        let (mut part, mut step, mut iterations) = (1.0, FIRST_STEP, 0);
        let mut last = y.to_vec();
        while part > 0.0 && step >= SMALLEST_STEP && !self.interrupted {
            let next = (part - step).max(0.0);
            self.offset.iter_mut().zip(&first).for_each(|(offset, x)| *offset = next * x);
            let tried = newton(self, None, y);
            if let Ok(Try::Converged(count) | Try::Failed(count)) = tried {
                iterations += count;
            }
            if matches!(tried, Ok(Try::Converged(_))) {
                last.copy_from_slice(y);
                part = next;
                step *= 2.0;
            } else {
                y.copy_from_slice(&last);
                step *= 0.5;
            }
        }
        self.offset.fill(0.0);
        let name = if part == 0.0 { "homotopy".to_owned() } else { format!("homotopy, which stopped at {:.0} %", 100.0 * (1.0 - part)) };
        self.note(&name, (iterations, part == 0.0), y, trail)
    }

    /// Levenberg's and Marquardt's method on scaled rows and columns.
    fn least_squares(&mut self, bounds: &Bounds, y: &mut [f64]) {
        let n = self.places.len();
        if n > MOST_SQUARES {
            return;
        }
        bounds.clip(&self.places, y);
        let mut damping = 1e-3;
        let mut trial = y.to_vec();
        for _ in 0..SQUARES {
            self.interrupted |= self.pace.stops();
            if self.interrupted {
                return;
            }
            let Some((jacobian, rows)) = self.scaled(y) else { return };
            let normal = jacobian.transpose() * &jacobian;
            let right = -(jacobian.transpose() * &rows);
            let size = rows.norm_squared();
            let mut accepted = false;
            while damping < 1e12 {
                let matrix = &normal + DMatrix::identity(n, n) * damping;
                let Some(step) = matrix.lu().solve(&right) else { return };
                trial.copy_from_slice(y);
                self.places.iter().zip(step.iter()).for_each(|(&at, d)| trial[at] += d * self.problem.scales[at]);
                bounds.clip(&self.places, &mut trial);
                let weights = self.row_weights(y);
                self.evaluate(&trial);
                let next: f64 = self.out.iter().zip(&weights).map(|(x, w)| (x * w).powi(2)).sum();
                if next < size {
                    accepted = (size - next) > 1e-12 * size;
                    y.copy_from_slice(&trial);
                    damping = (damping * 0.3).max(1e-12);
                    break;
                }
                damping *= 4.0;
            }
            if !accepted {
                return;
            }
        }
    }

    /// The Jacobian and the equations, columns by scales and rows by their largest entries; `None`
    /// where one is not finite.
    fn scaled(&mut self, y: &[f64]) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let n = self.places.len();
        let weights = self.row_weights(y);
        let mut jacobian = DMatrix::zeros(n, n);
        for (row, column, value) in self.entries(y) {
            jacobian[(row, column)] += value * self.problem.scales[self.places[column]] * weights[row];
        }
        self.evaluate(y);
        let rows = DVector::from_iterator(n, self.out.iter().zip(&weights).map(|(x, w)| x * w));
        jacobian.iter().chain(rows.iter()).all(|x| x.is_finite()).then_some((jacobian, rows))
    }

    /// One over the largest scaled entry of each row.
    fn row_weights(&mut self, y: &[f64]) -> Vec<f64> {
        let mut sizes = vec![0.0_f64; self.places.len()];
        for (row, column, value) in self.entries(y) {
            sizes[row] = sizes[row].max((value * self.problem.scales[self.places[column]]).abs());
        }
        sizes.into_iter().map(|size| if size > 0.0 && size.is_finite() { 1.0 / size } else { 1.0 }).collect()
    }

    /// Entries of the block's Jacobian.
    fn entries(&mut self, y: &[f64]) -> Vec<(usize, usize, f64)> {
        let all = self.problem.jacobian(y).into_iter();
        all.filter_map(|(row, column, value)| Some((self.row_of[row]?, self.column_of[column]?, value))).collect()
    }

    /// The factorisation for a list of entries, made when first needed, and the place of each entry
    /// in its values.
    fn place(&mut self, entries: &[(usize, usize, f64)]) -> Option<()> {
        let n = self.places.len();
        if self.factorisation.is_none() {
            let mut columns = vec![Vec::new(); n];
            entries.iter().for_each(|&(row, column, _)| columns[column].push(row));
            let (mut starts, mut rows) = (vec![0], Vec::new());
            for column in &mut columns {
                column.sort_unstable();
                column.dedup();
                rows.extend_from_slice(column);
                starts.push(rows.len());
            }
            let pattern = Pattern::new(starts, rows).ok()?;
            self.values = vec![0.0; pattern.entries()];
            self.factorisation = Some((Factorisation::new(&pattern, LinearSolver::Auto).ok()?, pattern));
        }
        let (_, pattern) = self.factorisation.as_ref()?;
        self.values.fill(0.0);
        for &(row, column, value) in entries {
            let entry = pattern.column(column).find(|&entry| pattern.rows()[entry] == row)?;
            self.values[entry] += value;
        }
        Some(())
    }
}

impl Equations for Search<'_, '_> {
    fn places(&self) -> &[usize] {
        &self.places
    }

    fn evaluate(&mut self, y: &[f64]) {
        self.problem.evaluate(y);
        for ((out, &row), offset) in self.out.iter_mut().zip(&self.block.rows).zip(&self.offset) {
            *out = self.problem.out[row] - offset;
        }
    }

    fn factorise(&mut self, y: &[f64]) -> Result<(), Option<usize>> {
        self.interrupted |= self.pace.stops();
        let entries = self.entries(y);
        if self.interrupted || entries.iter().any(|e| !e.2.is_finite()) {
            return Err(None);
        }
        self.place(&entries).ok_or(None)?;
        let (factorisation, _) = self.factorisation.as_mut().ok_or(None)?;
        factorisation.factorise(&self.values).map_err(|singular| singular.column)
    }

    fn correction(&mut self, out: &mut [f64]) {
        out.iter_mut().zip(&self.out).for_each(|(value, x)| *value = -x);
        if let Some((factorisation, _)) = &mut self.factorisation {
            factorisation.solve(out);
        }
    }

    fn norm(&self, step: &[f64]) -> f64 {
        let relative = step.iter().zip(&self.places).map(|(d, &at)| (d / self.problem.scales[at]).abs());
        relative.fold(0.0, |norm, x| if x.is_nan() || x > norm { x } else { norm })
    }
}
