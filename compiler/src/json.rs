//! The checked model as JSON, both ways, in the form that `docs/schema/model-3.schema.json` fixes.
//!
//! Expressions are one list of nodes, operands before users: trees whose repeated parts are written
//! once. Loops stay loops. The text holds all that the back end needs: [`read`] returns the flat
//! model that [`print`] wrote. It compiles to the same functions and is written again as the same
//! bytes. [`read`] accepts any text: it gives a model that keeps [every
//! invariant](crate::verify), or an error that names the place.

mod address;
mod error;
mod form;
mod limits;
mod nodes;
mod program;
mod read;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

pub use error::ReadError;
pub use read::{Read, read};

use self::form::{ChoiceForm, CircumstancesForm, FinishForm, ReductionForm, RowForm, SteadyForm};
use self::nodes::{Node, written};
use self::program::ProgramForm;
use crate::export::{Element, ExportError, Families, Nominal, Origin};
use crate::ir::{ExprId, Program, Role, VarId};
use crate::model::number::present;
use crate::model::{
    AlgebraicCounts, Delay, Draw, Episode, Grid, Invariant, Model, Port, Programs, Quantity, Root, Solver, StartCondition, Steady, Time,
    Variable, Variant,
};

/// Version of the form; what changes the meaning of a file counts it up.
pub const VERSION: u32 = 3;

/// Value of the field `format`.
const FORMAT: &str = "smpl-model";

/// Single numbers of each family, which follow from the quantities: for readers of the text.
type Elements = BTreeMap<String, Vec<Map<String, Value>>>;

/// A text.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    format: String,
    version: u32,
    name: String,
    text: String,
    made_for: CircumstancesForm,
    time: Time,
    explicit: bool,
    #[serde(with = "form::variables")]
    variables: Vec<Variable>,
    unknowns: Vec<VarId>,
    quantities: QuantitiesForm,
    ports: Vec<Port>,
    #[serde(with = "form::grids")]
    grids: Vec<Grid>,
    #[serde(deserialize_with = "present")]
    state_order: Option<Vec<u32>>,
    algebraic: AlgebraicCounts,
    elements: Elements,
    expressions: Vec<Node>,
    equations: Vec<RowForm>,
    #[serde(with = "form::roots")]
    events: Vec<Root>,
    integrals: Vec<ExprId>,
    programs: BTreeMap<String, ProgramForm>,
    policies: Vec<String>,
    finish: FinishForm,
    draws: Vec<Draw>,
    levels: Vec<String>,
    phases: Vec<String>,
    invariants: Vec<Invariant>,
    #[serde(deserialize_with = "present")]
    steady: Option<SteadyForm>,
    #[serde(default, with = "form::conditions")]
    start_conditions: Vec<StartCondition>,
    start_resets: bool,
    #[serde(with = "form::episode")]
    episode: Episode,
    #[serde(with = "form::solver")]
    solver: Solver,
    variants: Vec<Variant>,
    choices: Vec<ChoiceForm>,
    #[serde(default, with = "form::delays", skip_serializing_if = "Vec::is_empty")]
    delays: Vec<Delay>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reduction: Option<ReductionForm>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    measured: Vec<String>,
}

/// The families of quantities.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct QuantitiesForm {
    #[serde(with = "form::quantities")]
    states: Vec<Quantity>,
    #[serde(with = "form::quantities")]
    solved: Vec<Quantity>,
    #[serde(with = "form::quantities")]
    outputs: Vec<Quantity>,
    #[serde(with = "form::quantities")]
    discretes: Vec<Quantity>,
    #[serde(with = "form::quantities")]
    actions: Vec<Quantity>,
    #[serde(with = "form::quantities")]
    disturbances: Vec<Quantity>,
    #[serde(with = "form::quantities")]
    parameters: Vec<Quantity>,
}

/// The text of a model.
///
/// # Errors
/// If a value cannot be written.
pub(crate) fn print(model: &Model, nominal: &Nominal<'_>, origin: &Origin<'_>) -> Result<String, ExportError> {
    let document = Document::new(model.clone(), nominal, origin);
    // By way of a value, whose fields are in alphabetical order.
    Ok(serde_json::to_string_pretty(&serde_json::to_value(&document)?)? + "\n")
}

impl Document {
    fn new(mut model: Model, nominal: &Nominal<'_>, origin: &Origin<'_>) -> Document {
        let families = Families::new(&model, nominal);
        let mut used = Vec::new();
        each_value(&mut model, |e| used.push(*e));
        let (expressions, positions) = written(&model.exprs, used);
        each_value(&mut model, |e| *e = positions[e]);
        // Those of delays where there are delays.
        let is_written = |(name, program): &(String, &Program)| {
            !program.nests.is_empty() || name == "start_conditions" || !Programs::OPTIONAL.contains(&name.as_str())
        };
        let programs = model.programs.named().filter(is_written).map(|(name, program)| (name, program.into())).collect();
        let (q, i) = (&model.interface.quantities, &model.interface);
        Document {
            format: FORMAT.into(),
            version: VERSION,
            made_for: origin.circumstances.into(),
            explicit: model.explicit,
            variables: model.vars.values().filter(|v| v.role != Role::Cache).map(listed).collect(),
            quantities: QuantitiesForm {
                states: q.states.clone(),
                solved: q.solved.clone(),
                outputs: q.algebraics.clone(),
                discretes: q.discretes.clone(),
                actions: q.actions.clone(),
                disturbances: q.disturbances.clone(),
                parameters: q.parameters.clone(),
            },
            state_order: q.state_order.clone(),
            algebraic: q.algebraic_counts,
            steady: i.steady.as_ref().map(|steady| steady_form(steady, &families, q.state_order.as_deref())),
            elements: elements(&families),
            expressions,
            equations: model.rows.iter().map(RowForm::from).collect(),
            integrals: model.quadratures.clone(),
            programs,
            policies: model.programs.policies.iter().map(|(name, _)| name.clone()).collect(),
            finish: FinishForm::from(&i.finish),
            choices: i.alternatives.choices.iter().map(ChoiceForm::from).collect(),
            reduction: i.reduction.is_recorded().then(|| ReductionForm::from(&i.reduction)),
            unknowns: model.unknowns,
            events: model.roots,
            delays: model.delays,
            name: model.interface.name,
            text: model.interface.text,
            time: model.interface.time,
            ports: model.interface.ports,
            grids: model.interface.grids,
            draws: model.interface.draws,
            levels: model.interface.alternatives.levels,
            phases: model.interface.phases,
            invariants: model.interface.invariants,
            start_conditions: model.interface.start_conditions,
            start_resets: model.interface.start_resets,
            measured: model.interface.measured,
            episode: model.interface.episode,
            solver: model.interface.solver,
            variants: model.interface.alternatives.variants,
        }
    }
}

/// The variable as it is listed: one of delayed values that none are left of holds nothing.
fn listed(variable: &Variable) -> Variable {
    let role = if variable.len == 0 && variable.role == Role::Delayed { Role::Scratch } else { variable.role };
    Variable { role, ..variable.clone() }
}

/// Visits what is evaluated.
fn each_value(model: &mut Model, mut visit: impl FnMut(&mut ExprId)) {
    model.rows.iter_mut().for_each(|row| visit(&mut row.residual));
    model.roots.iter_mut().for_each(|root| visit(&mut root.value));
    model.quadratures.iter_mut().for_each(&mut visit);
    for (_, program) in model.programs.named_mut() {
        program.nests.iter_mut().flat_map(|nest| &mut nest.stores).for_each(|store| visit(&mut store.value));
    }
}

/// The single numbers of all families.
fn elements(families: &Families) -> Elements {
    let form = |e: &Element| {
        let fields = json!({
            "name": e.name, "unit": e.unit, "text": e.text,
            "low": e.low, "high": e.high, "scale": e.scale, "nominal": e.nominal, "structural": e.structural,
            "variable": e.place.map(|(var, _)| var), "element": e.place.map(|(_, element)| element),
        });
        fields.as_object().cloned().unwrap_or_default()
    };
    let families = [
        ("states", &families.states),
        ("solved", &families.solved),
        ("outputs", &families.outputs),
        ("discretes", &families.discretes),
        ("actions", &families.actions),
        ("disturbances", &families.disturbances),
        ("parameters", &families.parameters),
    ];
    families.into_iter().map(|(name, family)| (name.to_owned(), family.iter().map(form).collect())).collect()
}

/// The steady problem with the names of its fixed states.
fn steady_form(steady: &Steady, families: &Families, order: Option<&[u32]>) -> SteadyForm {
    let mut inside: Vec<&Element> = families.states.iter().collect();
    if let Some(order) = order {
        order.iter().zip(&families.states).for_each(|(&at, element)| inside[at as usize] = element);
    }
    let fixed = steady.fixed.iter().filter_map(|&at| Some(inside.get(at as usize)?.name.clone())).collect();
    SteadyForm { fixed, conditions: steady.conditions, given: steady.given, free: steady.free.clone() }
}
