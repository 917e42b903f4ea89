//! Discrete variables at a steady state: they are held, whatever a control step would make of them
//! there.

use smpl_compiler::layout::Region;

use crate::catalogue::{Catalogue, Element};
use crate::system::CompiledSystem;

/// Change, relative to sizes and scales, that counts as none.
const SAME: f64 = 1e-9;

/// Discrete variables that the updates of a control step at `y` change, their values and the next
/// ones: `system` rests there. Events are not looked at.
#[must_use]
pub fn changed_by_a_step<'a>(system: &CompiledSystem, catalogue: &'a Catalogue, y: &[f64]) -> Vec<(&'a Element, f64, f64)> {
    let (mut system, mut y) = (system.clone(), y.to_vec());
    let before = system.region(Region::Discrete).to_vec();
    let (model, memory) = system.parts();
    model.start(memory, 0.0, &mut y);
    model.prepare_step(memory);
    integrate(&mut system, &y);
    let step = system.model().interface().episode.step;
    let (model, memory) = system.parts();
    model.end(memory, step, &mut y);
    let after = system.region(Region::Discrete);
    let stays = |e: &Element| {
        let (a, b) = (before[e.at], after[e.at]);
        let scale = if e.scale.is_finite() { e.scale } else { 1.0 };
        a.to_bits() == b.to_bits() || (a - b).abs() <= SAME * a.abs().max(b.abs()).max(scale)
    };
    catalogue.discretes.elements().iter().filter(|e| !stays(e)).map(|e| (e, before[e.at], after[e.at])).collect()
}

/// Integrals over a step in which nothing moves.
fn integrate(system: &mut CompiledSystem, y: &[f64]) {
    let step = system.model().interface().episode.step;
    let mut rates = vec![0.0; system.model().quadratures()];
    let (model, memory) = system.parts();
    model.quadrature_rates(memory, 0.0, y, &vec![0.0; y.len()], &mut rates);
    system.region_mut(Region::Quadrature).iter_mut().zip(&rates).for_each(|(integral, rate)| *integral = step * rate);
}
