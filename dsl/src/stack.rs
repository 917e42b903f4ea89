//! A separate stack for deep recursion.
//!
//! Parsing, elaboration and code generation follow the nesting of a text, which has limits.
//! However, the thread of a caller may have a stack of any size, that of Python's
//! `threading.stack_size` or of a small container.

use std::cell::Cell;
use std::hint::black_box;
use std::sync::{Mutex, PoisonError};
use std::{panic, thread};

/// Bytes of the stack, of which pages are used only as deep as it gets; less where so much address
/// space is not to be had.
pub(crate) const SIZES: [usize; 3] = [64 << 20, 16 << 20, 4 << 20];

/// Blocks of memory that a thread's heap gets at once: their number, and bytes of each.
const ROOM: (usize, usize) = (24, 120 << 10);

thread_local! {
    /// This thread has a stack of the largest size.
    static LARGE: Cell<bool> = const { Cell::new(false) };
}

/// Does the work on a thread with a large stack and waits for it; on the caller's own where it has
/// one, or where no thread can be started. A panic goes on in the caller.
pub fn on_own_stack<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    if LARGE.get() {
        return work();
    }
    let slot = Mutex::new(Some(work));
    let run = || {
        let work = slot.lock().unwrap_or_else(PoisonError::into_inner).take();
        work.map(|work| work())
    };
    for size in SIZES {
        let ended = thread::scope(|scope| {
            let begin = || {
                LARGE.set(size == SIZES[0]);
                make_room();
                run()
            };
            let thread = thread::Builder::new().name("smpl".into()).stack_size(size).spawn_scoped(scope, begin);
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

/// Makes the heap of a new thread larger, so that it grows at once. The allocator of glibc extends
/// it by a page at a time otherwise, with a call of the system for each: hundreds in a compilation.
pub fn make_room() {
    let (count, bytes) = ROOM;
    let blocks: Vec<Vec<u8>> = (0..count).map(|_| Vec::with_capacity(bytes)).collect();
    drop(black_box(blocks));
}

#[cfg(test)]
mod tests {
    use super::on_own_stack;
    use std::thread;

    #[test]
    fn work_within_work_stays_on_the_large_stack() {
        let (outer, inner) = on_own_stack(|| (thread::current().id(), on_own_stack(|| thread::current().id())));
        assert_eq!(outer, inner);
        assert_ne!(outer, thread::current().id());
    }

    #[test]
    fn a_panic_goes_on_in_the_caller() {
        let ended = std::panic::catch_unwind(|| on_own_stack(|| on_own_stack(|| assert!(thread::panicking(), "within"))));
        assert!(ended.is_err());
    }
}
