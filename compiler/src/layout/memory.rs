//! The workspace of one instance.

use std::alloc::{Layout as Allocation, alloc_zeroed, dealloc, handle_alloc_error};
use std::fmt;
use std::ptr::NonNull;
use std::slice;
use std::sync::Arc;

use super::{Layout, Region};

/// Bytes of a cache line and of the widest vectors.
const ALIGNMENT: usize = 64;

/// Everything of one instance but `y`: one 64-byte aligned buffer. A clone is a snapshot.
pub struct Memory {
    numbers: NonNull<f64>,
    layout: Arc<Layout>,
}

// SAFETY: the buffer is allocated by this value, reached through it alone, and freed by it on
// whatever thread it is then.
unsafe impl Send for Memory {}
// SAFETY: a shared reference gives shared slices only, so that no code writes while it lives.
unsafe impl Sync for Memory {}

impl Memory {
    /// A workspace of zeros.
    #[must_use]
    pub fn new(layout: Arc<Layout>) -> Memory {
        let allocation = Memory::allocation(layout.len());
        // SAFETY: the size is not zero, see `allocation`.
        let Some(numbers) = NonNull::new(unsafe { alloc_zeroed(allocation) }.cast::<f64>()) else { handle_alloc_error(allocation) };
        Memory { numbers, layout }
    }

    fn allocation(len: usize) -> Allocation {
        let whole = Allocation::array::<f64>(len.max(1)).and_then(|a| a.align_to(ALIGNMENT));
        whole.unwrap_or_else(|_| handle_alloc_error(Allocation::new::<f64>()))
    }

    /// The numbers of a region: variables in the order of their ids, elements in storage order.
    #[must_use]
    #[inline]
    pub fn region(&self, region: Region) -> &[f64] {
        &self.all()[self.layout.range(region)]
    }

    /// The numbers of a region, to be changed.
    #[must_use]
    #[inline]
    pub fn region_mut(&mut self, region: Region) -> &mut [f64] {
        let range = self.layout.range(region);
        &mut self.all_mut()[range]
    }

    /// Places of all parts.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The whole workspace.
    #[must_use]
    pub fn all(&self) -> &[f64] {
        // SAFETY: allocated for that many numbers, zeroed at birth.
        unsafe { slice::from_raw_parts(self.numbers.as_ptr(), self.layout.len()) }
    }

    /// The whole workspace, to be changed.
    #[must_use]
    pub fn all_mut(&mut self) -> &mut [f64] {
        // SAFETY: as in `all`, and the borrow is unique.
        unsafe { slice::from_raw_parts_mut(self.numbers.as_ptr(), self.layout.len()) }
    }
}

impl Clone for Memory {
    fn clone(&self) -> Self {
        let mut copy = Memory::new(Arc::clone(&self.layout));
        copy.all_mut().copy_from_slice(self.all());
        copy
    }

    fn clone_from(&mut self, source: &Self) {
        if self.layout.len() == source.layout.len() {
            self.all_mut().copy_from_slice(source.all());
            self.layout = Arc::clone(&source.layout);
        } else {
            *self = source.clone();
        }
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        // SAFETY: allocated with the same size and alignment.
        unsafe { dealloc(self.numbers.as_ptr().cast(), Memory::allocation(self.layout.len())) }
    }
}

impl fmt::Debug for Memory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Memory").field("numbers", &self.all()).finish()
    }
}
