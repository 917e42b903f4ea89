//! Failures of a run in which something that was differentiated jumps.

use smpl_dsl::span::Span;

use super::super::super::common::{add_failure, element_name};
use super::Doubt;
use crate::ir::{BinaryFn, Compare, Expr, ExprId, Exprs, FastSet, Flavour, LoopVar, Loops, ReduceFn, Rewritten, Role, UnaryFn};
use crate::model::{Model, Root, RootAction, Unsteady};

/// Part of the terms of an expression by which it jumps at least.
const DIFFERS: f64 = 1e-6;

/// Adds a root function for each doubt: positive where a switch has changed since the step began
/// and both forms differ at its threshold.
///
/// # Errors
/// The doubt of which no root function can be made.
pub(in super::super) fn watch(model: &mut Model, doubts: &[Doubt], loops: &Loops, span: Span) -> Result<(), Doubt> {
    let mut known = FastSet::default();
    for doubt in doubts {
        let value = root_of(model, doubt, loops).ok_or(*doubt)?;
        if !known.insert(value) || model.roots.iter().any(|root| root.value == value) {
            continue;
        }
        let name = doubt.of.map_or_else(|| model.interface.time.name.clone(), |(var, element)| element_name(model, var, element));
        let of = name.split('[').next().unwrap_or_default().replace(['.', ' '], "_");
        let failure = add_failure(model, format!("jump_by_{of}"));
        let name_of_failure = model.interface.finish.failures[failure as usize].name.clone();
        model.roots.push(Root { name: name_of_failure, value, strict: true, action: RootAction::Fail(failure) });
        model.interface.reduction.unsteady.push(Unsteady { failure, span, of: name });
    }
    Ok(())
}

fn root_of(model: &mut Model, doubt: &Doubt, loops: &Loops) -> Option<ExprId> {
    let builtins = model.vars.iter().find(|(_, v)| v.role == Role::Builtin)?.0;
    let roles: Vec<Role> = model.vars.values().map(|v| v.role).collect();
    let exprs = &mut model.exprs;
    let zero = exprs.constant(0.0);
    let now = exprs.compare(Compare::Lt, zero, doubt.distance);
    let role = |var: crate::ir::VarId| roles[var.as_u32() as usize];
    let before = exprs.in_frame(now, Flavour::Previous, &role, builtins, &mut Rewritten::default()).ok()?;
    let (not_now, not_before) = (exprs.not(now), exprs.not(before));
    let (up, down) = (exprs.and(now, not_before), exprs.and(not_now, before));
    let changed = exprs.or(up, down);
    let [a, b] = doubt.sides;
    let gap = exprs.sub(a, b);
    let gap = exprs.unary(UnaryFn::Abs, gap);
    let (size, least) = (size(exprs, doubt.sides), exprs.constant(DIFFERS));
    let least = exprs.mul(least, size);
    let (excess, none) = (exprs.sub(gap, least), exprs.constant(-1.0));
    let mut value = exprs.select(changed, excess, none);
    for d in (0..loops.len()).rev().filter(|d| model.exprs.free(value) & (1 << d) != 0).collect::<Vec<_>>() {
        value = model.exprs.reduce(ReduceFn::Max, LoopVar(d as u8), loops[d]?, value);
    }
    Some(value)
}

/// The sum of the sizes of the terms of both sides.
fn size(exprs: &mut Exprs, sides: [ExprId; 2]) -> ExprId {
    let mut terms = Vec::new();
    let mut stack = sides.to_vec();
    while let Some(e) = stack.pop() {
        match exprs.node(e) {
            Expr::Binary(BinaryFn::Add | BinaryFn::Sub, a, b) => stack.extend([a, b]),
            Expr::Unary(UnaryFn::Neg, a) => stack.push(a),
            _ => terms.push(e),
        }
    }
    let mut sum = exprs.constant(f64::MIN_POSITIVE);
    for term in terms {
        let size = exprs.unary(UnaryFn::Abs, term);
        sum = exprs.add(sum, size);
    }
    sum
}
