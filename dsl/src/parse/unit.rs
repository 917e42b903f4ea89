//! Units: a product of powers, flattened, with exact exponents.

use pest::iterators::Pair;

use super::{Children, Context, Fallible, Rule, expression};
use crate::diagnostic::{Diagnostic, codes};
use crate::syntax::{Ident, UnitBase, UnitExpr, UnitFactor};
use crate::units::Rational;

/// Largest numerator of an exponent.
const LARGEST: i128 = 1_000_000_000;

/// `: unit` after a declared name, where it was written.
pub(super) fn declared(context: &Context<'_>, children: &mut Children<'_>) -> Fallible<Option<UnitExpr>> {
    children.take(Rule::declared_unit).map(|pair| brackets(context, pair)).transpose()
}

/// `[unit]`, or any rule with one unit in it.
pub(super) fn brackets(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<UnitExpr> {
    let mut children = Children::new(pair);
    unit(context, children.expect(context, Rule::unit)?)
}

/// A unit; `1` has no factors.
pub(super) fn unit(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<UnitExpr> {
    let span = context.span(&pair);
    let mut factors = Vec::new();
    product(context, pair, Rational::ONE, &mut factors)?;
    factors.retain(|factor| !matches!(factor.base, UnitBase::Number(value, _) if value == 1.0));
    Ok(UnitExpr { span, factors })
}

/// Adds the factors of a product, each to the power `outer`.
fn product(context: &Context<'_>, pair: Pair<'_, Rule>, outer: Rational, factors: &mut Vec<UnitFactor>) -> Fallible<()> {
    let mut parts = pair.into_inner().peekable();
    let mut divide = false;
    while let Some(part) = parts.next() {
        if part.as_rule() == Rule::unit_operator {
            divide = part.as_str() == "/";
            continue;
        }
        let mut exponent = if divide { outer.negate() } else { outer };
        divide = false;
        if let Some(power) = parts.next_if(|next| next.as_rule() == Rule::unit_power) {
            exponent = small(exponent.multiply(unit_power(context, power.clone())?)).ok_or_else(|| overflow(context, &power))?;
        }
        factor(context, part, exponent, factors)?;
    }
    Ok(())
}

fn factor(context: &Context<'_>, part: Pair<'_, Rule>, exponent: Rational, factors: &mut Vec<UnitFactor>) -> Fallible<()> {
    let base = match part.as_rule() {
        Rule::unit_group => {
            let mut children = Children::new(part);
            return product(context, children.expect(context, Rule::unit)?, exponent, factors);
        }
        Rule::unit_of => {
            let mut children = Children::new(part);
            UnitBase::Of(Box::new(expression::expr(context, children.expect(context, Rule::expr)?)?))
        }
        Rule::number => UnitBase::Number(expression::number_value(context, &part)?, context.span(&part)),
        _ => UnitBase::Symbol(symbol(context.word(&part))),
    };
    // Exponents are small, see `small`.
    let narrow = |part: i128| i32::try_from(part).unwrap_or_default();
    factors.push(UnitFactor { base, exponent: (narrow(exponent.numerator()), narrow(exponent.denominator())) });
    Ok(())
}

/// Degrees with their sign are those with their word.
fn symbol(word: Ident) -> Ident {
    match word.text.strip_prefix('\u{b0}') {
        Some(scale) => Ident { text: format!("deg{scale}"), ..word },
        None => word,
    }
}

/// `^2`, `^-1`, `^2.5`, `^(5/2)`
fn unit_power(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Rational> {
    let mut parts = pair.clone().into_inner();
    let numerator = parts.next().and_then(|part| decimal(part.as_str()));
    let denominator = parts.next().map_or(Some(Rational::ONE), |part| decimal(part.as_str()));
    let quotient = numerator.zip(denominator).and_then(|(numerator, denominator)| numerator.multiply(denominator.reciprocal()?));
    quotient.ok_or_else(|| overflow(context, &pair))
}

/// An exponent as written, exactly: at most six decimals, and five digits before them.
fn decimal(text: &str) -> Option<Rational> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    if fraction.len() > 6 || whole.len() > 5 {
        return None;
    }
    let digits: i64 = format!("{whole}{fraction}").parse().ok()?;
    Rational::new(digits.into(), 10_i128.pow(u32::try_from(fraction.len()).ok()?))
}

/// An exponent that may be in a unit.
fn small(exponent: Option<Rational>) -> Option<Rational> {
    exponent.filter(|e| e.numerator().abs() <= LARGEST && e.denominator() <= Rational::FINEST)
}

fn overflow(context: &Context<'_>, pair: &Pair<'_, Rule>) -> Box<Diagnostic> {
    let message = "this exponent of a unit cannot be represented";
    Box::new(
        Diagnostic::error(codes::UNIT_OVERFLOW, message, context.span(pair))
            .help("write a small rational number such as `^2.5` or `^(1/3)`"),
    )
}
