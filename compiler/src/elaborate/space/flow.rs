//! Direction of the terms of a flux.

use crate::elaborate::lower::Lowering;
use crate::elaborate::space::marks::{self, Term};
use crate::ir::{Compare, Expr as Node, ExprId, UnaryFn};

/// Source of a face value.
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

/// From below where a number is not negative.
pub(in crate::elaborate::space) fn forward(l: &mut Lowering<'_, '_>, sign: ExprId) -> Direction {
    let range = marks::reading(l).interval(sign);
    if range.is_not_negative() {
        return Direction::Below;
    }
    if range.is_not_positive() {
        return Direction::Above;
    }
    let zero = l.exprs.constant(0.0);
    Direction::When(match l.exprs.node(sign) {
        Node::Unary(UnaryFn::Neg, a) => l.exprs.compare(Compare::Le, a, zero),
        _ => l.exprs.compare(Compare::Le, zero, sign),
    })
}
