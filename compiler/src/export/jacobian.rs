//! The sparse Jacobian of the residual as a function of the export, in public order.

use super::ExportError;
use super::sheet::{Function, Loops, Nest, Sheet, Store};
use crate::differentiate::pattern::each;
use crate::differentiate::{self, Column, Entry, Rows};
use crate::ir::{Affine, Builtin, FastMap, Flavour, VarId};

/// Positions of the non-zeros, column after column.
pub(super) struct Pattern {
    /// Start of each column in `rows`, and its length at the end.
    pub columns: Vec<u32>,
    /// Row of each non-zero, ascending in each column.
    pub rows: Vec<u32>,
}

/// `dF/dy + cj dF/dy'` and its pattern.
pub(super) fn jacobian(sheet: &mut Sheet) -> Result<(Function, Pattern), ExportError> {
    let outside = outside(sheet)?;
    let entries = entries(sheet)?;
    // Row and column of every pass of every entry.
    let mut passes: Vec<Vec<(u32, u32)>> = Vec::with_capacity(entries.len());
    for entry in &entries {
        let mut places = vec![];
        each(&entry.loops, |counters| {
            let of = |at: Affine| outside.get(at.at(counters) as usize).copied().unwrap_or(0);
            places.push((of(entry.column), of(entry.row)));
        });
        passes.push(places);
    }
    let mut nonzeros: Vec<(u32, u32)> = passes.concat();
    nonzeros.sort_unstable();
    nonzeros.dedup();
    let slot = |place: &(u32, u32)| nonzeros.binary_search(place).unwrap_or(0) as u32;
    let mut taken = vec![0u32; nonzeros.len()];
    let slots: Vec<Vec<u32>> = passes.iter().map(|places| places.iter().map(slot).collect()).collect();
    slots.iter().flatten().for_each(|&at| taken[at as usize] += 1);
    let is_added = |positions: &Vec<u32>| positions.iter().any(|&at| taken[at as usize] > 1);
    let mut nests = cleared(sheet, slots.iter().filter(|p| is_added(p)).flatten().copied().collect());
    for (entry, positions) in entries.iter().zip(slots) {
        let store = Store { array: None, add: is_added(&positions), positions, value: entry.value };
        nests.push(Nest { loops: entry.loops.clone(), stores: vec![store] });
    }
    let function = Function {
        name: "jacobian".into(),
        text: "dF/dy + cj dF/dy', the non-zeros column after column".into(),
        nests,
        update: false,
        outputs: vec![],
    };
    Ok((function, pattern(&nonzeros, sheet.unknowns())))
}

/// Zeros where entries are added to what is there.
fn cleared(sheet: &mut Sheet, mut positions: Vec<u32>) -> Vec<Nest> {
    positions.sort_unstable();
    positions.dedup();
    let value = sheet.model.exprs.constant(0.0);
    let loops: Loops = vec![(0, positions.len() as u32)];
    let store = Store { array: None, positions, add: false, value };
    if store.positions.is_empty() { vec![] } else { vec![Nest { loops, stores: vec![store] }] }
}

fn pattern(nonzeros: &[(u32, u32)], columns: usize) -> Pattern {
    let mut starts = vec![0; columns + 1];
    nonzeros.iter().for_each(|&(column, _)| starts[column as usize + 1] += 1);
    for column in 0..columns {
        starts[column + 1] += starts[column];
    }
    Pattern { columns: starts, rows: nonzeros.iter().map(|&(_, row)| row).collect() }
}

/// The derivatives of all rows, rows and columns in the order of the equations.
fn entries(sheet: &mut Sheet) -> Result<Vec<Entry>, ExportError> {
    let model = &mut sheet.model;
    let mut first: FastMap<VarId, u32> = FastMap::default();
    let mut next = 0;
    for &var in &model.unknowns {
        first.insert(var, next);
        next += model.vars[var].len;
    }
    let builtin = model.builtins();
    let builtin = builtin.ok_or_else(|| ExportError::Unavailable { variable: "builtin".into() })?;
    let factor = model.exprs.load(builtin, Flavour::Value, Affine::constant(Builtin::DerivativeFactor as i64));
    let column_of = |var: VarId, flavour: Flavour| {
        let first = *first.get(&var)?;
        match flavour {
            Flavour::Value => Some(Column { first, factor: None }),
            Flavour::Derivative => Some(Column { first, factor: Some(factor) }),
            _ => None,
        }
    };
    let mut rows = Vec::with_capacity(model.rows.len());
    for row in &model.rows {
        let value = differentiate::normalise(&mut model.exprs, row.extents.len(), row.residual, &column_of)?;
        let start = first.get(&row.var).copied().unwrap_or(0);
        rows.push(Rows { extents: row.extents.clone(), row: row.at.plus(Affine::constant(i64::from(start))), value });
    }
    Ok(differentiate::entries(&mut model.exprs, &rows, &column_of))
}

/// Public position of each unknown in the order of the equations.
fn outside(sheet: &Sheet) -> Result<Vec<u32>, ExportError> {
    let mut outside = vec![];
    for &var in &sheet.model.unknowns {
        for element in 0..sheet.model.vars[var].len {
            let read = sheet.read(var, Flavour::Value, Affine::constant(i64::from(element)), &Default::default())?;
            outside.extend(read.positions);
        }
    }
    Ok(outside)
}
