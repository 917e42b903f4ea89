//! Drift of declared invariants: along the integration, the change of the value must be the
//! integral of the rate. The rates are integrated with the unknowns and take part in the error
//! test, so that a drift is an error of the model and not of a coarse integral.

use super::Environment;
use crate::setup::SetupError;
use crate::solver::{Advance, Quadratures, SolveError, integrator};

/// Drift of one invariant since the reset.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drift {
    /// Change of the value less the integral of the rate, summed over the intervals.
    pub sum: f64,
    /// Largest absolute sum so far.
    pub largest: f64,
    /// Largest absolute value so far, to compare with.
    pub magnitude: f64,
}

impl Environment {
    /// Evaluates the declared invariants along the integration from now on (slower, and with other
    /// steps).
    ///
    /// # Errors
    /// If the solver refuses its settings, which it has accepted before.
    pub fn watch_invariants(&mut self) -> Result<(), SetupError> {
        let mut settings = self.setup.settings.clone();
        let least = settings.atol.iter().copied().fold(settings.rtol, f64::min);
        settings.quadratures = Quadratures::Checked { rtol: settings.rtol, atol: least };
        self.system.watch_invariants();
        self.collect_statistics();
        self.integrator = integrator(&self.system, settings)?;
        self.drifts = vec![Drift::default(); self.setup.model().interface().invariants.len()];
        Ok(())
    }

    /// Drift of each declared invariant, if they are watched.
    #[must_use]
    pub fn invariant_drifts(&self) -> &[Drift] {
        &self.drifts
    }

    /// Goes to `end` or to an event before it, adding to the drifts.
    pub(super) fn advance_watched(&mut self, begin: f64, end: f64) -> Result<Advance, SolveError> {
        let before = self.evaluate_invariants(begin);
        let outcome = self.integrator.advance(&mut self.system, end)?;
        let after = self.evaluate_invariants(self.integrator.time());
        let integrals = &self.integrator.quadratures()[self.setup.model().quadratures()..];
        let values = before.chunks_exact(2).zip(after.chunks_exact(2)).map(|(before, after)| (before[0], after[0]));
        for ((drift, (before, after)), integral) in self.drifts.iter_mut().zip(values).zip(integrals) {
            drift.sum += after - before - integral;
            drift.largest = drift.largest.max(drift.sum.abs());
            drift.magnitude = drift.magnitude.max(before.abs()).max(after.abs());
        }
        Ok(outcome)
    }

    /// Value and rate of each invariant at the present state.
    fn evaluate_invariants(&mut self, t: f64) -> Vec<f64> {
        let mut out = vec![0.0; 2 * self.drifts.len()];
        let (y, yp) = (self.integrator.state(), self.integrator.derivative());
        let (model, memory) = self.system.parts();
        model.invariants(memory, t, y, yp, &mut out);
        out
    }
}
