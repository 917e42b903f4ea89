//! IDA's memory, and the objects whose addresses it holds.

use std::os::raw::{c_int, c_long, c_void};
use std::ptr::{self, NonNull};

use sundials_sys::*;

use super::super::callbacks::{self, Bridge, Message};
use super::super::newton::object;
use super::super::vector::{Handle, Vector};
use super::super::{IdaFlag, SolveError};
use super::check::check;
use super::{Context, Inquiry, Kept};

/// IDA's flag where there is no memory.
const NO_MEMORY: c_int = -20;

/// Counters that IDA keeps from one restart to the next, and its last step.
#[derive(Clone, Copy, Default)]
pub(crate) struct IdaCounts {
    pub steps: c_long,
    pub error_test_failures: c_long,
    pub nonlinear_failures: c_long,
    pub last_step: f64,
}

/// Extent of a call of IDA.
#[derive(Clone, Copy)]
pub(crate) enum Task {
    /// To the time asked for.
    Normal,
    /// One internal step.
    OneStep,
}

/// IDA's memory with all that it holds the address of.
///
/// The callbacks work on the [`Bridge`] while one of IDA's functions runs. Each of those takes the
/// memory exclusively, so that no other code has a reference to the bridge then.
pub(crate) struct Memory {
    inquiry: Inquiry,
    bridge: Kept<Bridge>,
    messages: Kept<Message>,
    solver: Kept<_generic_SUNLinearSolver>,
    matrix: Kept<_generic_SUNMatrix>,
    nonlinear: Kept<_generic_SUNNonlinearSolver>,
    /// Length of the integrals, once there are some.
    integrals: usize,
    context: Context,
}

impl Memory {
    /// Memory for systems of the length of `y`, whose callbacks work on a bridge.
    ///
    /// # Errors
    /// SUNDIALS out of memory.
    pub(crate) fn new(bridge: Bridge, y: &Vector, yp: &Vector, context: &Context) -> Result<Self, SolveError> {
        // SAFETY: the context lives.
        let Some(ida) = NonNull::new(unsafe { IDACreate(context.raw()) }) else {
            return Err(SolveError::Setup { function: "IDACreate", flag: IdaFlag { value: NO_MEMORY, message: String::new() } });
        };
        let (bridge, dimension) = (Kept::new(bridge), y.entries().len());
        // SAFETY: the memory is freed when all this is dropped, the bridge after it (`Memory`),
        // which asks it nothing then.
        let [inquiry, of_bridge] = unsafe { [Inquiry::new(ida, dimension), Inquiry::new(ida, dimension)] };
        let mut memory = Self {
            inquiry,
            messages: Kept::new(Message::default()),
            solver: Kept::new(callbacks::linear_solver(&bridge, context)),
            matrix: Kept::new(callbacks::matrix(context)),
            nonlinear: Kept::new(object::object(&bridge, context)),
            bridge,
            integrals: 0,
            context: context.clone(),
        };
        memory.bridge_mut().set_memory(of_bridge);
        memory.introduce(y, yp)?;
        Ok(memory)
    }

    /// Passes to IDA the callbacks and the objects.
    fn introduce(&self, y: &Vector, yp: &Vector) -> Result<(), SolveError> {
        let (ida, data) = (self.raw(), self.bridge.address().cast::<c_void>());
        let (y, yp) = (self.of_system(y), self.of_system(yp));
        self.take_messages()?;
        // SAFETY: the memory lives; the bridge and the objects are kept until it is freed, the
        // vectors are copied.
        unsafe {
            check("IDASetUserData", IDASetUserData(ida, data))?;
            check("IDAInit", IDAInit(ida, Some(callbacks::residual), 0.0, y, yp))?;
            check("IDAWFtolerances", IDAWFtolerances(ida, Some(callbacks::error_weights)))?;
            check("IDASetLinearSolver", IDASetLinearSolver(ida, self.solver.address(), self.matrix.address()))?;
            check("IDASetNonlinearSolver", IDASetNonlinearSolver(ida, self.nonlinear.address()))?;
            check("IDASetJacFn", IDASetJacFn(ida, Some(callbacks::jacobian)))
        }
    }

    /// Messages are kept instead of being printed: SUNDIALS 6.
    #[cfg(not(feature = "vendored"))]
    fn take_messages(&self) -> Result<(), SolveError> {
        // SAFETY: the memory lives, and the place of the messages is kept until it is freed.
        check("IDASetErrHandlerFn", unsafe { IDASetErrHandlerFn(self.raw(), Some(callbacks::message), self.messages.address().cast()) })
    }

    /// Messages are kept instead of being printed: SUNDIALS 7, where they belong to the context.
    #[cfg(feature = "vendored")]
    fn take_messages(&self) -> Result<(), SolveError> {
        let (context, data) = (self.context.raw(), self.messages.address().cast());
        // All handlers are called, and one that prints is there from the start.
        // SAFETY: the context lives, and nothing calls the handler once this memory is freed
        // (`drop` clears it).
        check("SUNContext_ClearErrHandlers", unsafe { SUNContext_ClearErrHandlers(context) })?;
        // SAFETY: as above.
        check("SUNContext_PushErrHandler", unsafe { SUNContext_PushErrHandler(context, Some(callbacks::message), data) })
    }

    /// Data of the callbacks.
    pub(crate) fn bridge(&self) -> &Bridge {
        // SAFETY: IDA is not at work, since its functions take the memory exclusively.
        unsafe { self.bridge.get() }
    }

    /// The same, to be changed.
    pub(crate) fn bridge_mut(&mut self) -> &mut Bridge {
        // SAFETY: as above.
        unsafe { self.bridge.get_mut() }
    }

    /// Clears what belongs to the time before a call of IDA.
    pub(crate) fn begin(&mut self) {
        self.bridge_mut().begin();
        // SAFETY: IDA is not at work.
        unsafe { self.messages.get_mut() }.clear();
    }

    /// IDA's last message.
    pub(crate) fn message(&self) -> String {
        // SAFETY: IDA is not at work.
        unsafe { self.messages.get() }.text()
    }

    /// The context of everything here.
    pub(crate) fn context(&self) -> &Context {
        &self.context
    }

    fn raw(&self) -> *mut c_void {
        self.inquiry.ida.as_ptr()
    }

    /// A vector as IDA takes it.
    ///
    /// # Panics
    /// Where it has another length than the system: a fault of this crate, not of an input.
    fn of_system(&self, vector: &Handle) -> N_Vector {
        assert_eq!(vector.entries().len(), self.inquiry.dimension);
        vector.raw()
    }

    /// The same for one of the integrals.
    fn of_integrals(&self, vector: &Handle) -> N_Vector {
        assert_eq!(vector.entries().len(), self.integrals);
        vector.raw()
    }
}

/// Settings of IDA that are made once.
impl Memory {
    /// Highest order, and most steps in a call.
    pub(crate) fn set_limits(&mut self, order: u32, steps: u32) -> Result<(), SolveError> {
        // SAFETY: the memory lives; so below.
        check("IDASetMaxOrd", unsafe { IDASetMaxOrd(self.raw(), order as c_int) })?;
        // SAFETY: as above.
        check("IDASetMaxNumSteps", unsafe { IDASetMaxNumSteps(self.raw(), c_long::from(steps)) })
    }

    /// Longest step; zero stands for no bound.
    pub(crate) fn set_longest_step(&mut self, step: f64) -> Result<(), SolveError> {
        // SAFETY: as above.
        check("IDASetMaxStep", unsafe { IDASetMaxStep(self.raw(), step) })
    }

    /// Shortest step.
    pub(crate) fn set_shortest_step(&mut self, step: f64) -> Result<(), SolveError> {
        // SAFETY: as above.
        check("IDASetMinStep", unsafe { IDASetMinStep(self.raw(), step) })
    }

    /// Differential unknowns (one, else zero), and the choice to leave the others out of the error
    /// test.
    pub(crate) fn set_identity(&mut self, identity: &Vector, suppress: bool) -> Result<(), SolveError> {
        // SAFETY: the memory lives, and copies the vector, which has its length.
        check("IDASetId", unsafe { IDASetId(self.raw(), self.of_system(identity)) })?;
        if suppress {
            // SAFETY: the memory lives.
            check("IDASetSuppressAlg", unsafe { IDASetSuppressAlg(self.raw(), 1) })?;
        }
        Ok(())
    }

    /// Integrals in addition to the unknowns.
    pub(crate) fn set_integrals(&mut self, values: &Vector) -> Result<(), SolveError> {
        let function = Some(callbacks::quadratures as unsafe extern "C" fn(_, _, _, _, _) -> _);
        // SAFETY: the memory lives, and copies the vector.
        check("IDAQuadInit", unsafe { IDAQuadInit(self.raw(), function, values.raw()) })?;
        self.integrals = values.entries().len();
        Ok(())
    }

    /// The integrals enter the error test.
    pub(crate) fn test_integrals(&mut self) -> Result<(), SolveError> {
        // SAFETY: the memory lives.
        check("IDASetQuadErrCon", unsafe { IDASetQuadErrCon(self.raw(), 1) })
    }
}

/// Calls of IDA.
impl Memory {
    /// Begins anew at a time and a state; IDA's flag.
    pub(crate) fn restart(&mut self, time: f64, y: &Vector, yp: &Vector) -> c_int {
        // SAFETY: the memory lives, and copies the vectors, which have its length.
        unsafe { IDAReInit(self.raw(), time, self.of_system(y), self.of_system(yp)) }
    }

    /// The first step; zero for IDA's rule.
    pub(crate) fn set_first_step(&mut self, step: f64) -> Result<(), SolveError> {
        // SAFETY: the memory lives.
        check("IDASetInitStep", unsafe { IDASetInitStep(self.raw(), step) })
    }

    /// Begins the integrals anew.
    pub(crate) fn restart_integrals(&mut self, values: &Vector) -> Result<(), SolveError> {
        // SAFETY: the memory lives, and copies the vector, which has the length of the integrals.
        check("IDAQuadReInit", unsafe { IDAQuadReInit(self.raw(), self.of_integrals(values)) })
    }

    /// Tolerances of the integrals.
    pub(crate) fn set_integral_tolerances(&mut self, rtol: f64, atol: &Vector) -> Result<(), SolveError> {
        // SAFETY: as above.
        check("IDAQuadSVtolerances", unsafe { IDAQuadSVtolerances(self.raw(), rtol, self.of_integrals(atol)) })
    }

    /// IDA's own search for y' and the algebraic unknowns at a time and a state, which it replaces;
    /// its flag.
    pub(crate) fn calculate_start(&mut self, time: f64, y: &mut Vector, yp: &mut Vector, first: f64) -> c_int {
        let mut value = self.restart(time, y, yp);
        if value == IDA_SUCCESS {
            // SAFETY: the memory lives; the system is lent to the bridge, which no other code uses
            // now.
            value = unsafe { IDACalcIC(self.raw(), IDA_YA_YDP_INIT, first) };
        }
        if value == IDA_SUCCESS {
            // SAFETY: the memory lives, and the vectors are borrowed exclusively and have its
            // length.
            value = unsafe { IDAGetConsistentIC(self.raw(), self.of_system(y), self.of_system(yp)) };
        }
        value
    }

    /// Time that IDA must not exceed.
    pub(crate) fn set_end(&mut self, time: f64) -> Result<(), SolveError> {
        // SAFETY: the memory lives.
        check("IDASetStopTime", unsafe { IDASetStopTime(self.raw(), time) })
    }

    /// Steps towards a time; IDA's flag, with the time that was reached and the state there.
    pub(crate) fn solve(&mut self, end: f64, time: &mut f64, y: &mut Vector, yp: &mut Vector, task: Task) -> c_int {
        let task = match task {
            Task::Normal => IDA_NORMAL,
            Task::OneStep => IDA_ONE_STEP,
        };
        // SAFETY: the memory lives; the system is lent to the bridge, which no other code uses now;
        // the vectors are borrowed exclusively and have the memory's length.
        unsafe { IDASolve(self.raw(), end, time, self.of_system(y), self.of_system(yp), task) }
    }

    /// The integrals at the time that the last call reached.
    pub(crate) fn take_integrals(&mut self, values: &mut Vector) -> Result<(), SolveError> {
        let mut time = 0.0;
        // SAFETY: the memory lives, and the vector is borrowed exclusively and has the length of
        // the integrals.
        check("IDAGetQuad", unsafe { IDAGetQuad(self.raw(), &mut time, self.of_integrals(values)) })
    }

    /// The unknowns' derivatives of this order at a time within the last step.
    pub(crate) fn interpolate(&mut self, time: f64, order: c_int, to: &mut Handle) -> Result<(), SolveError> {
        self.inquiry.interpolate(time, order, to).or_else(|flag| check("IDAGetDky", flag))
    }

    /// The integrals at a time within the last step.
    pub(crate) fn interpolate_integrals(&mut self, time: f64, values: &mut Vector) -> Result<(), SolveError> {
        // SAFETY: as above.
        check("IDAGetQuadDky", unsafe { IDAGetQuadDky(self.raw(), time, 0, self.of_integrals(values)) })
    }

    /// Estimated local errors of the last step that was tried; false if missing.
    pub(crate) fn local_errors(&self, errors: &mut Vector) -> bool {
        // SAFETY: the memory lives, calls nothing back here, and the vector is borrowed exclusively
        // and has its length.
        unsafe { IDAGetEstLocalErrors(self.raw(), self.of_system(errors)) == IDA_SUCCESS }
    }

    /// The present error weights; false if missing.
    pub(crate) fn error_weights(&self, weights: &mut Vector) -> bool {
        // SAFETY: as above.
        unsafe { IDAGetErrWeights(self.raw(), self.of_system(weights)) == IDA_SUCCESS }
    }

    /// Counters of IDA since the last restart.
    pub(crate) fn counts(&self) -> IdaCounts {
        let mut counts = IdaCounts::default();
        let (mut residuals, mut setups, mut last_order, mut order) = (0, 0, 0, 0);
        let (mut first, mut next, mut time) = (0.0, 0.0, 0.0);
        // SAFETY: the memory lives, and all pointers are to variables of this function.
        unsafe {
            IDAGetIntegratorStats(
                self.raw(),
                &mut counts.steps,
                &mut residuals,
                &mut setups,
                &mut counts.error_test_failures,
                &mut last_order,
                &mut order,
                &mut first,
                &mut counts.last_step,
                &mut next,
                &mut time,
            );
            IDAGetNumNonlinSolvConvFails(self.raw(), &mut counts.nonlinear_failures);
        }
        counts
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        let mut ida = self.raw();
        // SAFETY: made by `IDACreate`, and freed once; all that it holds addresses of is still
        // there.
        unsafe { IDAFree(&mut ida) };
        debug_assert_eq!(ida, ptr::null_mut());
        #[cfg(feature = "vendored")]
        // SAFETY: the context lives; its handler's data are about to go.
        unsafe {
            SUNContext_ClearErrHandlers(self.context.raw());
        }
    }
}
