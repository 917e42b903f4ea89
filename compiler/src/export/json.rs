//! The checked model as JSON, in the form that `docs/schema/model-1.schema.json` fixes.
//!
//! Expressions are one list of nodes, operands before users: trees whose repeated parts are written once. Loops stay loops.

use cranelift_entity::EntityRef;
use serde_json::{Map, Value, json};

use super::{Element, ExportError, Families, Nominal, Origin};
use crate::ir::{
    Affine, BinaryFn, Compare, Expr, ExprId, Exprs, FastMap, FastSet, Flavour, List, MAX_DEPTH, Place, Program, ReduceFn, Role, Side,
    UnaryFn,
};
use crate::model::{Instant, Model, RootAction, Variate};

/// Version of the form; what changes the meaning of a file counts it up.
const VERSION: u32 = 1;

/// The text of a model.
pub(super) fn print(model: &Model, nominal: &Nominal<'_>, origin: &Origin<'_>) -> Result<String, ExportError> {
    let nodes = Nodes::new(model);
    let (i, families) = (&model.interface, Families::new(model, nominal));
    let value = json!({
        "format": "smpl-model",
        "version": VERSION,
        "name": i.name,
        "text": i.text,
        "made_for": origin.made_for,
        "time": {"name": i.time.0, "unit": i.time.1},
        "explicit": model.explicit,
        "variables": model.vars.values().filter(|v| v.role != Role::Cache).map(|v| json!({
            "name": v.name, "role": role(v.role), "length": v.len,
        })).collect::<Vec<_>>(),
        "unknowns": model.unknowns.iter().map(|v| v.index()).collect::<Vec<_>>(),
        "elements": {
            "states": elements(&families.states),
            "solved": elements(&families.solved),
            "outputs": elements(&families.outputs),
            "discretes": elements(&families.discretes),
            "actions": elements(&families.actions),
            "disturbances": elements(&families.disturbances),
            "parameters": elements(&families.parameters),
        },
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
        "programs": programs(model).into_iter().map(|(name, p)| (name, program(p, &nodes))).collect::<Map<_, _>>(),
        "finish": finish(model),
        "draws": i.draws.iter().map(|d| json!({
            "stream": d.stream,
            "kind": if d.kind == Variate::Uniform { "uniform" } else { "normal" },
            "at": if d.instant == Instant::Reset { "reset" } else { "step" },
        })).collect::<Vec<_>>(),
        "phases": i.phases,
        "invariants": i.invariants.iter().map(|(name, text)| json!({"name": name, "text": text})).collect::<Vec<_>>(),
        "steady": steady(model, &families),
        "episode": i.episode,
        "solver": solver(model),
        "variants": i.variants.iter().map(|(name, on)| json!({"name": name, "on": on})).collect::<Vec<_>>(),
        "choices": i.choices.iter().map(|(name, options, chosen)| json!({
            "name": name, "options": options, "chosen": options.get(*chosen as usize),
        })).collect::<Vec<_>>(),
    });
    Ok(serde_json::to_string_pretty(&value)? + "\n")
}

fn role(role: Role) -> &'static str {
    match role {
        Role::State => "state",
        Role::Algebraic => "algebraic",
        Role::Param => "parameter",
        Role::Action => "action",
        Role::Discrete => "discrete",
        Role::Disturbance => "disturbance",
        Role::Draw => "draw",
        Role::Quadrature => "integral",
        Role::Builtin => "builtin",
        Role::ParamGiven => "given",
        Role::Cache => "cache",
        Role::Scratch => "scratch",
    }
}

fn elements(elements: &[Element]) -> Vec<Value> {
    let described = |e: &Element| {
        json!({
            "name": e.name, "unit": e.unit, "text": e.text,
            "low": e.low, "high": e.high, "scale": e.scale, "nominal": e.nominal, "structural": e.structural,
            "variable": e.place.map(|(var, _)| var.index()), "element": e.place.map(|(_, element)| element),
        })
    };
    elements.iter().map(described).collect()
}

fn solver(model: &Model) -> Value {
    let s = &model.interface.solver;
    json!({
        "rtol": s.rtol, "atol_factor": s.atol_factor, "max_order": s.max_order, "max_steps": s.max_steps,
        "max_step": s.max_step, "linear_solver": s.linear_solver,
    })
}

/// What the outputs of the program `finish` are, one after another; a failure has two numbers.
fn finish(model: &Model) -> Value {
    let i = &model.interface;
    let observation = |o: &crate::model::Observed| json!({"name": o.name, "unit": o.unit, "low": o.low, "high": o.high, "every": o.every, "delay": o.delay, "noise": o.noise});
    json!({
        "failures": i.failures.iter().map(|f| json!({"name": f.name, "text": f.text, "event": f.event})).collect::<Vec<_>>(),
        "successes": i.successes,
        "constraints": i.constraints,
        "rewards": i.rewards.iter().map(|r| json!({"name": r.name, "unit": r.unit, "text": r.text})).collect::<Vec<_>>(),
        "default_reward": i.rewards.get(i.default_reward as usize).map(|r| &r.name),
        "observations": i.observations.iter().map(observation).collect::<Vec<_>>(),
    })
}

fn steady(model: &Model, families: &Families) -> Value {
    let i = &model.interface;
    if !i.has_steady {
        return Value::Null;
    }
    let mut inside: Vec<&Element> = families.states.iter().collect();
    if let Some(order) = &i.state_order {
        let mut sorted = inside.clone();
        order.iter().zip(&inside).for_each(|(&at, element)| sorted[at as usize] = element);
        inside = sorted;
    }
    let fixed: Vec<&str> = i.steady_fixed.iter().filter_map(|&at| Some(inside.get(at as usize)?.name.as_str())).collect();
    json!({"fixed": fixed, "conditions": i.steady_conditions, "given": i.steady_given})
}

fn action(action: RootAction) -> Value {
    match action {
        RootAction::Fail(i) => json!({"fail": i}),
        RootAction::Run(i) => json!({"run": format!("event {i}")}),
        RootAction::Restart => json!("restart"),
    }
}

/// The programs with their names.
fn programs(model: &Model) -> Vec<(String, &Program)> {
    let p = &model.programs;
    let fixed = [
        ("parameters", &p.parameters),
        ("initial_states", &p.initial_states),
        ("initial_discretes", &p.initial_discretes),
        ("steady", &p.steady),
        ("disturb", &p.disturb),
        ("start", &p.start),
        ("end", &p.end),
        ("finish", &p.finish),
        ("outputs", &p.outputs),
        ("invariants", &p.invariants),
        ("boxes", &p.boxes),
    ];
    let events = p.events.iter().enumerate().map(|(i, e)| (format!("event {i}"), e));
    let policies = p.policies.iter().map(|(name, program)| (format!("policy {name}"), program));
    fixed.into_iter().map(|(name, p)| (name.to_owned(), p)).chain(events).chain(policies).collect()
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
                        Place::OutSlots(table) => json!({"out": at, "table": table, "value": value}),
                        Place::Var(var) => json!({"variable": var.index(), "at": at, "value": value}),
                    }
                })
                .collect();
            json!({"extents": nest.extents, "stores": stores})
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
        let mut stack: Vec<ExprId> = rows.chain(roots).collect();
        for (_, program) in programs(model) {
            stack.extend(program.nests.iter().flat_map(|n| &n.stores).map(|s| s.value));
        }
        let mut seen = FastSet::default();
        while let Some(expr) = stack.pop() {
            if seen.insert(expr) {
                stack.extend(model.exprs.operands(expr));
            }
        }
        let mut order: Vec<ExprId> = seen.into_iter().collect();
        order.sort_unstable();
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
            Expr::Load { var, flavour, at } => json!(["load", var.index(), copy(flavour), affine(at)]),
            Expr::Unary(f, a) => json!([unary(f), n(a)]),
            Expr::Binary(f, a, b) => json!([binary(f), n(a), n(b)]),
            Expr::PowInt(a, exponent) => json!(["integer_power", n(a), exponent]),
            Expr::Passed(limits, side, a) => {
                let side = if side == Side::UpTo { "passed_up_to" } else { "passed_below" };
                json!([side, n(a), list(limits)])
            }
            Expr::Entry(numbers, a) => json!(["entry", n(a), list(numbers)]),
            Expr::Compare(f, a, b) => json!([compare(f), n(a), n(b)]),
            Expr::And(a, b) => json!(["and", n(a), n(b)]),
            Expr::Or(a, b) => json!(["or", n(a), n(b)]),
            Expr::Not(a) => json!(["not", n(a)]),
            Expr::Select(c, a, b) => json!(["select", n(c), n(a), n(b)]),
            Expr::Reduce { op, depth, extent, body } => json!([reduce(op), depth.0, extent, n(body)]),
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

fn copy(flavour: Flavour) -> &'static str {
    match flavour {
        Flavour::Value => "value",
        Flavour::Derivative => "derivative",
        Flavour::Initial => "initial",
        Flavour::Previous => "previous",
        Flavour::Steady => "steady",
    }
}

fn unary(f: UnaryFn) -> &'static str {
    match f {
        UnaryFn::Neg => "negate",
        UnaryFn::Abs => "abs",
        UnaryFn::Sign => "sign",
        UnaryFn::Sqrt => "sqrt",
        UnaryFn::Exp => "exp",
        UnaryFn::Ln => "ln",
        UnaryFn::Log10 => "log10",
        UnaryFn::Sin => "sin",
        UnaryFn::Cos => "cos",
        UnaryFn::Tan => "tan",
        UnaryFn::Asin => "asin",
        UnaryFn::Acos => "acos",
        UnaryFn::Atan => "atan",
        UnaryFn::Sinh => "sinh",
        UnaryFn::Cosh => "cosh",
        UnaryFn::Tanh => "tanh",
        UnaryFn::Floor => "floor",
        UnaryFn::Ceil => "ceil",
        UnaryFn::Round => "round",
        UnaryFn::Single => "single",
    }
}

fn binary(f: BinaryFn) -> &'static str {
    match f {
        BinaryFn::Add => "add",
        BinaryFn::Sub => "subtract",
        BinaryFn::Mul => "multiply",
        BinaryFn::Div => "divide",
        BinaryFn::Pow => "power",
        BinaryFn::Min => "min",
        BinaryFn::Max => "max",
        BinaryFn::Atan2 => "atan2",
    }
}

fn compare(f: Compare) -> &'static str {
    match f {
        Compare::Lt => "less",
        Compare::Le => "less_equal",
        Compare::Eq => "equal",
        Compare::Ne => "unequal",
    }
}

fn reduce(f: ReduceFn) -> &'static str {
    match f {
        ReduceFn::Sum => "sum",
        ReduceFn::Product => "product",
        ReduceFn::Min => "minimum",
        ReduceFn::Max => "maximum",
    }
}
