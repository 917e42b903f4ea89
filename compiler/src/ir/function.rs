//! Functions of several numbers that nodes stand for, and their values.

use serde::{Deserialize, Serialize};

use crate::kernels;

/// Functions of two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the names say it")]
pub enum BinaryFn {
    #[serde(rename = "add")]
    Add,
    #[serde(rename = "subtract")]
    Sub,
    #[serde(rename = "multiply")]
    Mul,
    #[serde(rename = "divide")]
    Div,
    #[serde(rename = "power")]
    Pow,
    #[serde(rename = "min")]
    Min,
    #[serde(rename = "max")]
    Max,
    #[serde(rename = "atan2")]
    Atan2,
}

/// Comparisons; their result is a truth value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the names say it")]
pub enum Compare {
    #[serde(rename = "less")]
    Lt,
    #[serde(rename = "less_equal")]
    Le,
    #[serde(rename = "equal")]
    Eq,
    #[serde(rename = "unequal")]
    Ne,
}

/// Reductions over a loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the names say it")]
pub enum ReduceFn {
    #[serde(rename = "sum")]
    Sum,
    #[serde(rename = "product")]
    Product,
    #[serde(rename = "minimum")]
    Min,
    #[serde(rename = "maximum")]
    Max,
}

impl BinaryFn {
    /// The function's value.
    #[must_use]
    pub fn apply(self, x: f64, y: f64) -> f64 {
        match self {
            BinaryFn::Add => x + y,
            BinaryFn::Sub => x - y,
            BinaryFn::Mul => x * y,
            BinaryFn::Div => x / y,
            BinaryFn::Pow => kernels::pow(x, y),
            // A NaN must come through: a box test or a clip must not hide it.
            BinaryFn::Min => {
                if x.is_nan() || x < y {
                    x
                } else {
                    y
                }
            }
            BinaryFn::Max => {
                if x.is_nan() || x > y {
                    x
                } else {
                    y
                }
            }
            BinaryFn::Atan2 => kernels::atan2(x, y),
        }
    }
}

impl Compare {
    /// The comparison's value; any comparison with NaN but `Ne` is false.
    #[must_use]
    pub fn apply(self, x: f64, y: f64) -> bool {
        match self {
            Compare::Lt => x < y,
            Compare::Le => x <= y,
            Compare::Eq => x == y,
            Compare::Ne => x != y,
        }
    }
}

impl ReduceFn {
    /// The reduction of nothing.
    #[must_use]
    pub fn identity(self) -> f64 {
        match self {
            ReduceFn::Sum => 0.0,
            ReduceFn::Product => 1.0,
            ReduceFn::Min => f64::INFINITY,
            ReduceFn::Max => f64::NEG_INFINITY,
        }
    }

    /// The function of two numbers whose repetition it is.
    #[must_use]
    pub fn binary(self) -> BinaryFn {
        match self {
            ReduceFn::Sum => BinaryFn::Add,
            ReduceFn::Product => BinaryFn::Mul,
            ReduceFn::Min => BinaryFn::Min,
            ReduceFn::Max => BinaryFn::Max,
        }
    }
}
