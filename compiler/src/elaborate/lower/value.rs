//! Values with their units while an expression is built.

use smpl_dsl::units::Unit;

use crate::ir::ExprId;

/// A value under construction.
#[derive(Clone, Debug)]
pub(crate) struct Value {
    /// The node.
    pub expr: ExprId,
    /// Knowledge of its unit.
    pub unit: Measure,
}

/// Knowledge of the unit of a value.
#[derive(Clone, Debug)]
pub(crate) enum Measure {
    /// Part of an error already reported: fits everywhere.
    Poison,
    /// A truth value.
    Truth,
    /// The number 0 without a unit: fits every unit.
    Zero,
    /// The sum of nothing, a 0 whose terms would have had a unit: whatever it is multiplied with
    /// fits every unit too.
    Nothing,
    /// A pure number in which no declared quantity occurs: a place that declares a unit may take it
    /// as a number of that unit.
    Bare,
    /// A quantity; the number counts this unit.
    Of(Unit),
}

impl Value {
    /// A value with a unit.
    pub(crate) fn of(expr: ExprId, unit: Unit) -> Self {
        Value { expr, unit: Measure::Of(unit) }
    }

    /// A truth value.
    pub(crate) fn truth(expr: ExprId) -> Self {
        Value { expr, unit: Measure::Truth }
    }

    /// A pure number.
    pub(crate) fn bare(expr: ExprId) -> Self {
        Value { expr, unit: Measure::Bare }
    }

    /// Returns `true` if an error was already reported for it.
    pub(crate) fn is_poison(&self) -> bool {
        matches!(self.unit, Measure::Poison)
    }
}

impl Measure {
    /// The unit of a number (poison, zero and bare numbers count as dimensionless).
    pub(crate) fn unit(&self) -> Unit {
        match self {
            Measure::Of(unit) => unit.clone(),
            _ => Unit::one(),
        }
    }

    /// Common measure of two values: 0 fits everything; a pure number that meets a quantity is a
    /// dimensionless quantity and no longer a number for whatever unit is declared.
    pub(crate) fn beside(&self, other: &Measure) -> Measure {
        match (self, other) {
            (Measure::Zero | Measure::Nothing, m) => m.clone(),
            (Measure::Bare, Measure::Of(_)) => Measure::Of(Unit::one()),
            (m, _) => m.clone(),
        }
    }

    /// Returns `true` if the value is a pure number or fits everywhere.
    pub(crate) fn is_plain(&self) -> bool {
        matches!(self, Measure::Poison | Measure::Zero | Measure::Nothing | Measure::Bare)
    }

    /// Returns `true` if the value fits every unit.
    pub(crate) fn is_zero(&self) -> bool {
        matches!(self, Measure::Zero | Measure::Nothing)
    }
}
