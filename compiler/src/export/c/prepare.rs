//! Values that do not change within a step, computed in advance.

use crate::export::ExportError;
use crate::export::functions::{extents, spread};
use crate::export::sheet::{Nest, Sheet, Store, is_dynamic};
use crate::hoist::{Hoister, Stage};
use crate::ir::{self, Affine, Flavour, Place, Role, Target, VarId};
use crate::schedule::Staged;

/// Replaces what actions and parameters alone determine by elements of `w`; the nests that fill it,
/// stage after stage, and its length.
pub(super) fn hoist(sheet: &mut Sheet) -> Result<(Vec<Vec<Nest>>, u32), ExportError> {
    let before = sheet.model.vars.len();
    let mut hoister = Hoister::new(&mut sheet.model);
    for function in sheet.functions.iter_mut().filter(|f| is_dynamic(&f.name)) {
        for nest in &mut function.nests {
            // Where the values go does not matter here.
            let stores = nest.stores.iter().map(|s| ir::Store { target: Target::out(Affine::default()), value: s.value }).collect();
            let staged = Staged { stages: vec![vec![ir::Nest { loops: nest.loops.clone(), stores }]], in_place: false };
            let staged = hoister.staged(&staged, Stage::Step);
            let values = staged.stages.iter().flatten().flat_map(|rewritten| &rewritten.stores);
            nest.stores.iter_mut().zip(values).for_each(|(store, rewritten)| store.value = rewritten.value);
        }
    }
    let (parameters, step) = hoister.finish();
    let made: Vec<VarId> = sheet.model.vars.iter().skip(before).filter(|(_, v)| v.role == Role::Cache).map(|(id, _)| id).collect();
    let mut length = 0;
    for var in made {
        sheet.place_cache(var, length);
        length += sheet.model.vars[var].len;
    }
    let stages = [parameters, step].map(|staged| nests(sheet, &staged)).into_iter().collect::<Result<Vec<_>, _>>()?;
    Ok((stages, length))
}

fn nests(sheet: &Sheet, staged: &Staged) -> Result<Vec<Nest>, ExportError> {
    let mut nests = vec![];
    for nest in staged.stages.iter().flatten() {
        let mut stores = vec![];
        for &ir::Store { target: Target { place, at }, value } in &nest.stores {
            let Place::Var(var) = place else { continue };
            let read = sheet.read(var, Flavour::Value, at, &extents(&nest.loops))?;
            let positions = spread(&nest.loops, &read.loops, &read.positions);
            stores.push(Store { array: Some(read.array), positions, add: false, value });
        }
        nests.push(Nest { loops: nest.loops.clone(), stores });
    }
    Ok(nests)
}
