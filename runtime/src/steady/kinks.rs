//! Steady states at a tie of `min`, `max`, `if` and their like, where the equations have one
//! derivative on each side.

use crate::catalogue::Catalogue;
use crate::solver::System;
use crate::system::CompiledSystem;

/// Distances from the point, relative to the scales: a derivative that jumps does so at both, one
/// that bends does less at the smaller one.
const DISTANCES: [f64; 2] = [1e-6, 1e-9];
/// Change of an entry, relative to the largest of its row, that counts as a jump.
const JUMP: f64 = 1e-3;
/// Directions that are looked in, and their opposites.
const DIRECTIONS: usize = 2;

/// The place in `y` of an unknown whose equation has another derivative on another side of the
/// point.
#[must_use]
pub fn kink(system: &mut CompiledSystem, catalogue: &Catalogue, y: &[f64]) -> Option<usize> {
    let mut scales = vec![1.0; y.len()];
    for element in catalogue.states.elements().iter().chain(catalogue.solved.elements()) {
        if element.scale.is_finite() && element.scale > 0.0 {
            scales[element.at] = element.scale;
        }
    }
    let here = jacobian(system, y, &scales);
    let pattern = system.pattern().clone();
    let mut sizes = vec![f64::MIN_POSITIVE; y.len()];
    let rows = pattern.rows();
    rows.iter().zip(&here).for_each(|(&row, x)| sizes[row] = sizes[row].max(x.abs()));
    for direction in 0..2 * DIRECTIONS {
        let jumps = DISTANCES.map(|distance| {
            let there = jacobian(system, &moved(y, &scales, direction, distance), &scales);
            let changes = rows.iter().zip(here.iter().zip(&there));
            changes.map(|(&row, (a, b))| (a - b).abs() / sizes[row].max(b.abs())).collect::<Vec<f64>>()
        });
        if let Some(entry) = (0..rows.len()).find(|&k| jumps[1][k] > JUMP && jumps[1][k] > 0.5 * jumps[0][k]) {
            return Some(rows[entry]);
        }
    }
    None
}

/// The point moved by numbers without a pattern.
fn moved(y: &[f64], scales: &[f64], direction: usize, distance: f64) -> Vec<f64> {
    let sign = if direction.is_multiple_of(2) { 1.0 } else { -1.0 };
    let part = |i: usize| ((i * DIRECTIONS + direction / 2) as f64 + 1.0) * 0.618_033_988_749_895;
    let shift = |i: usize| sign * (part(i).fract() - 0.5);
    y.iter().zip(scales).enumerate().map(|(i, (y, scale))| y + distance * shift(i) * (scale + y.abs())).collect()
}

fn jacobian(system: &mut CompiledSystem, y: &[f64], scales: &[f64]) -> Vec<f64> {
    let mut values = vec![0.0; system.pattern().entries()];
    system.jacobian(0.0, y, &vec![0.0; y.len()], 0.0, &mut values);
    for (column, scale) in scales.iter().enumerate() {
        for entry in system.pattern().column(column) {
            values[entry] *= scale;
        }
    }
    values
}
