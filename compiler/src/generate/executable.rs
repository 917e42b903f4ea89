//! Executable memory of our own: written, then made executable, never both.

use std::io;
use std::ptr::NonNull;

/// Several pieces of code in one mapping.
#[derive(Debug)]
pub struct Executable {
    start: Option<NonNull<u8>>,
    len: usize,
    offsets: Vec<Option<usize>>,
}

// SAFETY: the mapping is read-only and executable after construction.
unsafe impl Send for Executable {}
// SAFETY: as above.
unsafe impl Sync for Executable {}

/// Code starts at cache lines.
const ALIGNMENT: usize = 64;

impl Executable {
    /// Maps the pieces; empty ones get no address.
    ///
    /// # Errors
    /// If the system refuses the memory or its protection.
    pub fn new(pieces: &[&[u8]]) -> io::Result<Executable> {
        let mut offsets = Vec::with_capacity(pieces.len());
        let mut len = 0usize;
        for piece in pieces {
            offsets.push((!piece.is_empty()).then_some(len));
            len += piece.len().next_multiple_of(ALIGNMENT);
        }
        if len == 0 {
            return Ok(Executable { start: None, len, offsets });
        }
        let (protection, flags) = (libc::PROT_READ | libc::PROT_WRITE, libc::MAP_PRIVATE | libc::MAP_ANONYMOUS);
        // SAFETY: a new anonymous mapping touches no other memory.
        let start = unsafe { libc::mmap(std::ptr::null_mut(), len, protection, flags, -1, 0) };
        if start == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        let executable = Executable { start: NonNull::new(start.cast()), len, offsets };
        for (piece, offset) in pieces.iter().zip(&executable.offsets) {
            if let Some(offset) = offset {
                // SAFETY: offset + piece.len() <= len, and nothing else points into the new mapping.
                unsafe { std::ptr::copy_nonoverlapping(piece.as_ptr(), start.cast::<u8>().add(*offset), piece.len()) };
            }
        }
        // SAFETY: the mapping made above, whole.
        if unsafe { libc::mprotect(start, len, libc::PROT_READ | libc::PROT_EXEC) } != 0 {
            return Err(io::Error::last_os_error());
        }
        #[cfg(target_arch = "aarch64")]
        executable.synchronise();
        Ok(executable)
    }

    /// Makes the new instructions visible to the instruction fetch (x86-64 does so by itself).
    #[cfg(target_arch = "aarch64")]
    fn synchronise(&self) {
        unsafe extern "C" {
            fn __clear_cache(start: *mut u8, end: *mut u8);
        }
        if let Some(start) = self.start {
            // SAFETY: the range is the mapping.
            unsafe { __clear_cache(start.as_ptr(), start.as_ptr().add(self.len)) };
        }
    }

    /// Address of a piece; `None` for an empty one.
    #[must_use]
    pub fn address(&self, piece: usize) -> Option<*const u8> {
        let offset = self.offsets.get(piece).copied().flatten()?;
        // SAFETY: offsets lie inside of the mapping.
        self.start.map(|s| unsafe { s.as_ptr().add(offset).cast_const() })
    }

    /// Bytes mapped.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether nothing is mapped.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

impl Drop for Executable {
    fn drop(&mut self) {
        if let Some(start) = self.start {
            // SAFETY: the mapping made in `new`; no function of it runs any more, its owner is being dropped.
            unsafe { libc::munmap(start.as_ptr().cast(), self.len) };
        }
    }
}
