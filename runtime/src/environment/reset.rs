//! The beginning of an episode.

use std::collections::{BTreeMap, BTreeSet};

use smpl_compiler::ir::Builtin;
use smpl_compiler::layout::{FramePart, Region};
use smpl_compiler::model::OutsideBounds;

use super::{Environment, History, Phase, Replay, finish};
use crate::catalogue::UnknownName;
use crate::failure::{Short, SolverFailure, describe_equation, describe_solver};
use crate::observe::variate;
use crate::parameters::{self, ParameterError};
use crate::past::PastError;
use crate::random::{AT_RESET, EpisodeKey, Stream};
use crate::setup::{fill_means, set_parameters};
use crate::solver::{Carried, Edge, SolveError, Statistics, System};
use crate::start::{self, Sought, StartError, StartFailure};
use crate::steady::{self, SteadyError};

/// Start of an episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// Drawn by the model's distributions.
    #[default]
    Sampled,
    /// Every random number at its mean.
    Nominal,
    /// The steady state of parameters at their means.
    Steady,
    /// The state to which a period under the nominal policy returns, parameters at their means.
    Cyclic,
}

impl Start {
    /// Names of all starts.
    pub const NAMES: [&str; 4] = ["sampled", "nominal", "steady", "cyclic"];

    /// The start of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        let all = [Self::Sampled, Self::Nominal, Self::Steady, Self::Cyclic];
        Self::NAMES.iter().position(|known| *known == name).map(|at| all[at])
    }
}

/// A state given from outside, physical units.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum StateInput {
    /// As the start says.
    #[default]
    Start,
    /// Some states by flattened name, and guesses of algebraic variables; the others as the start
    /// says.
    Named(BTreeMap<String, f64>),
    /// All states in declaration order.
    Array(Vec<f64>),
}

/// Options of a reset. Given values are simulated, neither clipped nor tested.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ResetOptions {
    /// Start.
    pub start: Start,
    /// States.
    pub state: StateInput,
    /// Discrete variables by name.
    pub discrete: BTreeMap<String, f64>,
    /// Parameters of this episode by name; they override draws and the parameters of the setup. The
    /// name of an array gives every element the value, apart from elements with their own.
    pub parameters: BTreeMap<String, f64>,
    /// Recorded disturbances by name, one value a step.
    pub disturbances: BTreeMap<String, Vec<f64>>,
    /// Those of them whose last value holds after the end of the record, where a step otherwise
    /// fails.
    pub held: BTreeSet<String>,
    /// The last value of every one of them holds.
    pub hold_records: bool,
    /// The episode goes on as it is expected to: random numbers of the steps are at their means,
    /// measurements without noise. A steady state that nothing reads is not searched for.
    pub expected: bool,
    /// Steps that count as completed at the start: the clock and recorded disturbances begin there.
    pub first_step: u32,
    /// Disturbances at the start by name, from which their rules go on.
    pub disturbed: BTreeMap<String, f64>,
    /// Seed of what is drawn after the start, disturbances and errors of measurements; that of the
    /// start if none.
    pub disturbance_seed: Option<u64>,
    /// The past that delayed values read; what follows from the start if none.
    pub history: Option<History>,
}

/// Reason why an episode cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum ResetError {
    /// A name that the model does not have.
    #[error(transparent)]
    UnknownName(#[from] UnknownName),
    /// A value that a parameter cannot have.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The state has the wrong length.
    #[error("state has {given} entries, expected {expected}")]
    Length {
        /// Its length.
        given: usize,
        /// The number of states.
        expected: usize,
    },
    /// A value is NaN or infinite.
    #[error("{what} must be finite")]
    NotFinite {
        /// Name.
        what: String,
    },
    /// Somebody wanted the reset to stop, see [`crate::interrupt`].
    #[error("the reset was interrupted")]
    Interrupted,
    /// A phase that the schedule does not have.
    #[error("`phase` must be a whole number from 1 to {phases} (the phases in their order), not {value}")]
    Phase {
        /// Number of phases.
        phases: usize,
        /// Given value.
        value: f64,
    },
    /// A recorded sequence without values.
    #[error("the recorded disturbance `{name}` has no values")]
    Empty {
        /// Name.
        name: String,
    },
    /// The steady state of the episode's parameters was not found.
    #[error("steady state: {0}")]
    Steady(#[from] SteadyError),
    /// No cyclic steady state was found.
    #[error("cyclic start: {message}")]
    Cyclic {
        /// Reason.
        message: String,
    },
    /// A history that does not fit.
    #[error("history: {message}")]
    History {
        /// Reason.
        message: String,
    },
    /// A delayed value that cannot be.
    #[error(transparent)]
    Past(#[from] PastError),
    /// The algebraic equations have no solution at the start.
    #[error("initial state: {message}")]
    Inconsistent {
        /// Failure and its place.
        message: String,
        /// The block of equations without a solution, and all that was tried.
        start: Option<Box<StartFailure>>,
    },
}

impl Environment {
    /// Begins an episode: that of the seed, or the next one of the last seed.
    ///
    /// # Errors
    /// Unknown names, wrong lengths, NaN, no steady state, no consistent start. The
    /// instance then needs another reset.
    pub fn reset(&mut self, seed: Option<u64>, options: &ResetOptions) -> Result<(), ResetError> {
        let key = seed.map_or(self.progress.next_key, EpisodeKey::seeded);
        self.progress.phase = Phase::New;
        self.progress.key = key;
        self.progress.next_key = key.next();
        self.progress.expected = options.expected;
        self.statistics = Statistics::default();
        self.integrator.forget();
        self.progress.carried = Carried::default();
        self.drifts.fill(super::Drift::default());
        let setup = std::sync::Arc::clone(&self.setup);
        self.system.restore(setup.system.memory().all());
        self.system.rest_past();

        let given = [setup.given.as_slice(), &setup.resolve(&options.parameters)?].concat();
        self.draw(options.start);
        set_parameters(&mut self.system, &given);
        parameters::check_computed(&setup.catalogue.parameters, &self.system)?;
        self.find_steady_state(options)?;
        self.set_replay(options)?;
        self.system.start_past();
        self.initial_values(options)?;
        self.refuse_broken_start()?;
        self.system.record_start(self.time(), &self.progress.y, &self.progress.yp)?;
        self.take_history(options)?;
        if matches!(options.state, StateInput::Start) {
            self.refuse_outside()?;
        }
        self.first_observation()?;
        if options.start == Start::Cyclic {
            self.progress.phase = Phase::Running;
            self.begin_cycle()?;
            self.statistics = Statistics::default();
        }
        self.progress.key = options.disturbance_seed.map_or(key, EpisodeKey::seeded);
        self.progress.phase = Phase::Running;
        Ok(())
    }

    fn draw(&mut self, start: Start) {
        fill_means(&mut self.system, &self.setup.draws);
        if start != Start::Sampled {
            return;
        }
        for draw in self.setup.draws.iter().filter(|d| !d.each_step) {
            let stream = Stream::from_hash(self.progress.key, draw.stream);
            let value = variate(&stream, draw.kind, AT_RESET, draw.element);
            self.system.region_mut(Region::Draw)[draw.at] = value;
        }
    }

    /// Solves for the steady state unless it is that of the nominal parameters. The search always
    /// begins there, so that the result does not depend on earlier episodes.
    fn find_steady_state(&mut self, options: &ResetOptions) -> Result<(), ResetError> {
        let start = options.start;
        let setup = &self.setup;
        let has_steady = setup.model().interface().steady.is_some();
        let nominal = self.system.region(Region::Param) == setup.system.region(Region::Param);
        if let Some(error) = setup.no_steady() {
            // Nothing reads it: other parameters are not searched for one either.
            return if start == Start::Steady { Err(error.clone().into()) } else { Ok(()) };
        }
        if has_steady && !nominal {
            let needed = setup.steady.needed || start == Start::Steady;
            if options.expected && !needed {
                steady::forget(&mut self.system);
                return Ok(());
            }
            let before = (!needed).then(|| self.system.clone());
            match (steady::solve_declared(&mut self.system, &setup.catalogue, setup.steady_state()), before) {
                (Err(_), Some(before)) => {
                    self.system = before;
                    steady::forget(&mut self.system);
                }
                (result, _) => drop(result?),
            }
        }
        if !has_steady && start == Start::Steady {
            let guess = steady::guess(&self.system, &setup.catalogue);
            steady::solve_declared(&mut self.system, &setup.catalogue, &guess)?;
        }
        Ok(())
    }

    /// States, discrete variables and what the algebraic equations make of them. Initial values
    /// that read algebraic unknowns are worked out from their guesses first, and again from the
    /// solution, as often as one such value needs another. Returns the values that were given to
    /// states which follow from constraints.
    pub(super) fn settle_initial_values(&mut self, options: &ResetOptions) -> Result<Vec<(usize, f64)>, ResetError> {
        self.initial_inputs(options);
        self.initial_states(options)?;
        self.initial_discretes(options)?;
        self.settle_discretes(options)?;
        let mut given = self.given_following();
        self.meet_conditions(options)?;
        self.make_consistent()?;
        for passes_left in (0..self.setup.programs.start_passes).rev() {
            let first = self.setup.model().states();
            let solved = self.progress.y[first..].to_vec();
            let states = self.progress.y[..first].to_vec();
            let discretes = self.system.region(Region::Discrete).to_vec();
            self.initial_states(options)?;
            let declared = self.given_following();
            self.progress.y[first..].copy_from_slice(&solved);
            if options.start != Start::Steady {
                declared.iter().for_each(|&(at, value)| self.progress.y[at] = value);
                self.run_initial_states(options)?;
                given = self.given_following();
            }
            self.initial_discretes(options)?;
            self.settle_discretes(options)?;
            self.setup.freed.pairs.iter().for_each(|&(_, at)| self.progress.y[at] = states[at]);
            self.meet_conditions(options)?;
            let tolerance = 1e-6_f64.max(10.0 * self.setup.model().interface().solver.rtol);
            let moved = |old: &[f64], new: &[f64]| {
                let far = |(a, b): (&f64, &f64)| (a - b).abs() > tolerance * a.abs().max(b.abs());
                old.iter().zip(new).position(far)
            };
            let state = moved(&states, &self.progress.y[..first]);
            let discrete = moved(&discretes, self.system.region(Region::Discrete));
            if state.is_none() && discrete.is_none() {
                // What differs by rounding stays what the algebraic equations were solved for.
                self.progress.y[..first].copy_from_slice(&states);
                self.progress.y[first..].copy_from_slice(&solved);
                self.system.region_mut(Region::Discrete).copy_from_slice(&discretes);
                return Ok(given);
            }
            if passes_left == 0 {
                let families = [(&self.setup.catalogue.states, state), (&self.setup.catalogue.discretes, discrete)];
                let found = families.into_iter().find_map(|(f, at)| f.elements().iter().find(|e| Some(e.at) == at));
                let name = found.map_or_else(String::new, |e| format!(" of `{}`", e.name));
                let message = format!("the initial value{name} depends on an algebraic variable that depends on it");
                return Err(ResetError::Inconsistent { message, start: None });
            }
            self.make_consistent()?;
        }
        Ok(given)
    }

    fn initial_states(&mut self, options: &ResetOptions) -> Result<(), ResetError> {
        let setup = std::sync::Arc::clone(&self.setup);
        let states = &setup.catalogue.states;
        for element in states.elements().iter().chain(setup.catalogue.solved.elements()) {
            self.progress.y[element.at] = if element.default.is_finite() { element.default } else { 0.0 };
        }
        let rest = self.system.region(Region::Steady(FramePart::Y));
        if (setup.model().interface().steady.is_some() || options.start == Start::Steady) && rest.iter().all(|x| x.is_finite()) {
            // The algebraic part of the steady state is the best guess there is.
            let first = setup.model().states();
            let steady = self.system.region(Region::Steady(FramePart::Y));
            self.progress.y[first..].copy_from_slice(&steady[first..]);
        }
        if let StateInput::Named(named) = &options.state {
            let guesses = named.iter().filter_map(|(name, &value)| Some((setup.catalogue.solved.find(name)?.at, value)));
            guesses.for_each(|(at, value)| self.progress.y[at] = value);
        }
        self.run_initial_states(options)
    }

    fn run_initial_states(&mut self, options: &ResetOptions) -> Result<(), ResetError> {
        let setup = std::sync::Arc::clone(&self.setup);
        let states = &setup.catalogue.states;
        let (model, memory) = self.system.parts();
        if options.start == Start::Steady {
            self.progress.y.copy_from_slice(memory.region(Region::Steady(FramePart::Y)));
        } else {
            model.initial_states(memory, &mut self.progress.y);
        }
        for (name, &value) in &setup.options.initial {
            if let Some(state) = setup.catalogue.state(name) {
                self.progress.y[state.at] = value;
            }
        }
        match &options.state {
            StateInput::Start => {}
            StateInput::Named(named) => {
                finite(named, "state")?;
                for (name, &value) in named {
                    // A guess of an algebraic variable was taken before.
                    match setup.catalogue.state(name) {
                        Some(state) => self.progress.y[state.at] = value,
                        None if setup.catalogue.solved.find(name).is_some() => {}
                        None => {
                            states.get(name, "state")?;
                        }
                    }
                }
            }
            StateInput::Array(values) => {
                if values.len() != states.len() {
                    return Err(ResetError::Length { given: values.len(), expected: states.len() });
                }
                if let Some(at) = values.iter().position(|v| !v.is_finite()) {
                    return Err(ResetError::NotFinite { what: format!("state `{}`", states.elements()[at].name) });
                }
                for (element, &value) in states.elements().iter().zip(values) {
                    self.progress.y[element.at] = value;
                }
            }
        }
        Ok(())
    }

    /// Actions and builtins, and defaults of what start values may read before it has its own.
    fn initial_inputs(&mut self, options: &ResetOptions) {
        let setup = std::sync::Arc::clone(&self.setup);
        let catalogue = &setup.catalogue;
        let families = [
            (&catalogue.actions, Region::Action),
            (&catalogue.discretes, Region::Discrete),
            (&catalogue.disturbances, Region::Disturbance),
        ];
        for (family, region) in families {
            for element in family.elements() {
                let default = if region == Region::Action || element.default.is_finite() { element.default } else { 0.0 };
                self.system.region_mut(region)[element.at] = default;
            }
        }
        self.progress.steps = options.first_step;
        self.progress.event_time = None;
        for builtin in [Builtin::LastStep, Builtin::Failed, Builtin::ActionExcess] {
            self.set_builtin(builtin, 0.0);
        }
        let clock = self.time();
        self.set_builtin(Builtin::Steps, f64::from(options.first_step));
        self.set_builtin(Builtin::Clock, clock);
        self.set_builtin(Builtin::Begin, clock);
    }

    /// Start values of states that read discrete variables or disturbances, once these have theirs,
    /// as often as one such value needs another.
    fn settle_discretes(&mut self, options: &ResetOptions) -> Result<(), ResetError> {
        for passes_left in (0..self.setup.programs.discrete_passes).rev() {
            let first = self.setup.model().states();
            let before = (self.progress.y[..first].to_vec(), self.system.region(Region::Discrete).to_vec());
            if options.start != Start::Steady {
                self.run_initial_states(options)?;
            }
            self.initial_discretes(options)?;
            let same = |old: &[f64], new: &[f64]| old.iter().zip(new).all(|(a, b)| a == b || a.is_nan() && b.is_nan());
            if same(&before.0, &self.progress.y[..first]) && same(&before.1, self.system.region(Region::Discrete)) {
                return Ok(());
            }
            if passes_left == 0 {
                let message = "initial values of states and of discrete variables need each other".to_owned();
                return Err(ResetError::Inconsistent { message, start: None });
            }
        }
        Ok(())
    }

    /// Discrete variables.
    fn initial_discretes(&mut self, options: &ResetOptions) -> Result<(), ResetError> {
        let setup = std::sync::Arc::clone(&self.setup);
        let catalogue = &setup.catalogue;
        self.system.look_back(self.time(), &self.progress.y, &self.progress.yp);
        let (model, memory) = self.system.parts();
        model.initial_discretes(memory, &mut self.progress.y);
        for (name, &value) in &setup.options.initial {
            if let Some(discrete) = catalogue.discretes.find(name) {
                self.system.region_mut(Region::Discrete)[discrete.at] = value;
            }
        }
        finite(&options.discrete, "discrete variable")?;
        for (name, &value) in &options.discrete {
            let at = catalogue.discretes.get(name, "discrete variable")?.at;
            self.system.region_mut(Region::Discrete)[at] = value;
        }
        finite(&options.disturbed, "disturbance")?;
        for (name, &value) in &options.disturbed {
            let at = catalogue.disturbances.get(name, "disturbance")?.at;
            self.system.region_mut(Region::Disturbance)[at] = value;
        }
        self.check_phase()
    }

    /// Nothing would be in force in a phase that there is not.
    fn check_phase(&self) -> Result<(), ResetError> {
        let Some(at) = self.setup.phase else { return Ok(()) };
        let phases = self.setup.model().interface().phases.len();
        let value = self.discretes().get(at).copied().unwrap_or_default();
        let exists = value.fract() == 0.0 && value >= 1.0 && value <= phases as f64;
        if exists { Ok(()) } else { Err(ResetError::Phase { phases, value }) }
    }

    fn set_replay(&mut self, options: &ResetOptions) -> Result<(), ResetError> {
        let (setup, recorded) = (&self.setup, &options.disturbances);
        self.replay.clear();
        let standing = setup.options.disturbances.iter().filter(|(name, _)| !recorded.contains_key(*name));
        for (name, values) in standing.chain(recorded) {
            let at = setup.catalogue.disturbances.get(name, "disturbance")?.at;
            if values.is_empty() {
                return Err(ResetError::Empty { name: name.clone() });
            }
            if values.iter().any(|v| !v.is_finite()) {
                return Err(ResetError::NotFinite { what: format!("disturbance `{name}`") });
            }
            let asked_to_hold = match recorded.contains_key(name) {
                true => options.held.contains(name),
                false => values.len() == 1 || setup.options.held.contains(name),
            };
            self.replay.push(Replay {
                at,
                first: options.first_step,
                values: values.clone(),
                holds: options.hold_records || asked_to_hold,
                asked_to_hold,
            });
        }
        Ok(())
    }

    /// Algebraic unknowns and derivatives that belong to the initial states at the nominal action.
    pub(super) fn make_consistent(&mut self) -> Result<(), ResetError> {
        let t = self.time();
        let (model, memory) = self.system.parts();
        model.prepare_step(memory);
        let needed = model.unknowns() > model.states() || self.setup.programs.derivatives_at_end;
        self.progress.yp.fill(0.0);
        if needed {
            match self.integrator.restart(&mut self.system, t, &self.progress.y, None) {
                Ok(()) => self.take_state(),
                Err(SolveError::Interrupted { .. }) => return Err(ResetError::Interrupted),
                Err(error) => {
                    let failure: SolverFailure = super::interval::blame(&error, t);
                    let setup = &self.setup;
                    let message = describe_solver(&failure, setup.model(), &setup.catalogue, setup.sources());
                    self.solve_start(Sought::default(), None, &message)?;
                    match self.integrator.restart(&mut self.system, t, &self.progress.y, None) {
                        Ok(()) => self.take_state(),
                        Err(_) => return Err(ResetError::Inconsistent { message, start: None }),
                    }
                }
            }
        }
        self.system.keep(&self.progress.y, Region::Initial);
        self.system.keep(&self.progress.y, Region::Previous);
        // Caches may depend on the initial frame.
        let (model, memory) = self.system.parts();
        model.prepare_step(memory);
        if needed && self.integrator.restart(&mut self.system, t, &self.progress.y, Some(&self.progress.yp)).is_ok() {
            self.progress.yp.copy_from_slice(self.integrator.derivative());
        }
        Ok(())
    }

    /// States that conditions at the start determine, where these are not given.
    fn meet_conditions(&mut self, options: &ResetOptions) -> Result<(), ResetError> {
        if self.setup.freed.pairs.is_empty() || options.start == Start::Steady {
            return Ok(());
        }
        let setup = std::sync::Arc::clone(&self.setup);
        let at = |name: &String| setup.catalogue.states.find(name).map(|e| e.at);
        let mut given: BTreeSet<usize> = setup.options.initial.keys().chain(&setup.options.given_starts).filter_map(at).collect();
        match &options.state {
            StateInput::Start => {}
            StateInput::Named(named) => given.extend(named.keys().filter_map(at)),
            StateInput::Array(_) => return Ok(()),
        }
        let (states, conditions) = setup.freed.without(|at| given.contains(&at));
        if states.is_empty() {
            return Ok(());
        }
        let (model, memory) = self.system.parts();
        model.prepare_step(memory);
        for (of, read) in &setup.programs.initial_reads {
            let name = |at: usize| setup.catalogue.states.elements().iter().find(|e| e.at == at).map_or("", |e| e.name.as_str());
            let stale = of.clone().find(|at| !given.contains(at) && !states.contains(at));
            if let (Some(stale), Some(&freed)) = (stale, states.iter().find(|at| read.contains(at))) {
                let (of, freed) = (name(stale), name(freed));
                let message = format!(
                    "the declared value of `{of}` reads `{freed}`, which a condition at the start determines; \
                     write it as a condition, too: `initial eq {of} = ...`"
                );
                return Err(ResetError::Inconsistent { message, start: None });
            }
        }
        let given = self.setup.programs.discretes_read_unknowns.then(|| self.given_discretes(options));
        let sought = Sought { states: &states, conditions: &conditions };
        self.solve_start(sought, given.as_deref(), "the conditions at the start have no solution")
    }

    /// Discrete variables that are given, by their places.
    fn given_discretes(&self, options: &ResetOptions) -> Vec<(usize, f64)> {
        let discretes = &self.setup.catalogue.discretes;
        let all = self.setup.options.initial.iter().chain(&options.discrete);
        all.filter_map(|(name, &value)| Some((discretes.find(name)?.at, value))).collect()
    }

    /// Solves for the algebraic unknowns and for what is `sought` block by block; `message` says
    /// what failed before. With `discretes`, those that are given, the others follow.
    fn solve_start(&mut self, sought: Sought<'_>, discretes: Option<&[(usize, f64)]>, message: &str) -> Result<(), ResetError> {
        let setup = std::sync::Arc::clone(&self.setup);
        let context = start::Context { catalogue: &setup.catalogue, sources: setup.sources(), time: self.time(), discretes };
        match start::solve(&mut self.system, context, sought, &mut self.progress.y) {
            Ok(()) => Ok(()),
            Err(StartError::Interrupted) => Err(ResetError::Interrupted),
            Err(StartError::Block(failure)) => {
                Err(ResetError::Inconsistent { message: format!("{message}\n{failure}"), start: Some(failure) })
            }
        }
    }

    /// Parameters, states and discrete variables are numbers.
    pub(super) fn refuse_broken_start(&self) -> Result<(), ResetError> {
        let parameter = self.parameters().iter().position(|p| p.is_nan());
        let name = |at: usize| self.catalogue().parameters.elements().iter().find(|e| e.at == at).map(|e| e.name.as_str());
        if let Some(name) = parameter.and_then(name) {
            return Err(ResetError::NotFinite { what: format!("the parameter `{name}`") });
        }
        match self.broken_variable() {
            None => Ok(()),
            Some(broken) => {
                Err(ResetError::NotFinite { what: format!("{} at the start", broken.quantity(self.setup.model(), self.catalogue())) })
            }
        }
    }

    /// Looks for another solution where algebraic variables are outside of their bounds, and
    /// refuses the start where none is found, if the model and not the caller chooses the states.
    fn refuse_outside(&mut self) -> Result<(), ResetError> {
        let setup = std::sync::Arc::clone(&self.setup);
        let Some(bounds) = self.system.bounds() else { return Ok(()) };
        let algebraic: Vec<usize> = (setup.model().states()..setup.model().unknowns()).collect();
        let Some(at) = bounds.outside(&algebraic, &self.progress.y) else { return Ok(()) };
        let equation = describe_equation(at, setup.model(), &setup.catalogue, setup.sources());
        let element = setup.catalogue.solved.elements().iter().find(|element| element.at == at);
        let Some(outside) = element.and_then(|element| element.check_bounds(self.progress.y[at]).err()) else { return Ok(()) };
        let outside = OutsideBounds { value: Short(outside.value).to_string().parse().unwrap_or(outside.value), ..outside };
        let message = format!("{equation}, has no solution inside of the declared bounds that the search finds: {outside}");
        self.solve_start(Sought::default(), None, &message)?;
        self.make_consistent()
    }

    pub(super) fn first_observation(&mut self) -> Result<(), ResetError> {
        let progress = &mut self.progress;
        progress.verdict.rewards.fill(0.0);
        progress.verdict.violations.fill(0.0);
        progress.verdict.failing.fill(false);
        progress.verdict.sum = 0.0;
        progress.verdict.last = None;
        progress.verdict.solver_failure = None;
        progress.verdict.action_excess = 0.0;
        progress.edges.fill(Edge::default());
        progress.chatter = None;
        progress.not_finite = None;
        self.evaluate_finish(self.time());
        let values = self.finish.part(finish::FinishPart::Observations);
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            let name = &self.setup.model().interface().finish.observations[at].name;
            return Err(ResetError::NotFinite { what: format!("the observation `{name}` at the start") });
        }
        let errors = self.progress.errors();
        self.sensors.reset(&mut self.progress.readings, errors, values);
        Ok(())
    }
}

fn finite(values: &BTreeMap<String, f64>, kind: &str) -> Result<(), ResetError> {
    match values.iter().find(|(_, value)| !value.is_finite()) {
        Some((name, _)) => Err(ResetError::NotFinite { what: format!("{kind} `{name}`") }),
        None => Ok(()),
    }
}
