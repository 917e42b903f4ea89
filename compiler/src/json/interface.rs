//! Public data of a model: names, units, shapes, bounds, settings.

use cranelift_entity::{EntityRef, PrimaryMap};
use smpl_dsl::span::Span;

use super::cursor::{At, MAX_ELEMENTS, ReadError};
use super::nodes::variable;

use super::write::families;
use crate::ir::{Role, VarId};
use crate::model::{
    AlgebraicCounts, Axis, BoxItem, Choice, Demoted, Differentiated, Draw, Episode, Failure, Finish, Grid, Guard, Interface, Invariant,
    Observed, Port, PortMember, Projected, Quantities, Quantity, Reduction, Reward, Solver, StartCondition, Steady, Time, Variable,
    Variant,
};

type Vars = PrimaryMap<VarId, Variable>;

/// Reads the interface; `root` is the whole text.
pub(super) fn read(root: &At<'_>, vars: &Vars) -> Result<Interface, ReadError> {
    let mut i = Interface { name: root.field("name")?.string()?, text: root.field("text")?.string()?, ..Interface::default() };
    let time = root.field("time")?;
    time.only(&["name", "unit"])?;
    i.time = Time { name: time.field("name")?.string()?, unit: time.field("unit")?.string()? };
    i.quantities = quantities(&root.field("quantities")?, vars)?;
    i.ports = root.field("ports")?.list(|at| port(at, &i.quantities))?;
    let grids = root.field("grids")?;
    i.grids = grids.list(|at| grid(at, vars))?;
    check_cells(&grids, &i)?;
    i.quantities.state_order = state_order(&root.field("state_order")?, count(&i.quantities.states))?;
    let algebraic = root.field("algebraic")?;
    algebraic.only(&["declared", "solved", "substituted"])?;
    let number = |name: &str| algebraic.field(name)?.count(u32::MAX);
    i.quantities.algebraic_counts =
        AlgebraicCounts { declared: number("declared")?, solved: number("solved")?, substituted: number("substituted")? };
    i.draws = root.field("draws")?.list(draw)?;
    i.phases = texts(&root.field("phases")?)?;
    i.alternatives.levels = texts(&root.field("levels")?)?;
    i.invariants = root.field("invariants")?.list(|at| {
        at.only(&["name", "text"])?;
        Ok(Invariant { name: at.field("name")?.string()?, text: at.field("text")?.string()? })
    })?;
    i.start_resets = root.field("start_resets")?.flag()?;
    i.finish = finish(&root.field("finish")?)?;
    i.steady = steady(&root.field("steady")?, &i.quantities.states)?;
    i.start_conditions = root.maybe("start_conditions")?.map_or_else(|| Ok(Vec::new()), |at| at.list(start_condition))?;
    i.episode = episode(&root.field("episode")?)?;
    i.solver = solver(&root.field("solver")?)?;
    i.alternatives.variants = root.field("variants")?.list(|at| {
        at.only(&["name", "on"])?;
        Ok(Variant { name: at.field("name")?.string()?, on: at.field("on")?.flag()? })
    })?;
    i.alternatives.choices = root.field("choices")?.list(choice)?;
    i.measured = root.maybe("measured")?.map_or_else(|| Ok(Vec::new()), |at| texts(&at))?;
    if let Some(at) = root.maybe("reduction")? {
        i.reduction = reduction(&at, i.invariants.len().saturating_sub(1) as u32, i.finish.failures.len())?;
    }
    Ok(i)
}

fn reduction(at: &At<'_>, invariants: u32, failures: usize) -> Result<Reduction, ReadError> {
    at.only(&["differentiated", "follow", "projected", "guards"])?;
    let differentiated = at.field("differentiated")?.list(|at| {
        at.only(&["times", "place", "equation"])?;
        let (place, text) = (at.field("place")?.string()?, at.field("equation")?.string()?);
        Ok(Differentiated { span: Span::default(), place, text, times: at.field("times")?.count(u32::MAX)? })
    })?;
    let guards = at.field("guards")?.list(|at| {
        at.only(&["failure", "names"])?;
        let failure = at.field("failure")?.index(failures, "failure")? as u32;
        Ok(Guard { failure, names: texts(&at.field("names")?)?, spans: Vec::new() })
    })?;
    let demoted = at.field("follow")?.list(|at| {
        at.only(&["name", "elements", "whole"])?;
        Ok(Demoted { name: at.field("name")?.string()?, elements: texts(&at.field("elements")?)?, whole: at.field("whole")?.flag()? })
    })?;
    let projected = at.field("projected")?.list(|at| {
        at.only(&["order", "states", "invariant", "count", "set"])?;
        let (order, invariant) = (at.field("order")?.count(u32::MAX)?, at.field("invariant")?.count(invariants)?);
        let (states, count) = (texts(&at.field("states")?)?, at.field("count")?.count(invariants + 1 - invariant)?);
        Ok(Projected { span: Span::default(), order, states, invariant, count, set: at.field("set")?.flag()? })
    })?;
    Ok(Reduction { differentiated, demoted, projected, preferred: Vec::new(), guards })
}

/// Number of elements; every length was checked.
pub(super) fn count(quantities: &[Quantity]) -> usize {
    quantities.iter().map(Quantity::len).sum()
}

pub(super) fn texts(at: &At<'_>) -> Result<Vec<String>, ReadError> {
    at.list(|item| item.string())
}

fn quantities(at: &At<'_>, vars: &Vars) -> Result<Quantities, ReadError> {
    at.only(&["states", "solved", "outputs", "discretes", "actions", "disturbances", "parameters"])?;
    let mut taken = vec![false; vars.len()];
    let mut family = |name: &str, role: Role, needs: bool| -> Result<Vec<Quantity>, ReadError> {
        let list = at.field(name)?;
        let mut all = vec![];
        for item in list.items()? {
            let found = quantity(&item, vars)?;
            match found.var {
                None if needs => return Err(item.fault("`variable` is missing: nothing holds the quantity")),
                Some(var) if vars[var].role != role => {
                    return Err(item.fault(format!("variable `{}` is of another role", vars[var].name)));
                }
                // An output is often a variable that is solved for.
                Some(var) if name != "outputs" && std::mem::replace(&mut taken[var.index()], true) => {
                    return Err(item.fault(format!("variable `{}` belongs to another quantity", vars[var].name)));
                }
                Some(_) | None => {}
            }
            all.push(found);
        }
        Ok(all)
    };
    Ok(Quantities {
        states: family("states", Role::State, false)?,
        solved: family("solved", Role::Algebraic, false)?,
        discretes: family("discretes", Role::Discrete, true)?,
        actions: family("actions", Role::Action, true)?,
        disturbances: family("disturbances", Role::Disturbance, true)?,
        parameters: family("parameters", Role::Param, true)?,
        algebraics: family("outputs", Role::Algebraic, false)?,
        ..Quantities::default()
    })
}

fn quantity(at: &At<'_>, vars: &Vars) -> Result<Quantity, ReadError> {
    let fields = ["pattern", "axes", "unit", "affine_unit", "text", "variable", "low", "high", "default", "scale", "structural"];
    at.only(&[&["name", "nonnegative"], &fields[..]].concat())?;
    let axes = at.field("axes")?.list(axis)?;
    let len = axes.iter().map(Axis::len).try_fold(1_usize, usize::checked_mul).filter(|&n| n <= MAX_ELEMENTS);
    let len = len.ok_or_else(|| at.fault("too many elements"))?;
    let held = at.field("variable")?;
    let var = if held.is_null() { None } else { Some(variable(&held, vars)?) };
    if let Some(var) = var.filter(|&var| vars[var].len as usize != len) {
        return Err(at.fault(format!("its axes have {len} elements, variable `{}` has {}", vars[var].name, vars[var].len)));
    }
    let numbers = |name: &str, none: f64| -> Result<Vec<f64>, ReadError> {
        let list = at.field(name)?;
        let numbers = list.list(|x| x.number_or(none))?;
        if numbers.len() == 1 || numbers.len() == len { Ok(numbers) } else { Err(list.fault(format!("expected 1 number or {len}"))) }
    };
    let pattern = at.field("pattern")?;
    Ok(Quantity {
        var,
        name: at.field("name")?.string()?,
        axes,
        pattern: if pattern.is_null() { None } else { Some(pattern.string()?) },
        unit: at.field("unit")?.string()?,
        text: at.field("text")?.string()?,
        low: numbers("low", f64::NEG_INFINITY)?,
        high: numbers("high", f64::INFINITY)?,
        default: numbers("default", f64::NAN)?,
        scale: numbers("scale", f64::NAN)?,
        affine_unit: at.field("affine_unit")?.flag()?,
        structural: at.field("structural")?.flag()?,
        nonnegative: at.maybe("nonnegative")?.map_or(Ok(false), |x| x.flag())?,
    })
}

/// A port, whose members are outputs, and equal to what is there with as many elements.
fn port(at: &At<'_>, known: &Quantities) -> Result<Port, ReadError> {
    at.only(&["name", "connector", "members"])?;
    let others = [&known.states, &known.actions, &known.disturbances, &known.parameters, &known.discretes];
    let members = at.field("members")?.list(|member| {
        member.only(&["name", "output", "equals", "flow"])?;
        let (output, equals) = (member.field("output")?, member.field("equals")?);
        let (text, none) = (output.text()?, || output.fault("there is no such output"));
        let length = known.algebraics.iter().find(|q| q.name == text).ok_or_else(none)?.len();
        let flow = member.maybe("flow")?.map(|at| at.flag()).transpose()?.unwrap_or_default();
        let name = if equals.is_null() { None } else { Some(equals.string()?) };
        if name.as_ref().is_some_and(|name| !others.into_iter().flatten().any(|q| q.name == *name && q.len() == length)) {
            return Err(equals.fault(format!("there is no such quantity of {length} elements")));
        }
        Ok(PortMember { name: member.field("name")?.string()?, output: output.string()?, equals: name, flow })
    })?;
    Ok(Port { name: at.field("name")?.string()?, connector: at.field("connector")?.string()?, members })
}

fn grid(at: &At<'_>, vars: &Vars) -> Result<Grid, ReadError> {
    at.only(&["name", "unit", "faces", "parameters"])?;
    let parameters = at.field("parameters")?.list(|item| {
        item.only(&["variable", "element", "value"])?;
        let var = variable(&item.field("variable")?, vars)?;
        if vars[var].role != Role::Param {
            return Err(item.fault(format!("variable `{}` is of another role", vars[var].name)));
        }
        let element = item.field("element")?.index(vars[var].len as usize, "element")?;
        Ok((var, element as u32, item.field("value")?.number()?))
    })?;
    let faces = at.field("faces")?.list(|face| face.number())?;
    Ok(Grid { name: at.field("name")?.string()?, unit: at.field("unit")?.string()?, faces, parameters })
}

/// Every row of cells has its grid, with one face more than there are cells where any are known.
fn check_cells(grids: &At<'_>, i: &Interface) -> Result<(), ReadError> {
    for quantity in families(&i.quantities).into_iter().flat_map(|(_, family)| family) {
        for axis in &quantity.axes {
            let &Axis::Cells { grid, count } = axis else { continue };
            let faces = i.grids.get(grid as usize).map(|grid| grid.faces.len());
            if !faces.is_some_and(|faces| faces == 0 || faces == count as usize + 1) {
                return Err(
                    grids.fault(format!("`{}` has {count} cells of grid {grid}, which is not here or has other faces", quantity.name))
                );
            }
        }
    }
    Ok(())
}

fn axis(at: &At<'_>) -> Result<Axis, ReadError> {
    if let Some(grid) = at.maybe("grid")? {
        at.only(&["grid", "count"])?;
        return Ok(Axis::Cells { grid: grid.count(u32::MAX)?, count: at.field("count")?.count(MAX_ELEMENTS as u32)? });
    }
    if let Some(names) = at.maybe("names")? {
        at.only(&["names"])?;
        return Ok(Axis::Names(texts(&names)?));
    }
    at.only(&["first", "count", "set"])?;
    let first = at.field("first")?.integer(1 << 40)?;
    let set = at.maybe("set")?.map_or(Ok(String::new()), |set| set.text().map(ToOwned::to_owned))?;
    Ok(Axis::Numbers { first, count: at.field("count")?.count(MAX_ELEMENTS as u32)?, set })
}

fn state_order(at: &At<'_>, states: usize) -> Result<Option<Vec<u32>>, ReadError> {
    if at.is_null() {
        return Ok(None);
    }
    let order = at.list(|item| Ok(item.index(states, "state")? as u32))?;
    let mut found = vec![false; states];
    order.iter().for_each(|&i| found[i as usize] = true);
    if order.len() == states && found.into_iter().all(|f| f) {
        return Ok(Some(order));
    }
    Err(at.fault(format!("expected each of the {states} states once")))
}

fn draw(at: &At<'_>) -> Result<Draw, ReadError> {
    at.only(&["stream", "kind", "at"])?;
    Ok(Draw { stream: at.field("stream")?.string()?, kind: at.field("kind")?.word()?, instant: at.field("at")?.word()? })
}

fn finish(at: &At<'_>) -> Result<Finish, ReadError> {
    at.only(&["failures", "successes", "constraints", "rewards", "default_reward", "observations"])?;
    let failures = at.field("failures")?.list(|f| {
        f.only(&["name", "text", "event", "on_reward", "box"])?;
        Ok(Failure {
            name: f.field("name")?.string()?,
            text: f.field("text")?.string()?,
            event: f.field("event")?.flag()?,
            items: f.field("box")?.list(box_item)?,
            on_reward: f.field("on_reward")?.flag()?,
        })
    })?;
    let rewards = at.field("rewards")?.list(|r| {
        r.only(&["name", "unit", "text"])?;
        Ok(Reward { name: r.field("name")?.string()?, unit: r.field("unit")?.string()?, text: r.field("text")?.string()? })
    })?;
    Ok(Finish {
        failures,
        successes: texts(&at.field("successes")?)?,
        constraints: texts(&at.field("constraints")?)?,
        default_reward: default_reward(&at.field("default_reward")?, &rewards)?,
        rewards,
        observations: at.field("observations")?.list(observed)?,
    })
}

/// The index of the named reward; a model without rewards needs no name.
fn default_reward(at: &At<'_>, rewards: &[Reward]) -> Result<u32, ReadError> {
    if at.is_null() && rewards.is_empty() {
        return Ok(0);
    }
    let name = at.text()?;
    let found = rewards.iter().position(|r| r.name == name);
    Ok(found.ok_or_else(|| at.fault(format!("there is no reward `{name}`")))? as u32)
}

fn box_item(at: &At<'_>) -> Result<BoxItem, ReadError> {
    at.only(&["name", "unit", "low", "high"])?;
    let (name, unit) = (at.field("name")?.string()?, at.field("unit")?.string()?);
    Ok(BoxItem { name, unit, low: at.field("low")?.number()?, high: at.field("high")?.number()? })
}

fn observed(at: &At<'_>) -> Result<Observed, ReadError> {
    at.only(&["name", "unit", "low", "high", "every", "delay", "noise"])?;
    let every = at.field("every")?;
    let steps = every.count(1_000_000)?;
    if steps == 0 {
        return Err(every.fault("an observation is sampled every 1 or more steps"));
    }
    Ok(Observed {
        name: at.field("name")?.string()?,
        unit: at.field("unit")?.string()?,
        low: at.field("low")?.number()?,
        high: at.field("high")?.number()?,
        every: steps,
        delay: at.field("delay")?.count(1_000_000)?,
        noise: at.field("noise")?.number_that("0 or more", |x| x >= 0.0 && x.is_finite())?,
    })
}

fn steady(at: &At<'_>, states: &[Quantity]) -> Result<Option<Steady>, ReadError> {
    if at.is_null() {
        return Ok(None);
    }
    at.only(&["fixed", "conditions", "given", "free"])?;
    let names = states.iter().flat_map(|q| (0..q.len()).map(|e| q.element_name(e)));
    let places: std::collections::HashMap<String, u32> = names.zip(0..).collect();
    let fixed = at.field("fixed")?.list(|name| {
        let text = name.text()?;
        places.get(text).copied().ok_or_else(|| name.fault(format!("there is no state `{text}`")))
    })?;
    let conditions = at.field("conditions")?.count(MAX_ELEMENTS as u32)?;
    let free = at.maybe("free")?.map_or_else(|| Ok(Vec::new()), |at| at.list(|position| position.count(MAX_ELEMENTS as u32)))?;
    Ok(Some(Steady { fixed, conditions, given: at.field("given")?.flag()?, free }))
}

fn start_condition(at: &At<'_>) -> Result<StartCondition, ReadError> {
    at.only(&["count", "free", "only"])?;
    let count = at.field("count")?.count(MAX_ELEMENTS as u32)?;
    Ok(StartCondition { count, free: texts(&at.field("free")?)?, only: at.field("only")?.flag()?, ..StartCondition::default() })
}

fn positive(at: &At<'_>, name: &str) -> Result<f64, ReadError> {
    at.field(name)?.number_that("positive and finite", |x| x > 0.0 && x.is_finite())
}

fn episode(at: &At<'_>) -> Result<Episode, ReadError> {
    at.only(&["step", "integrate", "max_steps", "cycle", "error_reward", "end_is_success", "failure_pays_alone", "single_precision"])?;
    let max_steps = at.field("max_steps")?;
    let steps = max_steps.count(u32::MAX)?;
    if steps == 0 {
        return Err(max_steps.fault("an episode has at least 1 step"));
    }
    Ok(Episode {
        step: positive(at, "step")?,
        integrate: positive(at, "integrate")?,
        max_steps: steps,
        cycle: at.maybe("cycle")?.map(|at| at.number_that("positive and finite", |x| x > 0.0 && x.is_finite())).transpose()?,
        error_reward: at.field("error_reward")?.number_that("finite", f64::is_finite)?,
        end_is_success: at.field("end_is_success")?.flag()?,
        failure_pays_alone: at.field("failure_pays_alone")?.flag()?,
        single_precision: at.field("single_precision")?.flag()?,
    })
}

fn solver(at: &At<'_>) -> Result<Solver, ReadError> {
    at.only(&[
        "rtol",
        "one_step_rtol",
        "atol_factor",
        "safety",
        "max_order",
        "max_steps",
        "max_events",
        "max_step",
        "retry",
        "algebraic_error_control",
        "quadrature_error_control",
        "linear_solver",
        "method",
    ])?;
    let order = at.field("max_order")?;
    let max_order = order.count(5)?;
    if max_order == 0 {
        return Err(order.fault("the highest order is 1 to 5"));
    }
    Ok(Solver {
        rtol: tolerance(&at.field("rtol")?)?,
        one_step_rtol: at.maybe("one_step_rtol")?.filter(|at| !at.is_null()).map(|at| tolerance(&at)).transpose()?,
        atol_factor: positive(at, "atol_factor")?,
        safety: positive(at, "safety")?,
        max_order,
        max_steps: at.field("max_steps")?.count(u32::MAX)?.max(1),
        max_events: at.field("max_events")?.count(u32::MAX)?,
        max_step: at.field("max_step")?.number_or(f64::INFINITY)?,
        // It was applied when the model was made.
        pade: 0,
        retry: at.maybe("retry")?.map_or(Ok(true), |at| at.flag())?,
        algebraic_error_control: at.field("algebraic_error_control")?.flag()?,
        quadrature_error_control: at.field("quadrature_error_control")?.flag()?,
        linear_solver: at.field("linear_solver")?.word()?,
        method: at.field("method")?.word()?,
    })
}

fn tolerance(at: &At<'_>) -> Result<f64, ReadError> {
    at.number_that(Solver::RTOL_TEXT, |x| Solver::RTOL.contains(&x))
}

fn choice(at: &At<'_>) -> Result<Choice, ReadError> {
    at.only(&["name", "options", "chosen"])?;
    let (options, chosen) = (texts(&at.field("options")?)?, at.field("chosen")?);
    let name = chosen.text()?;
    let found = options.iter().position(|option| option == name);
    let found = found.ok_or_else(|| chosen.fault(format!("there is no option `{name}`")))?;
    Ok(Choice { name: at.field("name")?.string()?, options, at: found as u32 })
}
