//! Guards: a constraint determines the variable that follows from it only where its derivative by
//! that variable is not zero. Where it could become zero, the episode ends with a failure that
//! names the constraint; otherwise the integration would take a wrong branch, or fail.

use super::super::common::{add_failure, element_name};
use super::system::{Node, Settled, by_element, scale};
use crate::ir::{Affine, BinaryFn, ExprId, Exprs, FastSet, Flavour, LoopVar, ReduceFn, Role, UnaryFn, VarId};
use crate::model::{Guard, Model, Root, RootAction};

/// Size of a derivative, relative to those by all states of its constraint, that counts as zero.
pub(crate) const LEAST: f64 = 1e-6;

/// Most constraints that are solved together.
const MOST: usize = 4;

/// Watches constraints of which something follows that could cease to.
pub(super) fn watch(model: &mut Model, settled: &[Settled]) {
    let next: Vec<Vec<usize>> = settled.iter().map(|s| owners(model, settled, s)).collect();
    let mut known = FastSet::default();
    for part in crate::graph::connected(&next) {
        let block: Vec<&Settled> = part.iter().map(|&i| &settled[i]).collect();
        let alone = block.len() == 1 && is_alone(model, block[0]);
        let scalars = block.len() <= MOST && block.iter().all(|s| s.node.extents.is_empty());
        // The derivative of a constraint by a rate is that of the constraint by the state.
        if block.iter().any(|s| s.varies) && (alone || scalars) && known.insert(pivots(model, &block)) {
            watch_block(model, &block);
        }
    }
}

/// The derivatives of the constraints of a block by the variables that follow from them.
fn pivots(model: &mut Model, block: &[&Settled]) -> Vec<Option<ExprId>> {
    let each = block.iter().flat_map(|s| block.iter().map(move |other| (&s.node, other.var, other.at)));
    each.map(|(node, var, at)| by_element(&mut model.exprs, node.extents.len(), node.residual, (var, at))).collect()
}

/// The constraints whose variables a constraint reads.
fn owners(model: &Model, settled: &[Settled], s: &Settled) -> Vec<usize> {
    let reads: Vec<_> = [Role::State, Role::Algebraic].into_iter().flat_map(|role| s.node.reads(model, role)).collect();
    let is_read = |other: &Settled| {
        reads.iter().any(|read| read.var == other.var && (!other.node.extents.is_empty() || !read.at.is_constant() || read.at == other.at))
    };
    (0..settled.len()).filter(|&i| is_read(&settled[i])).collect()
}

/// Returns `true` if each pass reads no other element of the variable than its own.
fn is_alone(model: &Model, s: &Settled) -> bool {
    let role = model.vars[s.var].role;
    s.node.reads(model, role).iter().all(|read| read.var != s.var || read.at == s.at)
}

/// Adds the root function of a block, its failure and its record.
fn watch_block(model: &mut Model, block: &[&Settled]) {
    let extents = &block[0].node.extents;
    let mut matrix: Vec<Vec<ExprId>> = Vec::new();
    let mut size = model.exprs.constant(1.0);
    for s in block {
        let mut square = model.exprs.constant(0.0);
        let roles = [Role::State, Role::Algebraic];
        let read: Vec<_> = roles.into_iter().flat_map(|role| s.node.candidates(model, role)).collect();
        for (var, at) in read {
            let slope = scaled(model, &s.node, (var, at), scale(model, var, at));
            let part = model.exprs.mul(slope, slope);
            square = model.exprs.add(square, part);
        }
        let norm = model.exprs.unary(UnaryFn::Sqrt, square);
        size = model.exprs.mul(size, norm);
        let entry = |other: &&Settled| {
            let scale = scale(model, other.var, other.at);
            scaled(model, &s.node, (other.var, other.at), scale)
        };
        matrix.push(block.iter().map(entry).collect());
    }
    let exprs = &mut model.exprs;
    let determinant = determinant(exprs, &matrix);
    let tiny = exprs.constant(f64::MIN_POSITIVE);
    let (size, absolute) = (exprs.binary(BinaryFn::Max, size, tiny), exprs.unary(UnaryFn::Abs, determinant));
    let mut share = exprs.div(absolute, size);
    for (d, &n) in extents.iter().enumerate().rev() {
        share = exprs.reduce(ReduceFn::Min, LoopVar(d as u8), n, share);
    }
    let least = exprs.constant(LEAST);
    let value = exprs.sub(least, share);
    let name = |s: &&Settled| match s.node.extents.len() {
        0 => element_name(model, s.var, s.at.offset),
        _ => model.vars[s.var].name.clone(),
    };
    let names: Vec<String> = block.iter().map(name).collect();
    let failure = add_failure(model, format!("{}_undetermined", names[0].split('[').next().unwrap_or_default()));
    let name = model.interface.finish.failures[failure as usize].name.clone();
    model.roots.push(Root { name, value, strict: true, action: RootAction::Fail(failure) });
    let spans = block.iter().map(|s| s.node.span).collect();
    model.interface.reduction.guards.push(Guard { failure, names, spans });
}

/// The derivative of a constraint by a variable, times the larger of its scale and its size.
fn scaled(model: &mut Model, node: &Node, (var, at): (VarId, Affine), scale: f64) -> ExprId {
    let exprs = &mut model.exprs;
    let slope = by_element(exprs, node.extents.len(), node.residual, (var, at)).unwrap_or_else(|| exprs.constant(0.0));
    if exprs.as_const(slope) == Some(0.0) {
        return slope;
    }
    let (x, scale) = (exprs.load(var, Flavour::Value, at), exprs.constant(scale));
    let size = exprs.unary(UnaryFn::Abs, x);
    let size = exprs.binary(BinaryFn::Max, size, scale);
    exprs.mul(slope, size)
}

/// The determinant of a small matrix, without divisions.
fn determinant(exprs: &mut Exprs, matrix: &[Vec<ExprId>]) -> ExprId {
    let Some((first, rest)) = matrix.split_first() else { return exprs.constant(1.0) };
    let mut sum = exprs.constant(0.0);
    for (k, &entry) in first.iter().enumerate() {
        if exprs.as_const(entry) == Some(0.0) {
            continue;
        }
        let without = |row: &Vec<ExprId>| row.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, e)| *e).collect();
        let minor: Vec<Vec<ExprId>> = rest.iter().map(without).collect();
        let minor = determinant(exprs, &minor);
        let part = exprs.mul(entry, minor);
        sum = if k % 2 == 0 { exprs.add(sum, part) } else { exprs.sub(sum, part) };
    }
    sum
}
