//! A separate stack for deep recursion.
//!
//! Parsing, elaboration and code generation follow the nesting of a text, which has limits.
//! However, the thread of a caller may have a stack of any size, that of Python's
//! `threading.stack_size` or of a small container.

use std::sync::{Mutex, PoisonError};
use std::{panic, thread};

/// Bytes of the stack, of which pages are used only as deep as it gets; less where so much address
/// space is not to be had.
pub(crate) const SIZES: [usize; 3] = [64 << 20, 16 << 20, 4 << 20];

/// Does the work on a thread with a large stack and waits for it; on the caller's own where no
/// thread can be started. A panic goes on in the caller.
pub fn on_own_stack<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let slot = Mutex::new(Some(work));
    let run = || {
        let work = slot.lock().unwrap_or_else(PoisonError::into_inner).take();
        work.map(|work| work())
    };
    for size in SIZES {
        let ended = thread::scope(|scope| {
            let thread = thread::Builder::new().name("smpl".into()).stack_size(size).spawn_scoped(scope, run);
            thread.map(|thread| thread.join())
        });
        match ended {
            Ok(Ok(Some(value))) => return value,
            Ok(Err(payload)) => panic::resume_unwind(payload),
            Ok(Ok(None)) | Err(_) => {}
        }
    }
    match run() {
        Some(value) => value,
        None => unreachable!("the work was done, or has panicked"),
    }
}
