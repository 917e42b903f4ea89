//! Constraints none of whose states follows from it at all times: a pendulum's `x^2 + y^2 = l^2`.
//!
//! All states stay states. Off the constraints h(x) = 0 their rates lead back to them:
//! x' = f - κ W Hᵀ (H W Hᵀ)⁻¹ h with H = ∂h/∂x. At the end of each step the states are projected in
//! the same direction. No choice of coordinates is made that could become bad.
//! Loops of constraints are projected pass by pass, in one loop, where no two passes share a state.

use super::super::common::{element_name, passes, sets};
use super::slopes::{Piece, Slopes};
use super::system::{Node, Wishes, by_element, scale, whole_of};
use crate::elaborate::for_each_element;
use crate::ir::{Affine, BinaryFn, ExprId, Exprs, FastSet, Flavour, Nest, Program, Role, Store, Target, UnaryFn, VarId};
use crate::model::{Invariant, Model, Projected};

/// Newton steps of a projection.
const PASSES: usize = 3;

/// By how much, over a step, the states come back to their constraints.
pub(super) const RETURN: f64 = 2.0;

/// Most constraints that are projected together.
pub(super) const MOST: usize = 6;

/// A state of a group, in each pass of its loops, with its magnitude.
pub(super) type Bound = (VarId, Affine, f64);

/// Constraints with the states that they bind, in the same loops.
pub(super) struct Group {
    pub(super) extents: Vec<u32>,
    pub(super) nodes: Vec<Node>,
    pub(super) states: Vec<Bound>,
}

impl Group {
    /// The group of some constraints; `None` if their loops differ or share a state between two
    /// passes.
    pub(super) fn of(model: &Model, nodes: Vec<Node>) -> Option<Group> {
        let extents = nodes.first()?.extents.clone();
        if nodes.iter().any(|node| node.extents != extents) {
            return None;
        }
        let mut bound: Vec<(VarId, Affine)> = nodes.iter().flat_map(|node| node.candidates(model, Role::State)).collect();
        bound.sort_unstable();
        bound.dedup();
        let mut own = FastSet::default();
        for &(var, at) in &bound {
            for_each_element(&extents, at, &mut |i| {
                own.insert((var, i));
            });
        }
        let read: FastSet<(VarId, i64)> = states_of(model, &nodes).into_iter().collect();
        let is_apart = own.len() as i64 == passes(&extents) * bound.len() as i64 && own == read;
        let states = bound.into_iter().map(|(var, at)| (var, at, scale(model, var, at))).collect();
        is_apart.then_some(Group { extents, nodes, states })
    }

    /// The equation of the rate of a state, if it has the loops of the group.
    fn rate<'p>(&self, list: &'p mut [Piece], at: Affine) -> Option<&'p mut Piece> {
        list.iter_mut().find(|piece| piece.at == at && piece.extents == self.extents)
    }

    /// Returns `true` if all of its states have explicit rates and none is preferred.
    pub(super) fn may_be_projected(&self, slopes: &Slopes, wishes: &Wishes) -> bool {
        let own = |&(var, at, _): &Bound| {
            let rated = slopes.pieces.get(&var).is_some_and(|list| self.rate(&mut list.clone(), at).is_some());
            rated && wishes.keep.get(&var).is_none_or(|&keep| keep < 4)
        };
        self.nodes.len() <= MOST && self.states.iter().all(own)
    }
}

/// Lets the states of a group stay on their constraints.
pub(super) fn project(model: &mut Model, slopes: &mut Slopes, group: &Group) {
    let step = model.interface.episode.step;
    let back = RETURN / if step > 0.0 && step.is_finite() { step } else { 1.0 };
    let changes = changes(&mut model.exprs, group);
    for (&(var, at, _), change) in group.states.iter().zip(&changes) {
        if let Some(piece) = group.rate(slopes.pieces.entry(var).or_default(), at) {
            let back = model.exprs.constant(back);
            let part = model.exprs.mul(back, *change);
            piece.value = model.exprs.add(piece.value, part);
        }
    }
    let stores = group.states.iter().zip(&changes).map(|(&(var, at, _), &change)| {
        let x = model.exprs.load(var, Flavour::Value, at);
        Store { target: Target::var(var, at), value: model.exprs.add(x, change) }
    });
    let nest = Nest::over(group.extents.clone(), stores.collect());
    let newton = || std::iter::repeat_n(nest.clone(), PASSES);
    let set: FastSet<VarId> = group.states.iter().map(|state| state.0).collect();
    let programs = &mut model.programs;
    let sets = |program: &Program| sets(program, |var| set.contains(&var));
    let set_too = sets(&programs.end);
    programs.end.nests.splice(0..0, newton());
    for program in [&mut programs.start].into_iter().chain(&mut programs.events) {
        if sets(program) {
            program.nests.extend(newton());
        }
    }
    programs.end.in_place = true;
    model.interface.reduction.conditions += (group.nodes.len() as i64 * passes(&group.extents)) as u32;
    watch(model, group, set_too, false);
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
    let mut slope = |node: &Node, &(var, at, scale): &Bound| {
        let slope = by_element(exprs, node.extents.len(), node.residual, (var, at));
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
pub(super) fn watch(model: &mut Model, group: &Group, set: bool, corrected: bool) {
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
        let (first, count) = (model.interface.invariants.len() as u32, passes(&group.extents));
        let name = format!("constraint_{}", model.interface.reduction.projected.len() + 1);
        let text = "distance from a constraint in the scale of its states";
        let invariant = |name: String| Invariant { name, text: text.to_owned() };
        let indexed = (1..=count).map(|i| invariant(if group.extents.is_empty() { name.clone() } else { format!("{name}[{i}]") }));
        model.interface.invariants.extend(indexed);
        let at = whole_of(&group.extents, count as usize).plus(Affine::constant(i64::from(first))).times(2);
        let stores = [(0, value), (1, zero)].map(|(k, value)| Store { target: Target::out(at.plus(Affine::constant(k))), value });
        model.programs.invariants.nests.push(Nest::over(group.extents.clone(), stores.to_vec()));
        let mut states = Vec::new();
        for &(var, at, _) in &group.states {
            for_each_element(&group.extents, at, &mut |i| states.push(element_name(model, var, i)));
        }
        let (span, order) = (node.span, node.order);
        model.interface.reduction.projected.push(Projected { span, order, states, invariant: first, count: count as u32, set, corrected });
    }
}

/// The states that nodes read, each once.
pub(super) fn states_of(model: &Model, nodes: &[Node]) -> Vec<(VarId, i64)> {
    let mut out = Vec::new();
    for read in nodes.iter().flat_map(|node| node.reads(model, Role::State)) {
        read.each(&mut |i| out.push((read.var, i)));
    }
    out.sort_unstable();
    out.dedup();
    out
}
