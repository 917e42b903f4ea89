//! The chain rule. Slopes of functions of one number are in [`crate::ir::slope`].

use super::terms::{Differentiator, Terms};
use crate::ir::{BinaryFn, Compare, ExprId, Slope, UnaryFn, slope};

impl Differentiator<'_, '_> {
    /// Chain rule: the derivative of `f` at `a` times the terms of `a`; `value` is the node `f(a)`
    /// itself.
    pub(super) fn unary(&mut self, value: ExprId, f: UnaryFn, a: ExprId) -> Terms {
        let terms = self.of(a);
        if terms.is_empty() {
            return terms;
        }
        match slope(self.exprs, f, a, value) {
            Slope::Zero => self.nothing.clone(),
            Slope::MinusOne => self.negated(&terms),
            Slope::Factor(factor) => self.scaled(&terms, factor),
            Slope::Sign => {
                let (zero, minus) = (self.exprs.constant(0.0), self.negated(&terms));
                let negative = self.exprs.compare(Compare::Lt, a, zero);
                self.select(negative, &minus, &terms)
            }
        }
    }

    /// Sums, products, quotients, powers, choices; `value` is the node itself.
    pub(super) fn binary(&mut self, value: ExprId, f: BinaryFn, a: ExprId, b: ExprId) -> Terms {
        let (da, db) = (self.of(a), self.of(b));
        if da.is_empty() && db.is_empty() {
            return self.nothing.clone();
        }
        match f {
            BinaryFn::Add => self.added(&da, &db),
            BinaryFn::Sub => {
                let minus = self.negated(&db);
                self.added(&da, &minus)
            }
            BinaryFn::Mul => {
                let (left, right) = (self.scaled(&da, b), self.scaled(&db, a));
                self.added(&left, &right)
            }
            BinaryFn::Div => self.quotient(value, b, &da, &db),
            BinaryFn::Pow => self.power(value, a, b, &da, &db),
            BinaryFn::Min => {
                let first = self.exprs.compare(Compare::Lt, a, b);
                self.select(first, &da, &db)
            }
            BinaryFn::Max => {
                let first = self.exprs.compare(Compare::Lt, b, a);
                self.select(first, &da, &db)
            }
            BinaryFn::Atan2 => {
                let x = &mut *self.exprs;
                let (aa, bb) = (x.powi(a, 2), x.powi(b, 2));
                let radius = x.add(aa, bb);
                let (along_a, along_b) = (x.div(b, radius), x.div(a, radius));
                let (left, right) = (self.scaled(&da, along_a), self.scaled(&db, along_b));
                let minus = self.negated(&right);
                self.added(&left, &minus)
            }
        }
    }

    /// `d(a/b) = (da - (a/b) db) / b`, with one division for all terms.
    fn quotient(&mut self, value: ExprId, b: ExprId, da: &Terms, db: &Terms) -> Terms {
        let one = self.exprs.constant(1.0);
        let inverse = self.exprs.div(one, b);
        let share = self.scaled(db, value);
        let minus = self.negated(&share);
        let difference = self.added(da, &minus);
        self.scaled(&difference, inverse)
    }

    /// `d(a^b) = b a^b/a da + a^b ln(a) db`; both factors are 0 at a = 0.
    fn power(&mut self, value: ExprId, a: ExprId, b: ExprId, da: &Terms, db: &Terms) -> Terms {
        let zero = self.exprs.constant(0.0);
        let at_zero = self.exprs.compare(Compare::Eq, a, zero);
        let left = if da.is_empty() {
            da.clone()
        } else {
            let x = &mut *self.exprs;
            let share = x.div(value, a);
            let slope = x.mul(b, share);
            let factor = x.select(at_zero, zero, slope);
            self.scaled(da, factor)
        };
        let right = if db.is_empty() {
            db.clone()
        } else {
            let x = &mut *self.exprs;
            let logarithm = x.unary(UnaryFn::Ln, a);
            let slope = x.mul(value, logarithm);
            let factor = x.select(at_zero, zero, slope);
            self.scaled(db, factor)
        };
        self.added(&left, &right)
    }
}
