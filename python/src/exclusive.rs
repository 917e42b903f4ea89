//! Values that one thread uses at a time.

use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

use pyo3::prelude::*;

use crate::errors::SimulationError;

/// A value that refuses a second thread, and a handler of signals, while a computation uses it.
pub struct Exclusive<T> {
    value: Mutex<T>,
    name: &'static str,
}

impl<T> Exclusive<T> {
    /// The value; `name` is its name in the error.
    pub fn new(name: &'static str, value: T) -> Self {
        Self { value: Mutex::new(value), name }
    }

    /// Access to the value.
    ///
    /// # Errors
    /// A `SimulationError` while another thread has access: waiting for it would hold the
    /// interpreter lock.
    pub fn enter(&self) -> PyResult<MutexGuard<'_, T>> {
        match self.value.try_lock() {
            Ok(guard) => Ok(guard),
            Err(TryLockError::Poisoned(error)) => Ok(PoisonError::into_inner(error)),
            Err(TryLockError::WouldBlock) => {
                let message = format!("another thread uses this {} at the moment; create one for each thread", self.name);
                Err(SimulationError::new_err(message))
            }
        }
    }
}
