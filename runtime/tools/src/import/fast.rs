//! Fast reactions, which are in equilibrium at all times.
//!
//! A species that fast reactions change is what it would be without them, a state, plus their
//! extents. The extents are the unknowns of the equilibria, in which the rates of the fast
//! reactions are zero. What fast reactions conserve follows the slow ones only, and nothing is
//! differentiated.

use std::collections::HashSet;

use super::document::{Event, Reaction, Sbml};
use super::math::Math;
use super::xml::Fault;

/// Definitions that follow from one another.
pub(super) const DEEPEST: usize = 60;

/// Species that fast reactions change.
pub(super) fn species(sbml: &Sbml, is_state: impl Fn(&str) -> bool) -> HashSet<&str> {
    let parts = fast(sbml).flat_map(|reaction| &reaction.parts);
    parts.map(|part| part.species.as_str()).filter(|id| is_state(id)).collect()
}

/// Refuses what would make the equilibrium another one at an instant, or leave it open which of
/// several holds.
pub(super) fn check(sbml: &Sbml, moved: &HashSet<&str>) -> Result<(), Fault> {
    let Some(first) = fast(sbml).next() else { return Ok(()) };
    let refuse = |place: usize, what: String| Err(Fault { at: place, message: format!("{what}, and the reaction `{}` is fast", first.id) });
    let read = |math: &Math| sbml.through(math).into_iter().find(|name| moved.contains(name.as_str()));
    for event in &sbml.events {
        let shifts = |id: &str| moved.contains(id) || fast(sbml).any(|r| sbml.through(&r.rate).iter().any(|name| name == id));
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
            return Err(Fault {
                at: reaction.at,
                message: format!("the fast reaction `{}` has a stoichiometry that is not a number", reaction.id),
            });
        }
        if degree(sbml, &reaction.rate, moved, 0) != Some(1) {
            let what = "is not linear in what fast reactions change: it may have several equilibria";
            return Err(Fault { at: reaction.at, message: format!("the fast reaction `{}` {what}", reaction.id) });
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

/// The fast reactions.
pub(super) fn fast(sbml: &Sbml) -> impl Iterator<Item = &Reaction> {
    sbml.reactions.iter().filter(|reaction| reaction.fast)
}
