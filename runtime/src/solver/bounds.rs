//! Declared bounds of the unknowns.

use crate::catalogue::Element;
use crate::failure::BOX_SLACK;

/// Lower and upper bounds by place in `y`, infinite if missing, with the slack of a box.
#[derive(Clone, Debug)]
pub struct Bounds {
    pub(crate) low: Box<[f64]>,
    pub(crate) high: Box<[f64]>,
    slack: Box<[f64]>,
    scale: Box<[f64]>,
}

impl Bounds {
    /// The bounds of some elements among `n` unknowns.
    pub(crate) fn new<'a>(elements: impl Iterator<Item = &'a Element>, n: usize) -> Self {
        let all = |value: f64| -> Box<[f64]> { vec![value; n].into() };
        let mut bounds = Self { low: all(f64::NEG_INFINITY), high: all(f64::INFINITY), slack: all(0.0), scale: all(1.0) };
        for element in elements {
            if element.scale.is_finite() && element.scale > 0.0 {
                bounds.scale[element.at] = element.scale;
            }
            if element.low.is_nan() || element.high.is_nan() {
                continue;
            }
            let range = element.high - element.low;
            let scale = if element.scale.is_finite() { element.scale.abs() } else { 1.0 };
            bounds.low[element.at] = element.low;
            bounds.high[element.at] = element.high;
            bounds.slack[element.at] = BOX_SLACK * if range.is_finite() { range.abs() } else { scale };
        }
        bounds
    }

    /// The same bounds behind an unknown that has none.
    pub(crate) fn behind_a_rest(&self) -> Self {
        let behind = |first: f64, list: &[f64]| std::iter::once(first).chain(list.iter().copied()).collect();
        Self {
            low: behind(f64::NEG_INFINITY, &self.low),
            high: behind(f64::INFINITY, &self.high),
            slack: behind(0.0, &self.slack),
            scale: behind(1.0, &self.scale),
        }
    }

    /// Returns whether an unknown has a bound.
    pub(crate) fn bind(&self) -> bool {
        self.low.iter().any(|low| low.is_finite()) || self.high.iter().any(|high| high.is_finite())
    }

    /// The unknown among `free` that is furthest outside, relative to its slack.
    pub(crate) fn outside(&self, free: &[usize], y: &[f64]) -> Option<usize> {
        let excess = |at: usize| (self.low[at] - y[at]).max(y[at] - self.high[at]) - self.slack[at];
        let relative = |at: usize| excess(at) / self.slack[at].max(f64::MIN_POSITIVE);
        free.iter().copied().filter(|&at| excess(at) > 0.0).max_by(|&a, &b| relative(a).total_cmp(&relative(b)))
    }

    /// Moves the unknowns of `free` that are outside to their bounds and returns whether there were
    /// any.
    pub(crate) fn clip(&self, free: &[usize], y: &mut [f64]) -> bool {
        let mut clipped = false;
        for &at in free {
            let bound = if y[at] < self.low[at] { self.low[at] } else { self.high[at] };
            if y[at] < self.low[at] || y[at] > self.high[at] {
                y[at] = bound;
                clipped = true;
            }
        }
        clipped
    }

    /// The largest damping, at most one, that leads no unknown further than `part` of its way to a
    /// bound.
    pub(crate) fn reach(&self, free: &[usize], y: &[f64], step: &[f64], part: f64) -> f64 {
        let way = |(&d, &at): (&f64, &usize)| {
            let room = if d < 0.0 { y[at] - self.low[at] } else { self.high[at] - y[at] };
            if d == 0.0 || room < 0.0 { 1.0 } else { part * room / d.abs() }
        };
        step.iter().zip(free).map(way).fold(1.0, f64::min)
    }

    /// A guess inside of the bounds, by number; around the present one if missing.
    pub(crate) fn other_guess(&self, number: u64, free: &[usize], y: &mut [f64]) {
        for (i, &at) in free.iter().enumerate() {
            let part = uniform(number << 32 | i as u64);
            let (low, high, scale) = (self.low[at], self.high[at], self.scale[at]);
            y[at] = match (low.is_finite(), high.is_finite()) {
                (true, true) => low + part * (high - low),
                (true, false) => low + 2.0 * part * (y[at] - low).max(scale),
                (false, true) => high - 2.0 * part * (high - y[at]).max(scale),
                (false, false) => y[at] + (2.0 * part - 1.0) * scale.max(y[at].abs()),
            };
        }
    }

    /// The distance of two points in ranges, or scales where bounds are open: the largest over
    /// `free`.
    pub(crate) fn distance(&self, free: &[usize], a: &[f64], b: &[f64]) -> f64 {
        let one = |&at: &usize| (a[at] - b[at]).abs() / (self.slack[at] / BOX_SLACK).max(f64::MIN_POSITIVE);
        let bound = |at: &&usize| self.low[**at].is_finite() || self.high[**at].is_finite();
        free.iter().filter(bound).map(one).fold(0.0, f64::max)
    }
}

/// A number in (0, 1) for each seed, always the same: Vigna's splitmix64.
fn uniform(seed: u64) -> f64 {
    let mut z = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64 + f64::EPSILON / 4.0
}
