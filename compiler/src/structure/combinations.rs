//! Rates that occur in fixed combinations only: `C*(d/dt y_2 - d/dt y_1) = f`, `C*(d/dt y_1 - d/dt
//! y_2) = g`.
//!
//! Equations that are linear in several rates, with numbers or parameters as coefficients, are
//! brought into reduced echelon form where they depend on each other. Each pivot row gives the rate
//! of a combination of states, which becomes the state: `w = y_1 - y_2`. Each dependent row is an
//! algebraic equation, and the states of the combinations become algebraic variables. Nothing is
//! approximated.

use std::collections::BTreeSet;

use super::common::programs;
use super::rates::linear;
use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, FastSet, Flavour, Place, Role, UnaryFn, VarId};
use crate::ir::{BinaryFn, Store};
use crate::model::{Model, Quantity, Variable};

/// Points at which coefficients are compared with zero, and what counts as zero there.
const POINTS: usize = 2;
const ZERO: f64 = 1e-12;

/// A coefficient: its expression and its values at random parameters.
#[derive(Clone, Copy)]
struct Coefficient {
    value: ExprId,
    at: [f64; POINTS],
}

/// An equation `sum of coefficient * rate + rest = 0`.
struct Line {
    equation: usize,
    terms: FastMap<VarId, Coefficient>,
    rest: ExprId,
}

/// Keeps dependent combinations of rates as states.
pub(crate) fn combine(model: &mut Model, equations: &mut Vec<Equation>) {
    let lines = lines(model, equations);
    if lines.len() < 2
        || model.interface.quantities.state_order.is_some()
        || model.interface.steady.as_ref().is_some_and(|s| !s.fixed.is_empty())
    {
        return;
    }
    for group in groups(lines) {
        let states: BTreeSet<VarId> = group.iter().flat_map(|line| line.terms.keys().copied()).collect();
        let (lines, pivots) = echelon(&mut model.exprs, group, &states);
        let dependent = lines.len() - pivots.len();
        let binds = |(i, line): (usize, &Line)| pivots.contains_key(&i) || has_unknown(model, line.rest);
        let determines = states.len() == lines.len() && lines.iter().enumerate().all(binds);
        if dependent > 0 && determines && is_free(model, equations, &lines, &states) {
            replace(model, equations, lines, &pivots, &states);
        }
    }
}

/// The equations that are linear in several rates of scalars that no other equation gives.
fn lines(model: &mut Model, equations: &[Equation]) -> Vec<Line> {
    let given: FastSet<VarId> =
        equations.iter().filter_map(|e| if let EquationForm::Rate { var, .. } = e.form { Some(var) } else { None }).collect();
    let (exprs, vars) = (&mut model.exprs, &model.vars);
    let mut out = Vec::new();
    for (equation, e) in equations.iter().enumerate().filter(|(_, e)| e.extents.is_empty()) {
        let EquationForm::Implicit { residual } = e.form else { continue };
        let rates = exprs.derivatives(residual, |v| vars[v].role == Role::State && !given.contains(&v));
        if rates.is_empty() || rates.iter().any(|(var, ..)| vars[*var].len != 1) {
            continue;
        }
        let (mut terms, mut rest) = (FastMap::default(), residual);
        for &(var, flavour, at) in &rates {
            let rate = exprs.load(var, flavour, at);
            let Some((factor, others)) = linear(exprs, rest, rate) else { break };
            let constant = exprs.loads(factor, |_, _| true).iter().all(|(v, ..)| vars[*v].role == Role::Param);
            if !constant {
                break;
            }
            rest = others;
            terms.insert(var, Coefficient { value: factor, at: std::array::from_fn(|point| value_at(exprs, factor, point)) });
        }
        if terms.len() == rates.len() {
            out.push(Line { equation, terms, rest });
        }
    }
    out
}

/// The value of a coefficient where every parameter has a random one.
fn value_at(exprs: &Exprs, e: ExprId, point: usize) -> f64 {
    let of = |e| value_at(exprs, e, point);
    match exprs.node(e) {
        Expr::Const(bits) => f64::from_bits(bits),
        Expr::Unary(UnaryFn::Neg, a) => -of(a),
        Expr::Binary(BinaryFn::Add, a, b) => of(a) + of(b),
        Expr::Binary(BinaryFn::Sub, a, b) => of(a) - of(b),
        Expr::Binary(BinaryFn::Mul, a, b) => of(a) * of(b),
        Expr::Binary(BinaryFn::Div, a, b) => of(a) / of(b),
        // A parameter, or any function of some.
        node => {
            use std::hash::{Hash, Hasher};
            let mut hasher = std::hash::DefaultHasher::new();
            (point, node).hash(&mut hasher);
            0.5 + (hasher.finish() >> 11) as f64 / (1_u64 << 53) as f64
        }
    }
}

/// Equations that share rates, directly or through others.
fn groups(lines: Vec<Line>) -> Vec<Vec<Line>> {
    let mut groups: Vec<Vec<Line>> = Vec::new();
    for line in lines {
        let shares = |group: &Vec<Line>| group.iter().any(|other| other.terms.keys().any(|var| line.terms.contains_key(var)));
        let (connected, others): (Vec<_>, Vec<_>) = groups.into_iter().partition(shares);
        groups = others;
        groups.push(connected.into_iter().flatten().chain([line]).collect());
    }
    groups.iter_mut().for_each(|group| group.sort_by_key(|line| line.equation));
    groups
}

/// Reduced echelon form; the state of each pivot, by line.
fn echelon(exprs: &mut Exprs, mut lines: Vec<Line>, states: &BTreeSet<VarId>) -> (Vec<Line>, FastMap<usize, VarId>) {
    let mut pivots: FastMap<usize, VarId> = FastMap::default();
    for &state in states {
        let Some(own) = (0..lines.len()).find(|i| !pivots.contains_key(i) && lines[*i].terms.contains_key(&state)) else { continue };
        pivots.insert(own, state);
        let pivot = lines[own].terms[&state];
        let divided = |exprs: &mut Exprs, c: Coefficient| Coefficient {
            value: exprs.div(c.value, pivot.value),
            at: std::array::from_fn(|point| c.at[point] / pivot.at[point]),
        };
        let terms: Vec<(VarId, Coefficient)> = lines[own].terms.iter().map(|(v, c)| (*v, divided(exprs, *c))).collect();
        let rest = exprs.div(lines[own].rest, pivot.value);
        lines[own].terms = terms.iter().copied().collect();
        lines[own].rest = rest;
        for line in (0..lines.len()).filter(|i| *i != own) {
            let Some(factor) = lines[line].terms.get(&state).copied() else { continue };
            for &(var, coefficient) in &terms {
                subtract(exprs, &mut lines[line].terms, var, factor, coefficient);
            }
            lines[line].terms.remove(&state);
            let part = exprs.mul(factor.value, rest);
            lines[line].rest = exprs.sub(lines[line].rest, part);
        }
    }
    (lines, pivots)
}

/// Subtracts a product from a coefficient; what cancels whatever the parameters are is dropped.
fn subtract(exprs: &mut Exprs, terms: &mut FastMap<VarId, Coefficient>, var: VarId, factor: Coefficient, coefficient: Coefficient) {
    let before = terms.get(&var).map_or([0.0; POINTS], |c| c.at);
    let product: [f64; POINTS] = std::array::from_fn(|point| factor.at[point] * coefficient.at[point]);
    let at: [f64; POINTS] = std::array::from_fn(|point| before[point] - product[point]);
    if (0..POINTS).all(|point| at[point].abs() <= ZERO * (before[point].abs() + product[point].abs())) {
        terms.remove(&var);
        return;
    }
    let product = exprs.mul(factor.value, coefficient.value);
    let value = match terms.get(&var) {
        Some(c) => exprs.sub(c.value, product),
        None => exprs.neg(product),
    };
    terms.insert(var, Coefficient { value, at });
}

/// Returns `true` if a dependent equation has something to determine.
fn has_unknown(model: &Model, rest: ExprId) -> bool {
    !model.exprs.loads(rest, |v, f| f == Flavour::Value && matches!(model.vars[v].role, Role::State | Role::Algebraic)).is_empty()
}

/// Returns `true` if nothing else reads the rates of the states or sets the states, but for their
/// initial values.
fn is_free(model: &Model, equations: &[Equation], lines: &[Line], states: &BTreeSet<VarId>) -> bool {
    let own: FastSet<usize> = lines.iter().map(|line| line.equation).collect();
    let reads = |e: ExprId| !model.exprs.derivatives(e, |v| states.contains(&v)).is_empty();
    let others = equations.iter().enumerate().filter(|(i, _)| !own.contains(i)).map(|(_, e)| match e.form {
        EquationForm::Rate { value, .. } | EquationForm::Definition { value, .. } => value,
        EquationForm::Implicit { residual } => residual,
    });
    let stores = || programs(&model.programs).flat_map(|p| &p.nests).flat_map(|nest| nest.stores.iter().map(move |store| (nest, store)));
    let mut read =
        others.chain(model.roots.iter().map(|root| root.value)).chain(model.quadratures.iter().copied()).chain(stores().map(|s| s.1.value));
    let sets = |store: &Store| matches!(store.target.place, Place::Var(var) if states.contains(&var));
    let initial =
        |store: &Store| model.programs.initial_states.nests.iter().any(|n| n.loops.is_empty() && n.stores.iter().any(|s| s == store));
    !read.any(reads) && stores().all(|(nest, store)| !sets(store) || nest.loops.is_empty() && initial(store))
}

fn replace(model: &mut Model, equations: &mut Vec<Equation>, lines: Vec<Line>, pivots: &FastMap<usize, VarId>, states: &BTreeSet<VarId>) {
    let initial: FastMap<VarId, ExprId> = states.iter().map(|&var| (var, initial_value(model, var))).collect();
    for (i, line) in lines.into_iter().enumerate() {
        let Some(&pivot) = pivots.get(&i) else {
            equations[line.equation].form = EquationForm::Implicit { residual: line.rest };
            continue;
        };
        let mut others: Vec<(VarId, Coefficient)> = line.terms.into_iter().filter(|(var, _)| *var != pivot).collect();
        others.sort_by_key(|(var, _)| *var);
        let value = model.exprs.neg(line.rest);
        let zero = Affine::constant(0);
        if others.is_empty() {
            equations[line.equation].form = EquationForm::Rate { var: pivot, at: zero, value };
            continue;
        }
        let sum = |exprs: &mut Exprs, of: &dyn Fn(&mut Exprs, VarId) -> ExprId| {
            others.iter().fold(exprs.constant(0.0), |sum, (var, c)| {
                let value = of(exprs, *var);
                let part = exprs.mul(c.value, value);
                exprs.add(sum, part)
            })
        };
        let start = sum(&mut model.exprs, &|_, var| initial[&var]);
        let start = model.exprs.add(initial[&pivot], start);
        let combination = new_state(model, pivot, &others, start);
        equations[line.equation].form = EquationForm::Rate { var: combination, at: zero, value };
        let rest = sum(&mut model.exprs, &|exprs, var| exprs.load(var, Flavour::Value, zero));
        let own = model.exprs.load(combination, Flavour::Value, zero);
        let value = model.exprs.sub(own, rest);
        let span = equations[line.equation].span;
        equations.push(Equation {
            extents: Vec::new(),
            runs: 0,
            repeats: None,
            form: EquationForm::Definition { var: pivot, at: zero, value },
            span,
        });
        make_algebraic(model, pivot);
        others.iter().for_each(|(var, _)| make_algebraic(model, *var));
    }
}

/// The initial value of a scalar state.
fn initial_value(model: &mut Model, var: VarId) -> ExprId {
    let stores = model.programs.initial_states.nests.iter().flat_map(|nest| &nest.stores);
    let stored = stores.filter(|store| store.target.place == Place::Var(var)).map(|store| store.value).next_back();
    let declared = model.interface.quantities.states.iter().find(|q| q.var == Some(var)).and_then(|q| q.default.first().copied());
    stored.unwrap_or_else(|| model.exprs.constant(declared.filter(|x| x.is_finite()).unwrap_or_default()))
}

/// The state that a combination becomes, in the place of its first member.
fn new_state(model: &mut Model, pivot: VarId, others: &[(VarId, Coefficient)], start: ExprId) -> VarId {
    let mut name = model.vars[pivot].name.clone();
    for (var, coefficient) in others {
        let factor = coefficient.at[0];
        let known = (coefficient.at[1] - factor).abs() <= ZERO * factor.abs();
        let sign = if factor < 0.0 { '-' } else { '+' };
        let factor = match factor.abs() {
            size if known && (size - 1.0).abs() <= ZERO => String::new(),
            size if known => format!("{size}*"),
            _ => "k*".to_owned(),
        };
        name.push_str(&format!(" {sign} {factor}{}", model.vars[*var].name));
    }
    let span = model.vars[pivot].span;
    let new = model.vars.push(Variable { name: name.clone(), role: Role::State, len: 1, span });
    model.unknowns.iter_mut().filter(|var| **var == pivot).for_each(|var| *var = new);
    let target = crate::ir::Target { place: Place::Var(new), at: Affine::constant(0) };
    model.programs.initial_states.nests.push(crate::ir::Nest { loops: Vec::new(), stores: vec![Store { target, value: start }] });
    let states = &mut model.interface.quantities.states;
    if let Some(at) = states.iter().position(|q| q.var == Some(pivot)) {
        let text = "combination of rates, kept as the state".to_owned();
        let quantity = Quantity {
            var: Some(new),
            name,
            text,
            low: vec![f64::NEG_INFINITY],
            high: vec![f64::INFINITY],
            affine_unit: false,
            ..states[at].clone()
        };
        states.insert(at, quantity);
    }
    new
}

/// Makes a scalar state an algebraic variable that starts where the state did.
fn make_algebraic(model: &mut Model, var: VarId) {
    if model.vars[var].role == Role::Algebraic {
        return;
    }
    model.vars[var].role = Role::Algebraic;
    model.unknowns.retain(|other| *other != var);
    for nest in &mut model.programs.initial_states.nests {
        nest.stores.retain(|store| store.target.place != Place::Var(var));
    }
    model.programs.initial_states.nests.retain(|nest| !nest.stores.is_empty());
    let quantities = &mut model.interface.quantities;
    let Some(at) = quantities.states.iter().position(|q| q.var == Some(var)) else { return };
    let quantity = quantities.states.remove(at);
    let first: usize = quantities.algebraics.iter().map(Quantity::len).sum();
    quantities.algebraics.push(quantity);
    let target = crate::ir::Target { place: Place::Out, at: Affine::constant(first as i64) };
    let value = model.exprs.load(var, Flavour::Value, Affine::constant(0));
    model.programs.outputs.nests.push(crate::ir::Nest { loops: Vec::new(), stores: vec![Store { target, value }] });
}
