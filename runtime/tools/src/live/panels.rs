//! Panels of the page: quantities that share a unit and a meaning share a panel with one scale.

use std::collections::{BTreeMap, HashMap, HashSet};

use serde_json::{Value, json};
use smpl_runtime::setup::Setup;

use super::wire::number;
use crate::picture::items::{self, Item, Member, Role};

/// Most panels that are shown without being asked for.
const MOST_FIRST: usize = 16;
/// Most outputs among them that no observation shows.
const MOST_OUTPUTS: usize = 4;
/// Most lines of a panel.
const MOST_LINES: usize = 24;
/// Most elements of an array that have their own curves.
const MOST_ELEMENTS: usize = 200;

/// One curve.
#[derive(Clone, Debug)]
pub(crate) struct Line {
    pub(crate) label: String,
    pub(crate) role: Role,
    pub(crate) unit: String,
    pub(crate) member: Member,
}

/// Curves on one axis.
#[derive(Clone, Debug)]
pub(crate) struct Panel {
    pub(crate) title: String,
    pub(crate) group: String,
    pub(crate) text: String,
    pub(crate) role: Role,
    pub(crate) first: bool,
    pub(crate) lines: Vec<Line>,
}

/// All that can be shown of a model.
pub(crate) struct Shown {
    pub(crate) panels: Vec<Panel>,
    /// Quantities over space.
    pub(crate) fields: Vec<Item>,
}

/// Interpolation of a curve between its points.
pub(crate) fn style(role: Role) -> &'static str {
    match role {
        Role::Observation => "dots",
        Role::Action | Role::Disturbance | Role::Reward | Role::Discrete => "step",
        Role::State | Role::Output | Role::Other => "line",
    }
}

/// The name of a role in the protocol.
pub(crate) fn role_name(role: Role) -> &'static str {
    match role {
        Role::Observation => "observation",
        Role::State => "state",
        Role::Output => "output",
        Role::Action => "action",
        Role::Discrete => "discrete",
        Role::Disturbance => "disturbance",
        Role::Reward => "reward",
        Role::Other => "other",
    }
}

/// The component of a name: `R1` of `R1.c`; empty at the top.
pub(crate) fn component(name: &str) -> &str {
    name.rsplit_once('.').map_or("", |(component, _)| component)
}

/// The last part of a name.
fn own_name(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(_, own)| own)
}

/// Panels and fields of a model. `noise` are the deviations of readings that a scenario gives.
pub(crate) fn shown(setup: &Setup, noise: &BTreeMap<String, f64>) -> Shown {
    let all = items::of_model(setup);
    let is_field = |item: &Item| item.indices.last().is_some_and(items::Index::is_space) && item.role != Role::Observation;
    let (fields, scalar): (Vec<Item>, Vec<Item>) = all.into_iter().partition(is_field);
    let has = |name: &str| {
        let of_name = |item: &&Item| item.name == name && !matches!(item.role, Role::Observation | Role::Reward);
        scalar.iter().chain(&fields).find(of_name).is_some()
    };
    let own = |item: &&Item| item.role != Role::Observation || !has(&item.name);
    let mut panels = grouped(scalar.iter().filter(own).filter(|item| item.members.len() <= MOST_ELEMENTS));
    let readings: HashMap<&str, &Item> =
        scalar.iter().filter(|item| item.role == Role::Observation).map(|item| (item.name.as_str(), item)).collect();
    let observations = &setup.model().interface().finish.observations;
    let differing = observations.iter().filter(|o| o.every > 1 || o.delay > 0 || noise.get(&o.name).copied().unwrap_or(o.noise) > 0.0);
    let differing: HashSet<String> = differing.map(|o| format!("obs.{}", o.name)).collect();
    for panel in &mut panels {
        add_readings(panel, &readings, &differing);
    }
    choose_first(&mut panels, &scalar);
    Shown { panels, fields }
}

/// Items of one role and unit with the same own name, as those of several instances, on one panel.
fn grouped<'i>(items: impl Iterator<Item = &'i Item>) -> Vec<Panel> {
    let mut panels: Vec<(String, Vec<&Item>)> = Vec::new();
    for item in items {
        let key = match item.role {
            Role::Reward if item.members.iter().any(|m| m.column == "reward") => "reward".to_owned(),
            Role::Reward => format!("rewards {}", item.unit),
            role => format!("{} {} {}", role_name(role), item.unit, own_name(&item.name)),
        };
        match panels.iter_mut().find(|(known, _)| *known == key) {
            Some((_, together)) => together.push(item),
            None => panels.push((key, vec![item])),
        }
    }
    panels.into_iter().flat_map(|(_, together)| panels_of(&together)).collect()
}

fn panels_of(together: &[&Item]) -> Vec<Panel> {
    let lone = together.len() == 1;
    let line = |item: &Item, member: &Member| {
        let label = match (lone, member.label.as_str()) {
            (true, "") => item.name.clone(),
            (true, label) => label.to_owned(),
            (false, "") => item.name.clone(),
            (false, label) => format!("{}[{label}]", item.name),
        };
        Line { label, role: item.role, unit: item.unit.clone(), member: member.clone() }
    };
    let lines: Vec<Line> = together.iter().flat_map(|item| item.members.iter().map(|member| line(item, member))).collect();
    let first = together[0];
    let title = match (lone, first.role) {
        (true, _) => first.name.clone(),
        (false, Role::Reward) => "rewards".to_owned(),
        (false, _) => own_name(&first.name).to_owned(),
    };
    let group = if lone { component(&first.name).to_owned() } else { String::new() };
    let panel = |lines: &[Line]| Panel {
        title: title.clone(),
        group: group.clone(),
        text: if lone { first.text.clone() } else { String::new() },
        role: first.role,
        first: false,
        lines: lines.to_vec(),
    };
    lines.chunks(MOST_LINES).map(panel).collect()
}

/// Adds the readings of a quantity to its curve, where they differ from it.
fn add_readings(panel: &mut Panel, readings: &HashMap<&str, &Item>, differing: &HashSet<String>) {
    let known = panel.lines.clone();
    for line in &known {
        let reading =
            readings.get(items::base(&line.member.column)).filter(|_| line.role != Role::Reward && line.role != Role::Observation);
        let of_line = |member: &&Member| member.column == format!("obs.{}", line.member.column) && differing.contains(&member.column);
        if let Some((item, member)) = reading.and_then(|item| Some((item, item.members.iter().find(of_line)?))) {
            let label = format!("{} observed", line.label);
            panel.lines.push(Line { label, role: Role::Observation, unit: item.unit.clone(), member: member.clone() });
        }
    }
}

/// Marks the panels that are shown without being asked for: what is observed, states, actions, the
/// reward, a few outputs.
fn choose_first(panels: &mut [Panel], items: &[Item]) {
    let observed = |panel: &Panel| {
        let is_seen = |line: &Line| items.iter().any(|item| item.observed && item.name == items::base(&line.member.column));
        panel.lines.iter().any(|line| line.role == Role::Observation || is_seen(line))
    };
    let schedule = |panel: &Panel| matches!(panel.title.as_str(), "phase" | "phase_start" | "phase_time");
    let rank = |panel: &Panel| match panel.role {
        Role::State | Role::Output | Role::Observation if observed(panel) => 0,
        Role::Action => 1,
        Role::Reward if panel.lines.iter().any(|line| line.member.column == "reward") => 1,
        Role::State => 2,
        Role::Output => 3,
        Role::Discrete | Role::Disturbance if !schedule(panel) => 4,
        _ => 5,
    };
    let mut order: Vec<usize> = (0..panels.len()).filter(|&i| rank(&panels[i]) < 5).collect();
    order.sort_by_key(|&i| rank(&panels[i]));
    let mut outputs = 0;
    let fits = |&i: &usize| {
        outputs += usize::from(rank(&panels[i]) == 3);
        rank(&panels[i]) != 3 || outputs <= MOST_OUTPUTS
    };
    let chosen: Vec<usize> = order.into_iter().filter(fits).take(MOST_FIRST).collect();
    chosen.into_iter().for_each(|i| panels[i].first = true);
}

impl Panel {
    /// As the protocol has it.
    pub(crate) fn json(&self, id: usize) -> Value {
        let line = |line: &Line| {
            json!({
                "column": line.member.column, "label": line.label, "role": role_name(line.role), "style": style(line.role),
                "low": number(line.member.low), "high": number(line.member.high), "target": line.member.target.and_then(|x| number(x).as_f64()),
            })
        };
        let common = |of: fn(&Member) -> f64| {
            let mut values = self.lines.iter().filter(|line| line.role != Role::Observation).map(|line| of(&line.member));
            let first = values.next().unwrap_or(f64::NAN);
            if values.all(|x| x == first) { number(first) } else { Value::Null }
        };
        json!({
            "id": id, "title": self.title, "group": self.group, "unit": self.lines.first().map_or("", |line| line.unit.as_str()),
            "text": self.text, "role": role_name(self.role), "first": self.first, "low": common(|m| m.low), "high": common(|m| m.high),
            "lines": self.lines.iter().map(line).collect::<Vec<Value>>(),
        })
    }
}

/// The heading of a field.
pub(crate) fn field(item: &Item) -> Value {
    let cells = item.indices.last().map_or(0, |last| last.labels.len());
    let space = item.indices.last().and_then(|last| last.space.as_deref());
    let space = space.map(|s| json!({"name": s.name, "unit": s.unit, "faces": s.faces}));
    json!({
        "name": item.name, "unit": item.unit, "text": item.text, "role": role_name(item.role), "groups": groups(item), "cells": cells,
        "space": space,
    })
}

/// Labels of the rows of cells of a field; one empty label where there is one row.
pub(crate) fn groups(item: &Item) -> Vec<String> {
    let cells = item.indices.last().map_or(1, |last| last.labels.len()).max(1);
    let label = |chunk: &[Member]| chunk[0].label.rsplit_once(',').map_or_else(String::new, |(leading, _)| leading.to_owned());
    item.members.chunks(cells).map(label).collect()
}
