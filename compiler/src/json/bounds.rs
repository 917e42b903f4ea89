//! True if what a model evaluates stays within its arrays and within reason.

use super::cursor::{At, ReadError};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastSet, Loops, loops_of};
use crate::model::Model;
use cranelift_entity::EntityRef;

/// Most passes of all loops around and inside of one value.
const MAX_PASSES: u64 = 1_000_000_000;

/// Checks what is evaluated in loops of some extents; what was looked at is remembered.
pub(super) struct Bounds<'m> {
    model: &'m Model,
    seen: FastSet<(ExprId, Loops)>,
    /// Passes of the reductions inside of each node.
    passes: Vec<u64>,
}

impl<'m> Bounds<'m> {
    pub(super) fn new(model: &'m Model) -> Self {
        let mut passes: Vec<u64> = Vec::with_capacity(model.exprs.len());
        for id in model.exprs.ids() {
            let below = model.exprs.operands(id).map(|o| passes[o.index()]).max().unwrap_or(1);
            passes.push(match model.exprs.node(id) {
                Expr::Reduce { extent, .. } => below.saturating_mul(u64::from(extent.max(1))),
                _ => below,
            });
        }
        Bounds { model, seen: FastSet::default(), passes }
    }

    /// A value that is evaluated for all counters; `at` is named in errors.
    pub(super) fn value(&mut self, at: &At<'_>, value: ExprId, extents: &[u32]) -> Result<(), ReadError> {
        let passes = extents.iter().map(|&e| u64::from(e.max(1))).fold(self.passes[value.index()], u64::saturating_mul);
        if passes > MAX_PASSES {
            return Err(at.fault(format!("{passes} passes of loops are more than {MAX_PASSES}")));
        }
        let exprs = &self.model.exprs;
        let mut stack = vec![(value, loops_of(extents))];
        while let Some((id, loops)) = stack.pop() {
            let around = free_only(exprs, id, loops);
            if !self.seen.insert((id, around)) {
                continue;
            }
            match exprs.node(id) {
                Expr::Counter(c) if loops[c.0 as usize].is_none() => {
                    return Err(at.fault(format!("counter {} is used outside of its loop", c.0)));
                }
                Expr::Load { var, at: address, .. } => {
                    let variable = &self.model.vars[var];
                    within(address, &loops, variable.len).map_err(|why| at.fault(format!("`{}`: {why}", variable.name)))?;
                }
                Expr::Reduce { depth, extent, body, .. } => {
                    let mut inner = loops;
                    inner[depth.0 as usize] = Some(extent);
                    stack.push((body, inner));
                }
                _ => stack.extend(exprs.operands(id).map(|o| (o, loops))),
            }
        }
        Ok(())
    }
}

/// The loops that a node depends on.
fn free_only(exprs: &Exprs, id: ExprId, mut loops: Loops) -> Loops {
    let free = exprs.free(id);
    loops.iter_mut().enumerate().filter(|(d, _)| free & (1 << d) == 0).for_each(|(_, l)| *l = None);
    loops
}

/// Returns `true` if an address stays in an array of that many elements, whatever the counters.
pub(super) fn within(address: Affine, loops: &Loops, len: u32) -> Result<(), String> {
    let (mut low, mut high) = (i128::from(address.offset), i128::from(address.offset));
    for (d, &stride) in address.strides.iter().enumerate().filter(|(_, s)| **s != 0) {
        match loops[d] {
            None => return Err(format!("an address follows counter {d} outside of its loop")),
            Some(0) => return Ok(()),
            Some(extent) => {
                let reach = i128::from(stride) * i128::from(extent - 1);
                low += reach.min(0);
                high += reach.max(0);
            }
        }
    }
    if low < 0 || high >= i128::from(len) {
        return Err(format!("elements {low} to {high} of {len}"));
    }
    Ok(())
}
