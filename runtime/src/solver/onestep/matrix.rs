//! The matrix of a Rosenbrock step, factorised once and solved with many times.
//!
//! Up to eight unknowns it is inverted. Eight products with a matrix in registers take a third of
//! the time of eight substitutions, whose operations wait for each other. The error of the solution
//! is bounded alike (N. J. Higham, *Accuracy and Stability of Numerical Algorithms*, 2nd edition
//! (SIAM, 2002), section 14.1).

use super::super::linear::{Factorisation, Singular};
use super::super::{LinearSolver, Pattern, SolveError};
use super::numbers::{Quad, entries, entries_mut};

/// A matrix by compressed columns.
pub(super) enum Matrix {
    /// Up to eight unknowns.
    Small(Box<dyn Small>),
    /// As many as there are.
    General(Box<Factorisation>, usize),
}

impl Matrix {
    /// Space, and the symbolic analysis, for matrices of this pattern.
    ///
    /// # Errors
    /// What the linear solvers say of the pattern.
    pub(super) fn new(pattern: &Pattern, choice: LinearSolver) -> Result<Self, SolveError> {
        let n = pattern.dimension();
        let small: Option<Box<dyn Small>> = match n {
            _ if !matches!(choice, LinearSolver::Auto | LinearSolver::Dense) => None,
            1 => Some(Box::new(Inverse::<1, 1>::new(pattern))),
            2 => Some(Box::new(Inverse::<2, 1>::new(pattern))),
            3 => Some(Box::new(Inverse::<3, 1>::new(pattern))),
            4 => Some(Box::new(Inverse::<4, 1>::new(pattern))),
            5 => Some(Box::new(Inverse::<5, 2>::new(pattern))),
            6 => Some(Box::new(Inverse::<6, 2>::new(pattern))),
            7 => Some(Box::new(Inverse::<7, 2>::new(pattern))),
            8 => Some(Box::new(Inverse::<8, 2>::new(pattern))),
            _ => None,
        };
        match small {
            Some(small) => Ok(Self::Small(small)),
            None => Ok(Self::General(Box::new(Factorisation::new(pattern, choice)?), n)),
        }
    }

    /// Returns `true` if a factorisation takes no longer than what else there is to a step.
    pub(crate) fn is_cheap(&self) -> bool {
        match self {
            Self::Small(_) => true,
            Self::General(factorisation, _) => factorisation.is_cheap(),
        }
    }

    /// Factorises the matrix with these entries, in the pattern's order.
    #[inline]
    pub(crate) fn factorise(&mut self, values: &[f64]) -> Result<(), Singular> {
        match self {
            Self::Small(small) => small.factorise(values),
            Self::General(factorisation, _) => factorisation.factorise(values),
        }
    }

    /// Writes the solution for minus the right-hand side to `x`.
    #[inline]
    pub(crate) fn solve_negative(&mut self, b: &[Quad], x: &mut [Quad]) {
        match self {
            Self::Small(small) => small.solve_negative(b, x),
            Self::General(factorisation, n) => factorisation.solve_scaled(-1.0, entries(b, *n), entries_mut(x, *n)),
        }
    }

    /// Forgets the pivots of earlier factorisations.
    pub(super) fn forget(&mut self) {
        if let Self::General(factorisation, _) = self {
            factorisation.forget();
        }
    }
}

/// A matrix whose dimension is known to the compiler.
pub(super) trait Small: Send {
    /// Factorises the matrix with these entries, in the pattern's order.
    fn factorise(&mut self, values: &[f64]) -> Result<(), Singular>;

    /// Writes the solution for minus the right-hand side to `x`.
    fn solve_negative(&self, b: &[Quad], x: &mut [Quad]);
}

/// The inverse of a matrix of `N` columns in `B` fours each.
struct Inverse<const N: usize, const B: usize> {
    columns: [[Quad; B]; N],
    /// Place of each entry of the pattern: column, row.
    places: Box<[(u8, u8)]>,
    /// Row exchanged with row k in step k.
    pivots: [usize; N],
}

impl<const N: usize, const B: usize> Inverse<N, B> {
    fn new(pattern: &Pattern) -> Self {
        let rows = |column| pattern.rows()[pattern.column(column)].iter();
        let places = (0..N).flat_map(|column| rows(column).map(move |&row| (column as u8, row as u8))).collect();
        Self { columns: [[[0.0; 4]; B]; N], places, pivots: [0; N] }
    }

    /// Step k of the method of Gauss and Jordan with partial pivoting.
    #[inline(always)]
    fn eliminate(&mut self, k: usize) -> Result<(), Singular> {
        let column = self.columns[k].as_flattened();
        let mut pivot = k;
        for row in k + 1..N {
            if column[row].abs() > column[pivot].abs() {
                pivot = row;
            }
        }
        let inverse = 1.0 / column[pivot];
        if !inverse.is_finite() {
            return Err(Singular { column: Some(k) });
        }
        self.pivots[k] = pivot;
        if pivot != k {
            self.columns.iter_mut().for_each(|column| column.as_flattened_mut().swap(k, pivot));
        }
        let mut this = self.columns[k];
        this.as_flattened_mut()[k] = 0.0;
        for (j, other) in self.columns.iter_mut().enumerate() {
            let factor = other.as_flattened()[k] * inverse;
            if j != k {
                other.as_flattened_mut()[k] = 0.0;
                let pairs = other.as_flattened_mut().iter_mut().zip(this.as_flattened());
                pairs.for_each(|(other, this)| *other -= factor * this);
                other.as_flattened_mut()[k] = factor;
            }
        }
        self.columns[k] = this.map(|quad| quad.map(|x| -(x * inverse)));
        self.columns[k].as_flattened_mut()[k] = inverse;
        Ok(())
    }
}

impl<const N: usize, const B: usize> Small for Inverse<N, B> {
    fn factorise(&mut self, values: &[f64]) -> Result<(), Singular> {
        self.columns = [[[0.0; 4]; B]; N];
        for (&(column, row), &value) in self.places.iter().zip(values) {
            self.columns[usize::from(column)].as_flattened_mut()[usize::from(row)] = value;
        }
        for k in 0..N {
            self.eliminate(k)?;
        }
        // Rows were exchanged: columns of the inverse go back, last first.
        for k in (0..N).rev() {
            if self.pivots[k] != k {
                self.columns.swap(k, self.pivots[k]);
            }
        }
        Ok(())
    }

    fn solve_negative(&self, b: &[Quad], x: &mut [Quad]) {
        let mut sums = [[0.0; 4]; B];
        for (column, &b) in self.columns.iter().zip(b.as_flattened()) {
            let pairs = sums.as_flattened_mut().iter_mut().zip(column.as_flattened());
            pairs.for_each(|(sum, entry)| *sum -= entry * b);
        }
        x[..B].copy_from_slice(&sums);
    }
}

#[cfg(test)]
mod tests {
    use super::super::numbers;
    use super::*;

    /// Solutions that are known, with matrices whose rows have to be exchanged.
    #[test]
    fn solutions_are_right_for_all_small_dimensions() {
        for n in 1..=9 {
            let pattern = Pattern::full(n);
            let values: Vec<f64> = (0..n * n).map(|at| if at % (n + 1) == 0 { 1e-9 } else { ((7 * at + 3) as f64).sin() }).collect();
            let expected: Vec<f64> = (0..n).map(|i| (i as f64).cos()).collect();
            let product = |row: usize| -(0..n).map(|column| values[column * n + row] * expected[column]).sum::<f64>();
            let b = numbers::from((0..n).map(product), n, 0.0);
            let mut x = numbers::zeros(n);
            let mut matrix = Matrix::new(&pattern, LinearSolver::Auto).expect("a matrix");
            matrix.factorise(&values).expect("not singular");
            matrix.solve_negative(&b, &mut x);
            for (i, (x, expected)) in x.as_flattened().iter().zip(&expected).enumerate() {
                assert!((x - expected).abs() < 1e-7, "{n}: unknown {i} is {x} in place of {expected}");
            }
        }
    }

    #[test]
    fn a_singular_matrix_is_refused() {
        let mut matrix = Matrix::new(&Pattern::full(2), LinearSolver::Auto).expect("a matrix");
        assert_eq!(matrix.factorise(&[1.0, 2.0, 2.0, 4.0]), Err(Singular { column: Some(1) }));
    }
}
