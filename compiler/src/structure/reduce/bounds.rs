//! Test for zero by declared bounds.

use crate::ir::{Affine, BinaryFn, Expr, ExprId, FastMap, Flavour, Role, UnaryFn, VarId};
use crate::model::{Model, Quantity};

/// Least and greatest value.
type Span = (f64, f64);

const ANY: Span = (f64::NEG_INFINITY, f64::INFINITY);

/// Returns `true` if the declared bounds keep an expression from being zero.
pub(super) fn cannot_vanish(model: &Model, e: ExprId) -> bool {
    let mut known: FastMap<ExprId, Span> = FastMap::default();
    for node in model.exprs.below_in_order([e]) {
        let span = span(model, node, &known);
        known.insert(node, if span.0.is_nan() || span.1.is_nan() { ANY } else { span });
    }
    known.get(&e).is_some_and(|&(low, high)| low > 0.0 || high < 0.0)
}

fn span(model: &Model, e: ExprId, known: &FastMap<ExprId, Span>) -> Span {
    let of = |e: ExprId| known.get(&e).copied().unwrap_or(ANY);
    match model.exprs.node(e) {
        Expr::Const(bits) => (f64::from_bits(bits), f64::from_bits(bits)),
        Expr::Load { var, flavour: Flavour::Value, at } => declared(model, var, at),
        Expr::Unary(UnaryFn::Neg, a) => (-of(a).1, -of(a).0),
        Expr::Unary(UnaryFn::Exp, a) => (of(a).0.exp().max(f64::MIN_POSITIVE), of(a).1.exp()),
        Expr::Unary(UnaryFn::Sqrt, a) => (of(a).0.max(0.0).sqrt(), of(a).1.max(0.0).sqrt()),
        Expr::Binary(BinaryFn::Add, a, b) => (of(a).0 + of(b).0, of(a).1 + of(b).1),
        Expr::Binary(BinaryFn::Sub, a, b) => (of(a).0 - of(b).1, of(a).1 - of(b).0),
        Expr::Binary(BinaryFn::Mul, a, b) => products(of(a), of(b)),
        Expr::Binary(BinaryFn::Div, a, b) if of(b).0 > 0.0 || of(b).1 < 0.0 => products(of(a), (1.0 / of(b).1, 1.0 / of(b).0)),
        Expr::PowInt(a, n) if of(a).0 > 0.0 => {
            let (x, y) = (of(a).0.powi(n), of(a).1.powi(n));
            (x.min(y), x.max(y))
        }
        _ => ANY,
    }
}

fn products(a: Span, b: Span) -> Span {
    // Zero times infinity is zero here: a bound that is met times one that is not.
    let times = |x: f64, y: f64| if x == 0.0 || y == 0.0 { 0.0 } else { x * y };
    let all = [times(a.0, b.0), times(a.0, b.1), times(a.1, b.0), times(a.1, b.1)];
    (all.into_iter().fold(f64::INFINITY, f64::min), all.into_iter().fold(f64::NEG_INFINITY, f64::max))
}

/// The bounds of an element, in a loop of all elements; a parameter without bounds has the sign of
/// its declared value.
fn declared(model: &Model, var: VarId, at: Affine) -> Span {
    let q = &model.interface.quantities;
    let all = [&q.states, &q.algebraics, &q.parameters, &q.actions, &q.discretes, &q.disturbances];
    let Some(quantity) = all.into_iter().flatten().find(|q| q.var == Some(var)) else { return ANY };
    if at.is_constant() {
        return declared_of(model, quantity, var, at.offset.max(0) as usize);
    }
    let each = (0..quantity.len()).map(|i| declared_of(model, quantity, var, i));
    each.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or(ANY)
}

fn declared_of(model: &Model, quantity: &Quantity, var: VarId, element: usize) -> Span {
    let pick = |list: &[f64]| Quantity::pick(list, element);
    let (low, high, value) = (pick(&quantity.low), pick(&quantity.high), pick(&quantity.default));
    let open = low == f64::NEG_INFINITY && high == f64::INFINITY;
    match model.vars[var].role {
        Role::Param if open && value > 0.0 => (f64::MIN_POSITIVE, f64::INFINITY),
        Role::Param if open && value < 0.0 => (f64::NEG_INFINITY, -f64::MIN_POSITIVE),
        _ => (low, high),
    }
}
