//! Dimensions: exponents of the base quantities.

use std::fmt;
use std::sync::Arc;

use super::Rational;

/// Name and coherent unit of each base quantity: the seven of the SI, and two that are counted.
pub const BASES: [(&str, &str); 9] = [
    ("length", "m"),
    ("mass", "kg"),
    ("time", "s"),
    ("current", "A"),
    ("temperature", "K"),
    ("amount", "mol"),
    ("luminous intensity", "cd"),
    ("cells", "cell"),
    ("units", "unit"),
];

/// The dimension of a quantity: a product of powers of the base quantities, in the order of
/// [`BASES`], and of the dimensions that a model declares by `unit NAME`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Dimension {
    exponents: [Rational; BASES.len()],
    /// Declared dimensions with exponents other than 0, sorted by name.
    own: Vec<(Arc<str>, Rational)>,
}

impl Dimension {
    /// The dimension of a number.
    pub const NONE: Self = Self { exponents: [Rational::ZERO; BASES.len()], own: Vec::new() };

    /// From integer exponents in the order of [`BASES`]; those left out are 0.
    #[must_use]
    pub fn of(exponents: &[i8]) -> Self {
        let mut dimension = Self::NONE;
        for (slot, exponent) in dimension.exponents.iter_mut().zip(exponents) {
            *slot = Rational::integer(i32::from(*exponent));
        }
        dimension
    }

    /// The dimension that a model declares by `unit NAME`.
    #[must_use]
    pub fn own(name: &str) -> Self {
        Self { own: vec![(name.into(), Rational::ONE)], ..Self::NONE }
    }

    /// Returns whether dimensions that a model declares are among its factors.
    #[must_use]
    pub fn has_own(&self) -> bool {
        !self.own.is_empty()
    }

    /// The exponents in the order of [`BASES`].
    #[must_use]
    pub fn exponents(&self) -> &[Rational; BASES.len()] {
        &self.exponents
    }

    /// Returns `true` if this is the dimension of a number.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// Dimension of a product; `None` beyond the range of exponents.
    #[must_use]
    pub fn multiply(&self, other: &Self) -> Option<Self> {
        let mut product = self.clone();
        for (slot, exponent) in product.exponents.iter_mut().zip(other.exponents) {
            *slot = small(slot.plus(exponent)?)?;
        }
        for (name, exponent) in &other.own {
            match product.own.binary_search_by(|(known, _)| known.cmp(name)) {
                Ok(at) => product.own[at].1 = small(product.own[at].1.plus(*exponent)?)?,
                Err(at) => product.own.insert(at, (name.clone(), *exponent)),
            }
        }
        product.own.retain(|(_, exponent)| !exponent.is_zero());
        Some(product)
    }

    /// Dimension of a power; `None` beyond the range of exponents.
    #[must_use]
    pub fn power(&self, exponent: Rational) -> Option<Self> {
        let mut power = self.clone();
        for slot in power.exponents.iter_mut().chain(power.own.iter_mut().map(|(_, own)| own)) {
            *slot = small(slot.multiply(exponent)?)?;
        }
        power.own.retain(|(_, exponent)| !exponent.is_zero());
        Some(power)
    }

    /// Returns `true` if one is a power of the other, as a volume is of a length.
    #[must_use]
    pub fn is_power_of(&self, other: &Self) -> bool {
        let of = |name: &Arc<str>| other.own.iter().find(|(known, _)| known == name).map_or(Rational::ZERO, |(_, exponent)| *exponent);
        let base = self.exponents.iter().copied().zip(other.exponents);
        let mut pairs = base.chain(self.own.iter().map(|(name, exponent)| (*exponent, of(name))));
        let ratio = pairs.find(|(a, _)| !a.is_zero()).and_then(|(a, b)| b.multiply(a.reciprocal()?));
        ratio.filter(|ratio| !ratio.is_zero()).and_then(|ratio| self.power(ratio)).is_some_and(|power| power == *other)
    }

    /// Dimension of a quotient; `None` beyond the range of exponents.
    #[must_use]
    pub fn divide(&self, other: &Self) -> Option<Self> {
        self.multiply(&other.power(Rational::integer(-1))?)
    }

    /// In words, as a message would say it: `pressure`, `temperature per time`, `dimensionless`.
    #[must_use]
    pub fn describe(&self) -> String {
        if let Some(name) = self.name() {
            return name.to_owned();
        }
        if !self.own.is_empty() {
            return self.spelled_out();
        }
        let time = Self::of(&[0, 0, 1]);
        let per_time = self.multiply(&time).and_then(|integral| integral.name());
        per_time.map_or_else(|| self.spelled_out(), |name| format!("{name} per time"))
    }

    fn name(&self) -> Option<&'static str> {
        let base = BASES.iter().enumerate().find(|(index, _)| *self == Self::base(*index));
        base.map(|(_, (name, _))| *name).or_else(|| NAMED.iter().find(|(exponents, _)| Self::of(exponents) == *self).map(|(_, name)| *name))
    }

    fn base(index: usize) -> Self {
        let mut dimension = Self::NONE;
        dimension.exponents[index] = Rational::ONE;
        dimension
    }

    /// `mass length^2 per time^3`
    fn spelled_out(&self) -> String {
        let part = |negative: bool| {
            let own = self.own.iter().map(|(name, exponent)| (&**name, *exponent));
            let all = own.chain(BASES.iter().zip(self.exponents).map(|((name, _), exponent)| (*name, exponent)));
            let factors = all.filter(|(_, exponent)| (exponent.numerator() < 0) == negative && !exponent.is_zero());
            let words = factors.map(|(name, exponent)| raised(name, if negative { exponent.negate() } else { exponent }));
            words.collect::<Vec<_>>().join(" ")
        };
        match (part(false), part(true)) {
            (above, below) if below.is_empty() => above,
            (above, below) if above.is_empty() => format!("per {below}"),
            (above, below) => format!("{above} per {below}"),
        }
    }
}

/// Coherent SI unit, such as `kg m^2/s^2`; `1` for a number.
impl fmt::Display for Dimension {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let factors = BASES.iter().zip(self.exponents).map(|((_, symbol), exponent)| (*symbol, exponent));
        formatter.write_str(&product(self.own.iter().map(|(name, exponent)| (&**name, *exponent)).chain(factors)))
    }
}

/// Exponents beyond a thousand, or with more than six decimals, are refused.
fn small(exponent: Rational) -> Option<Rational> {
    let denominator = exponent.denominator();
    (exponent.numerator().abs() <= 1000 * denominator && denominator <= Rational::FINEST).then_some(exponent)
}

fn raised(symbol: &str, exponent: Rational) -> String {
    if exponent == Rational::ONE { symbol.to_owned() } else { format!("{symbol}^{exponent}") }
}

/// `a b/(c d)` from factors with exponents.
pub(super) fn product<'a>(factors: impl Iterator<Item = (&'a str, Rational)>) -> String {
    let (mut above, mut below) = (Vec::new(), Vec::new());
    for (symbol, exponent) in factors.filter(|(_, exponent)| !exponent.is_zero()) {
        match exponent.numerator() > 0 {
            true => above.push(raised(symbol, exponent)),
            false => below.push(raised(symbol, exponent.negate())),
        }
    }
    let numerator = if above.is_empty() { "1".to_owned() } else { above.join(" ") };
    match below.as_slice() {
        [] => numerator,
        [single] => format!("{numerator}/{single}"),
        _ => format!("{numerator}/({})", below.join(" ")),
    }
}

/// Exponents of m, kg, s, A, K, mol, and the name of the quantity.
const NAMED: &[(&[i8], &str)] = &[
    (&[], "dimensionless"),
    (&[2], "area"),
    (&[3], "volume"),
    (&[1, 0, -1], "velocity"),
    (&[1, 0, -2], "acceleration"),
    (&[3, 0, -1], "volume flow"),
    (&[0, 1, -1], "mass flow"),
    (&[0, 0, -1, 0, 0, 1], "molar flow"),
    (&[0, 0, -1], "rate (1 over time)"),
    (&[-3, 0, 0, 0, 0, 1], "concentration"),
    (&[-3, 1], "mass concentration"),
    (&[3, -1], "specific volume"),
    (&[0, 1, 0, 0, 0, -1], "molar mass"),
    (&[3, 0, 0, 0, 0, -1], "molar volume"),
    (&[1, 1, -2], "force"),
    (&[-1, 1, -2], "pressure"),
    (&[2, 1, -2], "energy"),
    (&[2, 1, -3], "power"),
    (&[0, 1, -3], "heat flux"),
    (&[0, 1, -3, 0, -1], "heat-transfer coefficient"),
    (&[1, 1, -3, 0, -1], "thermal conductivity"),
    (&[2, 0, -2], "specific energy"),
    (&[2, 0, -2, 0, -1], "specific heat capacity"),
    (&[2, 1, -2, 0, -1], "heat capacity"),
    (&[2, 1, -2, 0, 0, -1], "molar energy"),
    (&[2, 1, -2, 0, -1, -1], "molar heat capacity"),
    (&[-1, 1, -1], "viscosity"),
    (&[2, 0, -1], "diffusivity"),
    (&[0, 1, -2], "surface tension"),
    (&[-2, 0, -1, 0, 0, 1], "molar flux"),
    (&[-2, 1, -1], "mass flux"),
    (&[0, 0, 1, 1], "charge"),
    (&[2, 1, -3, -1], "voltage"),
    (&[0, 0, 0, 0, -1], "inverse temperature"),
    (&[-1], "inverse length"),
    (&[-3], "number per volume"),
    (&[-3, 0, 0, 0, 0, 0, 0, 1], "cell density"),
];
