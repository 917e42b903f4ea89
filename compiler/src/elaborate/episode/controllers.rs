//! Controllers: `control u from y setpoint r gain K reset T every 3 [s]`.
//!
//! A controller is a PI controller in velocity form. At its instants the output moves by
//! `K*(e - e_last + e*interval/T)` with the error `e = r - y`, and stays within its limits. It
//! remembers the last error only. The integral is the output itself: it cannot wind up, and a start
//! or a return from `manual` does not make the output jump.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Control, Expr, ExprKind, Ident};
use smpl_dsl::units::Unit;

use crate::elaborate::episode::assignments::{Assignments, Setter, check_next};
use crate::elaborate::episode::common::store;
use crate::elaborate::episode::parameters::limits;
use crate::elaborate::episode::regular;
use crate::elaborate::episode::together::{Assignment, AssignmentKind, Draft};
use crate::elaborate::hidden::element;
use crate::elaborate::lower::place::{Bound, Place, Site};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, boxes, defaults, nests, units};
use crate::elaborate::symbols::{ScopeId, SymbolKind};
use crate::ir::{Affine, BinaryFn, Compare, ExprId, Flavour, Place as Memory, VarId};

/// Name under which a gain meets the error that it multiplies; no text can contain it.
const ERROR: &str = "the error";

/// Output of a controller at one place.
struct Controlled {
    output: (VarId, Affine),
    value: ExprId,
    memory: (VarId, Affine),
    error: ExprId,
}

/// Adds the assignments of a controller to those of regular instants.
pub(super) fn controller(
    l: &mut Lowering<'_, '_>,
    (scope, span): (ScopeId, Span),
    control: &Control,
    draft: &mut Draft,
    assignments: &mut Assignments,
) {
    let place = Place::new(scope, Site::Instant);
    let pieces = nests::nest(l, &control.binders, &place, &mut |s, inner| controlled(s, control, inner));
    for piece in pieces {
        let Some(Controlled { output: (var, at), value, memory, error }) = piece.value else { continue };
        check_next(l, assignments, (scope, "every"), var, (&piece.extents, at), (span, Setter::Control));
        for (var, at, value) in [(var, at, value), (memory.0, memory.1, error)] {
            let store = store(Memory::Var(var), at, value);
            draft.push(l, span, AssignmentKind::Next, Assignment { extents: piece.extents.clone(), store });
        }
    }
}

fn controlled(l: &mut Lowering<'_, '_>, control: &Control, place: &Place) -> Option<Controlled> {
    let (symbol, at) = boxes::target(l, &control.output, place, &[crate::ir::Role::Discrete])?;
    let SymbolKind::Variable { var, unit, .. } = l.symbols[symbol].kind.clone() else { return None };
    let Some(at) = at else {
        let message = format!("a controller sets one number, `{}` is an array", l.symbols[symbol].path);
        let help = "name an element, or write `control u[k] from y[k] ... for k in set`";
        l.ledger.report(Diagnostic::error(codes::WRONG_SHAPE, message, control.output.span).help(help));
        return None;
    };
    let number = regular::interval(l, &control.every, place)?;
    let due = regular::due(l, &control.every, place)?;
    let interval = l.hidden.regular.as_ref()?.intervals[number];
    let error = l.value(&binary(BinaryOp::Sub, &control.setpoint, control.measured.clone()), place);
    if error.is_poison() || is_truth(l, &error, control) {
        return None;
    }
    let memory = memory(l, place)?;
    let last = l.exprs.load(memory.0, Flavour::Value, memory.1);
    let change = change(l, control, (&error, last), interval, place)?;
    let moved = moved(l, control, change, &unit, place)?;
    let present = l.exprs.load(var, Flavour::Value, at);
    let sum = l.exprs.add(present, moved);
    let automatic = limited(l, control, sum, (var, at), &unit, place);
    let value = match &control.manual {
        None => automatic,
        Some((value, condition)) => {
            let holds = l.condition(condition, place);
            let manual = value.as_ref().map_or(present, |v| l.number_in(v, &unit, "the manual output", v.span, place));
            l.exprs.select(holds, manual, automatic)
        }
    };
    let value = l.exprs.select(due, value, present);
    let error = l.exprs.select(due, error.expr, last);
    Some(Controlled { output: (var, at), value, memory, error })
}

/// Reports an error that is a condition.
fn is_truth(l: &mut Lowering<'_, '_>, error: &Value, control: &Control) -> bool {
    let truth = matches!(error.unit, Measure::Truth);
    if truth {
        let message = "a controller follows a number, this is a condition";
        l.ledger.report(Diagnostic::error(codes::WRONG_KIND, message, control.measured.span));
    }
    truth
}

/// A place for the last error of one controller, or of those in the loops around.
fn memory(l: &mut Lowering<'_, '_>, place: &Place) -> Option<(VarId, Affine)> {
    let extents: Vec<u32> = (0..usize::from(place.depth)).map(|d| l.loops.frames.get(d).map_or(1, |frame| frame.passes as u32)).collect();
    let count = extents.iter().product::<u32>();
    let errors = &mut l.hidden.regular.as_mut()?.errors;
    let first = i64::from(errors.len);
    errors.len += count;
    Some((errors.var, element(&extents).plus(Affine::constant(first))))
}

/// Change of the error since the last instant, with the part that it makes over the interval: what
/// the gain multiplies.
fn change(l: &mut Lowering<'_, '_>, control: &Control, (error, last): (&Value, ExprId), interval: f64, place: &Place) -> Option<Value> {
    let never = l.exprs.constant(f64::INFINITY);
    let began = l.exprs.compare(Compare::Lt, last, never);
    let before = l.exprs.select(began, last, error.expr);
    let mut change = l.exprs.sub(error.expr, before);
    if let Some(reset) = &control.reset {
        let value = l.value(reset, place);
        if value.is_poison() {
            return None;
        }
        let endless = l.exprs.as_const(value.expr) == Some(f64::INFINITY);
        let unit = l.symbols.time_unit.clone();
        let time = if endless { value.expr } else { l.values().strictly_in(value, &unit, reset.span, "the reset time", Span::default()) };
        if let Some(x) = defaults::constant_value(l, time).filter(|x| x.is_nan() || *x <= 0.0) {
            let fault = Diagnostic::error(codes::BAD_SETTING, format!("the reset time must be above zero, not {x}"), reset.span);
            l.ledger.report(fault.help("leave `reset` out, or write `reset inf`, for a proportional controller"));
            return None;
        }
        let interval = l.exprs.constant(interval);
        let share = l.exprs.div(interval, time);
        let integral = l.exprs.mul(error.expr, share);
        change = l.exprs.add(change, integral);
    }
    Some(Value { expr: change, unit: error.unit.clone() })
}

/// By how much the output moves, in the unit of its differences.
fn moved(l: &mut Lowering<'_, '_>, control: &Control, change: Value, unit: &Unit, place: &Place) -> Option<ExprId> {
    let name = Ident { text: ERROR.to_owned(), span: control.gain.span };
    let product = binary(BinaryOp::Mul, &control.gain, Expr { span: control.gain.span, kind: ExprKind::Name(name) });
    let (of_error, of_output) = (change.unit.unit(), units::difference(unit));
    let value = l.value(&product, &place.bind(ERROR, Bound::Value(change)));
    if value.is_poison() {
        return None;
    }
    let of_product = value.unit.unit();
    let (expr, convertible) = match l.values().convert(value.expr, &of_product, &of_output) {
        Some(expr) => (expr, true),
        None => (value.expr, value.unit.is_zero()),
    };
    if !convertible {
        let message = format!("the gain times the error is {}, the output {}", units::describe(&of_product), units::describe(&of_output));
        let help = format!("give the gain in the unit of the output over that of the error: `{of_output}` over `{of_error}`");
        l.ledger.report(Diagnostic::error(codes::UNIT_MISMATCH, message, control.gain.span).help(help));
        return None;
    }
    Some(expr)
}

/// A value within the limits of the controller, or the bounds of its output.
fn limited(l: &mut Lowering<'_, '_>, control: &Control, value: ExprId, (var, at): (VarId, Affine), unit: &Unit, place: &Place) -> ExprId {
    let (low, high) = match &control.limits {
        Some((low, high)) => {
            limits(l, (low, high), unit, place, "the form is `limits low..high`; a bare number is in the unit of the output")
        }
        None => {
            let Some((low, high)) = l.quantities.get(&var).map(|q| (q.low.clone(), q.high.clone())) else { return value };
            let mut bound = |list: &[f64]| match list {
                [x] => l.exprs.constant(*x),
                list => l.exprs.entry_at(list, at),
            };
            (bound(&low), bound(&high))
        }
    };
    let above = l.exprs.binary(BinaryFn::Max, value, low);
    l.exprs.binary(BinaryFn::Min, above, high)
}

fn binary(op: BinaryOp, left: &Expr, right: Expr) -> Expr {
    let span = left.span;
    Expr { span, kind: ExprKind::Binary(op, Box::new(left.clone()), Box::new(right)) }
}
