//! What does not change within a step, computed ahead.

use crate::export::ExportError;
use crate::export::functions::{extents, spread};
use crate::export::sheet::{Nest, Sheet, Store, is_dynamic};
use crate::hoist::{Hoister, Stage};
use crate::ir::{Affine, Flavour, Role, VarId};
use crate::schedule::{Job, Sink, Task};

/// Replaces what actions and parameters alone determine by elements of `w`; the nests that fill it, stage after stage, and its length.
pub(super) fn hoist(sheet: &mut Sheet) -> Result<(Vec<Vec<Nest>>, u32), ExportError> {
    let before = sheet.model.vars.len();
    let mut hoister = Hoister::new(&mut sheet.model);
    for function in sheet.functions.iter_mut().filter(|f| is_dynamic(&f.name)) {
        for nest in &mut function.nests {
            // Where the values go does not matter here.
            let stores = nest.stores.iter().map(|s| (Sink::Out(Affine::default()), s.value)).collect();
            let job = Job { stages: vec![vec![Task { loops: nest.loops.clone(), stores }]], in_place: false };
            let job = hoister.job(&job, Stage::Step);
            let values = job.stages.iter().flatten().flat_map(|task| &task.stores);
            nest.stores.iter_mut().zip(values).for_each(|(store, (_, value))| store.value = *value);
        }
    }
    let (parameters, step) = hoister.finish();
    let made: Vec<VarId> = sheet.model.vars.iter().skip(before).filter(|(_, v)| v.role == Role::Cache).map(|(id, _)| id).collect();
    let mut length = 0;
    for var in made {
        sheet.place_cache(var, length);
        length += sheet.model.vars[var].len;
    }
    let stages = [parameters, step].map(|job| nests(sheet, &job)).into_iter().collect::<Result<Vec<_>, _>>()?;
    Ok((stages, length))
}

fn nests(sheet: &Sheet, job: &Job) -> Result<Vec<Nest>, ExportError> {
    let mut nests = vec![];
    for task in job.stages.iter().flatten() {
        let mut stores = vec![];
        for &(sink, value) in &task.stores {
            let Sink::Var(var, at) = sink else { continue };
            let read = sheet.read(var, Flavour::Value, at, &extents(&task.loops))?;
            let positions = spread(&task.loops, &read.loops, &read.positions);
            stores.push(Store { array: Some(read.array), positions, add: false, value });
        }
        nests.push(Nest { loops: task.loops.clone(), stores });
    }
    Ok(nests)
}
