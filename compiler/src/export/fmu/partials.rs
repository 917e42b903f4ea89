//! Derivatives for directional derivatives: of the residual by inputs, of outputs and observations
//! by unknowns, rates and inputs.

use crate::differentiate::pattern::each;
use crate::differentiate::{self, Column, Rows};
use crate::export::ExportError;
use crate::export::sheet::{Array, Function, Nest, Sheet, Store};
use crate::ir::{Affine, FastMap, Flavour, Role, VarId};
use crate::schedule::row_major;

/// Places of the nonzeros of the function `partials`.
pub(super) struct Partials {
    /// Row of each: residual, outputs, observations one after another.
    pub rows: Vec<u32>,
    /// Column of each: y, y', u, p one after another.
    pub columns: Vec<u32>,
    /// Number of rows.
    pub height: usize,
    /// Number of columns.
    pub width: usize,
}

/// Adds the function to a sheet.
pub(super) fn add(sheet: &mut Sheet) -> Result<Partials, ExportError> {
    let columns = Columns::new(sheet);
    let n = sheet.unknowns();
    let observations = sheet.function("observations").map_or(0, |f| f.outputs.len());
    let outputs = sheet.families.outputs.len();
    let mut found: Vec<(u32, Nest)> = vec![];
    for (name, first, by_unknowns) in [("residual", 0, false), ("outputs", n, true), ("observations", n + outputs, true)] {
        let nests = sheet.function(name).map(|f| f.nests.clone()).unwrap_or_default();
        for nest in nests {
            differentiate(sheet, &columns, &nest, (first as u32, by_unknowns), &mut found)?;
        }
    }
    let mut partials = Partials { rows: vec![], columns: vec![], height: n + outputs + observations, width: columns.width };
    let mut nests: Vec<Nest> = vec![];
    for (row, mut nest) in found {
        // A nest of many passes is one of the list: its first non-zero is where its places begin.
        let first = partials.rows.len() as u32;
        let store = &mut nest.stores[0];
        let passes = store.positions.len() / 2;
        let (rows, columns) = store.positions.split_at(passes);
        partials.rows.extend(rows.iter().map(|at| at + row));
        partials.columns.extend(columns.iter().copied());
        store.positions = (first..first + passes as u32).collect();
        nests.push(nest);
    }
    let text = "derivatives of the residual by inputs, of outputs and observations by unknowns, rates and inputs".to_owned();
    if !nests.is_empty() {
        sheet.functions.push(Function { name: "partials".into(), text, nests, update: false, outputs: vec![] });
    }
    Ok(partials)
}

/// Columns of the variables in the order of their ids, and where they are outside.
struct Columns {
    first: FastMap<(VarId, Flavour), u32>,
    outside: Vec<u32>,
    width: usize,
    /// Those before are unknowns and rates.
    unknowns: u32,
}

impl Columns {
    fn new(sheet: &Sheet) -> Columns {
        let n = sheet.unknowns() as u32;
        let starts = [(Array::Y, 0), (Array::Yp, n), (Array::U, 2 * n), (Array::P, 2 * n + sheet.families.actions.len() as u32)];
        let mut columns = Columns { first: FastMap::default(), outside: vec![], width: 0, unknowns: 0 };
        let kinds: [(&[Role], Flavour); 3] = [
            (&[Role::State, Role::Algebraic], Flavour::Value),
            (&[Role::State, Role::Algebraic], Flavour::Derivative),
            (&[Role::Action, Role::Disturbance], Flavour::Value),
        ];
        for (roles, flavour) in kinds {
            for (var, variable) in sheet.model.vars.iter().filter(|(_, v)| roles.contains(&v.role)) {
                let at = |element: u32| {
                    let (array, position) = sheet.place_of(var, flavour, element)?;
                    Some(starts.iter().find(|(of, _)| *of == array)?.1 + position)
                };
                let places: Option<Vec<u32>> = (0..variable.len).map(at).collect();
                if let Some(places) = places {
                    columns.first.insert((var, flavour), columns.outside.len() as u32);
                    columns.outside.extend(places);
                }
            }
            if flavour == Flavour::Derivative {
                columns.unknowns = columns.outside.len() as u32;
            }
        }
        columns.width = 2 * n as usize + sheet.families.actions.len() + sheet.parameters.len();
        columns
    }
}

/// The derivatives of what a nest stores: the row where they begin, and a nest whose positions are
/// rows, then columns.
fn differentiate(
    sheet: &mut Sheet,
    columns: &Columns,
    nest: &Nest,
    (first, by_unknowns): (u32, bool),
    found: &mut Vec<(u32, Nest)>,
) -> Result<(), ExportError> {
    let column_of = |var: VarId, flavour: Flavour| {
        let first = *columns.first.get(&(var, flavour))?;
        (by_unknowns || first >= columns.unknowns).then_some(Column { first, factor: None })
    };
    let extents: Vec<u32> = nest.loops.iter().map(|l| l.1).collect();
    for store in &nest.stores {
        let exprs = &mut sheet.model.exprs;
        let value = differentiate::normalise(exprs, extents.len(), store.value, &column_of)?;
        let rows = [Rows { extents: extents.clone(), row: row_major(&nest.loops), value }];
        for entry in differentiate::entries(exprs, &rows, &column_of) {
            let place = |at: Affine, of: &[u32]| {
                let mut places = vec![];
                each(&entry.loops, |counters| places.push(of.get(at.at(counters) as usize).copied().unwrap_or(0)));
                places
            };
            let mut positions = place(entry.row, &store.positions);
            positions.extend(place(entry.column, &columns.outside));
            let stores = vec![Store { array: None, positions, add: false, value: entry.value }];
            found.push((first, Nest { loops: entry.loops.clone(), stores }));
        }
    }
    Ok(())
}
