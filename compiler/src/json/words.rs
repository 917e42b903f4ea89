//! The words of the form: each meaning has one, which the compiler sees to, and the reader finds
//! the meaning of a word by it.

use crate::ir::{BinaryFn, Compare, Flavour, ReduceFn, Role, Side, UnaryFn};
use crate::model::{Instant, Lag, LinearSolver, Method, Variate};

/// Values written as words.
pub(super) trait Word: Copy + 'static {
    /// All that can be read.
    const ALL: &'static [Self];

    /// The word.
    fn word(self) -> &'static str;
}

/// The meaning of a word.
pub(super) fn meaning<T: Word>(word: &str) -> Option<T> {
    T::ALL.iter().copied().find(|known| known.word() == word)
}

impl Word for Role {
    const ALL: &'static [Role] = &[
        Role::State,
        Role::Algebraic,
        Role::Param,
        Role::Action,
        Role::Discrete,
        Role::Disturbance,
        Role::Draw,
        Role::Quadrature,
        Role::Delayed,
        Role::Builtin,
        Role::ParamGiven,
        Role::Scratch,
    ];

    fn word(self) -> &'static str {
        match self {
            Role::State => "state",
            Role::Algebraic => "algebraic",
            Role::Param => "parameter",
            Role::Action => "action",
            Role::Discrete => "discrete",
            Role::Disturbance => "disturbance",
            Role::Draw => "draw",
            Role::Quadrature => "integral",
            Role::Delayed => "delayed",
            Role::Builtin => "builtin",
            Role::ParamGiven => "given",
            Role::Scratch => "scratch",
            Role::Cache => "cache",
        }
    }
}

impl Word for Flavour {
    const ALL: &'static [Flavour] = &[Flavour::Value, Flavour::Derivative, Flavour::Initial, Flavour::Previous, Flavour::Steady];

    fn word(self) -> &'static str {
        match self {
            Flavour::Value => "value",
            Flavour::Derivative => "derivative",
            Flavour::Initial => "initial",
            Flavour::Previous => "previous",
            Flavour::Steady => "steady",
        }
    }
}

impl Word for Side {
    const ALL: &'static [Side] = &[Side::Below, Side::UpTo];

    fn word(self) -> &'static str {
        match self {
            Side::Below => "passed_below",
            Side::UpTo => "passed_up_to",
        }
    }
}

impl Word for UnaryFn {
    const ALL: &'static [UnaryFn] = UnaryFn::ALL;

    fn word(self) -> &'static str {
        UnaryFn::word(self)
    }
}

impl Word for BinaryFn {
    const ALL: &'static [BinaryFn] =
        &[BinaryFn::Add, BinaryFn::Sub, BinaryFn::Mul, BinaryFn::Div, BinaryFn::Pow, BinaryFn::Min, BinaryFn::Max, BinaryFn::Atan2];

    fn word(self) -> &'static str {
        match self {
            BinaryFn::Add => "add",
            BinaryFn::Sub => "subtract",
            BinaryFn::Mul => "multiply",
            BinaryFn::Div => "divide",
            BinaryFn::Pow => "power",
            BinaryFn::Min => "min",
            BinaryFn::Max => "max",
            BinaryFn::Atan2 => "atan2",
        }
    }
}

impl Word for Compare {
    const ALL: &'static [Compare] = &[Compare::Lt, Compare::Le, Compare::Eq, Compare::Ne];

    fn word(self) -> &'static str {
        match self {
            Compare::Lt => "less",
            Compare::Le => "less_equal",
            Compare::Eq => "equal",
            Compare::Ne => "unequal",
        }
    }
}

impl Word for ReduceFn {
    const ALL: &'static [ReduceFn] = &[ReduceFn::Sum, ReduceFn::Product, ReduceFn::Min, ReduceFn::Max];

    fn word(self) -> &'static str {
        match self {
            ReduceFn::Sum => "sum",
            ReduceFn::Product => "product",
            ReduceFn::Min => "minimum",
            ReduceFn::Max => "maximum",
        }
    }
}

impl Word for Variate {
    const ALL: &'static [Variate] = &[Variate::Uniform, Variate::Normal];

    fn word(self) -> &'static str {
        match self {
            Variate::Uniform => "uniform",
            Variate::Normal => "normal",
        }
    }
}

impl Word for Instant {
    const ALL: &'static [Instant] = &[Instant::Reset, Instant::Step];

    fn word(self) -> &'static str {
        match self {
            Instant::Reset => "reset",
            Instant::Step => "step",
        }
    }
}

impl Word for Lag {
    const ALL: &'static [Lag] = &[Lag::Constant, Lag::Held, Lag::Varying];

    fn word(self) -> &'static str {
        match self {
            Lag::Constant => "never",
            Lag::Held => "step",
            Lag::Varying => "always",
        }
    }
}

impl Word for LinearSolver {
    const ALL: &'static [LinearSolver] = &LinearSolver::ALL;

    fn word(self) -> &'static str {
        self.name()
    }
}

impl Word for Method {
    const ALL: &'static [Method] = &Method::ALL;

    fn word(self) -> &'static str {
        self.name()
    }
}
