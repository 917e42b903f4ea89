//! The model of a reduced system: rows, roles, names, starts.

use super::super::cuts::advanced;
use super::slopes::{Piece, Slopes, whole};
use super::system::{Node, Pool, Settled, whole_of};
use crate::elaborate::for_each_element;
use crate::ir::{Affine, ExprId, Exprs, FastMap, FastSet, Flavour, LoopVar, Nest, Place, Role, Store, Target, VarId};
use crate::model::{Axis, Demoted, Model, Quantity, Row, Variable};

/// The elements of a variable that stay states while others follow from constraints.
struct RemainingState {
    piece: Piece,
    state: VarId,
    /// The elements of the variable, in the order of the new state.
    elements: Vec<i64>,
}

/// Writes the model of a reduced system; the quantities of unknowns that no declaration names.
pub(super) fn finish(model: &mut Model, top: Vec<Settled>, settled: Vec<Settled>, slopes: &Slopes) -> (Vec<Row>, Vec<Quantity>) {
    let order = elements_in_order(model);
    let fixed = fixed_elements(model);
    let mut demoted = Pool::default();
    for s in settled.iter().filter(|s| model.vars[s.var].role == Role::State) {
        for_each_element(&s.node.extents, s.at, &mut |i| demoted.set(model, s.var, i, true));
    }
    let mut rows = Vec::new();
    for s in top.into_iter().chain(settled) {
        rows.push(Row { extents: s.node.extents, var: s.var, at: s.at, residual: s.node.residual, span: s.node.span });
    }
    let mut moved: FastMap<(VarId, i64), (VarId, i64)> = FastMap::default();
    let mut helpers = Vec::new();
    let mut states: Vec<VarId> = slopes.pieces.keys().copied().collect();
    states.sort_unstable();
    for var in states {
        let list = slopes.pieces[&var].clone();
        let gone: Vec<bool> = demoted.0.get(&var).cloned().unwrap_or_default();
        if gone.iter().all(|gone| !gone) {
            rows.extend(list.into_iter().map(|piece| rate_row(&mut model.exprs, var, piece)));
            continue;
        }
        let parts = kept_parts(model, var, list, &gone);
        record(model, var, &gone, &parts);
        for part in &parts {
            let elements = part.elements.iter().zip(0..).map(|(&i, k)| ((var, i), (part.state, k)));
            moved.extend(elements);
        }
        helpers.extend(make_algebraic(model, var, &gone, &parts));
        for part in parts {
            let RemainingState { piece, state, elements } = part;
            let own = whole_of(&piece.extents, elements.len());
            let (x, w) = (model.exprs.load(var, Flavour::Value, piece.at), model.exprs.load(state, Flavour::Value, own));
            let residual = model.exprs.sub(w, x);
            rows.push(Row { extents: piece.extents.clone(), var, at: piece.at, residual, span: piece.span });
            rows.push(rate_row(&mut model.exprs, state, Piece { at: own, ..piece }));
        }
    }
    put_in_order(model, &order, &moved);
    put_fixed(model, &fixed, &moved);
    helpers.extend(slopes.of.values().filter_map(|&rate| slopes.quantity(model, rate)));
    (rows, helpers)
}

fn rate_row(exprs: &mut Exprs, var: VarId, piece: Piece) -> Row {
    let own = exprs.load(var, Flavour::Derivative, piece.at);
    let residual = exprs.sub(piece.value, own);
    Row { extents: piece.extents, var, at: piece.at, residual, span: piece.span }
}

/// The parts of a variable that stay states, each with a new variable.
fn kept_parts(model: &mut Model, var: VarId, list: Vec<Piece>, gone: &[bool]) -> Vec<RemainingState> {
    let mut parts = Vec::new();
    for piece in list {
        for piece in kept(&mut model.exprs, piece, gone) {
            let mut elements = Vec::new();
            for_each_element(&piece.extents, piece.at, &mut |i| elements.push(i));
            let Variable { name, span, .. } = model.vars[var].clone();
            let new = Variable { name: format!("free({name})"), role: Role::State, len: elements.len() as u32, span };
            let state = model.vars.push(new);
            parts.push(RemainingState { piece, state, elements });
        }
    }
    parts
}

/// The passes of a piece whose elements stay states, as few pieces as that takes.
fn kept(exprs: &mut Exprs, piece: Piece, gone: &[bool]) -> Vec<Piece> {
    let mut stays = Vec::new();
    for_each_element(&piece.extents, piece.at, &mut |i| stays.push(!gone.get(i as usize).copied().unwrap_or(false)));
    if stays.iter().all(|stays| *stays) {
        return vec![piece];
    }
    if stays.iter().all(|stays| !stays) || piece.extents.is_empty() {
        return Vec::new();
    }
    if piece.extents.len() > 1 {
        // One pass of the outer loop after another.
        return (0..i64::from(piece.extents[0])).flat_map(|pass| kept_inner(exprs, &piece, pass, gone)).collect();
    }
    let mut out = Vec::new();
    let mut first = 0;
    for run in stays.chunk_by(|a, b| a == b) {
        if run[0] {
            let value = advanced(exprs, piece.value, LoopVar(0), first);
            let (extents, at) = (vec![run.len() as u32], piece.at.advanced(0, first));
            out.push(single(exprs, Piece { extents, at, value, span: piece.span }));
        }
        first += run.len() as i64;
    }
    out
}

/// One pass of the outer loop of a piece.
fn kept_inner(exprs: &mut Exprs, piece: &Piece, pass: i64, gone: &[bool]) -> Vec<Piece> {
    let mut extents = piece.extents.clone();
    extents[0] = 1;
    let value = advanced(exprs, piece.value, LoopVar(0), pass);
    let one = Piece { extents, at: piece.at.advanced(0, pass), value, span: piece.span };
    let mut stays = Vec::new();
    for_each_element(&one.extents, one.at, &mut |i| stays.push(!gone.get(i as usize).copied().unwrap_or(false)));
    match (stays.iter().all(|s| *s), stays.iter().any(|s| *s)) {
        (true, _) => vec![one],
        (_, false) => Vec::new(),
        // Every element by itself.
        _ => passes(exprs, one).into_iter().zip(stays).filter_map(|(piece, stays)| stays.then_some(piece)).collect(),
    }
}

fn passes(exprs: &mut Exprs, piece: Piece) -> Vec<Piece> {
    let Some(d) = piece.extents.len().checked_sub(1) else { return vec![piece] };
    let outer: Vec<u32> = piece.extents[..d].to_vec();
    let mut by_pass: Vec<Vec<Piece>> = Vec::new();
    for pass in 0..i64::from(piece.extents[d]) {
        let value = exprs.shift(piece.value, LoopVar(d as u8), pass);
        by_pass.push(passes(exprs, Piece { extents: outer.clone(), at: piece.at.at_pass(d, pass), value, span: piece.span }));
    }
    let count = by_pass.first().map_or(0, Vec::len);
    (0..count).flat_map(|i| by_pass.iter().map(move |list| list[i].clone()).collect::<Vec<_>>()).collect()
}

/// A loop of one pass as no loop.
fn single(exprs: &mut Exprs, piece: Piece) -> Piece {
    if piece.extents != [1] {
        return piece;
    }
    let value = exprs.shift(piece.value, LoopVar(0), 0);
    Piece { extents: Vec::new(), at: piece.at.at_pass(0, 0), value, span: piece.span }
}

/// The elements of states as the outside counts them.
fn elements_in_order(model: &Model) -> Vec<(VarId, i64)> {
    let q = &model.interface.quantities;
    let all = q.states.iter().flat_map(|q| q.var.into_iter().flat_map(|var| (0..q.len() as i64).map(move |i| (var, i))));
    let all: Vec<(VarId, i64)> = all.collect();
    match &q.state_order {
        None => all,
        Some(order) => order.iter().filter_map(|&at| all.get(at as usize).copied()).collect(),
    }
}

/// The elements of states in the order of `y`.
fn elements_inside(model: &Model) -> Vec<(VarId, i64)> {
    let states = model.unknowns.iter().filter(|var| model.vars[**var].role == Role::State);
    states.flat_map(|&var| (0..i64::from(model.vars[var].len)).map(move |i| (var, i))).collect()
}

fn fixed_elements(model: &Model) -> Vec<(VarId, i64)> {
    let inside = elements_inside(model);
    let fixed = model.interface.steady.iter().flat_map(|steady| &steady.fixed);
    fixed.filter_map(|&at| inside.get(at as usize).copied()).collect()
}

/// Positions of states outside and inside, after some are gone and others have moved.
fn put_in_order(model: &mut Model, before: &[(VarId, i64)], moved: &FastMap<(VarId, i64), (VarId, i64)>) {
    let inside: FastMap<(VarId, i64), u32> = elements_inside(model).into_iter().zip(0..).collect();
    let order: Vec<u32> = before.iter().filter_map(|e| inside.get(moved.get(e).unwrap_or(e)).copied()).collect();
    let is_identity = order.iter().copied().eq(0..order.len() as u32);
    model.interface.quantities.state_order = (!is_identity).then_some(order);
}

fn put_fixed(model: &mut Model, fixed: &[(VarId, i64)], moved: &FastMap<(VarId, i64), (VarId, i64)>) {
    let inside: FastMap<(VarId, i64), u32> = elements_inside(model).into_iter().zip(0..).collect();
    if let Some(steady) = &mut model.interface.steady {
        steady.fixed = fixed.iter().filter_map(|e| inside.get(moved.get(e).unwrap_or(e)).copied()).collect();
    }
}

/// Records the elements that follow from constraints.
fn record(model: &mut Model, var: VarId, gone: &[bool], parts: &[RemainingState]) {
    let Some(quantity) = model.interface.quantities.states.iter().find(|q| q.var == Some(var)).cloned() else { return };
    let names = gone.iter().enumerate().filter(|(_, gone)| **gone).map(|(i, _)| quantity.element_name(i));
    let demoted = Demoted { name: quantity.name.clone(), elements: names.collect(), whole: parts.is_empty() };
    model.interface.reduction.demoted.push(demoted);
}

/// Makes a variable algebraic, but for the parts that stay states; the quantity that its unknowns
/// have where its declaration is of some of them only.
fn make_algebraic(model: &mut Model, var: VarId, gone: &[bool], parts: &[RemainingState]) -> Option<Quantity> {
    model.vars[var].role = Role::Algebraic;
    let at = model.unknowns.iter().position(|other| *other == var)?;
    model.unknowns.splice(at..=at, parts.iter().map(|part| part.state));
    let q = &mut model.interface.quantities;
    let at = q.states.iter().position(|q| q.var == Some(var))?;
    let whole_quantity = q.states[at].clone();
    let states = parts.iter().map(|part| some(&whole_quantity, &part.elements, Some(part.state)));
    q.states.splice(at..=at, states.collect::<Vec<_>>());
    let elements: Vec<i64> = (0..).zip(gone).filter(|(_, gone)| **gone).map(|(i, _)| i).collect();
    let first: usize = q.algebraics.iter().map(Quantity::len).sum();
    let quantity =
        Quantity { nonnegative: false, ..if parts.is_empty() { whole_quantity.clone() } else { some(&whole_quantity, &elements, None) } };
    q.algebraics.push(quantity);
    outputs(model, var, first, &elements);
    for part in parts {
        start_of(model, var, part);
    }
    (!parts.is_empty()).then(|| inner_names(whole_quantity, gone))
}

/// A quantity of some elements of another one.
fn some(of: &Quantity, elements: &[i64], var: Option<VarId>) -> Quantity {
    let pick = |list: &[f64]| match list {
        [_] | [] => list.to_vec(),
        many => elements.iter().map(|&i| Quantity::pick(many, i as usize)).collect(),
    };
    let axes = vec![Axis::Names(elements.iter().map(|&i| of.label(i as usize)).collect())];
    let (low, high, default, scale) = (pick(&of.low), pick(&of.high), pick(&of.default), pick(&of.scale));
    Quantity { var, axes, low, high, default, scale, ..of.clone() }
}

/// Names of all elements, those of states marked: no two unknowns have one name.
fn inner_names(of: Quantity, gone: &[bool]) -> Quantity {
    let label = |(i, gone): (usize, &bool)| if *gone { of.label(i) } else { format!("{}; a state", of.label(i)) };
    let axes = vec![Axis::Names(gone.iter().enumerate().map(label).collect())];
    Quantity { axes, nonnegative: false, ..of }
}

/// Shows elements of a variable among the algebraic outputs.
fn outputs(model: &mut Model, var: VarId, first: usize, elements: &[i64]) {
    let whole_len = model.vars[var].len as usize;
    let mut nests = Vec::new();
    let mut nest = |exprs: &mut Exprs, extents: Vec<u32>, target: Affine, source: Affine| {
        let value = exprs.load(var, Flavour::Value, source);
        nests.push(Nest::over(extents, vec![Store { target: Target { place: Place::Out, at: target }, value }]));
    };
    let first = first as i64;
    if elements.len() == whole_len {
        let (extents, at) = whole(whole_len as u32);
        nest(&mut model.exprs, extents, Affine::constant(first).plus(at), at);
    } else {
        // Neighbours by one loop.
        let mut done = 0;
        while done < elements.len() {
            let run = (done..elements.len()).take_while(|&k| elements[k] - elements[done] == (k - done) as i64).count();
            let (extents, at) = whole(run as u32);
            let (target, source) = (Affine::constant(first + done as i64).plus(at), Affine::constant(elements[done]).plus(at));
            nest(&mut model.exprs, extents, target, source);
            done += run;
        }
    }
    model.programs.outputs.nests.extend(nests);
}

/// Lets a part start where the variable does.
fn start_of(model: &mut Model, var: VarId, part: &RemainingState) {
    let own = whole_of(&part.piece.extents, part.elements.len());
    let value: ExprId = model.exprs.load(var, Flavour::Value, part.piece.at);
    let target = Target { place: Place::Var(part.state), at: own };
    model.programs.initial_states.nests.push(Nest::over(part.piece.extents.clone(), vec![Store { target, value }]));
}

/// The variables that programs set at instants.
pub(super) fn set_at_instants(model: &Model) -> FastSet<VarId> {
    let p = &model.programs;
    let programs = [&p.start, &p.end, &p.finish, &p.disturb].into_iter().chain(&p.events);
    let stores = programs.flat_map(|p| &p.nests).flat_map(|nest| &nest.stores);
    stores.filter_map(|store| if let Place::Var(var) = store.target.place { Some(var) } else { None }).collect()
}

/// A node with its elements.
pub(super) fn settled(nodes: &[Node], node: usize, (var, at): (VarId, Affine)) -> Settled {
    Settled { node: nodes[node].clone(), var, at, varies: false }
}
