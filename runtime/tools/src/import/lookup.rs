//! Parts of a model by their ids.

use std::collections::HashMap;

use super::document::{Sbml, Symbol, Target};
use super::math::Math;

/// Symbols and what gives their values at the start, by id.
pub(super) struct Lookup<'s> {
    symbols: HashMap<&'s str, &'s Symbol>,
    values: HashMap<&'s str, &'s Math>,
}

impl<'s> Lookup<'s> {
    pub(super) fn of(sbml: &'s Sbml) -> Self {
        let (mut symbols, mut values) = (HashMap::new(), HashMap::new());
        for symbol in &sbml.symbols {
            symbols.entry(symbol.id.as_str()).or_insert(symbol);
        }
        let rules = sbml.rules.iter().filter_map(|rule| match &rule.target {
            Target::Assignment(id) => Some((id.as_str(), &rule.math)),
            _ => None,
        });
        let initial = sbml.initial.iter().map(|(id, math)| (id.as_str(), math));
        let rates = sbml.reactions.iter().map(|reaction| (reaction.id.as_str(), &reaction.rate));
        for (id, math) in rules.chain(initial).chain(rates) {
            values.entry(id).or_insert(math);
        }
        Self { symbols, values }
    }

    /// The symbol of an id.
    pub(super) fn symbol(&self, id: &str) -> Option<&'s Symbol> {
        self.symbols.get(id).copied()
    }

    /// The assignment of an id, its initial assignment, or the rate of the reaction.
    pub(super) fn value(&self, id: &str) -> Option<&'s Math> {
        self.values.get(id).copied()
    }
}
