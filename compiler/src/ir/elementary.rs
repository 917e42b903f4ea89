//! The elementary functions, those of one number: one table of names and kernels, and the rules of
//! their derivatives. Each exporter has a table of their names in its language.

use serde::{Deserialize, Serialize};

use super::function::BinaryFn;
use crate::kernels::{self, Kernel};

/// Makes the functions of the table: the name of each in JSON, and its kernel (none for those that
/// are single machine instructions).
macro_rules! elementary {
    ($($(#[$about:meta])* $name:ident $word:literal: $kernel:expr;)*) => {
        /// Functions of one number.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[allow(missing_docs, reason = "the names say it")]
        pub enum UnaryFn {
            $($(#[$about])* #[serde(rename = $word)] $name,)*
        }

        impl UnaryFn {
            /// All of them.
            pub(crate) const ALL: &[UnaryFn] = &[$(UnaryFn::$name),*];

            /// The kernel that works it out; `None` for those that are single machine instructions.
            #[must_use]
            pub fn kernel(self) -> Option<Kernel> {
                match self {
                    $(UnaryFn::$name => $kernel,)*
                }
            }
        }
    };
}

elementary! {
    Neg "negate": None;
    Abs "abs": None;
    /// -1, 0 or 1
    Sign "sign": Some(Kernel::Sign);
    Sqrt "sqrt": None;
    Exp "exp": Some(Kernel::Exp);
    Ln "ln": Some(Kernel::Ln);
    Log10 "log10": Some(Kernel::Log10);
    Sin "sin": Some(Kernel::Sin);
    Cos "cos": Some(Kernel::Cos);
    Tan "tan": Some(Kernel::Tan);
    Asin "asin": Some(Kernel::Asin);
    Acos "acos": Some(Kernel::Acos);
    Atan "atan": Some(Kernel::Atan);
    Sinh "sinh": Some(Kernel::Sinh);
    Cosh "cosh": Some(Kernel::Cosh);
    Tanh "tanh": Some(Kernel::Tanh);
    /// The error function.
    Erf "erf": Some(Kernel::Erf);
    Floor "floor": Some(Kernel::Floor);
    Ceil "ceil": Some(Kernel::Ceil);
    /// To the nearest integer, ties to even.
    Round "round": Some(Kernel::Round);
    /// To the nearest number of single precision.
    Single "single": Some(Kernel::Single);
    /// The same number, whose switches the integrator leaves to its error test.
    Smooth "smooth": None;
}

impl UnaryFn {
    /// The function's value.
    #[must_use]
    pub fn apply(self, x: f64) -> f64 {
        match (self, self.kernel()) {
            (UnaryFn::Neg, _) => -x,
            (UnaryFn::Abs, _) => x.abs(),
            (UnaryFn::Sqrt, _) => x.sqrt(),
            (UnaryFn::Smooth, _) => x,
            (_, kernel) => kernel.map_or(f64::NAN, |kernel| kernels::unary(kernel, x)),
        }
    }
}

/// Numbers, or nodes that stand for them: what a rule of differentiation is written in.
pub(crate) trait Arithmetic {
    /// A number.
    type Number: Copy;

    /// A known one.
    fn constant(&mut self, x: f64) -> Self::Number;

    /// A function of one.
    fn unary(&mut self, f: UnaryFn, a: Self::Number) -> Self::Number;

    /// A function of two.
    fn binary(&mut self, f: BinaryFn, a: Self::Number, b: Self::Number) -> Self::Number;

    /// `a^n`
    fn powi(&mut self, a: Self::Number, n: i32) -> Self::Number;

    /// One number where two are equal, else another.
    fn where_equal(&mut self, pair: (Self::Number, Self::Number), then: Self::Number, otherwise: Self::Number) -> Self::Number;
}

/// The derivative of a function of one number.
pub(crate) enum Slope<N> {
    Zero,
    MinusOne,
    /// -1 below zero, 1 above.
    Sign,
    Factor(N),
}

/// The derivative of `f` at `a`, where its value is `value`; zero where it is infinite.
pub(crate) fn slope<A: Arithmetic>(x: &mut A, f: UnaryFn, a: A::Number, value: A::Number) -> Slope<A::Number> {
    use BinaryFn::{Add, Div, Mul, Sub};
    let one = x.constant(1.0);
    Slope::Factor(match f {
        UnaryFn::Neg => return Slope::MinusOne,
        UnaryFn::Abs => return Slope::Sign,
        UnaryFn::Sign | UnaryFn::Floor | UnaryFn::Ceil | UnaryFn::Round => return Slope::Zero,
        UnaryFn::Sqrt => {
            let (half, zero) = (x.constant(0.5), x.constant(0.0));
            let slope = x.binary(Div, half, value);
            x.where_equal((value, zero), zero, slope)
        }
        // Rounding moves a value by less than its last digit: the slope is that of the value
        // itself.
        UnaryFn::Single | UnaryFn::Smooth => one,
        UnaryFn::Exp => value,
        UnaryFn::Ln => x.binary(Div, one, a),
        UnaryFn::Log10 => {
            let factor = x.constant(std::f64::consts::LOG10_E);
            x.binary(Div, factor, a)
        }
        UnaryFn::Sin => x.unary(UnaryFn::Cos, a),
        UnaryFn::Cos => {
            let sine = x.unary(UnaryFn::Sin, a);
            x.unary(UnaryFn::Neg, sine)
        }
        UnaryFn::Tan => {
            let square = x.powi(value, 2);
            x.binary(Add, one, square)
        }
        UnaryFn::Asin | UnaryFn::Acos => {
            let square = x.powi(a, 2);
            let rest = x.binary(Sub, one, square);
            let root = x.unary(UnaryFn::Sqrt, rest);
            let sign = x.constant(if f == UnaryFn::Asin { 1.0 } else { -1.0 });
            x.binary(Div, sign, root)
        }
        UnaryFn::Atan => {
            let square = x.powi(a, 2);
            let sum = x.binary(Add, one, square);
            x.binary(Div, one, sum)
        }
        UnaryFn::Sinh => x.unary(UnaryFn::Cosh, a),
        UnaryFn::Cosh => x.unary(UnaryFn::Sinh, a),
        UnaryFn::Tanh => {
            // (1 - t)(1 + t) loses no digits where t is near 1.
            let (down, up) = (x.binary(Sub, one, value), x.binary(Add, one, value));
            x.binary(Mul, down, up)
        }
        UnaryFn::Erf => {
            let square = x.powi(a, 2);
            let exponent = x.unary(UnaryFn::Neg, square);
            let (bell, factor) = (x.unary(UnaryFn::Exp, exponent), x.constant(std::f64::consts::FRAC_2_SQRT_PI));
            x.binary(Mul, factor, bell)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::UnaryFn;

    #[test]
    fn the_schema_of_models_lists_every_function() {
        let schema = include_str!("../../../docs/schema/model-3.schema.json");
        for f in UnaryFn::ALL {
            let name = serde_json::to_string(f).expect("a name");
            assert!(schema.contains(&name), "{name} is missing");
        }
    }
}
