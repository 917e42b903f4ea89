//! Making an integrator: everything that is allocated, and everything IDA is told once.

use std::os::raw::{c_int, c_long, c_void};

use sundials_sys::*;

use super::super::callbacks::{self, Bridge, LinearObjects};
use super::super::consistent::Consistent;
use super::super::forcing::Forcing;
use super::super::linear::Factorisation;
use super::super::newton::{self, Newton};
use super::super::quadrature::Integrals;
use super::super::vector::{Operations, Vector};
use super::super::watch::Watch;
use super::super::{IdaFlag, Settings, SolveError, System};
use super::handles::{Context, Memory, OwnBridge};
use super::{Ida, IdaCounts, Phase};

impl Ida {
    pub(super) fn with_operations(system: &dyn System, settings: Settings, operations: Operations) -> Result<Self, SolveError> {
        let n = system.dimension();
        settings.validate(n)?;
        check_shape(system)?;
        let context = Context::new()?;
        let factorisation = Factorisation::of(system, settings.linear_solver)?;
        let entries = system.pattern().entries();
        let newton = Newton::new(n, operations, context.raw());
        let watch = Watch::new(system.root_count(), system.root_kinds());
        let mut bridge = Bridge::new(operations, settings.rtol, &settings.atol, entries, factorisation, newton, watch);
        bridge.leading = n / (1 + system.directions());
        let consistent = match system.is_explicit() {
            true => Some(Consistent::new(system, operations, context.raw())?),
            false => None,
        };
        let vector = |length| Vector::zeros(length, operations, context.raw());
        let quadratures = Integrals::new(system, &settings.quadratures, operations, context.raw());
        let sharing = || Vector::sharing(n, operations, context.raw(), &bridge.shared);
        let (y, yp) = (sharing(), sharing());
        let later = (system.root_count() > 0).then(|| (sharing(), sharing()));
        let masks = !settings.algebraic_error_control && system.differential().contains(&false);
        let identity = (masks || !system.is_explicit()).then(|| vector(n));
        let pattern = system.pattern();
        let columns = (0..n).flat_map(|column| pattern.column(column).map(move |_| column)).collect();
        let bridge = OwnBridge::new(bridge);
        let mut ida = Self {
            // SAFETY: all that it will be told of are fields after it, and vectors of `n` numbers.
            memory: unsafe { Memory::new(&context) },
            linear: LinearObjects::new(bridge.address(), context.raw()),
            nonlinear: newton::object(bridge.address(), context.raw()),
            bridge,
            y,
            yp,
            quadratures,
            identity,
            consistent,
            forcing: Forcing::new(system.forcing_count()),
            context,
            operations,
            settings,
            differential: system.differential().into(),
            rows_of_entries: (pattern.rows().into(), columns),
            events: vec![0; system.root_count()].into(),
            later,
            scale: 0.0,
            time: 0.0,
            phase: Phase::Idle,
            counted: IdaCounts::default(),
            last_step: 0.0,
            last_interval: 1.0,
        };
        ida.bridge.memory = ida.memory.raw();
        if system.root_count() > 0 && system.roots_use_derivatives() {
            ida.bridge.derivative = Some(Vector::sharing(n, operations, ida.context.raw(), &ida.bridge.shared));
        }
        ida.configure()?;
        Ok(ida)
    }

    /// Tells IDA everything that does not change.
    fn configure(&mut self) -> Result<(), SolveError> {
        let memory = self.memory.raw();
        let data: *mut c_void = self.bridge.address().cast();
        // SAFETY: the memory is valid or null, which is refused; solvers, vectors and the bridge are fields that outlive it.
        unsafe {
            self.take_messages(data)?;
            check("IDASetUserData", IDASetUserData(memory, data))?;
            check("IDAInit", IDAInit(memory, Some(callbacks::residual), 0.0, self.y.raw(), self.yp.raw()))?;
            check("IDAWFtolerances", IDAWFtolerances(memory, Some(callbacks::error_weights)))?;
            let (solver, matrix) = (&mut *self.linear.solver, &mut *self.linear.matrix);
            check("IDASetLinearSolver", IDASetLinearSolver(memory, solver, matrix))?;
            check("IDASetNonlinearSolver", IDASetNonlinearSolver(memory, &mut *self.nonlinear))?;
            check("IDASetJacFn", IDASetJacFn(memory, Some(callbacks::jacobian)))?;
            check("IDASetMaxOrd", IDASetMaxOrd(memory, self.settings.max_order as c_int))?;
            check("IDASetMaxNumSteps", IDASetMaxNumSteps(memory, c_long::from(self.settings.max_steps)))?;
            if self.settings.max_step.is_finite() {
                check("IDASetMaxStep", IDASetMaxStep(memory, self.settings.max_step))?;
            }
            if self.settings.min_step > 0.0 {
                check("IDASetMinStep", IDASetMinStep(memory, self.settings.min_step))?;
            }
        }
        self.configure_identity()?;
        self.configure_quadratures()
    }

    /// Messages go to `data`, the bridge, in place of standard error: SUNDIALS 6.
    #[cfg(not(feature = "vendored"))]
    unsafe fn take_messages(&self, data: *mut c_void) -> Result<(), SolveError> {
        // SAFETY: `data` is the bridge, which outlives the memory; the callback has the type that is asked for.
        check("IDASetErrHandlerFn", unsafe { IDASetErrHandlerFn(self.memory.raw(), Some(callbacks::message), data) })
    }

    /// Messages go to `data`, the bridge, in place of standard error: SUNDIALS 7, where they belong to the context.
    #[cfg(feature = "vendored")]
    unsafe fn take_messages(&self, data: *mut c_void) -> Result<(), SolveError> {
        let context = self.context.raw();
        // All handlers are called, and one that prints is there from the start.
        // SAFETY: the context is valid.
        check("SUNContext_ClearErrHandlers", unsafe { SUNContext_ClearErrHandlers(context) })?;
        // SAFETY: `data` is the bridge; the context is freed after it, but calls no handler then.
        check("SUNContext_PushErrHandler", unsafe { SUNContext_PushErrHandler(context, Some(callbacks::message), data) })
    }

    /// Implicit systems, and those whose algebraic unknowns are left out of the error test: which unknowns are differential.
    fn configure_identity(&mut self) -> Result<(), SolveError> {
        let Some(identity) = &mut self.identity else {
            return Ok(());
        };
        for (entry, &differential) in identity.entries_mut().iter_mut().zip(&self.differential) {
            *entry = f64::from(u8::from(differential));
        }
        let memory = self.memory.raw();
        // SAFETY: the memory is valid; the vector is copied.
        check("IDASetId", unsafe { IDASetId(memory, identity.raw()) })?;
        if !self.settings.algebraic_error_control {
            // SAFETY: as above.
            check("IDASetSuppressAlg", unsafe { IDASetSuppressAlg(memory, 1) })?;
        }
        Ok(())
    }

    fn configure_quadratures(&mut self) -> Result<(), SolveError> {
        let Some(quadratures) = self.quadratures.as_ref().filter(|q| q.by_steps.is_none()) else {
            return Ok(());
        };
        let function = Some(callbacks::quadratures as unsafe extern "C" fn(_, _, _, _, _) -> _);
        // SAFETY: the memory is valid, the vector is copied, the callback has the type that is asked for.
        check("IDAQuadInit", unsafe { IDAQuadInit(self.memory.raw(), function, quadratures.values.raw()) })?;
        if let Some(rtol) = quadratures.checked() {
            check("IDAQuadSVtolerances", self.memory.set_integral_tolerances(rtol, &quadratures.tolerances))?;
            // SAFETY: the memory is valid.
            check("IDASetQuadErrCon", unsafe { IDASetQuadErrCon(self.memory.raw(), 1) })?;
        }
        Ok(())
    }
}

/// Turns the return value of a setup function into a result.
pub(super) fn check(function: &'static str, value: c_int) -> Result<(), SolveError> {
    if value >= 0 {
        return Ok(());
    }
    Err(SolveError::Setup { function, flag: IdaFlag { value, message: String::new() } })
}

/// The pattern has the system's dimension, and a diagonal where derivatives are explicit.
fn check_shape(system: &dyn System) -> Result<(), SolveError> {
    let (n, pattern) = (system.dimension(), system.pattern());
    let lengths = [("pattern", pattern.dimension()), ("differential", system.differential().len())];
    if let Some((name, given)) = lengths.into_iter().find(|&(_, given)| given != n) {
        return Err(SolveError::Length { name, given, expected: n });
    }
    let lacks_diagonal = |&i: &usize| system.differential()[i] && !pattern.rows()[pattern.column(i)].contains(&i);
    match (0..n).find(lacks_diagonal) {
        Some(row) if system.is_explicit() => Err(SolveError::Diagonal { row }),
        _ => Ok(()),
    }
}
