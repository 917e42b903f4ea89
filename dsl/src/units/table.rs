//! The table of unit symbols and prefixes.

use super::{Dimension, Rational, Scale};

/// One unit of the table.
#[derive(Clone, Copy, Debug)]
pub struct Symbol {
    /// As written.
    pub symbol: &'static str,
    /// In words.
    pub name: &'static str,
    /// Exponents of m, kg, s, A, K, mol, cd, cell, unit; those left out are 0.
    exponents: &'static [i8],
    /// Size in SI base units as numerator and denominator.
    size: (i64, i64),
    /// True if prefixes may be before it.
    pub prefixed: bool,
    /// For points on a temperature scale: the zero of the scale in K, as numerator and denominator.
    zero: Option<(i64, i64)>,
}

impl Symbol {
    /// The dimension.
    #[must_use]
    pub fn dimension(&self) -> Dimension {
        Dimension::of(self.exponents)
    }

    /// The size of one unit in SI base units.
    #[must_use]
    pub fn scale(&self) -> Scale {
        match self.symbol {
            "deg" => Scale::inexact(std::f64::consts::PI / 180.0),
            "rpm" => Scale::inexact(std::f64::consts::PI / 30.0),
            "Nm3" => Scale::inexact(NORMAL_CUBIC_METRE),
            "NL" => Scale::inexact(NORMAL_CUBIC_METRE / 1000.0),
            _ => fraction(self.size),
        }
    }

    /// Zero of the scale in kelvin, for `degC` and `degF`.
    #[must_use]
    pub fn zero(&self) -> Option<f64> {
        self.zero.map(|(numerator, denominator)| numerator as f64 / denominator as f64)
    }
}

/// A decimal prefix.
#[derive(Clone, Copy, Debug)]
pub struct Prefix {
    /// As written.
    pub symbol: &'static str,
    /// Power of ten.
    pub exponent: i32,
}

impl Prefix {
    /// The factor.
    #[must_use]
    pub fn scale(&self) -> Scale {
        let ten = Rational::integer(10).power(Rational::integer(self.exponent));
        ten.map_or_else(|| Scale::inexact(10_f64.powi(self.exponent)), Scale::exact)
    }
}

/// Every unit symbol.
#[must_use]
pub fn symbols() -> &'static [Symbol] {
    SYMBOLS
}

/// Every prefix, the two-letter one first.
#[must_use]
pub fn prefixes() -> &'static [Prefix] {
    PREFIXES
}

/// The unit and prefix that a symbol stands for. A unit without prefix comes first: `min` is the
/// minute, `cd` the candela.
pub(super) fn find(symbol: &str) -> Option<(Option<Prefix>, Symbol)> {
    if let Some(unit) = SYMBOLS.iter().find(|unit| unit.symbol == symbol) {
        return Some((None, *unit));
    }
    PREFIXES.iter().find_map(|prefix| {
        let rest = symbol.strip_prefix(prefix.symbol)?;
        let unit = SYMBOLS.iter().find(|unit| unit.prefixed && unit.symbol == rest)?;
        Some((Some(*prefix), *unit))
    })
}

/// Units as they are written elsewhere, and here.
pub(super) const SYNONYMS: &[(&str, &str)] = &[
    ("sec", "s"),
    ("second", "s"),
    ("seconds", "s"),
    ("minute", "min"),
    ("minutes", "min"),
    ("mins", "min"),
    ("hr", "h"),
    ("hour", "h"),
    ("hours", "h"),
    ("day", "d"),
    ("days", "d"),
    ("weeks", "week"),
    ("l", "L"),
    ("liter", "L"),
    ("litre", "L"),
    ("ml", "mL"),
    ("ul", "uL"),
    ("gram", "g"),
    ("kilogram", "kg"),
    ("Kg", "kg"),
    ("meter", "m"),
    ("metre", "m"),
    ("celsius", "degC"),
    ("Celsius", "degC"),
    ("kelvin", "K"),
    ("Kelvin", "K"),
    ("fahrenheit", "degF"),
    ("F", "degF` or, for farads, `C/V"),
    ("farad", "C/V"),
    ("H", "V s/A"),
    ("henry", "V s/A"),
    ("Ohm", "ohm"),
    ("ohms", "ohm"),
    ("siemens", "S"),
    ("percent", "%"),
    ("pct", "%"),
    ("mole", "mol"),
    ("moles", "mol"),
    ("Mol", "mol"),
    ("Kmol", "kmol"),
    ("joule", "J"),
    ("watt", "W"),
    ("pascal", "Pa"),
    ("poise", "P"),
    ("tonne", "t"),
    ("cells", "cell"),
    ("units", "unit"),
    ("U", "unit"),
    ("micron", "um"),
    ("cc", "mL"),
    ("foot", "ft"),
    ("feet", "ft"),
    ("inches", "inch"),
    ("pound", "lb"),
    ("pounds", "lb"),
    ("lbs", "lb"),
    ("lbm", "lb"),
    ("psia", "psi"),
    ("ton", "t"),
    ("tons", "t"),
    ("Nm", "N m` or, for normal cubic metres, `Nm3"),
    ("Torr", "torr"),
    ("gallon", "gal"),
    ("gallons", "gal"),
    ("USgal", "gal"),
    ("Btu", "BTU"),
    ("btu", "BTU"),
    ("horsepower", "hp"),
    ("RPM", "rpm"),
    ("cst", "cSt"),
    ("kwh", "kWh"),
    ("KWh", "kWh"),
    ("yr", "year"),
    ("years", "year"),
    ("NM3", "Nm3"),
    ("Nl", "NL"),
    ("molar", "M"),
];

fn fraction((numerator, denominator): (i64, i64)) -> Scale {
    let exact = Rational::new(numerator.into(), denominator.into());
    exact.map_or_else(|| Scale::inexact(numerator as f64 / denominator as f64), Scale::exact)
}

const fn si(symbol: &'static str, name: &'static str, exponents: &'static [i8]) -> Symbol {
    Symbol { symbol, name, exponents, size: (1, 1), prefixed: true, zero: None }
}

const fn unit(symbol: &'static str, name: &'static str, exponents: &'static [i8], size: (i64, i64)) -> Symbol {
    Symbol { symbol, name, exponents, size, prefixed: false, zero: None }
}

const fn prefixed(unit: Symbol) -> Symbol {
    Symbol { prefixed: true, ..unit }
}

const fn point(unit: Symbol, zero: (i64, i64)) -> Symbol {
    Symbol { zero: Some(zero), ..unit }
}

/// Mol in a normal cubic metre: 101325 Pa over R times 273.15 K, with the molar gas constant R of
/// the SI (CODATA 2018, exact).
const NORMAL_CUBIC_METRE: f64 = 101_325.0 / (8.314_462_618_153_24 * 273.15);

#[rustfmt::skip]
const SYMBOLS: &[Symbol] = &[
    si("m",   "metre",   &[1]),
    si("s",   "second",  &[0, 0, 1]),
    si("A",   "ampere",  &[0, 0, 0, 1]),
    si("K",   "kelvin",  &[0, 0, 0, 0, 1]),
    si("mol", "mole",    &[0, 0, 0, 0, 0, 1]),
    si("cd",  "candela", &[0, 0, 0, 0, 0, 0, 1]),
    si("N",   "newton",  &[1, 1, -2]),
    si("Pa",  "pascal",  &[-1, 1, -2]),
    si("J",   "joule",   &[2, 1, -2]),
    si("W",   "watt",    &[2, 1, -3]),
    si("Hz",  "hertz",   &[0, 0, -1]),
    si("V",   "volt",    &[2, 1, -3, -1]),
    si("C",   "coulomb", &[0, 0, 1, 1]),
    si("ohm", "ohm",     &[2, 1, -3, -2]),
    si("S",   "siemens", &[-2, -1, 3, 2]),
    prefixed(unit("g",   "gram",    &[0, 1], (1, 1000))),
    prefixed(unit("L",   "litre",   &[3], (1, 1000))),
    prefixed(unit("M",   "molar, mol/L", &[-3, 0, 0, 0, 0, 1], (1000, 1))),
    prefixed(unit("P",   "poise",   &[-1, 1, -1], (1, 10))),
    prefixed(unit("bar", "bar",     &[-1, 1, -2], (100_000, 1))),
    prefixed(unit("cal", "calorie (thermochemical)", &[2, 1, -2], (4184, 1000))),
    unit("min",  "minute", &[0, 0, 1], (60, 1)),
    unit("h",    "hour",   &[0, 0, 1], (3600, 1)),
    unit("d",    "day",    &[0, 0, 1], (86_400, 1)),
    unit("week", "week",   &[0, 0, 1], (604_800, 1)),
    unit("atm",  "standard atmosphere", &[-1, 1, -2], (101_325, 1)),
    unit("ha",   "hectare", &[2], (10_000, 1)),
    unit("t",    "tonne",   &[0, 1], (1000, 1)),
    unit("year", "year of 365 days", &[0, 0, 1], (31_536_000, 1)),
    unit("inch", "inch",    &[1], (254, 10_000)),
    unit("ft",   "foot",    &[1], (3048, 10_000)),
    unit("lb",   "pound, avoirdupois", &[0, 1], (45_359_237, 100_000_000)),
    unit("lbf",  "pound-force", &[1, 1, -2], (8_896_443_230_521, 2_000_000_000_000)),
    unit("lbmol", "pound-mole, lb/g of a mole", &[0, 0, 0, 0, 0, 1], (45_359_237, 100_000)),
    unit("psi",  "pound-force per square inch", &[-1, 1, -2], (8_896_443_230_521, 1_290_320_000)),
    unit("mmHg", "conventional millimetre of mercury", &[-1, 1, -2], (26_664_477_483, 200_000_000)),
    unit("torr", "torr, atm/760", &[-1, 1, -2], (20_265, 152)),
    unit("gal",  "gallon, United States, liquid", &[3], (473_176_473, 125_000_000_000)),
    unit("BTU",  "British thermal unit, International Table", &[2, 1, -2], (52_752_792_631, 50_000_000)),
    unit("hp",   "horsepower of 550 foot pounds-force per second", &[2, 1, -3], (37_284_993_579_113_511, 50_000_000_000_000)),
    prefixed(unit("Wh", "watt hour", &[2, 1, -2], (3600, 1))),
    prefixed(unit("St", "stokes",  &[2, 0, -1], (1, 10_000))),
    unit("rpm",  "revolution per minute, an angular velocity: 2 pi/60 rad/s", &[0, 0, -1], (0, 1)),
    unit("Nm3",  "normal cubic metre of an ideal gas, 273.15 K and 101325 Pa: an amount", &[0, 0, 0, 0, 0, 1], (0, 1)),
    unit("NL",   "normal litre, Nm3/1000", &[0, 0, 0, 0, 0, 1], (0, 1)),
    unit("%",    "per cent", &[], (1, 100)),
    unit("ppm",  "parts per million", &[], (1, 1_000_000)),
    unit("mol%", "per cent of an amount of substance", &[], (1, 100)),
    unit("wt%",  "per cent of a mass", &[], (1, 100)),
    unit("vol%", "per cent of a volume", &[], (1, 100)),
    unit("rad",  "radian", &[], (1, 1)),
    unit("deg",  "degree of angle", &[], (1, 1)),
    unit("cell", "cell", &[0, 0, 0, 0, 0, 0, 0, 1], (1, 1)),
    unit("unit", "unit of activity", &[0, 0, 0, 0, 0, 0, 0, 0, 1], (1, 1)),
    point(unit("degC", "degree Celsius",    &[0, 0, 0, 0, 1], (1, 1)), (27_315, 100)),
    point(unit("degF", "degree Fahrenheit", &[0, 0, 0, 0, 1], (5, 9)), (45_967 * 5, 900)),
];

#[rustfmt::skip]
const PREFIXES: &[Prefix] = &[
    Prefix { symbol: "da", exponent: 1 },
    Prefix { symbol: "k",  exponent: 3 },
    Prefix { symbol: "m",  exponent: -3 },
    Prefix { symbol: "u",  exponent: -6 },
    Prefix { symbol: "n",  exponent: -9 },
    Prefix { symbol: "c",  exponent: -2 },
    Prefix { symbol: "d",  exponent: -1 },
    Prefix { symbol: "h",  exponent: 2 },
    Prefix { symbol: "M",  exponent: 6 },
    Prefix { symbol: "G",  exponent: 9 },
    Prefix { symbol: "T",  exponent: 12 },
    Prefix { symbol: "P",  exponent: 15 },
    Prefix { symbol: "E",  exponent: 18 },
    Prefix { symbol: "p",  exponent: -12 },
    Prefix { symbol: "f",  exponent: -15 },
    Prefix { symbol: "a",  exponent: -18 },
];
