//! Stepping, seen from the environments.

use serde::{Deserialize, Serialize};

use super::{Edge, SolveError, System};

/// End of an [`advance`](Integrator::advance).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Advance {
    /// At the time asked for, exactly.
    Reached,
    /// Stop at conditions of root functions that became true; [`Integrator::events`] lists them.
    Event,
}

/// Work of an integrator since it was made (or since [`Integrator::forget`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Steps taken and accepted.
    pub steps: u64,
    /// Evaluations of the residual, those of restarts included.
    pub residuals: u64,
    /// Evaluations of the Jacobian, those of restarts included.
    pub jacobians: u64,
    /// Factorisations of the Newton matrix.
    pub factorisations: u64,
    /// Solves with a factorised Newton matrix (Newton iterations).
    pub linear_solves: u64,
    /// Steps rejected by the error test.
    pub error_test_failures: u64,
    /// Newton iterations that did not converge.
    pub nonlinear_failures: u64,
    /// Residuals that were not finite.
    pub not_finite: u64,
    /// Calls of [`Integrator::restart`] that succeeded.
    pub restarts: u64,
    /// Control steps repeated with the other implicit method.
    pub retries: u64,
}

impl Statistics {
    /// Steps, those that failed included.
    pub(super) fn tried(&self) -> u64 {
        self.steps + self.error_test_failures + self.nonlinear_failures
    }
}

/// Data that an integrator carries from one control step to the next, in addition to the state;
/// none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Carried {
    /// The step that fitted at its beginning; zero where none is known.
    pub step: f64,
    /// The explicit one of two methods takes it.
    pub explicit: bool,
    /// The longest step known to suit the explicit pair of lower order; zero where none is,
    /// negative where a longer one did not.
    pub reach: f64,
}

/// A method that steps a [`System`] through time.
///
/// An integrator is made for one system's dimension and pattern. The system itself is lent to it
/// call by call, so that inputs and parameters may be changed in between (followed by a
/// [`restart`](Self::restart)).
pub trait Integrator: Send {
    /// Begins anew at time `t0` and state `y` (length n): makes algebraic unknowns and derivatives
    /// consistent and sets the quadratures to zero. `yp` is a first guess of the derivatives where
    /// the system is implicit, otherwise not needed.
    ///
    /// # Errors
    /// [`SolveError::InitialConditions`] and its like when no consistent state is found near `y`.
    fn restart(&mut self, system: &mut dyn System, t0: f64, y: &[f64], yp: Option<&[f64]>) -> Result<(), SolveError>;

    /// Steps to `t_end`, exactly, or to the first event. What became true by a restart is an event
    /// at its time. After an event a restart is needed.
    ///
    /// # Errors
    /// Why the integration ended early; [`time`](Self::time) and [`state`](Self::state) are then
    /// those of the last accepted step, and the integrator needs a restart.
    fn advance(&mut self, system: &mut dyn System, t_end: f64) -> Result<Advance, SolveError>;

    /// Forgets what was carried over from earlier restarts (last step, order of pivots, conditions)
    /// and sets the statistics to zero. Later results are those of a new instance. To be called
    /// where an episode begins.
    fn forget(&mut self);

    /// Data for the next control step: stored at the end of one, and passed to
    /// [`carry`](Self::carry) at the start of the next.
    fn carried(&self) -> Carried {
        Carried::default()
    }

    /// Takes what was kept; after a [`forget`](Self::forget).
    fn carry(&mut self, carried: Carried) {
        let _ = carried;
    }

    /// Present time.
    fn time(&self) -> f64;

    /// Unknowns at the present time.
    fn state(&self) -> &[f64];

    /// Their derivatives.
    fn derivative(&self) -> &[f64];

    /// Integrals since the last restart.
    fn quadratures(&self) -> &[f64];

    /// After [`Advance::Event`], for each root function: 1 if its condition became true, −1 if it
    /// ceased to hold and that is an event, otherwise 0. There may be none: what is at the
    /// threshold of a strict condition is decided by the next restart.
    fn events(&self) -> &[i32];

    /// Truth of the conditions.
    fn edges(&self) -> &[Edge];

    /// Truth of the conditions, to be changed before a restart.
    fn edges_mut(&mut self) -> &mut [Edge];

    /// A root function that was not a number at a state since the last [`forget`](Self::forget).
    fn undefined_event(&self) -> Option<usize>;

    /// Counts of the work done.
    fn statistics(&self) -> Statistics;
}

/// No integrator: what an instance has that is lent one for each step.
pub(crate) struct Absent;

impl Integrator for Absent {
    fn restart(&mut self, _: &mut dyn System, _: f64, _: &[f64], _: Option<&[f64]>) -> Result<(), SolveError> {
        Err(SolveError::NotStarted)
    }

    fn advance(&mut self, _: &mut dyn System, _: f64) -> Result<Advance, SolveError> {
        Err(SolveError::NotStarted)
    }

    fn forget(&mut self) {}

    fn time(&self) -> f64 {
        0.0
    }

    fn state(&self) -> &[f64] {
        &[]
    }

    fn derivative(&self) -> &[f64] {
        &[]
    }

    fn quadratures(&self) -> &[f64] {
        &[]
    }

    fn events(&self) -> &[i32] {
        &[]
    }

    fn edges(&self) -> &[Edge] {
        &[]
    }

    fn edges_mut(&mut self) -> &mut [Edge] {
        &mut []
    }

    fn undefined_event(&self) -> Option<usize> {
        None
    }

    fn statistics(&self) -> Statistics {
        Statistics::default()
    }
}
