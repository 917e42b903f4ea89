//! Elementary functions of one and of many numbers, with the same bits everywhere.
//!
//! Constant folding, the interpreter, compiled scalar code and compiled loops all end here, so that
//! a model gives the same numbers whichever way it is run. `exp`, `ln`, `log10`, `pow` and `tanh`
//! are polynomial versions written with fused multiply-add (`math`). One copy is compiled for AVX2
//! with FMA, where loops over arrays run four lanes wide, another for any processor. Both round
//! alike because a fused multiply-add is exact on either. Trigonometric and the other hyperbolic
//! functions are those of the crate `libm`: a C library may have a version for each kind of
//! processor, which differ in the last bit.

mod lists;
mod math;
mod table;

pub use lists::{entry, passed};
pub(crate) use table::UNARY_COUNT;
pub use table::{ArrayKernel, BinaryArrayKernel, BinaryKernel, Kernel, KernelTable, ListKernel, ScalarKernel, table};

/// A function of one number, the same bits as in compiled code.
#[must_use]
pub fn unary(kernel: Kernel, x: f64) -> f64 {
    (table().unary[kernel as usize])(x)
}

/// `x^y`, the same bits as in compiled code.
#[must_use]
pub fn pow(x: f64, y: f64) -> f64 {
    (table().pow)(x, y)
}

/// Angle of the point `(x, y)`: `atan2(y, x)` in the usual order of arguments.
#[must_use]
pub(crate) fn atan2(y: f64, x: f64) -> f64 {
    (table().atan2)(y, x)
}

/// `x^n` by squaring: the order of multiplications that compiled code uses too.
#[must_use]
pub fn powi(x: f64, n: i32) -> f64 {
    let power = power_chain(n.unsigned_abs(), x, |a, b| a * b).unwrap_or(1.0);
    if n < 0 { 1.0 / power } else { power }
}

/// The multiplications of `x^n` by squaring, with any multiplication; `None` for n = 0.
pub(crate) fn power_chain<T: Copy>(mut n: u32, x: T, mut multiply: impl FnMut(T, T) -> T) -> Option<T> {
    let (mut square, mut result) = (x, None);
    while n > 0 {
        if n & 1 == 1 {
            result = Some(match result {
                None => square,
                Some(r) => multiply(r, square),
            });
        }
        n >>= 1;
        if n > 0 {
            square = multiply(square, square);
        }
    }
    result
}

#[cfg(test)]
mod tests;
