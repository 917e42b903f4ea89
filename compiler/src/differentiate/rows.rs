//! The equations of a model in the order of the unknowns, and the entries of their Jacobian.

use cranelift_entity::SecondaryMap;
use smpl_dsl::span::Span;

use super::{Column, DifferentiateError, Entry, Rows, entries, normalise};
use crate::ir::{Affine, BUILTIN_COUNT, Builtin, Exprs, Flavour, LoopVar, Role, VarId};
use crate::model::{Model, Variable};

/// Position in `y` of each unknown's first element.
fn positions(model: &Model) -> SecondaryMap<VarId, Option<u32>> {
    let mut positions = SecondaryMap::new();
    let mut next = 0;
    for &var in &model.unknowns {
        positions[var] = Some(next);
        next += model.vars[var].len;
    }
    positions
}

/// The equations in the order of `y`, ready to be differentiated.
pub fn rows(model: &mut Model) -> Result<Vec<Rows>, DifferentiateError> {
    let positions = positions(model);
    let mut rows = Vec::with_capacity(model.rows.len());
    for row in &model.rows {
        let column_of = |var: VarId, flavour: Flavour| {
            let wanted = matches!(flavour, Flavour::Value | Flavour::Derivative);
            positions[var].filter(|_| wanted).map(|first| Column { first, factor: None })
        };
        let value = normalise(&mut model.exprs, row.extents.len(), row.residual, &column_of)?;
        let first = i64::from(positions[row.var].unwrap_or(0));
        rows.push(Rows { extents: row.extents.clone(), row: row.at.plus(Affine::constant(first)), value });
    }
    Ok(joined(&mut model.exprs, rows))
}

/// The rows with those at the ends of a loop, often split off where a boundary might differ, taken
/// into the loop where they do not.
fn joined(exprs: &mut Exprs, rows: Vec<Rows>) -> Vec<Rows> {
    let mut out: Vec<Rows> = Vec::with_capacity(rows.len());
    for row in rows {
        let before = out.pop();
        match before {
            Some(mut before) if continues(exprs, &before, &row) => {
                if let Some(extent) = before.extents.last_mut() {
                    *extent += 1;
                }
                out.push(before);
            }
            before => out.extend(before.into_iter().chain([row])),
        }
    }
    out
}

/// Returns `true` if a row is the next pass of the innermost loop of the one before.
fn continues(exprs: &mut Exprs, before: &Rows, row: &Rows) -> bool {
    let Some((&extent, outer)) = before.extents.split_last() else { return false };
    let d = outer.len();
    let next = i64::from(extent);
    let mut at = before.row;
    at.offset += at.strides[d] * next;
    at.strides[d] = 0;
    outer == row.extents && at == row.row && exprs.shift(before.value, LoopVar(d as u8), next) == row.value
}

/// The entries of `∂F/∂y + cj ∂F/∂y'`, with `cj` the builtin [`Builtin::DerivativeFactor`].
pub fn jacobian(model: &mut Model, rows: &[Rows]) -> Vec<Entry> {
    let positions = positions(model);
    let builtin = builtin_variable(model);
    let at = Affine::constant(Builtin::DerivativeFactor as i64);
    let factor = model.exprs.load(builtin, Flavour::Value, at);
    let column_of = |var: VarId, flavour: Flavour| {
        let first = positions[var]?;
        match flavour {
            Flavour::Value => Some(Column { first, factor: None }),
            Flavour::Derivative => Some(Column { first, factor: Some(factor) }),
            _ => None,
        }
    };
    entries(&mut model.exprs, rows, &column_of)
}

fn builtin_variable(model: &mut Model) -> VarId {
    let known = model.builtins();
    known.unwrap_or_else(|| {
        let name = "builtin".into();
        model.vars.push(Variable { name, role: Role::Builtin, len: BUILTIN_COUNT, span: Span::default() })
    })
}
