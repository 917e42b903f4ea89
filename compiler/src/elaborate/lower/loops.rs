//! Cells and faces as numbers, and the loops around what is being elaborated.

use std::collections::BTreeSet;

use crate::elaborate::symbols::DomainId;
use crate::ir::{Affine, LoopVar};

/// The cells (or faces) of a domain, or the numbers of a range, that one piece of an equation
/// stands for: `first + step·l` for the passes `l < count` of a loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Cell {
    /// Number (from 0) in the first pass.
    pub first: i64,
    /// Number of passes.
    pub count: i64,
    /// The loop; `None` for a single cell.
    pub along: Option<LoopVar>,
    /// 1; -1 for numbers that a loop counts down, as `n - i` does. 1 for a single cell.
    pub step: i64,
}

impl Cell {
    /// One cell.
    pub(crate) fn single(number: i64) -> Self {
        Cell { first: number, count: 1, along: None, step: 1 }
    }

    /// Ascending numbers.
    pub(crate) fn run(first: i64, count: i64, along: LoopVar) -> Self {
        Cell { first, count, along: Some(along), step: 1 }
    }

    /// The number in the last pass.
    pub(crate) fn last(self) -> i64 {
        self.first + (self.count - 1) * self.step
    }

    /// The lowest and the highest number.
    pub(crate) fn ends(self) -> (i64, i64) {
        (self.first.min(self.last()), self.first.max(self.last()))
    }

    /// The cell `by` further on.
    pub(crate) fn shifted(self, by: i64) -> Self {
        Cell { first: self.first + by, ..self }
    }

    /// `n` minus each number.
    pub(crate) fn subtracted_from(self, n: i64) -> Self {
        Cell { first: n - self.first, step: if self.along.is_some() { -self.step } else { 1 }, ..self }
    }

    /// The first pass in which it is settled otherwise than in the first one whether the number is
    /// at least `turn`.
    pub(crate) fn turn(self, turn: i64) -> i64 {
        if self.step > 0 { turn - self.first } else { self.first - turn + 1 }
    }

    /// The number as an address.
    pub(crate) fn affine(self) -> Affine {
        match self.along {
            Some(v) => Affine::along(self.first, v, self.step),
            None => Affine::constant(self.first),
        }
    }
}

/// A face of a domain: face `k` lies below cell `k`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Face {
    /// The domain.
    pub domain: DomainId,
    /// Its number.
    pub at: Cell,
}

/// Something elaborated inside a nest of loops.
#[derive(Clone, Debug)]
pub(crate) struct Piece<T> {
    /// Extents of the loops, the outermost first.
    pub extents: Vec<u32>,
    /// Result.
    pub value: T,
}

/// A loop that is being elaborated.
#[derive(Debug)]
pub(crate) struct Loop {
    /// Number of passes.
    pub passes: i64,
    /// Passes before which the body asked for a cut.
    pub cuts: BTreeSet<i64>,
}

/// The loops around what is being elaborated.
#[derive(Debug, Default)]
pub(crate) struct Loops {
    /// By depth.
    pub frames: Vec<Loop>,
    /// Indices over ranges of numbers that only count cells, in the statement that is being
    /// elaborated.
    pub counted: Vec<(String, DomainId)>,
}
