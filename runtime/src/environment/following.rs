//! Declared states that follow from constraints: their values at the start are guesses of unknowns,
//! and must fit.

use std::collections::BTreeSet;
use std::sync::Arc;

use smpl_compiler::compiled::{Derived, WithRespectTo};
use smpl_compiler::model::Projected;

use super::Environment;
use super::reset::{ResetError, ResetOptions, Start, StateInput};
use crate::catalogue::Element;
use crate::failure::describe_equation;

/// Difference, relative to a value, from which a given value and the one that the equations demand
/// are two.
const FITS: f64 = 1e-6;

/// The same relative to the magnitude of the variable, where values are nearly zero.
const NEARLY_ZERO: f64 = 1e-9;

/// Most states for which a message proposes a start.
const SHOWN: usize = 4;

/// Most steps of Newton's method for such a start.
const MOST_STEPS: usize = 50;

impl Environment {
    /// Initial values that satisfy the constraints which bind states to each other.
    pub(super) fn initial_values(&mut self, options: &ResetOptions) -> Result<(), ResetError> {
        let settled = self.settle_initial_values(options);
        if options.start == Start::Steady {
            return settled.map(|_| ());
        }
        // Conditions at the start move states: the others follow, but for those that are given.
        if !self.setup.freed.pairs.is_empty() {
            return self.refuse_unfit(options, &settled?);
        }
        match settled {
            Ok(given) => self.refuse_unfit(options, &given)?,
            // Values off a constraint are often the reason.
            Err(error @ ResetError::Inconsistent { .. }) if self.setup.programs.start_passes == 0 => {
                return self.refuse_off_constraints(options).and(Err(error));
            }
            Err(error) => return Err(error),
        }
        self.refuse_off_constraints(options)
    }

    /// The values that were given to states which follow from constraints, by their places in `y`.
    pub(super) fn given_following(&self) -> Vec<(usize, f64)> {
        self.setup.catalogue.following.elements().iter().map(|e| (e.at, self.progress.y[e.at])).collect()
    }

    /// Refuses a start off the constraints that states are projected to. A whole array of states is
    /// taken as it is.
    pub(super) fn refuse_off_constraints(&mut self, options: &ResetOptions) -> Result<(), ResetError> {
        let setup = Arc::clone(&self.setup);
        let interface = setup.model().interface();
        if interface.reduction.projected.is_empty() || matches!(options.state, StateInput::Array(_)) {
            return Ok(());
        }
        let mut out = vec![0.0; 2 * interface.invariants.len()];
        let t = self.time();
        let (model, memory) = self.system.parts();
        model.invariants(memory, t, &self.progress.y, &self.progress.yp, &mut out);
        let pairs = |projected: &Projected| {
            let (first, count) = (2 * projected.invariant as usize, 2 * projected.count as usize);
            out.get(first..first + count).unwrap_or_default().chunks_exact(2)
        };
        let off = |projected: &'_ Projected| pairs(projected).position(|pair| pair[0].is_nan() || pair[0].abs() > FITS);
        let all = interface.reduction.projected.iter();
        let Some((projected, pass)) = all.filter_map(|projected| Some((projected, off(projected)?))).next() else { return Ok(()) };
        let place =
            setup.sources().map(|sources| format!(" at {}:{}", sources.name(projected.span.file), sources.locate(projected.span).line));
        let of = match projected.order {
            0 => "the equation",
            1 => "the time derivative of the equation",
            _ => "a time derivative of the equation",
        };
        // The states are listed by variable, and for each variable by pass of the loops.
        let own = projected.states.iter().skip(pass).step_by((projected.count as usize).max(1));
        let mut own: Vec<&Element> = own.filter_map(|name| setup.catalogue.states.find(name)).collect();
        // States that a constraint of lower order binds keep their values if others can move.
        let lower = self.bound_by(|one| one.order < projected.order);
        if own.iter().any(|state| !lower.contains(&state.at)) {
            own.retain(|state| !lower.contains(&state.at));
        }
        let row = projected.invariant as usize + pass;
        let fits: Vec<String> = own.iter().filter_map(|state| self.fitting(state, row)).take(SHOWN).collect();
        let names: Vec<&str> = own.iter().map(|state| state.name.as_str()).collect();
        let help = match fits.is_empty() {
            true => format!("change the initial values of `{}` so that it does", names.join("`, `")),
            false => format!("start {}", fits.join(", or ")),
        };
        let message = format!("inconsistent values: {of}{} does not hold at the start; {help}", place.unwrap_or_default());
        Err(ResetError::Inconsistent { message, start: None })
    }

    /// Places in `y` of the states that constraints move at the start.
    fn bound_by(&mut self, chosen: impl Fn(&Projected) -> bool) -> BTreeSet<usize> {
        let setup = Arc::clone(&self.setup);
        let projected = &setup.model().interface().reduction.projected;
        let first = projected.first().map_or(0, |one| one.invariant);
        let rows: BTreeSet<usize> = projected
            .iter()
            .filter(|one| chosen(one))
            .flat_map(|one| one.invariant..one.invariant + one.count)
            .map(|row| 2 * (row - first) as usize)
            .collect();
        let t = self.time();
        let (model, memory) = self.system.parts();
        let point = (&self.progress.y[..], &self.progress.yp[..]);
        let slopes = model.derivative(Derived::Constraints, WithRespectTo::Unknowns, memory, t, point).unwrap_or_default();
        slopes.into_iter().filter(|(row, _, slope)| rows.contains(row) && *slope != 0.0).map(|(_, at, _)| at).collect()
    }

    /// The start of one state that satisfies a constraint if the others keep theirs, by Newton's
    /// method.
    fn fitting(&mut self, state: &Element, row: usize) -> Option<String> {
        let setup = Arc::clone(&self.setup);
        let interface = setup.model().interface();
        let first = interface.reduction.projected.first()?.invariant as usize;
        let (t, mut y) = (self.time(), self.progress.y.clone());
        let (model, memory) = self.system.parts();
        let mut out = vec![0.0; 2 * interface.invariants.len()];
        let floor = NEARLY_ZERO * state.scale.abs();
        for _ in 0..MOST_STEPS {
            model.invariants(memory, t, &y, &self.progress.yp, &mut out);
            let point = (&y[..], &self.progress.yp[..]);
            let slopes = model.derivative(Derived::Constraints, WithRespectTo::Unknowns, memory, t, point).ok()?;
            let is_own = |entry: &&(usize, usize, f64)| (entry.0, entry.1) == (2 * (row - first), state.at);
            let slope: f64 = slopes.iter().filter(is_own).map(|entry| entry.2).sum();
            let change = -out[2 * row] / slope;
            if !change.is_finite() {
                return None;
            }
            y[state.at] += change;
            if change.abs() <= 1e-10 * y[state.at].abs() + floor {
                let value = y[state.at];
                let shown = format!("{value:.9e}").parse().unwrap_or(value);
                return (state.low..=state.high).contains(&value).then(|| format!("`{}` at {}", state.name, with_unit(shown, &state.unit)));
            }
        }
        None
    }

    /// Refuses given values that the constraints do not allow. Where a caller names states, or
    /// conditions move some, the others of a constraint follow.
    pub(super) fn refuse_unfit(&self, options: &ResetOptions, given: &[(usize, f64)]) -> Result<(), ResetError> {
        let setup = &self.setup;
        let all = setup.options.initial.is_empty() && setup.freed.pairs.is_empty();
        let is_named = |name: &str| match &options.state {
            StateInput::Start => all || setup.options.initial.contains_key(name) || setup.options.given_starts.contains(name),
            StateInput::Named(named) => named.contains_key(name),
            StateInput::Array(_) => false,
        };
        for &(at, value) in given {
            let Some(element) = setup.catalogue.following.elements().iter().find(|element| element.at == at) else { continue };
            let demanded = self.progress.y[at];
            let slack = FITS * value.abs().max(demanded.abs()) + NEARLY_ZERO * element.scale.abs();
            if (value - demanded).abs() <= slack || !demanded.is_finite() || !is_named(&element.name) {
                continue;
            }
            let equation = describe_equation(at, setup.model(), &setup.catalogue, setup.sources());
            let name = &element.name;
            let (value, demanded) = (with_unit(value, &element.unit), with_unit(demanded, &element.unit));
            let message = format!(
                "inconsistent values: `{name}` starts at {value}, but the {equation}, which binds it to other states, demands {demanded}; \
                 start `{name}` there, or change the other states of the equation"
            );
            return Err(ResetError::Inconsistent { message, start: None });
        }
        Ok(())
    }
}

/// A value with its unit.
fn with_unit(value: f64, unit: &str) -> String {
    if unit == "1" { value.to_string() } else { format!("{value} {unit}") }
}
