//! Steps by the explicit Runge–Kutta pair Tsit5, of order 5: half the evaluations of DOP853 where
//! one step reaches the end.

use super::super::System;
use super::frame::{Frame, surround};
use super::numbers::{Quad, Quads, bound_bow, combine, place_stage, set, weighted, widened, zeros};
use super::tsit5::*;

/// Space for a step, and its polynomial.
pub(super) struct Short {
    /// Rates at stages 2 to 6.
    k: [Quads; 5],
    /// Unknowns at a stage.
    place: Quads,
    /// The polynomial: the value at the beginning and four powers.
    first: Quads,
    terms: [Quads; 4],
    begin: f64,
    length: f64,
}

impl Short {
    /// Space for so many unknowns.
    pub(super) fn new(n: usize) -> Self {
        let space = || zeros(n);
        Self {
            k: std::array::from_fn(|_| space()),
            place: space(),
            first: space(),
            terms: std::array::from_fn(|_| space()),
            begin: 0.0,
            length: 0.0,
        }
    }

    /// Takes a step from the frame's beginning to its end, rates there included; the error in
    /// tolerances, not a number where something is not finite.
    pub(super) fn attempt(&mut self, frame: &mut Frame, system: &mut dyn System) -> f64 {
        take_stages(frame.n, self, frame, system)
    }

    #[inline(always)]
    fn stages(&mut self, frame: &mut Frame, system: &mut dyn System) -> f64 {
        let (t, h) = (frame.t, frame.h);
        let Frame { begin, begin_rates: k1, end, end_rates: k7, functions, .. } = frame;
        let (k1, place) = (&*k1, &mut self.place);
        let [k2, k3, k4, k5, k6] = &mut self.k;
        macro_rules! stage {
            ($out:ident, $number:literal, $row:ident, $($from:expr),+) => {{
                place_stage(place, begin, h, &$row, [$(&*$from),+]);
                functions.rates(system, t + C[$number] * h, place, $out);
            }};
        }
        stage!(k2, 1, A2, k1);
        stage!(k3, 2, A3, k1, k2);
        stage!(k4, 3, A4, k1, k2, k3);
        stage!(k5, 4, A5, k1, k2, k3, k4);
        stage!(k6, 5, A6, k1, k2, k3, k4, k5);
        combine(end, begin, h, &B, [k1, k2, k3, k4, k5, k6]);
        functions.rates(system, t + h, end, k7);
        let terms = [&frame.begin_rates[..], k2, k3, k4, k5, k6, &frame.end_rates];
        frame.h * frame.norm_of(|i| weighted(i, &E, &terms))
    }

    /// A box around the unknowns in some fours over the last step, as for DOP853.
    #[inline]
    pub(super) fn surround(&self, frame: &Frame, fours: &[u32], least: &mut [Quad], most: &mut [Quad]) {
        let [k2, k3, k4, k5, k6] = &self.k;
        surround(frame, fours, [&frame.begin_rates, k2, k3, k4, k5, k6, &frame.end_rates], (least, most));
    }

    /// Bounds of the unknowns in some fours over the last step.
    pub(super) fn enclose(&self, frame: &Frame, fours: &[u32], least: &mut [Quad], most: &mut [Quad]) {
        let [k2, k3, k4, k5, k6] = &self.k;
        let stages = [&frame.begin_rates[..], k2, k3, k4, k5, k6, &frame.end_rates];
        for &i in fours {
            let i = i as usize;
            let [b, c, d] = [1, 2, 3].map(|term| weighted(i, &D[term], &stages).map(|x| -frame.h * x));
            bound_bow((&frame.begin[i], &frame.end[i]), (&mut least[i], &mut most[i]), |lane| {
                let (b, c, d) = (b[lane], c[lane], d[lane]);
                (b + c.min(2.0 * c) + d.min(3.0 * d), b + c.max(2.0 * c) + d.max(3.0 * d))
            });
        }
    }

    /// Makes the polynomial of the last step.
    pub(super) fn prepare(&mut self, frame: &Frame) {
        let [k2, k3, k4, k5, k6] = &self.k;
        let stages = [&frame.begin_rates[..], k2, k3, k4, k5, k6, &frame.end_rates];
        self.first.copy_from_slice(&frame.begin);
        for (term, factors) in self.terms.iter_mut().zip(&D) {
            for (i, term) in term.iter_mut().enumerate() {
                *term = weighted(i, factors, &stages).map(|x| frame.h * x);
            }
        }
        (self.begin, self.length) = (frame.t, frame.h);
    }

    /// Unknowns, and derivatives where they are asked for, at a time within the last step.
    pub(super) fn interpolate(&self, t: f64, y: &mut [Quad], yp: Option<&mut [Quad]>) {
        let x = ((t - self.begin) / self.length).clamp(0.0, 1.0);
        let per_length = 1.0 / self.length;
        let [a, b, c, d] = &self.terms;
        let Some(yp) = yp else {
            let power = |i: usize, lane: usize| a[i][lane] + x * (b[i][lane] + x * (c[i][lane] + x * d[i][lane]));
            return set(y, |i, lane| self.first[i][lane] + x * power(i, lane));
        };
        for (i, (y, yp)) in y.iter_mut().zip(yp).enumerate() {
            for (lane, (y, yp)) in y.iter_mut().zip(yp).enumerate() {
                let (a, b, c, d) = (a[i][lane], b[i][lane], c[i][lane], d[i][lane]);
                *y = self.first[i][lane] + x * (a + x * (b + x * (c + x * d)));
                *yp = per_length * (a + x * (2.0 * b + x * (3.0 * c + x * (4.0 * d))));
            }
        }
    }
}

widened! {
    fn take_stages(short: &mut Short, frame: &mut Frame, system: &mut dyn System) -> f64 = Short::stages
}
