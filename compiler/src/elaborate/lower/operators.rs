//! Operators: arithmetic with units, comparisons, choices.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, UnaryOp};
use smpl_dsl::units::Unit;

use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, defaults, phases, units};
use crate::elaborate::symbols::Symbols;
use crate::ir::{BinaryFn, Compare, Expr as Node};
pub(in crate::elaborate) fn unary(l: &mut Lowering<'_, '_>, op: UnaryOp, a: &Expr, place: &Place) -> Value {
    if op == UnaryOp::Not {
        let Some(c) = l.sound_condition(a, place) else { return l.poison() };
        let expr = l.exprs.not(c);
        return Value::truth(expr);
    }
    let v = l.value(a, place);
    if op == UnaryOp::Plus || v.is_poison() {
        return v;
    }
    match &v.unit {
        Measure::Truth => l.fault(Diagnostic::error(codes::WRONG_KIND, "the negative of a condition", a.span).help("write `not`")),
        // A literal -5 in a declaration of degC is a number, but the negative of a temperature
        // means nothing.
        Measure::Of(unit) if units::is_point(unit) && !matches!(a.kind, ExprKind::Number { .. }) => {
            let unit = unit.clone();
            l.values().point_fault(&unit, a.span)
        }
        unit => {
            let unit = unit.clone();
            let expr = l.exprs.neg(v.expr);
            Value { expr, unit }
        }
    }
}

pub(in crate::elaborate) fn binary(l: &mut Lowering<'_, '_>, span: Span, op: BinaryOp, a: &Expr, b: &Expr, place: &Place) -> Value {
    match op {
        BinaryOp::And | BinaryOp::Or => {
            let (x, y) = (l.sound_condition(a, place), l.sound_condition(b, place));
            let (Some(x), Some(y)) = (x, y) else { return l.poison() };
            let expr = if op == BinaryOp::And { l.exprs.and(x, y) } else { l.exprs.or(x, y) };
            Value::truth(expr)
        }
        BinaryOp::Lt | BinaryOp::Le | BinaryOp::Gt | BinaryOp::Ge | BinaryOp::Eq | BinaryOp::Ne => comparison(l, span, op, a, b, place),
        BinaryOp::Div if l.symbols.is_rate_slip(a, b, place) => {
            let what = match &a.kind {
                ExprKind::Name(name) => name.text.strip_prefix('d').unwrap_or_default().to_owned(),
                ExprKind::Call { arguments, .. } => arguments.first().map(crate::elaborate::select::items::reference).unwrap_or_default(),
                _ => String::new(),
            };
            l.fault(
                Diagnostic::error(codes::UNKNOWN_NAME, "neither part of this quotient is declared", span)
                    .label("intended as a rate?")
                    .help(format!("a rate is written `d/dt {what}`")),
            )
        }
        _ => {
            let (x, y) = (l.value(a, place), l.value(b, place));
            if op == BinaryOp::Pow && matches!(b.kind, ExprKind::As(..)) && has_dimension(&y) {
                let text = "`as` belongs to the exponent here, which must be dimensionless";
                let help = "put the power in parentheses: `(a^b) as [unit]`";
                return l.fault(Diagnostic::error(codes::NOT_DIMENSIONLESS, text, b.span).help(help));
            }
            arithmetic(l, op, (x, a.span), (y, b.span), span)
        }
    }
}

/// Returns whether a value has a unit with a dimension.
fn has_dimension(v: &Value) -> bool {
    matches!(&v.unit, Measure::Of(unit) if !units::is_dimensionless(unit))
}

/// `a + b` and so on, on values.
pub(in crate::elaborate) fn arithmetic(l: &mut Lowering<'_, '_>, op: BinaryOp, a: (Value, Span), b: (Value, Span), span: Span) -> Value {
    if a.0.is_poison() || b.0.is_poison() {
        return l.poison();
    }
    for (v, s) in [&a, &b] {
        if matches!(v.unit, Measure::Truth) {
            return l
                .fault(Diagnostic::error(codes::WRONG_KIND, "arithmetic with a condition", *s).help("write `if condition then 1 else 0`"));
        }
    }
    match op {
        BinaryOp::Add | BinaryOp::Sub => l.values().sum(op, a, b, span),
        BinaryOp::Mul | BinaryOp::Div => l.values().product(op, a, b),
        _ => power(l, a, b),
    }
}

fn power(l: &mut Lowering<'_, '_>, (a, sa): (Value, Span), (b, sb): (Value, Span)) -> Value {
    let exponent = match &b.unit {
        Measure::Of(u) => {
            let u = u.clone();
            match l.values().convert(b.expr, &u, &Unit::one()) {
                Some(e) => e,
                None => {
                    return l.fault(
                        Diagnostic::error(codes::NOT_DIMENSIONLESS, "an exponent must be dimensionless", sb).label(units::describe(&u)),
                    );
                }
            }
        }
        _ => b.expr,
    };
    // Powers of whole numbers are products.
    if l.exprs.free(exponent) != 0 {
        l.ledger.speculation.refuse();
    }
    let unit = match &a.unit {
        Measure::Of(u) if units::is_point(u) => {
            let u = u.clone();
            return l.values().point_fault(&u, sa);
        }
        Measure::Of(u) if !units::is_dimensionless(u) => {
            let u = u.clone();
            let power = defaults::constant_value(l, exponent).and_then(|x| units::power(&u, x));
            match power {
                Some(unit) => Measure::Of(unit),
                None => {
                    return l.fault(
                        Diagnostic::error(codes::NOT_DIMENSIONLESS, "only a simple constant power of a quantity has a unit", sa)
                            .label(units::describe(&u))
                            .secondary(sb, "this exponent is neither a simple fraction nor a number of at most six decimals")
                            .help("divide the base by a reference of its unit, or take the unit off: `value(x)^p`"),
                    );
                }
            }
        }
        Measure::Of(u) => {
            let u = u.clone();
            let base = l.values().convert(a.expr, &u, &Unit::one()).unwrap_or(a.expr);
            let expr = l.exprs.binary(BinaryFn::Pow, base, exponent);
            return Value::of(expr, Unit::one());
        }
        m => m.clone(),
    };
    let unit = match unit {
        // A power with a quantity in its exponent is a dimensionless quantity.
        Measure::Zero | Measure::Bare if matches!(b.unit, Measure::Of(_)) => Measure::Of(Unit::one()),
        Measure::Zero => Measure::Bare,
        unit => unit,
    };
    let expr = l.exprs.binary(BinaryFn::Pow, a.expr, exponent);
    Value { expr, unit }
}

fn comparison(l: &mut Lowering<'_, '_>, span: Span, op: BinaryOp, a: &Expr, b: &Expr, place: &Place) -> Value {
    if let Some(v) = phases::phase_comparison(l, a, b, place) {
        return match op {
            BinaryOp::Eq => v,
            BinaryOp::Ne if v.is_poison() => v,
            BinaryOp::Ne => Value::truth(l.exprs.not(v.expr)),
            _ => l.fault(Diagnostic::error(codes::WRONG_KIND, "phases have no order; compare with `==` or `!=`", span)),
        };
    }
    if let Some(equal) = l.naming().name_comparison(a, b, place) {
        return match (op, equal) {
            (_, None) => l.poison(),
            (BinaryOp::Eq, Some(equal)) => Value::truth(l.exprs.truth(equal)),
            (BinaryOp::Ne, Some(equal)) => Value::truth(l.exprs.truth(!equal)),
            _ => l.fault(Diagnostic::error(codes::WRONG_KIND, "names have no order; compare with `==` or `!=`", span)),
        };
    }
    if let Some(holds) = l.run_comparison(op, a, b, place) {
        return Value::truth(l.exprs.truth(holds));
    }
    let (x, y) = (l.value(a, place), l.value(b, place));
    let Some((left, right)) = l.values().common(&x, a.span, &y, b.span, span) else { return l.poison() };
    let expr = match op {
        BinaryOp::Lt => l.exprs.compare(Compare::Lt, left, right),
        BinaryOp::Le => l.exprs.compare(Compare::Le, left, right),
        BinaryOp::Gt => l.exprs.compare(Compare::Lt, right, left),
        BinaryOp::Ge => l.exprs.compare(Compare::Le, right, left),
        BinaryOp::Eq => l.exprs.compare(Compare::Eq, left, right),
        _ => l.exprs.compare(Compare::Ne, left, right),
    };
    Value::truth(expr)
}

/// `if c then a else b`, with the way to elaborate a branch.
pub(in crate::elaborate) fn conditional_of<'m, 'a>(
    l: &mut Lowering<'m, 'a>,
    span: Span,
    c: &Expr,
    (a, b): (&Expr, &Expr),
    place: &Place,
    branch: &mut dyn FnMut(&mut Lowering<'m, 'a>, &Expr) -> Value,
) -> Value {
    let Some(condition) = l.sound_condition(c, place) else {
        // The branches may have their own faults.
        branch(l, a);
        branch(l, b);
        return l.poison();
    };
    // What the compiler can decide is decided: the other branch need not even have a meaning here.
    if let Node::Truth(holds) = l.exprs.node(condition) {
        return branch(l, if holds { a } else { b });
    }
    let (x, y) = (branch(l, a), branch(l, b));
    l.values().choose(condition, (x, a.span), (y, b.span), span)
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
