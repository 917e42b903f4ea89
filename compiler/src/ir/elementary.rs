//! The elementary functions, those of one number: one table of their kernels, their names in other
//! languages, and the rules of their derivatives.

use serde::{Deserialize, Serialize};

use super::function::BinaryFn;
use crate::kernels::{self, Kernel};

/// Names of a function of one number in JSON and in the languages of exports. A name that begins
/// with `_` is that of a function that the export defines itself.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spelling {
    /// In the form of a model as JSON.
    pub word: &'static str,
    /// In C99.
    pub c: &'static str,
    /// In CasADi.
    pub casadi: &'static str,
    /// In `jax.numpy`.
    pub jax: &'static str,
    /// Definitions of those that begin with `_`, where nothing else in the export defines them.
    pub defined: Defined,
}

/// Definitions of a function for exports; empty where a language has it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Defined {
    /// In C99, where `NAME` is the prefix of the export.
    pub c: &'static str,
    /// In CasADi, by functions of the module `ca`.
    pub casadi: &'static str,
    /// In JAX, by functions of the module `jnp`.
    pub jax: &'static str,
}

impl Spelling {
    /// The same name everywhere.
    const fn plain(name: &'static str) -> Self {
        Self { word: name, c: name, casadi: name, jax: name, defined: NOTHING }
    }

    /// The name, and that of functions which the exports define themselves.
    const fn own(word: &'static str, own: &'static str, defined: Defined) -> Self {
        Self { word, c: own, casadi: own, jax: own, defined }
    }
}

const NOTHING: Defined = Defined { c: "", casadi: "", jax: "" };

/// Makes the functions of the table: what works each out (nothing for those that are single machine
/// instructions), and its names.
macro_rules! elementary {
    ($($(#[$about:meta])* $name:ident: $kernel:expr, $spelling:expr;)*) => {
        /// Functions of one number.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[allow(missing_docs, reason = "the names say it")]
        pub enum UnaryFn {
            $($(#[$about])* $name,)*
        }

        impl UnaryFn {
            /// All of them.
            pub(crate) const ALL: &[UnaryFn] = &[$(UnaryFn::$name),*];

            /// Name.
            pub(crate) fn spelling(self) -> Spelling {
                match self {
                    $(UnaryFn::$name => $spelling,)*
                }
            }

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
    Neg: None, Spelling::own("negate", "_negate", NOTHING);
    Abs: None, Spelling { c: "fabs", ..Spelling::own("abs", "_abs", NOTHING) };
    /// -1, 0 or 1
    Sign: Some(Kernel::Sign), Spelling::own("sign", "_sign", SIGN);
    Sqrt: None, Spelling::plain("sqrt");
    Exp: Some(Kernel::Exp), Spelling::plain("exp");
    Ln: Some(Kernel::Ln), Spelling { word: "ln", ..Spelling::plain("log") };
    Log10: Some(Kernel::Log10), Spelling::plain("log10");
    Sin: Some(Kernel::Sin), Spelling::plain("sin");
    Cos: Some(Kernel::Cos), Spelling::plain("cos");
    Tan: Some(Kernel::Tan), Spelling::plain("tan");
    Asin: Some(Kernel::Asin), Spelling { jax: "arcsin", ..Spelling::plain("asin") };
    Acos: Some(Kernel::Acos), Spelling { jax: "arccos", ..Spelling::plain("acos") };
    Atan: Some(Kernel::Atan), Spelling { jax: "arctan", ..Spelling::plain("atan") };
    Sinh: Some(Kernel::Sinh), Spelling::plain("sinh");
    Cosh: Some(Kernel::Cosh), Spelling::plain("cosh");
    Tanh: Some(Kernel::Tanh), Spelling::plain("tanh");
    Floor: Some(Kernel::Floor), Spelling::plain("floor");
    Ceil: Some(Kernel::Ceil), Spelling::plain("ceil");
    /// To the nearest integer, ties to even.
    Round: Some(Kernel::Round), Spelling { c: "rint", ..Spelling::own("round", "_round", ROUND) };
    /// To the nearest number of single precision.
    Single: Some(Kernel::Single), Spelling::own("single", "_single", SINGLE);
    /// The same number, whose switches the integrator leaves to its error test. Other languages
    /// write nothing.
    Smooth: None, Spelling { word: "smooth", c: "", casadi: "", jax: "", defined: NOTHING };
}

const SIGN: Defined = Defined {
    c: "static double NAME_sign(double x)
{
    return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x;
}

",
    // One that can be smooth, and an alias, are next to the others of their kind.
    ..NOTHING
};

const ROUND: Defined = Defined {
    casadi: r#"
def _round(a):
    """To the nearest integer, ties to even."""
    low = ca.floor(a)
    up = ca.logic_or(a - low > 0.5, ca.logic_and(a - low == 0.5, low / 2.0 != ca.floor(low / 2.0)))
    return low + up
"#,
    ..NOTHING
};

const SINGLE: Defined = Defined {
    // In C a conversion there and back.
    c: "",
    casadi: r#"
def _single(a):
    """To the nearest number of single precision, by Veltkamp's splitting."""
    big = 536870913.0 * a
    return big - (big - a)
"#,
    jax: "
def _single(a):
    return jnp.asarray(a, dtype=jnp.float32).astype(jnp.asarray(a).dtype)
",
};

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
    })
}
