//! A model described in Markdown: tables of everything with a name, and the equations typeset.

mod equations;

use std::fmt::Write;

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::model::{Axis, Observed, Quantity};

use crate::failure::Short;

pub use equations::latex;

/// The page of a model; `equations` is LaTeX, one display a line, and may be empty.
#[must_use]
pub fn markdown(model: &CompiledModel, equations: &str) -> String {
    let interface = model.interface();
    let mut page = format!("# {}\n\n{}\n\nTime in {}.\n", interface.name, interface.text, interface.time.1);
    quantities(&mut page, "States", &interface.states, "initial");
    quantities(&mut page, "Actions", &interface.actions, "nominal");
    quantities(&mut page, "Discrete variables", &interface.discretes, "initial");
    quantities(&mut page, "Disturbances", &interface.disturbances, "initial");
    quantities(&mut page, "Algebraic variables", &interface.algebraics, "");
    quantities(&mut page, "Parameters", &interface.parameters, "value");
    section(&mut page, "Equations", equations.lines().map(|line| format!("$$\n{line}\n$$\n")).collect());
    observations(&mut page, model);
    rewards(&mut page, model);
    ends(&mut page, model);
    invariants(&mut page, model);
    alternatives(&mut page, model);
    page
}

fn section(page: &mut String, title: &str, lines: Vec<String>) {
    if !lines.is_empty() {
        // Writing into a string cannot fail.
        let _ = writeln!(page, "\n## {title}\n");
        lines.iter().for_each(|line| {
            page.push_str(line);
            page.push('\n');
        });
    }
}

/// Heading and rows of a table.
fn table(page: &mut String, title: &str, heading: &[&str], rows: Vec<Vec<String>>) {
    if rows.is_empty() {
        return;
    }
    let line = |cells: Vec<String>| format!("| {} |", cells.join(" | "));
    let mut lines = vec![line(heading.iter().map(|h| (*h).to_owned()).collect()), format!("|{}", "---|".repeat(heading.len()))];
    lines.extend(rows.into_iter().map(|cells| line(cells.iter().map(|c| c.replace('|', "\\|")).collect())));
    section(page, title, lines);
}

fn quantities(page: &mut String, title: &str, all: &[Quantity], value: &str) {
    let rows = all
        .iter()
        .map(|q| {
            let mut row = vec![format!("`{}`", indexed(q)), q.unit.clone()];
            if !value.is_empty() {
                row.extend([range(&q.default), range(&q.low), range(&q.high)]);
            }
            row.push(q.text.clone());
            row
        })
        .collect();
    match value {
        "" => table(page, title, &["name", "unit", "meaning"], rows),
        value => table(page, title, &["name", "unit", value, "low", "high", "meaning"], rows),
    }
}

/// Name with its indices: `c[9 names, 1..40]`.
fn indexed(quantity: &Quantity) -> String {
    if quantity.axes.is_empty() {
        return quantity.name.clone();
    }
    let axes: Vec<String> = quantity
        .axes
        .iter()
        .map(|axis| match axis {
            Axis::Names(names) if names.len() <= 4 => names.join("/"),
            Axis::Names(names) => format!("{} .. {}", names[0], names[names.len() - 1]),
            Axis::Numbers { first, count } => format!("{first}..{}", first + i64::from(*count) - 1),
        })
        .collect();
    format!("{}[{}]", quantity.name, axes.join(", "))
}

/// The values of all elements in brief.
fn range(values: &[f64]) -> String {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
    match values {
        [] => String::new(),
        // Given by an expression.
        _ if values.iter().any(|v| v.is_nan()) => String::new(),
        [one] if one.is_infinite() => String::new(),
        _ if low == high => Short(low).to_string(),
        _ => format!("{} to {}", Short(low), Short(high)),
    }
}

fn observations(page: &mut String, model: &CompiledModel) {
    let interface = model.interface();
    // Elements of one array in a row of the table.
    let array = |o: &Observed| o.name.split('[').next().unwrap_or_default().to_owned();
    let groups = interface.observations.chunk_by(|a, b| {
        array(a) == array(b) && (&a.unit, a.every, a.delay, a.noise, a.low, a.high) == (&b.unit, b.every, b.delay, b.noise, b.low, b.high)
    });
    let rows = groups.filter_map(|group| {
        let (first, last) = (group.first()?, group.last()?);
        let name = if group.len() == 1 { format!("`{}`", first.name) } else { format!("`{}` .. `{}`", first.name, last.name) };
        let sampling = if first.every > 1 { format!("every {} steps", first.every) } else { String::new() };
        let delay = if first.delay > 0 { format!("{} steps late", first.delay) } else { String::new() };
        let noise = if first.noise > 0.0 { format!("noise {}", Short(first.noise)) } else { String::new() };
        let notes: Vec<String> = [sampling, delay, noise].into_iter().filter(|s| !s.is_empty()).collect();
        Some(vec![name, first.unit.clone(), Short(first.low).to_string(), Short(first.high).to_string(), notes.join(", ")])
    });
    table(page, "Observations", &["name", "unit", "low", "high", "measurement"], rows.collect());
}

fn rewards(page: &mut String, model: &CompiledModel) {
    let interface = model.interface();
    let rows = interface.rewards.iter().enumerate().map(|(i, r)| {
        let default = if i as u32 == interface.default_reward { "yes" } else { "" };
        vec![format!("`{}`", r.name), r.unit.clone(), default.into(), r.text.clone()]
    });
    table(page, "Rewards", &["name", "unit", "default", "meaning"], rows.collect());
}

fn ends(page: &mut String, model: &CompiledModel) {
    let interface = model.interface();
    let mut rows = vec![
        vec!["failure `action_box`".into(), "an action outside its box; the step is still integrated".into()],
        vec!["failure `solver`".into(), "the integrator gives up; the state is as before the step".into()],
    ];
    rows.extend(interface.failures.iter().map(|f| {
        let items: Vec<String> =
            f.items.iter().map(|i| format!("{} in {}..{} {}", i.name, Short(i.low), Short(i.high), i.unit).trim_end().to_owned()).collect();
        let text = if f.text.is_empty() { items.join(", ") } else { f.text.clone() };
        vec![format!("failure `{}`{}", f.name, if f.event { " (event)" } else { "" }), text]
    }));
    rows.extend(interface.successes.iter().map(|name| vec![format!("success `{name}`"), String::new()]));
    rows.extend(interface.constraints.iter().map(|name| vec![format!("constraint `{name}`"), "a cost, ends nothing".into()]));
    let episode = &interface.episode;
    let end = if episode.end_is_success { "success" } else { "time limit" };
    rows.push(vec![end.into(), format!("after {} steps of {} {}", episode.max_steps, Short(episode.step), interface.time.1)]);
    table(page, "Ends of an episode", &["event", "when"], rows);
    // Writing into a string cannot fail.
    let _ = writeln!(page, "\nOn a failing step every reward is {}.", Short(episode.error_reward));
}

fn invariants(page: &mut String, model: &CompiledModel) {
    let rows = model.interface().invariants.iter().map(|(name, text)| vec![format!("`{name}`"), text.clone()]);
    table(page, "Invariants", &["name", "conserved, but for its rate"], rows.collect());
}

fn alternatives(page: &mut String, model: &CompiledModel) {
    let interface = model.interface();
    let switches = interface
        .variants
        .iter()
        .map(|(name, on)| vec![format!("`{name}`"), "switch".into(), if *on { "on".into() } else { "off".into() }]);
    let choices = interface.choices.iter().map(|(name, options, chosen)| {
        let chosen = options.get(*chosen as usize).cloned().unwrap_or_default();
        vec![format!("`{name}`"), options.join(", "), chosen]
    });
    table(page, "Variants and choices", &["name", "options", "here"], switches.chain(choices).collect());
}
