//! Declared states that follow from constraints: their values at the start are guesses of unknowns,
//! and must fit.

use std::sync::Arc;

use smpl_compiler::model::Projected;

use super::Environment;
use super::reset::{ResetError, ResetOptions, StateInput};
use crate::failure::describe_equation;

/// Difference, relative to a value, from which a given value and the one that the equations demand
/// are two.
const FITS: f64 = 1e-6;

/// The same relative to the magnitude of the variable, where values are nearly zero.
const NEARLY_ZERO: f64 = 1e-9;

impl Environment {
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
        let off = |projected: &&Projected| {
            let (first, count) = (2 * projected.invariant as usize, 2 * projected.count as usize);
            out.get(first..first + count).is_some_and(|pairs| pairs.chunks_exact(2).any(|pair| pair[0].abs() > FITS))
        };
        let Some(projected) = interface.reduction.projected.iter().find(off) else { return Ok(()) };
        let place =
            setup.sources().map(|sources| format!(" at {}:{}", sources.name(projected.span.file), sources.locate(projected.span).line));
        let of = match projected.order {
            0 => "the equation",
            1 => "the time derivative of the equation",
            _ => "a time derivative of the equation",
        };
        let (place, states) = (place.unwrap_or_default(), projected.states.join("`, `"));
        let message =
            format!("inconsistent values: {of}{place} does not hold at the start; change the initial values of `{states}` so that it does");
        Err(ResetError::Inconsistent { message, start: None })
    }

    /// Refuses given values that the constraints do not allow. Where a caller names states, the
    /// others of a constraint follow.
    pub(super) fn refuse_unfit(&self, options: &ResetOptions, given: &[(usize, f64)]) -> Result<(), ResetError> {
        let setup = &self.setup;
        let is_named = |name: &str| match &options.state {
            StateInput::Start => setup.options.initial.is_empty() || setup.options.initial.contains_key(name),
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
            let unit = if element.unit == "1" { String::new() } else { format!(" {}", element.unit) };
            let name = &element.name;
            let message = format!(
                "inconsistent values: `{name}` starts at {value}{unit}, but the {equation}, which binds it to other states, demands {demanded}{unit}; \
                 start `{name}` there, or change the other states of the equation"
            );
            return Err(ResetError::Inconsistent { message, start: None });
        }
        Ok(())
    }
}
