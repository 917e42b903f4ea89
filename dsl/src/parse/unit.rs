//! Units: a product of powers, flattened, with exact exponents.

use num_rational::Ratio;
use pest::iterators::Pair;

use super::{Children, Context, Fallible, Rule, expression};
use crate::diagnostic::{Diagnostic, codes};
use crate::syntax::{Ident, UnitBase, UnitExpr, UnitFactor};

type Exponent = Ratio<i32>;

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
    product(context, pair, Exponent::ONE, &mut factors)?;
    factors.retain(|factor| !matches!(factor.base, UnitBase::Number(value, _) if value == 1.0));
    Ok(UnitExpr { span, factors })
}

/// Adds the factors of a product, each to the power `outer`.
fn product(context: &Context<'_>, pair: Pair<'_, Rule>, outer: Exponent, factors: &mut Vec<UnitFactor>) -> Fallible<()> {
    let mut parts = pair.into_inner().peekable();
    let mut divide = false;
    while let Some(part) = parts.next() {
        if part.as_rule() == Rule::unit_operator {
            divide = part.as_str() == "/";
            continue;
        }
        let mut exponent = if divide { -outer } else { outer };
        divide = false;
        if let Some(power) = parts.next_if(|next| next.as_rule() == Rule::unit_power) {
            exponent = multiply(context, &power, exponent, unit_power(context, power.clone())?)?;
        }
        factor(context, part, exponent, factors)?;
    }
    Ok(())
}

fn factor(context: &Context<'_>, part: Pair<'_, Rule>, exponent: Exponent, factors: &mut Vec<UnitFactor>) -> Fallible<()> {
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
    factors.push(UnitFactor { base, exponent: (*exponent.numer(), *exponent.denom()) });
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
fn unit_power(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Exponent> {
    let mut parts = pair.clone().into_inner();
    let numerator = parts.next().and_then(|part| decimal(part.as_str()));
    let denominator = parts.next().map_or(Some(Exponent::ONE), |part| decimal(part.as_str()));
    match (numerator, denominator) {
        (Some(numerator), Some(denominator)) if *denominator.numer() != 0 => Ok(numerator / denominator),
        _ => Err(overflow(context, &pair)),
    }
}

/// An exponent as written, exactly: at most three decimals and four digits before them.
fn decimal(text: &str) -> Option<Exponent> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    if fraction.len() > 3 || whole.len() > 5 {
        return None;
    }
    let digits: i32 = format!("{whole}{fraction}").parse().ok()?;
    Some(Exponent::new(digits, 10_i32.pow(u32::try_from(fraction.len()).ok()?)))
}

fn multiply(context: &Context<'_>, pair: &Pair<'_, Rule>, a: Exponent, b: Exponent) -> Fallible<Exponent> {
    let numerator = i64::from(*a.numer()) * i64::from(*b.numer());
    let denominator = i64::from(*a.denom()) * i64::from(*b.denom());
    let exact = Ratio::new(numerator, denominator);
    let narrow = |value: i64| i32::try_from(value).ok().filter(|value| value.abs() <= 1_000_000);
    match (narrow(*exact.numer()), narrow(*exact.denom())) {
        (Some(numerator), Some(denominator)) => Ok(Exponent::new(numerator, denominator)),
        _ => Err(overflow(context, pair)),
    }
}

fn overflow(context: &Context<'_>, pair: &Pair<'_, Rule>) -> Box<Diagnostic> {
    let message = "this exponent of a unit cannot be represented";
    Box::new(
        Diagnostic::error(codes::UNIT_OVERFLOW, message, context.span(pair))
            .help("write a small rational number such as `^2.5` or `^(1/3)`"),
    )
}
