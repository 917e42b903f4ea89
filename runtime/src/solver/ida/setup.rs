//! Making an integrator: everything that is allocated, and everything IDA is told once.

use std::os::raw::{c_int, c_long, c_void};
use std::ptr;

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
use super::{Context, Ida, IdaCounts, Phase};

impl Ida {
    pub(super) fn with_operations(system: &dyn System, settings: Settings, operations: Operations) -> Result<Self, SolveError> {
        let n = system.dimension();
        settings.validate(n)?;
        check_shape(system)?;
        let mut raw = ptr::null_mut();
        check("SUNContext_Create", unsafe { SUNContext_Create(comm_no_mpi(), &mut raw) })?;
        let context = Context(raw);
        let factorisation = Factorisation::new(system.pattern(), settings.linear_solver)?;
        let entries = system.pattern().entries();
        let newton = Newton::new(n, operations, context.0);
        let watch = Watch::new(system.root_count(), system.root_kinds());
        let mut bridge = Bridge::new(operations, settings.rtol, &settings.atol, entries, factorisation, newton, watch);
        (bridge.leading, bridge.looseness) = (n / (1 + system.directions()), settings.looseness);
        bridge.shared.set_many(system.directions() > 0);
        let consistent = match system.is_explicit() {
            true => Some(Consistent::new(system, operations, context.0)?),
            false => None,
        };
        let vector = |length| Vector::zeros(length, operations, context.0);
        let quadratures = Integrals::new(system, &settings.quadratures, operations, context.0);
        let sharing = || Vector::sharing(n, operations, context.0, &bridge.shared);
        let (y, yp) = (sharing(), sharing());
        let later = (system.root_count() > 0).then(|| (sharing(), sharing()));
        let masks = !settings.algebraic_error_control && system.differential().contains(&false);
        let identity = (masks || !system.is_explicit()).then(|| vector(n));
        let pattern = system.pattern();
        let columns = (0..pattern.dimension()).flat_map(|column| pattern.column(column).map(move |_| column)).collect();
        let bridge = Box::into_raw(Box::new(bridge));
        let mut ida = Self {
            memory: unsafe { IDACreate(context.0) },
            bridge,
            linear: LinearObjects::new(bridge, context.0),
            nonlinear: newton::object(bridge, context.0),
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
        ida.bridge().memory = ida.memory;
        if system.root_count() > 0 && system.roots_use_derivatives() {
            ida.bridge().derivative = Some(Vector::sharing(n, operations, ida.context.0, &unsafe { &*ida.bridge }.shared));
        }
        ida.configure()?;
        Ok(ida)
    }

    /// Tells IDA everything that does not change.
    fn configure(&mut self) -> Result<(), SolveError> {
        let memory = self.memory;
        let data: *mut c_void = self.bridge.cast();
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
        check("IDASetErrHandlerFn", unsafe { IDASetErrHandlerFn(self.memory, Some(callbacks::message), data) })
    }

    /// Messages go to `data`, the bridge, in place of standard error: SUNDIALS 7, where they belong to the context.
    #[cfg(feature = "vendored")]
    unsafe fn take_messages(&self, data: *mut c_void) -> Result<(), SolveError> {
        let context = self.context.0;
        // All handlers are called, and one that prints is there from the start.
        check("SUNContext_ClearErrHandlers", unsafe { SUNContext_ClearErrHandlers(context) })?;
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
        check("IDASetId", unsafe { IDASetId(self.memory, identity.raw()) })?;
        if !self.settings.algebraic_error_control {
            check("IDASetSuppressAlg", unsafe { IDASetSuppressAlg(self.memory, 1) })?;
        }
        Ok(())
    }

    fn configure_quadratures(&mut self) -> Result<(), SolveError> {
        let Some(quadratures) = self.quadratures.as_ref().filter(|q| q.by_steps.is_none()) else {
            return Ok(());
        };
        let function = Some(callbacks::quadratures as unsafe extern "C" fn(_, _, _, _, _) -> _);
        check("IDAQuadInit", unsafe { IDAQuadInit(self.memory, function, quadratures.values.raw()) })?;
        if let Some(rtol) = quadratures.checked() {
            let tolerances = quadratures.tolerances.raw();
            check("IDAQuadSVtolerances", unsafe { IDAQuadSVtolerances(self.memory, rtol, tolerances) })?;
            check("IDASetQuadErrCon", unsafe { IDASetQuadErrCon(self.memory, 1) })?;
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
    let pattern = system.pattern();
    let n = pattern.dimension();
    let (given, expected) = (n * (1 + system.directions()), system.dimension());
    if given != expected {
        return Err(SolveError::Length { name: "pattern", given, expected });
    }
    let lacks_diagonal = |&i: &usize| system.differential()[i] && !pattern.rows()[pattern.column(i)].contains(&i);
    match (0..n).find(lacks_diagonal) {
        Some(row) if system.is_explicit() => Err(SolveError::Diagonal { row }),
        _ => Ok(()),
    }
}
