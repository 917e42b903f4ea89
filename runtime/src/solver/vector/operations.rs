//! The operations that SUNDIALS calls, and our own ones that take vectors.
//!
//! SUNDIALS calls an operation with vectors of one family: all are alive and have the same length.
//! Where the result is written, it may be one of the operands; so these functions work by pointers,
//! and no reference to numbers lives while others are written.

mod common;

use std::os::raw::c_int;
use std::ptr;

use sundials_sys::{_generic_N_Vector_Ops, N_Vector};

use super::Content;
use crate::solver::kernels::{self, Block};
use common::COMMON;

/// Vectors that one fused operation takes (IDA's: its maximum order plus one).
const MAX_FUSED: usize = 16;

/// The content of a vector.
///
/// # Safety
/// The vector is one of ours and alive; so below.
#[inline(always)]
unsafe fn content(vector: N_Vector) -> *mut Content {
    // SAFETY: by the contract.
    unsafe { (*vector).content.cast() }
}

/// Number of blocks.
///
/// # Safety
/// As for [`content`].
#[inline(always)]
unsafe fn block_count(vector: N_Vector) -> usize {
    // SAFETY: by the contract.
    unsafe { (*content(vector)).count }
}

/// Number of entries.
///
/// # Safety
/// As for [`content`].
#[inline(always)]
unsafe fn entry_count(vector: N_Vector) -> usize {
    // SAFETY: by the contract.
    unsafe { (*content(vector)).length }
}

/// The blocks, to be read.
///
/// # Safety
/// As for [`content`].
#[inline(always)]
unsafe fn blocks(vector: N_Vector) -> *const Block {
    // SAFETY: by the contract.
    unsafe { (*content(vector)).blocks.as_ptr() }
}

/// The blocks, to be written: the norm is no longer known.
///
/// # Safety
/// As for [`content`].
#[inline(always)]
unsafe fn written(vector: N_Vector) -> *mut Block {
    // SAFETY: by the contract; no reference to the content lives during an operation.
    unsafe {
        (*content(vector)).age = 0;
        (*content(vector)).blocks.as_ptr()
    }
}

impl Content {
    /// The error weights, where a norm of this vector will be asked for.
    #[inline(always)]
    fn weights(&self) -> Option<ptr::NonNull<Content>> {
        self.shared.as_deref().and_then(|shared| shared.weights.get())
    }

    /// The weighted root mean square from the sum of squares, kept with the vector.
    #[inline(always)]
    fn keep_norm(&mut self, square: f64) {
        self.norm = (square / self.length as f64).sqrt();
        self.age = self.shared.as_ref().map_or(0, |shared| shared.age.get());
    }

    /// The norm with these weights, if it is known.
    #[inline(always)]
    pub(super) fn known_norm(&self, weights: *const Content) -> Option<f64> {
        let shared = self.shared.as_deref()?;
        let known = self.age > 0 && self.age == shared.age.get() && shared.weights.get().is_some_and(|w| ptr::eq(w.as_ptr(), weights));
        known.then_some(self.norm)
    }

    /// Returns `true` if a sum of `y` and another to this is for nothing.
    #[inline(always)]
    fn discards_sum_with(&self, y: *const Content) -> bool {
        let corrections = || self.shared.as_deref().and_then(|shared| shared.corrections.get());
        self.discards && corrections().is_some_and(|sum| ptr::eq(sum.as_ptr(), y))
    }
}

/// Defines a module with the operations compiled under the given attribute, and their `TABLE`.
macro_rules! operations {
    ($module:ident $(, #[$feature:meta])?) => {
        mod $module {
            use super::*;

            $(#[$feature])?
            unsafe extern "C" fn linear_sum(a: f64, x: N_Vector, b: f64, y: N_Vector, z: N_Vector) {
                // SAFETY: vectors of one family, see above; the weights live as long as they and
                // have as many blocks (`Shared::renew`), and IDA writes none of its sums to them.
                unsafe {
                    if (*content(z)).discards_sum_with(content(y)) {
                        return;
                    }
                    let (n, x, y) = (block_count(z), (a, blocks(x)), (b, blocks(y)));
                    match (*content(z)).weights() {
                        Some(weights) if a.abs() == 1.0 && b.abs() == 1.0 => {
                            let weights = (*weights.as_ptr()).blocks.as_ptr();
                            let square = kernels::linear_sum_and_norm(n, x, y, written(z), weights);
                            (*content(z)).keep_norm(square);
                        }
                        _ => kernels::linear_sum(n, x, y, written(z)),
                    }
                }
            }

            $(#[$feature])?
            unsafe extern "C" fn multiply(x: N_Vector, y: N_Vector, z: N_Vector) {
                // SAFETY: vectors of one family.
                unsafe { kernels::zip(block_count(z), blocks(x), blocks(y), written(z), |x, y| x * y) }
            }

            $(#[$feature])?
            unsafe extern "C" fn scale(c: f64, x: N_Vector, z: N_Vector) {
                // SAFETY: vectors of one family.
                unsafe { kernels::map(block_count(z), blocks(x), written(z), |x| c * x) }
            }

            $(#[$feature])?
            unsafe extern "C" fn absolute(x: N_Vector, z: N_Vector) {
                // SAFETY: vectors of one family.
                unsafe { kernels::map(block_count(z), blocks(x), written(z), f64::abs) }
            }

            $(#[$feature])?
            unsafe extern "C" fn dot_product(x: N_Vector, y: N_Vector) -> f64 {
                // SAFETY: vectors of one family.
                unsafe { kernels::reduce(block_count(x), blocks(x), blocks(y), |x, y, sum| x.mul_add(y, sum)) }
            }

            $(#[$feature])?
            unsafe extern "C" fn wrms_norm(x: N_Vector, w: N_Vector) -> f64 {
                // SAFETY: vectors of one family.
                unsafe {
                    if let Some(norm) = (*content(x)).known_norm(content(w)) {
                        return norm;
                    }
                    let sum = kernels::weighted_square_sum(block_count(x), blocks(x), blocks(w));
                    (sum / entry_count(x) as f64).sqrt()
                }
            }

            $(#[$feature])?
            unsafe extern "C" fn weighted_l2_norm(x: N_Vector, w: N_Vector) -> f64 {
                // SAFETY: vectors of one family.
                unsafe { kernels::weighted_square_sum(block_count(x), blocks(x), blocks(w)) }.sqrt()
            }

            $(#[$feature])?
            unsafe extern "C" fn l1_norm(x: N_Vector) -> f64 {
                // SAFETY: a vector of ours.
                unsafe { kernels::reduce(block_count(x), blocks(x), blocks(x), |x, _, sum| x.abs() + sum) }
            }

            $(#[$feature])?
            unsafe extern "C" fn linear_combination(n: c_int, c: *mut f64, x: *mut N_Vector, z: N_Vector) -> c_int {
                let n = n as usize;
                if n > MAX_FUSED {
                    return -1;
                }
                let mut terms = [ptr::null::<Block>(); MAX_FUSED];
                // SAFETY: SUNDIALS gives `n` factors and `n` vectors, of one family with the
                // result.
                unsafe {
                    for (k, term) in terms[..n].iter_mut().enumerate() {
                        *term = blocks(*x.add(k));
                    }
                    let c = std::slice::from_raw_parts(c, n);
                    kernels::linear_combination(block_count(z), c, &terms[..n], written(z));
                }
                0
            }

            $(#[$feature])?
            unsafe extern "C" fn linear_sums(
                n: c_int, a: f64, x: *mut N_Vector, b: f64, y: *mut N_Vector, z: *mut N_Vector,
            ) -> c_int {
                let n = n as usize;
                // SAFETY: SUNDIALS gives `n` vectors of one family each, and writes none of the
                // three lists meanwhile.
                let (x, y, z) = unsafe {
                    (std::slice::from_raw_parts(x, n), std::slice::from_raw_parts(y, n), std::slice::from_raw_parts(z, n))
                };
                // Differences of the history: each sum is the next one's second term.
                if (a, b) == (1.0, 1.0) && n > 0 && n <= MAX_FUSED && x == z && y[1..] == x[..n - 1] && !x.contains(&y[0]) {
                    let mut terms = [ptr::null_mut::<Block>(); MAX_FUSED];
                    // SAFETY: vectors of one family. That of `y[0]` is not one of `x`; the results,
                    // which SUNDIALS keeps apart, are `x`.
                    unsafe {
                        terms.iter_mut().zip(x).for_each(|(term, &x)| *term = written(x));
                        kernels::cumulate(block_count(x[0]), blocks(y[0]), &terms[..n]);
                    }
                    return 0;
                }
                for k in 0..n {
                    // SAFETY: vectors of one family.
                    unsafe { linear_sum(a, x[k], b, y[k], z[k]) };
                }
                0
            }

            $(#[$feature])?
            unsafe extern "C" fn scales(n: c_int, c: *mut f64, x: *mut N_Vector, z: *mut N_Vector) -> c_int {
                for k in 0..n as usize {
                    // SAFETY: SUNDIALS gives `n` factors, and `n` vectors of one family each.
                    unsafe { scale(*c.add(k), *x.add(k), *z.add(k)) };
                }
                0
            }

            $(#[$feature])?
            pub(super) fn error_weights(rtol: f64, y: &Content, atol: &[Block], w: &mut Content) {
                assert!(y.count == atol.len() && w.count == atol.len());
                w.age = 0;
                // SAFETY: all three have so many blocks.
                unsafe { kernels::error_weights(atol.len(), rtol, y.blocks.as_ptr(), atol.as_ptr(), w.blocks.as_ptr()) }
            }

            $(#[$feature])?
            pub(super) fn norm(x: &Content, w: &Content) -> f64 {
                assert!(x.count == w.count);
                // SAFETY: both have so many blocks.
                let sum = unsafe { kernels::weighted_square_sum(x.count, x.blocks.as_ptr(), w.blocks.as_ptr()) };
                (sum / x.length as f64).sqrt()
            }

            $(#[$feature])?
            pub(super) fn accumulate(delta: &Content, w: &Content, sum: &mut Content) -> f64 {
                let n = sum.count;
                assert!(delta.count == n && w.count == n);
                sum.age = 0;
                // SAFETY: all three have so many blocks; the sum is borrowed exclusively, so that
                // it is not one of the others.
                let squares = unsafe { kernels::accumulate(n, delta.blocks.as_ptr(), w.blocks.as_ptr(), sum.blocks.as_ptr()) };
                let (square, sum_square) = squares;
                if sum.weights().is_some_and(|known| ptr::eq(known.as_ptr(), w)) {
                    sum.keep_norm(sum_square);
                }
                (square / delta.length as f64).sqrt()
            }

            $(#[$feature])?
            pub(super) fn correct(c: f64, x: &Content, (y0, y): (&Content, &mut Content), (z0, z): (&Content, &mut Content)) {
                let n = x.count;
                assert!([y0.count, y.count, z0.count, z.count].iter().all(|&count| n == count));
                (y.age, z.age) = (0, 0);
                // SAFETY: all have so many blocks; what is written is borrowed exclusively, so that
                // it is not one of the others.
                unsafe {
                    let (y, z) = ((y0.blocks.as_ptr().cast_const(), y.blocks.as_ptr()), (z0.blocks.as_ptr().cast_const(), z.blocks.as_ptr()));
                    kernels::correct(n, c, x.blocks.as_ptr(), y, z);
                }
            }

            $(#[$feature])?
            pub(super) fn all_finite(x: &[Block]) -> bool {
                // SAFETY: the slice has so many blocks.
                unsafe { kernels::all_finite(x.len(), x.as_ptr()) }
            }

            pub(super) static TABLE: _generic_N_Vector_Ops = _generic_N_Vector_Ops {
                nvlinearsum: Some(linear_sum),
                nvprod: Some(multiply),
                nvscale: Some(scale),
                nvabs: Some(absolute),
                nvdotprod: Some(dot_product),
                nvwrmsnorm: Some(wrms_norm),
                nvwl2norm: Some(weighted_l2_norm),
                nvl1norm: Some(l1_norm),
                nvlinearcombination: Some(linear_combination),
                nvlinearsumvectorarray: Some(linear_sums),
                nvscalevectorarray: Some(scales),
                ..COMMON
            };
        }
    };
}

operations!(portable);
#[cfg(target_arch = "x86_64")]
operations!(avx2, #[target_feature(enable = "avx2,fma")]);

/// Compilation of the operations that a vector uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Operations(Compilation);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Compilation {
    /// Any processor.
    Portable,
    /// Processors with AVX2 and fused multiply-add: made by [`Operations::detect`] only, where the
    /// processor has both.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Operations {
    /// Those of any processor.
    pub(crate) const PORTABLE: Self = Self(Compilation::Portable);

    /// The fastest that this processor runs.
    pub(crate) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return Self(Compilation::Avx2);
        }
        Self::PORTABLE
    }

    pub(super) fn table(self) -> &'static _generic_N_Vector_Ops {
        match self.0 {
            Compilation::Portable => &portable::TABLE,
            #[cfg(target_arch = "x86_64")]
            Compilation::Avx2 => &avx2::TABLE,
        }
    }

    /// `w = 1 / (rtol |y| + atol)`; infinite where `atol` is filled up, so that the weights there
    /// are zero.
    ///
    /// # Panics
    /// Where one has another number of blocks than the rest.
    #[inline]
    pub(crate) fn error_weights(self, rtol: f64, y: &Content, atol: &[Block], w: &mut Content) {
        match self.0 {
            Compilation::Portable => portable::error_weights(rtol, y, atol, w),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: this variant is made only where the processor has both features.
            Compilation::Avx2 => unsafe { avx2::error_weights(rtol, y, atol, w) },
        }
    }

    /// Weighted root mean square of `x`.
    ///
    /// # Panics
    /// Where one has another number of blocks than the other.
    #[inline]
    pub(crate) fn norm(self, x: &Content, w: &Content) -> f64 {
        match self.0 {
            Compilation::Portable => portable::norm(x, w),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: this variant is made only where the processor has both features.
            Compilation::Avx2 => unsafe { avx2::norm(x, w) },
        }
    }

    /// `sum += delta`; returns the weighted root mean square of `delta`.
    ///
    /// # Panics
    /// Where one has another number of blocks than another.
    #[inline]
    pub(crate) fn accumulate(self, delta: &Content, w: &Content, sum: &mut Content) -> f64 {
        match self.0 {
            Compilation::Portable => portable::accumulate(delta, w, sum),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: this variant is made only where the processor has both features.
            Compilation::Avx2 => unsafe { avx2::accumulate(delta, w, sum) },
        }
    }

    /// `y.1 = y.0 + x` and `z.1 = z.0 + c x`.
    ///
    /// # Panics
    /// Where one has another number of blocks than another.
    #[inline]
    pub(crate) fn correct(self, c: f64, x: &Content, y: (&Content, &mut Content), z: (&Content, &mut Content)) {
        match self.0 {
            Compilation::Portable => portable::correct(c, x, y, z),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: this variant is made only where the processor has both features.
            Compilation::Avx2 => unsafe { avx2::correct(c, x, y, z) },
        }
    }

    /// Returns `true` if every number is finite.
    #[inline]
    pub(crate) fn all_finite(self, x: &[Block]) -> bool {
        match self.0 {
            Compilation::Portable => portable::all_finite(x),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: this variant is made only where the processor has both features.
            Compilation::Avx2 => unsafe { avx2::all_finite(x) },
        }
    }
}
