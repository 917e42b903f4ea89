//! Extents of the fast reactions and their equilibria in the text of a model.

use super::convert::{Conversion, at};
use super::document::{Reaction, Symbol, SymbolRole};
use super::fast::{DEEPEST, fast};
use super::math::Math;
use super::roles::Role;
use super::units;
use super::writer::shown;
use super::xml::Fault;

impl Conversion<'_> {
    /// Returns true for a concentration whose amount is the state.
    pub(super) fn is_divided(&self, symbol: &Symbol) -> bool {
        self.roles.amounts.contains(&symbol.id) && matches!(symbol.kind, SymbolRole::Species { amount: false, .. })
    }

    /// The size that an amount is divided by to give the symbol; `None` for a symbol that is the
    /// amount.
    pub(super) fn size_of_amount(&self, symbol: &Symbol) -> Option<String> {
        self.is_divided(symbol).then(|| self.compartment_name(symbol).unwrap_or_else(|| "1".into()))
    }

    /// The amount of a species with the extents of the fast reactions.
    pub(super) fn moved_amount(&self, symbol: &Symbol, amount: String) -> String {
        let SymbolRole::Species { factor, .. } = &symbol.kind else { return amount };
        let factor = factor.as_ref().or(self.sbml.factor.as_ref()).map(|id| format!("{}*", self.names.of(id))).unwrap_or_default();
        let mut sum = amount.clone();
        for reaction in fast(self.sbml) {
            for part in reaction.parts.iter().filter(|part| part.species == symbol.id) {
                let Math::Number(number, _) = part.number else { continue };
                let (sign, size) = (if part.sign * number < 0.0 { '-' } else { '+' }, number.abs());
                let times = if size == 1.0 { String::new() } else { format!("{}*", shown(size)) };
                sum.push_str(&format!(" {sign} {factor}{times}{}", self.extent_name(reaction)));
            }
        }
        if sum == amount { amount } else { format!("({sum})") }
    }

    fn extent_name(&self, reaction: &Reaction) -> String {
        format!("{}_extent", self.names.of(&reaction.id))
    }

    /// Extents of the fast reactions and their equilibria.
    pub(super) fn equilibria(&mut self) -> Result<(), Fault> {
        let sbml = self.sbml;
        if fast(sbml).next().is_some() {
            self.line("\n# equilibria of the fast reactions");
        }
        let unit = units::text(&self.extent());
        for reaction in fast(sbml) {
            if !self.slope(reaction).is_some_and(|slope| slope < 0.0) {
                let text = format!("the fast reaction `{}` does not lead to an equilibrium at the start", reaction.id);
                return Err(at(reaction.at, text));
            }
            let name = self.extent_name(reaction);
            let line = self.declaration(&name, &unit, "0", "");
            self.line(&format!("var {line}"));
            let line = format!("eq {} = 0", self.names.of(&reaction.id));
            self.line(&line);
        }
        Ok(())
    }

    /// The change of the rate of a fast reaction with its own extent, at the start.
    fn slope(&self, reaction: &Reaction) -> Option<f64> {
        let change = |id: &str| {
            let own = reaction.parts.iter().filter(|part| part.species == id);
            own.map(|part| if let Math::Number(x, _) = part.number { part.sign * x } else { 0.0 }).sum::<f64>()
        };
        let rate = |extent: f64| reaction.rate.value(&mut |id| self.value_with(id, &|id| extent * change(id), 0));
        Some(rate(1.0)? - rate(0.0)?)
    }

    /// The value of a symbol at the start, where some are changed.
    fn value_with(&self, id: &str, change: &dyn Fn(&str) -> f64, depth: usize) -> Option<f64> {
        let rule = self.sbml.rules.iter().find(|rule| rule.target.id() == Some(id) && self.roles.of(id) == Some(Role::Let));
        match rule {
            Some(_) if depth > DEEPEST => None,
            Some(rule) => rule.math.value(&mut |id| self.value_with(id, change, depth + 1)),
            None => Some(self.start_value(id, 0)? + change(id)),
        }
    }
}
