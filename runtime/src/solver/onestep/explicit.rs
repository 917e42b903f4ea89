//! Steps by the explicit Runge–Kutta method DOP853.

use super::super::System;
use super::dop853::*;
use super::frame::{Frame, surround};
use super::numbers::{Quad, Quads, bound_bow, combine, place_stage, set, weighted, widened, zeros};

/// Factor of the error of order 5 for a doubtful step. With it, 400 random chains of kinks (half
/// waves, 1 to 24 in an interval, tolerances 1e-4 to 1e-8) were within half of their bound. Without
/// it one in 400 exceeded the bound, for 3 % fewer evaluations.
const DOUBT: f64 = 10.0;

/// Factor of the error of order 3 where a kink may be in any step: as large as that of order 5
/// there, and seldom small with it.
const CHANCE: f64 = 0.03;

/// Mean of the errors of orders 5 and 3, in tolerances, below which that of order 4 is within them.
const SMALL: f64 = 0.5;

/// Space for a step, and its polynomial.
pub(super) struct Explicit {
    /// Rates at stages 2 to 12, then at those of the dense output.
    k: [Quads; 11],
    extra: [Quads; 3],
    /// Unknowns at a stage: at the end, those of stage 12.
    place: Quads,
    /// The estimate of the error of order 5, unknown by unknown.
    error: Quads,
    /// Sums of squares of the estimates of orders 5 and 3, in tolerances a unit of time.
    squares: [f64; 2],
    /// The polynomial: the value at the beginning and seven more terms.
    first: Quads,
    terms: [Quads; 7],
    begin: f64,
    length: f64,
}

impl Explicit {
    /// Space for so many unknowns.
    pub(super) fn new(n: usize) -> Self {
        let space = || zeros(n);
        Self {
            k: std::array::from_fn(|_| space()),
            extra: std::array::from_fn(|_| space()),
            place: space(),
            error: space(),
            squares: [0.0; 2],
            first: space(),
            terms: std::array::from_fn(|_| space()),
            begin: 0.0,
            length: 0.0,
        }
    }

    /// Takes a step from the frame's beginning to its end; the error in tolerances, not a number
    /// where something is not finite.
    pub(super) fn attempt(&mut self, frame: &mut Frame, system: &mut dyn System) -> f64 {
        take_stages(frame.n, self, frame, system)
    }

    #[inline(always)]
    fn stages(&mut self, frame: &mut Frame, system: &mut dyn System) -> f64 {
        let (t, h) = (frame.t, frame.h);
        let Frame { begin, begin_rates: k1, end, functions, .. } = frame;
        let (k1, place) = (&*k1, &mut self.place);
        let [k2, k3, k4, k5, k6, k7, k8, k9, k10, k11, k12] = &mut self.k;
        macro_rules! stage {
            ($out:ident, $number:literal, $row:ident, $($from:expr),+) => {{
                place_stage(place, begin, h, &$row, [$(&*$from),+]);
                functions.rates(system, t + C[$number] * h, place, $out);
            }};
        }
        stage!(k2, 1, A2, k1);
        stage!(k3, 2, A3, k1, k2);
        stage!(k4, 3, A4, k1, k3);
        stage!(k5, 4, A5, k1, k3, k4);
        stage!(k6, 5, A6, k1, k4, k5);
        stage!(k7, 6, A7, k1, k4, k5, k6);
        stage!(k8, 7, A8, k1, k4, k5, k6, k7);
        stage!(k9, 8, A9, k1, k4, k5, k6, k7, k8);
        stage!(k10, 9, A10, k1, k4, k5, k6, k7, k8, k9);
        stage!(k11, 10, A11, k1, k4, k5, k6, k7, k8, k9, k10);
        stage!(k12, 11, A12, k1, k4, k5, k6, k7, k8, k9, k10, k11);
        combine(end, begin, h, &B, [k1, k6, k7, k8, k9, k10, k11, k12]);
        self.measure(frame)
    }

    /// Hairer's combination of the two estimates of the error. Where the step passes a kink, each
    /// of them is a difference of rates before and behind it, which vanishes for some of its
    /// places. Attempts of different lengths would find such a place, so that both have to be
    /// small, the one that is more exact by far.
    #[inline(always)]
    fn measure(&mut self, frame: &Frame) -> f64 {
        let [_, _, _, _, k6, k7, k8, k9, k10, k11, k12] = &self.k;
        let terms = [&frame.begin_rates[..], k6, k7, k8, k9, k10, k11, k12];
        let [fifth, third] = frame.squares(|i| weighted(i, &E5, &terms), |i| weighted(i, &E3, &terms));
        self.squares = [fifth, third];
        if fifth == 0.0 {
            return 0.0;
        }
        if frame.doubtful {
            return frame.h * ((DOUBT * DOUBT * fifth).max(0.01 * third) / frame.n as f64).sqrt();
        }
        if frame.careful {
            return self.careful_error(frame);
        }
        frame.h * fifth / ((fifth + 0.01 * third) * frame.n as f64).sqrt()
    }

    /// The error of the last step where one of the two estimates may be small by chance.
    pub(crate) fn careful_error(&self, frame: &Frame) -> f64 {
        let [fifth, third] = self.squares;
        frame.h * (fifth.max(CHANCE * CHANCE * third) / frame.n as f64).sqrt()
    }

    /// The error of the last step, unknown by unknown.
    pub(super) fn error(&mut self, frame: &Frame) -> &[Quad] {
        let [_, _, _, _, k6, k7, k8, k9, k10, k11, k12] = &self.k;
        let terms = [&frame.begin_rates[..], k6, k7, k8, k9, k10, k11, k12];
        for (i, out) in self.error.iter_mut().enumerate() {
            *out = weighted(i, &E5, &terms);
        }
        &self.error
    }

    /// Returns `true` if the error of a method of order 4 would have been small in the last step:
    /// that between its estimates of orders 5 and 3.
    pub(crate) fn suits_less(&self, frame: &Frame) -> bool {
        let [fifth, third] = self.squares.map(|square| frame.h * frame.h * square / frame.n as f64);
        fifth * third < SMALL * SMALL * SMALL * SMALL
    }

    /// The largest eigenvalue that the last step met times its length, about: rates and states of
    /// the last two stages (Hairer and Wanner, *Solving Ordinary Differential Equations II*,
    /// section IV.2).
    pub(crate) fn stiffness(&self, frame: &Frame) -> f64 {
        let last = &self.k[10];
        let difference = |a: &[Quad], b: &[Quad], i: usize| std::array::from_fn(|lane| a[i][lane] - b[i][lane]);
        let [rates, states] = frame.squares(|i| difference(&frame.end_rates, last, i), |i| difference(&frame.end, &self.place, i));
        if states > 0.0 { frame.h * (rates / states).sqrt() } else { 0.0 }
    }

    /// A box around the unknowns in some fours over the last step: they move by twice the fastest
    /// rate at most that the stages met.
    #[inline]
    pub(super) fn surround(&self, frame: &Frame, fours: &[u32], least: &mut [Quad], most: &mut [Quad]) {
        let [_, _, _, _, k6, k7, _, k9, k10, k11, _] = &self.k;
        surround(frame, fours, [&frame.begin_rates, k6, k7, k9, k10, k11, &frame.end_rates], (least, most));
    }

    /// Bounds of the unknowns in some fours over the last step without its polynomial. They are
    /// those of Hermite's cubic, widened by the difference of the rates of inner stages from its
    /// slopes. What is added to the cubic is zero at both ends, so that it is half of that at most.
    pub(super) fn enclose(&self, frame: &Frame, fours: &[u32], least: &mut [Quad], most: &mut [Quad]) {
        let h = frame.h;
        let [_, _, _, _, k6, k7, k8, k9, k10, k11, _] = &self.k;
        let inner = [(5, k6), (6, k7), (7, k8), (8, k9), (9, k10), (10, k11)];
        for &i in fours {
            let i = i as usize;
            let (first, last, k1, k13) = (&frame.begin[i], &frame.end[i], &frame.begin_rates[i], &frame.end_rates[i]);
            let rise: Quad = std::array::from_fn(|lane| last[lane] - first[lane]);
            let bow: Quad = std::array::from_fn(|lane| h * k1[lane] - rise[lane]);
            let tilt: Quad = std::array::from_fn(|lane| 2.0 * rise[lane] - h * (k1[lane] + k13[lane]));
            let mut off = [0.0_f64; 4];
            for (stage, k) in inner {
                let x = C[stage];
                for lane in 0..off.len() {
                    let slope = rise[lane] + (1.0 - 2.0 * x) * (bow[lane] + x * tilt[lane]) + x * (1.0 - x) * tilt[lane];
                    let differs = (h * k[i][lane] - slope).abs();
                    off[lane] = if differs > off[lane] { differs } else { off[lane] };
                }
            }
            bound_bow((first, last), (&mut least[i], &mut most[i]), |lane| {
                (bow[lane] + tilt[lane].min(0.0), bow[lane] + tilt[lane].max(0.0))
            });
            for lane in 0..off.len() {
                least[i][lane] -= off[lane];
                most[i][lane] += off[lane];
            }
        }
    }

    /// Makes the polynomial of the last step: three more evaluations.
    pub(super) fn prepare(&mut self, frame: &mut Frame, system: &mut dyn System) {
        let (t, h) = (frame.t, frame.h);
        let Frame { begin, begin_rates: k1, end, end_rates: k13, functions, .. } = frame;
        let (k1, k13, place) = (&*k1, &*k13, &mut self.place);
        let [_, _, _, _, k6, k7, k8, k9, k10, k11, k12] = &self.k;
        let [k14, k15, k16] = &mut self.extra;
        place_stage(place, begin, h, &A14, [k1, k7, k8, k9, k10, k11, k12, k13]);
        functions.rates(system, t + C[13] * h, place, k14);
        place_stage(place, begin, h, &A15, [k1, k6, k7, k8, k11, k12, k13, k14]);
        functions.rates(system, t + C[14] * h, place, k15);
        place_stage(place, begin, h, &A16, [k1, k6, k7, k8, k9, k13, k14, k15]);
        functions.rates(system, t + C[15] * h, place, k16);
        self.first.copy_from_slice(begin);
        let [f0, f1, f2, higher @ ..] = &mut self.terms;
        set(f0, |i, lane| end[i][lane] - begin[i][lane]);
        set(f1, |i, lane| h * k1[i][lane] - f0[i][lane]);
        set(f2, |i, lane| 2.0 * f0[i][lane] - h * (k1[i][lane] + k13[i][lane]));
        let terms = [&k1[..], k6, k7, k8, k9, k10, k11, k12, k13, k14, k15, k16];
        for (term, factors) in higher.iter_mut().zip(&D) {
            for (i, term) in term.iter_mut().enumerate() {
                *term = weighted(i, factors, &terms).map(|x| h * x);
            }
        }
        (self.begin, self.length) = (t, h);
    }

    /// Unknowns, and derivatives where they are asked for, at a time within the last step.
    pub(super) fn interpolate(&self, t: f64, y: &mut [Quad], yp: Option<&mut [Quad]>) {
        let x = ((t - self.begin) / self.length).clamp(0.0, 1.0);
        let (rest, per_length) = (1.0 - x, 1.0 / self.length);
        let Some(yp) = yp else {
            let terms = || self.terms.iter().enumerate().rev();
            let sum = |i: usize, lane: usize| terms().fold(0.0, |sum, (k, term)| (sum + term[i][lane]) * if k % 2 == 0 { x } else { rest });
            return set(y, |i, lane| self.first[i][lane] + sum(i, lane));
        };
        for (i, (y, yp)) in y.iter_mut().zip(yp).enumerate() {
            let (mut values, mut slopes): (Quad, Quad) = ([0.0; 4], [0.0; 4]);
            for (k, term) in self.terms.iter().enumerate().rev() {
                let (factor, sign) = if k % 2 == 0 { (x, 1.0) } else { (rest, -1.0) };
                for ((value, slope), term) in values.iter_mut().zip(&mut slopes).zip(&term[i]) {
                    *value += term;
                    *slope = *slope * factor + sign * *value;
                    *value *= factor;
                }
            }
            *y = std::array::from_fn(|lane| self.first[i][lane] + values[lane]);
            *yp = slopes.map(|x| x * per_length);
        }
    }
}

widened! {
    fn take_stages(explicit: &mut Explicit, frame: &mut Frame, system: &mut dyn System) -> f64 = Explicit::stages
}
