//! Shared data of all instances of an environment: the model, names, settings, the nominal steady
//! state.

use std::collections::{BTreeMap, HashSet};
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use smpl_compiler::artefact;
use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::ir::{Expr, Flavour, Place, Role, VarId};
use smpl_compiler::layout::{FramePart, Region};
use smpl_compiler::model::{Solver, Variate};
use smpl_dsl::diagnostic::SourceMap;

mod corrections;
mod options;
mod reads;
mod starts;

pub(crate) use self::corrections::Corrections;
pub use self::options::{EnvironmentOptions, SolverOverrides};
use self::reads::{
    algebraics_read_rates, any_expression, discrete_passes, discretes_read_unknowns, finish_reads_derivatives, initial_reads, reads,
    start_passes, step_reads_steady,
};
pub use self::starts::start_diagnostics;
use crate::catalogue::{Catalogue, Element, UnknownName};
use crate::parameters::{self, ParameterError};
use crate::random;
use crate::solver::{Integrator, Method, PatternError, Quadratures, Settings, SolveError, integrator};
use crate::start::{Conflict, Freed};
use crate::steady::{self, SteadyError};
use crate::system::CompiledSystem;

/// Reason why an environment cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    /// A name that the model does not have.
    #[error(transparent)]
    UnknownName(#[from] UnknownName),
    /// A value that a parameter cannot have.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// A value that is not finite.
    #[error("{what} must be {expected}, not {value}")]
    Value {
        /// Name of the setting.
        what: String,
        /// Expected value.
        expected: &'static str,
        /// Kind.
        value: String,
    },
    /// The Jacobian's pattern.
    #[error("pattern of the Jacobian: {0}")]
    Pattern(#[from] PatternError),
    /// The method does not take the model.
    #[error("{message}")]
    Method {
        /// Name of the unsupported part, and its replacement.
        message: String,
    },
    /// The solver refuses its settings or the system.
    #[error(transparent)]
    Solver(#[from] SolveError),
    /// The steady state that the model starts from was not found.
    #[error("steady state: {0}")]
    Steady(#[from] SteadyError),
    /// The conditions at the start determine too much.
    #[error(transparent)]
    Start(#[from] Conflict),
}

/// One stream of random numbers, ready to be drawn from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn {
    /// Place in the region of draws.
    pub at: usize,
    /// Hash of the stream's name.
    pub stream: u64,
    /// Number within the stream.
    pub element: u32,
    /// Distribution.
    pub kind: Variate,
    /// Drawn at every step, not at reset.
    pub each_step: bool,
}

impl Drawn {
    /// Mean of its distribution.
    pub(crate) fn mean(&self) -> f64 {
        match self.kind {
            Variate::Uniform => 0.5,
            Variate::Normal => 0.0,
        }
    }
}

/// Programs of a model, and the values they read.
pub(crate) struct Programs {
    pub has_start: bool,
    pub has_end: bool,
    pub has_disturbances: bool,
    /// `finish` or a test reads time derivatives, which then must be those of the final state.
    pub derivatives_at_end: bool,
    /// Most passes in which initial values that read what is known only at a consistent start get
    /// theirs.
    pub start_passes: usize,
    /// Most passes in which start values that read discrete variables or disturbances settle; 0
    /// without such values.
    pub discrete_passes: usize,
    /// States whose initial values read states: places of the former and of the latter in `y`.
    pub initial_reads: Vec<(Range<usize>, Range<usize>)>,
    /// Initial values of discrete variables read unknowns.
    pub discretes_read_unknowns: bool,
}

impl Programs {
    fn of(model: &CompiledModel) -> Self {
        let programs = &model.model().programs;
        Self {
            has_start: !programs.start.nests.is_empty(),
            has_end: !programs.end.nests.is_empty(),
            has_disturbances: !programs.disturb.nests.is_empty(),
            derivatives_at_end: finish_reads_derivatives(model) || !model.interface().tests.is_empty(),
            start_passes: start_passes(model),
            discrete_passes: discrete_passes(model),
            initial_reads: initial_reads(model),
            discretes_read_unknowns: discretes_read_unknowns(model),
        }
    }
}

/// Who reads the steady state.
pub(crate) struct Steady {
    /// Something in the model.
    pub needed: bool,
    /// A step, or what it is judged by.
    pub by_step: bool,
    /// Reason why there is no nominal one, where there should be one and nothing needs it.
    pub missing: Option<SteadyError>,
}

/// Shared data of all instances of an environment.
pub struct Setup {
    /// The compiled functions, with the parameters in force.
    pub system: CompiledSystem,
    /// Names and places.
    pub catalogue: Catalogue,
    /// Options that the environment was made with.
    pub options: EnvironmentOptions,
    /// Settings of the solver: declared ones with the options applied.
    pub settings: Settings,
    pub(crate) draws: Vec<Drawn>,
    /// Place of the chosen reward among the declared ones.
    pub reward: usize,
    pub(crate) max_steps: u32,
    /// Most events within one step.
    pub max_events: u32,
    retry: bool,
    pub(crate) programs: Programs,
    pub(crate) sources: Option<Arc<SourceMap>>,
    pub(crate) noise: Vec<f64>,
    /// Place of the number of the phase, where there is a schedule.
    pub phase: Option<usize>,
    pub(crate) steady: Steady,
    /// States that move to constraints by unknown corrections.
    pub(crate) corrections: Corrections,
    /// The states that conditions at the start determine.
    pub freed: Freed,
    /// Made when it is first asked for.
    checksum: OnceLock<Result<[u8; 32], String>>,
    /// Places and values of the parameters of the options.
    pub(crate) given: Vec<(usize, f64)>,
}

impl Setup {
    /// An integrator for instances.
    pub(crate) fn integrator(&self) -> Result<Box<dyn Integrator>, SolveError> {
        integrator(&self.system, self.settings.clone())
    }

    /// The implicit method that does not take the steps, if the model takes it and steps may be
    /// repeated.
    pub(crate) fn other_method(&self) -> Option<Method> {
        if !self.retry {
            return None;
        }
        let other = match self.settings.method {
            Method::Ida => Method::Rosenbrock,
            Method::Auto if !self.model().explicit() => Method::Rosenbrock,
            _ => Method::Ida,
        };
        check_method(self.model(), &self.catalogue, other).is_ok().then_some(other)
    }

    /// An integrator of the other implicit method.
    pub(crate) fn other_integrator(&self) -> Option<Box<dyn Integrator>> {
        let settings = Settings { method: self.other_method()?, ..self.settings.clone() };
        integrator(&self.system, settings).ok()
    }

    /// Prepares a model. `sources` are the texts that it was compiled from, for messages.
    ///
    /// # Errors
    /// Unknown names, values out of range, or no steady state where the model starts from one.
    pub fn new(model: Arc<CompiledModel>, options: EnvironmentOptions, sources: Option<Arc<SourceMap>>) -> Result<Arc<Self>, SetupError> {
        let needs_steady = reads(&model, Flavour::Steady);
        Self::make(model, options, sources, needs_steady)
    }

    /// As [`new`](Self::new), for callers that look for a steady state themselves: a missing steady
    /// state of the model is not an error.
    ///
    /// # Errors
    /// Unknown names, values out of range.
    pub fn without_steady(
        model: Arc<CompiledModel>,
        options: EnvironmentOptions,
        sources: Option<Arc<SourceMap>>,
    ) -> Result<Arc<Self>, SetupError> {
        Self::make(model, options, sources, false)
    }

    fn make(
        model: Arc<CompiledModel>,
        options: EnvironmentOptions,
        sources: Option<Arc<SourceMap>>,
        needs_steady: bool,
    ) -> Result<Arc<Self>, SetupError> {
        let catalogue = Catalogue::new(&model);
        let interface = model.interface();
        let asked = options.solver.over(&interface.solver);
        if let Some((what, expected, value)) = options.solver.bad_value() {
            return Err(SetupError::Value { what: what.into(), expected, value });
        }
        let mut settings = solver_settings(model.unknowns(), &catalogue, &asked);
        // Rates jump within their own tolerance where the order changes: a test of what follows
        // them would shorten steps without end.
        settings.algebraic_are_watched = model.algebraic_are_watched() && !algebraics_read_rates(&model);
        check_method(&model, &catalogue, settings.method)?;
        let reward = match &options.reward {
            None => interface.finish.default_reward as usize,
            Some(name) => interface
                .finish
                .rewards
                .iter()
                .position(|r| r.name == *name)
                .ok_or_else(|| UnknownName::new("reward", name, interface.finish.rewards.iter().map(|r| r.name.as_str())))?,
        };
        let noise = noise(&model, &options)?;
        check_names(&catalogue, &options)?;
        let max_steps = options.max_steps.unwrap_or(interface.episode.max_steps);
        if max_steps == 0 {
            return Err(SetupError::Value { what: "max_steps".into(), expected: "at least 1", value: "0".into() });
        }
        let has_phases = !interface.phases.is_empty();
        let mut system = CompiledSystem::new(model.clone())?;
        let mut setup = Self {
            settings,
            freed: Freed::choose(&mut system, &catalogue, sources.as_deref())?,
            draws: draws(&model),
            reward,
            max_steps,
            max_events: asked.max_events,
            retry: asked.retry,
            programs: Programs::of(&model),
            sources,
            noise,
            corrections: Corrections::of(&model, &catalogue),
            phase: catalogue.discretes.find("phase").filter(|_| has_phases).map(|e| e.at),
            checksum: OnceLock::new(),
            given: Vec::new(),
            steady: Steady { needed: needs_steady, by_step: step_reads_steady(&model), missing: None },
            catalogue,
            options,
            system,
        };
        setup.prepare_nominal(needs_steady)?;
        if !setup.freed.pairs.is_empty() {
            let guess = steady::guess(&setup.system, &setup.catalogue);
            let mut system = setup.system.clone();
            setup.freed = std::mem::take(&mut setup.freed).by_numbers(&mut system, &setup.catalogue, guess);
        }
        Ok(Arc::new(setup))
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Arc<CompiledModel> {
        self.system.model()
    }

    /// Time limit in steps.
    #[must_use]
    pub fn max_steps(&self) -> u32 {
        self.max_steps
    }

    /// Hash of the model and its scenario, which identifies the model of a snapshot. Which reward
    /// is dense and how long an episode is may differ.
    ///
    /// # Errors
    /// In words, if the model cannot be encoded.
    pub fn checksum(&self) -> Result<[u8; 32], String> {
        let compute = || {
            let model = self.model().checksum().map_err(|e| e.to_string())?;
            let options = EnvironmentOptions { sparse: false, max_steps: None, ..self.options.clone() };
            Ok(artefact::fingerprint(&[&format!("{options:?}")], &model))
        };
        self.checksum.get_or_init(compute).clone()
    }

    /// The parameters that are drawn at a reset, or computed from such.
    #[must_use]
    pub fn drawn_parameters(&self) -> Vec<&Element> {
        let model = self.model().model();
        let mut drawn: HashSet<VarId> = HashSet::new();
        for store in model.programs.parameters.nests.iter().flat_map(|nest| &nest.stores) {
            let Place::Var(target) = store.target.place else { continue };
            let is_drawn =
                |expr: &Expr| matches!(expr, Expr::Load { var, .. } if model.vars[*var].role == Role::Draw || drawn.contains(var));
            if any_expression(&model.exprs, vec![store.value], is_drawn) {
                drawn.insert(target);
            }
        }
        let places: HashSet<usize> = drawn
            .iter()
            .filter_map(|&var| Some((self.model().offset(var)?, model.vars[var].len as usize)))
            .flat_map(|(first, len)| first..first + len)
            .collect();
        self.catalogue.parameters.elements().iter().filter(|element| places.contains(&element.at)).collect()
    }

    /// All parameters, at their means where they are drawn.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        self.system.region(Region::Param)
    }

    /// The texts that the model was compiled from.
    #[must_use]
    pub fn sources(&self) -> Option<&SourceMap> {
        self.sources.as_deref()
    }

    /// The steady state that belongs to parameters at their means: unknowns in the order of `y`.
    #[must_use]
    pub fn steady_state(&self) -> &[f64] {
        self.system.region(Region::Steady(FramePart::Y))
    }

    /// The actions of that steady state.
    #[must_use]
    pub fn steady_action(&self) -> &[f64] {
        self.system.region(Region::Steady(FramePart::Action))
    }

    /// Reason why the model has no steady state with parameters at their means although it declares
    /// one.
    #[must_use]
    pub fn no_steady(&self) -> Option<&SteadyError> {
        self.steady.missing.as_ref()
    }

    /// Parameters at their means with the given ones in place, and their steady state.
    fn prepare_nominal(&mut self, needs_steady: bool) -> Result<(), SetupError> {
        let draws = self.draws.clone();
        self.given = self.resolve(&self.options.parameters)?;
        fill_means(&mut self.system, &draws);
        set_parameters(&mut self.system, &self.given);
        parameters::check_computed(&self.catalogue.parameters, &self.system)?;
        if self.model().interface().steady.is_some() {
            let guess = steady::guess(&self.system, &self.catalogue);
            let before = self.system.clone();
            if let Err(error) = steady::solve_declared(&mut self.system, &self.catalogue, &guess) {
                if needs_steady {
                    return Err(error.into());
                }
                self.system = before;
                steady::forget(&mut self.system);
                self.steady.missing = Some(error);
            }
        }
        Ok(())
    }

    /// Places and values of parameters that are given by name.
    pub(crate) fn resolve(&self, values: &BTreeMap<String, f64>) -> Result<Vec<(usize, f64)>, ParameterError> {
        let resolved = parameters::resolve(self.model(), &self.catalogue.parameters, &parameters::by_name(values))?;
        Ok(resolved.into_iter().map(|(element, value)| (element.at, value)).collect())
    }
}

/// Puts every random number at its mean.
pub(crate) fn fill_means(system: &mut CompiledSystem, draws: &[Drawn]) {
    let region = system.region_mut(Region::Draw);
    for draw in draws {
        region[draw.at] = draw.mean();
    }
}

/// Sets the given parameters, computes the others, and prepares what depends on them.
pub(crate) fn set_parameters(system: &mut CompiledSystem, given: &[(usize, f64)]) {
    for &(at, value) in given {
        system.region_mut(Region::Param)[at] = value;
        system.region_mut(Region::ParamGiven)[at] = 1.0;
    }
    let (model, memory) = system.parts();
    model.parameters(memory);
    model.prepare_parameters(memory);
}

fn solver_settings(unknowns: usize, catalogue: &Catalogue, asked: &Solver) -> Settings {
    let (rtol, factor) = (asked.safety * asked.rtol, asked.atol_factor);
    let mut atol = vec![factor * rtol; unknowns];
    for element in catalogue.states.elements().iter().chain(catalogue.solved.elements()) {
        if element.scale.is_finite() && element.scale > 0.0 {
            atol[element.at] = factor * rtol * element.scale;
        }
    }
    let mut settings = Settings::new(rtol, atol);
    settings.one_step_factor = asked.one_step_factor();
    settings.max_order = asked.max_order;
    settings.max_steps = asked.max_steps;
    settings.linear_solver = asked.linear_solver;
    settings.method = asked.method;
    settings.max_step = asked.max_step;
    settings.algebraic_error_control = asked.algebraic_error_control;
    if asked.quadrature_error_control {
        settings.quadratures = Quadratures::Checked { rtol, atol: factor * rtol };
    }
    settings
}

/// A method that does not take the model is refused with the name of what it does not take.
fn check_method(model: &CompiledModel, catalogue: &Catalogue, method: Method) -> Result<(), SetupError> {
    let algebraic = catalogue.solved.names().next();
    let message = match method {
        Method::Rosenbrock | Method::Explicit if !model.explicit() => format!(
            "method `{method}` takes models only whose rates are given explicitly, and here they follow from equations that are solved together: use `ida`"
        ),
        Method::Explicit if model.unknowns() > model.states() => format!(
            "method `explicit` takes ordinary differential equations only, and `{}` is an algebraic variable that is solved for: \
             use `rosenbrock`, `auto` or `ida`",
            algebraic.unwrap_or("a variable")
        ),
        _ => return Ok(()),
    };
    Err(SetupError::Method { message })
}

/// Integration method by its name on the command line or in Python.
///
/// # Errors
/// If the name is unknown.
pub fn method(name: &str) -> Result<Method, SetupError> {
    let unknown = || SetupError::Value { what: "method".into(), expected: Method::TEXT, value: format!("`{name}`") };
    Method::from_name(name).ok_or_else(unknown)
}

fn noise(model: &CompiledModel, options: &EnvironmentOptions) -> Result<Vec<f64>, SetupError> {
    let observations = &model.interface().finish.observations;
    let mut noise: Vec<f64> = observations.iter().map(|o| o.noise).collect();
    for (name, &deviation) in &options.noise {
        let at = observations
            .iter()
            .position(|o| o.name == *name)
            .ok_or_else(|| UnknownName::new("observation", name, observations.iter().map(|o| o.name.as_str())))?;
        if !(deviation.is_finite() && deviation >= 0.0) {
            return Err(SetupError::Value {
                what: format!("noise of {name}"),
                expected: "a standard deviation",
                value: deviation.to_string(),
            });
        }
        noise[at] = deviation;
    }
    Ok(noise)
}

fn check_names(catalogue: &Catalogue, options: &EnvironmentOptions) -> Result<(), UnknownName> {
    for name in options.disturbances.keys() {
        catalogue.disturbances.get(name, "disturbance")?;
    }
    for name in options.initial.keys() {
        if catalogue.discretes.find(name).is_none() && catalogue.state(name).is_none() {
            catalogue.states.get(name, "state or discrete variable")?;
        }
    }
    Ok(())
}

fn draws(model: &CompiledModel) -> Vec<Drawn> {
    use smpl_compiler::model::Instant;
    let mut counts: BTreeMap<&str, u32> = BTreeMap::new();
    let number = |(at, draw): (usize, &'_ smpl_compiler::model::Draw), element| Drawn {
        at,
        stream: random::hash(&draw.stream),
        element,
        kind: draw.kind,
        each_step: draw.instant == Instant::Step,
    };
    let draws = model.interface().draws.iter().enumerate();
    draws
        .map(|(at, draw)| {
            let count = counts.entry(draw.stream.as_str()).or_default();
            let element = *count;
            *count += 1;
            number((at, draw), element)
        })
        .collect()
}
