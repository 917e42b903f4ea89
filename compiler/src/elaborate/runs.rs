//! Ranges of whole numbers as loops.
//!
//! A set of names is written out: what is said of water need not be said of salt. A range of numbers mostly counts: trays, cells of a
//! battery, stages. It is elaborated as one loop first, with its index as a symbol. Where the body asks for more than a loop can
//! give (a single number, an entry of a table, a neighbour beyond the range), every trace of the attempt is removed and the range is
//! written out, with the same meaning and with the faults of its single members.

use smpl_dsl::syntax::{BinaryOp, Binder, BinderSet, Expr, ExprKind};

use super::cells::Cell;
use super::names::{Axis, SetId, SymbolKind};
use super::quantity::Value;
use super::{Bound, Elaborator, Place, Site};

/// Shorter ranges are written out: their numbers become constants.
pub(super) const SHORTEST: i64 = 16;
/// Most passes of all such loops together: more are refused, since nobody would wait for an evaluation, and to write them out takes more.
const MOST_PASSES: i64 = 20_000_000;

/// What an attempt may change.
pub(super) struct Trace {
    diagnostics: usize,
    reports: usize,
    unbound: usize,
    written_out: u32,
    passes: i64,
    remembered: usize,
    refused: bool,
}

impl Elaborator<'_> {
    /// The first and the last number that a binder counts, if they may stay a loop here.
    pub(super) fn run_of(&mut self, binder: &Binder, place: &Place) -> Option<(i64, i64)> {
        if !self.runs || !matches!(place.site, Site::Dynamics | Site::Instant) {
            return None;
        }
        let (low, high) = match &binder.over {
            BinderSet::Itself => self.numbers_of(&binder.name.text, place)?,
            BinderSet::Set(name) => self.numbers_of(&name.text, place)?,
            BinderSet::Range(low, high) => {
                let name = &binder.name.text;
                let symbol = self.names.lookup(place.scope, name);
                if self.counted.iter().any(|(n, _)| n == name) || symbol.is_some_and(|s| self.is_domain(s)) {
                    return None;
                }
                let (low, high) = (self.integer_quietly(low, place)?, self.integer_quietly(high, place)?);
                match self.numbers_of(name, place) {
                    Some((first, last)) => (low.max(first), high.min(last)),
                    None => (low, high),
                }
            }
            BinderSet::Tuple(_) => return None,
        };
        let passes = high.saturating_sub(low).saturating_add(1);
        let around = self.loops.iter().take(place.depth.into()).fold(1, |n: i64, l| n.saturating_mul(l.passes));
        if passes < SHORTEST {
            return None;
        }
        self.passes = self.passes.saturating_add(passes.saturating_mul(around));
        if self.passes > MOST_PASSES {
            self.exhausted.get_or_insert(binder.span);
            return None;
        }
        Some((low, high))
    }

    fn is_domain(&self, symbol: super::names::SymbolId) -> bool {
        matches!(self.names.symbols[symbol].kind, SymbolKind::Domain(_))
    }

    /// The first and the last member of a set of numbers.
    fn numbers_of(&self, name: &str, place: &Place) -> Option<(i64, i64)> {
        match self.names.symbols[self.names.lookup(place.scope, name)?].kind {
            SymbolKind::Set(set) => {
                let set = &self.names.sets[set];
                set.first.map(|first| (first, first + set.labels.len() as i64 - 1))
            }
            _ => None,
        }
    }

    /// Whether an index goes over the cells of a domain or over a range that may stay a loop.
    pub(super) fn may_run(&self, axis: Axis) -> bool {
        match axis {
            Axis::Domain(_) => true,
            Axis::Set(set) => self.names.sets[set].first.is_some() && self.names.axis_len(axis) >= SHORTEST,
        }
    }

    /// Elaborates something with a range as a loop; `None`, and no trace of it, where that was refused or at fault.
    pub(super) fn attempt<T>(&mut self, body: impl FnOnce(&mut Self) -> T) -> Option<T> {
        let before = self.trace();
        self.refused = false;
        self.attempts += 1;
        let value = body(self);
        self.attempts -= 1;
        let succeeded = !self.refused && self.diagnostics.len() == before.diagnostics;
        if !succeeded {
            self.forget(before);
            return None;
        }
        self.refused = before.refused;
        self.looped = true;
        if self.attempts == 0 {
            self.remembered.clear();
            self.reports.clear();
            self.unbound_names.clear();
        }
        Some(value)
    }

    /// What there is before something that may have to be forgotten.
    pub(super) fn trace(&self) -> Trace {
        Trace {
            diagnostics: self.diagnostics.len(),
            reports: self.reports.len(),
            unbound: self.unbound_names.len(),
            written_out: self.written_out,
            passes: self.passes,
            remembered: self.remembered.len(),
            refused: self.refused,
        }
    }

    /// Removes what an attempt has left.
    pub(super) fn forget(&mut self, before: Trace) {
        self.diagnostics.truncate(before.diagnostics);
        for key in self.reports.drain(before.reports..) {
            self.reported.remove(&key);
        }
        for key in self.unbound_names.drain(before.unbound..) {
            self.unbound.remove(&key);
        }
        self.written_out = before.written_out;
        self.passes = before.passes;
        self.refused = before.refused;
        for key in self.remembered.drain(before.remembered..) {
            self.memo.remove(&key);
        }
    }

    /// Notes that the range of the present attempt has to be written out.
    pub(super) fn refuse(&mut self) {
        self.refused = true;
    }

    /// The numbers that an index expression stands for, `i`, `i + 2`, `1 + i`, `i - 1`, where `i` is bound to a range.
    pub(super) fn run_index(&mut self, e: &Expr, place: &Place) -> Option<Cell> {
        match &e.kind {
            ExprKind::Name(name) => match place.bound(&name.text) {
                Some(Bound::Run(numbers)) => Some(*numbers),
                _ => None,
            },
            ExprKind::Binary(op @ (BinaryOp::Add | BinaryOp::Sub), a, b) => {
                if let Some(numbers) = self.run_index(a, place) {
                    let by = self.integer_quietly(b, place)?;
                    return Some(numbers.shifted(if *op == BinaryOp::Add { by } else { -by }));
                }
                if *op == BinaryOp::Sub {
                    return None;
                }
                let numbers = self.run_index(b, place)?;
                Some(numbers.shifted(self.integer_quietly(a, place)?))
            }
            _ => None,
        }
    }

    /// The members of a set that numbers of a range are; those of other sets, and numbers beyond it, are written out and reported.
    pub(super) fn run_members(&mut self, set: SetId, numbers: Cell) -> Option<Cell> {
        let len = self.names.sets[set].labels.len() as i64;
        let members = self.names.sets[set].first.map(|first| numbers.shifted(-first)).filter(|m| m.first >= 0 && m.last() < len);
        if members.is_none() {
            self.refuse();
        }
        members
    }

    /// A whole number that cannot change: of numbers, and of parameters that give sizes and indices.
    fn settled_number(&mut self, e: &Expr, place: &Place) -> Option<i64> {
        let v = self.value(e, place);
        let settled = !v.is_poison() && self.parameters_in(v.expr).iter().all(|(var, _)| self.structural.contains(var));
        let x = self.constant_value(v.expr).filter(|x| settled && x.fract() == 0.0 && x.abs() < 1e15)?;
        Some(x as i64)
    }

    /// The number that an index has, or the numbers of its range.
    fn counted_index(&mut self, e: &Expr, place: &Place) -> Option<Cell> {
        if let Some(numbers) = self.run_index(e, place) {
            return Some(numbers);
        }
        let number = |s: &Self, e: &Expr| match &e.kind {
            ExprKind::Name(name) => match place.bound(&name.text)? {
                Bound::Member(set, i) => s.names.sets[*set].first.map(|first| first + *i as i64),
                Bound::Number(e) => s.exprs.as_const(*e).map(|x| x as i64),
                _ => None,
            },
            _ => None,
        };
        match &e.kind {
            ExprKind::Binary(op @ (BinaryOp::Add | BinaryOp::Sub), a, b) if number(self, a).is_some() => {
                let by = self.integer_quietly(b, place)?;
                number(self, a).map(|n| Cell::single(if *op == BinaryOp::Add { n + by } else { n - by }))
            }
            _ => number(self, e).map(Cell::single),
        }
    }

    /// The numbers of a range as a value.
    pub(super) fn run_value(&mut self, numbers: Cell) -> Value {
        let first = self.exprs.constant(numbers.first as f64);
        let Some(along) = numbers.along else { return Value::bare(first) };
        let counter = self.exprs.counter(along);
        Value::bare(if numbers.first == 0 { counter } else { self.exprs.add(counter, first) })
    }

    /// `i < 4`, `n == i`: decided where one side is an index and the other one a number that the size of some range depends on too, so
    /// that it cannot change. A loop is cut where that holds in some passes only; what is made of this pass is thrown away then.
    pub(super) fn run_comparison(&mut self, op: BinaryOp, a: &Expr, b: &Expr, place: &Place) -> Option<bool> {
        let (numbers, op, n) = match (self.counted_index(a, place), self.counted_index(b, place)) {
            (Some(x), Some(y)) if x.along == y.along => return Some(holds(op, x.first, y.first)),
            (Some(x), Some(y)) if y.along.is_none() => (x, op, y.first),
            (Some(x), Some(y)) if x.along.is_none() => (y, mirrored(op), x.first),
            (Some(numbers), None) => (numbers, op, self.settled_number(b, place)?),
            (None, Some(numbers)) => (numbers, mirrored(op), self.settled_number(a, place)?),
            _ => return None,
        };
        // The passes at which the answer may change.
        let turns = match op {
            BinaryOp::Lt | BinaryOp::Ge => vec![n],
            BinaryOp::Le | BinaryOp::Gt => vec![n + 1],
            _ => vec![n, n + 1],
        };
        for turn in turns {
            numbers.along.into_iter().for_each(|along| self.cut(along, turn - numbers.first));
        }
        Some(holds(op, numbers.first, n))
    }
}

/// Whether `a op b`.
fn holds(op: BinaryOp, a: i64, b: i64) -> bool {
    match op {
        BinaryOp::Lt => a < b,
        BinaryOp::Le => a <= b,
        BinaryOp::Gt => a > b,
        BinaryOp::Ge => a >= b,
        BinaryOp::Eq => a == b,
        _ => a != b,
    }
}

/// `b op a` for `a op b`.
fn mirrored(op: BinaryOp) -> BinaryOp {
    match op {
        BinaryOp::Lt => BinaryOp::Gt,
        BinaryOp::Le => BinaryOp::Ge,
        BinaryOp::Gt => BinaryOp::Lt,
        BinaryOp::Ge => BinaryOp::Le,
        other => other,
    }
}
