//! The words of the form, each beside what it means: one table for both directions.

use crate::ir::{BinaryFn, Compare, Flavour, ReduceFn, Role, Side, UnaryFn};
use crate::model::{Instant, Variate};

/// A table of meanings and their words.
pub(super) type Words<T> = [(T, &'static str)];

/// The word of a meaning; every meaning that is written has one.
pub(super) fn word<T: PartialEq>(table: &Words<T>, meaning: &T) -> &'static str {
    table.iter().find(|(known, _)| known == meaning).map_or("", |(_, word)| word)
}

/// The meaning of a word.
pub(super) fn meaning<T: Copy>(table: &Words<T>, word: &str) -> Option<T> {
    table.iter().find(|(_, known)| *known == word).map(|(meaning, _)| *meaning)
}

pub(super) const ROLES: [(Role, &str); 11] = [
    (Role::State, "state"),
    (Role::Algebraic, "algebraic"),
    (Role::Param, "parameter"),
    (Role::Action, "action"),
    (Role::Discrete, "discrete"),
    (Role::Disturbance, "disturbance"),
    (Role::Draw, "draw"),
    (Role::Quadrature, "integral"),
    (Role::Builtin, "builtin"),
    (Role::ParamGiven, "given"),
    (Role::Scratch, "scratch"),
];

pub(super) const COPIES: [(Flavour, &str); 5] = [
    (Flavour::Value, "value"),
    (Flavour::Derivative, "derivative"),
    (Flavour::Initial, "initial"),
    (Flavour::Previous, "previous"),
    (Flavour::Steady, "steady"),
];

pub(super) const SIDES: [(Side, &str); 2] = [(Side::Below, "passed_below"), (Side::UpTo, "passed_up_to")];

pub(super) const UNARY: [(UnaryFn, &str); 20] = [
    (UnaryFn::Neg, "negate"),
    (UnaryFn::Abs, "abs"),
    (UnaryFn::Sign, "sign"),
    (UnaryFn::Sqrt, "sqrt"),
    (UnaryFn::Exp, "exp"),
    (UnaryFn::Ln, "ln"),
    (UnaryFn::Log10, "log10"),
    (UnaryFn::Sin, "sin"),
    (UnaryFn::Cos, "cos"),
    (UnaryFn::Tan, "tan"),
    (UnaryFn::Asin, "asin"),
    (UnaryFn::Acos, "acos"),
    (UnaryFn::Atan, "atan"),
    (UnaryFn::Sinh, "sinh"),
    (UnaryFn::Cosh, "cosh"),
    (UnaryFn::Tanh, "tanh"),
    (UnaryFn::Floor, "floor"),
    (UnaryFn::Ceil, "ceil"),
    (UnaryFn::Round, "round"),
    (UnaryFn::Single, "single"),
];

pub(super) const BINARY: [(BinaryFn, &str); 8] = [
    (BinaryFn::Add, "add"),
    (BinaryFn::Sub, "subtract"),
    (BinaryFn::Mul, "multiply"),
    (BinaryFn::Div, "divide"),
    (BinaryFn::Pow, "power"),
    (BinaryFn::Min, "min"),
    (BinaryFn::Max, "max"),
    (BinaryFn::Atan2, "atan2"),
];

pub(super) const COMPARE: [(Compare, &str); 4] =
    [(Compare::Lt, "less"), (Compare::Le, "less_equal"), (Compare::Eq, "equal"), (Compare::Ne, "unequal")];

pub(super) const REDUCE: [(ReduceFn, &str); 4] =
    [(ReduceFn::Sum, "sum"), (ReduceFn::Product, "product"), (ReduceFn::Min, "minimum"), (ReduceFn::Max, "maximum")];

pub(super) const VARIATES: [(Variate, &str); 2] = [(Variate::Uniform, "uniform"), (Variate::Normal, "normal")];

pub(super) const INSTANTS: [(Instant, &str); 2] = [(Instant::Reset, "reset"), (Instant::Step, "step")];
