//! Names of elementary functions in C99.

use crate::export::spelling::Spelling;
use crate::ir::UnaryFn;

/// Name of a function; one that begins with `_` follows the prefix of the export.
pub(super) fn spelling(f: UnaryFn) -> Spelling {
    let name = match f {
        UnaryFn::Neg => "-",
        UnaryFn::Abs => "fabs",
        UnaryFn::Sign => return Spelling { name: "_sign", definition: SIGN },
        UnaryFn::Sqrt => "sqrt",
        UnaryFn::Exp => "exp",
        UnaryFn::Ln => "log",
        UnaryFn::Log10 => "log10",
        UnaryFn::Sin => "sin",
        UnaryFn::Cos => "cos",
        UnaryFn::Tan => "tan",
        UnaryFn::Asin => "asin",
        UnaryFn::Acos => "acos",
        UnaryFn::Atan => "atan",
        UnaryFn::Sinh => "sinh",
        UnaryFn::Cosh => "cosh",
        UnaryFn::Tanh => "tanh",
        UnaryFn::Erf => "erf",
        UnaryFn::Floor => "floor",
        UnaryFn::Ceil => "ceil",
        UnaryFn::Round => "rint",
        UnaryFn::Single => "(double)(float)",
        UnaryFn::Smooth => "",
    };
    Spelling::known(name)
}

const SIGN: &str = "static double NAME_sign(double x)
{
    return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x;
}

";
