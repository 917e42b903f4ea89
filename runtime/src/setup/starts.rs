//! Conditions at the start of a model for readers of its text.

use std::sync::Arc;

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::model::StartCondition;
use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;

use super::{EnvironmentOptions, Setup, SetupError};
use crate::catalogue::Element;
use crate::failure::{Short, unit_suffix};

/// Names that one message shows.
const SHOWN: usize = 3;

/// Diagnostics of the conditions at the start. Conditions that determine too much are an error; a
/// statement that replaces declared values of states that it does not name is a warning.
#[must_use]
pub fn start_diagnostics(model: &Arc<CompiledModel>, options: &EnvironmentOptions) -> Vec<Diagnostic> {
    if model.interface().start_conditions.is_empty() {
        return Vec::new();
    }
    match Setup::without_steady(Arc::clone(model), options.clone(), None) {
        Ok(setup) => setup.replaced_starts(),
        Err(SetupError::Start(conflict)) => conflict.diagnostic().into_iter().collect(),
        // Every other call reports the error too.
        Err(_) => Vec::new(),
    }
}

impl Setup {
    /// The states that conditions at the start determine, each with its condition.
    pub fn determined_at_start(&self) -> impl Iterator<Item = (&StartCondition, &Element)> {
        let conditions = self.model().interface().start_conditions.iter();
        let each: Vec<&StartCondition> = conditions.flat_map(|c| std::iter::repeat_n(c, c.count as usize)).collect();
        let mut states: Vec<Option<&Element>> = vec![None; self.model().unknowns()];
        self.catalogue.states.elements().iter().for_each(|state| states[state.at] = Some(state));
        self.freed.pairs.iter().filter_map(move |&(number, at)| Some((*each.get(number)?, (*states.get(at)?)?)))
    }

    /// Warnings of declared values that conditions replace, one for each statement.
    fn replaced_starts(&self) -> Vec<Diagnostic> {
        let replaced = |(condition, state): &(&StartCondition, &Element)| {
            let given = self.options.initial.contains_key(&state.name) || self.options.given_starts.contains(&state.name);
            !given && !condition.free.contains(&state.name)
        };
        let mut statements: Vec<(&StartCondition, Vec<&Element>)> = Vec::new();
        for (condition, state) in self.determined_at_start().filter(replaced) {
            match statements.last_mut() {
                Some((last, states)) if std::ptr::eq(*last, condition) => states.push(state),
                _ => statements.push((condition, vec![state])),
            }
        }
        statements.into_iter().map(|(condition, states)| self.replaced_start(condition, &states)).collect()
    }

    fn replaced_start(&self, condition: &StartCondition, states: &[&Element]) -> Diagnostic {
        let value = |state: &Element| match state.default {
            value if value.is_finite() => format!(" {}{}", Short(value), unit_suffix(&state.unit)),
            _ => String::new(),
        };
        let message = match states {
            [state] => format!("this condition determines `{}`, whose declared value{} is only a guess", state.name, value(state)),
            many => {
                let names: Vec<String> = many.iter().take(SHOWN).map(|state| format!("`{}`", state.name)).collect();
                let more = if many.len() > SHOWN { format!(" and {} more", many.len() - SHOWN) } else { String::new() };
                format!("this condition determines {}{more}, whose declared values are only guesses", names.join(", "))
            }
        };
        let mut variables: Vec<(&str, Span)> = states.iter().filter_map(|state| self.variable_of(state)).collect();
        variables.dedup();
        let names: Vec<&str> = variables.iter().map(|(name, _)| *name).collect();
        let help = format!("name the state that the condition determines: `initial eq ... free {}`", names.join(", "));
        let warning = Diagnostic::warning(codes::REPLACED_START, message, condition.span).help(help);
        variables.iter().fold(warning, |warning, (_, span)| warning.secondary(*span, "declared here"))
    }

    /// Name and declaration of the variable of a state.
    fn variable_of(&self, state: &Element) -> Option<(&str, Span)> {
        let model = self.model();
        let mut before = 0;
        let quantity = model.interface().quantities.states.iter().find(|quantity| {
            before += quantity.len();
            state.at < before
        })?;
        Some((&quantity.name, model.model().vars[quantity.var?].span))
    }
}
