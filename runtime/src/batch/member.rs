//! One instance of a batch, and those that share an integrator with it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{Autoreset, BatchOptions};
use crate::environment::{Environment, ResetError, ResetOptions, StepError, StepResult};
use crate::observe::Normalisation;
use crate::setup::Setup;
use crate::solver::Integrator;
use crate::steady::SteadyError;

/// Data of a step of one instance in addition to its flags.
#[derive(Clone, Debug, Default)]
pub struct Info {
    /// Time.
    pub time: f64,
    /// The phase in force, see [`Environment::phase`].
    pub phase: Option<usize>,
    /// Success.
    pub success: bool,
    /// Name of the success condition, empty when none.
    pub success_name: String,
    /// Message of the failure, empty when none.
    pub failure: String,
    /// Sum of the violations.
    pub cost: f64,
    /// Violations, in the order of [`Environment::constraint_names`].
    pub violations: Vec<f64>,
    /// All rewards.
    pub rewards: Vec<f64>,
    /// The state in declaration order.
    pub state: Vec<f64>,
}

impl Info {
    /// The info of an instance's last step (or reset).
    pub fn of(environment: &mut Environment) -> Self {
        let mut info = Self::sized(environment);
        info.fill(environment);
        info
    }

    fn sized(environment: &Environment) -> Self {
        Self {
            violations: vec![0.0; environment.violations().len()],
            rewards: vec![0.0; environment.rewards().len()],
            state: vec![0.0; environment.catalogue().states.len()],
            ..Self::default()
        }
    }

    /// Overwrites; allocates only for the message of a failure and the name of a success.
    fn fill(&mut self, environment: &mut Environment) {
        let last = environment.last().copied();
        self.time = environment.time();
        self.phase = environment.phase();
        self.success = last.is_some_and(|r| r.success);
        self.success_name.clear();
        self.success_name.push_str(environment.success_name());
        self.cost = last.map_or(0.0, |r| r.cost);
        self.violations.copy_from_slice(environment.violations());
        self.rewards.copy_from_slice(environment.rewards());
        environment.state(&mut self.state);
        self.failure.clear();
        if last.is_some_and(|r| r.failure.is_some()) {
            self.failure = environment.failure_message();
        }
    }
}

/// One instance with what belongs to it.
pub(super) struct Member {
    pub environment: Environment,
    /// The episode is over and the next step begins anew.
    pub pending: bool,
    pub action: Vec<f64>,
    pub info: Info,
    /// Final observation (as reported) and info of an episode that ended in the last step.
    pub final_observation: Vec<f64>,
    pub final_info: Info,
    pub ended: bool,
    pub fault: Option<Fault>,
}

pub(super) enum Fault {
    Step(StepError),
    Reset(ResetError),
}

/// Instances next to one another, which one thread steps in turn with one integrator: its space
/// stays in the nearest cache.
pub(super) struct Crew {
    pub integrator: Box<dyn Integrator>,
    pub members: Vec<Member>,
}

impl Member {
    pub(super) fn new(setup: Arc<Setup>) -> Self {
        let environment = Environment::without_integrator(setup);
        let info = Info::sized(&environment);
        Self {
            pending: false,
            action: vec![0.0; environment.catalogue().actions.len()],
            final_observation: vec![0.0; environment.observation_len()],
            final_info: info.clone(),
            info,
            ended: false,
            fault: None,
            environment,
        }
    }

    pub(super) fn reset(&mut self, seed: Option<u64>, options: &ResetOptions, integrator: &mut Box<dyn Integrator>) {
        self.pending = false;
        self.ended = false;
        if let Err(error) = self.environment.with_integrator(integrator, |environment| environment.reset(seed, options)) {
            self.fault = Some(Fault::Reset(error));
        }
        self.info.fill(&mut self.environment);
    }

    /// Stops the others where this one was interrupted.
    pub(crate) fn pass_on(&self, stop: &AtomicBool) {
        let interrupted = match &self.fault {
            Some(Fault::Step(error)) => *error == StepError::Interrupted,
            Some(Fault::Reset(error)) => matches!(error, ResetError::Interrupted | ResetError::Steady(SteadyError::Interrupted)),
            None => false,
        };
        if interrupted {
            stop.store(true, Ordering::Relaxed);
        }
    }

    /// Reward, terminated, truncated.
    pub(super) fn step(&mut self, action: &[f64], options: &BatchOptions, integrator: &mut Box<dyn Integrator>) -> (f64, bool, bool) {
        self.ended = false;
        if self.pending {
            self.reset(None, &options.reset, integrator);
            return (0.0, false, false);
        }
        let result = match self.take_step(action, options.normalisation, integrator) {
            Ok(result) => result,
            Err(error) => {
                self.fault = Some(Fault::Step(error));
                return (f64::NAN, false, false);
            }
        };
        self.info.fill(&mut self.environment);
        if result.terminated || result.truncated {
            match options.autoreset {
                Autoreset::NextStep => self.pending = true,
                Autoreset::SameStep => self.begin_anew(options, integrator),
                Autoreset::Disabled => {}
            }
        }
        (result.reward, result.terminated, result.truncated)
    }

    /// The action was checked.
    fn take_step(
        &mut self,
        action: &[f64],
        normalisation: Normalisation,
        integrator: &mut Box<dyn Integrator>,
    ) -> Result<StepResult, StepError> {
        if normalisation == Normalisation::Off {
            return self.environment.with_integrator(integrator, |environment| environment.step_checked(action));
        }
        let elements = self.environment.catalogue().actions.elements();
        for ((out, &value), element) in self.action.iter_mut().zip(action).zip(elements) {
            *out = normalisation.physical(value, element);
        }
        let action = &self.action;
        self.environment.with_integrator(integrator, |environment| environment.step_checked(action))
    }

    fn begin_anew(&mut self, options: &BatchOptions, integrator: &mut Box<dyn Integrator>) {
        self.environment.observe(options.normalisation.scales(), &mut self.final_observation);
        std::mem::swap(&mut self.info, &mut self.final_info);
        self.reset(None, &options.reset, integrator);
        self.ended = true;
    }
}
