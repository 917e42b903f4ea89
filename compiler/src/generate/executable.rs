//! Executable memory: written, then made executable, never both.

use std::io;

use memmap2::{Mmap, MmapMut};

/// Several pieces of code in one mapping.
#[derive(Debug)]
pub(crate) struct Executable {
    /// `None` where there is no code.
    code: Option<Mmap>,
    offsets: Vec<Option<usize>>,
}

/// Code starts at cache lines.
const ALIGNMENT: usize = 64;

impl Executable {
    /// Maps the pieces; empty ones get no address.
    ///
    /// # Errors
    /// If the system refuses the memory or its protection.
    pub(crate) fn new(pieces: &[&[u8]]) -> io::Result<Executable> {
        let mut offsets = Vec::with_capacity(pieces.len());
        let mut len = 0usize;
        for piece in pieces {
            offsets.push((!piece.is_empty()).then_some(len));
            len += piece.len().next_multiple_of(ALIGNMENT);
        }
        if len == 0 {
            return Ok(Executable { code: None, offsets });
        }
        let mut memory = MmapMut::map_anon(len)?;
        for (piece, offset) in pieces.iter().zip(&offsets) {
            if let Some(place) = offset.and_then(|start| memory.get_mut(start..start + piece.len())) {
                place.copy_from_slice(piece);
            }
        }
        let code = memory.make_exec()?;
        #[cfg(target_arch = "aarch64")]
        synchronise(&code);
        Ok(Executable { code: Some(code), offsets })
    }

    /// Address of a piece; `None` for an empty one.
    #[must_use]
    pub(crate) fn address(&self, piece: usize) -> Option<*const u8> {
        let offset = self.offsets.get(piece).copied().flatten()?;
        Some(self.code.as_ref()?.get(offset..)?.as_ptr())
    }

    /// Bytes mapped.
    #[must_use]
    pub(crate) fn len(&self) -> usize {
        self.code.as_ref().map_or(0, |code| code.len())
    }
}

/// Makes the new instructions visible to the instruction fetch (x86-64 does so by itself).
#[cfg(target_arch = "aarch64")]
fn synchronise(code: &Mmap) {
    unsafe extern "C" {
        fn __clear_cache(start: *mut u8, end: *mut u8);
    }
    let range = code.as_ptr_range();
    // SAFETY: the range is the mapping.
    unsafe { __clear_cache(range.start.cast_mut(), range.end.cast_mut()) };
}
