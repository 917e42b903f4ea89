//! Ranges of whole numbers as loops.
//!
//! A set of names is unrolled: statements about water may not hold for salt. A range of numbers
//! mostly counts: trays, cells of a battery, stages. It is elaborated as one loop first, with its
//! index as a symbol. If the body needs more than a loop can give (a single number, an entry of a
//! table, a neighbour beyond the range), every trace of the attempt is removed. The range is then
//! unrolled, with the same meaning and with the faults of its single members.

use smpl_dsl::syntax::{BinaryOp, Binder, BinderSet, Expr, ExprKind};

use crate::elaborate::lower::loops::Cell;
use crate::elaborate::lower::place::{Bound, Place, Site};
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::values::Values;
use crate::elaborate::lower::{Lowering, indices, structural};
use crate::elaborate::naming::Naming;
use crate::elaborate::symbols::{Axis, SetId, SymbolKind, Symbols};
use crate::ir::{Affine, ExprId};

/// Shorter ranges are unrolled: their numbers become constants.
pub(in crate::elaborate) const SHORTEST: i64 = 16;
impl Lowering<'_, '_> {
    /// The first and the last number that a binder counts, if they may stay a loop here.
    pub(in crate::elaborate) fn run_of(&mut self, binder: &Binder, place: &Place) -> Option<(i64, i64)> {
        if !self.ledger.speculation.enabled || !matches!(place.site, Site::Dynamics | Site::Instant) {
            return None;
        }
        let (low, high) = match &binder.over {
            BinderSet::Itself => self.symbols.numbers_of(&binder.name.text, place)?,
            BinderSet::Set(name) => self.symbols.numbers_of(&name.text, place)?,
            BinderSet::Range(low, high) => {
                let name = &binder.name.text;
                let symbol = self.symbols.lookup(place.scope, name);
                if self.loops.counted.iter().any(|(n, _)| n == name) || symbol.is_some_and(|s| self.symbols.is_domain(s)) {
                    return None;
                }
                let (low, high) = (structural::integer_quietly(self, low, place)?, structural::integer_quietly(self, high, place)?);
                match self.symbols.numbers_of(name, place) {
                    Some((first, last)) => (low.max(first), high.min(last)),
                    None => (low, high),
                }
            }
            BinderSet::Tuple(_) => return None,
        };
        let passes = high.saturating_sub(low).saturating_add(1);
        let around = self.loops.frames.iter().take(place.depth.into()).fold(1, |n: i64, l| n.saturating_mul(l.passes));
        if passes < SHORTEST {
            return None;
        }
        if !self.ledger.speculation.may_loop(passes.saturating_mul(around)) {
            self.ledger.budget.give_up(binder.span);
            return None;
        }
        Some((low, high))
    }

    /// Elaborates something with a range as a loop; `None`, and no trace of it, if that was refused
    /// or invalid.
    pub(in crate::elaborate) fn attempt<T>(&mut self, body: impl FnOnce(&mut Self) -> T) -> Option<T> {
        let before = self.ledger.trace();
        self.ledger.speculation.begin();
        let value = body(self);
        self.ledger.speculation.end();
        if !self.ledger.speculation.succeeded(&before, &self.ledger.reports) {
            self.ledger.roll_back(before, self.expansions);
            return None;
        }
        self.ledger.speculation.commit(&before, &mut self.ledger.reports);
        Some(value)
    }

    /// The numbers that an index expression stands for, `i`, `i + 2`, `1 + i`, `i - 1`, `8 - i`,
    /// where `i` is bound to a range.
    pub(in crate::elaborate) fn run_index(&mut self, e: &Expr, place: &Place) -> Option<Cell> {
        match &e.kind {
            ExprKind::Name(name) => match place.bound(&name.text) {
                Some(Bound::Run(numbers)) => Some(*numbers),
                _ => None,
            },
            ExprKind::Binary(op @ (BinaryOp::Add | BinaryOp::Sub), a, b) => {
                if let Some(numbers) = self.run_index(a, place) {
                    let by = structural::integer_quietly(self, b, place)?;
                    return Some(numbers.shifted(if *op == BinaryOp::Add { by } else { -by }));
                }
                let numbers = self.run_index(b, place)?;
                let n = structural::integer_quietly(self, a, place)?;
                Some(if *op == BinaryOp::Add { numbers.shifted(n) } else { numbers.subtracted_from(n) })
            }
            _ => None,
        }
    }

    /// The entry of a table at an index that counts. `None` if one of its entries is missing or
    /// zero, since terms with zero vanish.
    pub(in crate::elaborate) fn table_entry(&mut self, at: Affine, values: &[f64]) -> Option<ExprId> {
        let passes = std::array::from_fn(|d| self.loops.frames.get(d).map(|frame| frame.passes as u32));
        let (low, high) = at.reach(&passes);
        let mut strides = at.strides.into_iter().filter(|&stride| stride != 0);
        let step = strides.next().filter(|_| strides.next().is_none()).map_or(1, i64::unsigned_abs) as usize;
        let entries = values.get(usize::try_from(low).ok()?..=usize::try_from(high).ok()?)?;
        if entries.iter().step_by(step).any(|x| *x == 0.0 || x.is_nan()) {
            return None;
        }
        Some(self.exprs.entry_at(values, at))
    }

    /// The number that an index has, or the numbers of its range.
    fn counted_index(&mut self, e: &Expr, place: &Place) -> Option<Cell> {
        if let Some(numbers) = self.run_index(e, place) {
            return Some(numbers);
        }
        let number = |s: &Self, e: &Expr| match &e.kind {
            ExprKind::Name(name) => match place.bound(&name.text)? {
                Bound::Member(set, i) => s.symbols.sets[*set].first.map(|first| first + *i as i64),
                Bound::Number(e) => s.exprs.as_const(*e).map(|x| x as i64),
                _ => None,
            },
            _ => None,
        };
        match &e.kind {
            ExprKind::Binary(op @ (BinaryOp::Add | BinaryOp::Sub), a, b) if number(self, a).is_some() => {
                let by = structural::integer_quietly(self, b, place)?;
                number(self, a).map(|n| Cell::single(if *op == BinaryOp::Add { n + by } else { n - by }))
            }
            ExprKind::Member(base, member) if member.text == "number" => indices::cell_number(base, place).map(|cell| cell.shifted(1)),
            _ => number(self, e).map(Cell::single),
        }
    }

    /// `z == z.last`: the number of a cell, where it is compared with an end of its domain.
    fn compared_cell(&self, e: &Expr, with: &Expr, place: &Place) -> Option<Cell> {
        let ExprKind::Member(base, end) = &with.kind else { return None };
        let ExprKind::Name(name) = &e.kind else { return None };
        match place.bound(&name.text)? {
            Bound::Cell(domain, cell) if matches!(end.text.as_str(), "first" | "last") => {
                (self.symbols.domain_of(base, place) == Some(*domain)).then(|| cell.shifted(1))
            }
            _ => None,
        }
    }

    /// `i < 4`, `n == i`: decided where one side is an index and the other one a number that the
    /// size of some range depends on too, so that it cannot change. A loop is cut where that holds
    /// in some passes only; what is made of this pass is thrown away then.
    pub(in crate::elaborate) fn run_comparison(&mut self, op: BinaryOp, a: &Expr, b: &Expr, place: &Place) -> Option<bool> {
        let index = |l: &mut Self, e, with| l.compared_cell(e, with, place).or_else(|| l.counted_index(e, place));
        let (numbers, op, n) = match (index(self, a, b), index(self, b, a)) {
            (Some(x), Some(y)) if (x.along, x.step) == (y.along, y.step) => return Some(holds(op, x.first, y.first)),
            (Some(x), Some(y)) if y.along.is_none() => (x, op, y.first),
            (Some(x), Some(y)) if x.along.is_none() => (y, mirrored(op), x.first),
            (Some(numbers), None) => (numbers, op, structural::settled(self, b, place)?),
            (None, Some(numbers)) => (numbers, mirrored(op), structural::settled(self, a, place)?),
            _ => return None,
        };
        // The passes at which the answer may change.
        let turns = match op {
            BinaryOp::Lt | BinaryOp::Ge => vec![n],
            BinaryOp::Le | BinaryOp::Gt => vec![n + 1],
            _ => vec![n, n + 1],
        };
        for turn in turns {
            numbers.along.into_iter().for_each(|along| self.cut(along, numbers.turn(turn)));
        }
        Some(holds(op, numbers.first, n))
    }
}

impl<'a> Naming<'_, 'a> {
    /// The members of a set that numbers of a range are; those of other sets, and numbers beyond
    /// it, are unrolled and reported.
    pub(in crate::elaborate) fn run_members(&mut self, set: SetId, numbers: Cell) -> Option<Cell> {
        let len = self.symbols.sets[set].labels.len() as i64;
        let members = self.symbols.sets[set].first.map(|first| numbers.shifted(-first)).filter(|m| m.ends().0 >= 0 && m.ends().1 < len);
        if members.is_none() {
            self.ledger.speculation.refuse();
        }
        members
    }
}

impl Values<'_> {
    /// The numbers of a range as a value.
    pub(in crate::elaborate) fn run_value(&mut self, numbers: Cell) -> Value {
        let first = self.exprs.constant(numbers.first as f64);
        let Some(along) = numbers.along else { return Value::bare(first) };
        let counter = self.exprs.counter(along);
        Value::bare(if numbers.step > 0 { self.exprs.add(counter, first) } else { self.exprs.sub(first, counter) })
    }
}

impl<'a> Symbols<'a> {
    fn is_domain(&self, symbol: crate::elaborate::symbols::SymbolId) -> bool {
        matches!(self[symbol].kind, SymbolKind::Domain(_))
    }

    /// The first and the last member of a set of numbers.
    fn numbers_of(&self, name: &str, place: &Place) -> Option<(i64, i64)> {
        match self[self.lookup(place.scope, name)?].kind {
            SymbolKind::Set(set) => {
                let set = &self.sets[set];
                set.first.map(|first| (first, first + set.labels.len() as i64 - 1))
            }
            _ => None,
        }
    }

    /// Returns `true` if an index goes over the cells of a domain or over a range that may stay a
    /// loop.
    pub(in crate::elaborate) fn may_run(&self, axis: Axis) -> bool {
        match axis {
            Axis::Domain(_) => true,
            Axis::Set(set) => self.sets[set].first.is_some() && self.axis_len(axis) >= SHORTEST,
        }
    }
}

/// Returns `true` if `a op b`.
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
