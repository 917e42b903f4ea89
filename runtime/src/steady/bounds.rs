//! Declared bounds of the unknowns.

use super::error::{AtBound, SteadyError};
use crate::catalogue::{Catalogue, Element};
use crate::failure::BOX_SLACK;

/// Lower and upper bounds by place in `y`, infinite where there are none, with the slack of a box.
pub(super) struct Bounds {
    low: Vec<f64>,
    high: Vec<f64>,
    slack: Vec<f64>,
}

impl Bounds {
    pub(super) fn new(catalogue: &Catalogue, n: usize) -> Self {
        let mut bounds = Self { low: vec![f64::NEG_INFINITY; n], high: vec![f64::INFINITY; n], slack: vec![0.0; n] };
        for element in all(catalogue).filter(|e| !(e.low.is_nan() || e.high.is_nan())) {
            let range = element.high - element.low;
            let scale = if element.scale.is_finite() { element.scale.abs() } else { 1.0 };
            bounds.low[element.at] = element.low;
            bounds.high[element.at] = element.high;
            bounds.slack[element.at] = BOX_SLACK * if range.is_finite() { range.abs() } else { scale };
        }
        bounds
    }

    /// The free unknown that is furthest outside, relative to its slack.
    pub(super) fn outside(&self, free: &[usize], y: &[f64]) -> Option<usize> {
        let excess = |at: usize| (self.low[at] - y[at]).max(y[at] - self.high[at]) - self.slack[at];
        let relative = |at: usize| excess(at) / self.slack[at].max(f64::MIN_POSITIVE);
        free.iter().copied().filter(|&at| excess(at) > 0.0).max_by(|&a, &b| relative(a).total_cmp(&relative(b)))
    }

    /// The free unknown that is nearest to one of its bounds, or furthest beyond it, if that is less than a hundredth of its range away.
    pub(super) fn reached(&self, catalogue: &Catalogue, free: &[usize], y: &[f64]) -> Option<AtBound> {
        let room = |at: usize| (y[at] - self.low[at]).min(self.high[at] - y[at]) / (self.high[at] - self.low[at]);
        let nearest = free.iter().copied().filter(|&at| room(at) < 0.01).min_by(|&a, &b| room(a).total_cmp(&room(b)))?;
        let element = all(catalogue).find(|e| e.at == nearest)?;
        let below = y[nearest] - self.low[nearest] < self.high[nearest] - y[nearest];
        let bound = if below { self.low[nearest] } else { self.high[nearest] };
        Some(AtBound { name: element.name.clone(), value: y[nearest], unit: element.unit.clone(), bound })
    }

    /// The largest damping, at most one, that leads no unknown further than `part` of its way to a bound.
    pub(super) fn reach(&self, free: &[usize], y: &[f64], step: &[f64], part: f64) -> f64 {
        let way = |(&d, &at): (&f64, &usize)| {
            let room = if d < 0.0 { y[at] - self.low[at] } else { self.high[at] - y[at] };
            if d == 0.0 || room < 0.0 { 1.0 } else { part * room / d.abs() }
        };
        step.iter().zip(free).map(way).fold(1.0, f64::min)
    }

    /// A guess inside of the bounds, by number; around the present one where there are none.
    pub(crate) fn other_guess(&self, number: u64, free: &[usize], scales: &[f64], y: &mut [f64]) {
        for (i, &at) in free.iter().enumerate() {
            let part = uniform(number << 32 | i as u64);
            let (low, high) = (self.low[at], self.high[at]);
            y[at] = match (low.is_finite(), high.is_finite()) {
                (true, true) => low + part * (high - low),
                (true, false) => low + 2.0 * part * (y[at] - low).max(scales[at]),
                (false, true) => high - 2.0 * part * (high - y[at]).max(scales[at]),
                (false, false) => y[at] + (2.0 * part - 1.0) * scales[at].max(y[at].abs()),
            };
        }
    }

    /// The refusal of a root with an unknown outside.
    pub(super) fn refusal(&self, catalogue: &Catalogue, at: usize, value: f64) -> SteadyError {
        let below = value < self.low[at];
        let element = all(catalogue).find(|e| e.at == at);
        SteadyError::Outside {
            name: element.map(|e| e.name.clone()).unwrap_or_default(),
            unit: element.map(|e| e.unit.clone()).unwrap_or_default(),
            bound: if below { self.low[at] } else { self.high[at] },
            value,
            below,
        }
    }
}

fn all(catalogue: &Catalogue) -> impl Iterator<Item = &Element> {
    catalogue.states.elements().iter().chain(catalogue.solved.elements())
}

/// A number in (0, 1) for each seed, always the same: Vigna's splitmix64.
fn uniform(seed: u64) -> f64 {
    let mut z = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64 + f64::EPSILON / 4.0
}
