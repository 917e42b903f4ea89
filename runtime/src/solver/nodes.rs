//! Instants within a step at which a polynomial is taken through what was integrated.

/// Number of the instants: as many as the interpolant of the highest degree needs, DOP853's.
pub(crate) const NODES: usize = 8;

/// The instants in parts of the step, from 0 to 1: the extrema of a Chebyshev polynomial.
pub(crate) fn shares() -> [f64; NODES] {
    std::array::from_fn(|k| 0.5 - 0.5 * (std::f64::consts::PI * k as f64 / (NODES - 1) as f64).cos())
}

/// Unknowns and rates at these instants.
#[derive(Clone, Debug, Default)]
pub struct Nodes {
    times: [f64; NODES],
    /// One vector after another.
    y: Vec<f64>,
    yp: Vec<f64>,
}

impl Nodes {
    /// Those of a step between two times, with so many numbers at each.
    pub(crate) fn place(&mut self, (from, to): (f64, f64), length: usize) {
        self.times = shares().map(|share| if share == 1.0 { to } else { from + share * (to - from) });
        self.y.resize(NODES * length, 0.0);
        self.yp.resize(NODES * length, 0.0);
    }

    /// The instants.
    pub(crate) fn times(&self) -> [f64; NODES] {
        self.times
    }

    /// Unknowns and rates at an instant.
    pub(crate) fn at(&self, node: usize) -> (&[f64], &[f64]) {
        let length = self.y.len() / NODES;
        (&self.y[node * length..][..length], &self.yp[node * length..][..length])
    }

    /// Likewise, to be written.
    pub(crate) fn at_mut(&mut self, node: usize) -> (&mut [f64], &mut [f64]) {
        let length = self.y.len() / NODES;
        (&mut self.y[node * length..][..length], &mut self.yp[node * length..][..length])
    }
}
