//! Tables of function pointers, one for each kind of processor.

use super::math;

unsafe extern "C" fn passed_below(x: f64, limits: *const f64, n: usize) -> f64 {
    // SAFETY: valid for n numbers, by the contract of `ListKernel`.
    super::lists::passed(unsafe { std::slice::from_raw_parts(limits, n) }, false, x)
}

unsafe extern "C" fn passed_up_to(x: f64, limits: *const f64, n: usize) -> f64 {
    // SAFETY: valid for n numbers, by the contract of `ListKernel`.
    super::lists::passed(unsafe { std::slice::from_raw_parts(limits, n) }, true, x)
}

unsafe extern "C" fn entry(index: f64, numbers: *const f64, n: usize) -> f64 {
    // SAFETY: valid for n numbers, by the contract of `ListKernel`.
    super::lists::entry(unsafe { std::slice::from_raw_parts(numbers, n) }, index)
}

/// A function of one number.
pub type ScalarKernel = extern "C" fn(f64) -> f64;
/// A function of two numbers.
pub type BinaryKernel = extern "C" fn(f64, f64) -> f64;
/// A function of each of `n` numbers: source, destination (may be the source), n.
pub type ArrayKernel = unsafe extern "C" fn(*const f64, *mut f64, usize);
/// A function of each of `n` pairs: first and second source, destination (may be a source), n.
pub type BinaryArrayKernel = unsafe extern "C" fn(*const f64, *const f64, *mut f64, usize);

/// A number looked up in a list: the number, the list, its length.
pub type ListKernel = unsafe extern "C" fn(f64, *const f64, usize) -> f64;

/// Functions that compiled code calls; the table's address is an argument of every compiled
/// function, so that code contains no addresses.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct KernelTable {
    /// Functions of one number, by [`Kernel`].
    pub unary: [ScalarKernel; UNARY_COUNT],
    /// The same over arrays.
    pub unary_array: [ArrayKernel; UNARY_COUNT],
    /// `x^y`
    pub pow: BinaryKernel,
    /// `atan2(y, x)`
    pub atan2: BinaryKernel,
    /// `x^y` over arrays.
    pub pow_array: BinaryArrayKernel,
    /// `atan2(y, x)` over arrays.
    pub atan2_array: BinaryArrayKernel,
    /// Numbers of limits below a number, and not above it.
    pub passed: [ListKernel; 2],
    /// The number at an index.
    pub entry: ListKernel,
}

/// The table for this processor.
#[must_use]
pub fn table() -> &'static KernelTable {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
        return &wide::TABLE;
    }
    &portable::TABLE
}

/// The table without instructions beyond the platform's base.
#[cfg(test)]
pub(super) fn portable_table() -> &'static KernelTable {
    &portable::TABLE
}

macro_rules! kernels {
    ($module:ident, $feature:meta, $($scalar:ident $array:ident = $of:expr;)*) => {
        mod $module {
            use super::*;

            $(
                extern "C" fn $scalar(x: f64) -> f64 {
                    #[$feature]
                    fn inner(x: f64) -> f64 {
                        $of(x)
                    }
                    // SAFETY: this table is used only where the processor has the instructions.
                    #[allow(unused_unsafe, reason = "the portable copy needs no instructions")]
                    unsafe { inner(x) }
                }

                unsafe extern "C" fn $array(from: *const f64, to: *mut f64, n: usize) {
                    #[$feature]
                    unsafe fn inner(from: *const f64, to: *mut f64, n: usize) {
                        if std::ptr::eq(from, to) {
                            // SAFETY: valid for n numbers, by the contract of `ArrayKernel`.
                            let values = unsafe { std::slice::from_raw_parts_mut(to, n) };
                            values.iter_mut().for_each(|v| *v = $of(*v));
                        } else {
                            // SAFETY: valid for n numbers and apart, by the contract of
                            // `ArrayKernel`.
                            let (from, to) = unsafe {
                                (std::slice::from_raw_parts(from, n), std::slice::from_raw_parts_mut(to, n))
                            };
                            to.iter_mut().zip(from).for_each(|(v, x)| *v = $of(*x));
                        }
                    }
                    // SAFETY: the instructions are there, see above; the pointers are the caller's
                    // promise.
                    unsafe { inner(from, to, n) }
                }
            )*

            extern "C" fn pow(x: f64, y: f64) -> f64 {
                #[$feature]
                fn inner(x: f64, y: f64) -> f64 {
                    math::pow(x, y)
                }
                // SAFETY: this table is used only where the processor has the instructions.
                #[allow(unused_unsafe, reason = "the portable copy needs no instructions")]
                unsafe { inner(x, y) }
            }

            extern "C" fn exp(x: f64) -> f64 {
                #[$feature]
                fn inner(x: f64) -> f64 {
                    math::exp(x)
                }
                // SAFETY: this table is used only where the processor has the instructions.
                #[allow(unused_unsafe, reason = "the portable copy needs no instructions")]
                unsafe {
                    inner(x)
                }
            }

            unsafe extern "C" fn exp_array(from: *const f64, to: *mut f64, n: usize) {
                #[$feature]
                unsafe fn inner(from: *const f64, to: *mut f64, n: usize) {
                    // SAFETY: valid for n numbers, by the contract of `ArrayKernel`; the borrow
                    // ends before the next one.
                    let any = unsafe { std::slice::from_raw_parts(from, n) }.iter().fold(0, |any, x| any | math::exp_room(*x));
                    if !std::ptr::eq(from, to) {
                        // SAFETY: valid for n numbers and apart, by the contract of `ArrayKernel`.
                        unsafe { std::ptr::copy_nonoverlapping(from, to, n) };
                    }
                    // SAFETY: valid for n numbers, by the contract of `ArrayKernel`.
                    let values = unsafe { std::slice::from_raw_parts_mut(to, n) };
                    if any >= 0 {
                        values.iter_mut().for_each(|v| *v = math::exp_normal(*v));
                    } else {
                        values.iter_mut().for_each(|v| *v = math::exp_any(*v));
                    }
                }
                // SAFETY: the instructions are there, see above; the pointers are the caller's
                // promise.
                unsafe { inner(from, to, n) }
            }

            extern "C" fn atan2(y: f64, x: f64) -> f64 {
                libm::atan2(y, x)
            }

            unsafe extern "C" fn pow_array(x: *const f64, y: *const f64, to: *mut f64, n: usize) {
                #[$feature]
                unsafe fn inner(x: *const f64, y: *const f64, to: *mut f64, n: usize) {
                    // SAFETY: valid for n numbers, by the contract; raw reads because `to` may be a
                    // source.
                    let ordinary = (0..n).fold(true, |all, i| all & unsafe { math::is_ordinary(*x.add(i), *y.add(i)) });
                    let mut chunk = [0.0; 64];
                    let mut start = 0;
                    while start < n {
                        let len = chunk.len().min(n - start);
                        // SAFETY: start + len <= n.
                        let (xs, ys) = unsafe {
                            (std::slice::from_raw_parts(x.add(start), len), std::slice::from_raw_parts(y.add(start), len))
                        };
                        let values = chunk.iter_mut().zip(xs.iter().zip(ys));
                        if ordinary {
                            values.for_each(|(v, (x, y))| *v = math::pow_ordinary(*x, *y));
                        } else {
                            values.for_each(|(v, (x, y))| *v = math::pow(*x, *y));
                        }
                        // SAFETY: start + len <= n, and the sources of this chunk are no longer
                        // borrowed.
                        unsafe { std::ptr::copy_nonoverlapping(chunk.as_ptr(), to.add(start), len) };
                        start += len;
                    }
                }
                // SAFETY: the instructions are there, see above; the pointers are the caller's
                // promise.
                unsafe { inner(x, y, to, n) }
            }

            unsafe extern "C" fn atan2_array(y: *const f64, x: *const f64, to: *mut f64, n: usize) {
                for i in 0..n {
                    // SAFETY: valid for n numbers, by the contract.
                    unsafe { *to.add(i) = libm::atan2(*y.add(i), *x.add(i)) };
                }
            }

            pub(super) static TABLE: KernelTable = KernelTable {
                unary: [exp, $($scalar),*],
                unary_array: [exp_array, $($array),*],
                pow,
                atan2,
                pow_array,
                atan2_array,
                passed: [passed_below, passed_up_to],
                entry,
            };
        }
    };
}

/// The functions, and a table of them for each kind of processor. `exp` is the first, whose array
/// has its own function.
macro_rules! tables {
    ($($(#[$about:meta])* $kernel:ident: $scalar:ident $array:ident = $of:expr;)*) => {
        /// Functions of one number, in the order of [`KernelTable::unary`].
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[allow(missing_docs, reason = "the names say it")]
        pub enum Kernel {
            Exp,
            $($(#[$about])* $kernel,)*
        }

        /// Number of functions in [`KernelTable::unary`].
        pub(crate) const UNARY_COUNT: usize = 1 + [$(Kernel::$kernel),*].len();

        kernels! { portable, inline, $($scalar $array = $of;)* }
        #[cfg(target_arch = "x86_64")]
        kernels! { wide, target_feature(enable = "avx2,fma"), $($scalar $array = $of;)* }
    };
}

tables! {
    Ln: ln ln_array = math::ln;
    Log10: log10 log10_array = math::log10;
    Tanh: tanh tanh_array = math::tanh;
    Sin: sin sin_array = libm::sin;
    Cos: cos cos_array = libm::cos;
    Tan: tan tan_array = libm::tan;
    Erf: erf erf_array = libm::erf;
    Asin: asin asin_array = libm::asin;
    Acos: acos acos_array = libm::acos;
    Atan: atan atan_array = libm::atan;
    Sinh: sinh sinh_array = libm::sinh;
    Cosh: cosh cosh_array = libm::cosh;
    Floor: floor floor_array = f64::floor;
    Ceil: ceil ceil_array = f64::ceil;
    /// To the nearest integer, ties to even.
    Round: round round_array = f64::round_ties_even;
    Sign: sign sign_array = math::sign;
    /// To the nearest number of single precision.
    Single: single single_array = math::single;
}
