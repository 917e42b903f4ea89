//! SUNDIALS vectors with content and operations of our own.
//!
//! IDA sees a vector as a content pointer and a table of operations. Debian's serial vectors run scalar loops, which
//! take four fifths of a solve with 1700 unknowns; here the table points to the vectorised loops of
//! [`kernels`](super::kernels). There are two tables of the same functions: one compiled for AVX2 and FMA, one for any
//! processor. Both give the same bits.

use std::cell::Cell;
use std::os::raw::c_int;
use std::ptr;
use std::rc::Rc;

use sundials_sys::{
    _generic_N_Vector, _generic_N_Vector_Ops, N_Vector, N_Vector_ID, N_Vector_ID_SUNDIALS_NVEC_CUSTOM, SUNComm, SUNContext, comm_no_mpi,
};

use super::kernels::{Block, LANES};

#[cfg(test)]
mod tests;

/// What the content pointer of a vector points to.
struct Content {
    length: usize,
    /// `length` entries; the rest of the last block is zero whatever IDA does with the vector.
    blocks: Box<[Block]>,
    /// What the vectors of an integrator know of each other.
    shared: Option<Rc<Shared>>,
    /// The weighted root mean square, with the weights of this age; zero where it is not known.
    norm: f64,
    age: u64,
    /// Whether nobody reads what a prediction and the corrections add up to.
    discards: bool,
}

/// What the vectors of an integrator know of each other: where a pass over numbers can take the next one along, or is for nothing.
///
/// IDA's error test adds two vectors and asks for the norm of the sum, which is taken in the pass of the addition; and
/// the norm of the corrections is known from Newton's method.
#[derive(Default)]
pub(crate) struct Shared {
    /// The present error weights, and how often they were set.
    weights: Cell<Option<N_Vector>>,
    age: Cell<u64>,
    /// The corrections of Newton's method.
    corrections: Cell<Option<N_Vector>>,
    /// Derivatives along directions follow the unknowns.
    many: Cell<bool>,
}

impl Shared {
    /// The error weights were set anew: no norm is known.
    pub(crate) fn renew(&self, weights: N_Vector) {
        self.weights.set(Some(weights));
        self.age.set(self.age.get() + 1);
    }

    /// Derivatives along directions follow the unknowns.
    pub fn set_many(&self, many: bool) {
        self.many.set(many);
    }

    /// Newton's method sums its corrections up here.
    pub(crate) fn set_corrections(&self, sum: N_Vector) {
        self.corrections.set(Some(sum));
    }
}

/// Vectors that one fused operation takes (IDA's: its maximum order plus one).
const MAX_FUSED: usize = 16;

fn content(vector: N_Vector) -> *mut Content {
    unsafe { (*vector).content.cast() }
}

#[inline(always)]
fn block_count(vector: N_Vector) -> usize {
    unsafe { &*content(vector) }.blocks.len()
}

#[inline(always)]
fn blocks(vector: N_Vector) -> *const Block {
    unsafe { (*content(vector)).blocks.as_ptr() }
}

/// The blocks, to be written: the norm is no longer known.
#[inline(always)]
fn written(vector: N_Vector) -> *mut Block {
    unsafe {
        let content = &mut *content(vector);
        content.age = 0;
        content.blocks.as_mut_ptr()
    }
}

/// What the vectors of the integrator know, if this is one of them.
#[inline(always)]
fn shared<'a>(vector: N_Vector) -> Option<&'a Shared> {
    unsafe { (*content(vector)).shared.as_deref() }
}

/// The error weights, where a norm of this vector will be asked for.
#[inline(always)]
fn weights_of(vector: N_Vector) -> Option<N_Vector> {
    shared(vector).and_then(|shared| shared.weights.get())
}

/// The weighted root mean square from the sum of squares, kept with the vector.
#[inline(always)]
fn keep_norm(vector: N_Vector, square: f64) -> f64 {
    unsafe {
        let content = &mut *content(vector);
        content.norm = (square / content.length as f64).sqrt();
        content.age = content.shared.as_ref().map_or(0, |shared| shared.age.get());
        content.norm
    }
}

/// The norm with these weights, if it is known.
#[inline(always)]
fn known_norm(vector: N_Vector, weights: N_Vector) -> Option<f64> {
    let content = unsafe { &*content(vector) };
    shared(vector).filter(|s| content.age > 0 && content.age == s.age.get() && s.weights.get() == Some(weights)).map(|_| content.norm)
}

/// Whether a sum of `y` and another to `z` is for nothing.
#[inline(always)]
fn is_discarded(y: N_Vector, z: N_Vector) -> bool {
    unsafe { (*content(z)).discards && shared(z).is_some_and(|shared| shared.corrections.get() == Some(y)) }
}

/// The entries of a vector that SUNDIALS hands to a callback.
///
/// # Safety
/// `vector` was made by [`Vector`], and nobody writes it while the slice lives.
pub(crate) unsafe fn entries<'a>(vector: N_Vector) -> &'a [f64] {
    unsafe { std::slice::from_raw_parts(blocks(vector).cast(), (*content(vector)).length) }
}

/// The entries of a vector that SUNDIALS hands to a callback to be written.
///
/// # Safety
/// `vector` was made by [`Vector`], and nobody else reads or writes it while the slice lives.
pub(crate) unsafe fn entries_mut<'a>(vector: N_Vector) -> &'a mut [f64] {
    unsafe { std::slice::from_raw_parts_mut(written(vector).cast(), (*content(vector)).length) }
}

/// The blocks of a vector.
///
/// # Safety
/// As for [`entries`].
pub(crate) unsafe fn block_slice<'a>(vector: N_Vector) -> &'a [Block] {
    unsafe { &(*content(vector)).blocks }
}

/// `length` numbers in whole blocks, all zero.
pub(crate) fn zeroed_blocks(length: usize) -> Box<[Block]> {
    vec![Block::ZERO; length.div_ceil(LANES)].into_boxed_slice()
}

fn allocate(length: usize, ops: *mut _generic_N_Vector_Ops, sunctx: SUNContext, shared: Option<Rc<Shared>>) -> N_Vector {
    let content = Content { length, blocks: zeroed_blocks(length), shared, norm: 0.0, age: 0, discards: false };
    let content = Box::into_raw(Box::new(content));
    Box::into_raw(Box::new(_generic_N_Vector { content: content.cast(), ops, sunctx }))
}

unsafe extern "C" fn vector_id(_: N_Vector) -> N_Vector_ID {
    N_Vector_ID_SUNDIALS_NVEC_CUSTOM
}

unsafe extern "C" fn clone(x: N_Vector) -> N_Vector {
    unsafe { allocate((*content(x)).length, (*x).ops, (*x).sunctx, (*content(x)).shared.clone()) }
}

unsafe extern "C" fn destroy(x: N_Vector) {
    unsafe {
        drop(Box::from_raw(content(x)));
        drop(Box::from_raw(x));
    }
}

/// Numbers and integers that a vector takes; IDA only adds them up, but asks for them unconditionally.
unsafe extern "C" fn space(x: N_Vector, numbers: *mut i64, integers: *mut i64) {
    unsafe {
        *numbers = (block_count(x) * LANES) as i64;
        *integers = 1;
    }
}

unsafe extern "C" fn array_pointer(x: N_Vector) -> *mut f64 {
    written(x).cast()
}

unsafe extern "C" fn length(x: N_Vector) -> i64 {
    unsafe { (*content(x)).length as i64 }
}

unsafe extern "C" fn communicator(_: N_Vector) -> SUNComm {
    comm_no_mpi()
}

// The operations from here to the macro write a number other than zero where zeros stand, so they keep to the length.

unsafe extern "C" fn constant(c: f64, z: N_Vector) {
    unsafe { entries_mut(z) }.fill(c);
}

unsafe extern "C" fn divide(x: N_Vector, y: N_Vector, z: N_Vector) {
    for_each(z, |i| unsafe { entry(x, i) / entry(y, i) });
}

unsafe extern "C" fn invert(x: N_Vector, z: N_Vector) {
    for_each(z, |i| unsafe { 1.0 / entry(x, i) });
}

unsafe extern "C" fn add_constant(x: N_Vector, b: f64, z: N_Vector) {
    for_each(z, |i| unsafe { entry(x, i) + b });
}

unsafe extern "C" fn minimum(x: N_Vector) -> f64 {
    unsafe { entries(x) }.iter().fold(f64::MAX, |least, &value| least.min(value))
}

/// Weighted root mean square over the entries whose mask is positive.
unsafe extern "C" fn masked_norm(x: N_Vector, w: N_Vector, mask: N_Vector) -> f64 {
    if shared(x).is_some_and(|shared| shared.many.get()) {
        return masked_norm_of_many(unsafe { (block_slice(x), block_slice(w), block_slice(mask)) });
    }
    let (x, w, mask) = unsafe { (entries(x), entries(w), entries(mask)) };
    let terms = x.iter().zip(w).zip(mask).filter(|&(_, &counts)| counts > 0.0);
    let (sum, count) = terms.fold((0.0, 0.0_f64), |(sum, count), ((x, w), _)| (sum + (x * w) * (x * w), count + 1.0));
    (sum / count.max(1.0)).sqrt()
}

/// The same by eight sums side by side: for derivatives along directions, which are many.
fn masked_norm_of_many((x, w, mask): (&[Block], &[Block], &[Block])) -> f64 {
    let (mut sums, mut counts) = ([0.0; LANES], [0.0; LANES]);
    for ((x, w), mask) in x.iter().zip(w).zip(mask) {
        for lane in 0..LANES {
            let (product, takes) = (x.0[lane] * w.0[lane], mask.0[lane] > 0.0);
            sums[lane] += if takes { product * product } else { 0.0 };
            counts[lane] += if takes { 1.0 } else { 0.0 };
        }
    }
    (sums.iter().sum::<f64>() / counts.iter().sum::<f64>().max(1.0)).sqrt()
}

unsafe extern "C" fn maximum_norm(x: N_Vector) -> f64 {
    unsafe { entries(x) }.iter().fold(0.0, |most: f64, value| most.max(value.abs()))
}

unsafe fn entry(x: N_Vector, i: usize) -> f64 {
    unsafe { *blocks(x).cast::<f64>().add(i) }
}

fn for_each(z: N_Vector, value: impl Fn(usize) -> f64) {
    let to = written(z).cast::<f64>();
    for i in 0..unsafe { (*content(z)).length } {
        unsafe { *to.add(i) = value(i) };
    }
}

/// Defines a module with the operations compiled under the given attribute, and their `TABLE`.
macro_rules! operations {
    ($module:ident $(, #[$feature:meta])?) => {
        mod $module {
            use super::*;
            use crate::solver::kernels;

            $(#[$feature])?
            unsafe extern "C" fn linear_sum(a: f64, x: N_Vector, b: f64, y: N_Vector, z: N_Vector) {
                if is_discarded(y, z) {
                    return;
                }
                let (n, x, y) = (block_count(z), (a, blocks(x)), (b, blocks(y)));
                match weights_of(z) {
                    Some(weights) if a.abs() == 1.0 && b.abs() == 1.0 => {
                        let square = unsafe { kernels::linear_sum_and_norm(n, x, y, written(z), blocks(weights)) };
                        keep_norm(z, square);
                    }
                    _ => unsafe { kernels::linear_sum(n, x, y, written(z)) },
                }
            }

            $(#[$feature])?
            unsafe extern "C" fn multiply(x: N_Vector, y: N_Vector, z: N_Vector) {
                unsafe { kernels::zip(block_count(z), blocks(x), blocks(y), written(z), |x, y| x * y) }
            }

            $(#[$feature])?
            unsafe extern "C" fn scale(c: f64, x: N_Vector, z: N_Vector) {
                unsafe { kernels::map(block_count(z), blocks(x), written(z), |x| c * x) }
            }

            $(#[$feature])?
            unsafe extern "C" fn absolute(x: N_Vector, z: N_Vector) {
                unsafe { kernels::map(block_count(z), blocks(x), written(z), f64::abs) }
            }

            $(#[$feature])?
            unsafe extern "C" fn dot_product(x: N_Vector, y: N_Vector) -> f64 {
                unsafe { kernels::reduce(block_count(x), blocks(x), blocks(y), |x, y, sum| x.mul_add(y, sum)) }
            }

            $(#[$feature])?
            unsafe extern "C" fn wrms_norm(x: N_Vector, w: N_Vector) -> f64 {
                if let Some(norm) = known_norm(x, w) {
                    return norm;
                }
                let sum = unsafe { kernels::weighted_square_sum(block_count(x), blocks(x), blocks(w)) };
                (sum / unsafe { (*content(x)).length } as f64).sqrt()
            }

            $(#[$feature])?
            unsafe extern "C" fn weighted_l2_norm(x: N_Vector, w: N_Vector) -> f64 {
                unsafe { kernels::weighted_square_sum(block_count(x), blocks(x), blocks(w)) }.sqrt()
            }

            $(#[$feature])?
            unsafe extern "C" fn l1_norm(x: N_Vector) -> f64 {
                unsafe { kernels::reduce(block_count(x), blocks(x), blocks(x), |x, _, sum| x.abs() + sum) }
            }

            $(#[$feature])?
            unsafe extern "C" fn linear_combination(n: c_int, c: *mut f64, x: *mut N_Vector, z: N_Vector) -> c_int {
                let n = n as usize;
                if n > MAX_FUSED {
                    return -1;
                }
                let mut terms = [ptr::null::<Block>(); MAX_FUSED];
                for (k, term) in terms[..n].iter_mut().enumerate() {
                    *term = blocks(unsafe { *x.add(k) });
                }
                let c = unsafe { std::slice::from_raw_parts(c, n) };
                unsafe { kernels::linear_combination(block_count(z), c, &terms[..n], written(z)) };
                0
            }

            $(#[$feature])?
            unsafe extern "C" fn linear_sums(
                n: c_int, a: f64, x: *mut N_Vector, b: f64, y: *mut N_Vector, z: *mut N_Vector,
            ) -> c_int {
                let n = n as usize;
                let (x, y, z) = unsafe {
                    (std::slice::from_raw_parts(x, n), std::slice::from_raw_parts(y, n), std::slice::from_raw_parts(z, n))
                };
                // Differences of the history: each sum is the next one's second term.
                if (a, b) == (1.0, 1.0) && n > 0 && n <= MAX_FUSED && x == z && y[1..] == x[..n - 1] && !x.contains(&y[0]) {
                    let mut terms = [ptr::null_mut::<Block>(); MAX_FUSED];
                    terms.iter_mut().zip(x).for_each(|(term, &x)| *term = written(x));
                    unsafe { kernels::cumulate(block_count(x[0]), blocks(y[0]), &terms[..n]) };
                    return 0;
                }
                for k in 0..n {
                    unsafe { linear_sum(a, x[k], b, y[k], z[k]) };
                }
                0
            }

            $(#[$feature])?
            unsafe extern "C" fn scales(n: c_int, c: *mut f64, x: *mut N_Vector, z: *mut N_Vector) -> c_int {
                for k in 0..n as usize {
                    unsafe { scale(*c.add(k), *x.add(k), *z.add(k)) };
                }
                0
            }

            $(#[$feature])?
            pub(super) unsafe fn error_weights(rtol: f64, y: N_Vector, atol: &[Block], w: N_Vector) {
                unsafe { kernels::error_weights(atol.len(), rtol, blocks(y), atol.as_ptr(), written(w)) }
            }

            $(#[$feature])?
            pub(super) unsafe fn accumulate(n: usize, delta: N_Vector, w: N_Vector, sum: N_Vector) -> f64 {
                let to = written(sum);
                let (square, sum_square) = unsafe { kernels::accumulate(n, blocks(delta), blocks(w), to) };
                if n == block_count(sum) && weights_of(sum) == Some(w) {
                    keep_norm(sum, sum_square);
                }
                (square / unsafe { (*content(delta)).length } as f64).sqrt()
            }

            $(#[$feature])?
            pub(super) unsafe fn correct(
                n: usize, c: f64, x: N_Vector, (y0, y): (N_Vector, N_Vector), (z0, z): (N_Vector, N_Vector),
            ) {
                unsafe { kernels::correct(n, c, blocks(x), (blocks(y0), written(y)), (blocks(z0), written(z))) }
            }

            $(#[$feature])?
            pub(super) unsafe fn all_finite(x: &[Block]) -> bool {
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

/// Which compilation of the operations a vector uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Operations {
    /// Any processor.
    Portable,
    /// Processors with AVX2 and fused multiply-add.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Operations {
    /// The fastest that this processor runs.
    pub(crate) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return Self::Avx2;
        }
        Self::Portable
    }

    fn table(self) -> &'static _generic_N_Vector_Ops {
        match self {
            Self::Portable => &portable::TABLE,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => &avx2::TABLE,
        }
    }

    /// `w = 1 / (rtol |y| + atol)`; infinite where `atol` is filled up, so that the weights there are zero.
    ///
    /// # Safety
    /// `y` and `w` were made by [`Vector`] with as many blocks as `atol`.
    #[inline]
    pub(crate) unsafe fn error_weights(self, rtol: f64, y: N_Vector, atol: &[Block], w: N_Vector) {
        match self {
            Self::Portable => unsafe { portable::error_weights(rtol, y, atol, w) },
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2::error_weights(rtol, y, atol, w) },
        }
    }

    /// `sum += delta` in so many leading blocks; returns the weighted root mean square of `delta`, of which the other entries are taken as zero.
    ///
    /// # Safety
    /// All were made by [`Vector`] with the same length; `sum` is another than the rest.
    #[inline]
    pub(crate) unsafe fn accumulate(self, blocks: usize, delta: N_Vector, w: N_Vector, sum: N_Vector) -> f64 {
        match self {
            Self::Portable => unsafe { portable::accumulate(blocks, delta, w, sum) },
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2::accumulate(blocks, delta, w, sum) },
        }
    }

    /// `y.1 = y.0 + x` and `z.1 = z.0 + c x` in so many leading blocks.
    ///
    /// # Safety
    /// All were made by [`Vector`] with the same length; what is written is another than the rest.
    #[inline]
    pub(crate) unsafe fn correct(self, blocks: usize, c: f64, x: N_Vector, y: (N_Vector, N_Vector), z: (N_Vector, N_Vector)) {
        match self {
            Self::Portable => unsafe { portable::correct(blocks, c, x, y, z) },
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2::correct(blocks, c, x, y, z) },
        }
    }

    /// Whether every number is finite.
    #[inline]
    pub(crate) fn all_finite(self, x: &[Block]) -> bool {
        match self {
            Self::Portable => unsafe { portable::all_finite(x) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: this variant is made only where the processor has both features.
            Self::Avx2 => unsafe { avx2::all_finite(x) },
        }
    }
}

/// A vector that SUNDIALS can work on; freed with its owner.
pub(crate) struct Vector {
    raw: N_Vector,
}

impl Vector {
    /// A vector of zeros.
    pub fn zeros(length: usize, operations: Operations, context: SUNContext) -> Self {
        let table = ptr::from_ref(operations.table()).cast_mut(); // SUNDIALS only reads it
        Self { raw: allocate(length, table, context, None) }
    }

    /// A vector of an integrator, as those that SUNDIALS will make after it.
    pub(crate) fn sharing(length: usize, operations: Operations, context: SUNContext, shared: &Rc<Shared>) -> Self {
        let vector = Self::zeros(length, operations, context);
        unsafe { (*content(vector.raw)).shared = Some(Rc::clone(shared)) };
        vector
    }

    /// Whether nobody reads what a prediction and the corrections add up to.
    pub(crate) fn set_discards(&mut self, discards: bool) {
        unsafe { (*content(self.raw)).discards = discards };
    }

    /// The handle that SUNDIALS takes.
    pub fn raw(&self) -> N_Vector {
        self.raw
    }

    /// The entries.
    pub fn entries(&self) -> &[f64] {
        unsafe { entries(self.raw) }
    }

    /// The entries, to be written.
    pub(crate) fn entries_mut(&mut self) -> &mut [f64] {
        unsafe { entries_mut(self.raw) }
    }
}

impl Drop for Vector {
    fn drop(&mut self) {
        unsafe { destroy(self.raw) }
    }
}

/// The operations that need no second compilation, and none where IDA does without.
const COMMON: _generic_N_Vector_Ops = _generic_N_Vector_Ops {
    nvgetvectorid: Some(vector_id),
    nvclone: Some(clone),
    nvdestroy: Some(destroy),
    nvspace: Some(space),
    nvgetarraypointer: Some(array_pointer),
    nvgetcommunicator: Some(communicator),
    nvgetlength: Some(length),
    nvconst: Some(constant),
    nvdiv: Some(divide),
    nvinv: Some(invert),
    nvaddconst: Some(add_constant),
    nvmin: Some(minimum),
    nvwrmsnormmask: Some(masked_norm),
    nvmaxnorm: Some(maximum_norm),
    // SAFETY: every other field is an optional function pointer, for which all zeros mean `None`.
    ..unsafe { std::mem::zeroed() }
};
