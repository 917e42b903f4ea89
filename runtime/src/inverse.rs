//! Solutions with matrices that are stored in full but are mostly zero, as those of linearised
//! processes.

use nalgebra::DMatrix;

use crate::solver::linear::Factorisation;
use crate::solver::{LinearSolver, Pattern};

/// Dimension up to which a full factorisation is as good.
const SMALL: usize = 8;

/// A factorised matrix.
pub(crate) struct Inverse(Factorisation);

impl Inverse {
    /// Factorises a matrix with partial pivoting; `None` if it is singular.
    pub(crate) fn new(a: &DMatrix<f64>) -> Option<Self> {
        let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        for column in a.column_iter() {
            for (row, &value) in column.iter().enumerate().filter(|(_, value)| **value != 0.0) {
                rows.push(row);
                values.push(value);
            }
            starts.push(rows.len());
        }
        let choice = if a.nrows() <= SMALL { LinearSolver::Dense } else { LinearSolver::Klu };
        let mut factorisation = Factorisation::new(&Pattern::new(starts, rows).ok()?, choice).ok()?;
        factorisation.factorise(&values).ok()?;
        Some(Self(factorisation))
    }

    /// Replaces a right-hand side by the solution.
    pub(crate) fn solve(&mut self, b: &mut [f64]) {
        self.0.solve(b);
    }

    /// The solutions for all columns.
    pub(crate) fn solve_all(&mut self, mut right: DMatrix<f64>) -> DMatrix<f64> {
        let rows = right.nrows();
        if rows > 0 {
            right.as_mut_slice().chunks_exact_mut(rows).for_each(|column| self.solve(column));
        }
        right
    }
}
