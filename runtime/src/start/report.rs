//! The report of a block of a start that has no solution.

use std::fmt;

use super::blocks::Block;
use super::problem::Problem;
use super::trail::{Trail, Tried};
use crate::failure::{Short, unit_suffix};

/// Unknowns and equations that a text shows.
const SHOWN: usize = 8;
/// Ratio of a value to its scale from which the scale is doubted.
const FAR: f64 = 1e6;

/// A block of a start without a solution.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StartFailure {
    /// Number of the block, from 1, and number of blocks.
    pub block: (usize, usize),
    /// Its unknowns.
    pub unknowns: Vec<StartUnknown>,
    /// Its equations.
    pub equations: Vec<StartEquation>,
    /// All that was tried, in order.
    pub tried: Vec<Tried>,
    /// Names of the unknowns that tries ended at the bounds of.
    pub at_bounds: Vec<String>,
    /// Unknowns whose size is far from their scale.
    pub badly_scaled: Vec<String>,
    /// Solutions outside of the bounds: values of the unknowns in their order.
    pub outside: Vec<Vec<f64>>,
    /// One proposal.
    pub help: String,
}

/// An unknown of a block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StartUnknown {
    /// Name of the state or variable.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Value from which the search began.
    pub guess: f64,
    /// Value at the point with the smallest residuals.
    pub value: f64,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
}

/// An equation of a block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StartEquation {
    /// Place and name: `equation at flash.eq:12, z`.
    pub text: String,
    /// Left less right side at the point with the smallest residuals.
    pub residual: f64,
}

/// The report of a block, from the guess and the nearest point.
pub(super) fn failure(
    problem: &mut Problem<'_>,
    block: &Block,
    number: (usize, usize),
    (guess, y): (&[f64], &[f64]),
    trail: Trail,
) -> StartFailure {
    problem.evaluate(y);
    let places: Vec<usize> = block.unknowns.iter().map(|&unknown| problem.places[unknown]).collect();
    let unknown = |&at: &usize| {
        let (name, unit) = problem.element(at).map(|e| (e.name.clone(), e.unit.clone())).unwrap_or_default();
        StartUnknown { name, unit, guess: guess[at], value: y[at], low: problem.bounds.low[at], high: problem.bounds.high[at] }
    };
    let unknowns: Vec<StartUnknown> = places.iter().map(unknown).collect();
    let equations = block.rows.iter().map(|&row| StartEquation { text: problem.describe(row), residual: problem.out[row] }).collect();
    let name = |at: usize| problem.element(at).map(|e| e.name.clone()).unwrap_or_default();
    let mut at_bounds: Vec<String> = trail.tried.iter().filter_map(|tried| tried.at_bound).map(name).collect();
    at_bounds.sort();
    at_bounds.dedup();
    let is_far = |&&at: &&usize| {
        let ratio = y[at].abs() / problem.scales[at];
        ratio > FAR || ratio > 0.0 && ratio < 1.0 / FAR
    };
    let badly_scaled: Vec<String> = places.iter().filter(is_far).map(|&at| name(at)).collect();
    let outside = trail.outside.iter().map(|found| places.iter().map(|&at| found[at]).collect()).collect();
    let mut out =
        StartFailure { block: number, unknowns, equations, tried: trail.tried, at_bounds, badly_scaled, outside, help: String::new() };
    out.help = help(&out, trail.not_finite, trail.singular.map(name));
    out
}

/// One proposal for a block.
fn help(failure: &StartFailure, not_finite: bool, singular: Option<String>) -> String {
    let first = failure.unknowns.first();
    let zero = failure.unknowns.iter().find(|u| u.guess == 0.0);
    if not_finite {
        let from = zero.or(first).map(|u| format!("`{}` starts at {}{}", u.name, Short(u.guess), unit_suffix(&u.unit)));
        return format!("{}, where an equation is not finite: give a guess, `var name = value`", from.unwrap_or_default());
    }
    if let Some(found) = failure.outside.first() {
        let beyond = failure.unknowns.iter().zip(found).find(|(u, x)| **x < u.low || **x > u.high);
        if let Some((u, x)) = beyond {
            let unit = unit_suffix(&u.unit);
            let (name, low, high) = (&u.name, Short(u.low), Short(u.high));
            return format!(
                "a solution has {name} = {}{unit}, outside its bounds {low}..{high}{unit}: check the bounds, or the values that the equations read",
                Short(*x)
            );
        }
    }
    if let (Some(zero), true) = (zero, singular.is_some() || failure.tried.iter().all(|t| t.iterations == 0)) {
        let unit = unit_suffix(&zero.unit);
        return format!(
            "`{}` starts at 0{unit}, where an equation has no finite or nonzero slope: give a guess, `var {} = value`",
            zero.name, zero.name
        );
    }
    if let Some(name) = failure.badly_scaled.first() {
        return format!("the size of `{name}` is far from its scale: give it a `scale`, and a guess near the solution");
    }
    match first {
        Some(u) => format!("check the values that these equations read, or give a guess near the solution: `var {} = value`", u.name),
        None => String::new(),
    }
}

impl fmt::Display for StartFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (number, count) = self.block;
        let plural = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        write!(f, "block {number} of {count}: {}", plural(self.unknowns.len(), "unknown"))?;
        for u in self.unknowns.iter().take(SHOWN) {
            let unit = unit_suffix(&u.unit);
            write!(f, "\n  {} = {}{unit}, guess {}{unit}", u.name, Short(u.value), Short(u.guess))?;
            if u.low.is_finite() || u.high.is_finite() {
                write!(f, ", bounds {}..{}{unit}", Short(u.low), Short(u.high))?;
            }
        }
        more(f, self.unknowns.len())?;
        for e in self.equations.iter().take(SHOWN) {
            write!(f, "\n  {}: residual {}", e.text, Short(e.residual))?;
        }
        more(f, self.equations.len())?;
        write!(f, "\ntried:")?;
        for t in grouped(&self.tried) {
            write!(f, "\n  {t}")?;
        }
        if !self.at_bounds.is_empty() {
            write!(f, "\nat bounds: {}", self.at_bounds.join(", "))?;
        }
        if !self.badly_scaled.is_empty() {
            write!(f, "\nfar from their scale: {}", self.badly_scaled.join(", "))?;
        }
        write!(f, "\nhelp: {}", self.help)
    }
}

/// A line that counts what is not shown.
fn more(f: &mut fmt::Formatter<'_>, count: usize) -> fmt::Result {
    if count > SHOWN { write!(f, "\n  and {} more", count - SHOWN) } else { Ok(()) }
}

/// One line a try; other guesses share one.
fn grouped(tried: &[Tried]) -> Vec<String> {
    let is_other = |t: &&Tried| t.way.starts_with("another guess");
    let line = |way: &str, t: &Tried| {
        let end = if t.solved { ", a solution outside of the bounds" } else { "" };
        format!("{way}: {} iterations, largest residual {}{end}", t.iterations, Short(t.residual))
    };
    let others: Vec<&Tried> = tried.iter().filter(is_other).collect();
    let mut out = Vec::new();
    for t in tried {
        if !is_other(&t) {
            out.push(line(&t.way, t));
        } else if others.first().is_some_and(|first| std::ptr::eq(*first, t)) {
            let best = others.iter().copied().min_by(|a, b| a.residual.total_cmp(&b.residual)).unwrap_or(t);
            out.push(line(&format!("{} other guesses, the best", others.len()), best));
        }
    }
    out
}
