//! Equations, derivatives and steady states of a model, with unknowns in declaration order: states,
//! then solved algebraic variables.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::ir::Builtin;
use smpl_compiler::layout::{FramePart, Region};
use smpl_compiler::model::Variate;
use smpl_runtime::catalogue::Catalogue;
use smpl_runtime::linearize::{self, Linearization};
use smpl_runtime::parameters::{self, ParameterError};
use smpl_runtime::solver::System;
use smpl_runtime::steady::{self, Held, SteadyError};
use smpl_runtime::system::CompiledSystem;

use crate::errors::SimulationError;
use crate::role::Role;

/// Values instead of defaults: role, element, value.
pub type Given = Vec<(Role, usize, f64)>;

/// An instance of a model to evaluate, and the order of its unknowns.
pub struct Equations {
    catalogue: Catalogue,
    /// Parameters at their means, nominal actions, the steady state of the model where there is
    /// one.
    nominal: CompiledSystem,
    work: CompiledSystem,
    /// Place in `y` of each unknown in declaration order.
    order: Vec<usize>,
    jacobian: Columns,
    y: Vec<f64>,
    yp: Vec<f64>,
    out: Vec<f64>,
    values: Vec<f64>,
}

/// Seconds of a call, the smallest mean of several batches, since the machine may do other work.
fn least_time(mut call: impl FnMut()) -> f64 {
    let mut batch = |count: u32| {
        let begin = Instant::now();
        (0..count).for_each(|_| call());
        begin.elapsed().as_secs_f64() / f64::from(count)
    };
    let once = batch(3).max(1e-9);
    let count = (1e-3 / once).clamp(3.0, 1e5) as u32;
    (0..51).map(|_| batch(count)).fold(f64::INFINITY, f64::min)
}

/// Compressed columns in declaration order, and the place of each entry in the compiled Jacobian.
struct Columns {
    pointers: Vec<i32>,
    rows: Vec<i32>,
    entries: Vec<usize>,
}

impl Equations {
    /// The equations of a model; `parameters` replace the defaults.
    ///
    /// # Errors
    /// A fault of the compiler.
    pub fn new(model: &Arc<CompiledModel>, parameters: &[(usize, f64)]) -> PyResult<Self> {
        let catalogue = Catalogue::new(model);
        let mut nominal = CompiledSystem::new(model.clone()).map_err(|e| SimulationError::new_err(e.to_string()))?;
        let draws = &model.interface().draws;
        for (at, draw) in nominal.region_mut(Region::Draw).iter_mut().zip(draws) {
            *at = if draw.kind == Variate::Uniform { 0.5 } else { 0.0 };
        }
        set_parameters(&mut nominal, parameters.iter().copied());
        if model.interface().steady.is_some() {
            let guess = steady::guess(&nominal, &catalogue);
            if steady::solve_declared(&mut nominal, &catalogue, &guess).is_err() {
                steady::forget(&mut nominal);
            }
        }
        let order: Vec<usize> = catalogue.states.elements().iter().chain(catalogue.solved.elements()).map(|e| e.at).collect();
        let n = model.unknowns();
        Ok(Self {
            jacobian: Columns::new(&nominal, &order),
            values: vec![0.0; nominal.pattern().entries()],
            work: nominal.clone(),
            y: vec![0.0; n],
            yp: vec![0.0; n],
            out: vec![0.0; n],
            catalogue,
            nominal,
            order,
        })
    }

    /// Residual at a point.
    pub fn residual(&mut self, t: f64, y: &[f64], yp: &[f64], u: &[f64], given: &Given, out: &mut [f64]) -> PyResult<()> {
        self.prepare(t, y, Some(yp), u, given)?;
        let (model, memory) = self.work.parts();
        model.residual(memory, t, &self.y, &self.yp, &mut self.out);
        for (out, &at) in out.iter_mut().zip(&self.order) {
            *out = self.out[at];
        }
        Ok(())
    }

    /// Values, rows and column pointers of dF/dy + cj dF/dy'.
    pub fn jacobian(
        &mut self,
        t: f64,
        y: &[f64],
        yp: &[f64],
        u: &[f64],
        cj: f64,
        given: &Given,
    ) -> PyResult<(Vec<f64>, Vec<i32>, Vec<i32>)> {
        self.prepare(t, y, Some(yp), u, given)?;
        let (model, memory) = self.work.parts();
        model.jacobian(memory, t, &self.y, &self.yp, cj, &mut self.values);
        let values = self.jacobian.entries.iter().map(|&entry| self.values[entry]).collect();
        Ok((values, self.jacobian.rows.clone(), self.jacobian.pointers.clone()))
    }

    /// Seconds of one residual and of one Jacobian at a point: the least mean of batches that last
    /// a millisecond.
    pub fn times(&mut self, t: f64, y: &[f64], u: &[f64], cj: f64) -> PyResult<(f64, f64)> {
        self.prepare(t, y, None, u, &Given::new())?;
        let (model, memory) = self.work.parts();
        let residual = least_time(|| model.residual(memory, t, black_box(&self.y), &self.yp, &mut self.out));
        let jacobian = least_time(|| model.jacobian(memory, t, black_box(&self.y), &self.yp, cj, &mut self.values));
        Ok((residual, jacobian))
    }

    /// Rates of the states of an explicit model.
    pub fn rhs(&mut self, t: f64, y: &[f64], u: &[f64], given: &Given, out: &mut [f64]) -> PyResult<()> {
        let model = self.work.model().clone();
        if !model.explicit() {
            return Err(PyValueError::new_err("the model is not explicit in its rates: use residual"));
        }
        self.prepare(t, y, None, u, given)?;
        let (model, memory) = self.work.parts();
        model.residual(memory, t, &self.y, &self.yp, &mut self.out);
        for (out, &at) in out.iter_mut().zip(&self.order) {
            *out = self.out[at];
        }
        Ok(())
    }

    /// Steady state at the actions `u`. `fixed` are positions of states and their values, by
    /// default those of the model; `begin` are positions of unknowns and their initial guesses.
    pub fn steady_state(&mut self, u: &[f64], given: &Given, fixed: &[(usize, f64)], begin: &[(usize, f64)]) -> PyResult<Vec<f64>> {
        self.work.restore(self.nominal.memory().all());
        let mut guess = self.first_guess();
        for &(i, value) in begin {
            guess[self.order[i]] = value;
        }
        self.y.copy_from_slice(&guess);
        self.set_given(given)?;
        let mut y = guess;
        let (_, declared) = steady::declared(&mut self.work, &self.catalogue, &mut y);
        let held_states: Held = match fixed {
            [] => declared,
            some => Held { states: some.iter().map(|&(i, value)| (self.order[i], value)).collect(), ..Held::default() },
        };
        let mut held = Vec::new();
        for (role, region) in [(Role::Discrete, Region::Discrete), (Role::Disturbance, Region::Disturbance)] {
            held.extend(self.places(role, given)?.into_iter().map(|(at, value)| (region, at, value)));
        }
        let found = steady::solve_held(&mut self.work, &self.catalogue, u, &held_states, &held, &mut y);
        found.and_then(|report| report.refuse_moving(&self.catalogue)).map_err(|e| steady_error(&e))?;
        Ok(self.order.iter().map(|&at| y[at]).collect())
    }

    /// Trim: the steady state and the actions of which those at positions `free` are found, so that
    /// unknowns at positions `fixed` have given values.
    pub fn trim(
        &mut self,
        u: &[f64],
        given: &Given,
        fixed: &[(usize, f64)],
        free: Vec<usize>,
        begin: &[(usize, f64)],
    ) -> PyResult<(Vec<f64>, Vec<f64>)> {
        self.work.restore(self.nominal.memory().all());
        let mut y = self.first_guess();
        begin.iter().for_each(|&(i, value)| y[self.order[i]] = value);
        self.y.copy_from_slice(&y);
        self.set_given(given)?;
        let held = Held { states: fixed.iter().map(|&(i, value)| (self.order[i], value)).collect(), free, ..Held::default() };
        let mut values = Vec::new();
        for (role, region) in [(Role::Discrete, Region::Discrete), (Role::Disturbance, Region::Disturbance)] {
            values.extend(self.places(role, given)?.into_iter().map(|(at, value)| (region, at, value)));
        }
        steady::solve_held(&mut self.work, &self.catalogue, u, &held, &values, &mut y).map_err(|e| steady_error(&e))?;
        let region = self.work.region(Region::Action);
        let actions = self.catalogue.actions.elements().iter().map(|e| region[e.at]).collect();
        Ok((self.order.iter().map(|&at| y[at]).collect(), actions))
    }

    /// Returns `true` if an equation reads values of the start of the episode, of the end of the
    /// step before or of the steady state.
    pub fn reads_other_instants(&self) -> bool {
        self.nominal.reads_other_instants()
    }

    /// Linearisation at a point, where given discrete variables and disturbances are within bounds.
    pub fn linearize(&mut self, y: &[f64], u: &[f64], given: &Given) -> PyResult<Linearization> {
        for &(role, element, value) in given.iter().filter(|(role, ..)| *role != Role::Parameter) {
            let found = role.family(&self.catalogue).elements().get(element);
            found.map_or(Ok(()), |found| found.check_bounds(value)).map_err(|e| PyValueError::new_err(format!("p: {e}")))?;
        }
        self.prepare(0.0, y, None, u, given)?;
        linearize::linearize(&mut self.work, &self.catalogue, 0.0, &self.y).map_err(|e| SimulationError::new_err(e.to_string()))
    }

    /// The model's steady state where it has one, else its declared values.
    fn first_guess(&self) -> Vec<f64> {
        let steady = self.nominal.region(Region::Steady(FramePart::Y));
        if self.nominal.model().interface().steady.is_some() && steady.iter().all(|x| x.is_finite()) {
            steady.to_vec()
        } else {
            steady::guess(&self.nominal, &self.catalogue)
        }
    }

    /// Puts a point into the instance.
    fn prepare(&mut self, t: f64, y: &[f64], yp: Option<&[f64]>, u: &[f64], given: &Given) -> PyResult<()> {
        self.work.restore(self.nominal.memory().all());
        self.yp.fill(0.0);
        for (i, &at) in self.order.iter().enumerate() {
            self.y[at] = y[i];
            if let Some(yp) = yp {
                self.yp[at] = yp[i];
            }
        }
        self.keep_start(u);
        self.set_given(given)?;
        self.keep_start(u);
        for builtin in [Builtin::Clock, Builtin::Begin] {
            self.work.region_mut(Region::Builtin)[builtin as usize] = t;
        }
        let (model, memory) = self.work.parts();
        model.prepare_step(memory);
        self.work.look_back(t, &self.y, &self.yp);
        Ok(())
    }

    /// An episode begins at the point, with nominal actions until `u` is applied: `initial(x)` and
    /// `previous(x)` are x, as in one step from there.
    fn keep_start(&mut self, u: &[f64]) {
        let actions = self.catalogue.actions.elements();
        actions.iter().for_each(|e| self.work.region_mut(Region::Action)[e.at] = e.default);
        [Region::Initial, Region::Previous].into_iter().for_each(|instant| self.work.keep(&self.y, instant));
        actions.iter().zip(u).for_each(|(e, &value)| self.work.region_mut(Region::Action)[e.at] = value);
    }

    /// Sets parameters, discrete variables and disturbances; those that are not given have their
    /// initial values.
    fn set_given(&mut self, given: &Given) -> PyResult<()> {
        let parameters = self.places(Role::Parameter, given)?;
        if !parameters.is_empty() {
            set_parameters(&mut self.work, parameters.into_iter());
            parameters::check_computed(&self.catalogue.parameters, &self.work).map_err(refused)?;
        }
        let (discretes, disturbances) = (&self.catalogue.discretes, &self.catalogue.disturbances);
        if discretes.is_empty() && disturbances.is_empty() {
            return Ok(());
        }
        let discrete_values = self.places(Role::Discrete, given)?;
        let disturbance_values = self.places(Role::Disturbance, given)?;
        let mut y = self.y.clone();
        let (model, memory) = self.work.parts();
        model.initial_discretes(memory, &mut y);
        for (region, values) in [(Region::Discrete, discrete_values), (Region::Disturbance, disturbance_values)] {
            for (at, value) in values {
                self.work.region_mut(region)[at] = value;
            }
        }
        Ok(())
    }

    /// Places and values given for a role.
    fn places(&self, role: Role, given: &Given) -> PyResult<Vec<(usize, f64)>> {
        let mine = given.iter().filter(|(of, _, _)| *of == role);
        mine.map(|&(_, element, value)| match role.family(&self.catalogue).elements().get(element) {
            Some(found) if role == Role::Parameter => parameters::check(found, value).map(|()| (found.at, value)).map_err(refused),
            Some(found) => Ok((found.at, value)),
            None => Err(PyValueError::new_err(format!("there is no {} number {element}", role.name()))),
        })
        .collect()
    }
}

impl Columns {
    fn new(system: &CompiledSystem, order: &[usize]) -> Self {
        let pattern = system.pattern();
        let mut outside = vec![0; order.len()];
        for (i, &at) in order.iter().enumerate() {
            outside[at] = i;
        }
        let mut columns = Self { pointers: vec![0], rows: Vec::new(), entries: Vec::new() };
        for &column in order {
            let mut entries: Vec<(usize, usize)> = pattern.column(column).map(|entry| (outside[pattern.rows()[entry]], entry)).collect();
            entries.sort_unstable();
            columns.rows.extend(entries.iter().map(|&(row, _)| row as i32));
            columns.entries.extend(entries.iter().map(|&(_, entry)| entry));
            columns.pointers.push(columns.rows.len() as i32);
        }
        columns
    }
}

/// Sets parameters, computes the dependent ones, and prepares what depends on them.
fn set_parameters(system: &mut CompiledSystem, given: impl Iterator<Item = (usize, f64)>) {
    for (at, value) in given {
        system.region_mut(Region::Param)[at] = value;
        system.region_mut(Region::ParamGiven)[at] = 1.0;
    }
    let (model, memory) = system.parts();
    model.parameters(memory);
    model.prepare_parameters(memory);
}

fn refused(error: ParameterError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

fn steady_error(error: &SteadyError) -> PyErr {
    SimulationError::new_err(error.to_string())
}
