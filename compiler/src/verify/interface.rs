//! Invariants of what is seen from outside: shapes of quantities, indices, ranges of settings.

use cranelift_entity::EntityRef;

use super::{Checked, ensure, known, violation};
use crate::functions::elements;
use crate::ir::{Role, VarId};
use crate::model::{Axis, Episode, Finish, Grid, Interface, Model, Port, Quantities, Quantity, Solver};

/// Checks the interface, apart from the solved variables.
pub(super) fn check(model: &Model) -> Checked {
    let i = &model.interface;
    let mut taken = vec![false; model.vars.len()];
    for (family, quantities) in i.quantities.families() {
        for (n, quantity) in quantities.iter().enumerate() {
            let place = || format!("quantities.{family}[{n}]");
            check_quantity(model, &place, quantity)?;
            check_variable(model, &place, family, quantity.var, &mut taken)?;
            cells(i, quantity)?;
        }
    }
    let states = unknown_elements(model, Role::State);
    let found = elements(&i.quantities.states);
    ensure(found == states, || "quantities.states".into(), || format!("{found} elements, the `unknowns` have {states}"))?;
    i.ports.iter().enumerate().try_for_each(|(n, port)| check_port(&i.quantities, n, port))?;
    i.grids.iter().enumerate().try_for_each(|(n, grid)| check_grid(model, n, grid))?;
    for (n, name) in i.measured.iter().enumerate() {
        let exists = i.quantities.algebraics.iter().any(|q| q.name == *name);
        ensure(exists, || format!("measured[{n}]"), || format!("there is no output `{name}`"))?;
    }
    state_order(&i.quantities, states)?;
    finish(&i.finish)?;
    steady(i, states)?;
    episode(&i.episode)?;
    solver(&i.solver)?;
    for (n, choice) in i.alternatives.choices.iter().enumerate() {
        let count = choice.options.len();
        let at = choice.at;
        ensure((at as usize) < count, || format!("choices[{n}].chosen"), || format!("there is no option {at}, there are {count}"))?;
    }
    for (n, projected) in i.reduction.projected.iter().enumerate() {
        let (end, count) = (projected.invariant as usize + projected.count as usize, i.invariants.len());
        let place = || format!("reduction.projected[{n}].invariant");
        ensure(end <= count, place, || format!("there is no invariant {}, there are {count}", end.saturating_sub(1)))?;
    }
    let guards = i.reduction.guards.iter().map(|guard| guard.failure).enumerate().map(|(n, at)| ("guards", n, at));
    let unsteady = i.reduction.unsteady.iter().map(|one| one.failure).enumerate().map(|(n, at)| ("unsteady", n, at));
    for (list, n, at) in guards.chain(unsteady) {
        let count = i.finish.failures.len();
        let place = || format!("reduction.{list}[{n}].failure");
        ensure((at as usize) < count, place, || format!("there is no failure {at}, there are {count}"))?;
    }
    Ok(())
}

/// The solved quantities are the solved unknowns.
pub(super) fn solved(model: &Model) -> Checked {
    let (found, expected) = (elements(&model.interface.quantities.solved), unknown_elements(model, Role::Algebraic));
    ensure(found == expected, || "quantities.solved".into(), || format!("{found} elements, the `unknowns` have {expected}"))
}

/// Number of elements of the unknowns of a role.
fn unknown_elements(model: &Model, role: Role) -> usize {
    model.unknowns.iter().map(|&var| &model.vars[var]).filter(|v| v.role == role).map(|v| v.len as usize).sum()
}

/// Axes have as many elements as the variable, and lists of numbers as many or one.
fn check_quantity(model: &Model, place: &dyn Fn() -> String, q: &Quantity) -> Checked {
    let Some(len) = q.axes.iter().map(Axis::len).try_fold(1_usize, usize::checked_mul) else {
        return violation(place(), "too many elements");
    };
    if let Some(var) = q.var {
        let variable = &model.vars[known(model, &|| format!("{}.variable", place()), var)?];
        ensure(variable.len as usize == len, place, || {
            format!("its axes have {len} elements, variable `{}` has {}", variable.name, variable.len)
        })?;
    }
    for (name, numbers) in [("low", &q.low), ("high", &q.high), ("default", &q.default), ("scale", &q.scale)] {
        let fits = numbers.len() == 1 || numbers.len() == len;
        ensure(fits, || format!("{}.{name}", place()), || format!("expected 1 number or {len}"))?;
    }
    Ok(())
}

/// Quantities other than outputs hold one variable each, of their role.
fn check_variable(model: &Model, place: &dyn Fn() -> String, family: &str, var: Option<VarId>, taken: &mut [bool]) -> Checked {
    let (role, needs) = match family {
        "states" => (Role::State, false),
        "discretes" => (Role::Discrete, true),
        "actions" => (Role::Action, true),
        "disturbances" => (Role::Disturbance, true),
        "parameters" => (Role::Param, true),
        _ => (Role::Algebraic, false),
    };
    let Some(var) = var else {
        return ensure(!needs, place, || "`variable` is missing: nothing holds the quantity".into());
    };
    let variable = &model.vars[var];
    ensure(variable.role == role, place, || format!("variable `{}` is of another role", variable.name))?;
    // An output is often a variable that is solved for.
    let another = family != "outputs" && std::mem::replace(&mut taken[var.index()], true);
    ensure(!another, place, || format!("variable `{}` belongs to another quantity", variable.name))
}

/// Cells have a grid, with one face more than there are cells where faces are known.
fn cells(i: &Interface, quantity: &Quantity) -> Checked {
    for axis in &quantity.axes {
        let &Axis::Cells { grid, count } = axis else { continue };
        let faces = i.grids.get(grid as usize).map(|grid| grid.faces.len());
        let fit = faces.is_some_and(|faces| faces == 0 || faces == count as usize + 1);
        ensure(
            fit,
            || "grids".into(),
            || format!("`{}` has {count} cells of grid {grid}, which does not exist or has other faces", quantity.name),
        )?;
    }
    Ok(())
}

fn check_grid(model: &Model, n: usize, grid: &Grid) -> Checked {
    for (p, &(var, element, _)) in grid.parameters.iter().enumerate() {
        let place = || format!("grids[{n}].parameters[{p}]");
        let variable = &model.vars[known(model, &place, var)?];
        ensure(variable.role == Role::Param, place, || format!("variable `{}` is of another role", variable.name))?;
        ensure(
            element < variable.len,
            || format!("{}.element", place()),
            || format!("there is no element {element}, there are {}", variable.len),
        )?;
    }
    Ok(())
}

/// Members of ports are outputs, and equal to existing quantities of as many elements.
fn check_port(known: &Quantities, n: usize, port: &Port) -> Checked {
    let others = [&known.states, &known.actions, &known.disturbances, &known.parameters, &known.discretes];
    for (m, member) in port.members.iter().enumerate() {
        let place = |field: &str| format!("ports[{n}].members[{m}].{field}");
        let Some(output) = known.algebraics.iter().find(|q| q.name == member.output) else {
            return violation(place("output"), "there is no such output");
        };
        let length = output.len();
        if let Some(name) = &member.equals {
            let exists = others.into_iter().flatten().any(|q| q.name == *name && q.len() == length);
            ensure(exists, || place("equals"), || format!("there is no such quantity of {length} elements"))?;
        }
    }
    Ok(())
}

/// The order of states has each of them once.
fn state_order(quantities: &Quantities, states: usize) -> Checked {
    let Some(order) = &quantities.state_order else { return Ok(()) };
    let mut sorted = order.clone();
    sorted.sort_unstable();
    let once = order.len() == states && sorted.iter().zip(0..).all(|(&at, i)| at == i);
    ensure(once, || "state_order".into(), || format!("expected each of the {states} states once"))
}

fn finish(finish: &Finish) -> Checked {
    let (at, count) = (finish.default_reward, finish.rewards.len());
    let exists = (at as usize) < count || (at == 0 && count == 0);
    ensure(exists, || "finish.default_reward".into(), || format!("there is no reward {at}, there are {count}"))?;
    for (n, observed) in finish.observations.iter().enumerate() {
        let place = |field: &str| format!("finish.observations[{n}].{field}");
        ensure(observed.every > 0, || place("every"), || "an observation is sampled every 1 or more steps".into())?;
        number(|| place("noise"), observed.noise, "0 or more", |x| x >= 0.0 && x.is_finite())?;
    }
    Ok(())
}

fn steady(i: &Interface, states: usize) -> Checked {
    let Some(steady) = &i.steady else { return Ok(()) };
    for (field, list, count) in [("fixed", &steady.fixed, states), ("free", &steady.free, elements(&i.quantities.actions))] {
        for (n, &at) in list.iter().enumerate() {
            let place = || format!("steady.{field}[{n}]");
            ensure((at as usize) < count, place, || format!("there is no element {at}, there are {count}"))?;
        }
    }
    Ok(())
}

fn episode(e: &Episode) -> Checked {
    positive("episode.step", e.step)?;
    positive("episode.integrate", e.integrate)?;
    e.cycle.map_or(Ok(()), |period| positive("episode.cycle", period))?;
    ensure(e.max_steps > 0, || "episode.max_steps".into(), || "an episode has at least 1 step".into())?;
    number(|| "episode.error_reward".into(), e.error_reward, "finite", f64::is_finite)
}

fn solver(s: &Solver) -> Checked {
    let tolerance = |name: &'static str, x: f64| number(|| name.into(), x, Solver::RTOL_TEXT, |x| Solver::RTOL.contains(&x));
    tolerance("solver.rtol", s.rtol)?;
    s.one_step_rtol.map_or(Ok(()), |x| tolerance("solver.one_step_rtol", x))?;
    positive("solver.atol_factor", s.atol_factor)?;
    positive("solver.safety", s.safety)?;
    ensure((1..=5).contains(&s.max_order), || "solver.max_order".into(), || "the highest order is 1 to 5".into())?;
    ensure(s.max_steps > 0, || "solver.max_steps".into(), || "the most internal steps are at least 1".into())?;
    number(|| "solver.max_step".into(), s.max_step, "positive", |x| x > 0.0)
}

fn positive(place: &'static str, x: f64) -> Checked {
    number(|| place.into(), x, "positive and finite", |x| x > 0.0 && x.is_finite())
}

fn number(place: impl FnOnce() -> String, x: f64, is: &str, test: impl Fn(f64) -> bool) -> Checked {
    ensure(test(x), place, || format!("expected a number that is {is}, found {x}"))
}
