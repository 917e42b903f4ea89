//! A unit: dimension, size, and how it is written.

use std::fmt;

use super::{Dimension, Rational, Scale, dimension, table};

/// What a number in a unit measures from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum UnitKind {
    /// From nothing: twice the number is twice the quantity.
    Linear,
    /// From the zero of a temperature scale, given in kelvin: `degC`, `degF`.
    Point {
        /// Zero of the scale in kelvin.
        zero: f64,
    },
}

/// A unit of measure.
#[derive(Clone, Debug)]
pub struct Unit {
    dimension: Dimension,
    scale: Scale,
    kind: UnitKind,
    /// Factors as written, for messages.
    factors: Vec<(String, Rational)>,
}

/// From a number in one unit to the number in another: `to = factor * from + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conversion {
    /// Ratio of the units; exactly 1 where they are equal.
    pub factor: f64,
    /// Zero except between temperature scales, in the target's unit.
    pub offset: f64,
}

impl Unit {
    /// The unit of a number.
    #[must_use]
    pub fn one() -> Self {
        Self { dimension: Dimension::NONE, scale: Scale::ONE, kind: UnitKind::Linear, factors: Vec::new() }
    }

    /// The unit of a symbol, prefix included: `kmol`, `degC`, `%`.
    #[must_use]
    pub fn named(symbol: &str) -> Option<Self> {
        let (prefix, unit) = table::find(symbol)?;
        let scale = prefix.map_or(unit.scale(), |prefix| prefix.scale().multiply(unit.scale()));
        let kind = unit.zero().map_or(UnitKind::Linear, |zero| UnitKind::Point { zero });
        Some(Self { dimension: unit.dimension(), scale, kind, factors: vec![(symbol.to_owned(), Rational::ONE)] })
    }

    /// A pure number as a unit, as in `100 mL`; `None` unless it is positive and finite.
    #[must_use]
    pub fn number(value: f64) -> Option<Self> {
        let scale = Scale::from_decimal(value);
        scale.is_valid().then(|| Self { scale, factors: vec![(format!("{value}"), Rational::ONE)], ..Self::one() })
    }

    /// The dimension.
    #[must_use]
    pub fn dimension(&self) -> &Dimension {
        &self.dimension
    }

    /// The size in SI base units.
    #[must_use]
    pub fn scale(&self) -> Scale {
        self.scale
    }

    /// What a number in this unit measures from.
    #[must_use]
    pub fn kind(&self) -> UnitKind {
        self.kind
    }

    /// Whether numbers in this unit are points on a temperature scale.
    #[must_use]
    pub fn is_point(&self) -> bool {
        matches!(self.kind, UnitKind::Point { .. })
    }

    /// Whether this is the unit of numbers: no dimension and size 1.
    #[must_use]
    pub fn is_one(&self) -> bool {
        self.dimension.is_none() && self.scale == Scale::ONE && !self.is_point()
    }

    /// Whether two units measure the same kind of thing.
    #[must_use]
    pub fn commensurable(&self, other: &Self) -> bool {
        self.dimension == other.dimension
    }

    /// The unit of differences: `K` for `degC`, the unit itself unless it is a point.
    #[must_use]
    pub fn difference(&self) -> Self {
        match self.kind {
            UnitKind::Linear => self.clone(),
            UnitKind::Point { .. } if self.scale == Scale::ONE => Self { factors: vec![("K".to_owned(), Rational::ONE)], ..self.linear() },
            UnitKind::Point { .. } => self.linear(),
        }
    }

    fn linear(&self) -> Self {
        Self { kind: UnitKind::Linear, ..self.clone() }
    }

    /// Unit of a product of differences; `None` beyond the range of exponents or factors.
    #[must_use]
    pub fn multiply(&self, other: &Self) -> Option<Self> {
        let dimension = self.dimension.multiply(&other.dimension)?;
        let scale = self.scale.multiply(other.scale);
        let mut factors = self.difference().factors;
        for (symbol, exponent) in other.difference().factors {
            add_factor(&mut factors, symbol, exponent)?;
        }
        scale.is_valid().then_some(Self { dimension, scale, kind: UnitKind::Linear, factors })
    }

    /// Unit of a quotient of differences.
    #[must_use]
    pub fn divide(&self, other: &Self) -> Option<Self> {
        self.multiply(&other.power(Rational::integer(-1))?)
    }

    /// Unit of a power of a difference.
    #[must_use]
    pub fn power(&self, exponent: Rational) -> Option<Self> {
        let mut factors = Vec::with_capacity(self.factors.len());
        for (symbol, own) in self.difference().factors {
            let product = own.multiply(exponent)?;
            if !product.is_zero() {
                factors.push((symbol, product));
            }
        }
        let dimension = self.dimension.power(exponent)?;
        let scale = self.scale.power(exponent);
        scale.is_valid().then_some(Self { dimension, scale, kind: UnitKind::Linear, factors })
    }

    /// By what a number (a difference, for points) in this unit is multiplied to give the number in `other`; exactly 1 for equal units, `None` for
    /// incommensurable ones.
    #[must_use]
    pub fn factor_to(&self, other: &Self) -> Option<f64> {
        self.commensurable(other).then(|| self.scale.divide(other.scale).value())
    }

    /// From numbers in this unit to numbers in `other`, between temperature scales with the offset. A linear unit of temperature counts from absolute zero.
    #[must_use]
    pub fn conversion_to(&self, other: &Self) -> Option<Conversion> {
        let factor = self.factor_to(other)?;
        let zero = |unit: &Self| match unit.kind {
            UnitKind::Linear => 0.0,
            UnitKind::Point { zero } => zero,
        };
        Some(Conversion { factor, offset: (zero(self) - zero(other)) / other.scale.value() })
    }

    /// Quantity and unit, for messages: `temperature per time [K/min]`, `dimensionless`.
    #[must_use]
    pub fn describe(&self) -> String {
        if self.factors.is_empty() {
            return self.dimension.describe();
        }
        format!("{} [{self}]", self.dimension.describe())
    }
}

/// Units are equal when they mean the same, however they are written.
impl PartialEq for Unit {
    fn eq(&self, other: &Self) -> bool {
        self.dimension == other.dimension && self.scale == other.scale && self.kind == other.kind
    }
}

/// `kmol/(m^3 min)`; `1` for the unit of numbers.
impl fmt::Display for Unit {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&dimension::product(self.factors.iter().map(|(symbol, exponent)| (symbol.as_str(), *exponent))))
    }
}

/// Adds a factor to a product, joining powers of one symbol and dropping those that cancel.
fn add_factor(factors: &mut Vec<(String, Rational)>, symbol: String, exponent: Rational) -> Option<()> {
    let Some(index) = factors.iter().position(|(known, _)| *known == symbol) else {
        factors.push((symbol, exponent));
        return Some(());
    };
    factors[index].1 = factors[index].1.plus(exponent)?;
    if factors[index].1.is_zero() {
        factors.remove(index);
    }
    Some(())
}
