//! Conditions that end or cost something, and boxes.

use smpl_dsl::syntax::{Expr, ExprKind};

use crate::elaborate::episode::amounts::amount;
use crate::elaborate::episode::common::Condition;
use crate::elaborate::episode::unknown::doubting;
use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::value::Measure;
use crate::elaborate::lower::{Lowering, boxes};
use crate::ir::BinaryFn;

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
        // A member that is not a number is outside.
        let unknown = l.exprs.truth(false);
        return Condition { holds, unknown, excess, items };
    }
    let holds = l.condition(e, place);
    let amount = amount(l, e, place);
    let excess = match amount.unit {
        Measure::Truth => l.exprs.constant(1.0),
        _ => l.exprs.binary(BinaryFn::Max, amount.expr, zero),
    };
    let excess = l.exprs.select(holds, excess, zero);
    let unknown = doubting(l).unknown(holds);
    Condition { holds, unknown, excess, items: Vec::new() }
}
