//! Operators: arithmetic with units, comparisons, choices.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, UnaryOp};
use smpl_dsl::units::Unit;

use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, units};
use crate::elaborate::symbols::Symbols;
use crate::ir::{BinaryFn, Compare, Expr as Node};
impl Lowering<'_, '_> {
    pub(in crate::elaborate) fn unary(&mut self, op: UnaryOp, a: &Expr, place: &Place) -> Value {
        if op == UnaryOp::Not {
            let Some(c) = self.sound_condition(a, place) else { return self.poison() };
            let expr = self.exprs.not(c);
            return Value::truth(expr);
        }
        let v = self.value(a, place);
        if op == UnaryOp::Plus || v.is_poison() {
            return v;
        }
        match &v.unit {
            Measure::Truth => self.fault(Diagnostic::error(codes::WRONG_KIND, "the negative of a condition", a.span).help("write `not`")),
            // A literal -5 in a declaration of degC is a number, but the negative of a temperature means nothing.
            Measure::Of(unit) if units::is_point(unit) && !matches!(a.kind, ExprKind::Number { .. }) => {
                let unit = unit.clone();
                self.values().point_fault(&unit, a.span)
            }
            unit => {
                let unit = unit.clone();
                let expr = self.exprs.neg(v.expr);
                Value { expr, unit }
            }
        }
    }

    pub(in crate::elaborate) fn binary(&mut self, span: Span, op: BinaryOp, a: &Expr, b: &Expr, place: &Place) -> Value {
        match op {
            BinaryOp::And | BinaryOp::Or => {
                let (x, y) = (self.sound_condition(a, place), self.sound_condition(b, place));
                let (Some(x), Some(y)) = (x, y) else { return self.poison() };
                let expr = if op == BinaryOp::And { self.exprs.and(x, y) } else { self.exprs.or(x, y) };
                Value::truth(expr)
            }
            BinaryOp::Lt | BinaryOp::Le | BinaryOp::Gt | BinaryOp::Ge | BinaryOp::Eq | BinaryOp::Ne => {
                self.comparison(span, op, a, b, place)
            }
            BinaryOp::Div if self.symbols.is_rate_slip(a, b, place) => {
                let what = match &a.kind {
                    ExprKind::Name(name) => name.text.strip_prefix('d').unwrap_or_default().to_owned(),
                    ExprKind::Call { arguments, .. } => {
                        arguments.first().map(crate::elaborate::select::items::reference).unwrap_or_default()
                    }
                    _ => String::new(),
                };
                self.fault(
                    Diagnostic::error(codes::UNKNOWN_NAME, "neither part of this quotient is declared", span)
                        .label("meant as a rate?")
                        .help(format!("a rate is written `d/dt {what}`")),
                )
            }
            _ => {
                let (x, y) = (self.value(a, place), self.value(b, place));
                self.arithmetic(op, (x, a.span), (y, b.span), span)
            }
        }
    }

    /// `a + b` and so on, on values.
    pub(in crate::elaborate) fn arithmetic(&mut self, op: BinaryOp, a: (Value, Span), b: (Value, Span), span: Span) -> Value {
        if a.0.is_poison() || b.0.is_poison() {
            return self.poison();
        }
        for (v, s) in [&a, &b] {
            if matches!(v.unit, Measure::Truth) {
                return self.fault(
                    Diagnostic::error(codes::WRONG_KIND, "arithmetic with a condition", *s).help("write `if condition then 1 else 0`"),
                );
            }
        }
        match op {
            BinaryOp::Add | BinaryOp::Sub => self.values().sum(op, a, b, span),
            BinaryOp::Mul | BinaryOp::Div => self.values().product(op, a, b),
            _ => self.power(a, b),
        }
    }

    fn power(&mut self, (a, sa): (Value, Span), (b, sb): (Value, Span)) -> Value {
        let exponent = match &b.unit {
            Measure::Of(u) => {
                let u = u.clone();
                match self.values().convert(b.expr, &u, &Unit::one()) {
                    Some(e) => e,
                    None => {
                        return self.fault(
                            Diagnostic::error(codes::NOT_DIMENSIONLESS, "an exponent must be dimensionless", sb).label(units::describe(&u)),
                        );
                    }
                }
            }
            _ => b.expr,
        };
        // Powers of whole numbers are products.
        if self.exprs.free(exponent) != 0 {
            self.ledger.speculation.refuse();
        }
        let unit = match &a.unit {
            Measure::Of(u) if units::is_point(u) => {
                let u = u.clone();
                return self.values().point_fault(&u, sa);
            }
            Measure::Of(u) if !units::is_dimensionless(u) => {
                let u = u.clone();
                let power = self.constant_value(exponent).and_then(|x| units::power(&u, x));
                match power {
                    Some(unit) => Measure::Of(unit),
                    None => {
                        return self.fault(
                            Diagnostic::error(codes::NOT_DIMENSIONLESS, "only a simple constant power of a quantity has a unit", sa)
                                .label(units::describe(&u))
                                .secondary(sb, "this exponent is not a simple fraction")
                                .help("divide the base by a reference of its unit, or take the unit off: `value(x)^p`"),
                        );
                    }
                }
            }
            Measure::Of(u) => {
                let u = u.clone();
                let base = self.values().convert(a.expr, &u, &Unit::one()).unwrap_or(a.expr);
                let expr = self.exprs.binary(BinaryFn::Pow, base, exponent);
                return Value::of(expr, Unit::one());
            }
            m => m.clone(),
        };
        let unit = if matches!(unit, Measure::Zero) { Measure::Bare } else { unit };
        let expr = self.exprs.binary(BinaryFn::Pow, a.expr, exponent);
        Value { expr, unit }
    }

    fn comparison(&mut self, span: Span, op: BinaryOp, a: &Expr, b: &Expr, place: &Place) -> Value {
        if let Some(v) = self.phase_comparison(a, b, place) {
            return match op {
                BinaryOp::Eq => v,
                BinaryOp::Ne if v.is_poison() => v,
                BinaryOp::Ne => Value::truth(self.exprs.not(v.expr)),
                _ => self.fault(Diagnostic::error(codes::WRONG_KIND, "phases have no order; compare with `==` or `!=`", span)),
            };
        }
        if let Some(equal) = self.naming().name_comparison(a, b, place) {
            return match (op, equal) {
                (_, None) => self.poison(),
                (BinaryOp::Eq, Some(equal)) => Value::truth(self.exprs.truth(equal)),
                (BinaryOp::Ne, Some(equal)) => Value::truth(self.exprs.truth(!equal)),
                _ => self.fault(Diagnostic::error(codes::WRONG_KIND, "names have no order; compare with `==` or `!=`", span)),
            };
        }
        if let Some(holds) = self.run_comparison(op, a, b, place) {
            return Value::truth(self.exprs.truth(holds));
        }
        let (x, y) = (self.value(a, place), self.value(b, place));
        let Some((l, r)) = self.values().common(&x, a.span, &y, b.span, span) else { return self.poison() };
        let expr = match op {
            BinaryOp::Lt => self.exprs.compare(Compare::Lt, l, r),
            BinaryOp::Le => self.exprs.compare(Compare::Le, l, r),
            BinaryOp::Gt => self.exprs.compare(Compare::Lt, r, l),
            BinaryOp::Ge => self.exprs.compare(Compare::Le, r, l),
            BinaryOp::Eq => self.exprs.compare(Compare::Eq, l, r),
            _ => self.exprs.compare(Compare::Ne, l, r),
        };
        Value::truth(expr)
    }

    /// `if c then a else b`, with the way to elaborate a branch.
    pub(in crate::elaborate) fn conditional_of(
        &mut self,
        span: Span,
        c: &Expr,
        (a, b): (&Expr, &Expr),
        place: &Place,
        branch: &mut dyn FnMut(&mut Self, &Expr) -> Value,
    ) -> Value {
        let Some(condition) = self.sound_condition(c, place) else {
            // The branches may have faults of their own.
            branch(self, a);
            branch(self, b);
            return self.poison();
        };
        // What the compiler can decide is decided: the other branch need not even have a meaning here.
        if let Node::Truth(holds) = self.exprs.node(condition) {
            return branch(self, if holds { a } else { b });
        }
        let (x, y) = (branch(self, a), branch(self, b));
        self.values().choose(condition, (x, a.span), (y, b.span), span)
    }
}

impl Symbols<'_> {
    /// `dx/dt`, `d(x)/dt` where that means nothing else.
    fn is_rate_slip(&self, a: &Expr, b: &Expr, place: &Place) -> bool {
        let is_free = |name: &str| place.bound(name).is_none() && self.lookup(place.scope, name).is_none();
        let by_time = matches!(&b.kind, ExprKind::Name(dt) if dt.text == "dt" && is_free("dt"));
        by_time
            && match &a.kind {
                ExprKind::Name(dx) => dx.text.len() > 1 && dx.text.starts_with('d') && is_free(&dx.text),
                ExprKind::Call { function, .. } => function.text == "d" && is_free("d"),
                _ => false,
            }
    }
}
