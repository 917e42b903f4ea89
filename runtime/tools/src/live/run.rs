//! Runs: one episode, several seeds, or a sweep, with the curves that the page shows.

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Instant;

use serde::Deserialize;
use serde_json::{Value, json};
use smpl_runtime::environment::{Environment, constraint_names};
use smpl_runtime::setup::Setup;

use super::episode::{Episode, Wanted, run};
use super::jobs::Stop;
use super::models::{Compiled, Found};
use super::panels::{self, Line, Shown, role_name, style};
use super::settings::{Settings, Single, kind_of};
use super::wire::{Answer, Fault, curve, number};
use crate::picture::items::Item;

/// Fields that are sent where no names are given.
const FIRST_FIELDS: usize = 4;
/// Most times of a field.
const MOST_TIMES: usize = 240;
/// Most numbers of the fields of an answer.
const MOST_FIELD_NUMBERS: usize = 4_000_000;

/// Parameters of `smpl/run`.
#[derive(Debug, Deserialize)]
pub(crate) struct RunRequest {
    #[serde(default)]
    pub(crate) settings: Settings,
    /// Names of columns; those of the panels that come first if missing.
    pub(crate) columns: Option<Vec<String>>,
    /// Names of fields.
    pub(crate) fields: Option<Vec<String>>,
    #[serde(default)]
    pub(crate) channel: Option<String>,
}

/// Environments that were used last: a slider runs the same one again.
#[derive(Default)]
pub(crate) struct Benches {
    last: Vec<Environment>,
}

impl Benches {
    /// An environment of a setup.
    pub(crate) fn take(&mut self, setup: &Arc<Setup>) -> Result<Environment, Fault> {
        match self.last.iter().position(|environment| Arc::ptr_eq(environment.setup(), setup)) {
            Some(at) => Ok(self.last.swap_remove(at)),
            None => Environment::new(Arc::clone(setup)).map_err(Fault::setting),
        }
    }

    pub(crate) fn put(&mut self, environment: Environment) {
        const MOST: usize = 4;
        if self.last.len() >= MOST {
            self.last.remove(0);
        }
        self.last.push(environment);
    }
}

/// Report of a run while it goes on: completed steps and all steps.
pub(crate) type Report<'a> = &'a mut dyn FnMut(u64, u64);

/// Runs what a request asks for. `find` gives the model under settings.
///
/// # Errors
/// Settings that the model does not take, or a stop.
pub(crate) fn answer(
    request: &RunRequest,
    find: &dyn Fn(&Settings) -> Result<Found, Fault>,
    benches: &mut Benches,
    stop: &Stop,
    report: Report<'_>,
) -> Answer {
    let begin = Instant::now();
    let found = find(&request.settings)?;
    let first = found.compiled.setup_of(&request.settings)?;
    let compile = begin.elapsed();
    let singles = request.settings.singles(|name| kind_of(&first, name))?;
    let all = singles.len() as u64 * u64::from(first.max_steps());
    let (mut runs, mut warnings) = (Vec::new(), Vec::new());
    for (index, single) in singles.iter().enumerate() {
        stop.check()?;
        let setup = if index == 0 && request.settings.sweep.is_none() { Arc::clone(&first) } else { setup_for(single, &found, find)? };
        let before = index as u64 * u64::from(first.max_steps());
        let shown = panels::shown(&setup, &found.compiled.loaded.options.noise);
        let lines = lines_of(request, &shown);
        let mut environment = benches.take(&setup)?;
        let wanted: Wanted = lines.iter().filter_map(|line| Some((line.member.column.clone(), line.member.source?))).collect();
        let result = run(&mut environment, single, &wanted, stop, &mut |step| report(before + u64::from(step), all));
        let episode = result?;
        for (name, values) in &episode.ended_records {
            warnings.push(format!("the disturbance `{name}` ends after step {values}; its last value held to the end"));
        }
        runs.push(run_json(&environment, single, &episode, &lines, &fields_of(request, &shown)));
        benches.put(environment);
    }
    warnings.dedup();
    let total = begin.elapsed();
    let ms = |duration: std::time::Duration| number(duration.as_secs_f64() * 1e3);
    Ok(json!({
        "stale": found.stale,
        "channel": request.channel,
        "ms": {"compile": ms(compile), "run": ms(total - compile), "total": ms(total)},
        "time_unit": first.model().interface().time.unit,
        "step": number(first.model().interface().episode.step),
        "runs": runs,
        "warnings": warnings,
    }))
}

/// The setup of one value of a sweep, which may shape the model.
pub(crate) fn setup_for(single: &Single, found: &Found, find: &dyn Fn(&Settings) -> Result<Found, Fault>) -> Result<Arc<Setup>, Fault> {
    let catalogue = smpl_runtime::catalogue::parameters(&found.compiled.loaded.model);
    let shapes = single.settings.parameters.keys().any(|name| catalogue.find(name).is_some_and(|e| e.structural));
    let compiled: Arc<Compiled> = if shapes { find(&single.settings)?.compiled } else { Arc::clone(&found.compiled) };
    compiled.setup_of(&single.settings)
}

/// The curves that are asked for.
fn lines_of<'s>(request: &RunRequest, shown: &'s Shown) -> Vec<&'s Line> {
    let asked: Option<HashSet<&str>> = request.columns.as_ref().map(|names| names.iter().map(String::as_str).collect());
    let panels = shown.panels.iter();
    match asked {
        Some(asked) => panels.flat_map(|p| &p.lines).filter(|line| asked.contains(line.member.column.as_str())).collect(),
        None => panels.filter(|panel| panel.first).flat_map(|panel| &panel.lines).collect(),
    }
}

fn fields_of<'s>(request: &RunRequest, shown: &'s Shown) -> Vec<&'s Item> {
    let mut room = MOST_FIELD_NUMBERS;
    let fits = |item: &&Item| {
        let numbers = item.members.len() * MOST_TIMES;
        let fits = numbers <= room;
        room -= if fits { numbers } else { 0 };
        fits
    };
    match &request.fields {
        Some(names) => shown.fields.iter().filter(|item| names.contains(&item.name)).filter(fits).collect(),
        None => shown.fields.iter().take(FIRST_FIELDS).filter(fits).collect(),
    }
}

fn run_json(environment: &Environment, single: &Single, episode: &Episode, lines: &[&Line], fields: &[&Item]) -> Value {
    let setup = environment.setup();
    let times = episode.table.numbers("time").unwrap_or_default();
    let fine = episode.trace.as_ref().map(|(_, trace)| trace.times.as_slice()).unwrap_or_default();
    let statistics = environment.statistics();
    json!({
        "label": single.label, "seed": single.seed, "value": single.value,
        "grids": {"step": curve(&times), "fine": curve(fine)},
        "columns": lines.iter().map(|line| column(line, episode)).collect::<Vec<Value>>(),
        "fields": fields.iter().map(|item| field(item, episode, &times)).collect::<Vec<Value>>(),
        "phases": phases(setup, episode, &times),
        "events": events(setup, episode),
        "end": {
            "kind": episode.end.kind, "name": episode.end.name, "message": episode.end.message,
            "step": times.len().saturating_sub(1), "time": number(environment.time()),
        },
        "rewards": rewards(setup, episode),
        "episode_return": number(episode.total),
        "reward": setup.model().interface().finish.rewards.get(setup.reward).map(|reward| reward.name.as_str()),
        "constraints": constraints(setup, episode),
        "set_point": episode.set_point,
        "statistics": {"steps": statistics.steps, "residuals": statistics.residuals, "jacobians": statistics.jacobians},
    })
}

fn column(line: &Line, episode: &Episode) -> Value {
    let name = &line.member.column;
    let within =
        episode.trace.as_ref().and_then(|(tracing, trace)| Some((tracing, trace, tracing.columns.iter().position(|c| c == name)?)));
    let (grid, style, values) = match within {
        Some((tracing, trace, at)) => ("fine", "line", tracing.curve(trace, at)),
        None => ("step", style(line.role), episode.table.numbers(name).unwrap_or_default()),
    };
    json!({
        "name": name, "unit": line.unit, "role": role_name(line.role), "grid": grid, "style": style, "values": curve(&values),
    })
}

fn field(item: &Item, episode: &Episode, times: &[f64]) -> Value {
    let every = times.len().div_ceil(MOST_TIMES).max(1);
    let rows: Vec<usize> = (0..times.len()).step_by(every).collect();
    let cells = item.indices.last().map_or(1, |last| last.labels.len()).max(1);
    let columns: Vec<Vec<f64>> = item.members.iter().map(|m| episode.table.numbers(&m.column).unwrap_or_default()).collect();
    let mut values = Vec::with_capacity(columns.len() * rows.len());
    for group in columns.chunks(cells) {
        for &row in &rows {
            values.extend(group.iter().map(|column| column.get(row).copied().unwrap_or(f64::NAN)));
        }
    }
    let finite = values.iter().copied().filter(|x| x.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    let mut field = panels::field(item);
    field["times"] = curve(&rows.iter().map(|&row| times[row]).collect::<Vec<f64>>());
    field["values"] = curve(&values);
    field["low"] = number(low);
    field["high"] = number(high);
    if episode.moved {
        field["space"] = Value::Null;
    }
    field
}

/// Phases with their beginnings and ends.
fn phases(setup: &Setup, episode: &Episode, times: &[f64]) -> Vec<Value> {
    let names = &setup.model().interface().phases;
    if names.is_empty() {
        return Vec::new();
    }
    let points: Vec<(f64, f64)> = match &episode.trace {
        Some((tracing, trace)) => trace.times.iter().copied().zip(tracing.curve(trace, tracing.columns.len())).collect(),
        None => times.iter().copied().zip(episode.table.numbers("phase").unwrap_or_default()).collect(),
    };
    let mut found: Vec<(usize, f64, f64)> = Vec::new();
    for (time, number) in points.into_iter().filter(|(_, number)| *number >= 1.0) {
        let number = number as usize - 1;
        match found.last_mut() {
            Some((last, _, to)) if *last == number => *to = time,
            Some((_, _, to)) => {
                *to = time;
                found.push((number, time, time));
            }
            None => found.push((number, time, time)),
        }
    }
    let named = |(at, from, to): (usize, f64, f64)| Some(json!({"name": names.get(at)?, "from": number(from), "to": number(to)}));
    found.into_iter().filter_map(named).collect()
}

fn events(setup: &Setup, episode: &Episode) -> Vec<Value> {
    const MOST: usize = 2000;
    let (interface, roots) = (setup.model().interface(), setup.model().roots_info());
    let Some((_, trace)) = &episode.trace else { return Vec::new() };
    let named = trace.events.iter().filter_map(|(time, root)| Some((*time, roots.get(*root)?.name.as_str())));
    let shown = named.filter(|(_, name)| !interface.phases.iter().any(|phase| phase == name)).take(MOST);
    shown.map(|(time, name)| json!({"time": number(time), "name": name})).collect()
}

fn rewards(setup: &Setup, episode: &Episode) -> Vec<Value> {
    let of = |reward: &smpl_compiler::model::Reward| {
        let values = episode.table.numbers(&format!("reward.{}", reward.name)).unwrap_or_default();
        let total: f64 = values.iter().filter(|x| x.is_finite()).sum();
        json!({"name": reward.name, "unit": reward.unit, "text": reward.text, "total": number(total), "values": curve(&values)})
    };
    setup.model().interface().finish.rewards.iter().map(of).collect()
}

/// Violations of all limits, step after step.
fn constraints(setup: &Setup, episode: &Episode) -> Vec<Value> {
    let names: Vec<&str> = constraint_names(setup.model().interface()).collect();
    let of = |(at, name): (usize, &&str)| {
        let values: Vec<f64> = episode.violations.iter().skip(at).step_by(names.len()).copied().collect();
        let worst = values.iter().enumerate().filter(|(_, x)| x.is_finite()).max_by(|a, b| a.1.total_cmp(b.1));
        json!({
            "name": name, "worst": worst.map(|(_, x)| *x), "step_of_worst": worst.filter(|(_, x)| **x > 0.0).map(|(at, _)| at + 1),
            "values": curve(&values),
        })
    };
    names.iter().enumerate().map(of).collect()
}
