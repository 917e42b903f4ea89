//! Constraints that states are projected to with unknown multipliers: many of them, loops that
//! share states, and constraints with algebraic unknowns.
//!
//! Constraints h(x, z) = 0 bind algebraic unknowns z; H = ∂h/∂x and G = ∂h/∂z. The corrections v of
//! the states and the multipliers μ are unknowns of the model:
//!
//! - h + H v = 0, a row of each multiplier,
//! - v + W Hᵀ μ = 0, a row of each correction, W the squared scales of the states,
//! - Gᵀ μ = 0, a row of each z.
//!
//! On the constraints v = 0. Off them x + v is the nearest point of the linearised constraints. The
//! system is regular wherever [H G] has full rank by rows and G by columns: no choice of states is
//! made that could become bad. It is as sparse as the constraints. Rates lead back by κ v; at the
//! end of each step the states move by v.

use std::collections::BTreeMap;

use super::super::common::{passes, sets};
use super::super::whole::{number, placed};
use super::project::{Group, RETURN, watch};
use super::slopes::{Slopes, whole};
use super::start::Start;
use super::system::{Node, Read, Settled, Wishes, scale, whole_of};
use crate::differentiate::{Column, normalise, total};
use crate::elaborate::for_each_element;
use crate::ir::{
    Affine, Compare, ExprId, Exprs, FastMap, FastSet, Flavour, LoopVar, MAX_DEPTH, Nest, ReduceFn, Role, Store, Target, VarId,
};
use crate::model::{Axis, Correction, Model, Quantity, Row, Variable};

/// Passes of a sum of which each is one element.
const LONGEST: u32 = 64;

/// Most equations and states that are projected together.
const LARGEST: i64 = 200_000;

/// Rows of corrections, multipliers and unknowns that they determine.
#[derive(Default)]
pub(super) struct Corrected {
    pub(super) rows: Vec<Row>,
    /// Quantities of corrections and multipliers.
    pub(super) helpers: Vec<Quantity>,
}

/// A derivative of a constraint by an element in each pass of its loops.
struct Part {
    node: usize,
    at: Affine,
    slope: ExprId,
}

/// A sum over the constraints that read an element, for elements that a loop goes over.
struct Sum {
    extents: Vec<u32>,
    at: Affine,
    value: ExprId,
}

/// Constraints in one form, with what they read.
pub(super) struct Constraints {
    nodes: Vec<Node>,
    /// Derivatives by the elements of each variable.
    parts: FastMap<VarId, Vec<Part>>,
    states: Vec<VarId>,
    /// The unknowns of lower order that they bind.
    bound: Vec<(VarId, FastSet<i64>)>,
}

impl Constraints {
    /// Constraints with what they determine; `None` if they cannot be projected to.
    pub(super) fn of(model: &mut Model, slopes: &Slopes, wishes: &Wishes, members: &[&Settled]) -> Option<Constraints> {
        let mut nodes: Vec<Node> = members.iter().map(|s| s.node.clone()).collect();
        for node in &mut nodes {
            let values = |_: VarId, flavour: Flavour| (flavour == Flavour::Value).then_some(Column { first: 0, factor: None });
            node.residual = normalise(&mut model.exprs, node.extents.len(), node.residual, &values).ok()?;
        }
        let mut bound: BTreeMap<VarId, FastSet<i64>> = BTreeMap::new();
        for s in members.iter().filter(|s| model.vars[s.var].role == Role::Algebraic) {
            let elements = bound.entry(s.var).or_default();
            for_each_element(&s.node.extents, s.at, &mut |i| {
                elements.insert(i);
            });
        }
        let mut found = Constraints { nodes, parts: FastMap::default(), states: Vec::new(), bound: bound.into_iter().collect() };
        for node in 0..found.nodes.len() {
            found.read_by(model, node)?;
        }
        let rated = |var: &VarId| slopes.pieces.contains_key(var) && wishes.keep.get(var).is_none_or(|&keep| keep < 4);
        let count: i64 = found.nodes.iter().map(Node::count).sum();
        let elements: i64 = found.states.iter().map(|&var| i64::from(model.vars[var].len)).sum();
        (found.states.iter().all(rated) && count + elements <= LARGEST).then_some(found)
    }

    /// Notes the derivatives of a node.
    fn read_by(&mut self, model: &mut Model, number: usize) -> Option<()> {
        let node = self.nodes[number].clone();
        for role in [Role::State, Role::Algebraic] {
            for read in widest(node.reads(model, role)) {
                let is_bound = self.bound.binary_search_by_key(&read.var, |(var, _)| *var).is_ok();
                if role == Role::Algebraic && !is_bound {
                    continue;
                }
                let mut fixed = vec![read.at];
                for d in (node.extents.len()..MAX_DEPTH).filter(|&d| read.at.strides[d] != 0) {
                    let extent = read.loops[d].filter(|&extent| extent <= LONGEST)?;
                    fixed = fixed.iter().flat_map(|at| (0..i64::from(extent)).map(|pass| at.at_pass(d, pass))).collect();
                }
                fixed.sort_unstable();
                fixed.dedup();
                for at in fixed.iter().copied().take(LONGEST as usize + 1) {
                    let slope = by_read(&mut model.exprs, &node, (read.var, read.at), at)?;
                    if model.exprs.as_const(slope) != Some(0.0) {
                        self.parts.entry(read.var).or_default().push(Part { node: number, at, slope });
                    }
                }
                if fixed.len() > LONGEST as usize {
                    return None;
                }
                if role == Role::State && !self.states.contains(&read.var) {
                    self.states.push(read.var);
                }
            }
        }
        Some(())
    }

    /// The states that they read.
    pub(super) fn states(&self) -> &[VarId] {
        &self.states
    }

    /// Sums of the derivatives by the elements of a variable times the multipliers; elements that
    /// nothing reads have the sum zero. `None` where loops would nest too deeply.
    fn sums(&self, model: &mut Model, multipliers: &[VarId], var: VarId, elements: &dyn Fn(i64) -> bool) -> Option<Vec<Sum>> {
        let none = Vec::new();
        let parts = self.parts.get(&var).unwrap_or(&none);
        let mut readers: BTreeMap<i64, Vec<(usize, [i64; MAX_DEPTH])>> = BTreeMap::new();
        (0..i64::from(model.vars[var].len)).filter(|&i| elements(i)).for_each(|i| {
            readers.insert(i, Vec::new());
        });
        for (k, part) in parts.iter().enumerate() {
            for_each_pass(&self.nodes[part.node].extents, part.at, &mut |counters| {
                if let Some(list) = readers.get_mut(&part.at.at(&counters)) {
                    list.push((k, counters));
                }
            });
        }
        // Elements with the same derivatives, each with its place and its passes.
        let mut alike: BTreeMap<Vec<usize>, Vec<Vec<i64>>> = BTreeMap::new();
        for (element, list) in readers {
            let kinds = list.iter().map(|(k, _)| *k).collect();
            let numbers = [element].into_iter().chain(list.iter().flat_map(|(_, counters)| *counters)).collect();
            alike.entry(kinds).or_default().push(numbers);
        }
        let mut sums = Vec::new();
        for (kinds, list) in alike {
            for run in runs(&list) {
                let affine = |k: usize| {
                    let along = run.strides.iter().zip(0..).map(|(stride, d)| Affine::along(0, LoopVar(d), stride[k]));
                    along.fold(Affine::constant(run.first[k]), Affine::plus)
                };
                let mut value = model.exprs.constant(0.0);
                for (n, &kind) in kinds.iter().enumerate() {
                    let part = &parts[kind];
                    let node = &self.nodes[part.node];
                    let indices: Vec<Affine> = (0..node.extents.len()).map(|d| affine(1 + n * MAX_DEPTH + d)).collect();
                    let term = term(&mut model.exprs, (node, part), multipliers[part.node], indices, run.extents.len())?;
                    value = model.exprs.add(value, term);
                }
                sums.push(Sum { at: affine(0), extents: run.extents, value });
            }
        }
        Some(sums)
    }
}

/// Reads by address, those in several sums with the longest one: a derivative counts all of them.
fn widest(reads: Vec<Read>) -> Vec<Read> {
    let mut out: Vec<Read> = Vec::new();
    for read in reads {
        match out.iter_mut().find(|known| (known.var, known.at) == (read.var, read.at)) {
            Some(known) => known.loops.iter_mut().zip(read.loops).for_each(|(known, extent)| *known = (*known).max(extent)),
            None => out.push(read),
        }
    }
    out
}

/// The derivative of a constraint by what one of its loads reads at an address.
fn by_read(exprs: &mut Exprs, node: &Node, (var, read): (VarId, Affine), at: Affine) -> Option<ExprId> {
    let one = |exprs: &mut Exprs, load: Option<(VarId, Flavour, Affine)>| match load {
        Some((v, Flavour::Value, place)) if (v, place) == (var, read) => {
            let (one, zero) = (exprs.constant(1.0), exprs.constant(0.0));
            let (own, other) = (number(exprs, at), number(exprs, read));
            let same = exprs.compare(Compare::Eq, own, other);
            Some(if read == at { one } else { exprs.select(same, one, zero) })
        }
        _ => None,
    };
    total(exprs, node.extents.len(), node.residual, &one).ok()
}

/// A derivative times its multiplier in the passes at `indices`, summed over the loops that the
/// element does not depend on.
fn term(exprs: &mut Exprs, (node, part): (&Node, &Part), multiplier: VarId, mut indices: Vec<Affine>, depth: usize) -> Option<ExprId> {
    let summed: Vec<usize> = (0..node.extents.len()).filter(|&d| part.at.strides[d] == 0 && node.extents[d] > 1).collect();
    if depth + summed.len() > MAX_DEPTH {
        return None;
    }
    for (k, &d) in summed.iter().enumerate() {
        indices[d] = Affine::along(0, LoopVar((depth + k) as u8), 1);
    }
    let own = whole_of(&node.extents, node.count() as usize);
    let at = indices.iter().zip(own.strides).fold(Affine::constant(own.offset), |at, (index, stride)| at.plus(index.times(stride)));
    let slope = if indices.is_empty() { part.slope } else { placed(exprs, part.slope, &indices)? };
    let multiplier = exprs.load(multiplier, Flavour::Value, at);
    let mut value = exprs.mul(slope, multiplier);
    for (k, &d) in summed.iter().enumerate().rev() {
        value = exprs.reduce(ReduceFn::Sum, LoopVar((depth + k) as u8), node.extents[d], value);
    }
    Some(value)
}

/// Calls `f` with the counters of each pass of the loops that an address depends on.
fn for_each_pass(extents: &[u32], at: Affine, f: &mut dyn FnMut([i64; MAX_DEPTH])) {
    fn pass(extents: &[u32], d: usize, at: Affine, counters: &mut [i64; MAX_DEPTH], f: &mut dyn FnMut([i64; MAX_DEPTH])) {
        let Some(&extent) = extents.get(d) else { return f(*counters) };
        for i in 0..if at.strides[d] == 0 { 1 } else { i64::from(extent) } {
            counters[d] = i;
            pass(extents, d + 1, at, counters, f);
        }
        counters[d] = 0;
    }
    pass(extents, 0, at, &mut [0; MAX_DEPTH], f);
}

/// Lists of numbers that grow evenly along loops.
struct Progression {
    first: Vec<i64>,
    extents: Vec<u32>,
    /// Growth of each number along each loop.
    strides: Vec<Vec<i64>>,
}

/// As few runs as neighbours in the list give; loops nest where runs follow each other evenly.
fn runs(list: &[Vec<i64>]) -> Vec<Progression> {
    let mut out: Vec<Progression> =
        list.iter().map(|numbers| Progression { first: numbers.clone(), extents: Vec::new(), strides: Vec::new() }).collect();
    for _ in 0..3 {
        let mut next: Vec<Progression> = Vec::new();
        let mut grows = false;
        // The last of `next` grows while what follows is one stride further.
        for run in out {
            if let Some(last) = next.last_mut() {
                let inner = run.extents.len();
                let open = last.extents.len() > inner && last.extents[1..] == run.extents[..] && last.strides[1..] == run.strides[..];
                if open {
                    let count = i64::from(last.extents[0]);
                    let follows = (0..run.first.len()).all(|k| run.first[k] == last.first[k] + count * last.strides[0][k]);
                    if follows {
                        last.extents[0] += 1;
                        continue;
                    }
                } else if last.extents == run.extents && last.strides == run.strides {
                    let stride = run.first.iter().zip(&last.first).map(|(a, b)| a - b).collect();
                    last.extents.insert(0, 2);
                    last.strides.insert(0, stride);
                    grows = true;
                    continue;
                }
            }
            next.push(run);
        }
        out = next;
        if !grows {
            break;
        }
    }
    out
}

/// Lets states stay on constraints by corrections.
pub(super) fn correct(model: &mut Model, slopes: &mut Slopes, constraints: &Constraints, out: &mut Corrected) -> Option<()> {
    let start = Start::of(model);
    let multipliers: Vec<VarId> = constraints.nodes.iter().map(|node| multiplier(model, node, out)).collect();
    for (k, &var) in multipliers.iter().enumerate() {
        let size = size(model, constraints, k, &start);
        out.helpers.iter_mut().filter(|q| q.var == Some(var)).for_each(|q| q.scale = vec![1.0 / size]);
    }
    let mut corrections: FastMap<VarId, VarId> = FastMap::default();
    for &state in &constraints.states {
        let own = correction(model, state, out);
        corrections.insert(state, own);
        model.interface.reduction.corrections.push(Correction { state, by: own });
        for Sum { extents, at, value } in constraints.sums(model, &multipliers, state, &|_| true)? {
            let exprs_scale = scale(model, state, at);
            let exprs = &mut model.exprs;
            let weight = exprs.constant(exprs_scale * exprs_scale);
            let (moved, by) = (exprs.load(own, Flavour::Value, at), exprs.mul(weight, value));
            let residual = exprs.add(moved, by);
            out.rows.push(Row { extents, var: own, at, residual, span: model.vars[state].span });
        }
    }
    for (var, elements) in &constraints.bound {
        for Sum { extents, at, value } in constraints.sums(model, &multipliers, *var, &|i| elements.contains(&i))? {
            out.rows.push(Row { extents, var: *var, at, residual: value, span: model.vars[*var].span });
        }
    }
    for (node, &own) in constraints.nodes.iter().zip(&multipliers) {
        let along = |exprs: &mut Exprs, load: Option<(VarId, Flavour, Affine)>| match load {
            Some((var, Flavour::Value, at)) => corrections.get(&var).map(|&by| exprs.load(by, Flavour::Value, at)),
            _ => None,
        };
        let change = total(&mut model.exprs, node.extents.len(), node.residual, &along).ok()?;
        let residual = model.exprs.add(node.residual, change);
        let at = whole_of(&node.extents, node.count() as usize);
        out.rows.push(Row { extents: node.extents.clone(), var: own, at, residual, span: node.span });
    }
    move_states(model, slopes, constraints, &corrections);
    Some(())
}

/// Lets rates lead back to the constraints, the end of a step move to them, and makes invariants.
fn move_states(model: &mut Model, slopes: &mut Slopes, constraints: &Constraints, corrections: &FastMap<VarId, VarId>) {
    let step = model.interface.episode.step;
    let back = RETURN / if step > 0.0 && step.is_finite() { step } else { 1.0 };
    let mut nests = Vec::new();
    let set_too = sets(&model.programs.end, |var| corrections.contains_key(&var));
    for &state in &constraints.states {
        let (by, exprs) = (corrections[&state], &mut model.exprs);
        let back = exprs.constant(back);
        for piece in slopes.pieces.get_mut(&state).into_iter().flatten() {
            let correction = exprs.load(by, Flavour::Value, piece.at);
            let part = exprs.mul(back, correction);
            piece.value = exprs.add(piece.value, part);
        }
        let (extents, at) = whole(model.vars[state].len);
        let (x, v) = (exprs.load(state, Flavour::Value, at), exprs.load(by, Flavour::Value, at));
        let value = exprs.add(x, v);
        nests.push(Nest::over(extents, vec![Store { target: Target::var(state, at), value }]));
    }
    model.programs.end.nests.splice(0..0, nests);
    model.programs.end.in_place = true;
    let bound: usize = constraints.bound.iter().map(|(_, elements)| elements.len()).sum();
    let count: i64 = constraints.nodes.iter().map(Node::count).sum();
    model.interface.reduction.conditions += (count as usize - bound) as u32;
    for (k, node) in constraints.nodes.iter().enumerate() {
        let own = constraints.states.iter().flat_map(|var| constraints.parts.get(var).into_iter().flatten().map(move |part| (*var, part)));
        let mut states: Vec<(VarId, Affine)> = own.filter(|(_, part)| part.node == k).map(|(var, part)| (var, part.at)).collect();
        states.sort_unstable();
        states.dedup();
        if !states.is_empty() {
            let states = states.into_iter().map(|(var, at)| (var, at, scale(model, var, at))).collect();
            watch(model, &Group { extents: node.extents.clone(), nodes: vec![node.clone()], states }, set_too, true);
        }
    }
}

/// Size of the derivatives of a constraint in the scale of its states, in the first pass of its
/// loops at the start.
fn size(model: &mut Model, constraints: &Constraints, node: usize, start: &Start) -> f64 {
    let mut square = 0.0;
    for &var in &constraints.states {
        for part in constraints.parts.get(&var).into_iter().flatten().filter(|part| part.node == node) {
            let scale = scale(model, var, part.at);
            square += (start.value(&mut model.exprs, part.slope) * scale).powi(2);
        }
    }
    if square.is_normal() { square.sqrt() } else { 1.0 }
}

/// The multiplier of a constraint.
fn multiplier(model: &mut Model, node: &Node, out: &mut Corrected) -> VarId {
    let len = passes(&node.extents) as u32;
    let number = out.helpers.iter().filter(|q| q.name.starts_with("multiplier(")).count() + 1;
    let name = format!("multiplier({number})");
    let var = model.vars.push(Variable { name: name.clone(), role: Role::Algebraic, len, span: node.span });
    let axes = if len == 1 { Vec::new() } else { vec![Axis::Names((1..=len).map(|i| i.to_string()).collect())] };
    out.helpers.push(Quantity {
        var: Some(var),
        name,
        axes,
        pattern: None,
        unit: "1".to_owned(),
        text: "multiplier of a constraint, an unknown of the reduced system".to_owned(),
        low: vec![f64::NEG_INFINITY],
        high: vec![f64::INFINITY],
        default: vec![0.0],
        scale: vec![1.0],
        affine_unit: false,
        structural: false,
        nonnegative: false,
    });
    var
}

/// The correction of a state.
fn correction(model: &mut Model, state: VarId, out: &mut Corrected) -> VarId {
    let Variable { name, len, span, .. } = model.vars[state].clone();
    let name = format!("correction({name})");
    let var = model.vars.push(Variable { name: name.clone(), role: Role::Algebraic, len, span });
    if let Some(of) = model.interface.quantities.states.iter().find(|q| q.var == Some(state)) {
        let (low, high, default) = (vec![f64::NEG_INFINITY], vec![f64::INFINITY], vec![0.0]);
        let text = "distance from constraints, an unknown of the reduced system".to_owned();
        out.helpers.push(Quantity { var: Some(var), name, text, low, high, default, nonnegative: false, pattern: None, ..of.clone() });
    }
    var
}
