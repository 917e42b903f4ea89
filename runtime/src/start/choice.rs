//! The states that conditions at the start determine.

use std::fmt;

use smpl_dsl::diagnostic::{Diagnostic, SourceMap, codes};
use smpl_dsl::span::Span;

use super::blocks::{Matching, Unmatched};
use super::pivots::{self, Wish};
use super::problem::{Problem, Row};
use super::{Context, Sought};
use crate::catalogue::Catalogue;
use crate::system::CompiledSystem;

/// The states that become unknowns of the start.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Freed {
    /// Condition, by number, and the place in `y` of the state that it frees.
    pub pairs: Vec<(usize, usize)>,
}

/// Conditions at the start that determine too much.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct Conflict {
    /// The conditions, in words.
    pub conditions: Vec<String>,
    /// Equations that they bind together with, in words.
    pub equations: Vec<String>,
    /// Places of the conditions and of the equations.
    pub places: [Vec<Span>; 2],
}

impl Conflict {
    /// The conflict as an error of the text; `None` where no condition has a place.
    pub(crate) fn diagnostic(self) -> Option<Diagnostic> {
        let [mut conditions, equations] = self.places;
        let last = conditions.pop()?;
        let message = format!("{} conditions at the start are too many: no state is left for this one", conditions.len() + 1);
        let fault = Diagnostic::error(codes::OVERDETERMINED, message, last);
        let fault = conditions.iter().fold(fault, |fault, span| fault.secondary(*span, "another condition"));
        let fault = equations.iter().fold(fault, |fault, span| fault.secondary(*span, "holds at the start too"));
        Some(fault.help("remove a condition, or free another state: `initial eq ... free name`"))
    }
}

impl fmt::Display for Conflict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "too many conditions at the start: no state is left for {}", self.conditions.join(", "))?;
        if !self.equations.is_empty() {
            write!(f, ", with {}", self.equations.join(", "))?;
        }
        write!(f, "; remove a condition, or free another state: `initial eq ... free name`")
    }
}

impl Freed {
    /// Chooses a state for each condition: first those that it names, then those without a declared
    /// value, then others, in the order of their declaration. The choice is structural and does not
    /// depend on numbers, which [`by_numbers`](Self::by_numbers) reads.
    ///
    /// # Errors
    /// Conditions in which fewer states occur than there are conditions.
    pub(crate) fn choose(system: &mut CompiledSystem, catalogue: &Catalogue, sources: Option<&SourceMap>) -> Result<Self, Conflict> {
        let declared = system.model().interface().start_conditions.clone();
        if declared.is_empty() {
            return Ok(Self::default());
        }
        let count: usize = declared.iter().map(|c| c.count as usize).sum();
        let mut states: Vec<_> = catalogue.states.elements().iter().collect();
        states.sort_by_key(|state| state.default.is_finite());
        let (places, conditions): (Vec<usize>, Vec<usize>) = (states.iter().map(|s| s.at).collect(), (0..count).collect());
        let y = vec![0.0; system.model().unknowns()];
        let context = Context { catalogue, sources, time: 0.0, discretes: None };
        let mut problem = Problem::new(system, context, Sought { states: &places, conditions: &conditions }, &y);
        let incidence = problem.incidence();
        let algebraic = incidence.len() - count;
        let mut matching = Matching::new(problem.len());
        matching.closed[algebraic..].fill(true);
        let conflict = |problem: &Problem<'_>, unmatched: Unmatched| conflict(problem, unmatched);
        for row in 0..algebraic {
            matching.add(&incidence, row).map_err(|unmatched| conflict(&problem, unmatched))?;
        }
        let mut pairs = Vec::new();
        let mut number = 0;
        for condition in &declared {
            let named: Vec<usize> =
                (0..states.len()).filter(|&i| condition.free.contains(&states[i].name)).map(|i| algebraic + i).collect();
            for _ in 0..condition.count {
                let row = algebraic + number;
                named.iter().for_each(|&column| matching.closed[column] = false);
                let mut found = if named.is_empty() { Err(Unmatched { rows: vec![row] }) } else { matching.add(&incidence, row) };
                if found.is_err() && !condition.only {
                    matching.closed[algebraic..].fill(false);
                    found = matching.add(&incidence, row);
                }
                matching.closed[algebraic..].fill(true);
                let column = found.map_err(|unmatched| conflict(&problem, unmatched))?;
                pairs.push((number, problem.places[column]));
                number += 1;
            }
        }
        Ok(Self { pairs })
    }

    /// Chooses among all states again, by their effect on each condition near the guess `y`: first
    /// those that a condition names, then those that move it most. States that move it alike are
    /// taken in the order of [`choose`](Self::choose). Where the numbers determine nothing, the
    /// choice stays.
    #[must_use]
    pub(crate) fn by_numbers(self, system: &mut CompiledSystem, catalogue: &Catalogue, mut y: Vec<f64>) -> Self {
        let declared = system.model().interface().start_conditions.clone();
        if declared.is_empty() || y.len() > pivots::MOST {
            return self;
        }
        let wishes: Vec<Wish<'_>> = declared.iter().flat_map(|c| (0..c.count).map(|_| Wish { free: &c.free, only: c.only })).collect();
        let mut states: Vec<_> = catalogue.states.elements().iter().collect();
        states.sort_by_key(|state| state.default.is_finite());
        let (places, conditions): (Vec<usize>, Vec<usize>) = (states.iter().map(|s| s.at).collect(), (0..wishes.len()).collect());
        let context = Context { catalogue, sources: None, time: 0.0, discretes: None };
        let mut problem = Problem::new(system, context, Sought { states: &places, conditions: &conditions }, &y);
        let algebraic = problem.len() - places.len();
        let found = pivots::slopes(&mut problem, algebraic, &mut y).and_then(|slopes| pivots::choose(slopes, &wishes, &states));
        match found {
            Some(columns) => Self { pairs: columns.into_iter().map(|column| states[column].at).enumerate().collect() },
            None => self,
        }
    }

    /// The states that are unknowns and the conditions that hold where some states are `given`.
    pub(crate) fn without(&self, given: impl Fn(usize) -> bool) -> (Vec<usize>, Vec<usize>) {
        let kept = || self.pairs.iter().filter(|(_, state)| !given(*state));
        (kept().map(|p| p.1).collect(), kept().map(|p| p.0).collect())
    }
}

fn conflict(problem: &Problem<'_>, unmatched: Unmatched) -> Conflict {
    let texts = |condition: bool| {
        let rows = unmatched.rows.iter().copied().filter(|&row| matches!(problem.rows[row], Row::Condition(_)) == condition);
        rows.map(|row| problem.describe(row)).collect::<Vec<_>>()
    };
    let places = [true, false].map(|condition| {
        let rows = unmatched.rows.iter().copied().filter(|&row| matches!(problem.rows[row], Row::Condition(_)) == condition);
        let mut spans: Vec<Span> = rows.filter_map(|row| problem.place(row)).collect();
        spans.sort_unstable_by_key(|span| (span.file, span.start));
        spans.dedup();
        spans
    });
    Conflict { conditions: texts(true), equations: texts(false), places }
}
