//! Conditions that end or cost something, and boxes.

use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, UnaryOp};

use crate::elaborate::episode::common::Condition;
use crate::elaborate::episode::unknown::doubting;
use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::{Lowering, boxes, defaults};
use crate::ir::{BinaryFn, ExprId};
use crate::model::Quantity;

/// A failing condition with its violation.
pub(in crate::elaborate) fn failing(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Condition {
    let zero = l.exprs.constant(0.0);
    if let ExprKind::Call { function, arguments } = &e.kind
        && function.text == "outside"
        && let [inner] = arguments.as_slice()
    {
        let (excess, items) = boxes::box_excess(l, inner, place);
        let holds = l.values().beyond(excess);
        let excess = l.exprs.select(holds, excess, zero);
        // A member that is no number is outside.
        let unknown = l.exprs.truth(false);
        return Condition { holds, unknown, excess, items };
    }
    let holds = l.condition(e, place);
    let amount = amount(l, e, place);
    let excess = match amount {
        Some(amount) => l.exprs.binary(BinaryFn::Max, amount, zero),
        None => l.exprs.constant(1.0),
    };
    let excess = l.exprs.select(holds, excess, zero);
    let unknown = doubting(l).unknown(holds);
    Condition { holds, unknown, excess, items: Vec::new() }
}

/// By how much a comparison holds, relative to the range of its left side.
fn amount(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Option<ExprId> {
    let (op, a, b) = match &e.kind {
        ExprKind::Binary(op, a, b) => (op, a, b),
        ExprKind::Unary(UnaryOp::Not, a) => return amount(l, a, place).map(|x| l.exprs.neg(x)),
        _ => return None,
    };
    match op {
        // What has no amount, `phase == heat`, takes none away.
        BinaryOp::And => match (amount(l, a, place), amount(l, b, place)) {
            (Some(x), Some(y)) => Some(l.exprs.binary(BinaryFn::Min, x, y)),
            (x, y) => x.or(y),
        },
        BinaryOp::Or => {
            let (x, y) = (amount(l, a, place)?, amount(l, b, place)?);
            Some(l.exprs.binary(BinaryFn::Max, x, y))
        }
        BinaryOp::Lt | BinaryOp::Le | BinaryOp::Gt | BinaryOp::Ge => {
            let (x, y) = (l.value(a, place), l.value(b, place));
            let (left, right) = l.values().common(&x, a.span, &y, b.span, e.span)?;
            let other = defaults::constant_value(l, right).map(f64::abs).filter(|r| *r > 0.0 && r.is_finite());
            let range = range_of(l, left, other.unwrap_or(1.0));
            let difference = if matches!(op, BinaryOp::Lt | BinaryOp::Le) { l.exprs.sub(right, left) } else { l.exprs.sub(left, right) };
            Some(l.exprs.div(difference, range))
        }
        _ => None,
    }
}

/// Width of the declared bounds of a variable that stands alone; where there is none, the other number.
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
