//! Data of Newton's method kept from one solve to the next; the method is in [`object`].

use std::os::raw::c_long;

use sundials_sys::SUNNonlinSolLSetupFn;

use super::sundials::Context;
use super::vector::{Operations, Vector};

pub(super) mod object;

/// rate / (1 − rate) that is assumed after a new factorisation.
const AFTER_SETUP: f64 = 20.0;

/// Least rate / (1 − rate) of a first correction of algebraic unknowns that are not in the error
/// test. A rate that was measured after a setup does not hold for a later solve with the same
/// Jacobian. No test sees the remaining error of such a correction, which would grow from step to
/// step.
const UNTESTED: f64 = 0.25;

/// Data kept from one solve to the next.
pub(crate) struct Newton {
    correction: Vector,
    /// IDA's function that leads to a new Jacobian and its factorisation.
    setup: SUNNonlinSolLSetupFn,
    /// Leading coefficient of the last solve, and of the last setup.
    cj: f64,
    setup_cj: f64,
    /// rate / (1 − rate).
    rate_factor: f64,
    /// The least of it for a first correction.
    least_factor: f64,
    /// True if the factorisation belongs to the present step.
    current: bool,
    iterations: c_long,
    failures: c_long,
}

impl Newton {
    pub(super) fn new(length: usize, operations: Operations, context: &Context) -> Self {
        Self {
            correction: Vector::zeros(length, operations, context),
            setup: None,
            cj: f64::NAN,
            setup_cj: f64::NAN,
            rate_factor: AFTER_SETUP,
            least_factor: 0.0,
            current: false,
            iterations: 0,
            failures: 0,
        }
    }

    /// Converges algebraic unknowns further, which are not in the error test.
    pub(super) fn with_untested_unknowns(self) -> Self {
        Self { least_factor: UNTESTED, ..self }
    }

    /// The last correction of the last solve.
    pub(super) fn corrections(&self) -> &[f64] {
        self.correction.entries()
    }

    /// Forgets the matrix: the next solve is the first one after a restart.
    pub(super) fn restart(&mut self) {
        self.setup_cj = f64::NAN;
    }

    /// Forgets earlier solves.
    pub(super) fn forget(&mut self) {
        self.cj = f64::NAN;
        self.setup_cj = f64::NAN;
        self.rate_factor = AFTER_SETUP;
        self.current = false;
    }
}
