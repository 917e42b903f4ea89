//! Class `Batch`: environments of one model, stepped together.

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smpl_runtime::batch::{self, Autoreset, BatchError, BatchOptions, Info, StepArrays};
use smpl_runtime::catalogue::Family;
use smpl_runtime::environment::ResetOptions;

use crate::arrays::Fresh;
use crate::environment::{Normalize, gather};
use crate::errors::{SimulationError, guarded, reset_error, setup_error, step_error};
use crate::exclusive::Exclusive;
use crate::interrupt::released;
use crate::model::{Model, policy_index};
use crate::role::{Role, role_error};
use crate::snapshot::Snapshot;
use crate::start::Start;

type Vector<'py> = Bound<'py, PyArray1<f64>>;
type Flags<'py> = Bound<'py, PyArray1<bool>>;
type Observations<'py> = Bound<'py, PyArray2<f32>>;
/// Time, success, failures (optional), violations (one row per constraint), cost, rewards (one row
/// per reward), states, phases, names of successes (optional).
type InfoArrays<'py> = (
    Vector<'py>,
    Flags<'py>,
    Option<Vec<String>>,
    Bound<'py, PyArray2<f64>>,
    Vector<'py>,
    Bound<'py, PyArray2<f64>>,
    Option<Bound<'py, PyArray2<f64>>>,
    Option<Vec<usize>>,
    Option<Vec<String>>,
);
/// Ended episodes, with their last observations and infos.
type Final<'py> = (Flags<'py>, Observations<'py>, InfoArrays<'py>);
type BatchStepReturn<'py> = (Observations<'py>, Vector<'py>, Flags<'py>, Flags<'py>, InfoArrays<'py>, Option<Final<'py>>);

/// Environments of one model, stepped together by threads.
#[pyclass(frozen, module = "smpl._native")]
pub struct Batch {
    inner: Exclusive<Inner>,
    with_state: bool,
    constraints: Vec<String>,
    sizes: Sizes,
}

struct Inner {
    batch: batch::Batch,
    /// Actions of a step: the caller's array may be written by other threads meanwhile.
    actions: Vec<f64>,
}

#[derive(Clone, Copy)]
struct Sizes {
    observations: usize,
    actions: usize,
    rewards: usize,
    states: usize,
}

#[pymethods]
impl Batch {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "the arguments of the Python class, one by one")]
    fn new(
        py: Python<'_>,
        model: &Model,
        num_envs: usize,
        normalize: Normalize,
        dense_reward: bool,
        info_state: bool,
        max_steps: Option<u32>,
        method: Option<&str>,
        num_threads: usize,
        autoreset: &str,
    ) -> PyResult<Self> {
        let autoreset = match autoreset {
            "NextStep" => Autoreset::NextStep,
            "SameStep" => Autoreset::SameStep,
            "Disabled" => Autoreset::Disabled,
            _ => {
                return Err(PyValueError::new_err(format!("unknown autoreset mode `{autoreset}`")));
            }
        };
        let setup = model.setup(py, dense_reward, max_steps, method)?;
        let reset = ResetOptions::default();
        let options = BatchOptions { autoreset, threads: num_threads, normalisation: normalize.0, reset };
        let batch = guarded(|| batch::Batch::new(&setup, num_envs, options))?.map_err(|e| batch_error(&e))?;
        let Some(first) = batch.environment(0) else {
            return Err(PyValueError::new_err("num_envs is 0, expected a positive integer"));
        };
        let sizes = Sizes {
            observations: first.observation_len(),
            actions: first.catalogue().actions.len(),
            rewards: first.rewards().len(),
            states: first.catalogue().states.len(),
        };
        let constraints = first.constraint_names().map(str::to_owned).collect();
        let actions = vec![0.0; num_envs * sizes.actions];
        let inner = Exclusive::new("vector environment", Inner { batch, actions });
        Ok(Self { constraints, sizes, with_state: info_state, inner })
    }

    #[getter]
    fn constraint_names(&self) -> Vec<String> {
        self.constraints.clone()
    }

    /// Begins episodes where the mask says so: the first of a given seed, or the next one of the
    /// last seed.
    fn reset<'py>(
        &self,
        py: Python<'py>,
        mask: PyReadonlyArray1<'py, bool>,
        seeds: Option<Vec<Option<u64>>>,
        start: Option<&Start>,
    ) -> PyResult<(Observations<'py>, InfoArrays<'py>)> {
        let batch = &mut self.inner.enter()?.batch;
        let mask = mask.as_array().to_vec();
        let mut observations = Fresh::matrix(py, batch.len(), self.sizes.observations);
        let out = observations.elements();
        batch.set_reset_options(start.map(|start| start.options.clone()).unwrap_or_default());
        let result = released(py, || reset(batch, &mask, seeds.as_deref(), out));
        // What an episode was started from does not hold for those that begin by themselves later.
        batch.set_reset_options(ResetOptions::default());
        result?.map_err(|e| batch_error(&e))?;
        let infos = info_arrays(py, batch, self.sizes, self.constraints.len(), self.with_state, batch::Batch::info);
        Ok((observations.done(), infos))
    }

    /// Takes a step in every environment.
    fn step<'py>(&self, py: Python<'py>, actions: PyReadonlyArray2<'py, f64>) -> PyResult<BatchStepReturn<'py>> {
        let mut inner = self.inner.enter()?;
        let Inner { batch, actions: own } = &mut *inner;
        let count = batch.len();
        let given = actions.as_slice()?;
        if given.len() != own.len() {
            return Err(PyValueError::new_err("actions has a wrong number of entries"));
        }
        own.copy_from_slice(given);
        let actions = &*own;
        let mut observations = Fresh::matrix(py, count, self.sizes.observations);
        let mut rewards = Fresh::vector(py, count);
        let (mut terminated, mut truncated) = (Fresh::vector(py, count), Fresh::vector(py, count));
        let arrays = StepArrays {
            observations: observations.elements(),
            rewards: rewards.elements(),
            terminated: terminated.elements(),
            truncated: truncated.elements(),
        };
        released(py, || batch.step(actions, arrays))?.map_err(|e| batch_error(&e))?;
        let constraints = self.constraints.len();
        let infos = info_arrays(py, batch, self.sizes, constraints, self.with_state, batch::Batch::info);
        let last = self.last(py, batch);
        Ok((observations.done(), rewards.done(), terminated.done(), truncated.done(), infos, last))
    }

    /// Present point of each environment, and whether its next step begins an episode.
    fn snapshot(&self) -> PyResult<Vec<(Snapshot, bool)>> {
        let batch = &mut self.inner.enter()?.batch;
        Ok(batch.snapshots().into_iter().map(|(snapshot, pending)| (Snapshot::from(snapshot), pending)).collect())
    }

    /// Goes back to a snapshot of as many environments of the same model.
    fn restore(&self, snapshots: Vec<(PyRef<'_, Snapshot>, bool)>) -> PyResult<()> {
        let batch = &mut self.inner.enter()?.batch;
        let snapshots = snapshots.iter().map(|(snapshot, pending)| (snapshot.inner(), *pending));
        guarded(|| batch.restore(snapshots))?.map_err(|e| batch_error(&e))
    }

    /// Actions of the model's policy of that name for the coming step, physical units, a row an
    /// environment.
    fn policy<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let batch = &mut self.inner.enter()?.batch;
        let setup = batch.environment(0).map(|first| first.setup().clone());
        let index = setup.map_or(Ok(0), |setup| policy_index(setup.model().model(), name))?;
        let mut actions = Fresh::matrix(py, batch.len(), self.sizes.actions);
        batch.policy(index, actions.elements()).map_err(|e| batch_error(&e))?;
        Ok(actions.done())
    }

    /// Values by role, a row an environment: `state`, `discrete`, `disturbance`, `action`,
    /// `parameter`.
    fn values<'py>(&self, py: Python<'py>, role: Role) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let batch = &mut self.inner.enter()?.batch;
        let family = batch.environment(0).map(|first| role.family(first.catalogue()));
        let width = family.map_or(0, Family::len);
        let mut values = Fresh::matrix(py, batch.len(), width);
        for (index, out) in values.elements().chunks_exact_mut(width.max(1)).enumerate() {
            if let Some(environment) = batch.environment(index) {
                let values = role.region(environment).ok_or_else(|| role_error(role.name()))?;
                gather(role.family(environment.catalogue()), values, out);
            }
        }
        Ok(values.done())
    }
}

impl Batch {
    /// The ends of the episodes that ended in this step, with same-step autoreset.
    fn last<'py>(&self, py: Python<'py>, batch: &batch::Batch) -> Option<Final<'py>> {
        let count = batch.len();
        if !(0..count).any(|i| batch.final_info(i).is_some()) {
            return None;
        }
        let ended = Fresh::vector(py, count).filled(|out| {
            for (i, out) in out.iter_mut().enumerate() {
                *out = batch.final_info(i).is_some();
            }
        });
        let mut observations = Fresh::matrix(py, count, self.sizes.observations);
        for (i, out) in observations.elements().chunks_exact_mut(self.sizes.observations.max(1)).enumerate() {
            for (out, &value) in out.iter_mut().zip(batch.final_info(i).map_or(&[][..], |(values, _)| values)) {
                *out = value as f32;
            }
        }
        let pick = |batch: &'_ batch::Batch, i| batch.final_info(i).map(|(_, info)| info.clone());
        let infos: Vec<Option<Info>> = (0..count).map(|i| pick(batch, i)).collect();
        let sizes = self.sizes;
        let infos = fill_infos(py, &infos.iter().map(Option::as_ref).collect::<Vec<_>>(), sizes, self.constraints.len(), self.with_state);
        Some((ended, observations.done(), infos))
    }
}

/// Resets what the mask says: those with a seed to its first episode, the others to their next one.
fn reset(batch: &mut batch::Batch, mask: &[bool], seeds: Option<&[Option<u64>]>, observations: &mut [f32]) -> Result<(), BatchError> {
    let Some(seeds) = seeds else {
        return batch.reset(None, Some(mask), observations);
    };
    let select = |seeded: bool| -> Vec<bool> { mask.iter().zip(seeds).map(|(&chosen, seed)| chosen && seed.is_some() == seeded).collect() };
    let unseeded = select(false);
    if unseeded.contains(&true) {
        batch.reset(None, Some(&unseeded), observations)?;
    }
    let values: Vec<u64> = seeds.iter().map(|seed| seed.unwrap_or_default()).collect();
    batch.reset(Some(&values), Some(&select(true)), observations)
}

/// The infos that `read` finds for each environment.
fn info_arrays<'py>(
    py: Python<'py>,
    batch: &batch::Batch,
    sizes: Sizes,
    constraints: usize,
    with_state: bool,
    read: impl Fn(&batch::Batch, usize) -> Option<&Info>,
) -> InfoArrays<'py> {
    let infos: Vec<Option<&Info>> = (0..batch.len()).map(|i| read(batch, i)).collect();
    fill_infos(py, &infos, sizes, constraints, with_state)
}

fn fill_infos<'py>(py: Python<'py>, infos: &[Option<&Info>], sizes: Sizes, constraints: usize, with_state: bool) -> InfoArrays<'py> {
    let count = infos.len();
    let column = |of: fn(&Info) -> f64| {
        Fresh::vector(py, count).filled(|out| {
            for (out, info) in out.iter_mut().zip(infos) {
                *out = info.map_or(0.0, of);
            }
        })
    };
    let phases = infos.iter().flatten().any(|info| info.phase.is_some());
    let phases = phases.then(|| infos.iter().map(|info| info.and_then(|i| i.phase).unwrap_or_default()).collect());
    let success = Fresh::vector(py, count).filled(|out| {
        for (out, info) in out.iter_mut().zip(infos) {
            *out = info.is_some_and(|info| info.success);
        }
    });
    let texts = |of: fn(&Info) -> &String| {
        let any = infos.iter().flatten().any(|info| !of(info).is_empty());
        any.then(|| infos.iter().map(|info| info.map_or(String::new(), |i| of(i).clone())).collect::<Vec<String>>())
    };
    let failures = texts(|info| &info.failure);
    let rows = |len: usize, of: fn(&Info) -> &[f64]| {
        let mut array = Fresh::matrix(py, len, count);
        let out = array.elements();
        for (i, info) in infos.iter().enumerate() {
            for (row, &value) in info.map_or(&[][..], of).iter().enumerate().take(len) {
                out[row * count + i] = value;
            }
        }
        array.done()
    };
    let states = with_state.then(|| {
        let mut array = Fresh::matrix(py, count, sizes.states);
        for (out, info) in array.elements().chunks_exact_mut(sizes.states.max(1)).zip(infos) {
            if let Some(info) = info {
                out.copy_from_slice(&info.state);
            }
        }
        array.done()
    });
    (
        column(|info| info.time),
        success,
        failures,
        rows(constraints, |info| &info.violations),
        column(|info| info.cost),
        rows(sizes.rewards, |info| &info.rewards),
        states,
        phases,
        texts(|info| &info.success_name),
    )
}

fn batch_error(error: &BatchError) -> PyErr {
    match error {
        BatchError::Length { .. } | BatchError::Snapshot { .. } => PyValueError::new_err(error.to_string()),
        BatchError::Step { index, error } => prefixed(*index, &step_error(error)),
        BatchError::Reset { index, error } => prefixed(*index, &reset_error(error)),
        BatchError::Setup(error) => setup_error(error),
        BatchError::Interrupted | BatchError::Threads(_) => SimulationError::new_err(error.to_string()),
    }
}

/// The same exception, naming the environment.
fn prefixed(index: usize, error: &PyErr) -> PyErr {
    Python::attach(|py| {
        let text = format!("environment {index}: {}", error.value(py));
        PyErr::from_type(error.get_type(py), text)
    })
}
