//! From a unit as written to what it means.

#![allow(clippy::result_large_err, reason = "faults of units are rare and end the compilation")]

use std::sync::LazyLock;

use super::{OwnUnits, Rational, Unit, table};
use crate::diagnostic::{Diagnostic, codes, did_you_mean, suggest};
use crate::span::Span;
use crate::syntax::{Expr, Ident, UnitBase, UnitExpr, UnitFactor};
use crate::words;

/// The unit that an expression of units stands for, as one that is in the text. `own` are the units
/// that the model declares; `unit_of` gives the unit of differences of the expression in `unit(x)`.
///
/// # Errors
/// A symbol that is not in the table (with the one probably intended), or exponents and factors
/// beyond what can be represented.
pub fn resolve(written: &UnitExpr, own: &OwnUnits, unit_of: &mut dyn FnMut(&Expr) -> Result<Unit, Diagnostic>) -> Result<Unit, Diagnostic> {
    if let [UnitFactor { base: UnitBase::Symbol(symbol), exponent: (1, 1) }] = written.factors.as_slice() {
        return named(symbol, own);
    }
    let mut product = Unit::one();
    for factor in &written.factors {
        let base = base(&factor.base, own, unit_of)?;
        let exponent = Rational::new(factor.exponent.0.into(), factor.exponent.1.into());
        let power = exponent.and_then(|exponent| base.power(exponent));
        product = power.and_then(|power| product.multiply(&power)).ok_or_else(|| overflow(written.span))?;
    }
    Ok(product.as_written())
}

fn base(base: &UnitBase, own: &OwnUnits, unit_of: &mut dyn FnMut(&Expr) -> Result<Unit, Diagnostic>) -> Result<Unit, Diagnostic> {
    match base {
        UnitBase::Symbol(symbol) => named(symbol, own),
        UnitBase::Of(expr) => unit_of(expr).map(|unit| unit.difference()),
        UnitBase::Number(value, span) => Unit::number(*value).ok_or_else(|| overflow(*span)),
    }
}

fn named(symbol: &Ident, own: &OwnUnits) -> Result<Unit, Diagnostic> {
    Unit::named(&symbol.text).or_else(|| own.get(&symbol.text).cloned()).ok_or_else(|| {
        let message = format!("unknown unit `{}`", symbol.text);
        let declared = did_you_mean(&symbol.text, own.iter().map(|(known, _)| known));
        // A misspelt word of the statement.
        let words = words::CLAUSES.iter().copied().filter(|word| word.len() > 4 && symbol.text.len() > 4);
        Diagnostic::error(codes::UNKNOWN_UNIT, message, symbol.span)
            .label("not a unit")
            .maybe_help(declared.or_else(|| did_you_mean(&symbol.text, words)).or_else(|| known_spelling(&symbol.text)))
    })
}

fn overflow(span: Span) -> Diagnostic {
    Diagnostic::error(codes::UNIT_OVERFLOW, "this unit has exponents or factors beyond what can be represented", span)
}

/// Longer symbols are not typing errors.
const LONGEST: usize = 32;

/// Probable intention of an unknown symbol.
fn known_spelling(symbol: &str) -> Option<String> {
    if let Some((_, known)) = table::SYNONYMS.iter().find(|(other, _)| *other == symbol) {
        return Some(format!("did you mean `{known}`?"));
    }
    if let Some(absolute) = gauge(symbol) {
        return Some(format!(
            "pressures are absolute: write `{absolute}`, and add the atmosphere where the number is a gauge pressure, `2 [{absolute}] + 1 [atm]`"
        ));
    }
    if let Some(absolute) = symbol.strip_suffix('a').filter(|unit| matches!(*unit, "bar" | "mbar" | "kPa" | "atm")) {
        return Some(format!("write `{absolute}`: pressures are absolute"));
    }
    if let Some(share) = symbol.strip_suffix('%') {
        let known = ["mol%", "wt%", "vol%"].map(|unit| format!("`{unit}`")).join(", ");
        return Some(format!("write `%`, or one of {known}; a product with `{share}` is written `% {share}`"));
    }
    let letters = symbol.trim_end_matches(|c: char| c.is_ascii_digit());
    if letters.len() < symbol.len() && Unit::named(letters).is_some() {
        return Some(format!("a power is written `{letters}^{}`", &symbol[letters.len()..]));
    }
    let near = if symbol.len() > LONGEST { None } else { split(symbol).or_else(|| nearest(symbol)) };
    // A word that is near to none of them is answered with all of them.
    Some(near.unwrap_or_else(all))
}

/// The unit of a gauge pressure that is written with its letter.
fn gauge(symbol: &str) -> Option<&str> {
    symbol
        .strip_suffix('g')
        .filter(|unit| matches!(*unit, "bar" | "mbar" | "kPa" | "MPa" | "psi" | "atm"))
        .or((symbol == "psig").then_some("psi"))
}

/// The units that there are.
fn all() -> String {
    let list = |prefixed: bool| {
        let symbols = table::symbols().iter().filter(|unit| unit.prefixed == prefixed);
        symbols.map(|unit| unit.symbol).collect::<Vec<_>>().join(" ")
    };
    format!("with prefixes (`km`, `mmol`): {}; without: {}; composed as in `kJ/(mol K)`", list(true), list(false))
}

/// `molL` is probably `mol L`.
fn split(symbol: &str) -> Option<String> {
    let known = |part: &str| part.len() > 1 && Unit::named(part).is_some();
    (2..symbol.len().saturating_sub(1)).filter(|at| symbol.is_char_boundary(*at)).find_map(|at| {
        let (left, right) = symbol.split_at(at);
        (known(left) && known(right)).then(|| format!("a product is written with a blank: `{left} {right}`"))
    })
}

fn nearest(symbol: &str) -> Option<String> {
    static CANDIDATES: LazyLock<Vec<String>> = LazyLock::new(|| table::symbols().iter().flat_map(spellings).collect());
    suggest(symbol, CANDIDATES.iter().map(String::as_str)).map(|candidate| format!("did you mean `{candidate}`?"))
}

/// A unit alone and with its usual prefixes.
fn spellings(unit: &table::Symbol) -> Vec<String> {
    let prefixes: &[&str] = if unit.prefixed { &["", "k", "m", "u", "c", "n", "M"] } else { &[""] };
    prefixes.iter().map(|prefix| format!("{prefix}{}", unit.symbol)).collect()
}
