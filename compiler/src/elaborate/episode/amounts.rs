//! By how much a condition holds: what a constraint costs, and the violation of a failure.

use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, UnaryOp};

use crate::elaborate::episode::unknown::doubting;
use crate::elaborate::lower::builtins::{self, Over};
use crate::elaborate::lower::place::{Place, Target};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, boxes, defaults, expression, paths};
use crate::ir::{BinaryFn, ExprId, ReduceFn};
use crate::model::Quantity;

/// By how much a condition holds, relative to a range; negative where it does not. Of a flag,
/// `phase == heat`, which holds or does not, it is the truth value itself.
pub(in crate::elaborate) fn amount(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Value {
    let found = match &e.kind {
        ExprKind::Binary(op @ (BinaryOp::And | BinaryOp::Or), a, b) => {
            let (x, y) = (amount(l, a, place), amount(l, b, place));
            Some(both(l, &x, &y, *op == BinaryOp::And))
        }
        ExprKind::Binary(op @ (BinaryOp::Lt | BinaryOp::Le | BinaryOp::Gt | BinaryOp::Ge), a, b) => compared(l, *op, a, b, place),
        ExprKind::Unary(UnaryOp::Not, a) => {
            let held = amount(l, a, place);
            Some(opposite(l, &held))
        }
        ExprKind::Call { function, arguments } => of_box(l, &function.text, arguments, place),
        ExprKind::Reduce { function, .. } => match builtins::find(&function.text).and_then(|b| b.over) {
            Some(Over::Any) => over(l, e, true, place),
            Some(Over::All) => over(l, e, false, place),
            _ => None,
        },
        ExprKind::Name(_) | ExprKind::Member(..) | ExprKind::Index(..) => named(l, e, place),
        _ => None,
    };
    found.unwrap_or_else(|| l.value(e, place))
}

/// Of `and` the least amount, of `or` the greatest. A flag does not reduce the amounts of other
/// conditions, and counts 1 if it alone decides.
fn both(l: &mut Lowering<'_, '_>, x: &Value, y: &Value, is_and: bool) -> Value {
    let (flag, number) = match (&x.unit, &y.unit) {
        (Measure::Truth, Measure::Truth) => {
            return Value::truth(if is_and { l.exprs.and(x.expr, y.expr) } else { l.exprs.or(x.expr, y.expr) });
        }
        (Measure::Truth, _) => (x.expr, y.expr),
        (_, Measure::Truth) => (y.expr, x.expr),
        _ => return Value::bare(extremum(l, x.expr, y.expr, is_and)),
    };
    let one = l.exprs.constant(if is_and { -1.0 } else { 1.0 });
    let decided = l.exprs.binary(if is_and { BinaryFn::Min } else { BinaryFn::Max }, number, one);
    Value::bare(if is_and { l.exprs.select(flag, number, decided) } else { l.exprs.select(flag, decided, number) })
}

/// The least or greatest of two amounts. NaN leaves the decision to the other: the knowledge of the
/// whole is tested elsewhere.
fn extremum(l: &mut Lowering<'_, '_>, x: ExprId, y: ExprId, least: bool) -> ExprId {
    let mut value = l.exprs.binary(if least { BinaryFn::Min } else { BinaryFn::Max }, x, y);
    for (side, other) in [(x, y), (y, x)] {
        if let Some(number) = doubting(l).number(side) {
            value = l.exprs.select(number, value, other);
        }
    }
    value
}

fn opposite(l: &mut Lowering<'_, '_>, held: &Value) -> Value {
    match held.unit {
        Measure::Truth => Value::truth(l.exprs.not(held.expr)),
        _ => Value::bare(l.exprs.neg(held.expr)),
    }
}

/// `outside bounds(...)`: the largest excess.
fn of_box(l: &mut Lowering<'_, '_>, function: &str, arguments: &[Expr], place: &Place) -> Option<Value> {
    let ([inner], "outside" | "inside") = (arguments, function) else { return None };
    let (excess, _) = boxes::box_excess(l, inner, place);
    let outside = Value::bare(excess);
    Some(if function == "inside" { opposite(l, &outside) } else { outside })
}

/// `any`: the greatest amount of those that count, `all`: the least. `None` where all are flags.
fn over(l: &mut Lowering<'_, '_>, e: &Expr, any: bool, place: &Place) -> Option<Value> {
    let ExprKind::Reduce { body, binders, condition, .. } = &e.kind else { return None };
    let op = if any { ReduceFn::Max } else { ReduceFn::Min };
    l.extreme(op, (body, binders, condition.as_deref()), amount, place, &mut |l, value, counts| {
        let mut number = signed(l, value);
        if let Some(known) = doubting(l).number(number) {
            let neutral = l.exprs.constant(op.identity());
            number = l.exprs.select(known, number, neutral);
        }
        let Some(counts) = counts else { return number };
        let flag = Value::truth(if any { counts } else { l.exprs.not(counts) });
        both(l, &flag, &Value::bare(number), any).expr
    })
}

/// A flag as an amount: 1 or -1.
fn signed(l: &mut Lowering<'_, '_>, value: &Value) -> ExprId {
    if !matches!(value.unit, Measure::Truth) {
        return value.expr;
    }
    let (holds, not) = (l.exprs.constant(1.0), l.exprs.constant(-1.0));
    l.exprs.select(value.expr, holds, not)
}

/// A condition with its own name: its expression.
fn named(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Option<Value> {
    let (base, index): (&Expr, &[Expr]) = match &e.kind {
        ExprKind::Index(base, index) => (base, index),
        _ => (e, &[]),
    };
    let Target::Symbol(symbol) = paths::resolve(l, base, place) else { return None };
    expression::read_definition(l, symbol, index, e.span, place, amount)
}

/// By how much a comparison holds, relative to the range of its left side.
fn compared(l: &mut Lowering<'_, '_>, op: BinaryOp, a: &Expr, b: &Expr, place: &Place) -> Option<Value> {
    let (x, y) = (l.value(a, place), l.value(b, place));
    let (left, right) = l.values().common(&x, a.span, &y, b.span, a.span.to(b.span))?;
    let other = defaults::constant_value(l, right).map(f64::abs).filter(|r| *r > 0.0 && r.is_finite());
    let range = range_of(l, left, other.unwrap_or(1.0));
    let difference = if matches!(op, BinaryOp::Lt | BinaryOp::Le) { l.exprs.sub(right, left) } else { l.exprs.sub(left, right) };
    Some(Value::bare(l.exprs.div(difference, range)))
}

/// Width of the declared bounds of a variable that appears alone; without bounds, the other number.
fn range_of(l: &mut Lowering<'_, '_>, e: ExprId, other: f64) -> ExprId {
    if let crate::ir::Expr::Load { var, at, .. } = l.exprs.node(e)
        && let Some(q) = l.quantities.get(&var)
    {
        let width = |i| Quantity::pick(&q.high, i) - Quantity::pick(&q.low, i);
        let or_other = |range: f64| if range.is_finite() && range > 0.0 { range } else { other };
        let ranges: Vec<f64> = (0..q.low.len().max(q.high.len())).map(|i| or_other(width(i))).collect();
        return l.exprs.entry_at(&ranges, at);
    }
    l.exprs.constant(other)
}
