//! A unit: dimension, size, and how it is written.

use std::fmt;
use std::sync::{Arc, LazyLock};

use super::{Dimension, Rational, Scale, dimension, table};

/// Zero point of a number in a unit.
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

/// A unit of measure; cheap to copy.
#[derive(Clone, Debug)]
pub struct Unit(Arc<Meaning>);

/// Meaning and notation of a unit.
#[derive(Clone, Debug)]
struct Meaning {
    dimension: Dimension,
    scale: Scale,
    kind: UnitKind,
    /// Factors as written, for messages.
    factors: Vec<Factor>,
    /// True if it is in a text, and did not come about by arithmetic.
    written: bool,
    /// True if its temperature is known to be a difference of two points on a scale, which no other
    /// scale can show as a point.
    between_points: bool,
}

/// A power of a symbol, or of a number.
#[derive(Clone, Debug)]
struct Factor {
    symbol: String,
    exponent: Rational,
    /// The unit of a symbol that the model declares.
    own: Option<Unit>,
}

impl Factor {
    /// A symbol of the table, or a number.
    fn of(symbol: impl Into<String>) -> Self {
        Self { symbol: symbol.into(), exponent: Rational::ONE, own: None }
    }

    /// The unit of the symbol; `None` for a number.
    fn unit(&self) -> Option<Unit> {
        self.own.clone().or_else(|| Unit::named(&self.symbol))
    }
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
    fn new(dimension: Dimension, scale: Scale, kind: UnitKind, factors: Vec<Factor>) -> Self {
        Self(Arc::new(Meaning { dimension, scale, kind, factors, written: true, between_points: false }))
    }

    /// Result of arithmetic.
    fn made(dimension: Dimension, scale: Scale, factors: Vec<Factor>) -> Option<Self> {
        scale
            .is_valid()
            .then(|| Self(Arc::new(Meaning { dimension, scale, kind: UnitKind::Linear, factors, written: false, between_points: false })))
    }

    /// The same as one that is in a text.
    #[must_use]
    pub fn as_written(&self) -> Self {
        if self.0.written { self.clone() } else { Self(Arc::new(Meaning { written: true, ..(*self.0).clone() })) }
    }

    /// Returns `true` if numbers in this unit count something without a name: arithmetic made it,
    /// of units of one dimension in several sizes (`min/h`, `L/m`, `% kg`).
    #[must_use]
    pub fn is_unnamed(&self) -> bool {
        let factors = &self.0.factors;
        // A factor that is not a symbol is a number.
        let parts: Vec<(Dimension, bool)> = factors
            .iter()
            .map(|factor| factor.unit().map_or((Dimension::NONE, true), |unit| (unit.0.dimension.clone(), unit.0.scale != Scale::ONE)))
            .collect();
        let ratio = |(dimension, scaled): &(Dimension, bool)| dimension.is_none() && *scaled;
        let alone = matches!(factors.as_slice(), [factor] if factor.exponent == Rational::ONE);
        let mixed = |i: usize| parts[..i].iter().any(|(d, scaled)| (*scaled || parts[i].1) && parts[i].0.is_power_of(d));
        !self.0.written && (parts.iter().any(ratio) && !alone || (0..parts.len()).any(mixed))
    }

    /// The unit of a number.
    #[must_use]
    pub fn one() -> Self {
        static ONE: LazyLock<Unit> = LazyLock::new(|| Unit::new(Dimension::NONE, Scale::ONE, UnitKind::Linear, Vec::new()));
        ONE.clone()
    }

    /// The unit of a symbol, prefix included: `kmol`, `degC`, `%`.
    #[must_use]
    pub fn named(symbol: &str) -> Option<Self> {
        memo::named(symbol, || {
            let (prefix, unit) = table::find(symbol)?;
            let scale = prefix.map_or(unit.scale(), |prefix| prefix.scale().multiply(unit.scale()));
            let kind = unit.zero().map_or(UnitKind::Linear, |zero| UnitKind::Point { zero });
            Some(Self::new(unit.dimension(), scale, kind, vec![Factor::of(symbol)]))
        })
    }

    /// A unit that a model declares: of a new dimension, or `size` units of another one.
    #[must_use]
    pub(super) fn declared(symbol: &str, size: Option<&Self>) -> Self {
        let (dimension, scale) = match size {
            Some(size) => (size.0.dimension.clone(), size.0.scale),
            None => (Dimension::own(symbol), Scale::ONE),
        };
        let bare = Self::new(dimension.clone(), scale, UnitKind::Linear, vec![]);
        Self::new(dimension, scale, UnitKind::Linear, vec![Factor { own: Some(bare), ..Factor::of(symbol) }])
    }

    /// A pure number as a unit, as in `100 mL`; `None` unless it is positive and finite.
    #[must_use]
    pub fn number(value: f64) -> Option<Self> {
        let scale = Scale::from_decimal(value);
        let factors = vec![Factor::of(format!("{value}"))];
        scale.is_valid().then(|| Self::new(Dimension::NONE, scale, UnitKind::Linear, factors))
    }

    /// The dimension.
    #[must_use]
    pub fn dimension(&self) -> &Dimension {
        &self.0.dimension
    }

    /// The size in SI base units.
    #[must_use]
    pub fn scale(&self) -> Scale {
        self.0.scale
    }

    /// Zero point of a number in this unit.
    #[must_use]
    pub fn kind(&self) -> UnitKind {
        self.0.kind
    }

    /// Returns `true` if numbers in this unit are points on a temperature scale.
    #[must_use]
    pub fn is_point(&self) -> bool {
        matches!(self.0.kind, UnitKind::Point { .. })
    }

    /// Returns `true` if this is the unit of numbers: no dimension and size 1.
    #[must_use]
    pub fn is_one(&self) -> bool {
        self.0.dimension.is_none() && self.0.scale == Scale::ONE && !self.is_point()
    }

    /// Returns `true` if two units measure the same kind of thing.
    #[must_use]
    pub fn commensurable(&self, other: &Self) -> bool {
        self.is_same(other) || self.0.dimension == other.0.dimension
    }

    /// Returns `true` if both are one object.
    fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// The unit of differences: `K` for `degC`, the unit itself unless it is a point.
    #[must_use]
    pub fn difference(&self) -> Self {
        match self.0.kind {
            UnitKind::Linear => self.clone(),
            UnitKind::Point { .. } => {
                memo::binary(memo::Operation::Difference, self, self, || Some(self.between())).unwrap_or_else(|| self.between())
            }
        }
    }

    fn between(&self) -> Self {
        let factors = if self.0.scale == Scale::ONE { vec![Factor::of("K")] } else { self.0.factors.clone() };
        Self(Arc::new(Meaning { kind: UnitKind::Linear, factors, between_points: true, ..(*self.0).clone() }))
    }

    /// Returns `true` if its temperature is known to be a difference of two points on a scale.
    #[must_use]
    pub fn is_between_points(&self) -> bool {
        self.0.between_points
    }

    /// The same unit, of what is known to be a difference of two points, or of what is not.
    #[must_use]
    pub fn between_points(&self, known: bool) -> Self {
        if self.0.between_points == known { self.clone() } else { Self(Arc::new(Meaning { between_points: known, ..(*self.0).clone() })) }
    }

    /// Unit of a product of differences; `None` beyond the range of exponents or factors.
    #[must_use]
    pub fn multiply(&self, other: &Self) -> Option<Self> {
        if other.0.factors.is_empty() && other.is_one() {
            return Some(self.difference());
        }
        if self.0.factors.is_empty() && self.is_one() {
            return Some(other.difference());
        }
        memo::binary(memo::Operation::Multiply, self, other, || self.product(other))
    }

    fn product(&self, other: &Self) -> Option<Self> {
        let dimension = self.0.dimension.multiply(&other.0.dimension)?;
        let scale = self.0.scale.multiply(other.0.scale);
        let mut factors = self.difference().0.factors.clone();
        for factor in &other.difference().0.factors {
            add_factor(&mut factors, factor)?;
        }
        let known = !dimension.is_none() && (self.difference().0.between_points || other.difference().0.between_points);
        Some(Self::made(dimension, scale, factors)?.between_points(known))
    }

    /// Unit of a quotient of differences.
    #[must_use]
    pub fn divide(&self, other: &Self) -> Option<Self> {
        memo::binary(memo::Operation::Divide, self, other, || self.product(&other.power(Rational::integer(-1))?))
    }

    /// The same unit by the name of a derived one, with its prefix, where there is one: `kW` for
    /// `kJ/s`.
    #[must_use]
    pub fn simplest(&self) -> Self {
        let symbols =
            ["N", "Pa", "J", "W", "V", "ohm"].into_iter().flat_map(|symbol| ["", "k", "M", "m"].map(|prefix| format!("{prefix}{symbol}")));
        let alike = |unit: &Self| unit == self && self.0.factors.len() > 1;
        symbols.filter_map(|symbol| Self::named(&symbol)).find(alike).unwrap_or_else(|| self.clone())
    }

    /// Unit of a power of a difference.
    #[must_use]
    pub fn power(&self, exponent: Rational) -> Option<Self> {
        if exponent == Rational::ONE {
            return Some(self.difference());
        }
        memo::binary(memo::Operation::Power(exponent), self, self, || self.raised(exponent))
    }

    fn raised(&self, exponent: Rational) -> Option<Self> {
        let mut factors = Vec::with_capacity(self.0.factors.len());
        for factor in &self.difference().0.factors {
            let product = factor.exponent.multiply(exponent)?;
            if !product.is_zero() {
                factors.push(Factor { exponent: product, ..factor.clone() });
            }
        }
        let dimension = self.0.dimension.power(exponent)?;
        let scale = self.0.scale.power(exponent);
        let known = !dimension.is_none() && self.difference().0.between_points;
        Some(Self::made(dimension, scale, factors)?.between_points(known))
    }

    /// By what a number (a difference, for points) in this unit is multiplied to give the number in
    /// `other`; exactly 1 for equal units, `None` for incommensurable ones.
    #[must_use]
    pub fn factor_to(&self, other: &Self) -> Option<f64> {
        self.commensurable(other).then(|| self.0.scale.divide(other.0.scale).value())
    }

    /// From numbers in this unit to numbers in `other`, between temperature scales with the offset.
    /// A linear unit of temperature counts from absolute zero.
    #[must_use]
    pub fn conversion_to(&self, other: &Self) -> Option<Conversion> {
        if self.is_same(other) {
            return Some(Conversion { factor: 1.0, offset: 0.0 });
        }
        let factor = self.factor_to(other)?;
        let zero = |unit: &Self| match unit.0.kind {
            UnitKind::Linear => 0.0,
            UnitKind::Point { zero } => zero,
        };
        Some(Conversion { factor, offset: (zero(self) - zero(other)) / other.0.scale.value() })
    }

    /// Quantity and unit, for messages: `temperature per time [K/min]`, `dimensionless`.
    #[must_use]
    pub fn describe(&self) -> String {
        if self.0.factors.is_empty() {
            return self.0.dimension.describe();
        }
        format!("{} [{self}]", self.0.dimension.describe())
    }
}

/// Units are equal when they mean the same, however they are written.
impl PartialEq for Unit {
    fn eq(&self, other: &Self) -> bool {
        let (a, b) = (&self.0, &other.0);
        self.is_same(other) || a.dimension == b.dimension && a.scale == b.scale && a.kind == b.kind
    }
}

/// `kmol/(m^3 min)`; `1` for the unit of numbers.
impl fmt::Display for Unit {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&dimension::product(self.0.factors.iter().map(|factor| (factor.symbol.as_str(), factor.exponent))))
    }
}

/// Adds a factor to a product, joining powers of one symbol and dropping those that cancel.
fn add_factor(factors: &mut Vec<Factor>, factor: &Factor) -> Option<()> {
    let Some(index) = factors.iter().position(|known| known.symbol == factor.symbol) else {
        factors.push(factor.clone());
        return Some(());
    };
    factors[index].exponent = factors[index].exponent.plus(factor.exponent)?;
    if factors[index].exponent.is_zero() {
        factors.remove(index);
    }
    Some(())
}

/// Results that were worked out before: a model multiplies the same few units over and over.
mod memo {
    use std::cell::RefCell;
    use std::collections::HashMap;
    use std::sync::Arc;

    use super::{Rational, Unit};

    /// Most results that are kept.
    const CAPACITY: usize = 8192;

    #[derive(Clone, Copy, PartialEq, Eq, Hash)]
    pub(super) enum Operation {
        Multiply,
        Divide,
        Power(Rational),
        Difference,
    }

    /// The operands are held, so that no other unit can come to lie at their addresses.
    type Result = (Unit, Unit, Option<Unit>);

    thread_local! {
        static NAMED: RefCell<HashMap<String, Option<Unit>>> = RefCell::default();
        static BINARY: RefCell<HashMap<(Operation, usize, usize), Result>> = RefCell::default();
    }

    pub(super) fn named(symbol: &str, find: impl FnOnce() -> Option<Unit>) -> Option<Unit> {
        if let Some(known) = NAMED.with_borrow(|map| map.get(symbol).cloned()) {
            return known;
        }
        let unit = find();
        NAMED.with_borrow_mut(|map| {
            if map.len() >= CAPACITY {
                map.clear();
            }
            map.insert(symbol.to_owned(), unit.clone());
        });
        unit
    }

    pub(super) fn binary(operation: Operation, a: &Unit, b: &Unit, work: impl FnOnce() -> Option<Unit>) -> Option<Unit> {
        let key = (operation, Arc::as_ptr(&a.0) as usize, Arc::as_ptr(&b.0) as usize);
        if let Some(known) = BINARY.with_borrow(|map| map.get(&key).map(|(_, _, unit)| unit.clone())) {
            return known;
        }
        let unit = work();
        BINARY.with_borrow_mut(|map| {
            if map.len() >= CAPACITY {
                map.clear();
            }
            map.insert(key, (a.clone(), b.clone(), unit.clone()));
        });
        unit
    }
}
