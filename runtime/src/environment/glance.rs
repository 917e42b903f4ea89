//! Looks ahead from the present point of an episode without moving it: states and measurements
//! within the coming step, and values of the disturbances by their rules.

use smpl_compiler::layout::Region;

use super::interval::IntervalEnd;
use super::{Environment, StepError};

impl Environment {
    /// Integrates a share of the coming step, from 0 to 1, with its action, and writes the states
    /// and the measurements there: without noise, sampling, delay or clipping. NaN where the
    /// integration does not get there. The episode is then where it was.
    ///
    /// # Errors
    /// An action that [`check`](Self::check) refuses, or an interruption.
    pub(crate) fn glance(&mut self, action: &[f64], share: f64, states: &mut [f64], measured: &mut [f64]) -> Result<(), StepError> {
        self.check(action)?;
        let point = self.snapshot();
        self.share = share;
        self.prepare(action);
        let broken = self.setup.programs.has_start && self.broken_variable().is_some();
        let outcome = if broken { IntervalEnd::Broken } else { self.integrate() };
        if outcome == IntervalEnd::Completed {
            self.system.region_mut(Region::Quadrature).copy_from_slice(&self.integrals);
            if share >= 1.0 && self.setup.programs.has_end {
                self.run_end();
            }
            self.evaluate_finish(self.end_time());
            self.state(states);
            measured.copy_from_slice(self.measured());
        } else {
            states.fill(f64::NAN);
            measured.fill(f64::NAN);
        }
        let interrupted = self.was_interrupted(outcome);
        self.share = 1.0;
        // The snapshot is of this instance: nothing can be wrong with it.
        let restored = self.restore(&point);
        if interrupted || restored.is_err() { Err(StepError::Interrupted) } else { Ok(()) }
    }

    /// Measurements at the present point, and values of the disturbances for the coming step by
    /// their rules, both with these random numbers of the reset and of the step. The present values
    /// of the disturbances are lost.
    pub(crate) fn disturbed(&mut self, action: &[f64], draws: &[f64], measured: &mut [f64], out: &mut [f64]) {
        let setup = std::sync::Arc::clone(&self.setup);
        for (draw, &value) in setup.draws.iter().zip(draws) {
            self.system.region_mut(Region::Draw)[draw.at] = value;
        }
        let (model, memory) = self.system.parts();
        model.prepare_parameters(memory);
        model.prepare_step(memory);
        self.evaluate_finish(self.time());
        measured.copy_from_slice(self.measured());
        self.apply(action);
        if setup.programs.has_disturbances {
            let begin = self.begin;
            let (model, memory) = self.system.parts();
            model.disturb(memory, begin);
        }
        let values = self.system.region(Region::Disturbance);
        for (element, out) in setup.catalogue.disturbances.elements().iter().zip(out) {
            *out = values[element.at];
        }
    }
}
