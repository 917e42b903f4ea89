//! From a JSON text to a flat model.

use cranelift_entity::{EntityRef, PrimaryMap};
use serde_json::Value;
use smpl_dsl::span::Span;

use super::bounds::{Bounds, within};
use super::cursor::{At, MAX_ELEMENTS, ReadError};
use super::interface::{self, count, texts};
use super::nodes::{Nodes, address, extents, variable};

use super::{FORMAT, VERSION, write};
use crate::artefact::Circumstances;
use crate::export::{Families, Nominal};
use crate::ir::{BUILTIN_COUNT, DELAY_SLOTS, ExprId, MAX_DEPTH, Place, Program, Role, VarId, loops_of};
use crate::layout::Layout;
use crate::model::{Delay, Lag, Model, Programs, Root, RootAction, Row, Variable};
use crate::structure::is_explicit;

/// Content of a text.
pub struct Read {
    /// The flat model, ready for [`CompiledModel::build`](crate::compiled::CompiledModel::build).
    pub model: Model,
    /// Options of its compilation.
    pub circumstances: Circumstances,
}

#[rustfmt::skip]
const FIELDS: [&str; 34] = [
    "format", "version", "name", "text", "made_for", "time", "explicit", "variables", "unknowns", "quantities", "ports", "grids", "state_order",
    "algebraic", "elements", "expressions", "equations", "events", "integrals", "programs", "policies", "finish", "draws", "levels", "phases", "invariants",
    "steady", "start_conditions", "start_resets", "episode", "solver", "variants", "choices", "delays",
];

/// Reads a model that [`print`](super::print) wrote, or another program in the same form.
///
/// # Errors
/// See [`ReadError`]; whatever the text is, it is an error or a model that the back end takes.
pub fn read(text: &str) -> Result<Read, ReadError> {
    let value: Value = serde_json::from_str(text).map_err(|error| ReadError::Syntax(error.to_string()))?;
    let root = At::root(&value);
    check_version(&root)?;
    root.only(&[&FIELDS[..], &["reduction", "measured"]].concat())?;
    let vars = variables(&root.field("variables")?)?;
    let mut model = Model { interface: interface::read(&root, &vars)?, vars, ..Model::default() };
    if let Some(at) = root.maybe("delays")? {
        model.delays = at.list(delay)?;
    }
    check_roles(&root, &model)?;
    model.unknowns = unknowns(&root.field("unknowns")?, &model.vars)?;
    check_families(&root, &model)?;
    let mut nodes = Nodes::read(&root.field("expressions")?, &model.vars)?;
    model.rows = rows(&root.field("equations")?, &nodes, &model)?;
    model.roots = roots(&root.field("events")?, &nodes, &model)?;
    model.quadratures = root.field("integrals")?.list(|at| nodes.number(at))?;
    model.programs = programs(&root, &nodes, &model)?;
    model.exprs = std::mem::take(&mut nodes.exprs);
    check_bounds(&root, &model)?;
    check_delays(&root, &model)?;
    check_covered(&root.field("equations")?, &model)?;
    model.explicit = root.field("explicit")?.flag()?;
    if model.explicit != is_explicit(&model) {
        return Err(root.field("explicit")?.fault("the equations say otherwise"));
    }
    check_elements(&root.field("elements")?, &model)?;
    model.verify().map_err(|violation| ReadError::Place { path: violation.place, message: violation.message })?;
    let circumstances = made_for(&root.field("made_for")?)?;
    Ok(Read { model, circumstances })
}

fn check_version(root: &At<'_>) -> Result<(), ReadError> {
    let format = root.field("format")?;
    if format.text()? != FORMAT {
        return Err(format.fault(format!("expected \"{FORMAT}\"")));
    }
    let version = root.field("version")?;
    if version.value().as_u64() == Some(u64::from(VERSION)) {
        return Ok(());
    }
    Err(ReadError::Version { found: version.value().to_string().chars().take(40).collect(), expected: VERSION })
}

fn made_for(at: &At<'_>) -> Result<Circumstances, ReadError> {
    at.only(&["scenario", "variants", "settings"])?;
    let scenario = at.field("scenario")?;
    let scenario = if scenario.is_null() {
        None
    } else {
        scenario.only(&["name", "text"])?;
        Some((scenario.field("name")?.string()?, scenario.field("text")?.string()?))
    };
    let settings = at.field("settings")?;
    let settings = settings.fields()?.map(|(name, value)| Ok((name.to_owned(), value.string()?))).collect::<Result<_, ReadError>>()?;
    Ok(Circumstances { scenario, variants: texts(&at.field("variants")?)?, settings })
}

fn variables(at: &At<'_>) -> Result<PrimaryMap<VarId, Variable>, ReadError> {
    let mut elements = 0_usize;
    let mut vars = PrimaryMap::new();
    for item in at.items()? {
        item.only(&["name", "role", "length"])?;
        let len = item.field("length")?.count(MAX_ELEMENTS as u32)?;
        elements += len as usize;
        if elements > MAX_ELEMENTS {
            return Err(item.fault(format!("more than {MAX_ELEMENTS} elements of all variables together")));
        }
        vars.push(Variable { name: item.field("name")?.string()?, role: item.field("role")?.word()?, len, span: Span::default() });
    }
    Ok(vars)
}

/// Variables that the runtime fills have the sizes that it fills.
fn check_roles(root: &At<'_>, model: &Model) -> Result<(), ReadError> {
    let at = root.field("variables")?;
    let total = |role: Role| model.vars.values().filter(|v| v.role == role).map(|v| v.len as usize).sum::<usize>();
    let i = &model.interface;
    let integrals = root.field("integrals")?.items()?.len();
    let sizes = [
        (Role::Builtin, BUILTIN_COUNT as usize, "values of the runtime"),
        (Role::Draw, i.draws.len(), "the random numbers (`draws`)"),
        (Role::Quadrature, integrals, "the `integrals`"),
        (Role::Delayed, DELAY_SLOTS as usize * model.delayed(), "the `delays`"),
    ];
    for (role, expected, what) in sizes {
        let found = total(role);
        let needed = role != Role::Builtin || found != 0;
        if found != expected && needed {
            return Err(at.fault(format!("variables of role {role:?} have {found} elements in all, {what} {expected}")));
        }
        if matches!(role, Role::Builtin | Role::Draw | Role::Quadrature | Role::Delayed)
            && model.vars.values().filter(|v| v.role == role).count() > 1
        {
            return Err(at.fault(format!("more than one variable of role {role:?}")));
        }
    }
    let given = total(Role::ParamGiven);
    if given != 0 && given != total(Role::Param) {
        return Err(at.fault(format!("variables of role `given` have {given} elements in all, the parameters {}", total(Role::Param))));
    }
    Ok(())
}

fn unknowns(at: &At<'_>, vars: &PrimaryMap<VarId, Variable>) -> Result<Vec<VarId>, ReadError> {
    let mut seen = vec![false; vars.len()];
    let mut solved = false;
    let mut unknowns = vec![];
    for item in at.items()? {
        let var = variable(&item, vars)?;
        match vars[var].role {
            _ if std::mem::replace(&mut seen[var.index()], true) => return Err(item.fault("is in the list already")),
            Role::State if solved => return Err(item.fault("a state follows an algebraic variable")),
            Role::State => {}
            Role::Algebraic => solved = true,
            _ => return Err(item.fault(format!("`{}` is neither state nor algebraic variable", vars[var].name))),
        }
        unknowns.push(var);
    }
    match vars.iter().find(|(var, v)| v.role == Role::State && !seen[var.index()]) {
        Some((_, state)) => Err(at.fault(format!("the state `{}` is missing", state.name))),
        None => Ok(unknowns),
    }
}

/// States and solved variables among the quantities are those that equations determine, in the same
/// order.
fn check_families(root: &At<'_>, model: &Model) -> Result<(), ReadError> {
    let at = root.field("quantities")?;
    let length =
        |role: Role| model.unknowns.iter().map(|v| &model.vars[*v]).filter(|v| v.role == role).map(|v| v.len as usize).sum::<usize>();
    for (name, quantities, role) in
        [("states", &model.interface.quantities.states, Role::State), ("solved", &model.interface.quantities.solved, Role::Algebraic)]
    {
        let (found, expected) = (count(quantities), length(role));
        if found != expected {
            return Err(at.field(name)?.fault(format!("{found} elements, the `unknowns` have {expected}")));
        }
    }
    Ok(())
}

fn rows(at: &At<'_>, nodes: &Nodes, model: &Model) -> Result<Vec<Row>, ReadError> {
    at.list(|item| {
        item.only(&["extents", "unknown", "residual"])?;
        let unknown = item.field("unknown")?;
        unknown.only(&["variable", "at"])?;
        Ok(Row {
            extents: extents(&item.field("extents")?)?,
            var: variable(&unknown.field("variable")?, &model.vars)?,
            at: address(&unknown.field("at")?)?,
            residual: nodes.number(&item.field("residual")?)?,
            span: Span::default(),
        })
    })
}

fn roots(at: &At<'_>, nodes: &Nodes, model: &Model) -> Result<Vec<Root>, ReadError> {
    at.list(|item| {
        item.only(&["name", "value", "strict", "does"])?;
        let does = item.field("does")?;
        let action = match does.value() {
            Value::String(word) if word == "restart" => RootAction::Restart,
            Value::Object(_) if does.maybe("fail")?.is_some() => {
                does.only(&["fail"])?;
                RootAction::Fail(does.field("fail")?.index(model.interface.finish.failures.len(), "failure")? as u32)
            }
            Value::Object(_) if does.maybe("succeed")?.is_some() => {
                does.only(&["succeed"])?;
                RootAction::Succeed(does.field("succeed")?.index(model.interface.finish.successes.len(), "success")? as u32)
            }
            Value::Object(_) => {
                does.only(&["run"])?;
                let run = does.field("run")?;
                let number = run.text()?.strip_prefix("event ").and_then(|n| n.parse().ok());
                RootAction::Run(number.ok_or_else(|| run.fault("expected `event` and the number of the program"))?)
            }
            _ => return Err(does.fault("expected \"restart\", {\"fail\": NUMBER}, {\"succeed\": NUMBER} or {\"run\": \"event NUMBER\"}")),
        };
        Ok(Root {
            name: item.field("name")?.string()?,
            value: nodes.number(&item.field("value")?)?,
            strict: item.field("strict")?.flag()?,
            action,
        })
    })
}

fn programs(root: &At<'_>, nodes: &Nodes, model: &Model) -> Result<Programs, ReadError> {
    let at = root.field("programs")?;
    let one = |name: &str| nodes.program(&at.field(name)?, &model.vars);
    let maybe = |name: &str| at.maybe(name)?.map_or_else(|| Ok(Program::default()), |at| nodes.program(&at, &model.vars));
    let policies = texts(&root.field("policies")?)?;
    let policies =
        policies.into_iter().map(|name| Ok((name.clone(), one(&format!("policy {name}"))?))).collect::<Result<Vec<_>, ReadError>>()?;
    let mut events = vec![];
    while at.maybe(&format!("event {}", events.len()))?.is_some() {
        events.push(one(&format!("event {}", events.len()))?);
    }
    let programs = Programs {
        parameters: one("parameters")?,
        initial_states: one("initial_states")?,
        initial_discretes: one("initial_discretes")?,
        steady: one("steady")?,
        start_conditions: if at.maybe("start_conditions")?.is_some() { one("start_conditions")? } else { Program::default() },
        disturb: one("disturb")?,
        start: one("start")?,
        end: one("end")?,
        finish: one("finish")?,
        outputs: one("outputs")?,
        events,
        policies,
        invariants: one("invariants")?,
        boxes: one("boxes")?,
        delayed: maybe("delayed")?,
        lags: maybe("lags")?,
        before: maybe("before")?,
    };
    let known = programs.named();
    if let Some((name, _)) = at.fields()?.find(|(name, _)| !known.iter().any(|(known, _)| known == name)) {
        return Err(at.fault(format!("unknown program `{name}`: policies are listed in `policies`, events counted from 0")));
    }
    let missing = model.roots.iter().find_map(|root| match root.action {
        RootAction::Run(i) if i as usize >= programs.events.len() => Some(i),
        _ => None,
    });
    match missing {
        Some(i) => Err(at.fault(format!("the program `event {i}` is missing"))),
        None => Ok(programs),
    }
}

fn delay(at: &At<'_>) -> Result<Delay, ReadError> {
    at.only(&["name", "count", "changes", "bounds", "before"])?;
    let lag: Lag = at.field("changes")?.word()?;
    let bounds = at.field("bounds")?;
    let bounds = if lag == Lag::Constant || bounds.is_null() {
        (f64::INFINITY, f64::INFINITY)
    } else {
        match bounds.list(|at| at.number_or(f64::NAN))?[..] {
            [low, high] if 0.0 <= low && low <= high && high.is_finite() => (low, high),
            _ => return Err(bounds.fault("expected two numbers from 0 on, the lower one first")),
        }
    };
    let (name, count) = (at.field("name")?.string()?, at.field("count")?.count(MAX_ELEMENTS as u32)?);
    Ok(Delay { name, count, bounds, lag, before: at.field("before")?.flag()?, span: Span::default() })
}

/// Delayed expression and dead time, written once for each element.
fn check_delays(root: &At<'_>, model: &Model) -> Result<(), ReadError> {
    let len = model.delayed();
    let programs = &model.programs;
    let first = |given: bool| {
        let mut at = 0;
        let each = model.delays.iter().map(move |delay| {
            at += delay.count as usize;
            (at - delay.count as usize..at, given && !delay.before)
        });
        each.filter(|(_, left_out)| !left_out).flat_map(|(range, _)| range).collect::<Vec<_>>()
    };
    for (name, program, needed) in
        [("delayed", &programs.delayed, first(false)), ("lags", &programs.lags, first(false)), ("before", &programs.before, first(true))]
    {
        let mut written = vec![false; len];
        for nest in &program.nests {
            for pass in 0..nest.extents().iter().map(|&e| u64::from(e)).fold(1, u64::saturating_mul).min(len as u64 + 1) {
                for store in &nest.stores {
                    let at = usize::try_from(store.target.at.at(&counters(pass, &nest.extents()))).unwrap_or(usize::MAX);
                    match written.get_mut(at) {
                        Some(written) if store.target.place == Place::Out && !*written => *written = true,
                        _ => {
                            return Err(root
                                .field("programs")?
                                .fault(format!("`{name}` does not write each of {len} delayed elements once")));
                        }
                    }
                }
            }
        }
        if needed.into_iter().any(|at| !written[at]) {
            return Err(root.field("programs")?.fault(format!("`{name}` leaves out a delayed element")));
        }
    }
    Ok(())
}

/// All that is evaluated and stored stays within its arrays.
fn check_bounds(root: &At<'_>, model: &Model) -> Result<(), ReadError> {
    let mut bounds = Bounds::new(model);
    let equations = root.field("equations")?;
    for (at, row) in equations.items()?.zip(&model.rows) {
        bounds.value(&at, row.residual, &row.extents)?;
        let variable = &model.vars[row.var];
        within(row.at, &loops_of(&row.extents), variable.len).map_err(|why| at.fault(format!("`{}`: {why}", variable.name)))?;
    }
    let values = |field: &'static str, values: Vec<ExprId>, bounds: &mut Bounds<'_>| -> Result<(), ReadError> {
        let list = root.field(field)?;
        list.items()?.zip(values).try_for_each(|(at, value)| bounds.value(&at, value, &[]))
    };
    values("events", model.roots.iter().map(|r| r.value).collect(), &mut bounds)?;
    values("integrals", model.quadratures.clone(), &mut bounds)?;
    let programs = root.field("programs")?;
    for (name, program) in model.programs.named() {
        check_program(&programs.field(&name)?, program, model, &mut bounds)?;
    }
    Ok(())
}

fn check_program(at: &At<'_>, program: &Program, model: &Model, bounds: &mut Bounds<'_>) -> Result<(), ReadError> {
    let nests = at.field("nests")?;
    for (at, nest) in nests.items()?.zip(&program.nests) {
        for (at, store) in at.field("stores")?.items()?.zip(&nest.stores) {
            bounds.value(&at, store.value, &nest.extents())?;
            let (what, len) = match store.target.place {
                Place::Var(var) => (model.vars[var].name.as_str(), model.vars[var].len),
                // How long the output is depends on the program: the back end compares.
                Place::Out | Place::Table { .. } => ("the output", u32::MAX),
            };
            within(store.target.at, &loops_of(&nest.extents()), len).map_err(|why| at.fault(format!("`{what}`: {why}")))?;
        }
    }
    Ok(())
}

/// Every unknown element has one equation.
fn check_covered(at: &At<'_>, model: &Model) -> Result<(), ReadError> {
    let mut covered: Vec<Vec<bool>> = model.vars.values().map(|v| vec![false; v.len as usize]).collect();
    for (at, row) in at.items()?.zip(&model.rows) {
        if !model.unknowns.contains(&row.var) {
            return Err(at.fault(format!("`{}` is not an unknown", model.vars[row.var].name)));
        }
        let slots = &mut covered[row.var.index()];
        let passes = row.extents.iter().map(|&e| u64::from(e)).fold(1, u64::saturating_mul);
        if passes > slots.len() as u64 {
            return Err(at.fault(format!("{passes} passes for the {} elements of `{}`", slots.len(), model.vars[row.var].name)));
        }
        for pass in 0..passes {
            let element = row.at.at(&counters(pass, &row.extents)) as usize;
            if std::mem::replace(&mut slots[element], true) {
                return Err(at.fault(format!("element {element} of `{}` has another equation", model.vars[row.var].name)));
            }
        }
    }
    let missing = model.unknowns.iter().find_map(|&var| Some((var, covered[var.index()].iter().position(|c| !c)?)));
    match missing {
        Some((var, element)) => Err(at.fault(format!("no equation for element {element} of `{}`", model.vars[var].name))),
        None => Ok(()),
    }
}

/// The counters of a pass, the last loop fastest.
fn counters(mut pass: u64, extents: &[u32]) -> [i64; MAX_DEPTH] {
    let mut counters = [0; MAX_DEPTH];
    for (counter, &extent) in counters.iter_mut().zip(extents).rev() {
        *counter = (pass % u64::from(extent)) as i64;
        pass /= u64::from(extent);
    }
    counters
}

/// The single numbers follow from the quantities, so that contradictions are refused.
fn check_elements(at: &At<'_>, model: &Model) -> Result<(), ReadError> {
    let layout = Layout::new(model, 0);
    let nominal = Nominal { layout: &layout, y: &[], work: &[], outputs: &[] };
    let expected = write::elements(&Families::new(model, &nominal));
    let families = write::families(&model.interface.quantities).map(|(name, _)| name);
    at.only(&families)?;
    for family in families {
        let list = at.field(family)?;
        let expected = expected[family].as_array().map_or(&[][..], Vec::as_slice);
        if list.items()?.len() != expected.len() {
            return Err(list.fault(format!("expected {} elements, as the `quantities` say", expected.len())));
        }
        for (item, expected) in list.items()?.zip(expected) {
            let known = expected.as_object().into_iter().flatten();
            item.only(&known.clone().map(|(name, _)| name.as_str()).collect::<Vec<_>>())?;
            for (name, value) in known.filter(|(name, _)| *name != "nominal") {
                let found = item.field(name)?;
                if found.value() != value {
                    return Err(found.fault(format!("the `quantities` say {value}")));
                }
            }
            item.field("nominal")?.number_or(f64::NAN)?;
        }
    }
    Ok(())
}
