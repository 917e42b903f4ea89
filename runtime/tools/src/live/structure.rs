//! The structure of a model: its unknowns, the equation of each, and which unknowns are solved for
//! together.

use std::collections::HashMap;
use std::path::Path;

use serde_json::{Value, json};
use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::graph::connected;
use smpl_compiler::model::{Interface, Quantity, RootAction};
use smpl_dsl::diagnostic::SourceMap;

use super::describe::range;
use super::models::Found;
use super::settings::Settings;
use super::uri::uri_of;
use super::wire::Answer;
use crate::reduction::Summary;

/// Unknowns beyond which blocks are not looked for.
const LARGE: usize = 20_000;
/// Most names of a block.
const MOST_NAMES: usize = 20;

/// The answer to `smpl/structure`.
pub(crate) fn answer(found: &Found, settings: &Settings) -> Answer {
    let setup = found.compiled.setup_of(settings)?;
    let (model, sources) = (setup.model(), &found.compiled.loaded.sources);
    let interface = model.interface();
    let solved: Vec<&str> = interface.quantities.solved.iter().map(|q| q.name.as_str()).collect();
    let quantity = |kind: &str, q: &Quantity| {
        let span = q.var.and_then(|var| model.model().vars.get(var)).map(|variable| range(sources, variable.span));
        json!({"name": q.name, "unit": q.unit, "text": q.text, "count": q.len(), "kind": kind, "range": span})
    };
    let substituted = interface.quantities.algebraics.iter().filter(|q| !solved.contains(&q.name.as_str()));
    let algebraic =
        interface.quantities.solved.iter().map(|q| quantity("solved", q)).chain(substituted.map(|q| quantity("substituted", q)));
    let roots = model.roots_info().iter().map(|root| {
        let action = match root.action {
            RootAction::Fail(_) => "failure",
            RootAction::Run(_) => "event",
            RootAction::Restart => "switch",
            RootAction::Succeed(_) => "success",
        };
        json!({"name": root.name, "action": action})
    });
    Ok(json!({
        "stale": found.stale,
        "states": interface.quantities.states.iter().map(|q| quantity("state", q)).collect::<Vec<Value>>(),
        "algebraic": algebraic.collect::<Vec<Value>>(),
        "equations": equations(model, sources),
        "blocks": blocks(model, &setup.catalogue),
        "reduction": reduction(interface, sources),
        "explicit": model.explicit(),
        "method": settings.solver(found.compiled.loaded.options.solver.clone())?.method.unwrap_or(interface.solver.method).name(),
        "nonzeros": model.pattern().nonzeros(),
        "roots": roots.collect::<Vec<Value>>(),
        "invariants": interface.invariants.iter().map(|i| i.name.as_str()).collect::<Vec<&str>>(),
    }))
}

/// The record of index reduction, with places in the text; `null` without one.
fn reduction(interface: &Interface, sources: &SourceMap) -> Value {
    let Some(mut value) = Summary::of(interface).map(|summary| summary.json()) else { return Value::Null };
    let places = interface.reduction.differentiated.iter();
    for (entry, one) in value["differentiated"].as_array_mut().into_iter().flatten().zip(places) {
        entry["range"] = range(sources, one.span);
        entry["line"] = json!(sources.locate(one.span).line);
        entry["uri"] = json!(uri_of(Path::new(sources.name(one.span.file))));
    }
    value
}

/// The equation that determines each unknown; the parts of one array by one equation are one entry.
fn equations(model: &CompiledModel, sources: &SourceMap) -> Vec<Value> {
    let mut order = Vec::new();
    let mut counts: HashMap<_, usize> = HashMap::new();
    for row in &model.model().rows {
        let count: usize = row.extents.iter().map(|&extent| extent as usize).product();
        let key = (row.var, row.span.file, row.span.start, row.span.end);
        match counts.get_mut(&key) {
            Some(known) => *known += count,
            None => {
                counts.insert(key, count);
                order.push((row, key));
            }
        }
    }
    let entry = |(row, key): &(&smpl_compiler::model::Row, _)| {
        let name = model.model().vars.get(row.var).map_or("", |variable| variable.name.as_str());
        let place = sources.locate(row.span);
        json!({
            "unknown": name, "count": counts.get(key), "range": range(sources, row.span), "line": place.line, "text": sources.text(row.span),
            "uri": uri_of(Path::new(sources.name(row.span.file))),
        })
    };
    order.iter().map(entry).collect()
}

/// Algebraic unknowns that are solved for together, in the order in which they can be solved for.
fn blocks(model: &CompiledModel, catalogue: &smpl_runtime::catalogue::Catalogue) -> Vec<Value> {
    let (states, unknowns) = (model.states(), model.unknowns());
    if unknowns - states > LARGE {
        return Vec::new();
    }
    let pattern = model.pattern();
    let mut reads = vec![Vec::new(); unknowns - states];
    for column in states..unknowns {
        for &row in &pattern.row_indices[pattern.column_pointers[column]..pattern.column_pointers[column + 1]] {
            if row >= states {
                reads[row - states].push(column - states);
            }
        }
    }
    let mut names = vec![""; unknowns - states];
    for element in catalogue.solved.elements() {
        if let Some(name) = element.at.checked_sub(states).and_then(|at| names.get_mut(at)) {
            *name = element.name.as_str();
        }
    }
    let block = |block: &Vec<usize>| {
        let shown: Vec<&str> = block.iter().take(MOST_NAMES).map(|&at| names[at]).collect();
        json!({"size": block.len(), "unknowns": shown})
    };
    connected(&reads).iter().map(block).collect()
}
