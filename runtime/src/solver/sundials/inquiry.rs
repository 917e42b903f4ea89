//! Queries of IDA's memory by IDA's callbacks.

use std::os::raw::{c_int, c_void};
use std::ptr::NonNull;

use sundials_sys::{IDAGetCurrentTime, IDAGetDky, IDAGetLastOrder, IDAGetLastStep};

use super::super::vector::Handle;

/// IDA's flag where there is no vector for a derivative.
const BAD_DERIVATIVE: c_int = -26;

/// Queries of IDA's memory that are valid during a step, by callbacks: none of them calls a
/// callback.
///
/// There are two of them: that of [`Memory`](super::Memory), and that of its bridge, which is freed
/// after IDA's memory.
pub(crate) struct Inquiry {
    pub(super) ida: NonNull<c_void>,
    /// Unknowns.
    pub(super) dimension: usize,
}

impl Inquiry {
    /// Questions to IDA's memory for so many unknowns.
    ///
    /// # Safety
    /// The memory outlives this, or is asked nothing afterwards.
    pub(super) unsafe fn new(ida: NonNull<c_void>, dimension: usize) -> Self {
        Self { ida, dimension }
    }

    /// The time that IDA has reached within.
    pub(crate) fn current_time(&self) -> f64 {
        let mut time = 0.0;
        // SAFETY: the memory lives (`Inquiry::new`), and the other pointer is to a variable of this
        // function; so below.
        unsafe { IDAGetCurrentTime(self.ida.as_ptr(), &mut time) };
        time
    }

    /// The last step that was accepted.
    pub(crate) fn last_step(&self) -> f64 {
        let mut step = 0.0;
        // SAFETY: as above.
        unsafe { IDAGetLastStep(self.ida.as_ptr(), &mut step) };
        step
    }

    /// The order of the last step that was accepted.
    pub(crate) fn last_order(&self) -> usize {
        let mut order = 0;
        // SAFETY: as above.
        unsafe { IDAGetLastOrder(self.ida.as_ptr(), &mut order) };
        usize::try_from(order).unwrap_or(0)
    }

    /// The unknowns' derivatives of this order at a time within the last step.
    ///
    /// # Errors
    /// IDA's flag where the time is not one of those, or the vector has another length.
    pub(crate) fn interpolate(&self, time: f64, order: c_int, to: &mut Handle) -> Result<(), c_int> {
        if to.entries().len() != self.dimension {
            return Err(BAD_DERIVATIVE);
        }
        // SAFETY: the memory lives, and the vector is ours alone and of IDA's length.
        match unsafe { IDAGetDky(self.ida.as_ptr(), time, order, to.raw()) } {
            flag if flag < 0 => Err(flag),
            _ => Ok(()),
        }
    }
}
