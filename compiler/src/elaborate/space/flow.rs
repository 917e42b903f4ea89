//! Which way the terms of a flux flow.

use crate::elaborate::space::marks::Term;
use crate::ir::ExprId;

/// Where a face value comes from.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(in crate::elaborate::space) enum Direction {
    Below,
    Above,
    /// From below where this holds.
    When(ExprId),
    /// A velocity: the mean of both cells.
    Mean,
    /// By the mean slope of what depends on this face value alone.
    Slope,
}

/// Terms of a flux and the directions of its marks.
pub(in crate::elaborate::space) struct Flow {
    pub terms: Vec<Term>,
    /// Terms without a face value, as `-v*T_ref` of `v*(T[z] - T_ref)`.
    pub bare: Vec<Term>,
    pub directions: Vec<Direction>,
}
