//! Bounds of the unknowns, in the messages of a search for a steady state.

use super::error::{AtBound, SteadyError};
use super::problem::Problem;
use crate::catalogue::{Catalogue, Element};
pub(super) use crate::solver::Bounds;

/// The bounds of states and solved variables, and of free `actions` behind the `n` unknowns.
pub(super) fn of(catalogue: &Catalogue, n: usize, actions: &[usize]) -> Bounds {
    let of_actions = catalogue.actions.elements().iter();
    let behind = of_actions.filter_map(|e| Some(Element { at: n + actions.iter().position(|&at| at == e.at)?, ..e.clone() }));
    let behind: Vec<Element> = behind.collect();
    Bounds::new(all(catalogue).chain(&behind), n + actions.len())
}

/// The free unknown that is nearest to one of its bounds, or furthest beyond it, if that is less
/// than a hundredth of its range away.
pub(super) fn reached(bounds: &Bounds, problem: &Problem, catalogue: &Catalogue, y: &[f64]) -> Option<AtBound> {
    let free = &problem.free;
    let (low, high) = (&bounds.low, &bounds.high);
    let room = |at: usize| (y[at] - low[at]).min(high[at] - y[at]) / (high[at] - low[at]);
    let nearest = free.iter().copied().filter(|&at| room(at) < 0.01).min_by(|&a, &b| room(a).total_cmp(&room(b)))?;
    let element = problem.element(catalogue, nearest)?;
    let below = y[nearest] - low[nearest] < high[nearest] - y[nearest];
    let bound = if below { low[nearest] } else { high[nearest] };
    Some(AtBound { name: element.name.clone(), value: y[nearest], unit: element.unit.clone(), bound })
}

/// The refusal of a root with an unknown outside.
pub(super) fn refusal(bounds: &Bounds, problem: &Problem, catalogue: &Catalogue, at: usize, value: f64) -> SteadyError {
    let below = value < bounds.low[at];
    let element = problem.element(catalogue, at);
    SteadyError::Outside {
        name: element.map(|e| e.name.clone()).unwrap_or_default(),
        unit: element.map(|e| e.unit.clone()).unwrap_or_default(),
        bound: if below { bounds.low[at] } else { bounds.high[at] },
        value,
        below,
    }
}

fn all(catalogue: &Catalogue) -> impl Iterator<Item = &Element> {
    catalogue.states.elements().iter().chain(catalogue.solved.elements())
}
