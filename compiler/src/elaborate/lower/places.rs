//! The index at which an array is greatest or least, and values between the places of an array.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Expr};
use smpl_dsl::units::Unit;

use crate::elaborate::lower::loops::Cell;
use crate::elaborate::lower::place::{BinderValue, Bound, Place};
use crate::elaborate::lower::reductions::{Reduced, Term, Terms};
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::{Lowering, binders};
use crate::elaborate::space::grid;
use crate::elaborate::symbols::DomainId;
use crate::ir::{BinaryFn, Compare, ExprId, ReduceFn, UnaryFn};

impl Lowering<'_, '_> {
    /// `argmax(x[i] for i in set)`: the index of the greatest term, the first one of equal terms.
    pub(in crate::elaborate::lower) fn index_of_extreme(&mut self, mut terms: Vec<Term>, op: ReduceFn, span: Span) -> Value {
        if terms.is_empty() {
            return self.fault(Diagnostic::error(codes::EMPTY_SET, "the index of the least or greatest of nothing", span));
        }
        let neutral = self.exprs.constant(op.identity());
        for term in &mut terms {
            if let Some(counts) = term.keep.take() {
                term.value.expr = self.exprs.select(counts, term.value.expr, neutral);
            }
        }
        if terms.iter().any(|term| !term.loops.is_empty()) {
            self.looped_index(terms, op, span)
        } else {
            self.chained_index(terms, op, span)
        }
    }

    /// Compares each term with the best one before it.
    fn chained_index(&mut self, terms: Vec<Term>, op: ReduceFn, span: Span) -> Value {
        let mut list = terms.into_iter();
        let Some(first) = list.next() else { return self.poison() };
        let (mut best, mut index) = ((first.value, first.span), first.index);
        for next in list {
            let Some((a, b)) = self.values().common(&best.0, best.1, &next.value, next.span, span) else { return self.poison() };
            let better = if op == ReduceFn::Max { self.exprs.compare(Compare::Lt, a, b) } else { self.exprs.compare(Compare::Lt, b, a) };
            best = (Value { expr: self.exprs.select(better, b, a), unit: best.0.unit.beside(&next.value.unit) }, best.1);
            index.expr = self.exprs.select(better, next.index.expr, index.expr);
        }
        index
    }

    /// The least index whose term equals the extreme. The equality always holds at the extreme, so
    /// that it has no crossing to locate.
    fn looped_index(&mut self, terms: Vec<Term>, op: ReduceFn, span: Span) -> Value {
        let best = self.fold(terms.clone(), op, span);
        if best.is_poison() {
            return best;
        }
        let never = self.exprs.constant(f64::INFINITY);
        let mut indices = Vec::with_capacity(terms.len());
        for term in terms {
            let Some((a, b)) = self.values().common(&term.value, term.span, &best, span, span) else { return self.poison() };
            let equal = if op == ReduceFn::Max { self.exprs.compare(Compare::Le, b, a) } else { self.exprs.compare(Compare::Le, a, b) };
            let expr = self.exprs.select(equal, term.index.expr, never);
            let expr = self.exprs.unary(UnaryFn::Smooth, expr);
            indices.push(Term { value: Value { expr, unit: term.index.unit.clone() }, ..term });
        }
        self.fold(indices, ReduceFn::Min, span)
    }

    /// `interp(T[z], z = x)`: straight lines between the centres of cells or between whole numbers,
    /// the value of the nearest one beyond the ends.
    pub(in crate::elaborate::lower) fn interpolation(&mut self, body: &Expr, binder: &Binder, at: &Expr, place: &Place) -> Value {
        let position = self.value(at, place);
        if position.is_poison() {
            return position;
        }
        let domain = match binders::bindings_of(self, binder, place).as_slice() {
            [] => return self.poison(),
            [BinderValue::Cells(domain, ..)] => Some(*domain),
            [BinderValue::One(Bound::Member(set, _)), ..] if self.symbols.sets[*set].first.is_some() => None,
            _ => {
                let message = format!("`{}` is neither a domain nor a set of numbers", binder.name.text);
                let fault = Diagnostic::error(codes::WRONG_KIND, message, binder.name.span);
                return self.fault(fault.help("interpolate along a domain, `interp(T[z], z = 0.2 [m])`"));
            }
        };
        let unit = domain.map_or_else(Unit::one, |domain| grid::ends(self, domain).0);
        let x = self.values().in_unit(position, &unit, at.span, "the position", binder.name.span);
        let terms = match domain {
            Some(domain) => self.hats_of_cells(domain, body, (binder, x), place),
            None => self.hats_of_numbers(body, (binder, x), place),
        };
        let unit = match terms.iter().find(|term| term.value.is_poison()).or_else(|| terms.first()) {
            Some(term) if !term.value.is_poison() => term.value.unit.clone(),
            _ => return self.poison(),
        };
        let weighted = terms.into_iter().map(|term| {
            let expr = self.exprs.mul(term.index.expr, term.value.expr);
            Term { value: Value::bare(expr), ..term }
        });
        let weighted = weighted.collect();
        Value { unit, ..self.fold(weighted, ReduceFn::Sum, body.span) }
    }

    /// The numbers of a set with their weights at a position, which replace their indices.
    fn hats_of_numbers(&mut self, body: &Expr, (binder, x): (&Binder, ExprId), place: &Place) -> Vec<Term> {
        let binders = std::slice::from_ref(binder);
        let mut terms = Vec::new();
        let read = |l: &mut Lowering<'_, '_>, e: &Expr, place: &Place| l.value(e, place);
        self.terms(Reduced { body, binders, condition: None, kind: Terms::Plain, indexed: true, read }, place, &mut terms);
        let (first, last) = match binders::bindings_of(self, binder, place).as_slice() {
            [BinderValue::One(Bound::Member(set, i)), .., BinderValue::One(Bound::Member(_, j))] => {
                let first = self.symbols.sets[*set].first.unwrap_or_default();
                (first + *i as i64, first + *j as i64)
            }
            [BinderValue::One(Bound::Member(set, i))] => {
                let only = self.symbols.sets[*set].first.unwrap_or_default() + *i as i64;
                (only, only)
            }
            _ => return Vec::new(),
        };
        let ends = [first, last].map(|end| self.exprs.constant(end as f64));
        let x = self.inside(x, ends);
        let one = self.exprs.constant(1.0);
        for term in &mut terms {
            let away = self.exprs.sub(x, term.index.expr);
            let away = self.exprs.unary(UnaryFn::Abs, away);
            let share = self.exprs.sub(one, away);
            term.index = Value::bare(self.weight(share));
        }
        terms
    }

    /// The cells of a domain with their weights at a position.
    fn hats_of_cells(&mut self, domain: DomainId, body: &Expr, (binder, x): (&Binder, ExprId), place: &Place) -> Vec<Term> {
        let n = self.symbols.domains[domain].cells;
        let (_, low, high) = grid::ends(self, domain);
        let length = self.exprs.sub(high, low);
        let round = self.symbols.is_periodic(domain);
        let x = if round {
            let beyond = self.exprs.sub(x, low);
            let turns = self.exprs.div(beyond, length);
            let turns = self.exprs.unary(UnaryFn::Floor, turns);
            let back = self.exprs.mul(turns, length);
            self.exprs.sub(x, back)
        } else {
            let ends = [0, n - 1].map(|k| grid::centre(self, domain, Cell::single(k)));
            self.inside(x, ends)
        };
        let pieces = self.cells(0, n - 1, body.span, place, &mut |l, cell, inner| {
            let value = l.value(body, &inner.bind(&binder.name.text, Bound::Cell(domain, cell)));
            let (Some(first), Some(last)) = (l.is_number(cell, 0), l.is_number(cell, n - 1)) else { return (value, l.exprs.constant(0.0)) };
            let mut weight = l.hat(domain, cell, x, (first && !round, last && !round));
            if round && first {
                let image = l.exprs.sub(x, length);
                let more = l.hat(domain, cell, image, (false, false));
                weight = l.exprs.add(weight, more);
            }
            if round && last {
                let image = l.exprs.add(x, length);
                let more = l.hat(domain, cell, image, (false, false));
                weight = l.exprs.add(weight, more);
            }
            (value, weight)
        });
        let term = |(cell, (value, weight)): (Cell, (Value, ExprId))| {
            let loops = cell.along.map(|v| (v, cell.count as u32)).into_iter().collect();
            Term { value, span: body.span, keep: None, loops, weight: None, index: Value::bare(weight) }
        };
        pieces.into_iter().map(term).collect()
    }

    /// Weight of a cell at a position: 1 in its centre, 0 in those of its neighbours; `ends` are
    /// the sides without a neighbour.
    fn hat(&mut self, domain: DomainId, cell: Cell, x: ExprId, ends: (bool, bool)) -> ExprId {
        let centre = grid::centre(self, domain, cell);
        let mut share = self.exprs.constant(1.0);
        for (by, end) in [(-1, ends.0), (1, ends.1)] {
            if end {
                continue;
            }
            let beside = grid::centre(self, domain, cell.shifted(by));
            let (part, whole) = (self.exprs.sub(x, beside), self.exprs.sub(centre, beside));
            let ratio = self.exprs.div(part, whole);
            share = self.exprs.binary(BinaryFn::Min, share, ratio);
        }
        self.weight(share)
    }

    /// A share above zero; its kinks are left to the error test.
    fn weight(&mut self, share: ExprId) -> ExprId {
        let zero = self.exprs.constant(0.0);
        let positive = self.exprs.binary(BinaryFn::Max, share, zero);
        self.exprs.unary(UnaryFn::Smooth, positive)
    }

    fn inside(&mut self, x: ExprId, [low, high]: [ExprId; 2]) -> ExprId {
        let above = self.exprs.binary(BinaryFn::Max, x, low);
        self.exprs.binary(BinaryFn::Min, above, high)
    }
}
