//! Many trajectories of a model at once.

use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArrayDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smpl_runtime::environment::History;
use smpl_runtime::rollout::{Arrays, Given, Origin, Plan, RolloutError, Rollouts};

use crate::arrays::Fresh;
use crate::errors::{SimulationError, reset_error, setup_error, step_error};
use crate::interrupt::released;
use crate::snapshot::Snapshot;

type Numbers<'py> = PyReadonlyArrayDyn<'py, f64>;
type Cube<'py> = Bound<'py, PyArray3<f64>>;
/// States, observations, outputs, rewards, cost, violations, steps, terminated, truncated,
/// failures, their kinds and names; states and measurements at the instants.
pub type Results<'py> = (
    Cube<'py>,
    Cube<'py>,
    Cube<'py>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Cube<'py>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Vec<String>,
    (Vec<&'static str>, Vec<String>),
    (Cube<'py>, Cube<'py>),
);

/// Start of trajectories, as given by Python.
#[derive(FromPyObject)]
pub enum Start<'py> {
    /// Present point of an episode.
    Snapshot(PyRef<'py, Snapshot>),
    /// A row a trajectory, or one for all.
    States(Numbers<'py>),
}

/// Request of Python. The caller's arrays may be written by other threads meanwhile: these are
/// copies.
pub struct Request {
    snapshot: Option<smpl_runtime::environment::Snapshot>,
    states: Vec<f64>,
    actions: Vec<f64>,
    parameters: Vec<(String, Vec<f64>)>,
    discrete: Vec<(String, Vec<f64>)>,
    disturbances: Vec<(String, Vec<f64>)>,
    count: usize,
    horizon: usize,
    seed: Option<u64>,
    first_step: u32,
    outputs: bool,
    instants: Vec<(usize, f64)>,
    history: Option<History>,
}

/// Seed, first step, with outputs, instants as step and share of it, and the history: times, states
/// and actions.
pub type Options = (Option<u64>, u32, bool, Vec<(usize, f64)>, Option<(Vec<f64>, Vec<f64>, Vec<f64>)>);

type Named<'py> = Vec<(String, Numbers<'py>)>;

impl Request {
    /// `size` is (trajectories, steps).
    pub fn new(start: &Start<'_>, actions: &Numbers<'_>, given: [&Named<'_>; 3], size: (usize, usize), options: Options) -> Self {
        let values = |array: &Numbers<'_>| array.as_array().iter().copied().collect::<Vec<f64>>();
        let [parameters, discrete, disturbances] =
            given.map(|named| named.iter().map(|(name, array)| (name.clone(), values(array))).collect::<Vec<_>>());
        let (snapshot, states) = match start {
            Start::Snapshot(snapshot) => (Some(snapshot.inner().clone()), Vec::new()),
            Start::States(states) => (None, values(states)),
        };
        let ((count, horizon), (seed, first_step, outputs, instants, history)) = (size, options);
        let history = history.map(|(times, states, actions)| History { times, states, actions });
        let actions = values(actions);
        Self { snapshot, states, actions, parameters, discrete, disturbances, count, horizon, seed, first_step, outputs, instants, history }
    }

    fn plan(&self) -> Plan<'_> {
        Plan {
            origin: self.snapshot.as_ref().map_or(Origin::States(&self.states), Origin::Snapshot),
            count: self.count,
            horizon: self.horizon,
            actions: &self.actions,
            parameters: named(&self.parameters),
            discrete: named(&self.discrete),
            disturbances: named(&self.disturbances),
            seed: self.seed,
            first_step: self.first_step,
            instants: &self.instants,
            history: self.history.as_ref(),
        }
    }

    /// Simulates without the interpreter lock, into new arrays.
    pub fn run<'py>(&self, py: Python<'py>, rollouts: &mut Rollouts) -> PyResult<Results<'py>> {
        let (widths, count, horizon) = (rollouts.widths(), self.count, self.horizon);
        let points = |width: usize| Fresh::cube(py, [count, horizon + 1, width]);
        let mut states = points(widths.states);
        let mut observations = points(widths.observations);
        let mut outputs = points(if self.outputs { widths.outputs } else { 0 });
        let mut violations = Fresh::cube(py, [count, horizon, widths.violations]);
        let (mut rewards, mut cost) = (Fresh::matrix(py, count, horizon), Fresh::matrix(py, count, horizon));
        let (mut steps, mut terminated, mut truncated) = (Fresh::vector(py, count), Fresh::vector(py, count), Fresh::vector(py, count));
        let mut instants = [widths.states, widths.observations].map(|width| Fresh::cube(py, [count, self.instants.len(), width]));
        let [instant_states, measured] = &mut instants;
        let arrays = Arrays {
            states: states.elements(),
            observations: observations.elements(),
            outputs: outputs.elements(),
            rewards: rewards.elements(),
            cost: cost.elements(),
            violations: violations.elements(),
            steps: steps.elements(),
            terminated: terminated.elements(),
            truncated: truncated.elements(),
            instant_states: instant_states.elements(),
            measured: measured.elements(),
        };
        let plan = self.plan();
        let ends = released(py, || rollouts.run(&plan, arrays))?.map_err(|e| rollout_error(&e))?;
        let kinds = ends.iter().map(|end| end.kind.name()).collect();
        let (failures, names) = ends.into_iter().map(|end| (end.failure, end.name)).unzip();
        Ok((
            states.done(),
            observations.done(),
            outputs.done(),
            rewards.done(),
            cost.done(),
            violations.done(),
            steps.done(),
            terminated.done(),
            truncated.done(),
            failures,
            (kinds, names),
            instants.map(Fresh::done).into(),
        ))
    }
}

fn named(values: &[(String, Vec<f64>)]) -> Given<'_> {
    values.iter().map(|(name, values)| (name.clone(), values.as_slice())).collect()
}

/// The exception of a rollout that cannot be made.
pub fn rollout_error(error: &RolloutError) -> PyErr {
    let numbered = |index: usize, error: &PyErr| {
        Python::attach(|py| PyErr::from_type(error.get_type(py), format!("trajectory {index}: {}", error.value(py))))
    };
    match error {
        RolloutError::Reset { index, error } => numbered(*index, &reset_error(error)),
        RolloutError::Step { index, error } => numbered(*index, &step_error(error)),
        RolloutError::Setup(error) => setup_error(error),
        RolloutError::Interrupted | RolloutError::Threads(_) => SimulationError::new_err(error.to_string()),
        _ => PyValueError::new_err(error.to_string()),
    }
}
