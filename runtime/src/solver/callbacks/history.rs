//! The unknowns that root functions read, at the steps that IDA accepted last: what bounds of them
//! over the last step follow from.
//!
//! IDA's polynomial of order q goes through the last q + 1 accepted states (K. E. Brenan, S. L.
//! Campbell and L. R. Petzold, *Numerical Solution of Initial-Value Problems in
//! Differential-Algebraic Equations*, SIAM 1996, section 5.2). It is kept by Newton's divided
//! differences.

use crate::solver::System;
use crate::solver::enclosure::Enclosure;
use crate::solver::safe::Safe;
use crate::solver::vector::Vector;

/// Points of the polynomial of the highest order.
const POINTS: usize = 6;

/// Changes over the last steps from which a box around the last one follows, and how much faster
/// unknowns may be within a step than over these.
const CHANGES: usize = 3;
const FASTER: f64 = 8.0;

/// The last accepted steps.
pub(crate) struct History {
    pub(super) unknowns: Box<[u32]>,
    /// Times, the last one first, and the unknowns there.
    times: [f64; POINTS],
    values: [Box<[f64]>; POINTS],
    count: usize,
    /// Divided differences, and the degree.
    differences: [Box<[f64]>; POINTS],
    degree: usize,
    enclosure: Enclosure,
    /// Bounds of all unknowns; only of those that are read are they up to date.
    pub(super) least: Box<[f64]>,
    pub(super) most: Box<[f64]>,
    pub(super) safe: Safe,
    /// Unknowns within the last step.
    pub(super) inside: Vector,
}

impl History {
    /// Of the unknowns that root functions of a system read, with a vector of all unknowns.
    pub(crate) fn new(system: &dyn System, inside: Vector) -> Self {
        let unknowns = system.watched_unknowns();
        let numbers = |n: usize| vec![0.0; n].into_boxed_slice();
        let (few, all) = (unknowns.len(), inside.entries().len());
        Self {
            unknowns: unknowns.into(),
            times: [0.0; POINTS],
            values: std::array::from_fn(|_| numbers(few)),
            count: 0,
            differences: std::array::from_fn(|_| numbers(few)),
            degree: 0,
            enclosure: Enclosure::new(few),
            least: numbers(all),
            most: numbers(all),
            safe: Safe::new(all, system),
            inside,
        }
    }

    /// An integration begins.
    pub(crate) fn begin(&mut self, time: f64, y: &[f64]) {
        self.count = 0;
        self.push(time, y);
    }

    /// Takes an accepted state; whether it is another one than the last.
    pub(super) fn push(&mut self, time: f64, y: &[f64]) -> bool {
        if self.count > 0 && self.times[0] == time {
            return false;
        }
        self.times.copy_within(0..POINTS - 1, 1);
        self.values.rotate_right(1);
        self.times[0] = time;
        for (value, &at) in self.values[0].iter_mut().zip(&self.unknowns) {
            *value = y[at as usize];
        }
        self.count = (self.count + 1).min(POINTS);
        true
    }

    /// A box around the unknowns over the last step, found at once: they move within it by no more
    /// than so much faster than over the last few steps.
    pub(super) fn surround(&mut self) {
        let step = self.times[0] - self.times[1];
        let changes = CHANGES.min(self.count - 1);
        let [a, b, c, d, ..] = &self.values;
        let per: [f64; CHANGES] =
            std::array::from_fn(|k| if k < changes { FASTER * step / (self.times[k] - self.times[k + 1]) } else { 0.0 });
        for (i, &at) in self.unknowns.iter().enumerate() {
            let (last, older, oldest) = ((a[i] - b[i]).abs() * per[0], (b[i] - c[i]).abs() * per[1], (c[i] - d[i]).abs() * per[2]);
            let reach = last.max(older).max(oldest);
            self.least[at as usize] = a[i] - reach;
            self.most[at as usize] = a[i] + reach;
        }
    }

    /// An unknown that root functions read, by its number among these.
    pub(crate) fn unknown(&self, number: usize) -> Option<usize> {
        self.unknowns.get(number).map(|&at| at as usize)
    }

    /// The time at which the last step began.
    pub(crate) fn step_began(&self) -> f64 {
        self.times[1]
    }

    /// Makes the polynomial of the last step, of this order if there are points for it. Bounds the
    /// unknowns over the step by the straight line between its ends and by the curvature.
    pub(super) fn enclose_step(&mut self, order: usize) {
        let degree = order.min(self.count.saturating_sub(1));
        self.degree = degree;
        let times = &self.times;
        let mut per_time = [[0.0; POINTS]; POINTS];
        for (level, per_time) in per_time.iter_mut().enumerate().take(degree + 1).skip(1) {
            for (k, per_time) in per_time.iter_mut().enumerate().take(degree + 1).skip(level) {
                *per_time = 1.0 / (times[k] - times[k - level]);
            }
        }
        // The product of the first two factors lies between -step²/4 and 0; the other times are
        // before both ends of the step.
        let step = times[0] - times[1];
        let bow = 0.25 * step * step;
        for (i, &at) in self.unknowns.iter().enumerate() {
            let mut differences: [f64; POINTS] = std::array::from_fn(|k| self.values[k][i]);
            for (level, per_time) in per_time.iter().enumerate().take(degree + 1).skip(1) {
                for k in (level..=degree).rev() {
                    differences[k] = (differences[k] - differences[k - 1]) * per_time[k];
                }
            }
            let (mut low, mut high) = (0.0_f64, 0.0_f64);
            for k in (2..=degree).rev() {
                let (near, far) = (times[1] - times[k], times[0] - times[k]);
                low = (low * near).min(low * far) + differences[k];
                high = (high * near).max(high * far) + differences[k];
            }
            let (end, begin) = (self.values[0][i], self.values[1][i]);
            self.least[at as usize] = end.min(begin) - bow * high.max(0.0);
            self.most[at as usize] = end.max(begin) - bow * low.min(0.0);
            self.differences.iter_mut().zip(differences).for_each(|(to, from)| to[i] = from);
        }
    }

    /// Bounds of the unknowns over a part of the last step.
    pub(super) fn enclose(&mut self, span: (f64, f64)) {
        let Self { times, differences, degree, enclosure, .. } = self;
        let bounded: Result<(), std::convert::Infallible> = enclosure.bound(*degree, span, |t, out| {
            for (i, out) in out.iter_mut().enumerate() {
                *out = (0..*degree).rev().fold(differences[*degree][i], |x, k| x * (t - times[k]) + differences[k][i]);
            }
            Ok(())
        });
        let Ok(()) = bounded;
        for (i, &at) in self.unknowns.iter().enumerate() {
            self.least[at as usize] = self.enclosure.least[i];
            self.most[at as usize] = self.enclosure.most[i];
        }
    }

    /// A box around the last accepted state, as wide as tolerances say.
    pub(super) fn enclose_tolerances(&mut self, tolerance: impl Fn(usize, f64) -> f64) {
        for (&at, &value) in self.unknowns.iter().zip(&self.values[0]) {
            let tolerance = tolerance(at as usize, value);
            self.least[at as usize] = value - tolerance;
            self.most[at as usize] = value + tolerance;
        }
    }
}
