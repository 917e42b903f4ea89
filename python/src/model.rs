//! Class `Model`: a compiled model.

use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap};
use std::num::NonZeroU32;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArrayDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::PyBytes;
use smpl_compiler::export::{ExportError, Target};
use smpl_compiler::model::{Instant, Port, PortMember, Variate};
use smpl_dsl::span::FileId;
use smpl_runtime::catalogue::{self, Catalogue, Element};
use smpl_runtime::parameters;
use smpl_runtime::rollout::Rollouts;
use smpl_runtime::rules::Rules;
use smpl_runtime::sensitivity::Sensitivities;
use smpl_runtime::setup::{self, EnvironmentOptions, Setup};
use smpl_runtime::solver::Method;
use smpl_tools::export::{ExportFault, export, export_fmu};

use crate::arrays::Fresh;
use crate::equations::{Equations, Given};
use crate::errors::{Diagnostic, guarded, setup_error};
use crate::interrupt::released;
use crate::load::{self, Loaded};
use crate::role::Role;
use crate::rollout::{Request, Results, Start, rollout_error};
use crate::{rules, sensitivity};

type Vector<'py> = Bound<'py, PyArray1<f64>>;
type Matrix<'py> = Bound<'py, PyArray2<f64>>;
type Indices<'py> = Bound<'py, PyArray1<i32>>;
type Input<'py> = PyReadonlyArray1<'py, f64>;
/// A, B, C, D, and the states that are coordinates with all states by these.
type Linearized<'py> = (Matrix<'py>, Matrix<'py>, Matrix<'py>, Matrix<'py>, Option<(Vec<usize>, Matrix<'py>)>);

/// By dense reward, time limit and method.
type Setups = HashMap<(bool, Option<u32>, Option<Method>), Arc<Setup>>;

/// Settings of trajectories: threads, time limit, method.
type Run = (usize, Option<u32>, Option<String>);

/// A member of a port: its name, the names of its numbers, the quantity that it equals.
type Member = (String, Vec<String>, Option<String>);

/// A compiled model.
#[pyclass(frozen, module = "smpl._native")]
pub struct Model {
    loaded: Loaded,
    /// Made when names are first asked for: a model may have a hundred thousand of them.
    catalogue: OnceLock<Catalogue>,
    /// Made at the first evaluation.
    equations: Mutex<Option<Equations>>,
    /// Shared data of environments.
    setups: Mutex<Setups>,
    /// Environments of rollouts, by number of threads, time limit and method.
    rollouts: Mutex<HashMap<Run, Rollouts>>,
    /// Instance for the rules of disturbances, made when it is needed.
    rules: Mutex<Option<Rules>>,
    /// Cache of the last computation of derivatives.
    sensitivities: Mutex<Vec<(sensitivity::Key, Sensitivities)>>,
}

/// Kept of what computes derivatives.
const KEPT: usize = 4;

#[pymethods]
impl Model {
    #[new]
    #[pyo3(signature = (path, source, scenario, variants, settings, observation, reward, extra=None))]
    #[expect(clippy::too_many_arguments, reason = "the arguments of the Python class, one by one")]
    fn new(
        py: Python<'_>,
        path: Option<String>,
        source: Option<String>,
        scenario: Option<String>,
        variants: Vec<String>,
        settings: BTreeMap<String, String>,
        observation: &str,
        reward: Option<String>,
        extra: Option<String>,
    ) -> PyResult<Self> {
        let level = (observation != "default").then(|| observation.to_owned());
        let request = load::Request { path, source, scenario, variants, settings, level, reward, extra };
        let loaded = load::load(py, request)?;
        Ok(Self {
            catalogue: OnceLock::new(),
            loaded,
            equations: Mutex::new(None),
            setups: Mutex::new(HashMap::new()),
            rollouts: Mutex::new(HashMap::new()),
            rules: Mutex::new(None),
            sensitivities: Mutex::new(Vec::new()),
        })
    }

    #[getter]
    fn name(&self) -> &str {
        &self.loaded.model.interface().name
    }

    #[getter]
    fn text(&self) -> &str {
        &self.loaded.model.interface().text
    }

    #[getter]
    fn time_name(&self) -> &str {
        &self.loaded.model.interface().time.name
    }

    #[getter]
    fn time_unit(&self) -> &str {
        &self.loaded.model.interface().time.unit
    }

    #[getter]
    fn explicit(&self) -> bool {
        self.loaded.model.explicit()
    }

    /// The calls of `delay` that the model reads.
    #[getter]
    fn delays(&self) -> Vec<String> {
        self.loaded.model.model().delays.iter().map(|delay| delay.name.clone()).collect()
    }

    /// States that the end of a step projects to constraints and does not set otherwise.
    #[getter]
    fn projected(&self) -> Vec<String> {
        let all = self.loaded.model.interface().reduction.projected.iter();
        all.filter(|one| !one.set).flat_map(|one| one.states.iter().cloned()).collect()
    }

    #[getter]
    fn unknowns(&self) -> usize {
        self.loaded.model.unknowns()
    }

    #[getter]
    fn states(&self) -> usize {
        self.loaded.model.states()
    }

    #[getter]
    fn nonzeros(&self) -> usize {
        self.loaded.model.pattern().row_indices.len()
    }

    /// Names of the texts that it was compiled from: files, and what settings and scenarios say.
    #[getter]
    fn sources(&self) -> Vec<String> {
        let sources = &self.loaded.sources;
        (0..sources.len()).map(|i| sources.name(FileId(i as u16)).to_owned()).collect()
    }

    /// Warnings of the compiler.
    #[getter]
    fn warnings(&self) -> Vec<Diagnostic> {
        load::warnings(&self.loaded)
    }

    /// The chosen reward.
    #[getter]
    fn reward(&self) -> String {
        let interface = self.loaded.model.interface();
        let default = interface.finish.rewards.get(interface.finish.default_reward as usize).map(|r| r.name.clone());
        self.loaded.options.reward.clone().or(default).unwrap_or_default()
    }

    /// The chosen observation level.
    #[getter]
    fn level(&self) -> &str {
        &self.loaded.level
    }

    /// Sensors of the level, in the order of its observations: standard deviation of the noise,
    /// steps between samples, steps of delay.
    #[getter]
    fn sensors(&self) -> Vec<(f64, u32, u32)> {
        let observations = &self.loaded.model.interface().finish.observations;
        observations.iter().map(|o| (o.noise, o.every, o.delay)).collect()
    }

    #[getter]
    fn levels(&self) -> Vec<String> {
        self.loaded.model.interface().alternatives.levels.clone()
    }

    /// Names of the phases of the schedule, in their order.
    #[getter]
    fn phases(&self) -> Vec<String> {
        self.loaded.model.interface().phases.clone()
    }

    /// Ports of components: path, connector, and of each member its name, the names of its numbers
    /// among the algebraic outputs and the quantity that it equals.
    #[getter]
    fn ports(&self) -> Vec<(String, String, Vec<Member>)> {
        let interface = self.loaded.model.interface();
        let elements = |output: &str| {
            let quantity = interface.quantities.algebraics.iter().find(|q| q.name == output);
            quantity.map_or_else(Vec::new, |q| (0..q.len()).map(|element| q.element_name(element)).collect())
        };
        let member = |m: &PortMember| (m.name.clone(), elements(&m.output), m.equals.clone());
        let port = |port: &Port| (port.name.clone(), port.connector.clone(), port.members.iter().map(member).collect());
        interface.ports.iter().map(port).collect()
    }

    /// Names of the open-loop policies.
    #[getter]
    fn policies(&self) -> Vec<String> {
        self.loaded.model.model().programs.policies.iter().map(|(name, _)| name.clone()).collect()
    }

    /// Returns `true` if a policy is a function of the step, the time and the parameters alone.
    fn is_recipe(&self, policy: &str) -> PyResult<bool> {
        let model = self.loaded.model.model();
        let (_, program) = &model.programs.policies[policy_index(model, policy)?];
        Ok(model.is_of_the_step_alone(program))
    }

    #[getter]
    fn step(&self) -> f64 {
        self.loaded.model.interface().episode.step
    }

    #[getter]
    fn max_steps(&self) -> u32 {
        self.loaded.options.max_steps.unwrap_or(self.loaded.model.interface().episode.max_steps)
    }

    /// Flattened names of a role.
    fn names(&self, role: &str) -> PyResult<Vec<String>> {
        let interface = self.loaded.model.interface();
        match role {
            "observation" => Ok(interface.finish.observations.iter().map(|o| o.name.clone()).collect()),
            "reward" => Ok(interface.finish.rewards.iter().map(|r| r.name.clone()).collect()),
            "measured" => Ok(interface.measured.clone()),
            _ => Ok(self.elements(Role::of(role)?).iter().map(|e| e.name.clone()).collect()),
        }
    }

    /// Flattened names of the elements of a parameter: of a whole array by its name, or that of one
    /// of them.
    fn elements_of(&self, parameter: &str) -> Vec<String> {
        let elements = catalogue::elements_of(&self.loaded.model, &self.catalogue().parameters, parameter);
        elements.iter().map(|element| element.name.clone()).collect()
    }

    /// Elements of parameters that names determine, an element over its array: name of the element,
    /// number of the name, and place in the array of that name.
    fn determined(&self, names: Vec<String>) -> PyResult<Vec<(String, usize, usize)>> {
        let known = &self.catalogue().parameters;
        let names: Vec<_> = names.iter().map(|name| (0, name.as_str())).collect();
        let found = parameters::determined(&self.loaded.model, known, &names);
        let found = found.map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(found.into_iter().map(|(at, (name, place))| (known.elements()[at].name.clone(), name, place)).collect())
    }

    /// Units of a role.
    fn units(&self, role: &str) -> PyResult<Vec<String>> {
        let interface = self.loaded.model.interface();
        match role {
            "observation" => Ok(interface.finish.observations.iter().map(|o| o.unit.clone()).collect()),
            "reward" => Ok(interface.finish.rewards.iter().map(|r| r.unit.clone()).collect()),
            _ => Ok(self.elements(Role::of(role)?).iter().map(|e| e.unit.clone()).collect()),
        }
    }

    /// The files of an export as (ending, text), the main one first.
    #[pyo3(signature = (target, stem=None, history=None))]
    fn export(
        &self,
        py: Python<'_>,
        target: &str,
        stem: Option<&str>,
        history: Option<NonZeroU32>,
    ) -> PyResult<Vec<(&'static str, String)>> {
        let target: Target = target.parse().map_err(|e: ExportError| PyValueError::new_err(e.to_string()))?;
        let files = released(py, || export(&self.loaded, target, stem, history))?.map_err(export_error)?;
        Ok(files.into_iter().map(|file| (file.ending, file.text)).collect())
    }

    /// The bytes of an FMU, and why it has no binary if it has none.
    #[pyo3(signature = (binary, history=None))]
    fn fmu<'py>(&self, py: Python<'py>, binary: bool, history: Option<NonZeroU32>) -> PyResult<(Bound<'py, PyBytes>, Option<String>)> {
        let fmu = released(py, || export_fmu(&self.loaded, binary, history))?.map_err(export_error)?;
        Ok((PyBytes::new(py, &fmu.bytes), fmu.without_binary))
    }

    /// Lower and upper bounds of a role.
    fn bounds<'py>(&self, py: Python<'py>, role: &str) -> PyResult<(Vector<'py>, Vector<'py>)> {
        let (low, high): (Vec<f64>, Vec<f64>) = if role == "observation" {
            self.loaded.model.interface().finish.observations.iter().map(|o| (o.low, o.high)).unzip()
        } else {
            self.elements(Role::of(role)?).iter().map(|e| (e.low, e.high)).unzip()
        };
        Ok((PyArray1::from_vec(py, low), PyArray1::from_vec(py, high)))
    }

    /// Default, nominal or initial values of a role.
    fn defaults<'py>(&self, py: Python<'py>, role: Role) -> Vector<'py> {
        PyArray1::from_iter(py, self.elements(role).iter().map(|e| e.default))
    }

    /// Residual at a point.
    fn residual<'py>(&self, py: Python<'py>, t: f64, y: Input<'py>, yp: Input<'py>, u: Input<'py>, given: Given) -> PyResult<Vector<'py>> {
        let (y, yp, u) = (y.as_slice()?, yp.as_slice()?, u.as_slice()?);
        let mut out = Fresh::vector(py, y.len());
        self.evaluate(py, |equations| equations.residual(t, y, yp, u, &given, out.elements()))?;
        Ok(out.done())
    }

    /// Values, rows and column pointers of the Jacobian at a point.
    #[expect(clippy::too_many_arguments, reason = "the arguments of the mathematical function")]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        t: f64,
        y: Input<'py>,
        yp: Input<'py>,
        u: Input<'py>,
        cj: f64,
        given: Given,
    ) -> PyResult<(Vector<'py>, Indices<'py>, Indices<'py>)> {
        let (y, yp, u) = (y.as_slice()?, yp.as_slice()?, u.as_slice()?);
        let (values, rows, pointers) = self.evaluate(py, |equations| equations.jacobian(t, y, yp, u, cj, &given))?;
        Ok((PyArray1::from_vec(py, values), PyArray1::from_vec(py, rows), PyArray1::from_vec(py, pointers)))
    }

    /// Seconds of one residual and of one Jacobian at a point, without the way from Python and
    /// back: for benchmarks.
    fn evaluation_times(&self, py: Python<'_>, t: f64, y: Input<'_>, u: Input<'_>, cj: f64) -> PyResult<(f64, f64)> {
        let (y, u) = (y.as_slice()?, u.as_slice()?);
        self.evaluate(py, |equations| equations.times(t, y, u, cj))
    }

    /// Rates of the states of an explicit model.
    fn rhs<'py>(&self, py: Python<'py>, t: f64, y: Input<'py>, u: Input<'py>, given: Given) -> PyResult<Vector<'py>> {
        let (y, u) = (y.as_slice()?, u.as_slice()?);
        let mut out = Fresh::vector(py, self.states());
        self.evaluate(py, |equations| equations.rhs(t, y, u, &given, out.elements()))?;
        Ok(out.done())
    }

    /// Steady state with some unknowns given and as many actions found; unknowns and actions.
    #[allow(clippy::too_many_arguments, reason = "they are the arguments of the Python method")]
    fn trim<'py>(
        &self,
        py: Python<'py>,
        u: Input<'py>,
        given: Given,
        fixed: Vec<(usize, f64)>,
        free: Vec<usize>,
        guess: Vec<(usize, f64)>,
    ) -> PyResult<(Vector<'py>, Vector<'py>)> {
        let u = u.as_slice()?;
        let (y, u) = self.evaluate(py, |equations| released(py, || equations.trim(u, &given, &fixed, free, &guess))?)?;
        Ok((PyArray1::from_vec(py, y), PyArray1::from_vec(py, u)))
    }

    /// Steady state at given actions.
    fn steady_state<'py>(
        &self,
        py: Python<'py>,
        u: Input<'py>,
        given: Given,
        fixed: Vec<(usize, f64)>,
        guess: Vec<(usize, f64)>,
    ) -> PyResult<Vector<'py>> {
        let u = u.as_slice()?;
        let y = self.evaluate(py, |equations| released(py, || equations.steady_state(u, &given, &fixed, &guess))?)?;
        Ok(PyArray1::from_vec(py, y))
    }

    /// Trajectories from states or from a snapshot; `size` is (trajectories, steps), `options`
    /// (seed, first step, with outputs, instants, history), `run` (threads, time limit, method).
    #[expect(clippy::too_many_arguments, reason = "the arguments of the Python method, one by one")]
    fn rollout<'py>(
        &self,
        py: Python<'py>,
        start: Start<'py>,
        actions: PyReadonlyArrayDyn<'py, f64>,
        parameters: Vec<(String, PyReadonlyArrayDyn<'py, f64>)>,
        discrete: Vec<(String, PyReadonlyArrayDyn<'py, f64>)>,
        disturbances: Vec<(String, PyReadonlyArrayDyn<'py, f64>)>,
        size: (usize, usize),
        options: crate::rollout::Options,
        run: Run,
    ) -> PyResult<Results<'py>> {
        let request = Request::new(&start, &actions, [&parameters, &discrete, &disturbances], size, options);
        drop((start, actions, parameters, discrete, disturbances));
        let (threads, max_steps, ref method) = run;
        let setup = self.setup(py, true, max_steps, method.as_deref())?;
        let mut all = self.rollouts.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        let rollouts = match all.entry(run) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => place.insert(guarded(|| Rollouts::new(&setup, threads))?.map_err(|e| rollout_error(&e))?),
        };
        request.run(py, rollouts)
    }

    /// Steps from states with their derivatives; `size` is (points, steps that count as completed,
    /// steps from each).
    #[expect(clippy::too_many_arguments, reason = "the arguments of the Python method, one by one")]
    fn sensitivity<'py>(
        &self,
        py: Python<'py>,
        states: PyReadonlyArrayDyn<'py, f64>,
        actions: PyReadonlyArrayDyn<'py, f64>,
        parameters: Vec<(String, PyReadonlyArrayDyn<'py, f64>)>,
        discrete: Vec<(String, PyReadonlyArrayDyn<'py, f64>)>,
        disturbances: Vec<(String, PyReadonlyArrayDyn<'py, f64>)>,
        size: (usize, u32, usize),
        key: sensitivity::Key,
    ) -> PyResult<sensitivity::Results<'py>> {
        let request = sensitivity::Request::new(&states, &actions, [&parameters, &discrete, &disturbances], size);
        drop((states, actions, parameters, discrete, disturbances));
        let setup = self.setup(py, true, key.2, key.3.as_deref())?;
        let mut all = self.sensitivities.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        let known = match all.iter().position(|(other, _)| *other == key) {
            Some(at) => all.remove(at),
            None => {
                let made = sensitivity::make(&key, &setup)?;
                (key, made)
            }
        };
        all.truncate(KEPT - 1);
        all.insert(0, known);
        request.run(py, &setup, &mut all[0].1)
    }

    /// Values of the disturbances for the next step by their rules, and measurements, at points.
    fn disturbed<'py>(
        &self,
        py: Python<'py>,
        points: rules::Points<'py>,
        parameters: rules::Named<'py>,
        discrete: rules::Named<'py>,
        first_step: u32,
    ) -> PyResult<rules::Results<'py>> {
        let setup = self.setup(py, true, None, None)?;
        let mut kept = self.rules.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        let made = match kept.take() {
            Some(rules) => rules,
            None => guarded(|| Rules::new(setup))?.map_err(|e| setup_error(&e))?,
        };
        rules::run(py, kept.insert(made), &points, [parameters, discrete], first_step)
    }

    /// The random numbers of the model: names, flags for standard normal numbers (others are
    /// uniform in [0, 1]), and flags for numbers drawn at every step (others at a reset).
    fn draws(&self, py: Python<'_>) -> PyResult<Vec<(String, bool, bool)>> {
        let setup = self.setup(py, true, None, None)?;
        let draws = Rules::draws(&setup).iter();
        Ok(draws.map(|draw| (draw.stream.clone(), draw.kind == Variate::Normal, draw.instant == Instant::Step)).collect())
    }

    /// Names of all limits, in the order of violations.
    #[getter]
    fn constraint_names(&self) -> Vec<String> {
        let interface = self.loaded.model.interface();
        smpl_runtime::environment::constraint_names(interface).map(str::to_owned).collect()
    }

    /// Returns `true` if an equation reads `initial(...)`, `previous(...)` or `steady(...)`.
    fn reads_other_instants(&self, py: Python<'_>) -> PyResult<bool> {
        self.evaluate(py, |equations| Ok(equations.reads_other_instants()))
    }

    /// A, B, C, D at a point; with `minimal` in free coordinates. Where constraints leave fewer of
    /// these than states: also the states that are coordinates, and all states by these.
    fn linearize<'py>(&self, py: Python<'py>, y: Input<'py>, u: Input<'py>, given: Given, minimal: bool) -> PyResult<Linearized<'py>> {
        let (y, u) = (y.as_slice()?, u.as_slice()?);
        let found = self.evaluate(py, |equations| equations.linearize(y, u, &given))?;
        let found = if minimal { found.minimal() } else { found };
        let matrix = |(rows, columns): (usize, usize), get: &dyn Fn(usize, usize) -> f64| {
            Fresh::matrix(py, rows, columns).filled(|out| {
                for (i, out) in out.iter_mut().enumerate() {
                    *out = get(i / columns, i % columns);
                }
            })
        };
        let free = found.free.as_ref();
        Ok((
            matrix(found.a.shape(), &|i, j| found.a[(i, j)]),
            matrix(found.b.shape(), &|i, j| found.b[(i, j)]),
            matrix(found.c.shape(), &|i, j| found.c[(i, j)]),
            matrix(found.d.shape(), &|i, j| found.d[(i, j)]),
            free.map(|free| (free.coordinates.clone(), matrix(free.states.shape(), &|i, j| free.states[(i, j)]))),
        ))
    }
}

impl Model {
    /// Data shared by environments of this model.
    ///
    /// # Errors
    /// Settings out of range, a method that does not take the model, or no steady state where the
    /// model starts from one.
    pub fn setup(&self, py: Python<'_>, dense_reward: bool, max_steps: Option<u32>, method: Option<&str>) -> PyResult<Arc<Setup>> {
        let method = method.map(setup::method).transpose().map_err(|e| setup_error(&e))?;
        let key = (dense_reward, max_steps, method);
        let mut setups = self.setups.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        if let Some(setup) = setups.get(&key) {
            return Ok(setup.clone());
        }
        let base = self.loaded.options.clone();
        let max = max_steps.or(base.max_steps);
        let mut options = EnvironmentOptions { sparse: !dense_reward, max_steps: max, ..base };
        options.solver.method = method.or(options.solver.method);
        let (model, sources) = (self.loaded.model.clone(), Some(self.loaded.sources.clone()));
        let setup = released(py, || Setup::new(model, options, sources))?.map_err(|e| setup_error(&e))?;
        setups.insert(key, setup.clone());
        Ok(setup)
    }

    /// Runs `work` on the equations; a panic in it becomes an exception.
    fn evaluate<T>(&self, py: Python<'_>, work: impl FnOnce(&mut Equations) -> PyResult<T>) -> PyResult<T> {
        let mut equations = self.equations.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        if equations.is_none() {
            let parameters = self.given_parameters();
            *equations = Some(released(py, || Equations::new(&self.loaded.model, &parameters))??);
        }
        match equations.as_mut() {
            Some(equations) => guarded(|| work(equations))?,
            None => Err(PyValueError::new_err("the model has no equations")),
        }
    }

    fn catalogue(&self) -> &Catalogue {
        self.catalogue.get_or_init(|| Catalogue::new(&self.loaded.model))
    }

    /// Parameters of the scenario and the settings, by place.
    fn given_parameters(&self) -> Vec<(usize, f64)> {
        let parameters = &self.loaded.options.parameters;
        parameters.iter().filter_map(|(name, &v)| Some((self.catalogue().parameters.find(name)?.at, v))).collect()
    }

    fn elements(&self, role: Role) -> &[Element] {
        role.family(self.catalogue()).elements()
    }
}

/// The exception of a model that is not exported.
fn export_error(fault: ExportFault) -> PyErr {
    match fault {
        ExportFault::Setup(error) => setup_error(&error),
        ExportFault::Export(error) => PyValueError::new_err(error.to_string()),
    }
}

/// Position of a policy of the model.
///
/// # Errors
/// `ValueError` if the name is unknown.
pub(crate) fn policy_index(model: &smpl_compiler::model::Model, name: &str) -> PyResult<usize> {
    let policies = &model.programs.policies;
    policies.iter().position(|(known, _)| known == name).ok_or_else(|| {
        let known: Vec<&str> = policies.iter().map(|(known, _)| known.as_str()).collect();
        PyValueError::new_err(format!("unknown policy `{name}`; there are: {}", known.join(", ")))
    })
}
