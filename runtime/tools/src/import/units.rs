//! Units of SBML in the symbols of the language.

use super::document::{Sbml, UnitPart};

/// A product of symbols with their exponents.
pub(super) type Product = Vec<(String, f64)>;

/// Symbols with their exponents, as the tables hold them.
type Symbols = &'static [(&'static str, f64)];

/// Kinds of SBML: products of symbols, whether a prefix may be before the first.
const KINDS: [(&str, Symbols, bool); 33] = [
    ("ampere", &[("A", 1.0)], true),
    ("becquerel", &[("s", -1.0)], false),
    ("candela", &[("cd", 1.0)], true),
    ("coulomb", &[("C", 1.0)], true),
    ("dimensionless", &[], false),
    ("farad", &[("C", 1.0), ("V", -1.0)], false),
    ("gram", &[("g", 1.0)], true),
    ("gray", &[("m", 2.0), ("s", -2.0)], false),
    ("henry", &[("V", 1.0), ("s", 1.0), ("A", -1.0)], false),
    ("hertz", &[("s", -1.0)], false),
    ("item", &[("unit", 1.0)], false),
    ("joule", &[("J", 1.0)], true),
    ("katal", &[("mol", 1.0), ("s", -1.0)], true),
    ("kelvin", &[("K", 1.0)], true),
    ("kilogram", &[("kg", 1.0)], false),
    ("liter", &[("L", 1.0)], true),
    ("litre", &[("L", 1.0)], true),
    ("lumen", &[("cd", 1.0)], true),
    ("lux", &[("cd", 1.0), ("m", -2.0)], true),
    ("meter", &[("m", 1.0)], true),
    ("metre", &[("m", 1.0)], true),
    ("mole", &[("mol", 1.0)], true),
    ("newton", &[("N", 1.0)], true),
    ("ohm", &[("ohm", 1.0)], true),
    ("pascal", &[("Pa", 1.0)], true),
    ("radian", &[("rad", 1.0)], false),
    ("second", &[("s", 1.0)], true),
    ("siemens", &[("S", 1.0)], true),
    ("sievert", &[("m", 2.0), ("s", -2.0)], false),
    ("steradian", &[], false),
    ("tesla", &[("V", 1.0), ("s", 1.0), ("m", -2.0)], false),
    ("volt", &[("V", 1.0)], true),
    ("watt", &[("W", 1.0)], true),
];

/// Prefixes of the language by their power of ten.
const PREFIXES: [(i32, &str); 11] =
    [(-15, "f"), (-12, "p"), (-9, "n"), (-6, "u"), (-3, "m"), (-2, "c"), (-1, "d"), (0, ""), (3, "k"), (6, "M"), (9, "G")];

/// Multiples of the second with their own symbol.
const TIMES: [(f64, &str); 5] = [(60.0, "min"), (3600.0, "h"), (86_400.0, "d"), (604_800.0, "week"), (31_536_000.0, "year")];

/// Default units of SBML Level 2.
const USUAL: [(&str, Symbols); 5] = [
    ("substance", &[("mol", 1.0)]),
    ("volume", &[("L", 1.0)]),
    ("area", &[("m", 2.0)]),
    ("length", &[("m", 1.0)]),
    ("time", &[("s", 1.0)]),
];

fn owned(product: &[(&str, f64)]) -> Product {
    product.iter().map(|(symbol, exponent)| ((*symbol).to_owned(), *exponent)).collect()
}

/// The product that an id means; none where the language has no symbols for it.
pub(super) fn product(sbml: &Sbml, id: &str) -> Option<Product> {
    if let Some(parts) = sbml.units.get(id) {
        let mut all = vec![];
        for part in parts {
            all = times(&all, &symbols(part)?, 1.0);
        }
        return Some(all);
    }
    if let Some((_, product, _)) = KINDS.iter().find(|(kind, ..)| *kind == id) {
        return Some(owned(product));
    }
    let usual = USUAL.iter().find(|(name, _)| *name == id && sbml.level == 2)?;
    Some(owned(usual.1))
}

/// One part of a definition.
fn symbols(part: &UnitPart) -> Option<Product> {
    let (_, product, prefixed) = KINDS.iter().find(|(kind, ..)| *kind == part.kind)?;
    let mut product = owned(product);
    let size = part.multiplier * 10_f64.powi(part.scale);
    if size != 1.0 {
        let first = product.first_mut()?;
        first.0 = prefix(&first.0, size, *prefixed)?;
    }
    Some(product.into_iter().map(|(symbol, exponent)| (symbol, exponent * part.exponent)).collect())
}

fn prefix(symbol: &str, size: f64, prefixed: bool) -> Option<String> {
    if symbol == "s"
        && let Some((_, time)) = TIMES.iter().find(|(seconds, _)| *seconds == size)
    {
        return Some((*time).to_owned());
    }
    let power = size.log10().round();
    if (size / 10_f64.powf(power) - 1.0).abs() > 1e-12 {
        return None;
    }
    let (symbol, power) = if symbol == "kg" { ("g", power + 3.0) } else { (symbol, power) };
    if !prefixed && symbol != "g" {
        return None;
    }
    PREFIXES.iter().find(|(p, _)| f64::from(*p) == power).map(|(_, prefix)| format!("{prefix}{symbol}"))
}

/// `a · b^power`
pub(super) fn times(a: &Product, b: &Product, power: f64) -> Product {
    let mut all = a.clone();
    for (symbol, exponent) in b {
        match all.iter_mut().find(|(known, _)| known == symbol) {
            Some((_, sum)) => *sum += exponent * power,
            None => all.push((symbol.clone(), exponent * power)),
        }
    }
    all.retain(|(_, exponent)| *exponent != 0.0);
    all
}

/// As the language writes it: `mmol/(L s)`.
pub(super) fn text(product: &Product) -> String {
    let one = |(symbol, exponent): &(String, f64)| {
        let size = exponent.abs();
        if size == 1.0 { symbol.clone() } else { format!("{symbol}^{size}") }
    };
    let above: Vec<String> = product.iter().filter(|(_, e)| *e > 0.0).map(one).collect();
    let below: Vec<String> = product.iter().filter(|(_, e)| *e < 0.0).map(one).collect();
    let above = if above.is_empty() { "1".to_owned() } else { above.join(" ") };
    match &below[..] {
        [] => above,
        [one] => format!("{above}/{one}"),
        many => format!("{above}/({})", many.join(" ")),
    }
}
