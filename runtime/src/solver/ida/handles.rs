//! What SUNDIALS knows by its address: made in one place, freed with its owner, used by safe methods.

use std::ops::{Deref, DerefMut};
use std::os::raw::{c_int, c_void};
use std::ptr::{self, NonNull};

use sundials_sys::*;

use super::super::SolveError;
use super::super::callbacks::Bridge;
use super::super::vector::Vector;
use super::IdaCounts;
use super::setup::check;

/// A SUNDIALS context.
pub(super) struct Context(SUNContext);

impl Context {
    pub fn new() -> Result<Self, SolveError> {
        let mut raw = ptr::null_mut();
        // SAFETY: the address is valid for the call, which writes a context or nothing there.
        check("SUNContext_Create", unsafe { SUNContext_Create(comm_no_mpi(), &mut raw) })?;
        Ok(Self(raw))
    }

    pub fn raw(&self) -> SUNContext {
        self.0
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: made by `new`, and freed here only; its owner keeps it longer than what was made with it.
        unsafe { SUNContext_Free(&mut self.0) };
    }
}

/// The bridge, which SUNDIALS hands to the callbacks by its address.
pub(super) struct OwnBridge(NonNull<Bridge>);

impl OwnBridge {
    pub fn new(bridge: Bridge) -> Self {
        Self(NonNull::from(Box::leak(Box::new(bridge))))
    }

    pub fn address(&self) -> *mut Bridge {
        self.0.as_ptr()
    }
}

impl Deref for OwnBridge {
    type Target = Bridge;

    fn deref(&self) -> &Bridge {
        // SAFETY: of a box that lives as long as this. Callbacks use the address only during IDA's calls, over which no reference from
        // here is held: those take [`Memory`], and where a callback's work is needed outside of them, this reference itself.
        unsafe { self.0.as_ref() }
    }
}

impl DerefMut for OwnBridge {
    fn deref_mut(&mut self) -> &mut Bridge {
        // SAFETY: as for `deref`; the exclusive borrow of this is one of the bridge.
        unsafe { self.0.as_mut() }
    }
}

impl Drop for OwnBridge {
    fn drop(&mut self) {
        // SAFETY: from the box of `new`, and freed here only.
        drop(unsafe { Box::from_raw(self.0.as_ptr()) });
    }
}

/// The memory of IDA. Null where there was none left; every function of IDA then returns an error.
pub(super) struct Memory(*mut c_void);

impl Memory {
    /// # Safety
    /// What this memory is told of (context, bridge, solvers, vectors) lives as long as it does, and all vectors have the length of
    /// those with which it is initialised.
    pub unsafe fn new(context: &Context) -> Self {
        // SAFETY: the context is valid.
        Self(unsafe { IDACreate(context.raw()) })
    }

    pub fn raw(&self) -> *mut c_void {
        self.0
    }

    /// Begins anew at these values.
    pub fn begin(&mut self, time: f64, y: &Vector, yp: &Vector) -> c_int {
        // SAFETY: by the contract of `new`, here and in all methods below.
        unsafe { IDAReInit(self.0, time, y.raw(), yp.raw()) }
    }

    /// Searches y' and the algebraic unknowns at the beginning; `ahead` is a later time.
    pub fn search_initial(&mut self, time: f64, y: &mut Vector, yp: &mut Vector, ahead: f64) -> c_int {
        // SAFETY: by the contract of `new`.
        unsafe {
            let mut value = IDAReInit(self.0, time, y.raw(), yp.raw());
            if value == IDA_SUCCESS {
                value = IDACalcIC(self.0, IDA_YA_YDP_INIT, ahead);
            }
            if value == IDA_SUCCESS {
                value = IDAGetConsistentIC(self.0, y.raw(), yp.raw());
            }
            value
        }
    }

    /// The first step; zero for IDA's rule.
    pub fn set_first_step(&mut self, step: f64) -> c_int {
        // SAFETY: by the contract of `new`.
        unsafe { IDASetInitStep(self.0, step) }
    }

    /// The longest step; zero for none.
    pub fn set_longest_step(&mut self, step: f64) -> c_int {
        // SAFETY: by the contract of `new`.
        unsafe { IDASetMaxStep(self.0, step) }
    }

    /// The time beyond which no step goes.
    pub fn set_stop(&mut self, time: f64) -> c_int {
        // SAFETY: by the contract of `new`.
        unsafe { IDASetStopTime(self.0, time) }
    }

    /// Begins the integrals anew.
    pub fn begin_integrals(&mut self, values: &Vector) -> c_int {
        // SAFETY: by the contract of `new`.
        unsafe { IDAQuadReInit(self.0, values.raw()) }
    }

    /// The tolerances of the integrals.
    pub fn set_integral_tolerances(&mut self, rtol: f64, atol: &Vector) -> c_int {
        // SAFETY: by the contract of `new`.
        unsafe { IDAQuadSVtolerances(self.0, rtol, atol.raw()) }
    }

    /// Steps to `end`, or one step towards it; writes where it came to.
    pub fn solve(&mut self, end: f64, time: &mut f64, y: &mut Vector, yp: &mut Vector, one_step: bool) -> c_int {
        let task = if one_step { IDA_ONE_STEP } else { IDA_NORMAL };
        // SAFETY: by the contract of `new`; the callbacks get the bridge, to which nobody else holds a reference during the call.
        unsafe { IDASolve(self.0, end, time, y.raw(), yp.raw(), task) }
    }

    /// The integrals where the last step ended.
    pub fn integrals(&self, mut time: f64, values: &mut Vector) -> c_int {
        // SAFETY: by the contract of `new`.
        unsafe { IDAGetQuad(self.0, &mut time, values.raw()) }
    }

    /// A derivative of the unknowns inside of the last step.
    pub fn interpolate(&self, time: f64, order: c_int, out: &mut Vector) -> c_int {
        // SAFETY: by the contract of `new`.
        unsafe { IDAGetDky(self.0, time, order, out.raw()) }
    }

    /// The integrals inside of the last step.
    pub fn interpolate_integrals(&self, time: f64, out: &mut Vector) -> c_int {
        // SAFETY: by the contract of `new`.
        unsafe { IDAGetQuadDky(self.0, time, 0, out.raw()) }
    }

    /// What was counted since the beginning, and the length of the last step.
    pub fn counts(&self) -> (IdaCounts, f64) {
        let mut now = IdaCounts::default();
        let (mut residuals, mut setups, mut last_order, mut order) = (0, 0, 0, 0);
        let (mut first, mut last, mut next, mut time) = (0.0, 0.0, 0.0, 0.0);
        // SAFETY: by the contract of `new`; the addresses are valid for the call.
        unsafe {
            IDAGetIntegratorStats(
                self.0,
                &mut now.steps,
                &mut residuals,
                &mut setups,
                &mut now.error_test_failures,
                &mut last_order,
                &mut order,
                &mut first,
                &mut last,
                &mut next,
                &mut time,
            );
            IDAGetNumNonlinSolvConvFails(self.0, &mut now.nonlinear_failures);
        }
        (now, last)
    }

    /// Local errors of the last step that was tried.
    pub fn local_errors(&self, out: &mut Vector) -> c_int {
        // SAFETY: by the contract of `new`.
        unsafe { IDAGetEstLocalErrors(self.0, out.raw()) }
    }

    /// The present error weights: reciprocal tolerances.
    pub fn weights(&self, out: &mut Vector) -> c_int {
        // SAFETY: by the contract of `new`.
        unsafe { IDAGetErrWeights(self.0, out.raw()) }
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        if !self.0.is_null() {
            // SAFETY: made by `new`, and freed here only, before all that it was told of.
            unsafe { IDAFree(&mut self.0) };
        }
    }
}
