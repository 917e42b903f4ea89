//! Class `Env`: one environment.

use numpy::{Element, PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use smpl_runtime::catalogue::Family;
use smpl_runtime::environment::{self, Environment};
use smpl_runtime::observe::Normalisation;

use crate::arrays::Fresh;
use crate::errors::{SimulationError, guarded, reset_error, step_error};
use crate::exclusive::Exclusive;
use crate::info::Keys;
use crate::interrupt::released;
use crate::model::{Model, policy_index};
use crate::role::Role;
use crate::snapshot::Snapshot;
use crate::start::Start;

type Observation<'py> = Bound<'py, PyArray1<f32>>;
type StepReturn<'py> = (Observation<'py>, f64, bool, bool, Bound<'py, PyDict>);

/// One environment.
#[pyclass(frozen, module = "smpl._native")]
pub struct Env {
    inner: Exclusive<Inner>,
}

struct Inner {
    environment: Environment,
    keys: Keys,
    normalisation: Normalisation,
    action: Vec<f64>,
}

#[pymethods]
impl Env {
    #[new]
    fn new(
        py: Python<'_>,
        model: &Model,
        normalize: Normalize,
        dense_reward: bool,
        info_state: bool,
        max_steps: Option<u32>,
        method: Option<&str>,
    ) -> PyResult<Self> {
        let setup = model.setup(py, dense_reward, max_steps, method)?;
        let environment = guarded(|| Environment::new(setup))?.map_err(|e| crate::errors::setup_error(&e))?;
        let inner = Inner {
            keys: Keys::new(py, &environment, info_state)?,
            action: vec![0.0; environment.catalogue().actions.len()],
            normalisation: normalize.0,
            environment,
        };
        Ok(Self { inner: Exclusive::new("environment", inner) })
    }

    /// Begins an episode: the first of a seed, or the next one of the last seed.
    #[pyo3(signature = (seed, start))]
    fn reset<'py>(&self, py: Python<'py>, seed: Option<u64>, start: Option<&Start>) -> PyResult<(Observation<'py>, Bound<'py, PyDict>)> {
        let default = environment::ResetOptions::default();
        let options = start.map_or(&default, |start| &start.options);
        let mut inner = self.inner.enter()?;
        let Inner { environment, keys, normalisation, .. } = &mut *inner;
        released(py, || environment.reset(seed, options))?.map_err(|e| reset_error(&e))?;
        Ok((observation(py, environment, *normalisation), keys.info(py, environment)?))
    }

    /// Takes a step; raises `TypeError` without a step if the action is not a plain vector of
    /// single- or double-precision numbers.
    fn step<'py>(&self, py: Python<'py>, action: &Bound<'py, PyAny>) -> PyResult<StepReturn<'py>> {
        let mut inner = self.inner.enter()?;
        let Inner { environment, keys, normalisation, action: values } = &mut *inner;
        match action.cast_exact::<PyArray1<f32>>() {
            Ok(single) => copy_numbers(single, values)?,
            Err(_) => copy_numbers(action.cast_exact::<PyArray1<f64>>()?, values)?,
        }
        for (value, element) in values.iter_mut().zip(environment.catalogue().actions.elements()) {
            *value = normalisation.physical(*value, element);
        }
        let action = &*values;
        let result = released(py, || environment.step(action))?.map_err(|e| step_error(&e))?;
        Ok((observation(py, environment, *normalisation), result.reward, result.terminated, result.truncated, keys.info(py, environment)?))
    }

    /// Values by role: `state`, `algebraic`, `discrete`, `disturbance`, `action`, `parameter`.
    fn values<'py>(&self, py: Python<'py>, role: Role) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(values(py, &mut self.inner.enter()?.environment, role))
    }

    /// Actions of the model's policy of that name for the coming step, physical units.
    fn policy<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let environment = &mut self.inner.enter()?.environment;
        let setup = environment.setup().clone();
        let index = policy_index(setup.model().model(), name)?;
        Ok(Fresh::vector(py, setup.catalogue.actions.len()).filled(|out| environment.policy(index, out)))
    }

    /// Seed of the episode, and its number since that seed was given.
    #[getter]
    fn episode(&self) -> PyResult<(u64, u64)> {
        self.with(|environment| (environment.key().seed, environment.key().episode))
    }

    #[getter]
    fn time(&self) -> PyResult<f64> {
        self.with(Environment::time)
    }

    #[getter]
    fn steps(&self) -> PyResult<u32> {
        self.with(Environment::steps)
    }

    /// Kind of the failure of the last step, see `Rollout.failure_kind`.
    #[getter]
    fn failure_kind(&self) -> PyResult<&'static str> {
        self.with(|environment| environment.failure_cause().0.name())
    }

    /// Name of the declared failure of the last step; empty for other kinds.
    #[getter]
    fn failure_name(&self) -> PyResult<String> {
        self.with(|environment| environment.failure_cause().1.to_owned())
    }

    #[getter]
    fn max_steps(&self) -> PyResult<u32> {
        self.with(|environment| environment.setup().max_steps())
    }

    #[getter]
    fn steady_state<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        self.with(|environment| {
            check_steady(environment)?;
            let setup = environment.setup();
            let states = &setup.catalogue.states;
            let steady = setup.model().interface().steady.is_some().then(|| environment.steady_state());
            Ok(steady.map(|steady| Fresh::vector(py, states.len()).filled(|out| gather(states, steady, out))))
        })?
    }

    #[getter]
    fn steady_action<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        self.with(|environment| {
            let setup = environment.setup();
            if let Some(error) = setup.no_steady() {
                return Err(SimulationError::new_err(format!("steady state: {error}")));
            }
            let actions = &setup.catalogue.actions;
            let steady = setup.model().interface().steady.is_some().then(|| setup.steady_action());
            Ok(steady.map(|steady| Fresh::vector(py, actions.len()).filled(|out| gather(actions, steady, out))))
        })?
    }

    #[getter]
    fn constraint_names(&self) -> PyResult<Vec<String>> {
        self.with(|environment| environment.constraint_names().map(str::to_owned).collect())
    }

    #[getter]
    fn solver_statistics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.with(|environment| crate::load::statistics(py, &environment.statistics()))?
    }

    fn snapshot(&self) -> PyResult<Snapshot> {
        self.with(|environment| environment.snapshot().into())
    }

    fn restore(&self, snapshot: &Snapshot) -> PyResult<()> {
        let environment = &mut self.inner.enter()?.environment;
        guarded(|| environment.restore(snapshot.inner()))?.map_err(|e| PyValueError::new_err(e.to_string()))
    }
}

impl Env {
    /// Calls `work` with the environment.
    ///
    /// # Errors
    /// When another thread uses it.
    pub fn with_mut<T>(&self, work: impl FnOnce(&mut Environment) -> T) -> PyResult<T> {
        Ok(work(&mut self.inner.enter()?.environment))
    }

    fn with<T>(&self, read: impl FnOnce(&Environment) -> T) -> PyResult<T> {
        Ok(read(&self.inner.enter()?.environment))
    }
}

/// The argument `normalize`: a flag, or `"nominal"`.
pub struct Normalize(pub Normalisation);

impl<'py> FromPyObject<'_, 'py> for Normalize {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if given.extract::<&str>().is_ok_and(|text| text == "nominal") {
            return Ok(Self(Normalisation::Nominal));
        }
        Ok(Self(if given.extract()? { Normalisation::Box } else { Normalisation::Off }))
    }
}

/// Copies an action of either precision.
///
/// # Errors
/// A `ValueError` if its length is not that of `out`.
fn copy_numbers<T: Element + Copy + Into<f64>>(action: &Bound<'_, PyArray1<T>>, out: &mut [f64]) -> PyResult<()> {
    if action.len() != out.len() {
        let message = format!("action has shape ({},), expected ({},)", action.len(), out.len());
        return Err(PyValueError::new_err(message));
    }
    for (i, out) in out.iter_mut().enumerate() {
        *out = action.get_owned(i).map_or(f64::NAN, Into::into);
    }
    Ok(())
}

fn observation<'py>(py: Python<'py>, environment: &Environment, normalisation: Normalisation) -> Observation<'py> {
    Fresh::vector(py, environment.observation_len()).filled(|out| environment.observe(normalisation.scales(), out))
}

/// Values of a role in declaration order.
fn values<'py>(py: Python<'py>, environment: &mut Environment, role: Role) -> Bound<'py, PyArray1<f64>> {
    let setup = environment.setup().clone();
    let family = role.family(&setup.catalogue);
    Fresh::vector(py, family.len()).filled(|out| match role.region(environment) {
        Some(values) => gather(family, values, out),
        None => environment.algebraics(out),
    })
}

/// Picks the elements of a family out of their region.
pub fn gather(family: &Family, values: &[f64], out: &mut [f64]) {
    for (element, out) in family.elements().iter().zip(out) {
        *out = values[element.at];
    }
}

/// Raises an exception if the declared steady state cannot be found.
fn check_steady(environment: &Environment) -> PyResult<()> {
    if let Some(error) = environment.setup().no_steady() {
        return Err(SimulationError::new_err(format!("steady state: {error}")));
    }
    if environment.steady_state().iter().any(|x| x.is_nan()) {
        return Err(SimulationError::new_err("no steady state was found with the parameters of this episode"));
    }
    Ok(())
}
