//! Limits of a text: what a model of it takes of memory and time.

use cranelift_entity::EntityRef;

use super::Document;
use super::error::{ReadError, fault};
use crate::ir::{Expr, Role};
use crate::model::{Axis, Model};

/// Most elements of all variables together, and of one quantity.
const MAX_ELEMENTS: usize = 50_000_000;

/// Most passes of one loop.
const MAX_EXTENT: u32 = 100_000_000;

/// Most passes of all loops around and inside of one value.
const MAX_PASSES: u64 = 1_000_000_000;

/// Most steps that an observation is held or late.
const MAX_STEPS: u32 = 1_000_000;

fn exceeds(path: String, what: &str, most: impl std::fmt::Display) -> Result<(), ReadError> {
    Err(fault(path, format!("more than {most} {what}")))
}

/// Checks a text before a model is made of it.
pub(super) fn check(document: &Document) -> Result<(), ReadError> {
    let mut elements = 0;
    for (i, variable) in document.variables.iter().enumerate() {
        elements += variable.len as usize;
        if elements > MAX_ELEMENTS {
            return exceeds(format!("variables[{i}]"), "elements of all variables together", MAX_ELEMENTS);
        }
        if variable.role == Role::Cache {
            return Err(fault(format!("variables[{i}].role"), "caches belong to the back end"));
        }
    }
    let q = &document.quantities;
    let families = [&q.states, &q.solved, &q.outputs, &q.discretes, &q.actions, &q.disturbances, &q.parameters];
    for quantity in families.into_iter().flatten() {
        let len = quantity.axes.iter().map(Axis::len).try_fold(1_usize, usize::checked_mul);
        if len.is_none_or(|len| len > MAX_ELEMENTS) {
            return exceeds(format!("quantities.{}", quantity.name), "elements", MAX_ELEMENTS);
        }
    }
    let delayed = document.delays.iter().map(|delay| delay.count as usize).sum::<usize>();
    if delayed > MAX_ELEMENTS {
        return exceeds("delays".into(), "elements", MAX_ELEMENTS);
    }
    Ok(())
}

/// Checks the loops and the delays of a model.
pub(super) fn check_work(model: &Model) -> Result<(), ReadError> {
    for (i, observed) in model.interface.finish.observations.iter().enumerate() {
        if observed.every > MAX_STEPS || observed.delay > MAX_STEPS {
            return exceeds(format!("finish.observations[{i}]"), "steps", MAX_STEPS);
        }
    }
    let mut below: Vec<u64> = Vec::with_capacity(model.exprs.len());
    for id in model.exprs.ids() {
        let inside = model.exprs.operands(id).map(|operand| below[operand.index()]).max().unwrap_or(1);
        below.push(match model.exprs.node(id) {
            Expr::Reduce { extent, .. } => inside.saturating_mul(u64::from(extent.max(1))),
            _ => inside,
        });
    }
    let work = |path: &dyn Fn() -> String, value: crate::ir::ExprId, extents: &[u32]| {
        let passes = extents.iter().map(|&e| u64::from(e.max(1))).fold(below[value.index()], u64::saturating_mul);
        if extents.iter().any(|&extent| extent > MAX_EXTENT) || passes > MAX_PASSES {
            return exceeds(path(), "passes of loops", MAX_PASSES);
        }
        Ok(())
    };
    for (i, row) in model.rows.iter().enumerate() {
        work(&|| format!("equations[{i}]"), row.residual, &row.extents)?;
    }
    for (i, root) in model.roots.iter().enumerate() {
        work(&|| format!("events[{i}]"), root.value, &[])?;
    }
    for (i, &value) in model.quadratures.iter().enumerate() {
        work(&|| format!("integrals[{i}]"), value, &[])?;
    }
    for (name, program) in model.programs.named() {
        for (n, nest) in program.nests.iter().enumerate() {
            for store in &nest.stores {
                work(&|| format!("programs.{name}.nests[{n}]"), store.value, &nest.extents())?;
            }
        }
    }
    Ok(())
}
