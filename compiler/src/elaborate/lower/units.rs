//! Units of measure in conversions and messages: a thin layer over [`smpl_dsl::units`].

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, Ident, UnaryOp, UnitBase, UnitExpr, UnitFactor};
use smpl_dsl::units::{Rational, Unit};

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::value::Measure;

/// Returns `true` if the unit has no dimension (it may have a scale, as `%`).
pub(crate) fn is_dimensionless(unit: &Unit) -> bool {
    unit.dimension().is_none()
}

/// Returns `true` if the unit is that of numbers.
pub(crate) fn is_plain_number(unit: &Unit) -> bool {
    unit.is_one()
}

/// Returns `true` if numbers in the unit are points on a temperature scale.
pub(crate) fn is_point(unit: &Unit) -> bool {
    unit.is_point()
}

/// The unit of differences.
pub(crate) fn difference(unit: &Unit) -> Unit {
    unit.difference()
}

/// Unit of a sum of amounts, in that of the first: known to be a difference of temperatures where
/// both are.
pub(crate) fn sum(a: &Unit, b: &Unit) -> Unit {
    a.between_points(a.is_between_points() && b.is_between_points())
}

/// Product of units; beyond all representable exponents the unit of numbers.
pub(crate) fn times(a: &Unit, b: &Unit) -> Unit {
    a.multiply(b).unwrap_or_else(Unit::one)
}

/// Quotient of units.
pub(crate) fn over(a: &Unit, b: &Unit) -> Unit {
    a.divide(b).unwrap_or_else(Unit::one)
}

/// The unit in which a value is shown if none is declared: a ratio in an unnamed unit (`bar/kPa`)
/// is the number.
pub(crate) fn shown(measure: &Measure) -> Unit {
    let unit = measure.unit();
    if is_dimensionless(&unit) && unit.is_unnamed() { Unit::one() } else { unit }
}

/// Unit of the rate of change.
pub(crate) fn rate(unit: &Unit, time: &Unit) -> Unit {
    over(&difference(unit), time)
}

/// A power with an exponent that is a simple fraction or has at most six decimals.
pub(crate) fn power(unit: &Unit, exponent: f64) -> Option<Unit> {
    unit.power(Rational::exponent(exponent)?)
}

/// Factor and offset from numbers of one unit to numbers of the other; `None` where they measure
/// different things.
pub(crate) fn conversion(from: &Unit, to: &Unit) -> Option<(f64, f64)> {
    if from.is_point() != to.is_point() {
        return None;
    }
    from.conversion_to(to).map(|c| (c.factor, c.offset))
}

/// Dimension of a unit, for messages.
pub(crate) fn describe(unit: &Unit) -> String {
    unit.describe()
}

/// "needs a length [m], this is a time [s]"
pub(crate) fn mismatch(found: &Unit, wanted: &Unit, span: Span, what: &str, declared: Span) -> Diagnostic {
    let mut d = Diagnostic::error(codes::UNIT_MISMATCH, format!("{what} is {}, but this is {}", describe(wanted), describe(found)), span)
        .label(describe(found));
    if declared != Span::default() && declared != span {
        d = d.secondary(declared, describe(wanted));
    }
    d.maybe_help(repair(found, wanted))
}

/// "cannot be added"
pub(crate) fn clash(a: &Unit, sa: Span, b: &Unit, sb: Span, span: Span, verb: &str) -> Diagnostic {
    // What is added to a point on a scale, or taken from it, is a difference.
    let adds = matches!(verb, "added" | "subtracted");
    let of = |unit: &Unit| if adds { difference(unit) } else { unit.clone() };
    let help = if is_dimensionless(a) && !is_dimensionless(b) {
        repair(a, &of(b)).map(|r| r.replace("it by", "the first by"))
    } else {
        repair(b, &if is_dimensionless(b) { of(a) } else { a.clone() }).map(|r| r.replace("it by", "the second by"))
    };
    Diagnostic::error(codes::UNIT_MISMATCH, format!("{} and {} cannot be {verb}", describe(a), describe(b)), span)
        .secondary(sa, describe(a))
        .secondary(sb, describe(b))
        .maybe_help(help)
}

/// A pure number where a quantity is needed: the number with its unit.
pub(crate) fn literal(x: f64, unit: &Unit) -> String {
    format!("give the number its unit: `{x} [{unit}]`")
}

/// A pure number that is taken from a point on a temperature scale.
pub(crate) fn literal_beside_point(x: f64, unit: &Unit) -> String {
    format!(
        "give the number its unit: `{x} [{unit}]` for the difference of two points, `{x} [{}]` for a point lower by it",
        unit.difference()
    )
}

/// Meaning of a number without a unit next to a dimensionless quantity with a scale.
pub(crate) fn bare_beside(number: Option<f64>, unit: &Unit, span: Span) -> Diagnostic {
    let factor = conversion(&Unit::one(), unit).map_or(1.0, |c| c.0);
    let counts = match number {
        Some(x) => format!("{x} without a unit is {} [{unit}]", rounded(x * factor)),
        None => format!("a number without a unit counts {} [{unit}] for one", rounded(factor)),
    };
    let written = number.map_or_else(|| format!("`... as [{unit}]`"), |x| format!("`{x} [{unit}]`"));
    let other = number.map_or_else(|| "`... as [1]`".to_owned(), |x| format!("`{x} [1]`"));
    Diagnostic::warning(codes::BARE_NUMBER, format!("{counts} here"), span)
        .label("next to a quantity in another scale")
        .help(format!("write {written} for that unit, {other} for the pure number"))
}

/// A function of amounts, of a temperature that counts from the zero of a scale.
pub(crate) fn of_a_point(function: &str, span: Span) -> Diagnostic {
    Diagnostic::error(codes::AFFINE_UNIT, format!("`{function}` of a point on a temperature scale"), span)
        .help("use `kelvin(T)`, or a difference of two temperatures")
}

/// A temperature that is known to be a difference, where one that counts from a zero is needed.
pub(crate) fn of_a_difference(function: &str, span: Span) -> Diagnostic {
    Diagnostic::error(codes::AFFINE_UNIT, format!("`{function}` takes a temperature, this is a difference of temperatures"), span)
        .label("counts from no zero")
        .help("a difference is in K already, its number `value(x, K)`; add it to a temperature for another one")
}

/// The number in a unit that arithmetic made.
pub(crate) fn unnamed(function: &str, unit: &Unit, span: Span) -> Diagnostic {
    let say = if function == "value" { "say in which unit: `value(x, unit)`" } else { "divide by what is counted: `x / 1 [unit]`" };
    let message = format!("`{function}` takes a number, and this is {}, a unit that is written nowhere", describe(unit));
    Diagnostic::error(codes::NOT_DIMENSIONLESS, message, span).label(describe(unit)).help(say)
}

/// Rounding of a percentage or the like.
pub(crate) fn rounded_as_number(function: &str, unit: &Unit, span: Span) -> Diagnostic {
    let factor = conversion(unit, &Unit::one()).map_or(1.0, |c| c.0);
    let message = format!("`{function}` rounds the number, and 1 [{unit}] is {} here", rounded(factor));
    Diagnostic::warning(codes::BARE_NUMBER, message, span)
        .label(format!("in {unit}"))
        .help(format!("write `{function}(x / 1 [{unit}]) * 1 [{unit}]` to round in {unit}, `x as [1]` for the number"))
}

/// A number with few digits, for readers.
fn rounded(x: f64) -> f64 {
    format!("{x:.6e}").parse().unwrap_or(x)
}

/// The sides of an equation measure different things.
pub(crate) fn sides(left: &Unit, sl: Span, right: &Unit, sr: Span) -> Diagnostic {
    Diagnostic::error(codes::UNIT_MISMATCH, format!("the left side is {}, the right side is {}", describe(left), describe(right)), sr)
        .label(describe(right))
        .secondary(sl, describe(left))
        .maybe_help(repair(right, left).map(|r| r.replace("it by", "the right side by")))
}

/// Factor from `found` to `wanted`.
fn repair(found: &Unit, wanted: &Unit) -> Option<String> {
    if found.commensurable(wanted) {
        // Same dimension: one of them is a point on a scale.
        return Some(if found.is_between_points() {
            format!("a difference of temperatures is not a point on a scale: give it in K, or add it to a temperature in {wanted}")
        } else if wanted.is_point() {
            format!("a point on a scale is needed: give it in {wanted}, or take `celsius(T)` of an absolute temperature")
        } else {
            "take a difference of two temperatures, or `kelvin(T)`".to_owned()
        });
    }
    if is_dimensionless(found) && !is_plain_number(found) {
        return Some(format!("multiply it by the quantity of which it is a share, in {wanted}"));
    }
    if is_dimensionless(found) {
        return Some(format!("state the unit if the number has one: `... as [{wanted}]`"));
    }
    let missing = over(wanted, &difference(found));
    let inverse = over(&difference(found), wanted);
    let quantity = |u: &Unit| u.dimension().describe();
    if simple(&missing) {
        return Some(format!("multiply it by {} [{missing}]", article(&quantity(&missing))));
    }
    simple(&inverse).then(|| format!("divide it by {} [{inverse}]", article(&quantity(&inverse))))
}

/// A unit of few factors in the numerator only, worth naming in a hint.
fn simple(unit: &Unit) -> bool {
    let text = unit.to_string();
    !text.starts_with("1/") && text.matches([' ', '/']).count() <= 1
}

fn article(what: &str) -> String {
    let article = if what.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" };
    format!("{article} {what}")
}

/// The unit that a text means; reports what is wrong with it.
pub(in crate::elaborate) fn unit(l: &mut Lowering<'_, '_>, written: &UnitExpr, place: &Place) -> Option<Unit> {
    let mut inner_fault = false;
    let result = smpl_dsl::units::resolve(written, &l.symbols.units, &mut |e: &Expr| {
        let v = l.value(e, place);
        inner_fault |= v.is_poison();
        Ok(match v.unit {
            Measure::Of(unit) => unit.difference(),
            _ => Unit::one(),
        })
    });
    match result {
        Ok(_) if inner_fault => None,
        Ok(unit) => Some(unit),
        Err(d) => {
            l.ledger.report(d);
            None
        }
    }
}

/// A unit written as an expression: `value(x, kmol/m^3)`.
pub(in crate::elaborate) fn unit_argument(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Option<Unit> {
    let mut factors = Vec::new();
    if collect(e, 1, &mut factors).is_none() {
        l.ledger.report(Diagnostic::error(codes::UNKNOWN_UNIT, "a unit is needed here", e.span).help("for example `value(T, degC)`"));
        return None;
    }
    unit(l, &UnitExpr { span: e.span, factors }, place)
}

fn collect(e: &Expr, sign: i32, out: &mut Vec<UnitFactor>) -> Option<()> {
    let symbol = |name: &Ident, exponent: (i32, i32)| UnitFactor { base: UnitBase::Symbol(name.clone()), exponent };
    match &e.kind {
        ExprKind::Name(name) => out.push(symbol(name, (sign, 1))),
        ExprKind::Number { value, unit: None } if *value == 1.0 => {}
        ExprKind::Binary(BinaryOp::Mul, a, b) => {
            collect(a, sign, out)?;
            collect(b, sign, out)?;
        }
        ExprKind::Binary(BinaryOp::Div, a, b) => {
            collect(a, sign, out)?;
            collect(b, -sign, out)?;
        }
        ExprKind::Binary(BinaryOp::Pow, a, b) => {
            let (ExprKind::Name(name), Some(n)) = (&a.kind, whole(b)) else { return None };
            out.push(symbol(name, (sign * n, 1)));
        }
        _ => return None,
    }
    Some(())
}

fn whole(e: &Expr) -> Option<i32> {
    match &e.kind {
        ExprKind::Number { value, unit: None } if value.fract() == 0.0 && value.abs() < 100.0 => Some(*value as i32),
        ExprKind::Unary(UnaryOp::Neg, a) => Some(-whole(a)?),
        _ => None,
    }
}
