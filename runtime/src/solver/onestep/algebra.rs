//! Algebraic unknowns where steps begin and end: by the same Newton's method as for IDA.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use super::super::callbacks::{Bridge, Tolerances, Trouble};
use super::super::consistent::{Consistent, End, Inconsistent};
use super::super::linear::Factorisation;
use super::super::newton::Newton;
use super::super::nonnegative::Nonnegative;
use super::super::sundials::Context;
use super::super::vector::{Operations, Vector};
use super::super::watch::Watch;
use super::super::{LinearSolver, Pattern, Settings, SolveError, Statistics, System};

/// Finds algebraic unknowns.
pub(crate) struct Algebra {
    consistent: Consistent,
    bridge: Bridge,
    y: Vector,
    yp: Vector,
}

// SAFETY: all pointers, and all reference counts, are to objects that this instance alone owns and
// does not share; a system is lent during a call only.
unsafe impl Send for Algebra {}

/// Reason why there are no consistent values: what was noted, or what Newton's method met.
pub(super) enum Failure {
    Noted(Trouble),
    Method(SolveError),
}

impl Algebra {
    /// Space for a system that is explicit in its derivatives.
    ///
    /// # Errors
    /// SUNDIALS out of memory, or a pattern that the linear solvers refuse.
    pub(super) fn new(system: &dyn System, settings: &Settings) -> Result<Self, SolveError> {
        let context = &Context::new()?;
        let (n, operations) = (system.dimension(), Operations::detect());
        // IDA's matrix is not used.
        let unused = Factorisation::new(&Pattern::full(1), LinearSolver::Dense)?;
        let newton = Newton::new(1, operations, context);
        let entries = system.pattern().entries();
        let tolerances = Tolerances::new(settings.rtol, &settings.atol);
        let bridge = Bridge::new(operations, tolerances, entries, unused, newton, Nonnegative::default(), Watch::default());
        Ok(Self {
            consistent: Consistent::new(system, operations, context)?,
            bridge,
            y: Vector::zeros(n, operations, context),
            yp: Vector::zeros(n, operations, context),
        })
    }

    /// As [`solve`](Self::solve), inside of the bounds where an integration begins; see
    /// [`Consistent::begin`].
    pub(super) fn begin(&mut self, system: &mut dyn System, (t, first): (f64, bool), y: &mut [f64], yp: &mut [f64]) -> Result<(), Failure> {
        self.y.entries_mut().copy_from_slice(y);
        let found = self.with(system, |this| this.consistent.begin(&mut this.bridge, first, t, (&mut this.y, &mut this.yp)));
        self.take(t, found, (y, yp))
    }

    /// Makes the algebraic unknowns of `y` consistent and sets the differential entries of `yp`,
    /// the others to zero.
    pub(super) fn solve(&mut self, system: &mut dyn System, t: f64, y: &mut [f64], yp: &mut [f64]) -> Result<(), Failure> {
        self.y.entries_mut().copy_from_slice(y);
        let found = self.with(system, |this| this.consistent.initialise(&mut this.bridge, t, &mut this.y, &mut this.yp));
        self.take(t, found, (y, yp))
    }

    fn take(&self, t: f64, found: Result<(), Inconsistent>, (y, yp): (&mut [f64], &mut [f64])) -> Result<(), Failure> {
        found.map_err(|cause| self.failure(t, cause))?;
        y.copy_from_slice(self.y.entries());
        yp.copy_from_slice(self.yp.entries());
        Ok(())
    }

    /// The same where `y` is nearly consistent and `off` is F(t, y, 0) there: without another
    /// Jacobian, if that serves. `last` where an advance ends.
    pub(super) fn follow(
        &mut self,
        system: &mut dyn System,
        (t, last): (f64, bool),
        y: &mut [f64],
        (off, rates): (&[f64], &mut [f64]),
    ) -> Result<(), Failure> {
        self.y.entries_mut().copy_from_slice(y);
        self.yp.entries_mut().fill(0.0);
        let follows = self.with(system, |this| {
            let end = End { t, y: &mut this.y, yp: &this.yp, last };
            this.consistent.follow(&mut this.bridge, end, (off, rates))
        });
        if follows {
            y.copy_from_slice(self.y.entries());
            return Ok(());
        }
        self.solve(system, t, y, rates)
    }

    /// Does `work` with the system; it is taken back also after a panic.
    fn with<R>(&mut self, system: &mut dyn System, work: impl FnOnce(&mut Self) -> R) -> R {
        self.bridge.begin();
        // SAFETY: taken back below.
        unsafe { self.bridge.lend(system) };
        let done = catch_unwind(AssertUnwindSafe(|| work(self)));
        self.bridge.take_back();
        done.unwrap_or_else(|panic| resume_unwind(panic))
    }

    fn failure(&self, time: f64, cause: Inconsistent) -> Failure {
        match (self.bridge.trouble, cause) {
            (Some(trouble @ Trouble::Interrupted), _) => Failure::Noted(trouble),
            (trouble, Inconsistent::Callback) => Failure::Noted(trouble.unwrap_or(Trouble::Panic)),
            (_, Inconsistent::Singular(column)) => Failure::Method(SolveError::SingularJacobian { time, column }),
            (_, Inconsistent::Outside { unknown }) => Failure::Method(SolveError::Outside { time, unknown }),
            (_, Inconsistent::Diverged { iterations, correction, unknown }) => {
                Failure::Method(SolveError::InitialConditions { time, iterations, correction, unknown })
            }
        }
    }

    /// Forgets the order of pivots and the work done.
    pub(super) fn forget(&mut self) {
        self.consistent.forget();
        self.bridge.counts = Statistics::default();
    }

    /// The work done.
    pub(super) fn counts(&self) -> Statistics {
        self.bridge.counts
    }
}
