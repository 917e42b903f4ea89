//! Arithmetic with units: all that it needs of the elaboration.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, Ident};
use smpl_dsl::units::Unit;

use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, units};
use crate::ir::{BinaryFn, ExprId, Exprs};

/// Nodes, and where faults go.
pub(in crate::elaborate) struct Values<'e> {
    /// The nodes.
    pub exprs: &'e mut Exprs,
    /// Faults.
    pub ledger: &'e mut Ledger,
}

impl Lowering<'_, '_> {
    /// Data of arithmetic.
    pub(in crate::elaborate) fn values(&mut self) -> Values<'_> {
        Values { exprs: self.exprs, ledger: self.ledger }
    }

    /// Placeholder after a reported fault: it fits everywhere.
    pub(in crate::elaborate) fn poison(&mut self) -> Value {
        self.values().poison()
    }

    /// Reports a fault; poison.
    pub(in crate::elaborate) fn fault(&mut self, diagnostic: Diagnostic) -> Value {
        self.values().fault(diagnostic)
    }
}

impl Values<'_> {
    pub(in crate::elaborate) fn poison(&mut self) -> Value {
        Value { expr: self.exprs.constant(f64::NAN), unit: Measure::Poison }
    }

    pub(in crate::elaborate) fn fault(&mut self, diagnostic: Diagnostic) -> Value {
        self.ledger.report(diagnostic);
        self.poison()
    }
}

impl Values<'_> {
    /// A value as a number in `target`; a pure number is taken in it.
    pub(in crate::elaborate) fn in_unit(&mut self, v: Value, target: &Unit, span: Span, what: &str, declared: Span) -> ExprId {
        match &v.unit {
            Measure::Poison | Measure::Zero | Measure::Nothing | Measure::Bare => v.expr,
            Measure::Truth => {
                self.ledger.report(
                    Diagnostic::error(codes::WRONG_KIND, "a number is needed here, this is a condition", span)
                        .help("write `if condition then 1 else 0`"),
                );
                v.expr
            }
            Measure::Of(unit) => {
                let unit = unit.clone();
                // A dimensionless factor on a bare number (`value(x)*uniform(...)`) still is a
                // number of the declared unit.
                if units::is_plain_number(&unit) && !units::is_dimensionless(target) {
                    return v.expr;
                }
                match self.convert(v.expr, &unit, target) {
                    Some(e) => e,
                    None => {
                        self.ledger.report(units::mismatch(&unit, target, span, what, declared));
                        v.expr
                    }
                }
            }
        }
    }

    /// A literal number is taken in the target's unit, anything else must have it.
    pub(in crate::elaborate) fn strictly_or_bare(&mut self, v: Value, unit: &Unit, span: Span, what: &str, declared: Span) -> ExprId {
        if matches!(v.unit, Measure::Bare) {
            return self.in_unit(v, unit, span, what, declared);
        }
        self.strictly_in(v, unit, span, what, declared)
    }

    /// A value as a number in `target`, strictly: a dimensionless number does not pass for a
    /// quantity.
    pub(in crate::elaborate) fn strictly_in(&mut self, v: Value, target: &Unit, span: Span, what: &str, declared: Span) -> ExprId {
        match &v.unit {
            Measure::Bare if !units::is_dimensionless(target) => {
                let mut fault = units::mismatch(&Unit::one(), target, span, what, declared);
                if let Some(x) = self.exprs.as_const(v.expr) {
                    fault = fault.help(units::literal(x, target));
                }
                self.ledger.report(fault);
                v.expr
            }
            Measure::Of(unit) if units::is_plain_number(unit) && !units::is_dimensionless(target) => {
                self.ledger.report(units::mismatch(&unit.clone(), target, span, what, declared));
                v.expr
            }
            Measure::Bare => self.convert(v.expr, &Unit::one(), target).unwrap_or(v.expr),
            _ => self.in_unit(v, target, span, what, declared),
        }
    }

    /// `v as [unit]`: a pure number gets the unit, a quantity is converted.
    pub(in crate::elaborate) fn put_unit(&mut self, v: Value, target: Unit, span: Span) -> Value {
        match &v.unit {
            Measure::Poison => v,
            Measure::Zero | Measure::Nothing | Measure::Bare => Value::of(v.expr, target),
            Measure::Truth => {
                self.fault(Diagnostic::error(codes::WRONG_KIND, "a condition has no unit", span).label("this is a condition"))
            }
            Measure::Of(unit) => {
                let unit = unit.clone();
                // A number gets the unit, `mg/g` and `%` included; a dimensionless quantity with a
                // scale is a number first.
                if units::is_plain_number(&unit) {
                    return Value::of(v.expr, target);
                }
                if units::is_dimensionless(&unit) && !units::is_dimensionless(&target) {
                    let expr = self.convert(v.expr, &unit, &Unit::one()).unwrap_or(v.expr);
                    return Value::of(expr, target);
                }
                match self.convert(v.expr, &unit, &target) {
                    // A difference of temperatures stays one.
                    Some(expr) => Value::of(expr, target.between_points(unit.is_between_points())),
                    None => self.fault(units::mismatch(&unit, &target, span, "the unit after `as`", Span::default())),
                }
            }
        }
    }

    pub(in crate::elaborate) fn not_a_state(&mut self, span: Span, inner: &Expr) -> Value {
        let help = match &inner.kind {
            ExprKind::Binary(BinaryOp::Mul, a, b) => match (&a.kind, &b.kind) {
                (ExprKind::Name(Ident { text: a, .. }), ExprKind::Name(Ident { text: b, .. })) => format!(
                    "write the product rule, `{a} * d/dt {b} + {b} * d/dt {a}` (one term where the other factor is constant), or make the product a state and divide"
                ),
                _ => "write the product rule, or make the product a separate state and divide".to_owned(),
            },
            ExprKind::Name(_) | ExprKind::Index(..) | ExprKind::Member(..) => "declare it with `state`".to_owned(),
            _ => "write out the derivative of the expression, or make it a separate state".to_owned(),
        };
        self.fault(Diagnostic::error(codes::WRONG_KIND, "only a state has a time derivative", span).help(help))
    }

    pub(in crate::elaborate) fn point_fault(&mut self, unit: &Unit, span: Span) -> Value {
        self.fault(
            Diagnostic::error(codes::AFFINE_UNIT, format!("a temperature in {unit} is a point on a scale, not an amount"), span)
                .label(format!("in {unit}"))
                .help("use `kelvin(T)` for the absolute temperature, or a difference of two temperatures"),
        )
    }

    pub(in crate::elaborate) fn sum(&mut self, op: BinaryOp, (a, sa): (Value, Span), (b, sb): (Value, Span), span: Span) -> Value {
        let f = if op == BinaryOp::Add { BinaryFn::Add } else { BinaryFn::Sub };
        let unit = match (&a.unit, &b.unit) {
            (Measure::Zero | Measure::Bare, Measure::Zero | Measure::Bare) => {
                let expr = self.exprs.binary(f, a.expr, b.expr);
                return Value::bare(expr);
            }
            // The negative of a point means nothing, however it is written.
            (m, Measure::Of(unit)) if m.is_zero() && op == BinaryOp::Sub && units::is_point(unit) => {
                let unit = unit.clone();
                return self.point_fault(&unit, sb);
            }
            (Measure::Nothing, m) | (m, Measure::Nothing) | (Measure::Zero, m) | (m, Measure::Zero) => {
                let unit = m.clone();
                let expr = self.exprs.binary(f, a.expr, b.expr);
                return Value { expr, unit };
            }
            (m, n) => (m.unit(), n.unit()),
        };
        let (ua, ub) = unit;
        self.warn_of_scale((&a, sa), (&b, sb));
        // Points on a scale: point - point is a difference, point ± difference is a point.
        let result = match (units::is_point(&ua), units::is_point(&ub)) {
            (false, false) => units::sum(&ua, &ub),
            (true, true) if op == BinaryOp::Sub => units::difference(&ua),
            (true, false) => ua.clone(),
            (false, true) if op == BinaryOp::Add => ub.clone(),
            _ => return self.point_fault(&ub, sb),
        };
        let target = match (units::is_point(&ua), units::is_point(&ub)) {
            (true, true) => ua.clone(),
            (true, false) => units::difference(&ua),
            _ => ua.clone(),
        };
        let left =
            if units::is_point(&ub) && !units::is_point(&ua) { self.convert(a.expr, &ua, &units::difference(&ub)) } else { Some(a.expr) };
        let right = if units::is_point(&ub) && !units::is_point(&ua) { Some(b.expr) } else { self.convert(b.expr, &ub, &target) };
        let (Some(left), Some(right)) = (left, right) else {
            let verb = if op == BinaryOp::Add { "added" } else { "subtracted" };
            let d = units::clash(&ua, sa, &ub, sb, span, verb);
            let d = match self
                .exprs
                .as_const(b.expr)
                .filter(|_| op == BinaryOp::Sub && units::is_point(&ua) && matches!(b.unit, Measure::Bare))
            {
                Some(x) => d.help(units::literal_beside_point(x, &ua)),
                None => self.with_literal(d, (&a, &units::difference(&ua)), (&b, &units::difference(&ub))),
            };
            return self.fault(d);
        };
        let expr = self.exprs.binary(f, left, right);
        Value::of(expr, result)
    }

    /// Warns of a number without a unit next to a percentage or the like, which is easily a
    /// mistake.
    pub(in crate::elaborate) fn warn_of_scale(&mut self, (a, sa): (&Value, Span), (b, sb): (&Value, Span)) {
        for ((number, span), quantity) in [((a, sa), b), ((b, sb), a)] {
            if let (Measure::Bare, Measure::Of(unit)) = (&number.unit, &quantity.unit)
                && units::is_dimensionless(unit)
                && units::conversion(&Unit::one(), unit).is_some_and(|(factor, _)| factor != 1.0)
            {
                let x = self.exprs.as_const(number.expr);
                self.ledger.report(units::bare_beside(x, unit, span));
            }
        }
    }

    /// The hint for a literal number that lacks its unit.
    pub(in crate::elaborate) fn with_literal(&self, d: Diagnostic, (a, ua): (&Value, &Unit), (b, ub): (&Value, &Unit)) -> Diagnostic {
        for (number, other) in [(b, ua), (a, ub)] {
            if let (Measure::Bare, Some(x)) = (&number.unit, self.exprs.as_const(number.expr)) {
                return d.help(units::literal(x, other));
            }
        }
        d
    }

    pub(in crate::elaborate) fn product(&mut self, op: BinaryOp, (a, sa): (Value, Span), (b, sb): (Value, Span)) -> Value {
        for (v, s) in [(&a, sa), (&b, sb)] {
            if let Measure::Of(u) = &v.unit
                && units::is_point(u)
            {
                let u = u.clone();
                return self.point_fault(&u, s);
            }
        }
        let f = if op == BinaryOp::Mul { BinaryFn::Mul } else { BinaryFn::Div };
        let expr = self.exprs.binary(f, a.expr, b.expr);
        if matches!(a.unit, Measure::Nothing) || (op == BinaryOp::Mul && matches!(b.unit, Measure::Nothing)) {
            return Value { expr, unit: Measure::Nothing };
        }
        if a.unit.is_plain() && b.unit.is_plain() {
            return Value::bare(expr);
        }
        let (ua, ub) = (a.unit.unit(), b.unit.unit());
        let unit = if op == BinaryOp::Mul { units::times(&ua, &ub) } else { units::over(&ua, &ub) };
        Value::of(expr, unit)
    }

    /// Both values as numbers of the first one's unit (points stay points); reports a clash.
    pub(in crate::elaborate) fn common(&mut self, a: &Value, sa: Span, b: &Value, sb: Span, span: Span) -> Option<(ExprId, ExprId)> {
        self.common_for(a, sa, b, sb, span, "compared")
    }

    /// As [`Self::common`], with the word for what the two are put together for.
    pub(in crate::elaborate) fn common_for(
        &mut self,
        a: &Value,
        sa: Span,
        b: &Value,
        sb: Span,
        span: Span,
        verb: &str,
    ) -> Option<(ExprId, ExprId)> {
        if a.is_poison() || b.is_poison() {
            return None;
        }
        match (&a.unit, &b.unit) {
            (Measure::Truth, Measure::Truth) => {
                self.ledger.report(
                    Diagnostic::error(codes::WRONG_KIND, "conditions are not compared", span).help("combine them with `and`, `or`, `not`"),
                );
                None
            }
            (Measure::Truth, _) | (_, Measure::Truth) => {
                self.ledger.report(Diagnostic::error(codes::WRONG_KIND, "a condition meets a number", span));
                None
            }
            (m, n) if m.is_zero() || n.is_zero() => Some((a.expr, b.expr)),
            (m, n) => {
                let (ua, ub) = (m.unit(), n.unit());
                self.warn_of_scale((a, sa), (b, sb));
                match self.convert(b.expr, &ub, &ua) {
                    Some(r) if units::is_point(&ua) == units::is_point(&ub) => Some((a.expr, r)),
                    _ => {
                        let d = units::clash(&ua, sa, &ub, sb, span, verb);
                        let d = self.with_literal(d, (a, &ua), (b, &ub));
                        self.ledger.report(d);
                        None
                    }
                }
            }
        }
    }

    /// `if c then a else b` on values.
    pub(in crate::elaborate) fn choose(&mut self, c: ExprId, (a, sa): (Value, Span), (b, sb): (Value, Span), span: Span) -> Value {
        if a.is_poison() || b.is_poison() {
            return self.poison();
        }
        if matches!((&a.unit, &b.unit), (Measure::Truth, Measure::Truth)) {
            let expr = self.exprs.select(c, a.expr, b.expr);
            return Value::truth(expr);
        }
        let unit = a.unit.beside(&b.unit);
        let Some((l, r)) = self.common_for(&a, sa, &b, sb, span, "branches of one `if`") else { return self.poison() };
        let expr = self.exprs.select(c, l, r);
        Value { expr, unit }
    }

    /// A function of a dimensionless number.
    pub(in crate::elaborate) fn dimensionless(&mut self, v: &Value, span: Span, function: &str) -> Option<ExprId> {
        match &v.unit {
            Measure::Poison => None,
            Measure::Zero | Measure::Nothing | Measure::Bare => Some(v.expr),
            Measure::Truth => {
                self.ledger.report(Diagnostic::error(codes::WRONG_KIND, format!("`{function}` of a condition"), span));
                None
            }
            Measure::Of(u) => {
                let u = u.clone();
                let converted = self.convert(v.expr, &u, &Unit::one());
                if converted.is_none() {
                    self.ledger.report(
                        Diagnostic::error(
                            codes::NOT_DIMENSIONLESS,
                            format!("`{function}` takes a dimensionless number, this is {}", units::describe(&u)),
                            span,
                        )
                        .label(units::describe(&u))
                        .help("divide by a reference of the same dimension"),
                    );
                }
                converted
            }
        }
    }

    /// The number of one unit as the number of another one; `None` where the dimensions differ.
    pub(in crate::elaborate) fn convert(&mut self, e: ExprId, from: &Unit, to: &Unit) -> Option<ExprId> {
        let (factor, offset) = units::conversion(from, to)?;
        let mut e = e;
        if factor != 1.0 {
            let f = self.exprs.constant(factor);
            e = self.exprs.mul(e, f);
        }
        if offset != 0.0 {
            let o = self.exprs.constant(offset);
            e = self.exprs.add(e, o);
        }
        Some(e)
    }
}
