//! Derivatives of the steady state by parameters: derivatives of the model's own steady problem at
//! its solution, by the implicit function theorem.

use smpl_compiler::compiled::tangent;
use smpl_compiler::layout::{FramePart, Region};

use super::problem::{Given, Problem};
use super::{MAX_ROUNDS, PARTS, declared, frames};
use crate::catalogue::{Catalogue, Element};
use crate::sensitivity::tangents::{Point, Tangents};
use crate::system::CompiledSystem;

/// Change of a derivative of a discrete variable, relative to its size and the variable's scale,
/// that counts as none.
const SETTLED: f64 = 1e-12;

/// Derivatives of the steady frame along directions, kept for as long as what they belong to is the
/// same.
#[derive(Default)]
pub(crate) struct Motion {
    /// Parameters, their derivatives, and the steady state.
    of: Vec<f64>,
    /// In the order of the workspace: for each of [`PARTS`] its numbers, for each number the
    /// directions.
    found: Vec<f64>,
}

impl Motion {
    /// Writes the derivatives of the steady frame into `tangents`, which have those of the
    /// parameters.
    ///
    /// # Errors
    /// A message, if the steady state has no derivatives.
    pub(crate) fn follow(&mut self, system: &CompiledSystem, catalogue: &Catalogue, tangents: &mut Tangents) -> Result<(), String> {
        let parameters = system.memory().layout().range(Region::Param);
        let mut of = system.region(Region::Param).to_vec();
        PARTS.iter().for_each(|&part| of.extend_from_slice(system.region(Region::Steady(part))));
        of.extend(parameters.flat_map(|cell| (0..tangents.width()).map(move |j| (cell, j))).map(|(cell, j)| tangents.work(cell, j)));
        if self.of != of {
            self.of.clear();
            let moved = moved(system, catalogue, tangents)?;
            self.found.clear();
            self.found.extend(places(system, tangents.width()).map(|(cell, j)| moved.work(cell, j)));
            self.of = of;
        }
        places(system, tangents.width()).zip(&self.found).for_each(|((cell, j), &value)| tangents.set_work(cell, j, value));
        Ok(())
    }
}

/// Numbers of the steady frame along each direction.
fn places(system: &CompiledSystem, width: usize) -> impl Iterator<Item = (usize, usize)> {
    let cells = PARTS.map(|part| system.memory().layout().range(Region::Steady(part)));
    cells.into_iter().flatten().flat_map(move |cell| (0..width).map(move |j| (cell, j)))
}

/// An instance at its steady state.
fn at_rest(system: &CompiledSystem) -> (CompiledSystem, Vec<f64>) {
    let mut there = system.clone();
    for (part, present) in
        [(FramePart::Action, Region::Action), (FramePart::Discrete, Region::Discrete), (FramePart::Disturbance, Region::Disturbance)]
    {
        there.region_mut(present).copy_from_slice(system.region(Region::Steady(part)));
    }
    let y = system.region(Region::Steady(FramePart::Y)).to_vec();
    frames::rest_at(&mut there, &y);
    (there, y)
}

/// Derivatives of an instance at its steady state. Fixed values and actions move by the `steady`
/// block, the unknowns by the equations, and discrete variables as their initial values, which
/// belong to the unknowns: as [`super::settle`] finds them.
fn moved(system: &CompiledSystem, catalogue: &Catalogue, parameters: &Tangents) -> Result<Tangents, String> {
    let (mut system, y) = at_rest(system);
    let (width, n, zero) = (parameters.width(), y.len(), vec![0.0; y.len()]);
    let point = Point { time: 0.0, moving: &[], y: &y, yp: &zero };
    let (_, held) = declared(&mut system, catalogue, &mut y.clone());
    let mut is_held = vec![false; n];
    held.states.iter().for_each(|&(at, _)| is_held[at] = true);
    let of_free: Vec<usize> = held.free.iter().map(|&position| catalogue.actions.elements()[position].at).collect();
    let mut whole = y.clone();
    whole.extend(of_free.iter().map(|&at| system.region(Region::Action)[at]));
    let given = Given { fixed: &is_held, conditions: &held.conditions, actions: &of_free };
    let mut problem = Problem::new(&mut system, catalogue, given, &whole).map_err(|e| e.to_string())?;
    problem.factorise(&mut system, &whole, 0.0).map_err(|_| "the steady state is not determined by the equations near it")?;
    let (free, replaced): (Vec<usize>, Vec<usize>) = (problem.free.clone(), problem.replaced().collect());

    let mut tangents = Tangents::new(&system, width);
    tangents.copy(parameters, system.memory().layout().range(Region::Param));
    let actions = catalogue.actions.elements();
    let (of_states, of_conditions) = (actions.len(), actions.len() + held.states.len());
    let declared_numbers = of_conditions + held.conditions.len();
    tangents.run(&system, tangent::TangentProgram::Steady, point, declared_numbers)?;
    let first = system.memory().layout().range(Region::Action).start;
    for j in 0..width {
        for (number, action) in actions.iter().enumerate() {
            tangents.set_work(first + action.at, j, tangents.output(number, j));
        }
        for (number, &(at, _)) in held.states.iter().enumerate() {
            tangents.set_y(at, j, tangents.output(of_states + number, j));
        }
    }
    // An unknown of the state, or an action that is found with it.
    let set = |tangents: &mut Tangents, at: usize, j: usize, value: f64| match at.checked_sub(n) {
        None => tangents.set_y(at, j, value),
        Some(action) => tangents.set_work(first + of_free[action], j, value),
    };
    let (mut rows, mut correction) = (vec![vec![0.0; problem.rows.len()]; width], vec![0.0; free.len()]);
    for _ in 0..MAX_ROUNDS {
        for j in 0..width {
            free.iter().for_each(|&at| set(&mut tangents, at, j, 0.0));
        }
        keep(&mut tangents, &system);
        tangents.run(&system, tangent::TangentProgram::Rows, point, n)?;
        rows.iter_mut().enumerate().for_each(|(j, row)| row[..n].iter_mut().enumerate().for_each(|(at, r)| *r = tangents.output(at, j)));
        if !replaced.is_empty() {
            tangents.run(&system, tangent::TangentProgram::Steady, point, declared_numbers)?;
            for (j, row) in rows.iter_mut().enumerate() {
                replaced.iter().enumerate().for_each(|(number, &at)| row[at] = tangents.output(of_conditions + number, j));
            }
        }
        for (j, row) in rows.iter().enumerate() {
            problem.rows.copy_from_slice(row);
            problem.correction(&mut correction);
            free.iter().zip(&correction).for_each(|(&at, &value)| set(&mut tangents, at, j, value));
        }
        keep(&mut tangents, &system);
        let before = discretes(&tangents, &system, catalogue);
        tangents.run(&system, tangent::TangentProgram::InitialDiscretes, point, 0)?;
        let after = discretes(&tangents, &system, catalogue);
        if before.iter().zip(&after).all(|((a, scale), (b, _))| (a - b).abs() <= SETTLED * a.abs().max(b.abs()).max(*scale)) {
            keep(&mut tangents, &system);
            return Ok(tangents);
        }
    }
    Err("the derivatives of the steady state by parameters do not settle between unknowns and discrete variables".into())
}

/// The other instants are those of the point itself.
fn keep(tangents: &mut Tangents, system: &CompiledSystem) {
    frames::INSTANTS.into_iter().for_each(|instant| tangents.keep(system, instant));
}

/// Derivatives of discrete variables and disturbances, with the scale of each.
fn discretes(tangents: &Tangents, system: &CompiledSystem, catalogue: &Catalogue) -> Vec<(f64, f64)> {
    let layout = system.memory().layout();
    let families: [(Region, &[Element]); 2] =
        [(Region::Discrete, catalogue.discretes.elements()), (Region::Disturbance, catalogue.disturbances.elements())];
    let cells = families.into_iter().flat_map(|(region, elements)| {
        let first = layout.range(region).start;
        elements.iter().map(move |e| (first + e.at, e.scale))
    });
    cells.flat_map(|(cell, scale)| (0..tangents.width()).map(move |j| (tangents.work(cell, j), scale))).collect()
}
