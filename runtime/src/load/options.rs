//! Options of environments from a scenario and settings, which the compiled model does not contain.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use smpl_compiler::artefact::Circumstances;
use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::model::Quantity;
use smpl_dsl::diagnostic::{Diagnostic, SourceMap, codes};

use super::layers::Layers;
use super::{LoadError, LoadOptions, Loaded};
use crate::catalogue;
use crate::scenario::{Disturbances, Noise, Recorded, Scenario};
use crate::setup::EnvironmentOptions;

/// Options of the environments: what of scenario and settings is not in the compiled model.
pub(super) fn finish(
    model: CompiledModel,
    sources: SourceMap,
    scenario: &Scenario,
    layers: Layers<'_>,
    options: &LoadOptions,
) -> Result<Loaded, LoadError> {
    let faults: Vec<Diagnostic> =
        names_of_scenario(scenario, &model, &sources).into_iter().chain(grid_faults(scenario, &model, &sources)).collect();
    if !faults.is_empty() {
        return Err(LoadError::Diagnostics { sources: Arc::new(sources), diagnostics: faults });
    }
    let mut environment = EnvironmentOptions {
        reward: options.reward.clone().or_else(|| scenario.reward.clone()),
        max_steps: scenario.max_steps,
        solver: scenario.solver.clone(),
        parameters: layers.parameters(&model)?,
        ..EnvironmentOptions::default()
    };
    environment.disturbances = recorded(scenario, &model);
    environment.held = held(scenario);
    environment.given_starts = given_starts(scenario, &model);
    environment.noise = match &scenario.noise {
        None | Some(Noise::Switch(true)) => BTreeMap::new(),
        Some(Noise::Switch(false)) => model.interface().finish.observations.iter().map(|o| (o.name.clone(), 0.0)).collect(),
        Some(Noise::Deviations(deviations)) => deviations.clone(),
    };
    Ok(Loaded {
        model: Arc::new(model),
        options: environment,
        level: options.observation.clone().or_else(|| scenario.observation.clone()).unwrap_or_else(|| "default".into()),
        sources: Arc::new(sources),
        warnings: Vec::new(),
        fingerprint: [0; 32],
        circumstances: Circumstances::default(),
    })
}

/// Elements of states that a scenario gives, one by one or as whole arrays.
fn given_starts(scenario: &Scenario, model: &CompiledModel) -> BTreeSet<String> {
    let states = &model.interface().quantities.states;
    let names = |quantity: &Quantity| (0..quantity.len()).map(|i| quantity.element_name(i)).collect::<Vec<_>>();
    let all = scenario.initial.keys().flat_map(|name| match states.iter().find(|quantity| quantity.name == *name) {
        Some(whole) => names(whole),
        None => vec![name.replace(' ', "")],
    });
    all.collect()
}

/// Names of noise and disturbances that the model does not have, at their places.
fn names_of_scenario(scenario: &Scenario, model: &CompiledModel, sources: &SourceMap) -> Vec<Diagnostic> {
    let mut faults = Vec::new();
    let mut compare = |key: &str, kind, given: Vec<&String>, known: Vec<&str>| {
        for name in given.into_iter().filter(|name| !known.contains(&name.as_str())) {
            let message = crate::catalogue::UnknownName::new(kind, name, known.iter().copied()).to_string();
            faults.push(Diagnostic::error(codes::BAD_SCENARIO, message, scenario.place_under(sources, key, name)));
        }
    };
    if let Some(Noise::Deviations(deviations)) = &scenario.noise {
        let known = model.interface().finish.observations.iter().map(|o| o.name.as_str()).collect();
        compare("noise", "observation", deviations.keys().collect(), known);
    }
    if let Some(Disturbances::Values(values)) = &scenario.disturbances {
        let elements = catalogue::disturbances(model);
        let measured = &model.interface().measured;
        let known = elements.names().chain(measured.iter().map(String::as_str)).collect();
        compare("disturbances", "disturbance", values.keys().collect(), known);
        for (name, recorded) in values {
            let place = || scenario.place_under(sources, "disturbances", name);
            let is_known = measured.contains(name) || elements.find(name).is_some();
            if let Some((message, help)) = misfit(name, recorded, measured.contains(name)).filter(|_| is_known) {
                faults.push(Diagnostic::error(codes::BAD_SCENARIO, message, place()).help(help));
            }
            let Some(element) = elements.find(name) else { continue };
            if let Some(message) = recorded.values().iter().find_map(|value| element.check_bounds(*value).err()) {
                faults.push(Diagnostic::error(codes::BAD_SCENARIO, message.to_string(), place()));
            }
        }
    }
    faults
}

/// The fault of data of another kind than the disturbance takes: one value a step, or data over
/// time.
fn misfit(name: &str, recorded: &Recorded, measured: bool) -> Option<(String, &'static str)> {
    match recorded {
        Recorded::Sequence { .. } if measured => Some((
            format!("the disturbance `{name}` follows data over time, not one value a step"),
            "give a file, `{from: \"data.csv\"}`, or one number",
        )),
        Recorded::File { .. } if !measured => Some((
            format!("the disturbance `{name}` takes one value a step, not data over time"),
            "declare it with `from`, or give a list of values",
        )),
        _ => None,
    }
}

/// Parameters under `grid` that are not numbers of cells.
fn grid_faults(scenario: &Scenario, model: &CompiledModel, sources: &SourceMap) -> Vec<Diagnostic> {
    let shapes_nothing = |name: &&String| model.interface().quantities.parameters.iter().any(|p| p.name == **name && !p.structural);
    let fault = |name: &String| {
        let message = format!("`{name}` is not a number of cells");
        Diagnostic::error(codes::BAD_SCENARIO, message, scenario.place_under(sources, "grid", name))
            .help("values of parameters belong under `parameters`")
    };
    scenario.grid.keys().filter(shapes_nothing).map(fault).collect()
}

/// Recorded disturbances whose last value is to hold.
fn held(scenario: &Scenario) -> BTreeSet<String> {
    let Some(Disturbances::Values(values)) = &scenario.disturbances else { return BTreeSet::new() };
    let holds = |recorded: &Recorded| matches!(recorded, Recorded::Sequence { hold: true, .. } | Recorded::Constant(_));
    values.iter().filter(|(_, recorded)| holds(recorded)).map(|(name, _)| name.clone()).collect()
}

fn recorded(scenario: &Scenario, model: &CompiledModel) -> BTreeMap<String, Vec<f64>> {
    match &scenario.disturbances {
        None | Some(Disturbances::Switch(true)) => BTreeMap::new(),
        Some(Disturbances::Switch(false)) => {
            let elements = catalogue::disturbances(model);
            elements.elements().iter().map(|e| (e.name.clone(), vec![if e.default.is_finite() { e.default } else { 0.0 }])).collect()
        }
        Some(Disturbances::Values(values)) => {
            let measured = &model.interface().measured;
            let per_step = values.iter().filter(|(name, _)| !measured.contains(name));
            per_step.map(|(name, recorded)| (name.clone(), recorded.values().to_vec())).collect()
        }
    }
}
