//! Constraints none of whose states follows from it at all times: a pendulum's `x^2 + y^2 = l^2`.
//!
//! All states stay states. Off the constraints h(x) = 0 their rates lead back to them:
//! x' = f - κ W Hᵀ (H W Hᵀ)⁻¹ h with H = ∂h/∂x. At the end of each step the states are projected in
//! the same direction. No choice of coordinates is made that could become bad.

use super::slopes::Slopes;
use super::system::{Node, Wishes, by_element};
use crate::elaborate::for_each_element;
use crate::ir::{Affine, BinaryFn, ExprId, Exprs, FastSet, Flavour, Nest, Place, Program, Store, Target, UnaryFn, VarId};
use crate::model::{Invariant, Model, Projected};

/// Newton steps of a projection.
const PASSES: usize = 3;

/// By how much, over a step, the states come back to their constraints.
const RETURN: f64 = 2.0;

/// Most constraints that are projected together.
pub(super) const MOST: usize = 6;

/// Constraints with the states that they bind.
pub(super) struct Group {
    pub(super) nodes: Vec<Node>,
    /// The states and their magnitudes.
    pub(super) states: Vec<(VarId, i64, f64)>,
}

impl Group {
    /// Returns `true` if all of its states have explicit rates and none is preferred.
    pub(super) fn may_be_projected(&self, slopes: &Slopes, wishes: &Wishes) -> bool {
        let own = |&(var, element, _): &(VarId, i64, f64)| {
            let pieces = slopes.pieces.get(&var).into_iter().flatten();
            let mut pieces = pieces.filter(|piece| piece.extents.is_empty());
            pieces.any(|piece| piece.at == Affine::constant(element)) && wishes.keep.get(&var).is_none_or(|&keep| keep < 4)
        };
        self.nodes.len() <= MOST && self.states.iter().all(own)
    }
}

/// Lets the states of a group stay on their constraints.
pub(super) fn project(model: &mut Model, slopes: &mut Slopes, group: &Group) {
    let step = model.interface.episode.step;
    let back = RETURN / if step > 0.0 && step.is_finite() { step } else { 1.0 };
    let changes = changes(&mut model.exprs, group);
    for (&(var, element, _), change) in group.states.iter().zip(&changes) {
        let pieces = slopes.pieces.entry(var).or_default();
        for piece in pieces.iter_mut().filter(|piece| piece.extents.is_empty() && piece.at == Affine::constant(element)) {
            let back = model.exprs.constant(back);
            let part = model.exprs.mul(back, *change);
            piece.value = model.exprs.add(piece.value, part);
        }
    }
    let stores = group.states.iter().zip(&changes).map(|(&(var, element, _), &change)| {
        let at = Affine::constant(element);
        let x = model.exprs.load(var, Flavour::Value, at);
        Store { target: Target { place: Place::Var(var), at }, value: model.exprs.add(x, change) }
    });
    let nest = Nest { loops: Vec::new(), stores: stores.collect() };
    let passes = || std::iter::repeat_n(nest.clone(), PASSES);
    let set: FastSet<VarId> = group.states.iter().map(|state| state.0).collect();
    let programs = &mut model.programs;
    programs.end.nests.splice(0..0, passes());
    let sets = |program: &Program| {
        let mut places = program.nests.iter().flat_map(|nest| &nest.stores).map(|store| store.target.place);
        places.any(|place| matches!(place, Place::Var(var) if set.contains(&var)))
    };
    for program in [&mut programs.start].into_iter().chain(&mut programs.events) {
        if sets(program) {
            program.nests.extend(passes());
        }
    }
    programs.end.in_place = true;
    watch(model, group);
}

/// The Newton step of each state to the constraints, the shortest one in the scale of the states.
fn changes(exprs: &mut Exprs, group: &Group) -> Vec<ExprId> {
    let count = group.nodes.len();
    let slopes = slopes_of(exprs, group);
    let mut matrix = vec![vec![exprs.constant(0.0); count]; count];
    for (i, row) in matrix.iter_mut().enumerate() {
        for (k, entry) in row.iter_mut().enumerate() {
            for (&a, &b) in slopes[i].iter().zip(&slopes[k]) {
                let part = exprs.mul(a, b);
                *entry = exprs.add(*entry, part);
            }
        }
    }
    let mut off: Vec<ExprId> = group.nodes.iter().map(|node| node.residual).collect();
    solve(exprs, &mut matrix, &mut off);
    let mut out = Vec::with_capacity(group.states.len());
    for (j, &(_, _, scale)) in group.states.iter().enumerate() {
        let mut sum = exprs.constant(0.0);
        for (row, &multiplier) in slopes.iter().zip(&off) {
            let part = exprs.mul(row[j], multiplier);
            sum = exprs.add(sum, part);
        }
        let scale = exprs.constant(-scale);
        out.push(exprs.mul(scale, sum));
    }
    out
}

/// The derivatives of the constraints by the states, in the scale of these.
fn slopes_of(exprs: &mut Exprs, group: &Group) -> Vec<Vec<ExprId>> {
    let mut slope = |node: &Node, &(var, element, scale): &(VarId, i64, f64)| {
        let slope = by_element(exprs, 0, node.residual, (var, Affine::constant(element)));
        let slope = slope.unwrap_or_else(|| exprs.constant(0.0));
        let scale = exprs.constant(scale);
        exprs.mul(slope, scale)
    };
    group.nodes.iter().map(|node| group.states.iter().map(|state| slope(node, state)).collect()).collect()
}

/// Solves a positive definite system in place.
#[allow(clippy::needless_range_loop, reason = "two rows of one matrix")]
fn solve(exprs: &mut Exprs, matrix: &mut [Vec<ExprId>], off: &mut [ExprId]) {
    let count = off.len();
    let eliminate = |exprs: &mut Exprs, x: ExprId, factor: ExprId, y: ExprId| {
        let part = exprs.mul(factor, y);
        exprs.sub(x, part)
    };
    for k in 0..count {
        for i in k + 1..count {
            let factor = exprs.div(matrix[i][k], matrix[k][k]);
            for j in k + 1..count {
                matrix[i][j] = eliminate(exprs, matrix[i][j], factor, matrix[k][j]);
            }
            off[i] = eliminate(exprs, off[i], factor, off[k]);
        }
    }
    for k in (0..count).rev() {
        for j in k + 1..count {
            off[k] = eliminate(exprs, off[k], matrix[k][j], off[j]);
        }
        off[k] = exprs.div(off[k], matrix[k][k]);
    }
}

/// Makes invariants of the constraints: the distance from each of them in the scale of the states,
/// which starts are tested by.
fn watch(model: &mut Model, group: &Group) {
    let slopes = slopes_of(&mut model.exprs, group);
    for (node, slopes) in group.nodes.iter().zip(slopes) {
        let exprs = &mut model.exprs;
        let mut square = exprs.constant(0.0);
        for slope in slopes {
            let part = exprs.mul(slope, slope);
            square = exprs.add(square, part);
        }
        let size = exprs.unary(UnaryFn::Sqrt, square);
        let tiny = exprs.constant(f64::MIN_POSITIVE);
        let size = exprs.binary(BinaryFn::Max, size, tiny);
        let value = exprs.div(node.residual, size);
        let zero = exprs.constant(0.0);
        let list = &mut model.interface.invariants;
        let first = 2 * list.len() as i64;
        let name = format!("constraint_{}", model.interface.reduction.projected.len() + 1);
        let text = "distance from a constraint in the scale of its states".to_owned();
        let invariant = list.len() as u32;
        list.push(Invariant { name, text });
        let store = |at: i64, value: ExprId| Store { target: Target { place: Place::Out, at: Affine::constant(at) }, value };
        let stores = vec![store(first, value), store(first + 1, zero)];
        model.programs.invariants.nests.push(Nest { loops: Vec::new(), stores });
        let states = group.states.iter().map(|&(var, element, _)| super::super::common::element_name(model, var, element)).collect();
        model.interface.reduction.projected.push(Projected { span: node.span, order: node.order, states, invariant });
    }
}

/// The states that nodes read, each once.
pub(super) fn states_of(model: &Model, nodes: &[Node]) -> Vec<(VarId, i64)> {
    let mut out = Vec::new();
    for node in nodes {
        for (var, at) in node.candidates(model, crate::ir::Role::State) {
            for_each_element(&node.extents, at, &mut |i| out.push((var, i)));
        }
    }
    out.sort_unstable();
    out.dedup();
    out
}
