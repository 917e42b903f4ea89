//! Every name of a model as it is seen from outside, kind by kind.

use std::collections::HashSet;

use smpl_compiler::model::{Axis, Choice, Interface, Port, PortMember, Quantity, Variant};

use super::markdown::{code, prose, table};

/// The last chapter of the page; `policies` are those that the model declares.
pub(super) fn page(interface: &Interface, policies: &[&str]) -> String {
    let quantities = [
        ("states", &interface.quantities.states),
        ("actions", &interface.quantities.actions),
        ("disturbances", &interface.quantities.disturbances),
        ("discrete variables", &interface.quantities.discretes),
        ("algebraic variables", &interface.quantities.algebraics),
        ("parameters", &interface.quantities.parameters),
    ];
    let members: HashSet<&str> = interface.ports.iter().flat_map(|port| &port.members).map(|member| member.output.as_str()).collect();
    let mut rows: Vec<Vec<String>> = Vec::new();
    for (kind, list) in quantities {
        let list: Vec<&Quantity> = list.iter().filter(|q| !members.contains(q.name.as_str())).collect();
        let count = list.iter().map(|q| q.len()).sum();
        rows.extend(row(kind, count, list.into_iter().map(indexed).collect()));
    }
    rows.extend(row("ports", interface.ports.len(), interface.ports.iter().map(|port| ported(interface, port)).collect()));
    rows.extend(row("observations", interface.finish.observations.len(), observed(interface)));
    let levels = interface.alternatives.levels.iter().map(|name| code(name)).collect();
    rows.extend(row("levels of observation", interface.alternatives.levels.len(), levels));
    rows.extend(row("phases", interface.phases.len(), interface.phases.iter().map(|name| code(name)).collect()));
    rows.extend(row("rewards", interface.finish.rewards.len(), rewards(interface)));
    let failures =
        ["action_box", "solver", "events", "not_finite"].into_iter().chain(interface.finish.failures.iter().map(|f| f.name.as_str()));
    let failures: Vec<String> = failures.map(code).collect();
    rows.extend(row("failures", failures.len(), failures));
    for (kind, list) in [("successes", &interface.finish.successes), ("constraints", &interface.finish.constraints)] {
        rows.extend(row(kind, list.len(), list.iter().map(|name| code(name)).collect()));
    }
    rows.extend(row(
        "invariants",
        interface.invariants.len(),
        interface.invariants.iter().map(|invariant| code(&invariant.name)).collect(),
    ));
    let policies = policies.iter().copied().chain((!policies.contains(&"nominal")).then_some("nominal"));
    let policies: Vec<String> = policies.map(code).collect();
    rows.extend(row("policies", policies.len(), policies));
    let switch = |variant: &Variant| if variant.on { format!("{} (on)", code(&variant.name)) } else { code(&variant.name) };
    rows.extend(row("variants", interface.alternatives.variants.len(), interface.alternatives.variants.iter().map(switch).collect()));
    let choice = |choice: &Choice| format!("{} ({})", code(&choice.name), prose(choice.chosen().unwrap_or_default()));
    rows.extend(row("choices", interface.alternatives.choices.len(), interface.alternatives.choices.iter().map(choice).collect()));
    let note = "As they are called from the command line and from Python. Four failures are there in every model: \
                `action_box`, an action outside of its box (the step is still integrated); `solver`, the integrator gives up (the state \
                is as before the step); `events`, events without end; `not_finite`, a number of the step is not finite. \
                The policy `nominal` is there too: the nominal actions, where the model does not declare it.";
    format!("\n## Names\n\n{note}\n\n{}", table(&["kind", "how many", "names"], &rows))
}

fn row(kind: &str, count: usize, names: Vec<String>) -> Option<Vec<String>> {
    (!names.is_empty()).then(|| vec![kind.to_owned(), count.to_string(), names.join(", ")])
}

/// A port with the members of its connector: `R1.inlet` (`Q`, `c[tropine .. toluene]`).
fn ported(interface: &Interface, port: &Port) -> String {
    let quantity = |member: &PortMember| interface.quantities.algebraics.iter().find(|q| q.name == member.output).cloned();
    let members = port.members.iter().filter_map(|member| Some(indexed(&Quantity { name: member.name.clone(), ..quantity(member)? })));
    format!("{} ({})", code(&port.name), members.collect::<Vec<_>>().join(", "))
}

/// Name with its indices: `c[tropine .. toluene, 1..40]`.
fn indexed(quantity: &Quantity) -> String {
    if quantity.axes.is_empty() {
        return code(&quantity.name);
    }
    if quantity.pattern.is_some() && !quantity.is_empty() {
        return format!("{} .. {}", code(&quantity.element_name(0)), code(&quantity.element_name(quantity.len() - 1)));
    }
    let axes: Vec<String> = quantity
        .axes
        .iter()
        .map(|axis| match axis {
            Axis::Names(names) if names.len() <= 4 => names.join("/"),
            Axis::Names(names) => format!("{} .. {}", names[0], names[names.len() - 1]),
            Axis::Cells { count, .. } => format!("1..{count}"),
            Axis::Numbers { first, count, .. } => format!("{first}..{}", first + i64::from(*count) - 1),
        })
        .collect();
    code(&format!("{}[{}]", quantity.name, axes.join(", ")))
}

/// Observations, elements of one array together.
fn observed(interface: &Interface) -> Vec<String> {
    let array = |name: &str| name.split('[').next().unwrap_or_default().to_owned();
    let groups = interface.finish.observations.chunk_by(|a, b| array(&a.name) == array(&b.name));
    let shown = |group: &[smpl_compiler::model::Observed]| match group {
        [] => String::new(),
        [one] => code(&one.name),
        [first, .., last] => format!("{} .. {}", code(&first.name), code(&last.name)),
    };
    groups.map(shown).collect()
}

fn rewards(interface: &Interface) -> Vec<String> {
    let shown = |(i, reward): (usize, &smpl_compiler::model::Reward)| {
        if i as u32 == interface.finish.default_reward { format!("{} (default)", code(&reward.name)) } else { code(&reward.name) }
    };
    interface.finish.rewards.iter().enumerate().map(shown).collect()
}
