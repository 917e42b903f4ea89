//! Fast reactions: in equilibrium at all times.
//!
//! A species that fast reactions change is what it would be without them, a state, plus their
//! extents. The extents are the unknowns of the equilibria, in which the rates of the fast
//! reactions are zero. What fast reactions conserve follows the slow ones only, and nothing is
//! differentiated.

use std::collections::{HashMap, HashSet};

use super::convert::{Conversion, at};
use super::document::{Event, Reaction, Sbml, Symbol, SymbolRole};
use super::math::Math;
use super::roles::{self, Role};
use super::units;
use super::writer::shown;
use super::xml::Fault;

/// Definitions that follow from one another.
const DEEPEST: usize = 60;

/// Species that fast reactions change.
pub(super) fn species<'s>(sbml: &'s Sbml, roles: &HashMap<String, Role>) -> HashSet<&'s str> {
    let parts = fast(sbml).flat_map(|reaction| &reaction.parts);
    parts.map(|part| part.species.as_str()).filter(|id| roles.get(*id) == Some(&Role::State)).collect()
}

/// Refuses what would make the equilibrium another one at an instant, or leave it open which of
/// several holds.
pub(super) fn check(sbml: &Sbml, moved: &HashSet<&str>) -> Result<(), Fault> {
    let Some(first) = fast(sbml).next() else { return Ok(()) };
    let refuse = |place: usize, what: String| Err(at(place, format!("{what}, and the reaction `{}` is fast", first.id)));
    let read = |math: &Math| roles::through(sbml, math).into_iter().find(|name| moved.contains(name.as_str()));
    for event in &sbml.events {
        let shifts = |id: &str| moved.contains(id) || fast(sbml).any(|r| roles::through(sbml, &r.rate).iter().any(|name| name == id));
        if let Some(target) = Event::targets(event).find(|target| shifts(target)) {
            return refuse(event.at, format!("an event sets `{target}`"));
        }
    }
    for (id, math) in &sbml.initial {
        if let Some(read) = read(math) {
            let place = sbml.symbols.iter().find(|symbol| symbol.id == *id).map_or(first.at, |symbol| symbol.at);
            return refuse(place, format!("the initial value of `{id}` reads `{read}`"));
        }
    }
    let rules = sbml.rules.iter().map(|rule| (rule.at, &rule.math));
    let rates = sbml.reactions.iter().map(|reaction| (reaction.at, &reaction.rate));
    for (place, math) in rules.chain(rates).filter(|(_, math)| math.has_delay()) {
        if let Some(read) = read(math) {
            return refuse(place, format!("`{read}` is delayed"));
        }
    }
    for reaction in fast(sbml) {
        if reaction.parts.iter().any(|part| !matches!(part.number, Math::Number(..))) {
            return Err(at(reaction.at, format!("the fast reaction `{}` has a stoichiometry that is not a number", reaction.id)));
        }
        if degree(sbml, &reaction.rate, moved, 0) != Some(1) {
            let what = "is not linear in what fast reactions change: it may have several equilibria";
            return Err(at(reaction.at, format!("the fast reaction `{}` {what}", reaction.id)));
        }
    }
    Ok(())
}

/// The degree of an expression as a polynomial in what fast reactions change; `None` for one that
/// is not a polynomial.
fn degree(sbml: &Sbml, math: &Math, moved: &HashSet<&str>, depth: usize) -> Option<u32> {
    let of = |math: &Math| if depth > DEEPEST { None } else { degree(sbml, math, moved, depth + 1) };
    let all = |list: &[Math]| list.iter().map(of).collect::<Option<Vec<u32>>>();
    let most = |list: Vec<u32>| list.into_iter().max().unwrap_or(0);
    match math {
        Math::Number(..) | Math::Time | Math::Constant(_) => Some(0),
        Math::Name(id) if moved.contains(id.as_str()) => Some(1),
        Math::Name(id) => {
            let rule = sbml.rules.iter().find(|rule| rule.target.id() == Some(id)).map(|rule| &rule.math);
            rule.or_else(|| sbml.reactions.iter().find(|r| r.id == *id).map(|r| &r.rate)).map_or(Some(0), of)
        }
        Math::Apply("+" | "-", list) => all(list).map(most),
        Math::Apply("*", list) => all(list).map(|degrees| degrees.into_iter().sum()),
        Math::Apply("/", list) => all(list).filter(|degrees| most(degrees[1..].to_vec()) == 0).map(|degrees| degrees[0]),
        Math::Apply(_, list) | Math::Call(_, list) => all(list).map(most).filter(|degree| *degree == 0),
        Math::RateOf(_) => None,
        Math::Piecewise(cases, otherwise) => {
            let conditions = cases.iter().map(|(_, condition)| of(condition)).all(|degree| degree == Some(0));
            let values = cases.iter().map(|(value, _)| of(value)).chain([of(otherwise)]).collect::<Option<Vec<u32>>>();
            values.map(most).filter(|_| conditions)
        }
    }
}

fn fast(sbml: &Sbml) -> impl Iterator<Item = &Reaction> {
    sbml.reactions.iter().filter(|reaction| reaction.fast)
}

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
