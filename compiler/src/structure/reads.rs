//! Reads of algebraic variables in loops.

use super::common::programs;
use crate::elaborate::Equation;
use crate::ir::{Affine, Expr, ExprId, FastSet, Loops, MAX_DEPTH, Role, VarId, loops_of};
use crate::model::Model;

/// An address that loops move.
#[derive(Clone, Copy, Debug)]
pub(super) struct Read {
    /// The variable.
    pub var: VarId,
    /// The address.
    pub at: Affine,
    /// The loops around it.
    pub loops: Loops,
}

/// Reads of algebraic variables in the loops of equations, and in the sums of programs.
pub(super) fn looped_reads(model: &Model, equations: &[Equation]) -> Vec<Read> {
    let mut walk = Walk { model, still: vec![false; model.exprs.len()], seen: FastSet::default(), out: Vec::new() };
    for equation in equations {
        walk.value(equation.form.value(), loops_of(&equation.extents), u8::MAX);
    }
    for value in model.roots.iter().map(|r| r.value).chain(model.quadratures.iter().copied()) {
        walk.value(value, [None; MAX_DEPTH], u8::MAX);
    }
    for program in programs(&model.programs) {
        for nest in &program.nests {
            nest.stores.iter().for_each(|store| walk.value(store.value, loops_of(&nest.extents()), 0));
        }
    }
    walk.out
}

struct Walk<'m> {
    model: &'m Model,
    /// Nodes met that no loop moves.
    still: Vec<bool>,
    /// The others, with the loops that move them.
    seen: FastSet<(ExprId, Loops, u8)>,
    out: Vec<Read>,
}

impl Walk<'_> {
    /// Reads below a value that one of the loops `of` moves, or one of a sum.
    fn value(&mut self, root: ExprId, loops: Loops, of: u8) {
        let exprs = &self.model.exprs;
        let mut stack = vec![(root, loops, of)];
        while let Some((id, loops, of)) = stack.pop() {
            let free = exprs.free(id);
            let fresh = if free == 0 {
                !std::mem::replace(&mut self.still[id.as_u32() as usize], true)
            } else {
                let around = std::array::from_fn(|d| loops[d].filter(|_| free & (1 << d) != 0));
                self.seen.insert((id, around, of & free))
            };
            if !fresh {
                continue;
            }
            match exprs.node(id) {
                Expr::Load { var, at, .. } if at.counters() & of != 0 && self.model.vars[var].role == Role::Algebraic => {
                    self.out.push(Read { var, at, loops });
                }
                Expr::Reduce { depth, extent, body, .. } => {
                    let mut inner = loops;
                    inner[usize::from(depth.0)] = Some(extent);
                    stack.push((body, inner, of | 1 << depth.0));
                }
                _ => stack.extend(exprs.operands(id).map(|o| (o, loops, of))),
            }
        }
    }
}
