//! Units of measure as data: dimensions, exact scales, the table of symbols, and what a
//! [`UnitExpr`] means.
//!
//! A [`Unit`] is a dimension, the size of one unit in SI base units, and the factors as written,
//! for messages. Scales are exact rationals wherever they can be, so that `1 [L]` in `m^3` is
//! exactly `0.001` and equal units convert by exactly 1.
//!
//! `degC` and `degF` alone are *points* on a scale; within a product they stand for differences
//! (`W/(m^2 degC)`).
//!
//! ```
//! use smpl_dsl::units::Unit;
//!
//! let (Some(hour), Some(minute)) = (Unit::named("h"), Unit::named("min")) else { return };
//! assert_eq!(hour.factor_to(&minute), Some(60.0));
//! ```

mod dimension;
mod own;
mod rational;
mod resolve;
mod scale;
mod table;
mod unit;

pub use dimension::{BASES, Dimension};
pub use own::OwnUnits;
pub use rational::Rational;
pub use resolve::resolve;
pub use scale::Scale;
pub use table::{Prefix, Symbol, prefixes, symbols};
pub use unit::{Conversion, Unit, UnitKind};

#[cfg(doc)]
use crate::syntax::UnitExpr;
