//! Definitions that are expanded where they are used: `let`s, fluxes, functions.

use super::lower::place::{IndexKey, Site};
use super::lower::value::Value;
use super::symbols::{SymbolId, Symbols};
use crate::ir::{FastMap, FastSet};

/// A `let` at what its indices are bound to, in a kind of text, and whether it is read for what it
/// is or by how much it holds.
pub(in crate::elaborate) type Expansion = (SymbolId, Vec<IndexKey>, Site, Asked);

/// Request to a definition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(in crate::elaborate) enum Asked {
    /// Its value.
    Value,
    /// By how much the condition holds that it is.
    Amount,
}

/// Expansions in progress and done.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Expansions {
    /// Definitions that are being expanded, one inside another.
    open: Vec<SymbolId>,
    /// `let`s, fluxes and functions that something has asked for.
    used: FastSet<SymbolId>,
    values: FastMap<Expansion, Value>,
}

impl Expansions {
    /// Returns `true` if a definition is being expanded: it needs itself.
    pub(in crate::elaborate) fn is_open(&self, symbol: SymbolId) -> bool {
        self.open.contains(&symbol)
    }

    /// Begins to expand a definition.
    pub(in crate::elaborate) fn enter(&mut self, symbol: SymbolId) {
        self.open.push(symbol);
    }

    /// Ends what was begun last.
    pub(in crate::elaborate) fn leave(&mut self) {
        self.open.pop();
    }

    /// The way from a definition back to itself in words, where it has stations.
    pub(in crate::elaborate) fn cycle(&self, symbol: SymbolId, symbols: &Symbols<'_>) -> String {
        let ring = self.ring(symbol);
        if ring.len() < 2 {
            return String::new();
        }
        let path = |s: &SymbolId| format!("`{}`", symbols[*s].path);
        let stations: Vec<String> = ring.iter().chain([&symbol]).map(path).collect();
        format!(": {}", stations.join(" needs "))
    }

    /// The way from a definition back to itself: the definitions in between, itself first.
    fn ring(&self, symbol: SymbolId) -> &[SymbolId] {
        let start = self.open.iter().position(|&s| s == symbol).unwrap_or(0);
        &self.open[start..]
    }

    /// Notes that something asks for a definition.
    pub(in crate::elaborate) fn note_use(&mut self, symbol: SymbolId) {
        self.used.insert(symbol);
    }

    /// Returns `true` if anything has asked for a definition.
    pub(in crate::elaborate) fn is_used(&self, symbol: SymbolId) -> bool {
        self.used.contains(&symbol)
    }

    /// The value of an expansion that was made before.
    pub(in crate::elaborate) fn value(&self, key: &Expansion) -> Option<&Value> {
        self.values.get(key)
    }

    /// Values of all expansions that were made.
    pub(in crate::elaborate) fn values(&self) -> impl Iterator<Item = (SymbolId, &Value)> {
        self.values.iter().map(|((symbol, ..), value)| (*symbol, value))
    }

    /// Remembers the value of an expansion.
    pub(in crate::elaborate) fn remember(&mut self, key: Expansion, value: Value) {
        self.values.insert(key, value);
    }

    /// Forgets an expansion that an attempt made.
    pub(in crate::elaborate) fn forget(&mut self, key: &Expansion) {
        self.values.remove(key);
    }
}
