//! From a JSON text to a flat model.

use std::collections::{BTreeMap, HashMap};

use cranelift_entity::PrimaryMap;
use serde::Deserialize;
use serde_json::Value;
use serde_json::error::Category;

use super::error::{ReadError, fault};
use super::program::ProgramForm;
use super::{Document, Elements, FORMAT, VERSION, each_value, elements, limits, nodes};
use crate::artefact::Circumstances;
use crate::export::{Families, Nominal};
use crate::ir::Program;
use crate::layout::Layout;
use crate::model::{Alternatives, Interface, Model, Programs, Quantities, Quantity, Row, Steady};

/// Content of a text.
pub struct Read {
    /// The flat model, ready for [`CompiledModel::build`](crate::compiled::CompiledModel::build).
    pub model: Model,
    /// Options of its compilation.
    pub circumstances: Circumstances,
}

/// Reads a model that [`print`](super::print) wrote, or another program in the same form.
///
/// # Errors
/// See [`ReadError`]; every text gives an error or a model that the back end takes.
pub fn read(text: &str) -> Result<Read, ReadError> {
    check_version(text)?;
    let mut document: Document = parsed(text)?;
    limits::check(&document)?;
    let circumstances = std::mem::replace(&mut document.made_for, (&Circumstances::default()).into()).into();
    let found = std::mem::take(&mut document.elements);
    let model = model(document)?;
    model.verify()?;
    limits::check_work(&model)?;
    check_elements(&found, &model)?;
    Ok(Read { model, circumstances })
}

/// A type of a text; errors name the place.
fn parsed<'t, T: Deserialize<'t>>(text: &'t str) -> Result<T, ReadError> {
    let mut reader = serde_json::Deserializer::from_str(text);
    let found = serde_path_to_error::deserialize(&mut reader).map_err(|error| {
        let path = error.path().to_string();
        let inner = error.into_inner();
        match inner.classify() {
            Category::Data => fault(if path == "." { "the whole".to_owned() } else { path }, inner.to_string()),
            Category::Syntax | Category::Eof | Category::Io => ReadError::Syntax(inner.to_string()),
        }
    })?;
    reader.end().map_err(|error| ReadError::Syntax(error.to_string()))?;
    Ok(found)
}

fn check_version(text: &str) -> Result<(), ReadError> {
    #[derive(Deserialize)]
    struct Head {
        format: String,
        version: Value,
    }
    let Head { format, version } = parsed(text)?;
    if format != FORMAT {
        return Err(fault("format", format!("expected \"{FORMAT}\"")));
    }
    if version.as_u64() == Some(u64::from(VERSION)) {
        return Ok(());
    }
    Err(ReadError::Version { found: version.to_string().chars().take(40).collect(), expected: VERSION })
}

/// The model of a text, whose invariants are still to be checked.
fn model(d: Document) -> Result<Model, ReadError> {
    let (exprs, ids) = nodes::read(d.expressions).map_err(|(at, why)| fault(format!("expressions[{at}]"), why))?;
    let quantities = Quantities {
        states: d.quantities.states,
        state_order: d.state_order,
        algebraics: d.quantities.outputs,
        solved: d.quantities.solved,
        algebraic_counts: d.algebraic,
        discretes: d.quantities.discretes,
        actions: d.quantities.actions,
        disturbances: d.quantities.disturbances,
        parameters: d.quantities.parameters,
    };
    let none = |name: String| fault("finish.default_reward", format!("there is no reward `{name}`"));
    let steady = d.steady.map(|form| {
        let fixed = places(&form.fixed, &quantities.states)?;
        Ok::<_, ReadError>(Steady { fixed, conditions: form.conditions, given: form.given, free: form.free })
    });
    let interface = Interface {
        name: d.name,
        text: d.text,
        time: d.time,
        ports: d.ports,
        grids: d.grids,
        phases: d.phases,
        draws: d.draws,
        finish: d.finish.finish().map_err(none)?,
        invariants: d.invariants,
        steady: steady.transpose()?,
        start_conditions: d.start_conditions,
        start_resets: d.start_resets,
        measured: d.measured,
        episode: d.episode,
        solver: d.solver,
        alternatives: Alternatives { levels: d.levels, variants: d.variants, choices: d.choices.into_iter().map(Into::into).collect() },
        tests: Vec::new(),
        reduction: d.reduction.map(Into::into).unwrap_or_default(),
        quantities,
    };
    let mut model = Model {
        exprs,
        vars: d.variables.into_iter().collect::<PrimaryMap<_, _>>(),
        unknowns: d.unknowns,
        rows: d.equations.into_iter().map(Row::from).collect(),
        explicit: d.explicit,
        roots: d.events,
        quadratures: d.integrals,
        quadrature_units: Vec::new(),
        delays: d.delays,
        programs: programs(d.programs, d.policies)?,
        interface,
    };
    // Positions behind the list name no node, which the check of the model finds.
    each_value(&mut model, |e| *e = ids.get(e.as_u32() as usize).copied().unwrap_or(*e));
    Ok(model)
}

/// Positions of states by their names.
fn places(names: &[String], states: &[Quantity]) -> Result<Vec<u32>, ReadError> {
    let known = states.iter().flat_map(|q| (0..q.len()).map(|e| q.element_name(e)));
    let known: HashMap<String, u32> = known.zip(0..).collect();
    let place = |(i, name): (usize, &String)| {
        known.get(name).copied().ok_or_else(|| fault(format!("steady.fixed[{i}]"), format!("there is no state `{name}`")))
    };
    names.iter().enumerate().map(place).collect()
}

/// Programs by their names; policies in their order.
fn programs(mut forms: BTreeMap<String, ProgramForm>, policies: Vec<String>) -> Result<Programs, ReadError> {
    let mut programs = Programs::default();
    while forms.contains_key(&format!("event {}", programs.events.len())) {
        programs.events.push(Program::default());
    }
    programs.policies = policies.into_iter().map(|name| (name, Program::default())).collect();
    for (name, program) in programs.named_mut() {
        match forms.remove(&name) {
            Some(form) => *program = form.program().map_err(|(at, why)| fault(format!("programs.{name}.{at}"), why))?,
            None if Programs::OPTIONAL.contains(&name.as_str()) => {}
            None => return Err(fault("programs", format!("missing field `{name}`"))),
        }
    }
    match forms.into_keys().next() {
        Some(name) => {
            let why = format!("unknown program `{name}`: policies are listed in `policies`, events counted from 0");
            Err(fault("programs", why))
        }
        None => Ok(programs),
    }
}

/// The single numbers follow from the quantities; a text that states others is refused.
fn check_elements(found: &Elements, model: &Model) -> Result<(), ReadError> {
    let layout = Layout::new(model, 0);
    let nominal = Nominal { layout: &layout, y: &[], work: &[], outputs: &[] };
    let expected = elements(&Families::new(model, &nominal));
    if let Some(family) = found.keys().find(|family| !expected.contains_key(*family)) {
        return Err(fault("elements", format!("unknown field `{family}`")));
    }
    for (family, expected) in expected {
        let list = found.get(&family).map_or(&[][..], Vec::as_slice);
        if list.len() != expected.len() {
            return Err(fault(format!("elements.{family}"), format!("expected {} elements, as in the `quantities`", expected.len())));
        }
        for (i, (found, expected)) in list.iter().zip(&expected).enumerate() {
            let place = |field: &str| format!("elements.{family}[{i}].{field}");
            if let Some(field) = found.keys().find(|field| !expected.contains_key(*field)) {
                return Err(fault(place(field), "unknown field"));
            }
            let differs = |(field, value): &(&String, &Value)| *field != "nominal" && found.get(*field) != Some(value);
            if let Some((field, value)) = expected.iter().find(differs) {
                return Err(fault(place(field), format!("the `quantities` state {value}")));
            }
        }
    }
    Ok(())
}
