//! Loops that go across the parts of an array are cut where a part ends.
//!
//! `eq w[i] = a for i in 1..100` and `eq w[i] = b for i in 101..200` define `w` in two parts; what
//! reads `w[i]` for i in 1..200 is one loop for each of them.

use super::common::replace_everywhere;
use super::reads::looped_reads;
use super::whole::{Whole, wholes};
use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, LoopVar, Rewritten, VarId};
use crate::model::Model;

/// Rounds of cutting: each may cut definitions into parts that others go across. What is left is
/// unrolled or stays unknown.
const ROUNDS: usize = 16;

/// Cuts loops of equations and of sums.
pub(crate) fn cut_at_parts(model: &mut Model, equations: &mut Vec<Equation>) {
    for _ in 0..ROUNDS {
        let wholes = wholes(model, equations);
        if !wholes.values().any(Whole::is_in_parts) {
            return;
        }
        let crosses = |read: &super::reads::Read| wholes.get(&read.var).is_some_and(|whole| !whole.holds(read.at, &read.loops));
        if !looped_reads(model, equations).iter().any(crosses) {
            return;
        }
        let cuts = |exprs: &Exprs, value: ExprId, depth: usize, extent: u32| cuts(exprs, &wholes, value, depth, extent);
        for equation in std::mem::take(equations) {
            let found = (0..equation.extents.len())
                .map(|d| (d, cuts(&model.exprs, equation.form.value(), d, equation.extents[d])))
                .find(|(_, at)| !at.is_empty());
            match found {
                Some((depth, at)) => split(&mut model.exprs, &equation, depth, &at, equations),
                None => equations.push(equation),
            }
        }
        replace_everywhere(model, equations, &mut Rewritten::default(), &|_, _| true, &mut |exprs, node| {
            let Expr::Reduce { op, depth, extent, body } = node else { return None };
            let at = cuts(exprs, body, usize::from(depth.0), extent);
            let mut total = None;
            for (first, count) in pieces(&at, extent) {
                let value = advanced(exprs, body, depth, first);
                let piece = exprs.reduce(op, depth, count, value);
                total = Some(total.map_or(piece, |t| exprs.binary(op.binary(), t, piece)));
            }
            total.filter(|_| !at.is_empty())
        });
    }
}

/// Passes of a loop before which something that it reads goes over to another part.
fn cuts(exprs: &Exprs, wholes: &FastMap<VarId, Whole>, value: ExprId, depth: usize, extent: u32) -> Vec<i64> {
    let read = exprs.loads(value, |v, _| wholes.contains_key(&v));
    let mut at: Vec<i64> = read.into_iter().flat_map(|(v, _, at)| wholes[&v].turns(at, depth, extent)).collect();
    at.sort_unstable();
    at.dedup();
    at
}

/// First pass and number of passes between cuts.
fn pieces(cuts: &[i64], extent: u32) -> impl Iterator<Item = (i64, u32)> + '_ {
    let ends = cuts.iter().copied().chain([i64::from(extent)]);
    [0].into_iter().chain(cuts.iter().copied()).zip(ends).map(|(first, end)| (first, (end - first) as u32))
}

/// One equation for each piece of a loop.
fn split(exprs: &mut Exprs, equation: &Equation, depth: usize, cuts: &[i64], out: &mut Vec<Equation>) {
    for (first, count) in pieces(cuts, equation.extents[depth]) {
        let mut extents = equation.extents.clone();
        extents[depth] = count;
        let value = advanced(exprs, equation.form.value(), LoopVar(depth as u8), first);
        let moved = |at: Affine| at.advanced(depth, first);
        let form = match equation.form {
            EquationForm::Rate { var, at, .. } => EquationForm::Rate { var, at: moved(at), value },
            EquationForm::Definition { var, at, .. } => EquationForm::Definition { var, at: moved(at), value },
            EquationForm::Implicit { .. } => EquationForm::Implicit { residual: value },
        };
        out.push(Equation { extents, form, ..equation.clone() });
    }
}

/// Expression of a loop `by` iterations later.
pub(super) fn advanced(exprs: &mut Exprs, value: ExprId, depth: LoopVar, by: i64) -> ExprId {
    let d = usize::from(depth.0);
    exprs.rewrite(value, &mut Rewritten::default(), &mut |exprs, node| match node {
        // A sum may bind the same counter again: inside, it is another one.
        Expr::Reduce { body, depth: bound, .. } if bound == depth || exprs.free(body) & (1 << d) == 0 => Some(exprs.raw(node)),
        Expr::Counter(v) if v == depth => {
            let by = exprs.constant(by as f64);
            let counter = exprs.counter(v);
            Some(exprs.add(counter, by))
        }
        Expr::Load { var, flavour, at } => Some(exprs.load(var, flavour, at.advanced(d, by))),
        _ => None,
    })
}
