//! Linear systems of the Newton iteration.

mod block;
pub(crate) mod columns;
mod dense;
mod klu;
mod substitution;

pub(crate) use block::Block;
pub(crate) use dense::Dense;
pub(crate) use klu::Klu;

use std::fmt::{self, Display, Formatter};

use super::{LinearSolver, Pattern, SolveError};

/// Dimension up to which the dense factorisation is the faster one whatever the pattern.
const SMALL: usize = 3;

/// Dimension up to which it is the faster one for patterns at least half full.
const MEDIUM: usize = 48;

/// Products of a factorisation for each of a substitution up to which it is called cheap: their
/// operands are anywhere, and eight substitutions take as long.
const CHEAP: usize = 2;

/// The linear solver that a system got.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// LU with partial pivoting of the full matrix.
    Dense,
    /// Sparse LU of the diagonal blocks of the block triangular form, its pivots on the diagonal
    /// where they serve.
    Block,
    /// SuiteSparse's KLU, with partial pivoting.
    Klu,
}

impl Display for Method {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Dense => "dense LU",
            Self::Block => "sparse LU of diagonal blocks",
            Self::Klu => "KLU",
        })
    }
}

/// The linear solver that a matrix of this pattern gets.
///
/// # Errors
/// If the memory of a factorisation cannot be had.
pub fn method(pattern: &Pattern, choice: LinearSolver) -> Result<Method, SolveError> {
    Ok(Factorisation::new(pattern, choice)?.method())
}

/// The matrix has no factorisation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Singular {
    /// The column without a pivot, where known.
    pub column: Option<usize>,
}

/// A matrix by compressed columns, factorised again and again.
pub(crate) enum Factorisation {
    /// Dense.
    Dense(Dense),
    /// Sparse, pivots on the diagonal.
    Block(Box<Block>),
    /// Sparse, partial pivoting.
    Klu(Box<Klu>),
}

impl Factorisation {
    /// Space, and the symbolic analysis, for matrices of this pattern.
    pub(crate) fn new(pattern: &Pattern, choice: LinearSolver) -> Result<Self, SolveError> {
        let n = pattern.dimension();
        let full = pattern.entries() * 2 >= n * n;
        let method = match choice {
            LinearSolver::Auto if n <= SMALL || (n <= MEDIUM && full) => Method::Dense,
            // A list of the places of all products, which is what the sparse one works by, would be
            // that of n^3/3 of them.
            LinearSolver::Auto if full && Block::largest(pattern)? * 2 > n => Method::Dense,
            LinearSolver::Auto | LinearSolver::Block => Method::Block,
            LinearSolver::Dense => Method::Dense,
            LinearSolver::Klu => Method::Klu,
        };
        Ok(match method {
            Method::Dense => Self::Dense(Dense::new(pattern)),
            Method::Block => Self::Block(Box::new(Block::new(pattern)?)),
            Method::Klu => Self::Klu(Box::new(Klu::new(pattern)?)),
        })
    }

    /// Kind of solver.
    pub(crate) fn method(&self) -> Method {
        match self {
            Self::Dense(_) => Method::Dense,
            Self::Block(_) => Method::Block,
            Self::Klu(_) => Method::Klu,
        }
    }

    /// Returns `true` if a factorisation takes as little time as some substitutions.
    pub(crate) fn is_cheap(&self) -> bool {
        let Self::Block(block) = self else { return false };
        let (factorisation, substitution) = block.products();
        factorisation <= CHEAP * substitution
    }

    /// Factorises the matrix with these entries, in the pattern's order.
    pub(crate) fn factorise(&mut self, values: &[f64]) -> Result<(), Singular> {
        match self {
            Self::Dense(dense) => dense.factorise(values),
            Self::Block(block) => block.factorise(values),
            Self::Klu(klu) => klu.factorise(values),
        }
    }

    /// Writes the solution for `factor` times the right-hand side to `x`.
    pub(crate) fn solve_scaled(&mut self, factor: f64, b: &[f64], x: &mut [f64]) {
        if let Self::Block(block) = self
            && block.solve_scaled(factor, b, x)
        {
            return;
        }
        x.iter_mut().zip(b).for_each(|(x, b)| *x = factor * b);
        self.solve(x);
    }

    /// Replaces the right-hand side by the solution.
    pub(crate) fn solve(&mut self, b: &mut [f64]) {
        match self {
            Self::Dense(dense) => dense.solve(b),
            Self::Block(block) => block.solve(b),
            Self::Klu(klu) => klu.solve(b),
        }
    }

    /// Replaces many right-hand sides, a matrix of `width` columns, row after row, by their
    /// solutions. `space` is working memory.
    pub(crate) fn solve_many(&mut self, width: usize, b: &mut [f64], space: &mut Vec<f64>) {
        let done = match self {
            Self::Dense(dense) => {
                dense.solve_many(width, b);
                true
            }
            Self::Block(block) => block.solve_many(width, b, space),
            _ => false,
        };
        if done {
            return;
        }
        // Partial pivoting takes a column at a time.
        space.resize(b.len() / width, 0.0);
        for j in 0..width {
            space.iter_mut().zip(b[j..].iter().step_by(width)).for_each(|(to, from)| *to = *from);
            self.solve(space);
            b[j..].iter_mut().step_by(width).zip(&*space).for_each(|(to, from)| *to = *from);
        }
    }

    /// Forgets the pivots of earlier factorisations.
    pub(crate) fn forget(&mut self) {
        match self {
            Self::Dense(_) => {}
            Self::Block(block) => block.forget(),
            Self::Klu(klu) => klu.forget(),
        }
    }
}

/// `row -= factor * other`, entry by entry.
#[inline(always)]
fn subtract(row: &mut [f64], factor: f64, other: &[f64]) {
    row.iter_mut().zip(other).for_each(|(row, other)| *row -= factor * other);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An arrow with a cycle, its rows of very different size, so that rows are scaled and
    /// exchanged.
    fn system(n: usize, shift: f64) -> (Pattern, Vec<f64>) {
        let (mut starts, mut rows, mut values) = (vec![0], vec![], vec![]);
        for column in 0..n {
            for row in 0..n {
                if row == column || row == 0 || column == n - 1 || row == (column + 3) % n {
                    let size = 10f64.powi((row as i32 * 7) % 13 - 6);
                    let entry = (1.0 + (3 * row + 5 * column) as f64).sin();
                    let diagonal = f64::from(u8::from(row == column)) * shift;
                    rows.push(row);
                    values.push(size * (entry + diagonal));
                }
            }
            starts.push(rows.len());
        }
        (Pattern::new(starts, rows).expect("a pattern"), values)
    }

    #[test]
    fn many_right_hand_sides_are_solved_as_one_by_one() {
        for (n, width) in [(40, 5), (40, 8), (40, 19)] {
            many(n, width);
        }
    }

    fn many(n: usize, width: usize) {
        let (pattern, values) = system(n, 4.0);
        for choice in [LinearSolver::Block, LinearSolver::Dense, LinearSolver::Klu] {
            let mut factors = Factorisation::new(&pattern, choice).expect("a solver");
            factors.factorise(&values).expect("not singular");
            let b: Vec<f64> = (0..n * width).map(|i| (1.0 + i as f64).sin()).collect();
            let mut together = b.clone();
            factors.solve_many(width, &mut together, &mut Vec::new());
            for j in 0..width {
                let mut column: Vec<f64> = b[j..].iter().step_by(width).copied().collect();
                factors.solve(&mut column);
                let size = column.iter().fold(0.0, |size: f64, x| size.max(x.abs()));
                for (row, expected) in column.iter().enumerate() {
                    let got = together[row * width + j];
                    assert!((got - expected).abs() <= 1e-9 * size, "{choice:?}: {got} {expected}");
                }
            }
        }
    }

    /// Of a full matrix the sparse one would list the places of n^3/3 products; of a triangular
    /// one, as full by half, there are none.
    #[test]
    fn large_matrices_that_are_one_full_block_are_taken_as_dense() {
        let n = 60;
        let triangle = Pattern::new((0..=n).map(|c| c * n - c * (c.max(1) - 1) / 2).collect(), (0..n).flat_map(|c| c..n).collect());
        let method = |pattern: &Pattern| Factorisation::new(pattern, LinearSolver::Auto).expect("a solver").method();
        assert_eq!(method(&Pattern::full(n)), Method::Dense);
        assert_eq!(method(&triangle.expect("a pattern")), Method::Block);
    }

    #[test]
    fn factors_solve_rows_of_very_different_size() {
        let n = 40;
        let pattern = system(n, 0.0).0;
        for choice in [LinearSolver::Klu, LinearSolver::Block, LinearSolver::Dense] {
            let mut sparse = Factorisation::new(&pattern, choice).expect("a solver");
            // Pivots chosen anew, then kept.
            for shift in [0.0, 0.5, 4.0] {
                let values = system(n, shift).1;
                let solution: Vec<f64> = (0..n).map(|i| (i as f64).cos()).collect();
                let mut b = vec![0.0; n];
                for (column, x) in solution.iter().enumerate() {
                    for entry in pattern.column(column) {
                        b[pattern.rows()[entry]] += values[entry] * x;
                    }
                }
                sparse.factorise(&values).expect("not singular");
                sparse.solve(&mut b);
                for (got, expected) in b.iter().zip(&solution) {
                    assert!((got - expected).abs() < 1e-9, "{shift}: {got} {expected}");
                }
            }
        }
    }
}
