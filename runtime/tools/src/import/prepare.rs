//! A model with its function definitions put in and the past of its delays worked out.

use std::collections::{HashMap, HashSet};

use super::convert::at;
use super::document::Sbml;
use super::math::Math;
use super::past::Before;
use super::xml::Fault;

/// Calls `change` with each expression of the model and its place.
fn each_math(sbml: &mut Sbml, change: &dyn Fn(usize, &mut Math) -> Result<(), Fault>) -> Result<(), Fault> {
    for rule in &mut sbml.rules {
        change(rule.at, &mut rule.math)?;
    }
    for reaction in &mut sbml.reactions {
        change(reaction.at, &mut reaction.rate)?;
        for part in &mut reaction.parts {
            change(part.at, &mut part.number)?;
        }
    }
    for event in &mut sbml.events {
        change(event.at, &mut event.trigger)?;
        for math in event.delay.iter_mut().chain(&mut event.priority) {
            change(event.at, math)?;
        }
        for (place, _, math) in &mut event.assignments {
            change(*place, math)?;
        }
    }
    for (place, math) in &mut sbml.constraints {
        change(*place, math)?;
    }
    let places: HashMap<&str, usize> = sbml.symbols.iter().map(|s| (s.id.as_str(), s.at)).collect();
    for (id, math) in &mut sbml.initial {
        let place = places.get(id.as_str()).copied();
        change(place.ok_or_else(|| at(0, format!("an initial assignment to the unknown symbol `{id}`")))?, math)?;
    }
    Ok(())
}

/// Puts the function definitions in, checks that all symbols are known, and gives delays their
/// values before the start.
pub(super) fn prepare(sbml: &mut Sbml) -> Result<(), Fault> {
    let functions = std::mem::take(&mut sbml.functions);
    let known: HashSet<String> = sbml.symbols.iter().map(|s| s.id.clone()).chain(sbml.reactions.iter().map(|r| r.id.clone())).collect();
    each_math(sbml, &|place, math| {
        *math = math.put_in(&functions).map_err(|why| at(place, why))?;
        match math.names().into_iter().find(|name| !known.contains(name)) {
            Some(name) => Err(at(place, format!("unknown symbol `{name}`"))),
            None => Ok(()),
        }
    })?;
    let before = Before::of(sbml);
    each_math(sbml, &|place, math| {
        *math = before.put_in(math).map_err(|why| at(place, why))?;
        Ok(())
    })
}
