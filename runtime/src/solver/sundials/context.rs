//! The context in which SUNDIALS makes its objects.

use std::ptr;
use std::rc::Rc;

use sundials_sys::{SUNContext, SUNContext_Create, SUNContext_Free, comm_no_mpi};

use super::super::SolveError;
use super::check;

/// A SUNDIALS context, freed with the last object that was made in it.
#[derive(Clone)]
pub(crate) struct Context(Rc<Owned>);

struct Owned(SUNContext);

impl Context {
    /// A separate context.
    ///
    /// # Errors
    /// SUNDIALS out of memory.
    pub(crate) fn new() -> Result<Self, SolveError> {
        let mut raw = ptr::null_mut();
        // SAFETY: the pointer is to a variable of this function.
        check("SUNContext_Create", unsafe { SUNContext_Create(comm_no_mpi(), &mut raw) })?;
        Ok(Self(Rc::new(Owned(raw))))
    }

    /// Pointer for SUNDIALS.
    pub(crate) fn raw(&self) -> SUNContext {
        self.0.0
    }
}

impl Drop for Owned {
    fn drop(&mut self) {
        // SAFETY: made by `SUNContext_Create`, and freed once, when no code names it any more.
        unsafe { SUNContext_Free(&mut self.0) };
    }
}
