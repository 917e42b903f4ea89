//! From a flat model to JSON.

use cranelift_entity::EntityRef;
use serde_json::{Map, Value, json};

use super::words::Word;
use super::{FORMAT, VERSION};
use crate::artefact::Circumstances;
use crate::export::{Element, ExportError, Families, Nominal, Origin};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, List, MAX_DEPTH, Place, Program, Role, VarId};
use crate::model::{
    AlgebraicCounts, Axis, Delay, Demoted, Differentiated, Finish, Grid, Guard, Interface, Lag, Model, Port, PortMember, Projected,
    Quantities, Quantity, Reduction, RootAction, Steady,
};

/// The text of a model.
///
/// # Errors
/// If a value cannot be written.
pub(crate) fn print(model: &Model, nominal: &Nominal<'_>, origin: &Origin<'_>) -> Result<String, ExportError> {
    let nodes = Nodes::new(model);
    let (i, families) = (&model.interface, Families::new(model, nominal));
    let mut value = json!({
        "format": FORMAT,
        "version": VERSION,
        "name": i.name,
        "text": i.text,
        "made_for": made_for(origin.circumstances),
        "time": {"name": i.time.name, "unit": i.time.unit},
        "explicit": model.explicit,
        "variables": model.vars.values().filter(|v| v.role != Role::Cache).map(|v| json!({
            "name": v.name, "role": if v.len == 0 && v.role == Role::Delayed { Role::Scratch } else { v.role }.word(), "length": v.len,
        })).collect::<Vec<_>>(),
        "unknowns": model.unknowns.iter().map(|v| v.index()).collect::<Vec<_>>(),
        "quantities": quantities(&i.quantities),
        "ports": i.ports.iter().map(port).collect::<Vec<_>>(),
        "grids": i.grids.iter().map(grid).collect::<Vec<_>>(),
        "state_order": i.quantities.state_order,
        "algebraic": counts(i.quantities.algebraic_counts),
        "elements": elements(&families),
        "expressions": nodes.list(model),
        "equations": model.rows.iter().map(|row| json!({
            "extents": row.extents,
            "unknown": {"variable": row.var.index(), "at": affine(row.at)},
            "residual": nodes.number(row.residual),
        })).collect::<Vec<_>>(),
        "events": model.roots.iter().map(|root| json!({
            "name": root.name, "value": nodes.number(root.value), "strict": root.strict, "does": action(root.action),
        })).collect::<Vec<_>>(),
        "integrals": model.quadratures.iter().map(|q| nodes.number(*q)).collect::<Vec<_>>(),
        "programs": model.programs.named().into_iter().map(|(name, p)| (name, program(p, &nodes))).collect::<Map<_, _>>(),
        "policies": model.programs.policies.iter().map(|(name, _)| name).collect::<Vec<_>>(),
        "finish": finish(&i.finish),
        "draws": i.draws.iter().map(|d| json!({
            "stream": d.stream,
            "kind": d.kind.word(),
            "at": d.instant.word(),
        })).collect::<Vec<_>>(),
        "levels": i.alternatives.levels,
        "phases": i.phases,
        "invariants": i.invariants.iter().map(|x| json!({"name": x.name, "text": x.text})).collect::<Vec<_>>(),
        "steady": steady(i, &families),
        "start_conditions": i.start_conditions.iter().map(|c| json!({"count": c.count, "free": c.free, "only": c.only})).collect::<Vec<_>>(),
        "start_resets": i.start_resets,
        "episode": episode(i),
        "solver": solver(i),
        "variants": i.alternatives.variants.iter().map(|v| json!({"name": v.name, "on": v.on})).collect::<Vec<_>>(),
        "choices": i.alternatives.choices.iter().map(|c| json!({"name": c.name, "options": c.options, "chosen": c.chosen()})).collect::<Vec<_>>(),
    });
    if !model.delays.is_empty() {
        value["delays"] = model.delays.iter().map(delay).collect();
    }
    if !i.measured.is_empty() {
        value["measured"] = json!(i.measured);
    }
    if i.reduction.has_reduced() {
        value["reduction"] = reduction(&i.reduction);
    }
    Ok(serde_json::to_string_pretty(&value)? + "\n")
}

/// The record of index reduction: equations with the orders of their derivatives, states that
/// follow, projections, and constraints that could stop to determine what follows from them.
fn reduction(r: &Reduction) -> Value {
    let differentiated = |d: &Differentiated| json!({"times": d.times, "place": d.place, "equation": d.text});
    let guard = |g: &Guard| json!({"failure": g.failure, "names": g.names});
    let follow = |d: &Demoted| json!({"name": d.name, "elements": d.elements, "whole": d.whole});
    let projected = |p: &Projected| json!({"order": p.order, "states": p.states, "invariant": p.invariant, "count": p.count, "set": p.set});
    json!({
        "differentiated": r.differentiated.iter().map(differentiated).collect::<Vec<_>>(),
        "follow": r.demoted.iter().map(follow).collect::<Vec<_>>(),
        "projected": r.projected.iter().map(projected).collect::<Vec<_>>(),
        "guards": r.guards.iter().map(guard).collect::<Vec<_>>(),
    })
}

fn delay(delay: &Delay) -> Value {
    let bounds = (delay.lag != Lag::Constant && delay.bounds.1.is_finite()).then_some(delay.bounds);
    json!({"name": delay.name, "count": delay.count, "changes": delay.lag.word(), "bounds": bounds, "before": delay.before})
}

/// Options of the model's compilation, as stored by a compiled model.
fn made_for(circumstances: &Circumstances) -> Value {
    let Circumstances { scenario, variants, settings } = circumstances;
    json!({
        "scenario": scenario.as_ref().map(|(name, text)| json!({"name": name, "text": text})),
        "variants": variants,
        "settings": settings.iter().map(|(name, value)| (name.clone(), json!(value))).collect::<Map<_, _>>(),
    })
}

fn counts(counts: AlgebraicCounts) -> Value {
    let AlgebraicCounts { declared, solved, substituted } = counts;
    json!({"declared": declared, "solved": solved, "substituted": substituted})
}

/// The families of quantities with their names.
pub(super) fn families(i: &Quantities) -> [(&'static str, &[Quantity]); 7] {
    [
        ("states", &i.states),
        ("solved", &i.solved),
        ("outputs", &i.algebraics),
        ("discretes", &i.discretes),
        ("actions", &i.actions),
        ("disturbances", &i.disturbances),
        ("parameters", &i.parameters),
    ]
}

fn quantities(i: &Quantities) -> Value {
    let list = |family: &[Quantity]| Value::Array(family.iter().map(quantity).collect());
    Value::Object(families(i).into_iter().map(|(name, family)| (name.to_owned(), list(family))).collect())
}

fn port(port: &Port) -> Value {
    let member = |m: &PortMember| json!({"name": m.name, "output": m.output, "equals": m.equals, "flow": m.flow});
    json!({"name": port.name, "connector": port.connector, "members": port.members.iter().map(member).collect::<Vec<_>>()})
}

fn grid(grid: &Grid) -> Value {
    let parameter =
        |&(var, element, value): &(VarId, u32, f64)| json!({"variable": var.index(), "element": element, "value": number(value)});
    json!({
        "name": grid.name, "unit": grid.unit, "faces": grid.faces.iter().map(|&x| number(x)).collect::<Vec<_>>(),
        "parameters": grid.parameters.iter().map(parameter).collect::<Vec<_>>(),
    })
}

fn quantity(q: &Quantity) -> Value {
    let axis = |axis: &Axis| match axis {
        Axis::Names(names) => json!({"names": names}),
        Axis::Numbers { first, count, set } if set.is_empty() => json!({"first": first, "count": count}),
        Axis::Numbers { first, count, set } => json!({"first": first, "count": count, "set": set}),
        Axis::Cells { grid, count } => json!({"grid": grid, "count": count}),
    };
    let numbers = |list: &[f64], none: f64| list.iter().map(|&x| if same(x, none) { Value::Null } else { number(x) }).collect::<Vec<_>>();
    let mut object = json!({
        "name": q.name, "pattern": q.pattern, "axes": q.axes.iter().map(axis).collect::<Vec<_>>(),
        "unit": q.unit, "affine_unit": q.affine_unit, "text": q.text, "variable": q.var.map(|var| var.index()),
        "low": numbers(&q.low, f64::NEG_INFINITY), "high": numbers(&q.high, f64::INFINITY), "default": numbers(&q.default, f64::NAN),
        "scale": numbers(&q.scale, f64::NAN), "structural": q.structural,
    });
    if q.nonnegative {
        object["nonnegative"] = Value::Bool(true);
    }
    object
}

fn same(x: f64, y: f64) -> bool {
    x == y || x.is_nan() && y.is_nan()
}

/// The single numbers of all families.
pub(super) fn elements(families: &Families) -> Value {
    let described = |e: &Element| {
        json!({
            "name": e.name, "unit": e.unit, "text": e.text,
            "low": e.low, "high": e.high, "scale": e.scale, "nominal": e.nominal, "structural": e.structural,
            "variable": e.place.map(|(var, _)| var.index()), "element": e.place.map(|(_, element)| element),
        })
    };
    let elements = |family: &[Element]| family.iter().map(described).collect::<Vec<_>>();
    json!({
        "states": elements(&families.states),
        "solved": elements(&families.solved),
        "outputs": elements(&families.outputs),
        "discretes": elements(&families.discretes),
        "actions": elements(&families.actions),
        "disturbances": elements(&families.disturbances),
        "parameters": elements(&families.parameters),
    })
}

/// The settings of the episode; without a period it is absent.
fn episode(i: &Interface) -> Value {
    let mut episode = json!(i.episode);
    if i.episode.cycle.is_none() {
        episode.as_object_mut().map(|entries| entries.remove("cycle"));
    }
    episode
}

/// The settings of the solver; no longest step is null.
fn solver(i: &Interface) -> Value {
    let mut solver = json!(i.solver);
    // Approximations are part of the equations.
    solver.as_object_mut().map(|entries| entries.remove("pade"));
    solver
}

/// Outputs of the program `finish`, one after another; a failure has two numbers.
fn finish(finish: &Finish) -> Value {
    let observation = |o: &crate::model::Observed| {
        json!({
            "name": o.name, "unit": o.unit, "low": number(o.low), "high": number(o.high), "every": o.every, "delay": o.delay, "noise": number(o.noise),
        })
    };
    let item = |b: &crate::model::BoxItem| json!({"name": b.name, "unit": b.unit, "low": number(b.low), "high": number(b.high)});
    let failure = |f: &crate::model::Failure| {
        json!({
            "name": f.name, "text": f.text, "event": f.event, "on_reward": f.on_reward, "box": f.items.iter().map(item).collect::<Vec<_>>(),
        })
    };
    json!({
        "failures": finish.failures.iter().map(failure).collect::<Vec<_>>(),
        "successes": finish.successes,
        "constraints": finish.constraints,
        "rewards": finish.rewards.iter().map(|r| json!({"name": r.name, "unit": r.unit, "text": r.text})).collect::<Vec<_>>(),
        "default_reward": finish.rewards.get(finish.default_reward as usize).map(|r| &r.name),
        "observations": finish.observations.iter().map(observation).collect::<Vec<_>>(),
    })
}

fn steady(i: &Interface, families: &Families) -> Value {
    let Some(Steady { fixed, conditions, given, free }) = &i.steady else { return Value::Null };
    let mut inside: Vec<&Element> = families.states.iter().collect();
    if let Some(order) = &i.quantities.state_order {
        let mut sorted = inside.clone();
        order.iter().zip(&inside).for_each(|(&at, element)| sorted[at as usize] = element);
        inside = sorted;
    }
    let fixed: Vec<&str> = fixed.iter().filter_map(|&at| Some(inside.get(at as usize)?.name.as_str())).collect();
    let mut object = json!({"fixed": fixed, "conditions": conditions, "given": given});
    if !free.is_empty() {
        object["free"] = json!(free);
    }
    object
}

fn action(action: RootAction) -> Value {
    match action {
        RootAction::Fail(i) => json!({"fail": i}),
        RootAction::Run(i) => json!({"run": format!("event {i}")}),
        RootAction::Restart => json!("restart"),
        RootAction::Succeed(i) => json!({"succeed": i}),
    }
}

fn program(program: &Program, nodes: &Nodes) -> Value {
    let nests: Vec<_> = program
        .nests
        .iter()
        .map(|nest| {
            let stores: Vec<_> = nest
                .stores
                .iter()
                .map(|store| {
                    let at = affine(store.target.at);
                    let value = nodes.number(store.value);
                    match store.target.place {
                        Place::Out => json!({"out": at, "value": value}),
                        // Positions from tables are made behind the flat model only.
                        Place::Table { table, .. } => json!({"out": at, "table": table, "value": value}),
                        Place::Var(var) => json!({"variable": var.index(), "at": at, "value": value}),
                    }
                })
                .collect();
            json!({"extents": nest.extents(), "stores": stores})
        })
        .collect();
    json!({"in_place": program.in_place, "nests": nests})
}

/// Offset, then the factor of each loop counter up to the last that occurs.
fn affine(at: Affine) -> Vec<i64> {
    let depth = (0..MAX_DEPTH).rev().find(|&d| at.strides[d] != 0).map_or(0, |d| d + 1);
    [at.offset].into_iter().chain(at.strides.into_iter().take(depth)).collect()
}

/// The nodes that a model uses, numbered anew, operands first.
struct Nodes {
    order: Vec<ExprId>,
    numbers: FastMap<ExprId, usize>,
}

impl Nodes {
    fn new(model: &Model) -> Nodes {
        let rows = model.rows.iter().map(|r| r.residual);
        let roots = model.roots.iter().map(|r| r.value).chain(model.quadratures.iter().copied());
        let mut all: Vec<ExprId> = rows.chain(roots).collect();
        for (_, program) in model.programs.named() {
            all.extend(program.nests.iter().flat_map(|n| &n.stores).map(|s| s.value));
        }
        let order = model.exprs.below_in_order(all);
        let numbers = order.iter().enumerate().map(|(i, e)| (*e, i)).collect();
        Nodes { order, numbers }
    }

    /// The number of a node; every node that is asked for is there.
    fn number(&self, expr: ExprId) -> Option<usize> {
        self.numbers.get(&expr).copied()
    }

    fn list(&self, model: &Model) -> Vec<Value> {
        self.order.iter().map(|&e| self.node(&model.exprs, model.exprs.node(e))).collect()
    }

    fn node(&self, exprs: &Exprs, node: Expr) -> Value {
        let list = |list: List| exprs.lists().of(list).iter().map(|&x| number(x)).collect::<Vec<_>>();
        let n = |e: ExprId| self.number(e);
        match node {
            Expr::Const(bits) => json!(["constant", number(f64::from_bits(bits))]),
            Expr::Truth(t) => json!(["truth", t]),
            Expr::Time => json!(["time"]),
            Expr::Counter(v) => json!(["counter", v.0]),
            Expr::Load { var, flavour, at } => json!(["load", var.index(), flavour.word(), affine(at)]),
            Expr::Unary(f, a) => json!([f.word(), n(a)]),
            Expr::Binary(f, a, b) => json!([f.word(), n(a), n(b)]),
            Expr::PowInt(a, exponent) => json!(["integer_power", n(a), exponent]),
            Expr::Passed(limits, side, a) => json!([side.word(), n(a), list(limits)]),
            Expr::Entry(numbers, a) => json!(["entry", n(a), list(numbers)]),
            Expr::Compare(f, a, b) => json!([f.word(), n(a), n(b)]),
            Expr::And(a, b) => json!(["and", n(a), n(b)]),
            Expr::Or(a, b) => json!(["or", n(a), n(b)]),
            Expr::Not(a) => json!(["not", n(a)]),
            Expr::Select(c, a, b) => json!(["select", n(c), n(a), n(b)]),
            Expr::Reduce { op, depth, extent, body } => json!([op.word(), depth.0, extent, n(body)]),
        }
    }
}

/// A number; what JSON has no numbers for as a word.
fn number(x: f64) -> Value {
    if x.is_nan() {
        json!("nan")
    } else if x.is_infinite() {
        json!(if x > 0.0 { "inf" } else { "-inf" })
    } else {
        json!(x)
    }
}
