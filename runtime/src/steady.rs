//! Steady states: F(y, y' = 0) = 0 with given actions.
//!
//! States that the equations leave free (an integrating level) are fixed by the caller, and their rows are dropped. The search
//! is Newton's method, damped by the natural monotonicity test (Deuflhard, Newton Methods for Nonlinear Problems, section 3.3), with the
//! exact Jacobian. Where it does not converge, pseudo-transient continuation (Kelley and Keyes, SIAM J. Numer. Anal. 35 (1998) 508-523)
//! follows the process itself to rest first, so that what is found is a stable state near the guess.

mod newton;

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::layout::{Part, Region};

use crate::catalogue::{Catalogue, UnknownName};
use crate::solver::SolveError;
use crate::system::CompiledSystem;
use newton::Search;

/// Rounds between unknowns and discrete variables: each passes a held value one unit further down a flowsheet.
const MAX_ROUNDS: u32 = 100;
/// Change of a discrete variable, relative to its value and scale, that counts as none.
const SETTLED: f64 = 1e-14;
/// What a frame holds.
const PARTS: [Part; 4] = [Part::Y, Part::Action, Part::Discrete, Part::Disturbance];

/// How well a steady state was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteadyReport {
    /// Euclidean norm of the rows that were solved: all but those of fixed states, in the model's units.
    pub residual_norm: f64,
    /// Largest rate of a fixed state and its place in `y`: how far what is held is from rest. `None` where nothing is fixed.
    pub held: Option<(usize, f64)>,
    /// Newton iterations and pseudo-time steps.
    pub iterations: u32,
}

/// Why no steady state was found.
#[derive(Debug, thiserror::Error)]
pub enum SteadyError {
    /// Neither Newton's method nor the process itself came to rest.
    #[error(
        "no steady state was found: after {iterations} iterations the largest residual is {residual:e}, in the {equation}; give a better initial value, or fix a state that integrates"
    )]
    NotFound {
        /// Iterations made.
        iterations: u32,
        /// Largest residual.
        residual: f64,
        /// Its equation.
        equation: String,
    },
    /// The equations do not determine all unknowns.
    #[error("the steady state is not determined{}: fix a state that integrates ({})", unknown.as_ref().map_or(String::new(), |u| format!(" (unknown `{u}`)")), fixing(unknown.as_deref()))]
    Undetermined {
        /// An unknown that is free, where known.
        unknown: Option<String>,
    },
    /// An equation is NaN or infinite at the first guess.
    #[error("the {equation} is not finite at the first guess")]
    NotFinite {
        /// The equation.
        equation: String,
    },
    /// Somebody wanted the search to stop, see [`crate::interrupt`].
    #[error("the search was interrupted")]
    Interrupted,
    /// A name that the model does not have.
    #[error(transparent)]
    UnknownName(#[from] UnknownName),
    /// The linear solver.
    #[error(transparent)]
    Solver(#[from] SolveError),
}

/// How a free unknown is fixed, in words.
fn fixing(unknown: Option<&str>) -> String {
    let name = unknown.unwrap_or("h");
    let named = if unknown.is_some() { "" } else { "for example " };
    format!("{named}`steady {{ {name} = ... }}` in the model, or `--fix {name}=...`")
}

/// A first guess: the declared values of states and solved variables.
#[must_use]
pub fn guess(system: &CompiledSystem, catalogue: &Catalogue) -> Vec<f64> {
    let mut y = vec![0.0; system.model().unknowns()];
    for element in catalogue.states.elements().iter().chain(catalogue.solved.elements()) {
        if element.default.is_finite() {
            y[element.at] = element.default;
        }
    }
    y
}

/// The actions and fixed states (places in `y` and values) of the model's `steady` block; nominal actions without one.
#[must_use]
pub fn declared(system: &mut CompiledSystem, catalogue: &Catalogue, y: &mut [f64]) -> (Vec<f64>, Vec<(usize, f64)>) {
    let (model, memory) = system.parts();
    let interface = model.interface();
    let actions = catalogue.actions.elements();
    if !interface.has_steady {
        return (actions.iter().map(|a| a.default).collect(), Vec::new());
    }
    let mut out = vec![0.0; actions.len() + interface.steady_fixed.len()];
    model.steady(memory, y, &mut out);
    let states = out.split_off(actions.len());
    (out, interface.steady_fixed.iter().map(|&at| at as usize).zip(states).collect())
}

/// Finds the model's own steady state and keeps it in the steady frame of the instance. The instance's actions and
/// discrete variables are those of the steady state afterwards.
///
/// # Errors
/// See [`SteadyError`].
pub fn solve_declared(system: &mut CompiledSystem, catalogue: &Catalogue, guess: &[f64]) -> Result<SteadyReport, SteadyError> {
    let mut y = guess.to_vec();
    let (actions, fixed) = declared(system, catalogue, &mut y);
    let report = solve(system, catalogue, &actions, &fixed, &mut y)?;
    system.keep(&y, Region::Steady);
    Ok(report)
}

/// Finds a steady state near `y` for actions (in their order) and fixed states (places in `y` and values).
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
    solve_given(system, catalogue, actions, fixed, &[], y)
}

/// A value in place of the one that the model computes: its region, its place there, the value.
pub type GivenValue = (Region, usize, f64);

/// As [`solve`], with discrete variables or disturbances held at given values.
///
/// # Errors
/// See [`SteadyError`].
pub fn solve_given(
    system: &mut CompiledSystem,
    catalogue: &Catalogue,
    actions: &[f64],
    fixed: &[(usize, f64)],
    given: &[GivenValue],
    y: &mut [f64],
) -> Result<SteadyReport, SteadyError> {
    let region = system.region_mut(Region::Action);
    for (element, &value) in catalogue.actions.elements().iter().zip(actions) {
        region[element.at] = value;
    }
    let mut is_fixed = vec![false; y.len()];
    for &(at, value) in fixed {
        y[at] = value;
        is_fixed[at] = true;
    }
    let frame = PARTS.map(|part| system.region(Region::Steady(part)).to_vec());
    let iterations = settle(system, catalogue, &is_fixed, given, y);
    for (part, values) in PARTS.into_iter().zip(&frame) {
        system.region_mut(Region::Steady(part)).copy_from_slice(values);
    }
    let iterations = iterations?;
    let (model, memory) = system.parts();
    model.prepare_step(memory);
    Ok(report(system, &is_fixed, y, iterations))
}

/// Unknowns and discrete variables that belong to each other: a discrete variable stands for its initial value, which may be an
/// expression of the steady state. The steady frame is that of the state on the way.
fn settle(
    system: &mut CompiledSystem,
    catalogue: &Catalogue,
    fixed: &[bool],
    given: &[GivenValue],
    y: &mut [f64],
) -> Result<u32, SteadyError> {
    let mut search = Search::new(system, catalogue, fixed)?;
    let mut iterations = 0;
    for round in 0..MAX_ROUNDS {
        let before = system.region(Region::Discrete).to_vec();
        system.keep(y, Region::Steady);
        let (model, memory) = system.parts();
        model.initial_discretes(memory, y);
        for &(region, at, value) in given {
            system.region_mut(region)[at] = value;
        }
        let (model, memory) = system.parts();
        model.prepare_step(memory);
        if round == 0 {
            settle_algebraic(system, catalogue, y);
        } else if unchanged(catalogue, &before, system.region(Region::Discrete)) {
            break;
        }
        iterations += search.run(system, catalogue, y)?;
    }
    Ok(iterations)
}

/// Makes the solved variables fit the guessed states where that is possible: their own guesses are often none.
fn settle_algebraic(system: &mut CompiledSystem, catalogue: &Catalogue, y: &mut [f64]) {
    let states = system.model().states();
    if states == y.len() {
        return;
    }
    let is_state: Vec<bool> = (0..y.len()).map(|at| at < states).collect();
    let mut trial = y.to_vec();
    let found = Search::new(system, catalogue, &is_state).and_then(|mut search| search.run(system, catalogue, &mut trial));
    if found.is_ok() {
        y.copy_from_slice(&trial);
    }
}

/// Whether no discrete variable moved, beyond rounding.
fn unchanged(catalogue: &Catalogue, before: &[f64], after: &[f64]) -> bool {
    catalogue.discretes.elements().iter().all(|e| {
        let (a, b) = (before[e.at], after[e.at]);
        a.to_bits() == b.to_bits() || (a - b).abs() <= SETTLED * a.abs().max(b.abs()).max(e.scale)
    })
}

fn report(system: &mut CompiledSystem, fixed: &[bool], y: &[f64], iterations: u32) -> SteadyReport {
    let (zero, mut out) = (vec![0.0; y.len()], vec![0.0; y.len()]);
    let (model, memory) = system.parts();
    model.residual(memory, 0.0, y, &zero, &mut out);
    let residual_norm = out.iter().zip(fixed).filter(|(_, fixed)| !**fixed).fold(0.0, |sum, (r, _)| sum + r * r).sqrt();
    let rates = out.iter().map(|r| r.abs()).enumerate().filter(|&(at, _)| fixed[at]);
    SteadyReport { residual_norm, held: rates.max_by(|a, b| a.1.total_cmp(&b.1)), iterations }
}

/// Name of the unknown at a place in `y`.
fn unknown_name(catalogue: &Catalogue, at: usize) -> Option<String> {
    let mut all = catalogue.states.elements().iter().chain(catalogue.solved.elements());
    all.find(|e| e.at == at).map(|e| e.name.clone())
}

fn equation_name(model: &CompiledModel, catalogue: &Catalogue, at: usize) -> String {
    crate::failure::describe_equation(at, model, catalogue, None)
}
