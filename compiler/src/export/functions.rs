//! The functions of a model: residual, rates, outputs, what is looked at after a step, updates.

use super::sheet::{Array, Function, Label, Loops, Nest, Sheet, Store};
use super::{ExportError, Nominal};
use crate::differentiate::pattern::each;
use crate::ir::{Affine, Expr, ExprId, Exprs, Flavour, LoopVar, MAX_DEPTH, Place, Program, Rewritten};
use crate::model::{Model, Quantity, RootAction};

/// The sheet of a model with its functions.
///
/// # Errors
/// If a program of the model has a form that exports do not know.
pub(super) fn sheet(model: &Model, nominal: &Nominal<'_>) -> Result<Sheet, ExportError> {
    let mut sheet = Sheet::new(model, nominal);
    sheet.functions = all(&mut sheet)?;
    sheet.find_extra(nominal);
    Ok(sheet)
}

/// All functions of a model but those that are empty.
fn all(sheet: &mut Sheet) -> Result<Vec<Function>, ExportError> {
    let mut functions = equations(sheet)?;
    functions.extend(values(sheet)?);
    functions.extend(finish(sheet)?);
    functions.extend(updates(sheet)?);
    functions.retain(|f| !f.nests.is_empty() && (f.update || !f.outputs.is_empty()));
    Ok(functions)
}

/// Residual, and its two parts where the model is explicit.
fn equations(sheet: &mut Sheet) -> Result<Vec<Function>, ExportError> {
    let rows = sheet.model.rows.clone();
    let mut nests = Vec::with_capacity(rows.len());
    for row in &rows {
        let loops: Loops = (0..).zip(row.extents.iter().copied()).collect();
        let read = sheet.read(row.var, Flavour::Value, row.at, &extents(&loops))?;
        let store = Store { array: None, positions: spread(&loops, &read.loops, &read.positions), add: false, value: row.residual };
        nests.push(Nest { loops, stores: vec![store] });
    }
    let f = &sheet.families;
    let label = |name: &str, unit: &str| Label { name: name.to_owned(), unit: unit.to_owned() };
    let labels: Vec<Label> = f.states.iter().chain(&f.solved).map(|e| label(&e.name, &e.unit)).collect();
    let states = f.states.len();
    let text = "residual of every equation: f - y' for a rate, left - right otherwise".to_owned();
    let mut functions = vec![];
    if sheet.model.explicit {
        let mut done = Rewritten::default();
        let mut still: Vec<Nest> = nests.clone();
        for store in still.iter_mut().flat_map(|n| &mut n.stores) {
            store.value = at_rest(&mut sheet.model.exprs, store.value, &mut done);
        }
        let part = |wanted: std::ops::Range<usize>, name: &str, text: &str| Function {
            name: name.into(),
            text: text.into(),
            nests: still.iter().filter_map(|n| within(n, wanted.start as u32..wanted.end as u32)).collect(),
            update: false,
            outputs: labels[wanted].to_vec(),
        };
        functions.push(part(0..states, "rates", "time derivatives of the states"));
        functions.push(part(states..labels.len(), "algebraic", "residual of the algebraic equations"));
    }
    functions.insert(0, Function { name: "residual".into(), text, nests, update: false, outputs: labels });
    Ok(functions)
}

/// An expression with all derivatives zero: of `f - y'`, f.
fn at_rest(exprs: &mut Exprs, value: ExprId, done: &mut Rewritten) -> ExprId {
    exprs.rewrite_where(value, done, &Exprs::has_derivative, &mut |exprs, node| match node {
        Expr::Load { flavour: Flavour::Derivative, .. } => Some(exprs.constant(0.0)),
        _ => None,
    })
}

/// A nest whose stores all lie in a range, counted from its start.
fn within(nest: &Nest, range: std::ops::Range<u32>) -> Option<Nest> {
    let mut nest = nest.clone();
    nest.stores.retain(|store| store.positions.iter().all(|at| range.contains(at)));
    nest.stores.iter_mut().flat_map(|s| &mut s.positions).for_each(|at| *at -= range.start);
    (!nest.stores.is_empty()).then_some(nest)
}

/// Outputs, root functions, integrands, invariants, boxes, delayed expressions, policies.
fn values(sheet: &mut Sheet) -> Result<Vec<Function>, ExportError> {
    let model = &sheet.model;
    let (i, p) = (&model.interface, &model.programs);
    let quantity = |q: &Quantity, k: usize| Label { name: q.element_name(k), unit: q.unit.clone() };
    let labels = |list: &[Quantity]| list.iter().flat_map(|q| (0..q.len()).map(|k| quantity(q, k))).collect::<Vec<_>>();
    let plain = |name: String| Label { name, unit: "1".into() };
    let numbers = |values: &mut dyn Iterator<Item = ExprId>| {
        let store = |(at, value)| Store { array: None, positions: vec![at], add: false, value };
        let stores: Vec<Store> = (0..).zip(values).map(store).collect();
        if stores.is_empty() { vec![] } else { vec![Nest { loops: vec![], stores }] }
    };
    let function = |name: &str, text: &str, nests: Vec<Nest>, outputs: Vec<Label>| Function {
        name: name.to_owned(),
        text: text.to_owned(),
        nests,
        update: false,
        outputs,
    };
    let roots = model.roots.iter().map(|r| plain(r.name.clone())).collect();
    let integrals = (1..=model.quadratures.len()).map(|k| plain(format!("integral({k})"))).collect();
    let invariants = i.invariants.iter().flat_map(|x| [plain(x.name.clone()), plain(format!("{}'", x.name))]).collect();
    let boxed = i.finish.failures.iter().flat_map(|f| &f.items).map(|item| Label { name: item.name.clone(), unit: item.unit.clone() });
    let mut list = vec![
        function("outputs", "algebraic outputs", nests(sheet, &p.outputs)?, labels(&i.quantities.algebraics)),
        function(
            "events",
            "root functions of events, positive where the condition holds",
            numbers(&mut model.roots.iter().map(|r| r.value)),
            roots,
        ),
        function("integrals", "integrands of what is integrated over a step", numbers(&mut model.quadratures.iter().copied()), integrals),
        function("invariants", "value and rate of each invariant", nests(sheet, &p.invariants)?, invariants),
        function("boxes", "what the boxes of failures hold", nests(sheet, &p.boxes)?, boxed.collect()),
    ];
    let delayed = || model.delays.iter().flat_map(|delay| std::iter::repeat_n(delay.name.clone(), delay.count as usize));
    for (name, text, program) in [
        ("delayed", "present values of what is delayed", &p.delayed),
        ("lags", "dead times", &p.lags),
        ("before", "values before the start, where they are given", &p.before),
    ] {
        list.push(function(name, text, nests(sheet, program)?, delayed().map(plain).collect()));
    }
    for (name, program) in &p.policies {
        let text = format!("actions of the policy {name}");
        list.push(function(&format!("policy_{name}"), &text, nests(sheet, program)?, labels(&i.quantities.actions)));
    }
    Ok(list)
}

/// The parts of the program `finish`.
fn finish(sheet: &mut Sheet) -> Result<Vec<Function>, ExportError> {
    let program = sheet.model.programs.finish.clone();
    let all = nests(sheet, &program)?;
    let i = &sheet.model.interface;
    let plain = |name: &String| Label { name: name.clone(), unit: "1".into() };
    let failures = i.finish.failures.iter().flat_map(|f| [plain(&f.name), plain(&format!("{} excess", f.name))]).collect();
    let rewards = i.finish.rewards.iter().map(|r| Label { name: r.name.clone(), unit: r.unit.clone() }).collect();
    let observations = i.finish.observations.iter().map(|o| Label { name: o.name.clone(), unit: o.unit.clone() }).collect();
    let parts: [(&str, &str, Vec<Label>); 5] = [
        ("failures", "for each failure, 1 where it holds (NaN where that is unknown), and its violation", failures),
        ("successes", "1 where a success holds", i.finish.successes.iter().map(plain).collect()),
        ("constraints", "violation of each constraint, 0 when kept", i.finish.constraints.iter().map(plain).collect()),
        ("rewards", "rewards, before the error reward of failures", rewards),
        ("observations", "observations, physical units, without noise, delay and clipping", observations),
    ];
    let mut first = 0;
    let mut functions = vec![];
    for (name, text, outputs) in parts {
        let range = first..first + outputs.len() as u32;
        first = range.end;
        let mut part = vec![];
        for nest in &all {
            part.extend(cut(&mut sheet.model.exprs, nest, &range));
        }
        functions.push(Function { name: name.into(), text: text.into(), nests: part, update: false, outputs });
    }
    Ok(functions)
}

/// Stores of a nest in a range, counted from its start; single iterations if only some are in it.
pub(super) fn cut(exprs: &mut Exprs, nest: &Nest, range: &std::ops::Range<u32>) -> Vec<Nest> {
    let mut whole = within(nest, range.clone()).into_iter().collect::<Vec<_>>();
    for store in &nest.stores {
        let inside = store.positions.iter().filter(|at| range.contains(at)).count();
        if inside == 0 || inside == store.positions.len() {
            continue;
        }
        let mut pass = 0;
        each(&nest.loops, |counters| {
            let at = store.positions[pass];
            pass += 1;
            if range.contains(&at) {
                let value = at_pass(exprs, store.value, &nest.loops, counters);
                let single = Store { array: store.array, positions: vec![at - range.start], add: store.add, value };
                whole.push(Nest { loops: vec![], stores: vec![single] });
            }
        });
    }
    whole
}

/// An expression at given counters.
pub(super) fn at_pass(exprs: &mut Exprs, value: ExprId, loops: &Loops, counters: &[i64; MAX_DEPTH]) -> ExprId {
    loops.iter().fold(value, |value, &(d, _)| exprs.shift(value, LoopVar(d), counters[d as usize]))
}

/// Updates at instants of an episode, which change `y` and `p` in place.
fn updates(sheet: &mut Sheet) -> Result<Vec<Function>, ExportError> {
    let p = sheet.model.programs.clone();
    let mut list: Vec<(String, String, &Program)> = vec![
        ("parameters".into(), "computed and drawn parameters that are not given".into(), &p.parameters),
        ("initial_states".into(), "initial values of the states".into(), &p.initial_states),
        ("initial_discretes".into(), "initial values of discrete variables and disturbances".into(), &p.initial_discretes),
        ("disturb".into(), "next values of the disturbances".into(), &p.disturb),
        ("start".into(), "updates and resets at the start of a step".into(), &p.start),
        ("end".into(), "updates and clamps at the end of a step".into(), &p.end),
    ];
    for (number, program) in p.events.iter().enumerate() {
        let runs = |action| matches!(action, RootAction::Run(k) if k as usize == number);
        let names: Vec<&str> = sheet.model.roots.iter().filter(|r| runs(r.action)).map(|r| r.name.as_str()).collect();
        list.push((format!("event_{number}"), format!("what the event {} does", names.join(", ")), program));
    }
    let mut functions = vec![];
    for (name, text, program) in list {
        let nests = nests(sheet, program)?;
        functions.push(Function { name, text, nests, update: true, outputs: vec![] });
    }
    Ok(functions)
}

/// A program with its stores in public order.
fn nests(sheet: &Sheet, program: &Program) -> Result<Vec<Nest>, ExportError> {
    let mut out = Vec::with_capacity(program.nests.len());
    for nest in &program.nests {
        let loops: Loops = nest.loops.clone();
        let mut stores = Vec::with_capacity(nest.stores.len());
        for store in &nest.stores {
            let (at, value) = (store.target.at, store.value);
            let (array, positions) = match store.target.place {
                Place::Out => (None, places(&loops, |counters| at.at(counters) as u32)),
                // Only the back end's functions store by tables.
                Place::Table { table, .. } => return Err(ExportError::Unavailable { variable: format!("table {table}") }),
                Place::Var(var) => {
                    let read = sheet.read(var, Flavour::Value, at, &extents(&loops))?;
                    (Some(read.array), spread(&loops, &read.loops, &read.positions))
                }
            };
            stores.push(Store { array, positions, add: false, value });
        }
        out.push(Nest { loops, stores });
    }
    Ok(out)
}

fn places(loops: &Loops, mut of: impl FnMut(&[i64; MAX_DEPTH]) -> u32) -> Vec<u32> {
    let mut places = vec![];
    each(loops, |counters| places.push(of(counters)));
    places
}

/// Passes by counter.
pub(super) fn extents(loops: &Loops) -> super::sheet::Extents {
    let mut extents = [0; MAX_DEPTH];
    loops.iter().for_each(|&(d, extent)| extents[d as usize] = extent);
    extents
}

/// Positions that some of the loops move, for every pass of all of them.
pub(super) fn spread(all: &Loops, some: &Loops, positions: &[u32]) -> Vec<u32> {
    let index: Affine = crate::schedule::row_major(some);
    places(all, |counters| positions[index.at(counters) as usize])
}

/// Returns `true` if an update stores what another pass of the same nest reads, so that its passes
/// are not an array operation.
pub(super) fn is_sequential(sheet: &Sheet, nest: &Nest) -> bool {
    let stored: Vec<Array> = nest.stores.iter().filter_map(|s| s.array).collect();
    let mut sequential = nest.stores.iter().any(|s| {
        let mut sorted = s.positions.clone();
        sorted.sort_unstable();
        sorted.windows(2).any(|pair| pair[0] == pair[1])
    });
    let mut stack: Vec<ExprId> = nest.stores.iter().map(|s| s.value).collect();
    let mut seen = crate::ir::FastSet::default();
    let around = extents(&nest.loops);
    while let Some(expr) = stack.pop() {
        if !seen.insert(expr) {
            continue;
        }
        stack.extend(sheet.model.exprs.operands(expr));
        if let Expr::Load { var, flavour: Flavour::Value, at } = sheet.model.exprs.node(expr) {
            let inside = at.counters() & !nest.loops.iter().fold(0, |bits, l| bits | 1 << l.0) == 0;
            let Some(read) = inside.then(|| sheet.read(var, Flavour::Value, at, &around).ok()).flatten() else {
                sequential |= !inside;
                continue;
            };
            let same = |s: &Store| s.positions == spread(&nest.loops, &read.loops, &read.positions);
            let touches = |s: &Store| s.array == Some(read.array) && s.positions.iter().any(|at| read.positions.contains(at));
            sequential |= stored.contains(&read.array) && nest.stores.iter().any(|s| touches(s) && !same(s));
        }
    }
    sequential && !nest.loops.is_empty()
}
