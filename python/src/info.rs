//! The `info` of a step as a dictionary.

use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use smpl_runtime::environment::Environment;

use crate::arrays::Fresh;

/// Keys of the mappings in `info`, made once.
pub struct Keys {
    constraints: Vec<Py<PyString>>,
    rewards: Vec<Py<PyString>>,
    phases: Vec<Py<PyString>>,
    with_state: bool,
    /// Dictionaries of all keys with what most steps say, nothing failed, no limit was violated: a
    /// copy of one has its places already.
    blank: [Py<PyDict>; 3],
}

impl Keys {
    /// The keys of an environment; `with_state` adds the state.
    pub fn new(py: Python<'_>, env: &Environment, with_state: bool) -> PyResult<Self> {
        let text = |name: &str| PyString::intern(py, name).unbind();
        let interface = env.setup().model().interface();
        let constraints: Vec<Py<PyString>> = env.constraint_names().map(text).collect();
        let rewards: Vec<Py<PyString>> = interface.finish.rewards.iter().map(|r| text(&r.name)).collect();
        let blank = [usual(py)?, zeros(py, &constraints)?, zeros(py, &rewards)?];
        Ok(Self { constraints, rewards, phases: interface.phases.iter().map(|name| text(name)).collect(), with_state, blank })
    }

    /// A new dictionary about the present point of the episode.
    pub fn info<'py>(&self, py: Python<'py>, env: &mut Environment) -> PyResult<Bound<'py, PyDict>> {
        let [info, constraints, rewards] = &self.blank;
        let info = info.bind(py).copy()?;
        let failed = env.last().is_some_and(|last| last.failure.is_some());
        info.set_item(intern!(py, "time"), env.time())?;
        if failed {
            info.set_item(intern!(py, "failure"), env.failure_message())?;
        }
        if env.last().is_some_and(|last| last.success) {
            info.set_item(intern!(py, "success"), true)?;
            info.set_item(intern!(py, "success_name"), env.success_name())?;
        }
        info.set_item(intern!(py, "constraints"), filled(constraints.bind(py), &self.constraints, env.violations())?)?;
        if let Some(last) = env.last().filter(|last| last.cost != 0.0) {
            info.set_item(intern!(py, "cost"), last.cost)?;
        }
        info.set_item(intern!(py, "rewards"), filled(rewards.bind(py), &self.rewards, env.rewards())?)?;
        if let Some(phase) = env.phase().and_then(|phase| self.phases.get(phase)) {
            info.set_item(intern!(py, "phase"), phase)?;
        }
        if self.with_state {
            let states = env.catalogue().states.len();
            info.set_item(intern!(py, "state"), Fresh::vector(py, states).filled(|out| env.state(out)))?;
        }
        Ok(info)
    }
}

/// The `info` of a step in which nothing happened; `time` and the mappings are still to be set.
fn usual(py: Python<'_>) -> PyResult<Py<PyDict>> {
    let mapping = PyDict::new(py);
    mapping.set_item(intern!(py, "time"), py.None())?;
    mapping.set_item(intern!(py, "failure"), "")?;
    mapping.set_item(intern!(py, "success"), false)?;
    mapping.set_item(intern!(py, "success_name"), "")?;
    mapping.set_item(intern!(py, "constraints"), py.None())?;
    mapping.set_item(intern!(py, "cost"), 0.0)?;
    mapping.set_item(intern!(py, "rewards"), py.None())?;
    Ok(mapping.unbind())
}

/// A dictionary of these keys with zeros.
fn zeros(py: Python<'_>, keys: &[Py<PyString>]) -> PyResult<Py<PyDict>> {
    let mapping = PyDict::new(py);
    for key in keys {
        mapping.set_item(key, 0.0)?;
    }
    Ok(mapping.unbind())
}

/// A copy of zeros with values.
fn filled<'py>(blank: &Bound<'py, PyDict>, keys: &[Py<PyString>], values: &[f64]) -> PyResult<Bound<'py, PyDict>> {
    let mapping = blank.copy()?;
    for (key, value) in keys.iter().zip(values).filter(|(_, value)| value.to_bits() != 0) {
        mapping.set_item(key, value)?;
    }
    Ok(mapping)
}
