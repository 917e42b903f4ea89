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
    /// Dictionaries of all keys: a copy of one has its places already.
    blank: [Py<PyDict>; 3],
}

impl Keys {
    /// The keys of an environment; `with_state` adds the state.
    pub fn new(py: Python<'_>, env: &Environment, with_state: bool) -> PyResult<Self> {
        let text = |name: &str| PyString::intern(py, name).unbind();
        let interface = env.setup().model().interface();
        let constraints: Vec<Py<PyString>> = env.constraint_names().map(text).collect();
        let rewards: Vec<Py<PyString>> = interface.finish.rewards.iter().map(|r| text(&r.name)).collect();
        let first = ["time", "failure", "success", "success_name", "constraints", "cost", "rewards"].map(text);
        let blank = [blank(py, &first)?, blank(py, &constraints)?, blank(py, &rewards)?];
        Ok(Self { constraints, rewards, phases: interface.phases.iter().map(|name| text(name)).collect(), with_state, blank })
    }

    /// A new dictionary about the present point of the episode.
    pub fn info<'py>(&self, py: Python<'py>, env: &mut Environment) -> PyResult<Bound<'py, PyDict>> {
        let [info, constraints, rewards] = &self.blank;
        let info = info.bind(py).copy()?;
        let failed = env.last().is_some_and(|last| last.failure.is_some());
        let failure = if failed { env.failure_message() } else { String::new() };
        info.set_item(intern!(py, "time"), env.time())?;
        info.set_item(intern!(py, "failure"), failure)?;
        info.set_item(intern!(py, "success"), env.last().is_some_and(|last| last.success))?;
        info.set_item(intern!(py, "success_name"), env.success_name())?;
        info.set_item(intern!(py, "constraints"), filled(constraints.bind(py), &self.constraints, env.violations())?)?;
        info.set_item(intern!(py, "cost"), env.last().map_or(0.0, |last| last.cost))?;
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

/// A dictionary of these keys.
fn blank(py: Python<'_>, keys: &[Py<PyString>]) -> PyResult<Py<PyDict>> {
    let mapping = PyDict::new(py);
    for key in keys {
        mapping.set_item(key, py.None())?;
    }
    Ok(mapping.unbind())
}

/// A copy with values.
fn filled<'py>(blank: &Bound<'py, PyDict>, keys: &[Py<PyString>], values: &[f64]) -> PyResult<Bound<'py, PyDict>> {
    let mapping = blank.copy()?;
    for (key, value) in keys.iter().zip(values) {
        mapping.set_item(key, value)?;
    }
    Ok(mapping)
}
