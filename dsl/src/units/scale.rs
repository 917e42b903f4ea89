//! The size of a unit in SI base units.

use super::Rational;

/// A positive factor: exact where it can be, a double otherwise (`deg`, or a root of an inexact
/// power).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    exact: Option<Rational>,
    value: f64,
}

impl Scale {
    /// 1
    pub(crate) const ONE: Self = Self { exact: Some(Rational::ONE), value: 1.0 };

    /// An exact factor.
    #[must_use]
    pub fn exact(factor: Rational) -> Self {
        Self { exact: Some(factor), value: factor.to_f64() }
    }

    /// A factor known to double precision.
    #[must_use]
    pub(crate) fn inexact(value: f64) -> Self {
        Self { exact: None, value }
    }

    /// A factor as a decimal number says it.
    #[must_use]
    pub(crate) fn from_decimal(value: f64) -> Self {
        Rational::from_decimal(value).map_or(Self::inexact(value), Self::exact)
    }

    /// The factor as a double.
    #[must_use]
    pub fn value(self) -> f64 {
        self.value
    }

    /// The exact factor, where known.
    #[must_use]
    pub fn rational(self) -> Option<Rational> {
        self.exact
    }

    /// Product.
    #[must_use]
    pub fn multiply(self, other: Self) -> Self {
        let exact = self.exact.zip(other.exact).and_then(|(a, b)| a.multiply(b));
        exact.map_or(Self::inexact(self.value * other.value), Self::exact)
    }

    /// Quotient.
    #[must_use]
    pub fn divide(self, other: Self) -> Self {
        if self == other {
            return Self::ONE;
        }
        let exact = self.exact.zip(other.exact).and_then(|(a, b)| a.multiply(b.reciprocal()?));
        exact.map_or(Self::inexact(self.value / other.value), Self::exact)
    }

    /// Rational power.
    #[must_use]
    pub fn power(self, exponent: Rational) -> Self {
        let exact = self.exact.and_then(|factor| factor.power(exponent));
        exact.map_or_else(|| Self::inexact(self.value.powf(exponent.to_f64())), Self::exact)
    }

    /// Returns `true` if the factor is finite and positive.
    #[must_use]
    pub(crate) fn is_valid(self) -> bool {
        self.value.is_finite() && self.value > 0.0
    }
}
