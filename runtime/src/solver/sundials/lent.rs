//! Values that SUNDIALS knows by their address.

use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;

/// A value on the heap whose address others keep: moving its owner leaves it where it is. Freed
/// with its owner.
pub(crate) struct Kept<T>(NonNull<T>);

impl<T> Kept<T> {
    pub(crate) fn new(value: T) -> Self {
        Self(NonNull::from(Box::leak(Box::new(value))))
    }

    /// Address.
    pub(crate) fn address(&self) -> *mut T {
        self.0.as_ptr()
    }

    /// The value.
    ///
    /// # Safety
    /// While the reference lives, no code writes the value by its address.
    pub(crate) unsafe fn get(&self) -> &T {
        // SAFETY: it is there as long as its owner, and not written, by the contract.
        unsafe { self.0.as_ref() }
    }

    /// The value, to be changed.
    ///
    /// # Safety
    /// While the reference lives, no code reads or writes the value by its address.
    pub(crate) unsafe fn get_mut(&mut self) -> &mut T {
        // SAFETY: it is there as long as its owner, and no other code uses it, by the contract.
        unsafe { self.0.as_mut() }
    }
}

impl<T> Drop for Kept<T> {
    fn drop(&mut self) {
        // SAFETY: leaked from a box by `new`, and freed here only.
        drop(unsafe { Box::from_raw(self.0.as_ptr()) });
    }
}

/// A value that is reached through the address that SUNDIALS gave back.
pub(crate) struct Lent<T>(NonNull<T>);

impl<T> Lent<T> {
    /// The value at an address.
    ///
    /// # Safety
    /// There is a value, which lives as long as this. While a reference from this lives, no other
    /// code writes the value; while an exclusive one lives, no other code reads it either.
    #[inline]
    pub(crate) unsafe fn new(address: *mut T) -> Self {
        // SAFETY: where a value is, the address is not null.
        Self(unsafe { NonNull::new_unchecked(address) })
    }
}

impl<T> Deref for Lent<T> {
    type Target = T;

    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: as who made this vouches.
        unsafe { self.0.as_ref() }
    }
}

impl<T> DerefMut for Lent<T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: as who made this vouches.
        unsafe { self.0.as_mut() }
    }
}
