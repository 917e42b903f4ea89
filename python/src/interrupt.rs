//! Ctrl-C: Python notes a signal, and looks at it only between its own instructions.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};

use pyo3::prelude::*;
use smpl_runtime::interrupt;

use crate::errors::{fault, guarded, panicked};

thread_local! {
    /// The exception of a signal's handler, to be raised when the computation on this thread has
    /// stopped.
    static RAISED: RefCell<Option<PyErr>> = const { RefCell::new(None) };
}

/// Lets computations ask Python for signals.
pub fn install() {
    interrupt::set_hook(signalled);
}

/// Runs the handlers of signals that have come; whether one of them raised an exception. Only the
/// main thread has any.
fn signalled() -> bool {
    let seen = || {
        RAISED.with(|raised| {
            if raised.borrow().is_none()
                && let Err(error) = Python::attach(|py| py.check_signals())
            {
                *raised.borrow_mut() = Some(error);
            }
            raised.borrow().is_some()
        })
    };
    // Python may be on its way out, and no panic may reach the solver.
    catch_unwind(AssertUnwindSafe(seen)).unwrap_or(false)
}

/// Runs `work` without the interpreter lock. A panic in it, or a signal that arrived meanwhile,
/// becomes an exception.
pub fn released<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let result = guarded(|| py.detach(work));
    match RAISED.take() {
        Some(error) => Err(error),
        None => result,
    }
}

/// Runs `work` on a new thread with a stack that suits a compiler. When a signal comes the caller
/// goes on at once, and what the thread finds is dropped.
pub fn aside<T: Send + 'static>(py: Python<'_>, work: impl FnOnce() -> T + Send + 'static) -> PyResult<T> {
    use std::sync::mpsc::{RecvTimeoutError, sync_channel};

    let (sender, receiver) = sync_channel(1);
    let run = move || {
        // The receiver is gone after a signal.
        let _ = sender.send(catch_unwind(AssertUnwindSafe(work)));
    };
    std::thread::Builder::new().name("smpl-compile".into()).stack_size(STACK).spawn(run)?;
    let wait = move || loop {
        match receiver.recv_timeout(interrupt::PERIOD) {
            Ok(result) => return Some(result),
            Err(RecvTimeoutError::Timeout) if !interrupt::requested() => {}
            Err(_) => return None,
        }
    };
    match released(py, wait)? {
        Some(Ok(value)) => Ok(value),
        Some(Err(cause)) => Err(panicked(cause.as_ref())),
        None => Err(fault("the thread of the compiler ended")),
    }
}

/// Bytes of the stack of a compilation.
const STACK: usize = 64 << 20;
