//! Rules of disturbances at points, and recorded columns on the steps of a run.

use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smpl_runtime::rules::{Plan, Rules, RulesError};
use smpl_runtime::trajectory::{Between, Clock, Holds, on_steps as resampled};

use crate::arrays::Fresh;
use crate::errors::{SimulationError, reset_error, setup_error};
use crate::interrupt::released;

/// Values of the disturbances for the next step, and measurements at the points.
pub type Results<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);
/// Arrays with a row for each point: states, actions, disturbances, random numbers.
pub type Points<'py> = (PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>);
/// Values by name: one for all points, or one for each.
pub type Named<'py> = Vec<(String, PyReadonlyArray1<'py, f64>)>;

/// Evaluates the rules without the interpreter lock.
///
/// # Errors
/// Arrays of a wrong length, or a point at which no episode begins.
pub fn run<'py>(
    py: Python<'py>,
    rules: &mut Rules,
    (states, actions, disturbances, draws): &Points<'py>,
    named: [Named<'py>; 2],
    first_step: u32,
) -> PyResult<Results<'py>> {
    let copy = |array: &PyReadonlyArray2<'_, f64>| array.as_array().iter().copied().collect::<Vec<f64>>();
    let (count, observations) = (states.as_array().nrows(), rules.observations());
    let (states, actions, draws) = (copy(states), copy(actions), copy(draws));
    let width = disturbances.as_array().ncols();
    let disturbances = copy(disturbances);
    let [parameters, discrete] =
        named.map(|named| named.iter().map(|(name, array)| (name.clone(), array.as_array().to_vec())).collect::<Vec<_>>());
    let (mut next, mut measured) = (Fresh::matrix(py, count, width), Fresh::matrix(py, count, observations));
    let plan = Plan {
        count,
        states: &states,
        actions: &actions,
        disturbances: &disturbances,
        draws: &draws,
        parameters: parameters.iter().map(|(name, values)| (name.clone(), values.as_slice())).collect(),
        discrete: discrete.iter().map(|(name, values)| (name.clone(), values.as_slice())).collect(),
        first_step,
    };
    let (out, seen) = (next.elements(), measured.elements());
    released(py, || rules.run(&plan, out, seen))?.map_err(|error| rules_error(&error))?;
    Ok((next.done(), measured.done()))
}

fn rules_error(error: &RulesError) -> PyErr {
    match error {
        RulesError::Reset { error, .. } => reset_error(error),
        RulesError::Setup(error) => setup_error(error),
        RulesError::Interrupted => SimulationError::new_err(error.to_string()),
        RulesError::Length { .. } => PyValueError::new_err(error.to_string()),
    }
}

/// Values of a recorded input for the steps of a run, and the first step, from 0, within which a
/// held one changes. With `end` a value holds after its time and the last one until `end`; without
/// it holds before its time.
#[pyfunction]
pub fn on_steps(
    times: Vec<f64>,
    values: Vec<f64>,
    step: f64,
    linear: bool,
    end: Option<f64>,
    most: usize,
) -> PyResult<(Vec<f64>, Option<usize>)> {
    let between = if linear { Between::Linear } else { Between::Hold };
    let holds = end.map_or(Holds::Before, Holds::After);
    let found = resampled(&times, &values, Clock { step, between, most }, holds);
    let found = found.map_err(|error| PyValueError::new_err(error.to_string()))?;
    Ok((found.values, found.split))
}
