//! Values of other instants in the equations: at rest, the end of the previous step, the start of
//! the episode and the steady state are the point itself.

use std::sync::Arc;

use smpl_compiler::compiled::tangent::ByInputs;
use smpl_compiler::layout::{FramePart, Memory, Region};

use super::error::SteadyError;
use crate::system::CompiledSystem;

/// The other instants.
pub(super) const INSTANTS: [fn(FramePart) -> Region; 3] = [Region::Initial, Region::Previous, Region::Steady];
/// Content of a frame.
const PARTS: [FramePart; 4] = [FramePart::Y, FramePart::Action, FramePart::Discrete, FramePart::Disturbance];

/// Puts an instance to rest at a point: `initial(e)`, `previous(e)` and `steady(e)` are `e` there.
pub fn rest_at(system: &mut CompiledSystem, y: &[f64]) {
    keep(system, y);
    let (model, memory) = system.parts();
    model.prepare_step(memory);
}

/// As [`rest_at`], without what is prepared for the equations.
pub(super) fn keep(system: &mut CompiledSystem, y: &[f64]) {
    INSTANTS.into_iter().for_each(|instant| system.keep(y, instant));
}

/// The numbers of all other instants.
pub(super) struct Saved(Vec<(Region, Vec<f64>)>);

impl Saved {
    pub(super) fn of(system: &CompiledSystem) -> Self {
        let regions = INSTANTS.into_iter().flat_map(|instant| PARTS.map(instant));
        Self(regions.map(|region| (region, system.region(region).to_vec())).collect())
    }

    pub(super) fn restore(&self, system: &mut CompiledSystem) {
        self.0.iter().for_each(|(region, values)| system.region_mut(*region).copy_from_slice(values));
    }
}

/// Derivatives of the equations by the unknowns of other instants.
pub(super) struct Frames {
    compiled: Arc<ByInputs>,
    memory: Memory,
    /// Row of each value, and the place in `y` that it is a derivative by.
    pub places: Vec<(usize, usize)>,
    pub values: Vec<f64>,
}

impl Frames {
    /// `None` where the equations read no other instant.
    ///
    /// # Errors
    /// If an equation cannot be differentiated.
    pub(super) fn new(system: &CompiledSystem) -> Result<Option<Self>, SteadyError> {
        if !system.reads_other_instants() {
            return Ok(None);
        }
        let model = system.model();
        let ranges = INSTANTS.map(|instant| system.memory().layout().range(instant(FramePart::Y)));
        let mut inputs = Vec::new();
        model.find_inputs(|cells| ranges.iter().any(|range| range.contains(&cells.start)), &mut inputs);
        let compiled = model.by_inputs(&inputs).map_err(|e| SteadyError::Condition { message: e.to_string() })?;
        let place = |cell: u32| {
            let found = ranges.iter().find(|range| range.contains(&(cell as usize)));
            found.map_or(usize::MAX, |range| cell as usize - range.start)
        };
        let places: Vec<(usize, usize)> = compiled.places().iter().map(|&(row, cell)| (row as usize, place(cell))).collect();
        Ok(Some(Self { memory: compiled.memory(), values: vec![0.0; places.len()], compiled, places }))
    }

    /// Evaluates the derivatives of an instance that rests at `y`.
    pub(super) fn evaluate(&mut self, system: &CompiledSystem, y: &[f64], zero: &[f64]) {
        self.compiled.take(&mut self.memory, system.memory());
        self.compiled.evaluate(system.model(), &mut self.memory, 0.0, (y, zero), &mut self.values);
    }
}
