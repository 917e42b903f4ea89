//! Variables of the flat model: ids, roles, and values from the runtime.

use cranelift_entity::entity_impl;
use serde::{Deserialize, Serialize};

/// A variable of the flat model: a scalar or an array of any number of elements.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct VarId(u32);
entity_impl!(VarId, "v");

/// Storage of a variable's values, and the time of their changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Differential unknown.
    State,
    /// Algebraic unknown, or a variable to be substituted (structure decides).
    Algebraic,
    /// Constant over an episode.
    #[serde(rename = "parameter")]
    Param,
    /// Input held over a step.
    Action,
    /// Changes at sampling instants and events.
    Discrete,
    /// Exogenous sequence, one value a step.
    Disturbance,
    /// Standard variate (uniform on (0,1) or standard normal) filled in by the runtime.
    Draw,
    /// Number of the quadrature over the current step.
    #[serde(rename = "integral")]
    Quadrature,
    /// Earlier values of expressions, filled in by the runtime: [`DELAY_SLOTS`] numbers for each
    /// element, see [`DelaySlot`].
    Delayed,
    /// Values from the runtime: see [`Builtin`].
    Builtin,
    /// 1 where the parameter was given from outside and must not be computed or drawn; same shape
    /// as the parameters.
    #[serde(rename = "given")]
    ParamGiven,
    /// Value computed ahead of the step by a preparing program (hoisted).
    Cache,
    /// Working memory of one call.
    Scratch,
}

/// Elements of the one variable of role [`Role::Builtin`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(u32)]
pub enum Builtin {
    /// Completed steps before the current one.
    Steps = 0,
    /// Time at the start of the step, in the model's unit.
    Clock = 1,
    /// Sampling interval.
    StepLength = 2,
    /// 1 when this step is the last that the limit allows.
    LastStep = 3,
    /// 1 when the step failed for a reason outside the model's conditions (action box, event,
    /// solver).
    Failed = 4,
    /// Largest excess of an action over its box, relative to its range.
    ActionExcess = 5,
    /// Time at the end of the step before; where the episode starts, that. It stands still at
    /// events too, where the clock does not.
    Begin = 6,
    /// Factor of the derivatives in the Jacobian (an argument of that function, not memory).
    DerivativeFactor = 7,
}

/// Numbers of an element of the variable of role [`Role::Delayed`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(u32)]
pub enum DelaySlot {
    /// Earlier value of the expression.
    Value = 0,
    /// Its rate there.
    Slope = 1,
    /// The earlier time.
    At = 2,
    /// Lower bound of the value over a span of time.
    Low = 3,
    /// Upper bound.
    High = 4,
}

/// Number of [`DelaySlot`]s.
pub const DELAY_SLOTS: u32 = 5;

/// Number of elements of the builtin variable.
pub const BUILTIN_COUNT: u32 = 8;
