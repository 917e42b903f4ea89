//! Control steps with their derivatives, many at once.

use std::sync::Arc;

use numpy::{PyArray2, PyArray3, PyReadonlyArrayDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smpl_runtime::catalogue::Catalogue;
use smpl_runtime::environment::Direction;
use smpl_runtime::sensitivity::{Arrays, Plan, Sensitivities, SensitivityError};
use smpl_runtime::setup::Setup;

use crate::arrays::Fresh;
use crate::errors::{SimulationError, guarded, reset_error, setup_error};
use crate::interrupt::released;
use crate::role::{Role, role_error};

type Matrix<'py> = Bound<'py, PyArray2<f64>>;
type Cube<'py> = Bound<'py, PyArray3<f64>>;
type Named<'py> = Vec<(String, PyReadonlyArrayDyn<'py, f64>)>;

/// States, rewards, observations (a row per step of each point); their derivatives, rows by
/// directions.
pub type Results<'py> = (Matrix<'py>, Matrix<'py>, Matrix<'py>, Cube<'py>, Cube<'py>, Cube<'py>);

/// Settings of a computation: directions by role and number in declaration order, threads, time
/// limit, method.
#[derive(Clone, PartialEq, Eq, Hash, FromPyObject)]
pub struct Key(pub Vec<(Role, usize)>, pub usize, pub Option<u32>, pub Option<String>);

/// Makes what computes.
///
/// # Errors
/// A role that there is not, or what the solver says of the equations.
pub fn make(key: &Key, setup: &Arc<Setup>) -> PyResult<Sensitivities> {
    let directions = key.0.iter().map(|(role, index)| direction(&setup.catalogue, *role, *index)).collect::<PyResult<_>>()?;
    guarded(|| Sensitivities::new(setup, directions, key.1))?.map_err(|e| error(&e))
}

/// A direction; actions of later steps are counted behind those of the first one.
fn direction(catalogue: &Catalogue, role: Role, index: usize) -> PyResult<Direction> {
    let (width, missing) = (catalogue.actions.len(), || PyValueError::new_err(format!("there is no {} {index}", role.name())));
    if role == Role::Action && index >= width {
        let element = catalogue.actions.elements().get(index % width.max(1)).ok_or_else(missing)?;
        return Ok(Direction::ActionIn(index / width, element.at));
    }
    let make = match role {
        Role::State => Direction::State,
        Role::Action => Direction::Action,
        Role::Parameter => Direction::Parameter,
        Role::Discrete => Direction::Discrete,
        Role::Disturbance => Direction::Disturbance,
        Role::Solved | Role::Algebraic => return Err(role_error(role.name())),
    };
    Ok(make(role.family(catalogue).elements().get(index).ok_or_else(missing)?.at))
}

/// Request of Python. The caller's arrays may be written by other threads meanwhile: these are
/// copies.
pub struct Request {
    states: Vec<f64>,
    actions: Vec<f64>,
    named: [Vec<(String, Vec<f64>)>; 3],
    count: usize,
    first_step: u32,
    horizon: usize,
}

impl Request {
    /// Parameters, discrete variables and disturbances are named.
    pub fn new(
        states: &PyReadonlyArrayDyn<'_, f64>,
        actions: &PyReadonlyArrayDyn<'_, f64>,
        named: [&Named<'_>; 3],
        (count, first_step, horizon): (usize, u32, usize),
    ) -> Self {
        let values = |array: &PyReadonlyArrayDyn<'_, f64>| array.as_array().iter().copied().collect::<Vec<f64>>();
        let named = named.map(|named| named.iter().map(|(name, array)| (name.clone(), values(array))).collect());
        Self { states: values(states), actions: values(actions), named, count, first_step, horizon: horizon.max(1) }
    }

    /// Computes without the interpreter lock, into new arrays.
    pub fn run<'py>(&self, py: Python<'py>, setup: &Setup, sensitivities: &mut Sensitivities) -> PyResult<Results<'py>> {
        let interface = setup.model().interface();
        let (n, rewards, observations) =
            (setup.catalogue.states.len(), interface.finish.rewards.len(), interface.finish.observations.len());
        let (rows, directions) = (self.count * self.horizon, sensitivities.directions().len());
        let mut values = [n, rewards, observations].map(|width| Fresh::matrix(py, rows, width));
        let mut derivatives = [n, rewards, observations].map(|width| Fresh::cube(py, [rows, width, directions]));
        let given = |at: usize| self.named[at].iter().map(|(name, values)| (name.clone(), values.as_slice())).collect();
        let plan = Plan {
            count: self.count,
            horizon: self.horizon,
            states: &self.states,
            actions: &self.actions,
            parameters: given(0),
            discrete: given(1),
            disturbances: given(2),
            first_step: self.first_step,
        };
        let [states, rewards, observations] = &mut values;
        let [by_states, by_rewards, by_observations] = &mut derivatives;
        let arrays = Arrays {
            states: states.elements(),
            rewards: rewards.elements(),
            observations: observations.elements(),
            by_states: by_states.elements(),
            by_rewards: by_rewards.elements(),
            by_observations: by_observations.elements(),
        };
        released(py, || sensitivities.run(&plan, arrays))?.map_err(|e| error(&e))?;
        let ([a, b, c], [d, e, f]) = (values, derivatives);
        Ok((a.done(), b.done(), c.done(), d.done(), e.done(), f.done()))
    }
}

/// The exception of derivatives that cannot be computed.
fn error(error: &SensitivityError) -> PyErr {
    match error {
        SensitivityError::Reset { index, error } => {
            let plain = reset_error(error);
            Python::attach(|py| PyErr::from_type(plain.get_type(py), format!("point {index}: {}", plain.value(py))))
        }
        SensitivityError::Setup(error) => setup_error(error),
        SensitivityError::Length { .. } => PyValueError::new_err(error.to_string()),
        _ => SimulationError::new_err(error.to_string()),
    }
}
