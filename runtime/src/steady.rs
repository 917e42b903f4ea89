//! Steady states: F(y, y' = 0) = 0 with given actions.
//!
//! States that the equations leave free (an integrating level) are fixed by the caller, and their
//! rows are dropped. The search is Newton's method, damped by the natural monotonicity test
//! (Deuflhard, Newton Methods for Nonlinear Problems, section 3.3), with the exact Jacobian. Where
//! it does not converge, pseudo-transient continuation (Kelley and Keyes, SIAM J. Numer. Anal. 35
//! (1998) 508-523) follows the process itself to rest first, so that what is found is a stable
//! state near the guess. What is outside of the declared bounds is not taken: the process is
//! followed, the search kept inside, and other guesses are tried.
//!
//! At rest the start of the episode, the end of the last step and the steady state are the same
//! point. In the search `initial(x)`, `previous(x)` and `steady(x)` are x, and the Jacobian has
//! their derivatives.

mod bounds;
pub(crate) mod delays;
mod discretes;
mod error;
mod frames;
mod freedom;
mod kinks;
mod motion;
mod newton;
mod problem;

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::layout::{FramePart, Region};

use crate::catalogue::{Catalogue, Element};
use crate::linearize::rates_at;
use crate::solver::System;
use crate::system::CompiledSystem;
pub use discretes::changed_by_a_step;
pub use error::{AtBound, ConservedSum, Drift, Freedom, SteadyError};
use frames::Saved;
pub use frames::rest_at;
pub use kinks::kink;
pub(crate) use motion::Motion;
use newton::Search;
use problem::Given;

/// Rounds between unknowns and discrete variables: each passes a held value one unit further down a
/// flowsheet.
const MAX_ROUNDS: u32 = 100;
/// Change of a discrete variable, relative to its value and scale, that counts as none.
const SETTLED: f64 = 1e-14;
/// Content of a frame.
const PARTS: [FramePart; 4] = [FramePart::Y, FramePart::Action, FramePart::Discrete, FramePart::Disturbance];

/// Accuracy of a steady state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteadyReport {
    /// Euclidean norm of the rows that were solved: all but those of fixed states, in the model's
    /// units.
    pub residual_norm: f64,
    /// Largest rate of a fixed state, or of one whose row a condition took, and its place in `y`:
    /// how far what is held is from rest. `None` where nothing is fixed, or the equations do not
    /// determine the rates.
    pub held: Option<(usize, f64)>,
    /// Largest rate, relative to its scale, of another state, and its place in `y`, if it moves:
    /// where rates are coupled, it moves with a held one.
    pub moving: Option<(usize, f64)>,
    /// Newton iterations and pseudo-time steps.
    pub iterations: u32,
}

/// Other guesses from which [`others`] looks for steady states.
const GUESSES: u64 = 24;
/// Other guesses of the algebraic variables at given states, where their solution is outside of the
/// bounds.
const ALGEBRAIC_GUESSES: u64 = 8;
/// Unknowns beyond which it does not.
const MANY: usize = 100;
/// Difference of two steady states, relative to sizes and scales, that counts as none.
const SAME: f64 = 1e-6;

/// Unknowns of implicit models beyond which the rates of held states are not computed.
const MOST_RATES: usize = 3000;
/// A free state moves if its rate, in scales, is more than this part of that of a held one, and
/// than rounding leaves.
const MOVING: f64 = 1e-6;
const RESTING: f64 = 1e-9;

/// Fixed values of a search.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Held {
    /// States (places in `y`) and their values.
    pub states: Vec<(usize, f64)>,
    /// Conditions of the model's `steady` block, `A + B = 1`, by number.
    pub conditions: Vec<usize>,
    /// Actions that are found with the unknowns, by position: as many as states and conditions,
    /// which hold in addition to the equations (trim).
    pub free: Vec<usize>,
}

impl Held {
    /// Holds one more state; a condition that it occurs in is given up for it.
    ///
    /// # Errors
    /// If a condition cannot be differentiated.
    pub fn fix(&mut self, at: usize, value: f64, system: &mut CompiledSystem, y: &[f64]) -> Result<(), SteadyError> {
        self.states.retain(|(place, _)| *place != at);
        self.states.push((at, value));
        if !self.conditions.is_empty() {
            let concerned = problem::gradient(system, y)?;
            self.conditions.retain(|&c| !concerned.iter().any(|t| t.0 == c && t.1 == at));
        }
        Ok(())
    }
}

/// A first guess: the initial values of states where they do not depend on the steady state itself,
/// the declared values of the others.
#[must_use]
pub fn guess(system: &CompiledSystem, catalogue: &Catalogue) -> Vec<f64> {
    let mut y = vec![0.0; system.model().unknowns()];
    for element in catalogue.states.elements().iter().chain(catalogue.solved.elements()) {
        if element.default.is_finite() {
            y[element.at] = element.default;
        }
    }
    let mut initial = y.clone();
    let mut unknown = system.clone();
    for part in PARTS {
        unknown.region_mut(Region::Steady(part)).fill(f64::NAN);
    }
    let (model, memory) = unknown.parts();
    model.initial_states(memory, &mut initial);
    for element in catalogue.states.elements() {
        let value = initial[element.at];
        if value.is_finite() {
            y[element.at] = value;
        }
    }
    y
}

/// The actions and what the model's `steady` block holds; nominal actions without one.
#[must_use]
pub fn declared(system: &mut CompiledSystem, catalogue: &Catalogue, y: &mut [f64]) -> (Vec<f64>, Held) {
    let (model, memory) = system.parts();
    let interface = model.interface();
    let actions = catalogue.actions.elements();
    let Some(problem) = &interface.steady else {
        return (actions.iter().map(|a| a.default).collect(), Held::default());
    };
    let conditions = problem.conditions as usize;
    let mut out = vec![0.0; actions.len() + problem.fixed.len() + conditions];
    model.steady(memory, y, &mut out);
    let states = out.split_off(actions.len());
    let states = problem.fixed.iter().map(|&at| at as usize).zip(states).collect();
    let free = problem.free.iter().map(|&position| position as usize).collect();
    (out, Held { states, conditions: (0..conditions).collect(), free })
}

/// Sets all references to the missing steady state to NaN, which the equations may not need.
pub fn forget(system: &mut CompiledSystem) {
    for part in PARTS {
        system.region_mut(Region::Steady(part)).fill(f64::NAN);
    }
}

impl SteadyReport {
    /// Refuses a point where a state that is not held moves.
    ///
    /// # Errors
    /// [`SteadyError::Moving`].
    pub fn refuse_moving(&self, catalogue: &Catalogue) -> Result<(), SteadyError> {
        let Some((at, rate)) = self.moving else { return Ok(()) };
        Err(SteadyError::Moving { name: unknown_name(catalogue, at).unwrap_or_default(), rate })
    }
}

/// Finds the model's own steady state and keeps it in the steady frame of the instance. The
/// instance's actions and discrete variables are those of the steady state afterwards.
///
/// # Errors
/// See [`SteadyError`].
pub fn solve_declared(system: &mut CompiledSystem, catalogue: &Catalogue, guess: &[f64]) -> Result<SteadyReport, SteadyError> {
    let mut y = guess.to_vec();
    let (actions, held) = declared(system, catalogue, &mut y);
    let report = solve_held(system, catalogue, &actions, &held, &[], &mut y)?;
    report.refuse_moving(catalogue)?;
    system.keep(&y, Region::Steady);
    Ok(report)
}

/// Finds a steady state near `y` for actions (in their order) and fixed states (places in `y` and
/// values).
///
/// # Errors
/// See [`SteadyError`].
pub fn solve(
    system: &mut CompiledSystem,
    catalogue: &Catalogue,
    actions: &[f64],
    fixed: &[(usize, f64)],
    y: &mut [f64],
) -> Result<SteadyReport, SteadyError> {
    let held = Held { states: fixed.to_vec(), ..Held::default() };
    solve_held(system, catalogue, actions, &held, &[], y)
}

/// A value instead of the one that the model computes: its region, its place there, the value.
pub type GivenValue = (Region, usize, f64);

/// As [`solve`], with conditions, and with discrete variables or disturbances held at given values.
///
/// # Errors
/// See [`SteadyError`].
pub fn solve_held(
    system: &mut CompiledSystem,
    catalogue: &Catalogue,
    actions: &[f64],
    held: &Held,
    given: &[GivenValue],
    y: &mut [f64],
) -> Result<SteadyReport, SteadyError> {
    let region = system.region_mut(Region::Action);
    for (element, &value) in catalogue.actions.elements().iter().zip(actions) {
        region[element.at] = value;
    }
    let mut is_held = vec![false; y.len()];
    for &(at, value) in &held.states {
        y[at] = value;
        is_held[at] = true;
    }
    let saved = Saved::of(system);
    let free: Vec<usize> = held.free.iter().map(|&position| catalogue.actions.elements()[position].at).collect();
    let mut point = y.to_vec();
    point.extend(free.iter().map(|&at| system.region(Region::Action)[at]));
    let sought = Given { fixed: &is_held, conditions: &held.conditions, actions: &free };
    let found = settle(system, catalogue, sought, given, &mut point).map(|(iterations, replaced)| {
        y.copy_from_slice(&point[..y.len()]);
        replaced.into_iter().filter(|&row| row < y.len()).for_each(|row| is_held[row] = true);
        frames::rest_at(system, y);
        report(system, catalogue, &is_held, y, iterations)
    });
    saved.restore(system);
    let report = found?;
    let (model, memory) = system.parts();
    model.prepare_step(memory);
    Ok(report)
}

/// Unknowns and discrete variables that belong to each other: a discrete variable stands for its
/// initial value, which may be an expression of the steady state. The other instants are those of
/// the state on the way. Returns iterations and the rows that conditions replace.
fn settle(
    system: &mut CompiledSystem,
    catalogue: &Catalogue,
    sought: Given<'_>,
    given: &[GivenValue],
    y: &mut [f64],
) -> Result<(u32, Vec<usize>), SteadyError> {
    let n = sought.fixed.len();
    begin_round(system, given, &mut y[..n]);
    settle_algebraic(system, catalogue, &mut y[..n], sought.fixed);
    let mut search = Search::new(system, catalogue, sought, y)?;
    let mut iterations = 0;
    for round in 1..=MAX_ROUNDS {
        iterations += search.run(system, catalogue, y)?;
        let before = system.region(Region::Discrete).to_vec();
        begin_round(system, given, &mut y[..n]);
        let settled = unchanged(catalogue, &before, system.region(Region::Discrete));
        if (settled || round == MAX_ROUNDS) && search.problem.rests(system, y) {
            return Ok((iterations, search.problem.replaced().collect()));
        }
    }
    Err(search.not_at_rest(system, catalogue, y, iterations))
}

/// Takes the discrete variables that belong to a state at rest.
fn begin_round(system: &mut CompiledSystem, given: &[GivenValue], y: &mut [f64]) {
    frames::keep(system, y);
    let (model, memory) = system.parts();
    model.initial_discretes(memory, y);
    for &(region, at, value) in given {
        system.region_mut(region)[at] = value;
    }
    frames::rest_at(system, y);
}

/// Makes the solved variables fit the guessed states where that is possible: their own guesses are
/// often none.
fn settle_algebraic(system: &mut CompiledSystem, catalogue: &Catalogue, y: &mut [f64], fixed: &[bool]) {
    let states = system.model().states();
    // A variable that is held belongs to other states.
    if states == y.len() || fixed[states..].contains(&true) {
        return;
    }
    let is_state: Vec<bool> = (0..y.len()).map(|at| at < states).collect();
    let Ok(mut search) = Search::new(system, catalogue, Given { fixed: &is_state, conditions: &[], actions: &[] }, y) else { return };
    let (mut trial, mut first) = (y.to_vec(), None);
    for number in 0..=ALGEBRAIC_GUESSES {
        trial.copy_from_slice(y);
        if number > 0 {
            search.other_guess(number, &mut trial);
        }
        if search.run_once(system, &mut trial) {
            if search.is_inside(&trial) {
                first = Some(trial);
                break;
            }
            first.get_or_insert_with(|| trial.clone());
        } else if first.is_none() && number == 0 && !search.has_bounds() {
            break;
        }
    }
    if let Some(found) = first {
        y.copy_from_slice(&found);
    }
}

/// Returns `true` if no discrete variable moved, beyond rounding.
fn unchanged(catalogue: &Catalogue, before: &[f64], after: &[f64]) -> bool {
    catalogue.discretes.elements().iter().all(|e| {
        let (a, b) = (before[e.at], after[e.at]);
        a.to_bits() == b.to_bits() || (a - b).abs() <= SETTLED * a.abs().max(b.abs()).max(e.scale)
    })
}

/// Other steady states inside of the bounds than `y`, as far as searches from some other guesses
/// find them: `system` is at `y`.
#[must_use]
pub fn others(system: &CompiledSystem, catalogue: &Catalogue, actions: &[f64], held: &Held, y: &[f64]) -> Vec<Vec<f64>> {
    let mut found: Vec<Vec<f64>> = Vec::new();
    let mut fixed = vec![false; y.len()];
    held.states.iter().for_each(|&(at, _)| fixed[at] = true);
    let free = fixed.iter().filter(|fixed| !**fixed).count();
    if free == 0 || free > MANY || !held.free.is_empty() {
        return found;
    }
    for number in 0..GUESSES {
        let mut system = system.clone();
        let mut trial = y.to_vec();
        let Ok(mut search) = Search::new(&mut system, catalogue, Given { fixed: &fixed, conditions: &held.conditions, actions: &[] }, y)
        else {
            break;
        };
        search.other_guess(number, &mut trial);
        let near = search.run_once(&mut system, &mut trial) && search.is_inside(&trial);
        let known = |known: &[f64], trial: &[f64]| {
            is_same(catalogue.states.elements(), known, trial) && is_same(catalogue.solved.elements(), known, trial)
        };
        let is_new = |trial: &[f64]| !std::iter::once(y).chain(found.iter().map(Vec::as_slice)).any(|other| known(other, trial));
        // Discrete variables may depend on the steady state: once more with those that belong to
        // it.
        if near && is_new(&trial) && solve_held(&mut system, catalogue, actions, held, &[], &mut trial).is_ok() && is_new(&trial) {
            found.push(trial);
        }
    }
    found
}

/// Returns `true` if two points have the same values of some states and solved variables, to the
/// tolerance for distinct steady states.
#[must_use]
pub fn is_same(elements: &[Element], a: &[f64], b: &[f64]) -> bool {
    elements.iter().all(|e| {
        let (a, b) = (a[e.at], b[e.at]);
        (a - b).abs() <= SAME * a.abs().max(b.abs()).max(if e.scale.is_finite() { e.scale.abs() } else { 1.0 })
    })
}

fn report(system: &mut CompiledSystem, catalogue: &Catalogue, fixed: &[bool], y: &[f64], iterations: u32) -> SteadyReport {
    let (zero, mut out) = (vec![0.0; y.len()], vec![0.0; y.len()]);
    system.look_back(0.0, y, &zero);
    let (model, memory) = system.parts();
    model.residual(memory, 0.0, y, &zero, &mut out);
    let residual_norm = out.iter().zip(fixed).filter(|(_, fixed)| !**fixed).fold(0.0, |sum, (r, _)| sum + r * r).sqrt();
    let report = SteadyReport { residual_norm, held: None, moving: None, iterations };
    if !fixed.contains(&true) || !system.is_explicit() && y.len() > MOST_RATES {
        return report;
    }
    let Ok(rates) = rates_at(system, y) else { return report };
    let mut scales = vec![1.0; y.len()];
    for element in catalogue.states.elements().iter().filter(|e| e.scale.is_finite() && e.scale > 0.0) {
        scales[element.at] = element.scale;
    }
    let size = |at: usize| (rates[at] / scales[at]).abs();
    let of = |held: bool| (0..system.model().states()).filter(move |&at| fixed[at] == held);
    let held = of(true).max_by(|&a, &b| rates[a].abs().total_cmp(&rates[b].abs()));
    let moving = of(false).max_by(|&a, &b| size(a).total_cmp(&size(b)));
    let largest = of(true).map(size).fold(0.0, f64::max);
    // An explicit rate of a free state is a residual of the search.
    let moves = |at: &usize| !system.is_explicit() && size(*at) > (MOVING * largest).max(RESTING);
    SteadyReport { held: held.map(|at| (at, rates[at])), moving: moving.filter(moves).map(|at| (at, rates[at])), ..report }
}

/// Name of the unknown at a place in `y`.
fn unknown_name(catalogue: &Catalogue, at: usize) -> Option<String> {
    let mut all = catalogue.states.elements().iter().chain(catalogue.solved.elements());
    all.find(|e| e.at == at).map(|e| e.name.clone())
}

fn equation_name(model: &CompiledModel, catalogue: &Catalogue, at: usize) -> String {
    match at.checked_sub(model.unknowns()) {
        None => crate::failure::describe_equation(at, model, catalogue, None),
        Some(condition) => format!("condition {} of the `steady` block", condition + 1),
    }
}
