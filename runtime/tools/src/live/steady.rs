//! Steady states: values, eigenvalues, other steady states.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::{Value, json};
use smpl_compiler::compiled::Region;
use smpl_runtime::catalogue::{Catalogue, Element};
use smpl_runtime::linearize::linearize;
use smpl_runtime::setup::Setup;
use smpl_runtime::spectrum::eigenvalues;
use smpl_runtime::steady::{self, SteadyError};
use smpl_runtime::system::CompiledSystem;

use super::jobs::Stop;
use super::models::Found;
use super::settings::Settings;
use super::wire::{Answer, Fault, number};

/// States beyond which eigenvalues take minutes.
const LARGE: usize = 3000;

/// Parameters of `smpl/steady`.
#[derive(Debug, Deserialize)]
pub(crate) struct SteadyRequest {
    #[serde(default)]
    pub(crate) settings: Settings,
    /// States that the equations leave free, with their values.
    #[serde(default)]
    fixed: BTreeMap<String, f64>,
    /// Look for other steady states too.
    #[serde(default = "yes")]
    others: bool,
    /// Compute eigenvalues.
    #[serde(default = "yes")]
    linear: bool,
}

fn yes() -> bool {
    true
}

/// The steady state of a model under settings.
///
/// # Errors
/// Settings that the model does not take, or a stop.
pub(crate) fn answer(request: &SteadyRequest, found: &Found, stop: &Stop) -> Answer {
    let mut options = found.compiled.loaded.options.clone();
    let parameters = smpl_runtime::catalogue::parameters(&found.compiled.loaded.model);
    let shapes = |name: &str| parameters.find(name).is_some_and(|element| element.structural);
    options.parameters.extend(request.settings.parameters.clone().into_iter().filter(|(name, _)| !shapes(name)));
    let setup = found.compiled.setup(options, true).map_err(Fault::setting)?;
    let catalogue = &setup.catalogue;
    let mut system = setup.system.clone();
    let known = setup.model().interface().steady.is_some() && setup.no_steady().is_none();
    let mut y = if known { setup.steady_state().to_vec() } else { steady::guess(&system, catalogue) };
    let (mut actions, mut held) = steady::declared(&mut system, catalogue, &mut y);
    for (name, value) in &request.settings.actions {
        let position = catalogue.actions.get(name, "action").map_err(Fault::setting)?;
        let at = catalogue.actions.elements().iter().position(|e| e.name == position.name);
        at.into_iter().for_each(|at| actions[at] = *value);
    }
    for (name, value) in &request.fixed {
        let element = catalogue.states.get(name, "state").map_err(Fault::setting)?;
        held.fix(element.at, *value, &mut system, &y).map_err(Fault::setting)?;
    }
    let report = match steady::solve_held(&mut system, catalogue, &actions, &held, &[], &mut y) {
        Ok(report) => report,
        Err(SteadyError::Interrupted) => return Err(stop.fault()),
        Err(error) => return Ok(not_found(&error, catalogue, found.stale)),
    };
    stop.check()?;
    steady::rest_at(&mut system, &y);
    let values = values(&mut system, &setup, &y, &actions);
    let (spectrum, note) = if request.linear { spectrum(&mut system, catalogue, &y) } else { (Value::Null, String::new()) };
    stop.check()?;
    let others = request.others.then(|| {
        let found = steady::others(&system, catalogue, &actions, &held, &y);
        let state = |y: &[f64], e: &Element| json!({"name": e.name, "unit": e.unit, "value": number(y[e.at])});
        found
            .iter()
            .map(|y| json!({"values": catalogue.states.elements().iter().map(|e| state(y, e)).collect::<Vec<_>>()}))
            .collect::<Vec<_>>()
    });
    let message = report.moving.map(|(at, rate)| {
        let name = catalogue.states.elements().iter().find(|e| e.at == at).map_or("", |e| e.name.as_str());
        format!("`{name}` is not at rest: d/dt {name} = {rate:.3e}, as its rate is coupled with that of a held state; hold other states")
    });
    stop.check()?;
    Ok(json!({
        "stale": found.stale, "found": report.moving.is_none(), "message": message, "free": [],
        "values": values, "residual_norm": number(report.residual_norm), "iterations": report.iterations,
        "time_unit": setup.model().interface().time.unit,
        "eigenvalues": spectrum, "eigenvalue_note": note, "others": others,
    }))
}

/// The answer without a steady state: why, and which states must be given.
fn not_found(error: &SteadyError, catalogue: &Catalogue, stale: bool) -> Value {
    let free = match error {
        SteadyError::Undetermined(freedom) => freedom.states.as_slice(),
        _ => &[],
    };
    let shown = |name: &String| {
        let element = catalogue.states.find(name)?;
        Some(
            json!({"name": name, "unit": element.unit, "value": number(element.default), "low": number(element.low), "high": number(element.high)}),
        )
    };
    json!({
        "stale": stale, "found": false, "message": error.to_string(), "free": free.iter().filter_map(shown).collect::<Vec<Value>>(),
        "values": [], "eigenvalues": null, "others": null,
    })
}

fn values(system: &mut CompiledSystem, setup: &Setup, y: &[f64], actions: &[f64]) -> Vec<Value> {
    let catalogue = &setup.catalogue;
    let zero = vec![0.0; y.len()];
    let mut outputs = vec![0.0; catalogue.algebraics.len()];
    let (model, memory) = system.parts();
    model.outputs(memory, 0.0, y, &zero, &mut outputs);
    let discretes = system.region(Region::Discrete);
    let disturbances = system.region(Region::Disturbance);
    let row = |role: &str, e: &Element, value: f64| json!({"name": e.name, "unit": e.unit, "role": role, "value": number(value), "low": number(e.low), "high": number(e.high)});
    let states = catalogue.states.elements().iter().map(|e| row("state", e, y[e.at]));
    let outputs = catalogue.algebraics.elements().iter().map(|e| row("output", e, outputs[e.at]));
    let actions = catalogue.actions.elements().iter().zip(actions).map(|(e, value)| row("action", e, *value));
    let discretes = catalogue.discretes.elements().iter().map(|e| row("discrete", e, discretes[e.at]));
    let disturbances = catalogue.disturbances.elements().iter().map(|e| row("disturbance", e, disturbances[e.at]));
    states.chain(outputs).chain(actions).chain(discretes).chain(disturbances).collect()
}

/// Eigenvalues of the linearisation, those with the largest real part first, and what is to be
/// known of them.
fn spectrum(system: &mut CompiledSystem, catalogue: &Catalogue, y: &[f64]) -> (Value, String) {
    if catalogue.states.len() > LARGE {
        return (Value::Null, format!("eigenvalues are not computed for more than {LARGE} states"));
    }
    let linear = match linearize(system, catalogue, 0.0, y) {
        Ok(linear) => linear,
        Err(error) => return (Value::Null, error.to_string()),
    };
    let Some(spectrum) = eigenvalues(&linear.minimal().a) else {
        return (Value::Null, "the iteration for the eigenvalues did not converge".into());
    };
    let values = spectrum.values.iter().map(|v| json!({"re": number(v.re), "im": number(v.im)})).collect();
    let note =
        if spectrum.omitted > 0 { format!("{} eigenvalues, far from zero, are not computed", spectrum.omitted) } else { String::new() };
    (Value::Array(values), note)
}
