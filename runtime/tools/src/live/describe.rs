//! Descriptions of a model for the controls of the page: parameters, starts, actions, choices,
//! panels.

use std::sync::Arc;

use serde_json::{Value, json};
use smpl_compiler::compiled::Region;
use smpl_compiler::ir::VarId;
use smpl_compiler::model::{Method, Quantity};
use smpl_dsl::diagnostic::SourceMap;
use smpl_dsl::span::Span;
use smpl_runtime::catalogue::{Element, Family};
use smpl_runtime::environment::{Environment, ResetOptions, Start};
use smpl_runtime::scenario;
use smpl_runtime::setup::Setup;

use super::models::Found;
use super::panels::{self, component};
use super::settings::Settings;
use super::uri::uri_of;
use super::wire::{Answer, number};
use crate::policy;

/// Most elements of an array that have controls.
const MOST_ELEMENTS: usize = 64;
/// Ratio of bounds from which a slider is logarithmic.
const DECADES: f64 = 1000.0;
/// Positions of a slider.
const POSITIONS: f64 = 200.0;

/// The answer to `smpl/model`.
pub(crate) fn answer(found: &Found, settings: &Settings) -> Answer {
    let compiled = &found.compiled;
    let loaded = &compiled.loaded;
    let setup = compiled.setup_of(settings)?;
    let interface = setup.model().interface();
    let shown = panels::shown(&setup, &loaded.options.noise);
    let counts = interface.quantities.algebraic_counts;
    let solver = settings.solver(loaded.options.solver.clone())?;
    let mut large = Vec::new();
    let controls = controls(&setup, &loaded.sources, &mut large);
    let mut answer = json!({
        "uri": uri_of(&compiled.path), "stale": found.stale, "version": compiled.version,
        "name": interface.name, "text": interface.text,
        "time": {"name": interface.time.name, "unit": interface.time.unit},
        "step": number(interface.episode.step), "max_steps": setup.max_steps(), "batch": interface.episode.end_is_success,
        "scenarios": scenario::beside(&compiled.path), "scenario": settings.scenario.as_deref().unwrap_or("default"),
        "variants": interface.alternatives.variants.iter().map(|v| json!({"name": v.name, "on": v.on})).collect::<Vec<Value>>(),
        "choices": interface.alternatives.choices.iter()
            .map(|c| json!({"name": c.name, "options": c.options, "chosen": c.chosen()})).collect::<Vec<Value>>(),
        "methods": methods(&setup), "method": solver.method.unwrap_or(interface.solver.method).name(),
        "rtol": solver.rtol.unwrap_or(interface.solver.rtol),
        "policies": policy::names(&setup).collect::<Vec<&str>>(),
        "rewards": interface.finish.rewards.iter().enumerate()
            .map(|(i, r)| json!({"name": r.name, "unit": r.unit, "text": r.text, "chosen": i == setup.reward})).collect::<Vec<Value>>(),
        "levels": interface.alternatives.levels,
        "observations": interface.finish.observations.iter()
            .map(|o| json!({"name": o.name, "unit": o.unit, "low": number(o.low), "high": number(o.high)})).collect::<Vec<Value>>(),
        "constraints": smpl_runtime::environment::constraint_names(interface).collect::<Vec<&str>>(),
        "panels": shown.panels.iter().enumerate().map(|(id, panel)| panel.json(id)).collect::<Vec<Value>>(),
        "fields": shown.fields.iter().map(panels::field).collect::<Vec<Value>>(),
        "sizes": {
            "states": setup.catalogue.states.len(), "parameters": setup.catalogue.parameters.len(),
            "algebraic_declared": counts.declared, "algebraic_solved": counts.solved, "algebraic_substituted": counts.substituted,
        },
        "large": large,
        "compile_ms": number(compiled.took.as_secs_f64() * 1e3),
    });
    if let (Value::Object(answer), Value::Object(controls)) = (&mut answer, controls) {
        answer.extend(controls);
    }
    Ok(answer)
}

/// Names of the methods that take the model.
fn methods(setup: &Setup) -> Vec<&'static str> {
    let model = setup.model();
    let takes = |method: &Method| match method {
        Method::Ida | Method::Auto => true,
        Method::Rosenbrock => model.explicit(),
        Method::Explicit => model.explicit() && model.unknowns() == model.states(),
    };
    Method::ALL.into_iter().filter(takes).map(Method::name).collect()
}

/// A kind of controls: quantities, their elements, and the values that they have.
struct ControlGroup<'s> {
    name: &'static str,
    quantities: &'s [Quantity],
    family: &'s Family,
    value: &'s dyn Fn(&Element) -> f64,
    drawn: &'s dyn Fn(&Element) -> bool,
}

fn controls(setup: &Arc<Setup>, sources: &SourceMap, large: &mut Vec<Value>) -> Value {
    let quantities = &setup.model().interface().quantities;
    let catalogue = &setup.catalogue;
    let start = nominal_start(setup);
    let drawn: Vec<usize> = setup.drawn_parameters().iter().map(|element| element.at).collect();
    let parameters = setup.parameters();
    let of_start = |region: Region, e: &Element| start.as_ref().map_or(e.default, |s| s.region(region, e));
    let never = |_: &Element| false;
    let kinds = [
        ControlGroup {
            name: "parameters",
            quantities: &quantities.parameters,
            family: &catalogue.parameters,
            value: &|e| parameters.get(e.at).copied().unwrap_or(e.default),
            drawn: &|e| drawn.contains(&e.at),
        },
        ControlGroup {
            name: "states",
            quantities: &quantities.states,
            family: &catalogue.states,
            value: &|e| start.as_ref().map_or(e.default, |s| s.state(e)),
            drawn: &never,
        },
        ControlGroup {
            name: "discretes",
            quantities: &quantities.discretes,
            family: &catalogue.discretes,
            value: &|e| of_start(Region::Discrete, e),
            drawn: &never,
        },
        ControlGroup { name: "actions", quantities: &quantities.actions, family: &catalogue.actions, value: &|e| e.default, drawn: &never },
        ControlGroup {
            name: "disturbances",
            quantities: &quantities.disturbances,
            family: &catalogue.disturbances,
            value: &|e| of_start(Region::Disturbance, e),
            drawn: &never,
        },
    ];
    kinds.iter().map(|kind| (kind.name.to_owned(), Value::Array(of_kind(kind, setup, sources, large)))).collect()
}

/// The values at the start with random numbers at their means.
struct Start0(Environment);

impl Start0 {
    fn state(&self, e: &Element) -> f64 {
        self.0.unknowns().get(e.at).copied().unwrap_or(e.default)
    }

    fn region(&self, region: Region, e: &Element) -> f64 {
        let values = if region == Region::Discrete { self.0.discretes() } else { self.0.disturbances() };
        values.get(e.at).copied().unwrap_or(e.default)
    }
}

fn nominal_start(setup: &Arc<Setup>) -> Option<Start0> {
    let mut environment = Environment::new(Arc::clone(setup)).ok()?;
    let options = ResetOptions { start: Start::Nominal, hold_records: true, ..ResetOptions::default() };
    environment.reset(Some(0), &options).ok()?;
    Some(Start0(environment))
}

fn of_kind(kind: &ControlGroup<'_>, setup: &Setup, sources: &SourceMap, large: &mut Vec<Value>) -> Vec<Value> {
    let mut out = Vec::new();
    for quantity in kind.quantities {
        if quantity.len() > MOST_ELEMENTS {
            large.push(json!({"array": quantity.name, "count": quantity.len(), "role": kind.name}));
            continue;
        }
        let range = quantity.var.and_then(|var| range_of(setup, sources, var));
        for index in 0..quantity.len() {
            let name = quantity.element_name(index);
            let Some(element) = kind.family.find(&name) else { continue };
            let value = (kind.value)(element);
            out.push(json!({
                "name": name, "array": quantity.name, "component": component(&quantity.name), "unit": quantity.unit, "text": quantity.text,
                "value": number(value), "low": number(element.low), "high": number(element.high),
                "slider": slider(element, value), "structural": quantity.structural, "drawn": (kind.drawn)(element), "range": range,
            }));
        }
    }
    out
}

/// The ends of a slider: the bounds where they are given, else half of the value around it.
fn slider(element: &Element, value: f64) -> Value {
    let around = if value.is_finite() && value != 0.0 {
        (value - 0.5 * value.abs(), value + 0.5 * value.abs())
    } else if element.scale.is_finite() && element.scale > 0.0 {
        (-element.scale, element.scale)
    } else {
        (-1.0, 1.0)
    };
    let mut low = if element.low.is_finite() { element.low } else { around.0.min(element.high) };
    let mut high = if element.high.is_finite() { element.high } else { around.1.max(element.low) };
    if low >= high {
        (low, high) = around;
    }
    // A bound far away, such as 0..1e30, leaves no way to set the value.
    if value.is_finite() && value > 0.0 && low == 0.0 && high > DECADES * value {
        high = 10.0 * value;
    }
    let log = low > 0.0 && high / low >= DECADES;
    json!({"low": number(low), "high": number(high), "log": log, "step": number((high - low) / POSITIONS)})
}

fn range_of(setup: &Setup, sources: &SourceMap, var: VarId) -> Option<Value> {
    let variable = setup.model().model().vars.get(var)?;
    Some(range(sources, variable.span))
}

/// A place in a text as the page counts: lines and UTF-16 units from 0, with the file.
pub(crate) fn range(sources: &SourceMap, span: Span) -> Value {
    let Some(file) = sources.file(span.file) else { return Value::Null };
    let text = file.text();
    let position = |byte: u32| {
        let byte = text.floor_char_boundary(byte as usize);
        let start = text[..byte].rfind('\n').map_or(0, |at| at + 1);
        let line = text[..start].matches('\n').count();
        json!({"line": line, "character": text[start..byte].encode_utf16().count()})
    };
    let path = std::path::Path::new(file.name());
    json!({"uri": uri_of(path), "start": position(span.start), "end": position(span.end)})
}
