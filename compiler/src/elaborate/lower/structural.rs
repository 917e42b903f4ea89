//! Numbers that the compiler itself evaluates: sizes, indices, ends of ranges, sampling intervals.
//! All of them are read here, with their units.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, UnaryOp};
use smpl_dsl::units::Unit;

use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, defaults, units};
use crate::ir::ExprId;

/// Largest whole number, exclusive.
const LARGEST: f64 = 1e15;

/// Distance to a whole number, relative to it or to 1, that counts as rounding.
const ROUNDING: f64 = 1e-9;

/// A number that the compiler cannot use.
enum Unusable {
    /// A fault inside of the expression, which was reported.
    Reported,
    /// A fault of the number.
    Fault(Box<Diagnostic>),
}

/// The nearest whole number, where the difference is a rounding error: `2 [m] / 1 [cm]` is 200.
pub(in crate::elaborate) fn whole(x: f64) -> Option<i64> {
    let nearest = x.round();
    ((x - nearest).abs() <= ROUNDING * nearest.abs().max(1.0) && nearest.abs() < LARGEST).then_some(nearest as i64)
}

/// A whole number known to the compiler.
pub(in crate::elaborate) fn integer(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Option<i64> {
    if let Some(n) = literal(e) {
        return Some(n);
    }
    let v = l.value(e, place);
    let x = number_or_fault(l, &v, e.span)?;
    let fault = match whole(x) {
        Some(n) => return Some(n),
        // The number is that of a sample, which need not be whole.
        None if l.instances.samples.taken() && x.abs() < 1e6 => return Some(x.round() as i64),
        None if x.abs() >= LARGEST => Diagnostic::error(codes::TOO_LARGE, "a whole number below 1e15 is needed here", e.span),
        None => Diagnostic::error(codes::WRONG_KIND, format!("a whole number is needed here, this is {x}"), e.span),
    };
    l.ledger.report(fault);
    None
}

/// A whole number where one may be; faults of its value are not reported.
pub(in crate::elaborate) fn integer_quietly(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Option<i64> {
    if let Some(n) = literal(e) {
        return Some(n);
    }
    let v = l.value(e, place);
    whole(number(l, &v, e.span).ok()?)
}

/// A whole number that cannot change: of numbers, and of parameters that give sizes and indices.
pub(in crate::elaborate) fn settled(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Option<i64> {
    if let Some(n) = literal(e) {
        return Some(n);
    }
    let v = l.value(e, place);
    let expr = pure(l, &v, e.span).ok()?;
    let fixed = l.symbols.parameters_in(l.exprs, expr).iter().all(|(var, _)| l.constants.is_structural(*var));
    let x = defaults::constant_value(l, expr).filter(|_| fixed)?;
    whole(x)
}

/// A number of steps: a whole number, or a time that is a multiple of the step.
pub(in crate::elaborate) fn steps(l: &mut Lowering<'_, '_>, e: &Expr, what: &str, place: &Place) -> Option<i64> {
    if let Some(n) = literal(e) {
        return Some(n);
    }
    let v = l.value(e, place);
    let (time, step) = (l.symbols.time_unit.clone(), l.names.step);
    let Measure::Of(unit) = &v.unit else { return integer(l, e, place) };
    let unit = unit.clone();
    if units::is_dimensionless(&unit) {
        return integer(l, e, place);
    }
    let Some(expr) = l.values().convert(v.expr, &unit, &time) else {
        let message = format!("`{what}` takes a number of steps or a time, this is {}", units::describe(&unit));
        l.ledger.report(Diagnostic::error(codes::UNIT_MISMATCH, message, e.span).label(units::describe(&unit)));
        return None;
    };
    let x = number_or_fault(l, &Value::bare(expr), e.span)?;
    let n = whole(x / step);
    if n.is_none() {
        let steps = (x / step).round().max(1.0);
        let message = format!("`{what}` is not a multiple of the step: {x} [{time}] is {} steps of {step} [{time}]", rounded(x / step));
        let help = format!("give a multiple, as `{} [{time}]`, or a number of steps", rounded(steps * step));
        l.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, e.span).help(help));
    }
    n
}

/// The whole number that is written, without a unit.
fn literal(e: &Expr) -> Option<i64> {
    match &e.kind {
        ExprKind::Number { value, unit: None } if value.fract() == 0.0 && value.abs() < LARGEST => Some(*value as i64),
        ExprKind::Unary(UnaryOp::Neg, a) => Some(-literal(a)?),
        ExprKind::Binary(op, a, b) => {
            let (a, b) = (literal(a)?, literal(b)?);
            match op {
                BinaryOp::Add => a.checked_add(b),
                BinaryOp::Sub => a.checked_sub(b),
                BinaryOp::Mul => a.checked_mul(b),
                BinaryOp::Div if b != 0 && a % b == 0 => Some(a / b),
                _ => None,
            }
        }
        _ => None,
    }
}

/// The number of a value, or its fault, reported.
fn number_or_fault(l: &mut Lowering<'_, '_>, v: &Value, span: Span) -> Option<f64> {
    match number(l, v, span) {
        Ok(x) => Some(x),
        Err(Unusable::Reported) => None,
        Err(Unusable::Fault(fault)) => {
            l.ledger.report(*fault);
            None
        }
    }
}

/// The number of a value that sizes and indices are computed from; its parameters keep their
/// numbers.
fn number(l: &mut Lowering<'_, '_>, v: &Value, span: Span) -> Result<f64, Unusable> {
    let expr = pure(l, v, span)?;
    let Some(x) = defaults::constant_value(l, expr) else {
        let fault = Diagnostic::error(codes::WRONG_KIND, "a whole number known to the compiler is needed here", span)
            .label("changes while the model runs")
            .help("use numbers and parameters that are computed from numbers");
        return Err(Unusable::Fault(Box::new(fault)));
    };
    defaults::mark_structural(l, expr);
    Ok(x)
}

/// A value as a pure number: `400 %` is 4, and a quantity is refused.
fn pure(l: &mut Lowering<'_, '_>, v: &Value, span: Span) -> Result<ExprId, Unusable> {
    let fault = match &v.unit {
        Measure::Poison => return Err(Unusable::Reported),
        Measure::Zero | Measure::Bare | Measure::Nothing => return Ok(v.expr),
        Measure::Truth => Diagnostic::error(codes::WRONG_KIND, "a whole number is needed here, this is a condition", span),
        Measure::Of(unit) => {
            let unit = unit.clone();
            if let Some(expr) = l.values().convert(v.expr, &unit, &Unit::one()) {
                return Ok(expr);
            }
            let message = format!("a whole number is needed here, this is {}", units::describe(&unit));
            let fault = Diagnostic::error(codes::NOT_DIMENSIONLESS, message, span).label(units::describe(&unit));
            fault.help(format!("divide it by the size of one, for example `x / 1 [{unit}]`"))
        }
    };
    Err(Unusable::Fault(Box::new(fault)))
}

/// A number with the digits that a message shows.
fn rounded(x: f64) -> f64 {
    format!("{x:.6e}").parse().unwrap_or(x)
}
