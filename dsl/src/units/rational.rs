//! Exact fractions with checked arithmetic.

use std::fmt;

/// A fraction in lowest terms with a positive denominator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Rational {
    numerator: i128,
    denominator: i128,
}

impl Rational {
    /// 0
    pub const ZERO: Self = Self { numerator: 0, denominator: 1 };
    /// 1
    pub(crate) const ONE: Self = Self { numerator: 1, denominator: 1 };

    /// Largest denominator of an exponent of a unit: six decimals.
    pub(crate) const FINEST: i128 = 1_000_000;

    /// An exponent of a quantity: a fraction with a small denominator, or a number with at most six
    /// decimals.
    #[must_use]
    pub fn exponent(value: f64) -> Option<Self> {
        let nearest = |d: i32| {
            let n = value * f64::from(d);
            ((n - n.round()).abs() < 1e-12 && n.abs() < 1e4).then(|| Self::new(n.round() as i128, i128::from(d)))?
        };
        // Rounding of arithmetic: `1 + 0.32` is 33/25.
        let decimals = || {
            let n = value * Self::FINEST as f64;
            let is_near = (n - n.round()).abs() < 1e-9 * n.abs().max(1.0) && n.abs() < 1e10;
            is_near.then(|| Self::new(n.round() as i128, Self::FINEST)).flatten()
        };
        (1..=12).find_map(nearest).or_else(decimals)
    }

    /// `numerator / denominator`; `None` for a denominator of zero or beyond the range.
    #[must_use]
    pub fn new(numerator: i128, denominator: i128) -> Option<Self> {
        let divisor = gcd(numerator, denominator)?;
        let sign = denominator.signum();
        Some(Self { numerator: (numerator / divisor).checked_mul(sign)?, denominator: (denominator / divisor).checked_mul(sign)? })
    }

    /// An integer.
    #[must_use]
    pub const fn integer(value: i32) -> Self {
        Self { numerator: value as i128, denominator: 1 }
    }

    /// A finite decimal, exactly as its shortest text says (`0.1` is 1/10); `None` where it does
    /// not fit.
    #[must_use]
    pub(crate) fn from_decimal(value: f64) -> Option<Self> {
        let text = format!("{value:e}");
        let (mantissa, exponent) = text.split_once('e')?;
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        let digits: i128 = format!("{whole}{fraction}").parse().ok()?;
        let power = exponent.parse::<i32>().ok()? - i32::try_from(fraction.len()).ok()?;
        let ten = 10_i128.checked_pow(power.unsigned_abs())?;
        if power < 0 { Self::new(digits, ten) } else { Self::new(digits.checked_mul(ten)?, 1) }
    }

    /// The numerator; it has the sign.
    #[must_use]
    pub const fn numerator(self) -> i128 {
        self.numerator
    }

    /// The denominator, positive.
    #[must_use]
    pub const fn denominator(self) -> i128 {
        self.denominator
    }

    /// Returns `true` if this is 0.
    #[must_use]
    pub const fn is_zero(self) -> bool {
        self.numerator == 0
    }

    /// The nearest double (to one rounding where both parts are below 2^53).
    #[must_use]
    pub fn to_f64(self) -> f64 {
        self.numerator as f64 / self.denominator as f64
    }

    /// Sum, if it fits.
    #[must_use]
    pub fn plus(self, other: Self) -> Option<Self> {
        // Exponents are whole nearly always.
        if self.denominator == 1 && other.denominator == 1 {
            return Some(Self { numerator: self.numerator.checked_add(other.numerator)?, denominator: 1 });
        }
        let left = self.numerator.checked_mul(other.denominator)?;
        let right = other.numerator.checked_mul(self.denominator)?;
        Self::new(left.checked_add(right)?, self.denominator.checked_mul(other.denominator)?)
    }

    /// Product, if it fits.
    #[must_use]
    pub fn multiply(self, other: Self) -> Option<Self> {
        if self.denominator == 1 && other.denominator == 1 {
            return Some(Self { numerator: self.numerator.checked_mul(other.numerator)?, denominator: 1 });
        }
        let a = Self::new(self.numerator, other.denominator)?;
        let b = Self::new(other.numerator, self.denominator)?;
        Self::new(a.numerator.checked_mul(b.numerator)?, a.denominator.checked_mul(b.denominator)?)
    }

    /// `1/x`, unless zero.
    #[must_use]
    pub fn reciprocal(self) -> Option<Self> {
        Self::new(self.denominator, self.numerator)
    }

    /// `-x`
    #[must_use]
    pub fn negate(self) -> Self {
        Self { numerator: -self.numerator, ..self }
    }

    /// A rational power, if the result is rational and fits.
    #[must_use]
    pub fn power(self, exponent: Self) -> Option<Self> {
        let root = u32::try_from(exponent.denominator).ok()?;
        let whole = u32::try_from(exponent.numerator.unsigned_abs()).ok()?;
        let base = if exponent.numerator < 0 { self.reciprocal()? } else { self };
        let base = Self::new(exact_root(base.numerator, root)?, exact_root(base.denominator, root)?)?;
        Self::new(base.numerator.checked_pow(whole)?, base.denominator.checked_pow(whole)?)
    }
}

impl fmt::Display for Rational {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.denominator {
            1 => write!(formatter, "{}", self.numerator),
            2 | 4 | 5 | 10 | 13.. if Self::FINEST % self.denominator == 0 => write!(formatter, "{}", self.to_f64()),
            _ => write!(formatter, "({}/{})", self.numerator, self.denominator),
        }
    }
}

/// Greatest common divisor, positive; `None` where the denominator is zero or a sign cannot be
/// turned.
fn gcd(numerator: i128, denominator: i128) -> Option<i128> {
    if denominator == 0 || numerator == i128::MIN || denominator == i128::MIN {
        return None;
    }
    let (mut a, mut b) = (numerator.abs(), denominator.abs());
    while b != 0 {
        (a, b) = (b, a % b);
    }
    Some(a)
}

/// The integer whose `root`-th power is `value`.
fn exact_root(value: i128, root: u32) -> Option<i128> {
    if root == 1 {
        return Some(value);
    }
    if value < 0 {
        return None;
    }
    let near = (value as f64).powf(1.0 / f64::from(root)).round() as i128;
    (near.saturating_sub(1)..=near.saturating_add(1)).find(|candidate| candidate.checked_pow(root) == Some(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_are_exact() {
        assert_eq!(Rational::from_decimal(0.1), Rational::new(1, 10));
        assert_eq!(Rational::from_decimal(1e-8), Rational::new(1, 100_000_000));
        assert_eq!(Rational::from_decimal(101_325.0), Rational::new(101_325, 1));
        assert_eq!(Rational::from_decimal(1e300), None);
    }

    #[test]
    fn roots_are_taken_only_where_exact() {
        let half = Rational::new(1, 2).unwrap_or(Rational::ONE);
        assert_eq!(Rational::new(9, 4).and_then(|x| x.power(half)), Rational::new(3, 2));
        assert_eq!(Rational::new(1, 1000).and_then(|x| x.power(half)), None);
    }

    #[test]
    fn overflow_is_none() {
        let large = Rational::new(i128::MAX, 1).unwrap_or(Rational::ONE);
        assert_eq!(large.multiply(large), None);
        assert_eq!(Rational::new(1, 0), None);
    }
}
