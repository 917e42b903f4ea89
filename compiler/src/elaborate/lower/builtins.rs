//! The functions that every model knows: one table, from which calls, suggestions and the book's
//! page come.
//!
//! A new function is an entry here. A function of one number is also a variant of [`UnaryFn`] with
//! its kernel, its rule of differentiation and its name in each exporter.

use crate::ir::{BinaryFn, Flavour, ReduceFn, UnaryFn};

/// A built-in function.
#[derive(Clone, Copy, Debug)]
pub struct Builtin {
    /// Its name.
    pub name: &'static str,
    /// Usage, for the book.
    pub usage: &'static str,
    /// Meaning, in one line; equal lines are merged in the book.
    pub meaning: &'static str,
    /// Arguments of a call; `None` where the call looks at them itself.
    pub(in crate::elaborate) arity: Option<usize>,
    /// Kind of a call; `None` for reductions over a set only.
    pub(in crate::elaborate) call: Option<Call>,
    /// Reduction over a set, `sum(x for i in set)`.
    pub(in crate::elaborate) over: Option<Over>,
}

/// Kind of a call of a built-in function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::elaborate) enum Call {
    /// A function of a dimensionless number.
    Elementary(UnaryFn),
    /// A number or a quantity rounded.
    Rounding(UnaryFn),
    /// A function of an amount, not of a point on a temperature scale.
    OfAmount(UnaryFn),
    /// A power.
    Power(f64),
    /// The least or greatest of several.
    Extremum(BinaryFn),
    /// `clip(x, low, high)`
    Clip,
    /// `atan2(y, x)`
    Atan2,
    /// `mod(a, b)`
    Modulo,
    /// `der(x)`
    Derivative,
    /// The same expression at another instant.
    Frame(Flavour),
    /// `integral(e)` over the step.
    Quadrature,
    /// `delay(e, theta)`, `delay(e, theta, before = e0)`
    Delay,
    /// `transport(c, v, L)`
    Transport,
    /// `kelvin(T)`
    Kelvin,
    /// `celsius(T)`
    Celsius,
    /// `value(x)`, `value(x, unit)`
    Value,
    /// A declared number of a variable.
    Attribute(Attribute),
    /// A condition on a box; `true` where it holds inside.
    Box(bool),
    /// A random number.
    Random(Distribution),
    /// `div(J[z])`
    Divergence,
    /// `grad(c[z])`
    Gradient,
    /// `smooth(x)`
    Smooth,
    /// `upwind(v, c[z])`
    Upwind,
    /// The length of a cell.
    Width,
    /// Its measure.
    Volume,
}

/// A number that is declared with a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::elaborate) enum Attribute {
    /// Lower bound.
    Low,
    /// Upper bound.
    High,
    /// Scale.
    Scale,
    /// Default.
    Nominal,
}

/// A distribution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::elaborate) enum Distribution {
    /// Between two numbers.
    Uniform,
    /// By mean and standard deviation.
    Normal,
    /// Whose logarithm is normal.
    Lognormal,
}

/// Reduction of a function over a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::elaborate) enum Over {
    /// A sum, product, minimum or maximum.
    Reduce(ReduceFn),
    /// The index of the maximum or minimum.
    Index(ReduceFn),
    /// A value between the places of an array.
    Between,
    /// The mean, weighted over cells.
    Mean,
    /// The integral over space.
    Integral,
    /// True if a condition holds for any.
    Any,
    /// True if it holds for all.
    All,
}

const fn call(name: &'static str, usage: &'static str, arity: usize, call: Call, meaning: &'static str) -> Builtin {
    Builtin { name, usage, meaning, arity: Some(arity), call: Some(call), over: None }
}

const fn any_call(name: &'static str, usage: &'static str, call: Call, meaning: &'static str) -> Builtin {
    Builtin { name, usage, meaning, arity: None, call: Some(call), over: None }
}

const fn over(name: &'static str, usage: &'static str, over: Over, meaning: &'static str) -> Builtin {
    Builtin { name, usage, meaning, arity: None, call: None, over: Some(over) }
}

const fn also(builtin: Builtin, over: Over) -> Builtin {
    Builtin { over: Some(over), ..builtin }
}

const ELEMENTARY: &str = "of a dimensionless number";
const ROUNDING: &str = "to a whole number, down, up, to the nearest (ties to even): of a ratio the number (`floor(t/(1 [h]))`, whatever the unit of `t` is), of a quantity its number in its declared unit";
const FRAME: &str = "value of `e` at the start of the episode (time 0), at the end of the step before (at the start, in the first step), at the steady state; with `t`, tables over time, `n` and `clock` at that instant, actions at the start at their nominal values. `previous` is not of `previous`: keep it in a discrete variable";
const TEMPERATURE: &str = "absolute temperature, point in degC, see Units";
const DECLARED: &str = "declared bounds, scale, default of a variable";
const BOX: &str = "whether a variable, or an element of an array, is outside of its declared bounds, all are inside; with the slack of 1e-6 of each range. `bounds(states)` are all states, `bounds(observations)` what the model observes at the chosen level, with the bounds given there";
const RANDOM: &str = "random numbers, in `~` only; `noise` takes `normal(0, sd)`";
const CELL: &str = "length and measure of the cell `z`, an index bound by `for`";
const QUANTIFIED: &str = "whether a condition holds for any, for all";
const INDEX: &str = "the index of the greatest, of the least, the first one of equal values: the number of a member, its position in a set of names, the centre of a cell";
const EXTREMUM: &str = "the least, the greatest of two or more, or over a set: `min(x[i] for i in set)`";

/// All of them.
pub const BUILTINS: &[Builtin] = &[
    call("exp", "exp(x)", 1, Call::Elementary(UnaryFn::Exp), ELEMENTARY),
    call("ln", "ln(x)", 1, Call::Elementary(UnaryFn::Ln), ELEMENTARY),
    call("log10", "log10(x)", 1, Call::Elementary(UnaryFn::Log10), ELEMENTARY),
    call("sin", "sin(x)", 1, Call::Elementary(UnaryFn::Sin), ELEMENTARY),
    call("cos", "cos(x)", 1, Call::Elementary(UnaryFn::Cos), ELEMENTARY),
    call("tan", "tan(x)", 1, Call::Elementary(UnaryFn::Tan), ELEMENTARY),
    call("asin", "asin(x)", 1, Call::Elementary(UnaryFn::Asin), ELEMENTARY),
    call("acos", "acos(x)", 1, Call::Elementary(UnaryFn::Acos), ELEMENTARY),
    call("atan", "atan(x)", 1, Call::Elementary(UnaryFn::Atan), ELEMENTARY),
    call("sinh", "sinh(x)", 1, Call::Elementary(UnaryFn::Sinh), ELEMENTARY),
    call("cosh", "cosh(x)", 1, Call::Elementary(UnaryFn::Cosh), ELEMENTARY),
    call("tanh", "tanh(x)", 1, Call::Elementary(UnaryFn::Tanh), ELEMENTARY),
    call("erf", "erf(x)", 1, Call::Elementary(UnaryFn::Erf), ELEMENTARY),
    call("atan2", "atan2(y, x)", 2, Call::Atan2, "angle of the point `(x, y)`, both in one unit"),
    call("sqrt", "sqrt(x)", 1, Call::Power(0.5), "square root and square, of units too"),
    call("sq", "sq(x)", 1, Call::Power(2.0), "square root and square, of units too"),
    call("abs", "abs(x)", 1, Call::OfAmount(UnaryFn::Abs), "absolute value; -1, 0 or 1"),
    call("sign", "sign(x)", 1, Call::OfAmount(UnaryFn::Sign), "absolute value; -1, 0 or 1"),
    call("smooth", "smooth(x)", 1, Call::Smooth, "the same, but its switches are not located: the error test alone sees them"),
    call("floor", "floor(x)", 1, Call::Rounding(UnaryFn::Floor), ROUNDING),
    call("ceil", "ceil(x)", 1, Call::Rounding(UnaryFn::Ceil), ROUNDING),
    call("round", "round(x)", 1, Call::Rounding(UnaryFn::Round), ROUNDING),
    call("single", "single(x)", 1, Call::Rounding(UnaryFn::Single), "to the nearest number of single precision"),
    call("mod", "mod(a, b)", 2, Call::Modulo, "what is left of `a` after whole multiples of `b`, with the sign of `b`"),
    call("clip", "clip(x, low, high)", 3, Call::Clip, "the number, or the bound that it passes"),
    also(any_call("min", "min(a, b)", Call::Extremum(BinaryFn::Min), EXTREMUM), Over::Reduce(ReduceFn::Min)),
    also(any_call("max", "max(a, b)", Call::Extremum(BinaryFn::Max), EXTREMUM), Over::Reduce(ReduceFn::Max)),
    over("argmax", "argmax(x[i] for i in set)", Over::Index(ReduceFn::Max), INDEX),
    over("argmin", "argmin(x[i] for i in set)", Over::Index(ReduceFn::Min), INDEX),
    over(
        "interp",
        "interp(T[z], z = x)",
        Over::Between,
        "value of an array at a place: straight lines between the centres of the cells of a domain, or between the numbers of a set, the nearest value beyond them",
    ),
    over("sum", "sum(x[i] for i in set)", Over::Reduce(ReduceFn::Sum), "sum, product over a set"),
    over("product", "product(x[i] for i in set)", Over::Reduce(ReduceFn::Product), "sum, product over a set"),
    over("mean", "mean(x[i] for i in set)", Over::Mean, "mean; over cells weighted with their measure"),
    over("any", "any(c[i] for i in set)", Over::Any, QUANTIFIED),
    over("all", "all(c[i] for i in set)", Over::All, QUANTIFIED),
    call("initial", "initial(e)", 1, Call::Frame(Flavour::Initial), FRAME),
    call("previous", "previous(e)", 1, Call::Frame(Flavour::Previous), FRAME),
    call("steady", "steady(e)", 1, Call::Frame(Flavour::Steady), FRAME),
    call(
        "sampled",
        "sampled(e)",
        1,
        Call::Frame(Flavour::Previous),
        "value of `e` at the start of the step, before `at start`, held over the step; the same as `previous(e)`, for equations with sampled measurements",
    ),
    also(
        call(
            "integral",
            "integral(e)",
            1,
            Call::Quadrature,
            "integral over the step, by quadrature; outside equations. `integral(e for z)`: over the cells of a domain",
        ),
        Over::Integral,
    ),
    any_call(
        "delay",
        "delay(e, theta)`, `delay(e, theta, before = e0)",
        Call::Delay,
        "value of `e` a dead time `theta` ago, see [Dead time](dead-time.md); before the start the value at the start, or `e0`",
    ),
    any_call(
        "transport",
        "transport(c, v, L)",
        Call::Transport,
        "value of `c` where a plug flow of velocity `v` entered a length `L` ago, see [Dead time](dead-time.md#plug-flow)",
    ),
    call("der", "der(x)", 1, Call::Derivative, "time derivative, on a right side too"),
    call("kelvin", "kelvin(T)", 1, Call::Kelvin, TEMPERATURE),
    call("celsius", "celsius(T)", 1, Call::Celsius, TEMPERATURE),
    any_call("value", "value(x)`, `value(x, unit)", Call::Value, "the number without its unit, in its own or in another one, see Units"),
    call("low", "low(x)", 1, Call::Attribute(Attribute::Low), DECLARED),
    call("high", "high(x)", 1, Call::Attribute(Attribute::High), DECLARED),
    call("scale", "scale(x)", 1, Call::Attribute(Attribute::Scale), DECLARED),
    call("nominal", "nominal(x)", 1, Call::Attribute(Attribute::Nominal), DECLARED),
    call("outside", "outside bounds(x, y, ...)", 1, Call::Box(false), BOX),
    call("inside", "inside bounds(x, y, ...)", 1, Call::Box(true), BOX),
    call("uniform", "uniform(a, b)", 2, Call::Random(Distribution::Uniform), RANDOM),
    call("normal", "normal(mean, sd)", 2, Call::Random(Distribution::Normal), RANDOM),
    call("lognormal", "lognormal(mu, sigma)", 2, Call::Random(Distribution::Lognormal), RANDOM),
    call("div", "div(J[z])", 1, Call::Divergence, "divergence of a flux, see Space"),
    call("grad", "grad(c[z])", 1, Call::Gradient, "gradient at a face, inside a `flux`"),
    call("upwind", "upwind(v, c[z])", 2, Call::Upwind, "value from the side that the flow comes from, inside a `flux`"),
    call("width", "width(z)", 1, Call::Width, CELL),
    call("volume", "volume(z)", 1, Call::Volume, CELL),
];

/// The built-in function of a name.
pub(in crate::elaborate) fn find(name: &str) -> Option<&'static Builtin> {
    BUILTINS.iter().find(|b| b.name == name)
}

/// The names, for suggestions.
pub(in crate::elaborate) fn names<'n>() -> impl Iterator<Item = &'n str> {
    BUILTINS.iter().map(|b| b.name)
}
