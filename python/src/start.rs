//! Given start of an episode, instead of a drawn one.

use std::collections::BTreeMap;

use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smpl_runtime::environment::{ResetOptions, Start as Mode, StateInput};

/// Options of a reset.
#[pyclass(frozen, module = "smpl._native")]
pub struct Start {
    /// As the runtime needs them.
    pub options: ResetOptions,
}

/// A state as Python gives it.
#[derive(FromPyObject)]
enum GivenState<'py> {
    Named(BTreeMap<String, f64>),
    Array(PyReadonlyArray1<'py, f64>),
}

#[pymethods]
impl Start {
    #[new]
    #[pyo3(signature = (mode, state, discrete, parameters, disturbances, held, disturbance_seed=None))]
    fn new(
        mode: &str,
        state: Option<GivenState<'_>>,
        discrete: BTreeMap<String, f64>,
        parameters: BTreeMap<String, f64>,
        disturbances: BTreeMap<String, Vec<f64>>,
        held: Vec<String>,
        disturbance_seed: Option<u64>,
    ) -> PyResult<Self> {
        let start = Mode::from_name(mode).ok_or_else(|| PyValueError::new_err(format!("unknown start `{mode}`")))?;
        let state = match state {
            None => StateInput::Start,
            Some(GivenState::Named(named)) => StateInput::Named(named),
            Some(GivenState::Array(array)) => StateInput::Array(array.as_array().to_vec()),
        };
        Ok(Self {
            options: ResetOptions {
                start,
                state,
                discrete,
                parameters,
                disturbances,
                held: held.into_iter().collect(),
                disturbance_seed,
                ..ResetOptions::default()
            },
        })
    }
}
