//! A flux as a sum of terms: products of factors without marks and of a rest with marks.

use crate::elaborate::lower::Lowering;
use crate::elaborate::space::interval::Interval;
use crate::elaborate::space::marks;
use crate::elaborate::space::marks::{Marks, Term};
use crate::ir::{BinaryFn, Expr as Node, ExprId, FastMap, ReduceFn, UnaryFn};
/// The terms of a flux that have marks, and those that have none.
pub(in crate::elaborate::space) fn flux_terms(l: &mut Lowering<'_, '_>, root: ExprId) -> (Vec<Term>, Vec<Term>) {
    let mut done = FastMap::default();
    let marks = marks::reading(l).marks(root, &mut done);
    let (mut terms, mut bare) = (Vec::new(), Vec::new());
    let mut brackets = 0;
    let mut stack = vec![Term { factors: Vec::new(), rest: root, marks, bracket: None, sums: Vec::new() }];
    while let Some(term) = stack.pop() {
        let of = |e: ExprId| done.get(&e).copied().unwrap_or(Marks::None);
        let has = |e: ExprId| of(e) != Marks::None;
        let inside = |e: ExprId| Term { rest: e, marks: of(e), ..term.clone() };
        match l.exprs.node(term.rest) {
            _ if term.marks == Marks::None => bare.push(term),
            Node::Binary(f @ (BinaryFn::Add | BinaryFn::Sub), a, b) => {
                let opened = term.bracket.is_none() && has(a) && has(b) && term.factors.iter().any(|&(x, _)| l.exprs.as_const(x).is_none());
                brackets += usize::from(opened);
                let bracket = if opened { Some((brackets, Interval::of(1.0))) } else { term.bracket };
                let (a, b) = (Term { bracket, ..inside(a) }, Term { bracket, ..inside(b) });
                stack.push(a);
                stack.push(if f == BinaryFn::Sub { with_factor(l, b, -1.0) } else { b });
            }
            Node::Unary(UnaryFn::Neg, a) => {
                let a = inside(a);
                stack.push(with_factor(l, a, -1.0));
            }
            Node::Binary(BinaryFn::Mul, a, b) if !(has(a) && has(b)) => {
                let (factor, rest) = if has(a) { (b, a) } else { (a, b) };
                stack.push(marks::reading(l).times(inside(rest), factor, false));
            }
            Node::Binary(BinaryFn::Div, a, b) if !has(b) => stack.push(marks::reading(l).times(inside(a), b, true)),
            Node::Select(c, a, b) if !has(c) => {
                let (one, zero) = (l.exprs.constant(1.0), l.exprs.constant(0.0));
                let (first, second) = (l.exprs.select(c, one, zero), l.exprs.select(c, zero, one));
                let (a, b) = (inside(a), inside(b));
                stack.push(marks::reading(l).times(a, first, false));
                stack.push(marks::reading(l).times(b, second, false));
            }
            Node::Reduce { op: ReduceFn::Sum, depth, extent, body } => {
                let mut body = inside(body);
                body.sums.push((depth, extent));
                stack.push(body);
            }
            Node::Binary(BinaryFn::Mul | BinaryFn::Div, ..) => {
                let term = unmarked_factors_out(l, term, &done);
                terms.push(term);
            }
            _ => terms.push(term),
        }
    }
    terms.reverse();
    (terms, bare)
}

/// A product of several parts with marks, with the others among its factors.
fn unmarked_factors_out(l: &mut Lowering<'_, '_>, mut term: Term, marks: &FastMap<ExprId, Marks>) -> Term {
    let mut stack = vec![(term.rest, false)];
    let mut rest = l.exprs.constant(1.0);
    while let Some((e, divides)) = stack.pop() {
        match l.exprs.node(e) {
            _ if marks.get(&e).is_none_or(|m| *m == Marks::None) => term = marks::reading(l).times(term, e, divides),
            Node::Binary(BinaryFn::Mul, a, b) => stack.extend([(b, divides), (a, divides)]),
            Node::Binary(BinaryFn::Div, a, b) => stack.extend([(b, !divides), (a, divides)]),
            Node::Unary(UnaryFn::Neg, a) => {
                term = with_factor(l, term, -1.0);
                stack.push((a, divides));
            }
            _ => rest = if divides { l.exprs.div(rest, e) } else { l.exprs.mul(rest, e) },
        }
    }
    term.rest = rest;
    term
}

fn with_factor(l: &mut Lowering<'_, '_>, term: Term, x: f64) -> Term {
    let factor = l.exprs.constant(x);
    marks::reading(l).times(term, factor, false)
}

pub(in crate::elaborate::space) fn multiplied(l: &mut Lowering<'_, '_>, factors: &[(ExprId, bool)], first: ExprId) -> ExprId {
    factors.iter().fold(first, |e, &(f, divides)| if divides { l.exprs.div(e, f) } else { l.exprs.mul(e, f) })
}

/// A product with the sign of the factors, without those whose sign is known.
pub(in crate::elaborate::space) fn sign_of(l: &mut Lowering<'_, '_>, factors: &[(ExprId, bool)]) -> ExprId {
    let mut sign = l.exprs.constant(1.0);
    let mut stack: Vec<ExprId> = factors.iter().rev().map(|f| f.0).collect();
    while let Some(e) = stack.pop() {
        let range = marks::reading(l).interval(e);
        match l.exprs.node(e) {
            _ if range.is_not_negative() => {}
            _ if range.is_not_positive() => sign = l.exprs.neg(sign),
            Node::Binary(BinaryFn::Mul | BinaryFn::Div, a, b) => stack.extend([b, a]),
            Node::Unary(UnaryFn::Neg, a) => {
                sign = l.exprs.neg(sign);
                stack.push(a);
            }
            _ => sign = l.exprs.mul(sign, e),
        }
    }
    sign
}

/// A term as an expression.
pub(in crate::elaborate::space) fn term(l: &mut Lowering<'_, '_>, term: &Term) -> ExprId {
    let e = multiplied(l, &term.factors, term.rest);
    term.sums.iter().rev().fold(e, |e, &(depth, extent)| l.exprs.reduce(ReduceFn::Sum, depth, extent, e))
}
