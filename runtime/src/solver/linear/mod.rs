//! Linear systems of the Newton iteration.

mod dense;
mod klu;
mod triangular;

pub(crate) use dense::Dense;
pub(crate) use klu::Klu;

use super::{LinearSolver, Pattern, SolveError};

/// Dimension up to which the dense factorisation is the faster one whatever the pattern.
const SMALL: usize = 8;

/// Dimension up to which it is the faster one for patterns at least half full.
const MEDIUM: usize = 48;

/// The linear solver that a system got.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// LU with partial pivoting of the full matrix.
    Dense,
    /// SuiteSparse's KLU.
    Klu,
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
    /// Sparse.
    Klu(Box<Klu>),
}

impl Factorisation {
    /// Space, and the symbolic analysis, for matrices of this pattern.
    pub fn new(pattern: &Pattern, choice: LinearSolver) -> Result<Self, SolveError> {
        let n = pattern.dimension();
        let full = pattern.entries() * 2 >= n * n;
        let dense = match choice {
            LinearSolver::Auto => n <= SMALL || (n <= MEDIUM && full),
            LinearSolver::Dense => true,
            LinearSolver::Klu => false,
        };
        Ok(if dense { Self::Dense(Dense::new(pattern)) } else { Self::Klu(Box::new(Klu::new(pattern)?)) })
    }

    /// Which it is.
    pub fn method(&self) -> Method {
        match self {
            Self::Dense(_) => Method::Dense,
            Self::Klu(_) => Method::Klu,
        }
    }

    /// Factorises the matrix with these entries, in the pattern's order.
    pub fn factorise(&mut self, values: &[f64]) -> Result<(), Singular> {
        match self {
            Self::Dense(dense) => dense.factorise(values),
            Self::Klu(klu) => klu.factorise(values),
        }
    }

    /// Replaces the right-hand side by the solution.
    pub fn solve(&mut self, b: &mut [f64]) {
        match self {
            Self::Dense(dense) => dense.solve(b),
            Self::Klu(klu) => klu.solve(b),
        }
    }

    /// Forgets the pivots of earlier factorisations.
    pub fn forget(&mut self) {
        if let Self::Klu(klu) = self {
            klu.forget();
        }
    }
}
