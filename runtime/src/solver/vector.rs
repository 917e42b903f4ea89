//! SUNDIALS vectors with own content and operations.
//!
//! IDA sees a vector as a content pointer and a table of operations. Debian's serial vectors run
//! scalar loops, which take four fifths of a solve with 1700 unknowns; here the table points to the
//! vectorised loops of [`kernels`](super::kernels). There are two tables of the same functions
//! (`operations`): one compiled for AVX2 and FMA, one for any processor. Both give the same bits.
//!
//! [`Vector`] owns a vector, [`Handle`] is one that SUNDIALS lends to a callback; both give its
//! [`Content`], which is safe to use. All vectors that SUNDIALS meets here were made by [`Vector`],
//! or cloned from one by SUNDIALS.

mod operations;
#[cfg(test)]
mod tests;

use std::cell::Cell;
use std::ops::{Deref, DerefMut};
use std::ptr::{self, NonNull};
use std::rc::Rc;

use sundials_sys::{_generic_N_Vector, _generic_N_Vector_Ops, N_Vector};

use super::kernels::{Block, LANES};
use super::sundials::Context;
pub(crate) use operations::Operations;

/// Target of the content pointer of a vector.
pub(crate) struct Content {
    length: usize,
    /// `count` blocks, which the content owns. The rest of the last one is zero whatever IDA does
    /// with the vector.
    blocks: NonNull<Block>,
    count: usize,
    /// Shared data of the vectors of an integrator.
    shared: Option<Rc<Shared>>,
    /// The weighted root mean square, with the weights of this age; zero where it is not known.
    norm: f64,
    age: u64,
    /// True if no code reads what a prediction and the corrections add up to.
    discards: bool,
    /// Outlives the vectors that name it.
    context: Context,
}

/// Shared data of the vectors of an integrator: passes over numbers that can be merged or skipped.
///
/// IDA's error test adds two vectors and asks for the norm of the sum, which is taken in the pass
/// of the addition. The norm of the corrections is known from Newton's method.
#[derive(Default)]
pub(crate) struct Shared {
    /// The present error weights, and how often they were set.
    weights: Cell<Option<NonNull<Content>>>,
    age: Cell<u64>,
    /// The corrections of Newton's method; only compared with.
    corrections: Cell<Option<NonNull<Content>>>,
}

impl Shared {
    /// The error weights were set anew: no norm is known.
    ///
    /// # Safety
    /// The weights live as long as SUNDIALS works on vectors that share this, and have as many
    /// blocks.
    pub(crate) unsafe fn renew(&self, weights: &Handle) {
        self.weights.set(Some(weights.content));
        self.age.set(self.age.get() + 1);
    }

    /// Newton's method sums its corrections up here.
    pub(crate) fn set_corrections(&self, sum: &Handle) {
        self.corrections.set(Some(sum.content));
    }
}

/// `length` numbers in whole blocks, all zero.
pub(crate) fn zeroed_blocks(length: usize) -> Box<[Block]> {
    vec![Block::ZERO; length.div_ceil(LANES)].into_boxed_slice()
}

impl Content {
    fn new(length: usize, context: Context, shared: Option<Rc<Shared>>) -> Self {
        let blocks = zeroed_blocks(length);
        let count = blocks.len();
        // A box is never null.
        let blocks = NonNull::from(Box::leak(blocks)).cast();
        Self { length, blocks, count, shared, norm: 0.0, age: 0, discards: false, context }
    }

    /// The entries.
    #[inline]
    pub(crate) fn entries(&self) -> &[f64] {
        // SAFETY: the content owns `count` blocks of `LANES` numbers each, which are at least
        // `length`.
        unsafe { std::slice::from_raw_parts(self.blocks.as_ptr().cast(), self.length) }
    }

    /// The entries, to be written: the norm is no longer known.
    #[inline]
    pub(crate) fn entries_mut(&mut self) -> &mut [f64] {
        self.age = 0;
        // SAFETY: as in `entries`; the slice borrows the content exclusively.
        unsafe { std::slice::from_raw_parts_mut(self.blocks.as_ptr().cast(), self.length) }
    }

    /// The entries in whole blocks.
    #[inline]
    pub(crate) fn blocks(&self) -> &[Block] {
        // SAFETY: the content owns so many blocks.
        unsafe { std::slice::from_raw_parts(self.blocks.as_ptr(), self.count) }
    }

    /// Returns `true` if no code reads what a prediction and the corrections add up to.
    pub(crate) fn set_discards(&mut self, discards: bool) {
        self.discards = discards;
    }
}

impl Drop for Content {
    fn drop(&mut self) {
        let blocks = ptr::slice_from_raw_parts_mut(self.blocks.as_ptr(), self.count);
        // SAFETY: so many blocks were leaked from a box when the content was made, and no other
        // code frees them.
        drop(unsafe { Box::from_raw(blocks) });
    }
}

/// A vector that SUNDIALS lends, or one of ours: an `N_Vector` whose content may be used.
pub(crate) struct Handle {
    raw: N_Vector,
    content: NonNull<Content>,
}

impl Handle {
    /// The handle of a vector that SUNDIALS gives.
    ///
    /// # Safety
    /// `raw` is a vector of [`Vector`]'s making that lives as long as the handle. While a reference
    /// from the handle lives, no code writes the vector; while an exclusive one lives, no code
    /// reads it either.
    #[inline]
    pub(crate) unsafe fn new(raw: N_Vector) -> Self {
        // SAFETY: by the contract, so that the content is one of `allocate`'s, which is not null.
        let content = unsafe { NonNull::new_unchecked((*raw).content.cast()) };
        Self { raw, content }
    }

    /// Pointer for SUNDIALS.
    pub(crate) fn raw(&self) -> N_Vector {
        self.raw
    }

    /// Address of the content, for comparisons.
    #[cfg(test)]
    fn address(&self) -> *const Content {
        self.content.as_ptr()
    }
}

impl Deref for Handle {
    type Target = Content;

    #[inline]
    fn deref(&self) -> &Content {
        // SAFETY: the vector lives and is not written, as who made the handle vouches.
        unsafe { self.content.as_ref() }
    }
}

impl DerefMut for Handle {
    #[inline]
    fn deref_mut(&mut self) -> &mut Content {
        // SAFETY: the vector lives and no other code uses it, as who made the handle vouches.
        unsafe { self.content.as_mut() }
    }
}

/// A vector that SUNDIALS can work on; freed with its owner.
pub(crate) struct Vector(Handle);

impl Vector {
    /// A vector of zeros.
    pub(crate) fn zeros(length: usize, operations: Operations, context: &Context) -> Self {
        Self::make(length, operations, context, None)
    }

    /// A vector of an integrator, as those that SUNDIALS will make after it.
    pub(crate) fn sharing(length: usize, operations: Operations, context: &Context, shared: &Rc<Shared>) -> Self {
        Self::make(length, operations, context, Some(Rc::clone(shared)))
    }

    fn make(length: usize, operations: Operations, context: &Context, shared: Option<Rc<Shared>>) -> Self {
        let table = ptr::from_ref(operations.table()).cast_mut(); // SUNDIALS only reads it
        let raw = allocate(Content::new(length, context.clone(), shared), table);
        // SAFETY: just made, and freed by `Drop` only; the pointer is lent to SUNDIALS by those who
        // hold the vector.
        Self(unsafe { Handle::new(raw) })
    }
}

impl Deref for Vector {
    type Target = Handle;

    #[inline]
    fn deref(&self) -> &Handle {
        &self.0
    }
}

impl DerefMut for Vector {
    #[inline]
    fn deref_mut(&mut self) -> &mut Handle {
        &mut self.0
    }
}

impl Drop for Vector {
    fn drop(&mut self) {
        // SAFETY: made by `allocate`, and not freed by anyone else: SUNDIALS frees its own clones
        // only.
        unsafe { free(self.0.raw) }
    }
}

/// A vector on the heap, to be freed by [`free`].
fn allocate(content: Content, ops: *mut _generic_N_Vector_Ops) -> N_Vector {
    let sunctx = content.context.raw();
    let content = Box::into_raw(Box::new(content));
    Box::into_raw(Box::new(_generic_N_Vector { content: content.cast(), ops, sunctx }))
}

/// Frees a vector.
///
/// # Safety
/// `vector` was made by [`allocate`], and no code uses it any more.
unsafe fn free(vector: N_Vector) {
    // SAFETY: both are boxes that `allocate` gave away, by the contract.
    unsafe {
        drop(Box::from_raw((*vector).content.cast::<Content>()));
        drop(Box::from_raw(vector));
    }
}
