//! Rules of disturbances at points: states, actions and present values in, the values of the next
//! step and measurements out.
//!
//! Estimators read here how a declared disturbance goes on, and by how much its random numbers move
//! it.

use std::sync::Arc;

use smpl_compiler::model::Draw;

use crate::environment::{Environment, ResetError, ResetOptions, Start, StateInput};
use crate::interrupt;
use crate::rollout::Given;
use crate::setup::{Setup, SetupError};

/// Points; every array has a row for each.
pub struct Plan<'a> {
    /// Number of points.
    pub count: usize,
    /// States in declaration order.
    pub states: &'a [f64],
    /// Actions.
    pub actions: &'a [f64],
    /// Present values of all disturbances in declaration order.
    pub disturbances: &'a [f64],
    /// Random numbers of the reset and of the step, see [`Rules::draws`].
    pub draws: &'a [f64],
    /// Parameters by name: one value for all points, or one for each.
    pub parameters: Given<'a>,
    /// Discrete variables by name.
    pub discrete: Given<'a>,
    /// Steps that count as completed.
    pub first_step: u32,
}

/// A plan that cannot be evaluated.
#[derive(Debug, thiserror::Error)]
pub enum RulesError {
    /// An array has another length.
    #[error("{name} has {given} entries, expected {expected}")]
    Length {
        /// Name of the array.
        name: String,
        /// Its length.
        given: usize,
        /// The right length.
        expected: usize,
    },
    /// An episode cannot begin at a point.
    #[error("point {index}: {error}")]
    Reset {
        /// Number of the point.
        index: usize,
        /// Cause.
        error: ResetError,
    },
    /// An interruption.
    #[error("the evaluation was interrupted")]
    Interrupted,
    /// The instance cannot be made.
    #[error(transparent)]
    Setup(#[from] SetupError),
}

/// An instance that evaluates rules.
pub struct Rules {
    environment: Environment,
}

impl Rules {
    /// Rules of a setup.
    ///
    /// # Errors
    /// When the solver refuses the system.
    pub fn new(setup: Arc<Setup>) -> Result<Self, SetupError> {
        Ok(Self { environment: Environment::new(setup)? })
    }

    /// The random numbers that rules and measurements may read, in the order of `draws`.
    #[must_use]
    pub fn draws(setup: &Setup) -> &[Draw] {
        &setup.model().interface().draws
    }

    /// Number of measurements.
    #[must_use]
    pub fn observations(&self) -> usize {
        self.environment.observation_len()
    }

    /// Writes the values of the disturbances for the coming step, and the measurements at the
    /// points without noise, sampling, delay or clipping.
    ///
    /// # Errors
    /// Arrays of a wrong length, a point at which no episode begins, or an interruption.
    pub fn run(&mut self, plan: &Plan<'_>, next: &mut [f64], measured: &mut [f64]) -> Result<(), RulesError> {
        let catalogue = self.environment.catalogue();
        let (states, actions, disturbances) = (catalogue.states.len(), catalogue.actions.len(), catalogue.disturbances.len());
        let (draws, observations) = (Self::draws(self.environment.setup()).len(), self.environment.observation_len());
        length("states", plan.states, plan.count * states)?;
        length("actions", plan.actions, plan.count * actions)?;
        length("disturbances", plan.disturbances, plan.count * disturbances)?;
        length("draws", plan.draws, plan.count * draws)?;
        length("next", next, plan.count * disturbances)?;
        length("measured", measured, plan.count * observations)?;
        for index in 0..plan.count {
            if interrupt::requested() {
                return Err(RulesError::Interrupted);
            }
            let options = plan.options(index, &self.environment);
            self.environment.reset(Some(0), &options).map_err(|error| RulesError::Reset { index, error })?;
            let row = |values: &'_ [f64], width: usize| values[index * width..(index + 1) * width].to_vec();
            let out = &mut next[index * disturbances..(index + 1) * disturbances];
            let seen = &mut measured[index * observations..(index + 1) * observations];
            self.environment.disturbed(&row(plan.actions, actions), &row(plan.draws, draws), seen, out);
        }
        Ok(())
    }
}

impl Plan<'_> {
    fn options(&self, index: usize, environment: &Environment) -> ResetOptions {
        let catalogue = environment.catalogue();
        let (states, disturbances) = (catalogue.states.len(), catalogue.disturbances.len());
        let value = |(name, values): &(String, &[f64])| (name.clone(), if values.len() == 1 { values[0] } else { values[index] });
        let present = &self.disturbances[index * disturbances..(index + 1) * disturbances];
        ResetOptions {
            start: Start::Nominal,
            state: StateInput::Array(self.states[index * states..(index + 1) * states].to_vec()),
            parameters: self.parameters.iter().map(value).collect(),
            discrete: self.discrete.iter().map(value).collect(),
            disturbed: catalogue.disturbances.names().map(str::to_owned).zip(present.iter().copied()).collect(),
            expected: true,
            first_step: self.first_step,
            ..ResetOptions::default()
        }
    }
}

fn length(name: &str, values: &[f64], expected: usize) -> Result<(), RulesError> {
    if values.len() == expected { Ok(()) } else { Err(RulesError::Length { name: name.into(), given: values.len(), expected }) }
}
