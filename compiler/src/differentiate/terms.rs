//! Lists of derivatives, and their arithmetic.

use std::cmp::Ordering;
use std::rc::Rc;

use super::{ColumnOf, RateOf};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, MAX_DEPTH, UnaryFn};

/// A column pattern: elements along loop counters, of which those of sums are `bound` to extents.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Leaf {
    pub(super) column: Affine,
    pub(super) bound: [u32; MAX_DEPTH],
}

/// An element pattern with the derivative by it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Term {
    pub(super) leaf: Leaf,
    pub(super) value: ExprId,
}

/// Derivatives of a node: a number and a factor common to all times terms, one for each leaf,
/// ascending. Numbers and factors are multiplied with each other on the way up and with the terms
/// at last, where lists with different factors are added.
#[derive(Clone)]
pub(super) struct Terms {
    pub(super) list: Rc<[Term]>,
    pub(super) scale: f64,
    /// `None` for 1.
    pub(super) factor: Option<ExprId>,
}

impl Terms {
    pub(super) fn new(list: impl Into<Rc<[Term]>>) -> Terms {
        Terms { list: list.into(), scale: 1.0, factor: None }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.list.is_empty()
    }
}

/// Differentiation: the nodes, and the known derivatives.
pub(super) struct Differentiator<'a, 'c> {
    pub(super) exprs: &'a mut Exprs,
    pub(super) column_of: &'a ColumnOf<'c>,
    /// By time instead of columns: the rates of loads, in column 0.
    pub(super) rates: Option<&'a RateOf<'c>>,
    /// Derivatives that are still needed.
    pub(super) known: FastMap<ExprId, Terms>,
    /// By how many nodes and rows those of each node are still needed.
    pub(super) uses: Vec<u32>,
    pub(super) nothing: Terms,
}

impl Differentiator<'_, '_> {
    /// Forgets the derivatives of a node with its last use.
    pub(super) fn used(&mut self, expr: ExprId) {
        let Some(left) = self.uses.get_mut(expr.as_u32() as usize) else { return };
        *left = left.saturating_sub(1);
        if *left == 0 {
            self.known.remove(&expr);
        }
    }

    pub(super) fn of(&self, expr: ExprId) -> Terms {
        self.known.get(&expr).unwrap_or(&self.nothing).clone()
    }

    /// Terms times a factor.
    pub(super) fn scaled(&mut self, terms: &Terms, factor: ExprId) -> Terms {
        match self.exprs.node(factor) {
            Expr::Const(bits) => {
                let scale = terms.scale * f64::from_bits(bits);
                if scale == 0.0 { self.nothing.clone() } else { Terms { scale, ..terms.clone() } }
            }
            Expr::Unary(UnaryFn::Neg, a) => {
                let minus = self.negated(terms);
                self.scaled(&minus, a)
            }
            _ => {
                let factor = terms.factor.map_or(factor, |f| self.exprs.mul(factor, f));
                Terms { factor: Some(factor), ..terms.clone() }
            }
        }
    }

    pub(super) fn negated(&self, terms: &Terms) -> Terms {
        Terms { scale: -terms.scale, ..terms.clone() }
    }

    /// The list with the number and the factor in every term.
    pub(super) fn expanded(&mut self, terms: &Terms) -> Rc<[Term]> {
        if terms.factor.is_none() && terms.scale == 1.0 {
            return Rc::clone(&terms.list);
        }
        let whole = self.times(terms.factor, terms.scale);
        let times = |t: &Term| {
            let value = match self.exprs.as_const(t.value) {
                Some(x) => self.times(terms.factor, terms.scale * x),
                None => self.exprs.mul(whole, t.value),
            };
            Term { leaf: t.leaf, value }
        };
        terms.list.iter().map(times).collect()
    }

    fn times(&mut self, factor: Option<ExprId>, scale: f64) -> ExprId {
        let scale = self.exprs.constant(scale);
        factor.map_or(scale, |f| self.exprs.mul(f, scale))
    }

    pub(super) fn added(&mut self, a: &Terms, b: &Terms) -> Terms {
        if a.is_empty() {
            return b.clone();
        }
        if b.is_empty() {
            return a.clone();
        }
        if a.factor == b.factor && a.scale.abs() == b.scale.abs() {
            let join = if a.scale == b.scale { Exprs::add } else { Exprs::sub };
            return Terms { list: self.joined(&a.list, &b.list, join), ..a.clone() };
        }
        let (a, b) = (self.expanded(a), self.expanded(b));
        Terms::new(self.joined(&a, &b, Exprs::add))
    }

    /// Sum or difference of lists without factors.
    fn joined(&mut self, a: &[Term], b: &[Term], join: impl Fn(&mut Exprs, ExprId, ExprId) -> ExprId) -> Rc<[Term]> {
        self.merged(a, b, |exprs, x, y| match (x, y) {
            (Some(x), Some(y)) => join(exprs, x, y),
            (Some(x), None) => x,
            (None, y) => {
                let zero = exprs.constant(0.0);
                y.map_or(zero, |y| join(exprs, zero, y))
            }
        })
    }

    /// A factor must not reach what is not chosen: infinity times 0 is NaN.
    pub(super) fn select(&mut self, c: ExprId, a: &Terms, b: &Terms) -> Terms {
        let zero = self.exprs.constant(0.0);
        let (a, b) = (self.expanded(a), self.expanded(b));
        Terms::new(self.merged(&a, &b, |exprs, x, y| exprs.select(c, x.unwrap_or(zero), y.unwrap_or(zero))))
    }

    /// Both lists, leaf by leaf.
    fn merged(&mut self, a: &[Term], b: &[Term], join: impl Fn(&mut Exprs, Option<ExprId>, Option<ExprId>) -> ExprId) -> Rc<[Term]> {
        let (mut i, mut k) = (0, 0);
        let mut terms = Vec::with_capacity(a.len().max(b.len()));
        while i < a.len() || k < b.len() {
            let order = match (a.get(i), b.get(k)) {
                (Some(x), Some(y)) => x.leaf.cmp(&y.leaf),
                (Some(_), None) => Ordering::Less,
                _ => Ordering::Greater,
            };
            let (x, y) = (a.get(i).filter(|_| order.is_le()), b.get(k).filter(|_| order.is_ge()));
            let Some(leaf) = x.or(y).map(|t| t.leaf) else {
                break;
            };
            i += usize::from(x.is_some());
            k += usize::from(y.is_some());
            let value = join(self.exprs, x.map(|t| t.value), y.map(|t| t.value));
            if self.exprs.as_const(value) != Some(0.0) {
                terms.push(Term { leaf, value });
            }
        }
        Rc::from(terms)
    }
}
