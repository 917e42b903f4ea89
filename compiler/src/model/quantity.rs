//! Variables as they are seen from outside: names, shapes, units, bounds.

use serde::{Deserialize, Serialize};

use crate::ir::VarId;

/// A value outside the bounds of its variable.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("`{name}` = {} is outside its bounds {}..{}{unit}", plain(*value), plain(*low), plain(*high))]
pub struct OutsideBounds {
    /// Flattened name of the variable.
    pub name: String,
    /// The value.
    pub value: f64,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
    /// Unit, after a blank; empty without a unit.
    pub unit: String,
}

impl OutsideBounds {
    /// Checks that a value is within bounds, but for rounding.
    ///
    /// # Errors
    /// The value with the name and the bounds if it is not.
    pub fn check(name: impl FnOnce() -> String, value: f64, (low, high): (f64, f64), unit: &str) -> Result<(), Self> {
        if Quantity::admits(low, high, value) {
            return Ok(());
        }
        let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
        Err(Self { name: name(), value, low, high, unit })
    }
}

/// All digits of a number, with an exponent if it is very small or large.
fn plain(x: f64) -> String {
    if x == 0.0 || !x.is_finite() || (1e-4..1e9).contains(&x.abs()) { x.to_string() } else { format!("{x:e}") }
}

/// A variable as seen from outside: scalar or array.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quantity {
    /// The variable; `None` for outputs without a variable.
    pub var: Option<VarId>,
    /// Name without indices, `R1.c`.
    pub name: String,
    /// Index sets, outermost first; empty for a scalar.
    pub axes: Vec<Axis>,
    /// Flattened-name pattern `n{}` instead of `n[..]`.
    pub pattern: Option<String>,
    /// Unit as declared; `1` when dimensionless.
    pub unit: String,
    /// Describing text.
    pub text: String,
    /// Lower bound of each element, or one for all; -inf where none.
    pub low: Vec<f64>,
    /// Upper bound likewise; +inf where none.
    pub high: Vec<f64>,
    /// Default, nominal or initial value likewise.
    pub default: Vec<f64>,
    /// Magnitude for absolute tolerances likewise: declared, else the range, else 1.
    pub scale: Vec<f64>,
    /// The unit is a point on a scale (degC).
    pub affine_unit: bool,
    /// Sizes or indices were computed from it (a parameter) when the model was compiled: it has
    /// that value.
    pub structural: bool,
    /// A state that never falls below zero.
    pub nonnegative: bool,
}

/// One index of an array.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Axis {
    /// Members of a set.
    Names(Vec<String>),
    /// Integers from the first on.
    Numbers {
        /// The first number.
        first: i64,
        /// Number of them.
        count: u32,
        /// Name of the set; empty where the text does not name it.
        set: String,
    },
    /// Cells of a domain, numbered from 1.
    Cells {
        /// Index in [`super::Interface::grids`].
        grid: u32,
        /// Number of them.
        count: u32,
    },
}

/// Positions of the cells of a domain.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// Name of the domain.
    pub name: String,
    /// Unit of its coordinate.
    pub unit: String,
    /// Faces of the cells, one more than there are cells, for parameters as they were when the
    /// model was compiled; empty where that does not tell.
    pub faces: Vec<f64>,
    /// The elements of parameters that the faces depend on, with the values that they had.
    pub parameters: Vec<(VarId, u32, f64)>,
}

impl Quantity {
    /// Number of elements.
    #[must_use]
    pub fn len(&self) -> usize {
        self.axes.iter().map(Axis::len).product()
    }

    /// Returns `true` if there is no element.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Flattened name of an element, `R1.c[tropine,3]`.
    #[must_use]
    pub fn element_name(&self, element: usize) -> String {
        let label = self.label(element);
        match &self.pattern {
            Some(pattern) => pattern.replace("{}", &label),
            None if self.axes.is_empty() => self.name.clone(),
            None => format!("{}[{label}]", self.name),
        }
    }

    /// The indices of an element as its name shows them, `tropine,3`; empty for a scalar.
    #[must_use]
    pub fn label(&self, element: usize) -> String {
        let mut labels = Vec::with_capacity(self.axes.len());
        let mut rest = element;
        for axis in self.axes.iter().rev() {
            labels.push(axis.label(rest % axis.len().max(1)));
            rest /= axis.len().max(1);
        }
        labels.reverse();
        labels.join(",")
    }

    /// Checks that a number is within the bounds of an element.
    ///
    /// # Errors
    /// [`OutsideBounds`] if it is not.
    pub fn check(&self, element: usize, value: f64) -> Result<(), OutsideBounds> {
        let bounds = (self.least(element), Self::pick(&self.high, element));
        OutsideBounds::check(|| self.element_name(element), value, bounds, &self.unit)
    }

    /// Returns `true` if a number is within bounds, but for rounding.
    #[must_use]
    pub fn admits(low: f64, high: f64, x: f64) -> bool {
        let size = |bound: f64| if bound.is_finite() { bound.abs() } else { 0.0 };
        let slack = 1e-12 * size(low).max(size(high));
        x >= low - slack && x <= high + slack
    }

    /// Least value of an element: its lower bound, at least zero for nonnegative states.
    #[must_use]
    pub fn least(&self, element: usize) -> f64 {
        let low = Self::pick(&self.low, element);
        if self.nonnegative { low.max(0.0) } else { low }
    }

    /// One of `low`, `high`, `default`, `scale` at an element.
    #[must_use]
    pub fn pick(values: &[f64], element: usize) -> f64 {
        match values {
            [] => f64::NAN,
            [one] => *one,
            many => many.get(element).copied().unwrap_or(f64::NAN),
        }
    }
}

impl Axis {
    /// Number of members.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Axis::Names(names) => names.len(),
            Axis::Numbers { count, .. } | Axis::Cells { count, .. } => *count as usize,
        }
    }

    /// Returns `true` if it has no member.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Label of a member.
    #[must_use]
    pub fn label(&self, i: usize) -> String {
        match self {
            Axis::Names(names) => names.get(i).cloned().unwrap_or_default(),
            Axis::Numbers { first, .. } => (first + i as i64).to_string(),
            Axis::Cells { .. } => (i + 1).to_string(),
        }
    }
}
