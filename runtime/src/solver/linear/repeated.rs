//! One matrix for many columns: derivatives along directions follow the equations of the unknowns that they belong to.

use super::super::{LinearSolver, Pattern, SolveError};
use super::{Factorisation, Singular};

/// The factors of the leading block, for the leading right-hand side and for a matrix of others, row after row.
pub(crate) struct Repeated {
    leading: Factorisation,
    n: usize,
    entries: usize,
    width: usize,
    /// A column of the matrix, where the solver takes one at a time.
    column: Box<[f64]>,
    space: Vec<f64>,
}

impl Repeated {
    /// For the pattern of the whole: `width` columns beside the leading one.
    pub fn new(whole: &Pattern, width: usize, choice: LinearSolver) -> Result<Self, SolveError> {
        let n = whole.dimension() / (width + 1);
        let entries = whole.column_starts()[n];
        let leading = Pattern::new(whole.column_starts()[..=n].to_vec(), whole.rows()[..entries].to_vec())?;
        let leading = Factorisation::new(&leading, choice)?;
        Ok(Self { leading, n, entries, width, column: vec![0.0; n].into(), space: Vec::new() })
    }

    /// The solver of the leading block.
    pub fn leading(&self) -> &Factorisation {
        &self.leading
    }

    pub(crate) fn factorise(&mut self, values: &[f64]) -> Result<(), Singular> {
        self.leading.factorise(&values[..self.entries])
    }

    pub fn solve(&mut self, b: &mut [f64]) {
        let (n, width) = (self.n, self.width);
        let (first, many) = b.split_at_mut(n);
        self.leading.solve(first);
        if self.leading.solve_many(width, many, &mut self.space) {
            return;
        }
        for j in 0..width {
            self.column.iter_mut().zip(many[j..].iter().step_by(width)).for_each(|(to, from)| *to = *from);
            self.leading.solve(&mut self.column);
            many[j..].iter_mut().step_by(width).zip(&self.column).for_each(|(to, from)| *to = *from);
        }
    }

    pub fn forget(&mut self) {
        self.leading.forget();
    }
}

/// `row -= factor * other`, entry by entry.
#[inline(always)]
pub(super) fn subtract(row: &mut [f64], factor: f64, other: &[f64]) {
    row.iter_mut().zip(other).for_each(|(row, other)| *row -= factor * other);
}
