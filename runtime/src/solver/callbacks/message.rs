//! Messages of SUNDIALS, stored instead of printed.

use std::ffi::CStr;
use std::os::raw::{c_char, c_int, c_void};

use super::super::sundials::Lent;

/// Bytes kept of the last message.
const SPACE: usize = 256;

/// SUNDIALS' last message.
pub(crate) struct Message {
    bytes: [u8; SPACE],
    length: usize,
}

impl Default for Message {
    fn default() -> Self {
        Self { bytes: [0; SPACE], length: 0 }
    }
}

impl Message {
    /// Forgets it.
    pub(crate) fn clear(&mut self) {
        self.length = 0;
    }

    /// It as text, as far unchanged stored.
    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.bytes[..self.length]).trim().to_owned()
    }

    fn keep(&mut self, text: &[u8]) {
        self.length = text.len().min(SPACE);
        self.bytes[..self.length].copy_from_slice(&text[..self.length]);
    }
}

/// Keeps the last message: SUNDIALS 6.
#[cfg(not(feature = "vendored"))]
pub(crate) unsafe extern "C" fn message(
    _code: c_int,
    _module: *const c_char,
    _function: *const c_char,
    text: *mut c_char,
    data: *mut c_void,
) {
    // SAFETY: SUNDIALS gives a text, and the address that it was given with this function.
    unsafe { keep(text, data) }
}

/// Keeps the last message: SUNDIALS 7.
#[cfg(feature = "vendored")]
pub(crate) unsafe extern "C" fn message(
    _line: c_int,
    _function: *const c_char,
    _file: *const c_char,
    text: *const c_char,
    _code: sundials_sys::SUNErrCode,
    data: *mut c_void,
    _context: sundials_sys::SUNContext,
) {
    // SAFETY: SUNDIALS gives a text, and the address that it was given with this function.
    unsafe { keep(text, data) }
}

/// Keeps a text.
///
/// # Safety
/// `text` is null or a C string, and `data` the address of a [`Message`] that no other code uses
/// during the call.
unsafe fn keep(text: *const c_char, data: *mut c_void) {
    if !text.is_null() {
        // SAFETY: by the contract, both.
        unsafe { Lent::<Message>::new(data.cast()).keep(CStr::from_ptr(text).to_bytes()) };
    }
}
