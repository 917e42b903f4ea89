//! Functions that nodes stand for, and their values.

use serde::{Deserialize, Serialize};

use crate::kernels::{self, Kernel};

/// Functions of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the names say it")]
pub enum UnaryFn {
    Neg,
    Abs,
    /// -1, 0 or 1
    Sign,
    Sqrt,
    Exp,
    Ln,
    Log10,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Floor,
    Ceil,
    /// To the nearest integer, ties to even.
    Round,
    /// To the nearest number of single precision.
    Single,
}

/// Functions of two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the names say it")]
pub enum BinaryFn {
    Add,
    Sub,
    Mul,
    Div,
    Pow,
    Min,
    Max,
    Atan2,
}

/// Comparisons; their result is a truth value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the names say it")]
pub enum Compare {
    Lt,
    Le,
    Eq,
    Ne,
}

/// Reductions over a loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the names say it")]
pub enum ReduceFn {
    Sum,
    Product,
    Min,
    Max,
}

/// What a function of one number is called in a form of a model and in the languages of exports. A name that begins with `_` is that of a
/// function that the export defines itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Spelling {
    /// In the form of a model as JSON.
    pub word: &'static str,
    /// In C99.
    pub c: &'static str,
    /// In CasADi.
    pub casadi: &'static str,
    /// In `jax.numpy`.
    pub jax: &'static str,
}

impl Spelling {
    /// The same name everywhere.
    const fn plain(name: &'static str) -> Self {
        Self { word: name, c: name, casadi: name, jax: name }
    }

    /// The name, and that of functions which the exports define themselves.
    const fn own(word: &'static str, own: &'static str) -> Self {
        Self { word, c: own, casadi: own, jax: own }
    }
}

impl UnaryFn {
    /// All of them.
    pub(crate) const ALL: &[UnaryFn] = &[
        UnaryFn::Neg,
        UnaryFn::Abs,
        UnaryFn::Sign,
        UnaryFn::Sqrt,
        UnaryFn::Exp,
        UnaryFn::Ln,
        UnaryFn::Log10,
        UnaryFn::Sin,
        UnaryFn::Cos,
        UnaryFn::Tan,
        UnaryFn::Asin,
        UnaryFn::Acos,
        UnaryFn::Atan,
        UnaryFn::Sinh,
        UnaryFn::Cosh,
        UnaryFn::Tanh,
        UnaryFn::Floor,
        UnaryFn::Ceil,
        UnaryFn::Round,
        UnaryFn::Single,
    ];

    /// What it is called.
    pub(crate) fn spelling(self) -> Spelling {
        match self {
            UnaryFn::Neg => Spelling::own("negate", "_negate"),
            UnaryFn::Abs => Spelling { c: "fabs", ..Spelling::own("abs", "_abs") },
            UnaryFn::Sign => Spelling::own("sign", "_sign"),
            UnaryFn::Sqrt => Spelling::plain("sqrt"),
            UnaryFn::Exp => Spelling::plain("exp"),
            UnaryFn::Ln => Spelling { word: "ln", ..Spelling::plain("log") },
            UnaryFn::Log10 => Spelling::plain("log10"),
            UnaryFn::Sin => Spelling::plain("sin"),
            UnaryFn::Cos => Spelling::plain("cos"),
            UnaryFn::Tan => Spelling::plain("tan"),
            UnaryFn::Asin => Spelling { jax: "arcsin", ..Spelling::plain("asin") },
            UnaryFn::Acos => Spelling { jax: "arccos", ..Spelling::plain("acos") },
            UnaryFn::Atan => Spelling { jax: "arctan", ..Spelling::plain("atan") },
            UnaryFn::Sinh => Spelling::plain("sinh"),
            UnaryFn::Cosh => Spelling::plain("cosh"),
            UnaryFn::Tanh => Spelling::plain("tanh"),
            UnaryFn::Floor => Spelling::plain("floor"),
            UnaryFn::Ceil => Spelling::plain("ceil"),
            UnaryFn::Round => Spelling { c: "rint", ..Spelling::own("round", "_round") },
            UnaryFn::Single => Spelling::own("single", "_single"),
        }
    }

    /// The kernel that works it out; `None` for those that are single machine instructions.
    #[must_use]
    pub fn kernel(self) -> Option<Kernel> {
        Some(match self {
            UnaryFn::Neg | UnaryFn::Abs | UnaryFn::Sqrt => return None,
            UnaryFn::Exp => Kernel::Exp,
            UnaryFn::Ln => Kernel::Ln,
            UnaryFn::Log10 => Kernel::Log10,
            UnaryFn::Tanh => Kernel::Tanh,
            UnaryFn::Sin => Kernel::Sin,
            UnaryFn::Cos => Kernel::Cos,
            UnaryFn::Tan => Kernel::Tan,
            UnaryFn::Asin => Kernel::Asin,
            UnaryFn::Acos => Kernel::Acos,
            UnaryFn::Atan => Kernel::Atan,
            UnaryFn::Sinh => Kernel::Sinh,
            UnaryFn::Cosh => Kernel::Cosh,
            UnaryFn::Floor => Kernel::Floor,
            UnaryFn::Ceil => Kernel::Ceil,
            UnaryFn::Round => Kernel::Round,
            UnaryFn::Sign => Kernel::Sign,
            UnaryFn::Single => Kernel::Single,
        })
    }

    /// The function's value.
    #[must_use]
    pub fn apply(self, x: f64) -> f64 {
        match self {
            UnaryFn::Neg => -x,
            UnaryFn::Abs => x.abs(),
            UnaryFn::Sign => {
                if x > 0.0 {
                    1.0
                } else if x < 0.0 {
                    -1.0
                } else {
                    x
                }
            }
            UnaryFn::Sqrt => x.sqrt(),
            UnaryFn::Floor => x.floor(),
            UnaryFn::Ceil => x.ceil(),
            UnaryFn::Round => x.round_ties_even(),
            UnaryFn::Single => f64::from(x as f32),
            _ => self.kernel().map_or(f64::NAN, |kernel| kernels::unary(kernel, x)),
        }
    }
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
