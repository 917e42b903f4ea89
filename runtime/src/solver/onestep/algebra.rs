//! Algebraic unknowns where steps begin and end: by the same Newton's method as for IDA.

use std::ptr;

use sundials_sys::{SUNContext, SUNContext_Create, SUNContext_Free, comm_no_mpi};

use super::super::callbacks::{Bridge, Trouble};
use super::super::consistent::{Consistent, Inconsistent};
use super::super::linear::Factorisation;
use super::super::newton::Newton;
use super::super::vector::{Operations, Vector};
use super::super::watch::Watch;
use super::super::{IdaFlag, LinearSolver, Pattern, Settings, SolveError, Statistics, System};

/// Finds algebraic unknowns.
pub(crate) struct Algebra {
    // Freed in this order, the context last.
    consistent: Consistent,
    bridge: Bridge,
    y: Vector,
    yp: Vector,
    _context: Context,
}

/// A SUNDIALS context.
struct Context(SUNContext);

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: made by `SUNContext_Create`, and freed once.
        unsafe { SUNContext_Free(&mut self.0) };
    }
}

// SAFETY: all pointers are to objects that this instance alone owns, and a system is lent during a call only.
unsafe impl Send for Algebra {}

/// Why there are no consistent values: what was noted, or what Newton's method met.
pub enum Failure {
    Noted(Trouble),
    Method(SolveError),
}

impl Algebra {
    /// Space for a system that is explicit in its derivatives.
    ///
    /// # Errors
    /// SUNDIALS out of memory, or a pattern that the linear solvers refuse.
    pub fn new(system: &dyn System, settings: &Settings) -> Result<Self, SolveError> {
        let mut raw = ptr::null_mut();
        // SAFETY: the pointer is to a variable of this function.
        let value = unsafe { SUNContext_Create(comm_no_mpi(), &mut raw) };
        if value != 0 {
            return Err(SolveError::Setup { function: "SUNContext_Create", flag: IdaFlag { value, message: String::new() } });
        }
        let context = Context(raw);
        let (n, operations) = (system.dimension(), Operations::detect());
        // IDA's matrix is not used.
        let unused = Factorisation::new(&Pattern::full(1), LinearSolver::Dense)?;
        let newton = Newton::new(1, operations, context.0);
        let entries = system.pattern().entries();
        let bridge = Bridge::new(operations, settings.rtol, &settings.atol, entries, unused, newton, Watch::default());
        Ok(Self {
            consistent: Consistent::new(system, operations, context.0)?,
            bridge,
            y: Vector::zeros(n, operations, context.0),
            yp: Vector::zeros(n, operations, context.0),
            _context: context,
        })
    }

    /// Makes the algebraic unknowns of `y` consistent and sets the differential entries of `yp`, the others to zero.
    pub fn solve(&mut self, system: &mut dyn System, t: f64, y: &mut [f64], yp: &mut [f64]) -> Result<(), Failure> {
        self.y.entries_mut().copy_from_slice(y);
        self.bridge.begin();
        self.bridge.lend(system);
        let found = self.consistent.initialise(&mut self.bridge, t, &mut self.y, &mut self.yp);
        self.bridge.take_back();
        found.map_err(|cause| self.failure(t, cause))?;
        y.copy_from_slice(self.y.entries());
        yp.copy_from_slice(self.yp.entries());
        Ok(())
    }

    fn failure(&self, time: f64, cause: Inconsistent) -> Failure {
        match (self.bridge.trouble, cause) {
            (Some(trouble @ Trouble::Interrupted), _) => Failure::Noted(trouble),
            (trouble, Inconsistent::Callback) => Failure::Noted(trouble.unwrap_or(Trouble::Panic)),
            (_, Inconsistent::Singular(column)) => Failure::Method(SolveError::SingularJacobian { time, column }),
            (_, Inconsistent::Diverged { iterations, correction, unknown }) => {
                Failure::Method(SolveError::InitialConditions { time, iterations, correction, unknown })
            }
        }
    }

    /// Forgets the order of pivots and the work done.
    pub fn forget(&mut self) {
        self.consistent.forget();
        self.bridge.counts = Statistics::default();
    }

    /// The work done.
    pub fn counts(&self) -> Statistics {
        self.bridge.counts
    }
}
