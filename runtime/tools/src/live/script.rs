//! The settings of the controls as texts: a scenario in YAML, a script in Python, a line for a
//! picture.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use serde_yaml::{Mapping, Value as Yaml};
use smpl_runtime::scenario::{Value, Variant};
use smpl_runtime::setup::Setup;

use super::settings::{PidSettings, Settings, StartAt};
use super::wire::Fault;

/// Inputs of a run, in a line.
pub(crate) fn circumstances(settings: &Settings, seed: u64) -> String {
    let scenario = settings.scenario.iter().filter(|name| *name != "default").map(|name| format!("scenario {name}"));
    let variants = settings.variants.iter().map(|variant| format!("variant {variant}"));
    let given = settings.settings.iter().map(|(name, value)| format!("{name} = {value}"));
    let numbers = [&settings.parameters, &settings.initial, &settings.actions, &settings.disturbances];
    let numbers = numbers.into_iter().flatten().map(|(name, value)| format!("{name} = {}", smpl_runtime::failure::Short(*value)));
    let policy = settings.policy.as_ref().map(|name| format!("policy {name}"));
    let pid = settings.pid.as_ref().map(|pid| format!("PID of {} by {}", pid.measured, pid.action));
    let all = scenario.chain(variants).chain(given).chain(numbers).chain([format!("seed {seed}")]).chain(policy).chain(pid);
    all.collect::<Vec<_>>().join(", ")
}

/// The scenario that the settings describe, over the text of another one. What a scenario cannot
/// say is a comment.
///
/// # Errors
/// A scenario that is not valid YAML.
pub(crate) fn scenario(settings: &Settings, base: &str) -> Result<String, Fault> {
    let base: Option<Mapping> = serde_yaml::from_str(base).map_err(|error| Fault::setting(format!("the scenario: {error}")))?;
    let mut scenario = base.unwrap_or_default();
    merge_numbers(&mut scenario, "parameters", &settings.parameters);
    merge_numbers(&mut scenario, "initial", &settings.initial);
    merge_numbers(&mut scenario, "disturbances", &settings.disturbances);
    let given: Vec<(String, Yaml)> = settings.settings.iter().map(|(name, value)| (name.clone(), yaml(value))).collect();
    merge(&mut scenario, "settings", given);
    if !settings.variants.is_empty() {
        let known = scenario.get("variants").and_then(Yaml::as_sequence).cloned().unwrap_or_default();
        let own = settings.variants.iter().map(|text| Yaml::String(Variant::parse(text).to_string()));
        scenario.insert("variants".into(), Yaml::Sequence(known.into_iter().chain(own).collect()));
    }
    let method = settings.method.iter().map(|name| ("method".to_owned(), Yaml::String(name.clone())));
    let rtol = settings.rtol.iter().map(|x| ("rtol".to_owned(), Yaml::Number((*x).into())));
    merge(&mut scenario, "solver", method.chain(rtol).collect());
    let texts = [("reward", &settings.reward), ("observation", &settings.level)];
    for (key, text) in texts.into_iter().filter_map(|(key, text)| Some((key, text.clone()?))) {
        scenario.insert(key.into(), Yaml::String(text));
    }
    if let Some(steps) = settings.steps {
        scenario.insert("max_steps".into(), Yaml::Number(steps.into()));
    }
    let mut text = comments(settings);
    if !scenario.is_empty() {
        text += &serde_yaml::to_string(&scenario).map_err(|error| Fault::setting(error.to_string()))?;
    }
    Ok(text)
}

/// Settings of a run that a scenario does not have.
fn comments(settings: &Settings) -> String {
    let actions = settings.actions.iter().map(|(name, value)| format!("action {name} = {value}"));
    let policy = settings.policy.iter().map(|name| format!("policy {name}"));
    let pid = settings.pid.iter().map(|pid| {
        let integral = pid.integral_time.map(|t| format!(", integral time {t}")).unwrap_or_default();
        format!("PID of {} by {}: gain {}{integral}, derivative time {}", pid.measured, pid.action, pid.gain, pid.derivative_time)
    });
    let start = (settings.start != StartAt::Sampled).then(|| format!("start {}", settings.start.name()));
    let lines = actions.chain(policy).chain(pid).chain(start).map(|line| format!("# {}\n", line.replace('\n', " ")));
    lines.collect()
}

fn merge_numbers(scenario: &mut Mapping, key: &str, values: &BTreeMap<String, f64>) {
    merge(scenario, key, values.iter().map(|(name, value)| (name.clone(), Yaml::Number((*value).into()))).collect());
}

/// Puts entries into a mapping of a scenario.
fn merge(scenario: &mut Mapping, key: &str, entries: Vec<(String, Yaml)>) {
    if entries.is_empty() {
        return;
    }
    let mut inner = scenario.get(key).and_then(Yaml::as_mapping).cloned().unwrap_or_default();
    for (name, value) in entries {
        inner.insert(name.into(), value);
    }
    scenario.insert(key.into(), Yaml::Mapping(inner));
}

fn yaml(value: &Value) -> Yaml {
    match value {
        Value::Flag(flag) => Yaml::Bool(*flag),
        Value::Number(x) => Yaml::Number((*x).into()),
        Value::Text(text) => Yaml::String(text.clone()),
        Value::List(list) => Yaml::Sequence(list.iter().map(|x| Yaml::Number((*x).into())).collect()),
    }
}

/// A script that runs the episode of the settings by `smpl.Env` and prints its return. `recorded`
/// are actions that a policy without a counterpart in Python has drawn.
pub(crate) fn python(settings: &Settings, path: &Path, setup: &Setup, recorded: Option<&BTreeMap<String, Vec<f64>>>) -> String {
    let mut text = String::from("import numpy as np\nimport smpl\n");
    if settings.pid.is_some() {
        text += "from smpl.controllers import PID\n";
    }
    text.push('\n');
    let mut arguments = vec![quoted(&path.to_string_lossy()), "normalize=False".to_owned()];
    arguments.extend(choices(settings));
    let _ = writeln!(text, "env = smpl.Env(\n    {},\n)", arguments.join(",\n    "));
    let _ = writeln!(text, "env.reset(seed={}{})", settings.seed, reset_options(settings, setup));
    text += &policy(settings, setup, recorded);
    text += "total, ended = 0.0, False\nwhile not ended:\n    _, reward, terminated, truncated, info = env.step(action())\n    \
             total += reward\n    ended = terminated or truncated\nprint(total, info[\"time\"], info[\"failure\"] or \"no failure\")\n";
    text
}

/// Keyword arguments of `smpl.Env`.
fn choices(settings: &Settings) -> Vec<String> {
    let mut out = Vec::new();
    let texts = [
        ("scenario", settings.scenario.as_ref().filter(|name| *name != "default")),
        ("reward", settings.reward.as_ref()),
        ("observation", settings.level.as_ref()),
        ("method", settings.method.as_ref()),
    ];
    out.extend(texts.into_iter().filter_map(|(key, text)| Some(format!("{key}={}", quoted(text?)))));
    if !settings.variants.is_empty() {
        let names: String = settings.variants.iter().map(|name| format!("{}, ", quoted(name))).collect();
        out.push(format!("variants=({})", names.trim_end()));
    }
    let value = |value: &Value| match value {
        Value::Flag(flag) => if *flag { "True" } else { "False" }.to_owned(),
        Value::Text(text) => quoted(text),
        other => other.to_string(),
    };
    let given = settings.settings.iter().map(|(name, v)| (name, value(v)));
    let parameters = settings.parameters.iter().map(|(name, x)| (name, x.to_string()));
    let rtol = "rtol".to_owned();
    let rtol = settings.rtol.iter().map(|x| (&rtol, x.to_string()));
    let all: Vec<String> = given.chain(parameters).chain(rtol).map(|(name, value)| format!("{}: {value}", quoted(name))).collect();
    if !all.is_empty() {
        out.push(format!("settings={{{}}}", all.join(", ")));
    }
    out.extend(settings.steps.map(|steps| format!("max_steps={steps}")));
    out
}

/// The argument `options` of `reset`; empty where there is nothing to say.
fn reset_options(settings: &Settings, setup: &Setup) -> String {
    let is_discrete = |name: &str| setup.catalogue.discretes.find(name).is_some();
    let (discrete, states): (Vec<_>, Vec<_>) = settings.initial.iter().partition(|(name, _)| is_discrete(name));
    let mapping = |entries: Vec<(&String, &f64)>, list: bool| {
        let entry = |(name, x): (&String, &f64)| if list { format!("{}: [{x}]", quoted(name)) } else { format!("{}: {x}", quoted(name)) };
        entries.into_iter().map(entry).collect::<Vec<_>>().join(", ")
    };
    let mut entries = Vec::new();
    if settings.start != StartAt::Sampled {
        entries.push(format!("\"start\": {}", quoted(settings.start.name())));
    }
    let parts = [("state", states, false), ("discrete", discrete, false), ("disturbances", settings.disturbances.iter().collect(), true)];
    for (key, values, list) in parts.into_iter().filter(|(_, values, _)| !values.is_empty()) {
        entries.push(format!("\"{key}\": {{{}}}", mapping(values, list)));
    }
    if !settings.disturbances.is_empty() {
        entries.push("\"hold_disturbances\": True".to_owned());
    }
    if entries.is_empty() { String::new() } else { format!(", options={{{}}}", entries.join(", ")) }
}

/// The function `action` of the script.
fn policy(settings: &Settings, setup: &Setup, recorded: Option<&BTreeMap<String, Vec<f64>>>) -> String {
    let names: Vec<&str> = setup.catalogue.actions.names().collect();
    let place = |name: &str| names.iter().position(|known| *known == name).unwrap_or_default();
    let mut text = String::new();
    let asked = settings.policy.as_deref().unwrap_or("nominal");
    let declared = setup.model().model().programs.policies.iter().any(|(name, _)| name == asked);
    if let Some(recorded) = recorded {
        let columns = names.iter().map(|name| format!("{:?}", recorded.get(*name).cloned().unwrap_or_default()));
        let _ = writeln!(
            text,
            "\nrecorded = np.array([{}]).T  # of the policy `random`\nstep = iter(recorded)",
            columns.collect::<Vec<_>>().join(", ")
        );
    }
    if let Some(pid) = &settings.pid {
        text += &pid_text(pid);
    }
    text += "\n\ndef action():\n";
    text += &match (recorded, declared) {
        (Some(_), _) => "    u = next(step).copy()\n".to_owned(),
        (None, true) => format!("    u = np.array(env.policy({}))\n", quoted(asked)),
        (None, false) => {
            let defaults: Vec<f64> = setup.catalogue.actions.elements().iter().map(|element| element.default).collect();
            format!("    u = np.array({defaults:?})\n")
        }
    };
    for (name, value) in &settings.actions {
        let _ = writeln!(text, "    u[{}] = {value}  # {name}", place(name));
    }
    if let Some(pid) = &settings.pid {
        let _ = writeln!(text, "    u[{}] = loop.next(env)", place(&pid.action));
    }
    text + "    return u\n\n\n"
}

fn pid_text(pid: &PidSettings) -> String {
    let (measured, sees) = match pid.measured.strip_prefix("obs.") {
        Some(name) => (name, "observation"),
        None => (pid.measured.as_str(), "state"),
    };
    let integral = pid.integral_time.map(|t| format!(", integral_time={t}")).unwrap_or_default();
    let goal = pid.set_point.map(|x| format!(", set_point={x}")).unwrap_or_default();
    format!(
        "loop = PID(\n    {}, {}, {}{integral}, derivative_time={}{goal}, sees=\"{sees}\",\n)\nloop.reset(env)\n",
        quoted(measured),
        quoted(&pid.action),
        pid.gain,
        pid.derivative_time
    )
}

/// A text as a literal of Python, which that of JSON is too.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}
