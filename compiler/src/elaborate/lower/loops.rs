//! Cells and faces as numbers, and the loops around what is being elaborated.

use std::collections::BTreeSet;

use crate::elaborate::symbols::DomainId;
use crate::ir::{Affine, LoopVar};

/// The cells (or faces) of a domain that one piece of an equation stands for: `first + l` for the passes `l < count` of a loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Cell {
    /// Number (from 0) in the first pass.
    pub first: i64,
    /// Number of passes.
    pub count: i64,
    /// The loop; `None` for a single cell.
    pub along: Option<LoopVar>,
}

impl Cell {
    /// One cell.
    pub fn single(number: i64) -> Self {
        Cell { first: number, count: 1, along: None }
    }

    /// The number in the last pass.
    pub fn last(self) -> i64 {
        self.first + self.count - 1
    }

    /// The cell `by` further on.
    pub fn shifted(self, by: i64) -> Self {
        Cell { first: self.first + by, ..self }
    }

    /// The number as an address.
    pub(crate) fn affine(self) -> Affine {
        match self.along {
            Some(v) => Affine::along(self.first, v, 1),
            None => Affine::constant(self.first),
        }
    }
}

/// A face of a domain: face `k` lies below cell `k`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Face {
    /// The domain.
    pub domain: DomainId,
    /// Its number.
    pub at: Cell,
}

/// A loop that is being elaborated.
#[derive(Debug)]
pub struct Loop {
    /// Number of passes.
    pub passes: i64,
    /// Passes before which the body asked for a cut.
    pub cuts: BTreeSet<i64>,
}

/// The loops around what is being elaborated.
#[derive(Debug, Default)]
pub struct Loops {
    /// By depth.
    pub frames: Vec<Loop>,
    /// Indices over ranges of numbers that only count cells, in the statement that is being elaborated.
    pub counted: Vec<(String, DomainId)>,
}
