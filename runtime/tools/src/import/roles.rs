//! Roles of the symbols of an SBML model: parameter, state, discrete variable, named expression or
//! algebraic variable.

use std::collections::{HashMap, HashSet};

use super::document::{Event, Sbml, Symbol, SymbolRole, Target};
use super::fast;
use super::math::Math;
use super::xml::Fault;

/// Role of a symbol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// It never changes.
    Parameter,
    /// An assignment rule gives it.
    Let,
    /// It has a rate.
    State,
    /// An algebraic rule determines it.
    Variable,
    /// Events change it, or it starts from what is known at the start only.
    Discrete,
}

/// The roles of all symbols, and what follows from them.
pub(super) struct Roles {
    pub(super) roles: HashMap<String, Role>,
    /// Species whose state is the amount though the symbol is the concentration: their compartments
    /// change.
    pub(super) amounts: HashSet<String>,
}

impl Roles {
    pub(super) fn of(&self, id: &str) -> Option<Role> {
        self.roles.get(id).copied()
    }
}

fn at(at: usize, message: impl Into<String>) -> Fault {
    Fault { at, message: message.into() }
}

/// Finds the roles.
pub(super) fn find(sbml: &Sbml) -> Result<Roles, Fault> {
    let known: HashMap<&str, &Symbol> = sbml.symbols.iter().map(|s| (s.id.as_str(), s)).collect();
    if known.len() < sbml.symbols.len() {
        let twice = sbml.symbols.iter().find(|s| sbml.symbols.iter().filter(|o| o.id == s.id).count() > 1);
        return Err(twice.map_or_else(|| at(0, "an id twice"), |s| at(s.at, format!("the id `{}` is used twice", s.id))));
    }
    let mut roles: HashMap<String, Role> = HashMap::new();
    let mut set = |place: usize, id: &str, role: Role| -> Result<(), Fault> {
        let symbol = known.get(id).ok_or_else(|| at(place, format!("unknown symbol `{id}`")))?;
        if symbol.constant && role != Role::Discrete {
            return Err(at(place, format!("`{id}` is constant, and changes here")));
        }
        match (roles.get(id), role) {
            (None, _) => drop(roles.insert(id.to_owned(), role)),
            (Some(Role::State), Role::State | Role::Discrete) | (Some(Role::Discrete), Role::Discrete) => {}
            _ => return Err(at(place, format!("`{id}` is determined twice"))),
        }
        Ok(())
    };
    for rule in &sbml.rules {
        match &rule.target {
            Target::Assignment(id) => set(rule.at, id, Role::Let)?,
            Target::Rate(id) => set(rule.at, id, Role::State)?,
            Target::Algebraic => {}
        }
    }
    let ruled: HashSet<String> = sbml.rules.iter().filter_map(|r| r.target.id().map(str::to_owned)).collect();
    for reaction in &sbml.reactions {
        for part in &reaction.parts {
            let species = known.get(part.species.as_str()).ok_or_else(|| at(part.at, format!("unknown species `{}`", part.species)))?;
            match &species.kind {
                SymbolRole::Species { boundary: true, .. } => {}
                SymbolRole::Species { .. } if ruled.contains(&part.species) => {
                    return Err(at(part.at, format!("`{}` is changed by a reaction and by a rule", part.species)));
                }
                SymbolRole::Species { .. } => set(part.at, &part.species, Role::State)?,
                _ => return Err(at(part.at, format!("`{}` is not a species", part.species))),
            }
        }
    }
    for event in &sbml.events {
        for (place, id, _) in &event.assignments {
            if known.get(id.as_str()).is_some_and(|s| s.constant) {
                return Err(at(*place, format!("`{id}` is constant, and an event changes it")));
            }
            set(*place, id, Role::Discrete)?;
        }
    }
    algebraic(sbml, &mut roles)?;
    for symbol in &sbml.symbols {
        roles.entry(symbol.id.clone()).or_insert(Role::Parameter);
    }
    starts(sbml, &mut roles);
    for id in set_with_contents(sbml) {
        if roles.get(id) == Some(&Role::Discrete) {
            roles.insert(id.to_owned(), Role::State);
        }
    }
    let kept = amounts(sbml, &roles);
    let late: Vec<String> = sbml.symbols.iter().filter(|s| starts_late(sbml, &roles, &kept, s)).map(|s| s.id.clone()).collect();
    roles.extend(late.into_iter().map(|id| (id, Role::Discrete)));
    starts(sbml, &mut roles);
    fast::check(sbml, &fast::species(sbml, |id| roles.get(id) == Some(&Role::State)))?;
    let amounts = amounts(sbml, &roles);
    Ok(Roles { roles, amounts })
}

impl Target {
    pub(super) fn id(&self) -> Option<&str> {
        match self {
            Target::Assignment(id) | Target::Rate(id) => Some(id),
            Target::Algebraic => None,
        }
    }
}

/// Gives each algebraic rule a symbol that nothing else determines.
fn algebraic(sbml: &Sbml, roles: &mut HashMap<String, Role>) -> Result<(), Fault> {
    let rules: Vec<_> = sbml.rules.iter().filter(|r| matches!(r.target, Target::Algebraic)).collect();
    let free = |id: &str| sbml.symbols.iter().any(|s| s.id == id && !s.constant) && !roles.contains_key(id);
    let candidates: Vec<Vec<String>> = rules.iter().map(|r| sbml.through(&r.math).into_iter().filter(|id| free(id)).collect()).collect();
    let mut of: HashMap<String, usize> = HashMap::new();
    for (rule, found) in rules.iter().enumerate() {
        if !augment(rule, &candidates, &mut of, &mut HashSet::new()) {
            return Err(at(found.at, "the algebraic rule determines nothing: all its symbols are determined otherwise"));
        }
    }
    roles.extend(of.into_keys().map(|id| (id, Role::Variable)));
    Ok(())
}

fn augment(rule: usize, candidates: &[Vec<String>], of: &mut HashMap<String, usize>, seen: &mut HashSet<String>) -> bool {
    for id in &candidates[rule] {
        if !seen.insert(id.clone()) {
            continue;
        }
        let other = of.get(id).copied();
        if other.is_none_or(|other| augment(other, candidates, of, seen)) {
            of.insert(id.clone(), rule);
            return true;
        }
    }
    false
}

/// A parameter that starts from more than parameters is known at the start only.
fn starts(sbml: &Sbml, roles: &mut HashMap<String, Role>) {
    loop {
        let late = |id: &str, math: &Math| {
            roles.get(id) == Some(&Role::Parameter)
                && (math.has_rates() || math.names().iter().any(|n| roles.get(n) != Some(&Role::Parameter)))
        };
        let found: Vec<String> = sbml.initial.iter().filter(|(id, math)| late(id, math)).map(|(id, _)| id.clone()).collect();
        if found.is_empty() {
            return;
        }
        roles.extend(found.into_iter().map(|id| (id, Role::Discrete)));
    }
}

/// Compartments that one event sets together with the concentration of a species in them, and that
/// have no rate. They are states with the rate 0: an event sets its states from the values before
/// it, and the concentration counts for the size before.
fn set_with_contents(sbml: &Sbml) -> Vec<&str> {
    let within = |event: &Event, size: &str| {
        event.assignments.iter().any(|(_, id, _)| {
            let species = sbml.symbols.iter().find(|s| s.id == *id).map(|s| &s.kind);
            matches!(species, Some(SymbolRole::Species { compartment, amount: false, .. }) if compartment == size)
        })
    };
    let of_event = |event| Event::targets(event).filter(move |id| within(event, id));
    sbml.events.iter().flat_map(of_event).collect()
}

/// Returns true for a parameter whose initial value needs the size of a compartment that is not a
/// parameter.
fn starts_late(sbml: &Sbml, roles: &HashMap<String, Role>, amounts: &HashSet<String>, symbol: &Symbol) -> bool {
    let SymbolRole::Species { compartment, amount, starts_as_amount, .. } = &symbol.kind else { return false };
    if roles.get(&symbol.id) != Some(&Role::Parameter) || roles.get(compartment) == Some(&Role::Parameter) {
        return false;
    }
    let as_amount = *amount || amounts.contains(&symbol.id);
    let given = sbml.initial.contains_key(&symbol.id);
    if given { as_amount && !*amount } else { as_amount != *starts_as_amount }
}

/// Species that are concentrations in compartments that change: their amounts are kept. A rate rule
/// of a concentration stays one, unless an event may change the size at once, which leaves the
/// amount as it is.
fn amounts(sbml: &Sbml, roles: &HashMap<String, Role>) -> HashSet<String> {
    let resized: HashSet<&str> = sbml.events.iter().flat_map(Event::targets).collect();
    let moved = fast::species(sbml, |id| roles.get(id) == Some(&Role::State));
    let kept = |s: &&Symbol| {
        if moved.contains(s.id.as_str()) {
            return true;
        }
        let SymbolRole::Species { compartment, amount: false, .. } = &s.kind else { return false };
        let rule = sbml.rules.iter().find(|r| r.target.id() == Some(&s.id)).map(|r| &r.target);
        let by_itself = match rule {
            Some(Target::Rate(_)) => !resized.contains(compartment.as_str()),
            Some(_) => true,
            None => roles.get(&s.id) == Some(&Role::Variable),
        };
        roles.get(compartment) != Some(&Role::Parameter) && !by_itself
    };
    sbml.symbols.iter().filter(kept).map(|s| s.id.clone()).collect()
}
