//! Derivatives of reductions that stay loops.

use std::rc::Rc;

use super::terms::{Differentiator, Terms};
use crate::ir::{BinaryFn, Compare, Expr, ExprId, LoopVar, ReduceFn};

impl Differentiator<'_, '_> {
    /// The body of a reduction with another counter.
    fn twin(&mut self, body: ExprId, depth: LoopVar, by: u8) -> (ExprId, LoopVar) {
        let (from, to) = (depth.0 as usize, LoopVar(depth.0 + by));
        let twin = self.exprs.rewrite(body, &mut crate::ir::Rewritten::default(), &mut |exprs, node| match node {
            Expr::Counter(v) if v == depth => Some(exprs.counter(to)),
            Expr::Load { var, flavour, mut at } if at.strides[from] != 0 => {
                at.strides[to.0 as usize] += std::mem::take(&mut at.strides[from]);
                Some(exprs.load(var, flavour, at))
            }
            _ => None,
        });
        (twin, to)
    }

    /// The derivative of the greatest (least) element; of several that are equal, the mean of
    /// theirs.
    pub(super) fn extremum(&mut self, op: ReduceFn, (depth, extent): (LoopVar, u32), body: ExprId, terms: &Terms) -> Terms {
        let (second, over) = self.twin(body, depth, 2);
        let value = self.exprs.reduce(op, over, extent, second);
        let (first, counted) = self.twin(body, depth, 1);
        let (zero, one) = (self.exprs.constant(0.0), self.exprs.constant(1.0));
        let x = &mut *self.exprs;
        let (hit, equal) = (x.compare(Compare::Eq, body, value), x.compare(Compare::Eq, first, value));
        let each = x.select(equal, one, zero);
        let count = x.reduce(ReduceFn::Sum, counted, extent, each);
        // There is at least one, unless the value is not a number.
        let count = x.binary(BinaryFn::Max, count, one);
        let share = x.div(one, count);
        let nothing = self.nothing.clone();
        let chosen = self.select(hit, terms, &nothing);
        let sum = self.sum(depth, extent, &chosen);
        self.scaled(&sum, share)
    }

    /// The derivative of a long product, which may have factors that are zero.
    pub(super) fn product(&mut self, (depth, extent): (LoopVar, u32), body: ExprId, terms: &Terms) -> Terms {
        let (factor, counter) = self.twin(body, depth, 1);
        let (zero, one) = (self.exprs.constant(0.0), self.exprs.constant(1.0));
        let x = &mut *self.exprs;
        let is_zero = x.compare(Compare::Eq, factor, zero);
        let (others, each) = (x.select(is_zero, one, factor), x.select(is_zero, one, zero));
        let others = x.reduce(ReduceFn::Product, counter, extent, others);
        let zeros = x.reduce(ReduceFn::Sum, counter, extent, each);
        let (none, only) = (x.compare(Compare::Eq, zeros, zero), x.compare(Compare::Eq, zeros, one));
        let (here, rest) = (x.compare(Compare::Eq, body, zero), x.div(others, body));
        let (at_zero, elsewhere) = (x.select(only, others, zero), x.select(none, rest, zero));
        let slope = x.select(here, at_zero, elsewhere);
        let scaled = self.scaled(terms, slope);
        self.sum(depth, extent, &scaled)
    }

    /// The derivative of a sum: one more loop where a leaf runs along its counter.
    pub(super) fn sum(&mut self, depth: LoopVar, extent: u32, inner: &Terms) -> Terms {
        let d = depth.0 as usize;
        let inner = inner.clone();
        let stays = inner.factor.is_none_or(|f| self.exprs.free(f) & (1 << d) == 0);
        let inner = if stays { inner } else { Terms::new(self.expanded(&inner)) };
        let mut terms = vec![];
        for &term in inner.list.iter() {
            let mut term = term;
            if term.leaf.column.strides[d] != 0 {
                term.leaf.bound[d] = extent;
            } else {
                term.value = self.exprs.reduce(ReduceFn::Sum, depth, extent, term.value);
            }
            terms.push(term);
        }
        terms.sort_by_key(|t| t.leaf);
        Terms { list: Rc::from(terms), ..inner }
    }
}
