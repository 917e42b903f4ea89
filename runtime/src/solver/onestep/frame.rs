//! Start and end of a step of any method, and the counted functions of the system.

use super::super::callbacks::Trouble;
use super::super::linear::columns::all_finite;
use super::super::{Settings, Statistics, System};
use super::numbers::{Quad, Quads, entries, entries_mut, filled, from, zeros};

/// Start and end of a step.
pub(super) struct Frame {
    /// Number of unknowns.
    pub n: usize,
    /// True if time occurs in the equations.
    pub timed: bool,
    /// Something turns so often that an estimate of the error may be small by chance.
    pub careful: bool,
    /// And an attempt was so far off that something in this step is not smooth.
    pub doubtful: bool,
    /// Error of the last accepted step, in tolerances.
    pub error: f64,
    /// Time and length of the step.
    pub t: f64,
    pub h: f64,
    /// Unknowns where it begins and ends.
    pub begin: Quads,
    pub end: Quads,
    /// Rates there, F(t, y, 0): derivatives on differential rows, what should be zero on algebraic
    /// ones.
    pub begin_rates: Quads,
    pub end_rates: Quads,
    /// 1 on differential rows, 0 on algebraic ones and behind the last.
    pub mass: Quads,
    /// 1 for unknowns in the error test; where there are derivatives along directions, how much
    /// each counts.
    tested: Quads,
    rtol: f64,
    atol: Quads,
    pub functions: Functions,
}

/// The functions of the system.
pub(super) struct Functions {
    n: usize,
    pub counts: Statistics,
    /// Last failure.
    pub trouble: Option<Trouble>,
    /// Looks at every residual for what is not finite.
    pub checks: bool,
    zeros: Quads,
}

impl Frame {
    pub(super) fn new(system: &dyn System, settings: &Settings) -> Self {
        let n = system.dimension();
        let differential = || system.differential().iter().map(|&d| f64::from(u8::from(d)));
        let leading = n / (1 + system.directions());
        // Unknowns that derivatives follow count as much as if they were alone.
        let (alone, following) = ((n as f64 / leading.max(1) as f64).sqrt(), 1.0 / settings.looseness);
        let importance = |i: usize| if i < leading { alone } else { following };
        let tested = match settings.algebraic_error_control {
            true => from((0..n).map(importance), n, 0.0),
            false => from(differential().enumerate().map(|(i, differential)| importance(i) * differential), n, 0.0),
        };
        Self {
            n,
            timed: system.depends_on_time(),
            careful: false,
            error: 0.0,
            doubtful: false,
            t: 0.0,
            h: 0.0,
            begin: zeros(n),
            end: zeros(n),
            begin_rates: zeros(n),
            end_rates: zeros(n),
            mass: from(differential(), n, 0.0),
            tested,
            rtol: settings.rtol,
            atol: from(settings.atol.iter().copied(), n, 1.0),
            functions: Functions { n, counts: Statistics::default(), trouble: None, checks: false, zeros: filled(n, 0.0) },
        }
    }

    /// Reciprocal tolerances of four unknowns over the step.
    #[inline(always)]
    fn weights(&self, i: usize) -> Quad {
        let (begin, end, atol) = (&self.begin[i], &self.end[i], &self.atol[i]);
        let mut weights = self.tested[i];
        for lane in 0..weights.len() {
            weights[lane] /= atol[lane] + self.rtol * begin[lane].abs().max(end[lane].abs());
        }
        weights
    }

    /// Sums of squares over the unknowns, in tolerances, of two vectors.
    #[inline(always)]
    pub(super) fn squares(&self, mut first: impl FnMut(usize) -> Quad, mut second: impl FnMut(usize) -> Quad) -> [f64; 2] {
        let (mut a, mut b) = ([0.0; 4], [0.0; 4]);
        for i in 0..self.begin.len() {
            let weights = self.weights(i);
            add_squares(&mut a, first(i), weights);
            add_squares(&mut b, second(i), weights);
        }
        [a, b].map(|s| (s[0] + s[2]) + (s[1] + s[3]))
    }

    /// Reciprocal tolerance of unknown `at` over the step.
    pub(crate) fn reciprocal_tolerance(&self, at: usize) -> f64 {
        let (i, lane) = (at / 4, at % 4);
        1.0 / (self.atol[i][lane] + self.rtol * self.begin[i][lane].abs().max(self.end[i][lane].abs()))
    }

    /// The largest change of an unknown at the end of the step since `before`, in tolerances.
    pub(crate) fn largest_change(&self, before: &[Quad]) -> f64 {
        let (end, before) = (entries(&self.end, self.n), entries(before, self.n));
        let changes = end.iter().zip(before).enumerate().filter(|(_, (end, before))| end != before);
        changes.map(|(at, (end, before))| (end - before).abs() * self.reciprocal_tolerance(at)).fold(0.0, f64::max)
    }

    /// Root mean square over all unknowns of what is tested, in tolerances.
    #[inline(always)]
    pub(crate) fn norm(&self, x: &[Quad]) -> f64 {
        self.norm_of(|i| x[i])
    }

    /// The same of a vector that is made on the way.
    #[inline(always)]
    pub(crate) fn norm_of(&self, mut x: impl FnMut(usize) -> Quad) -> f64 {
        let mut squares = [0.0; 4];
        for i in 0..self.begin.len() {
            add_squares(&mut squares, x(i), self.weights(i));
        }
        (((squares[0] + squares[2]) + (squares[1] + squares[3])) / self.n as f64).sqrt()
    }

    /// The unknown that is largest, in tolerances; NaN is larger than all.
    pub(super) fn largest(&self, x: &[Quad]) -> Option<usize> {
        let sizes = (0..self.n).map(|at| (at, (x[at / 4][at % 4] * self.weights(at / 4)[at % 4]).abs()));
        let order = |x: f64| if x.is_nan() { f64::INFINITY } else { x };
        sizes.map(|(at, size)| (at, order(size))).filter(|&(_, size)| size > 0.0).max_by(|a, b| a.1.total_cmp(&b.1)).map(|(at, _)| at)
    }

    /// Rates at the end of the step.
    #[inline]
    pub(crate) fn evaluate_end(&mut self, system: &mut dyn System) {
        self.functions.rates(system, self.t + self.h, &self.end, &mut self.end_rates);
    }

    /// The end becomes the beginning.
    #[inline]
    pub(crate) fn go_on(&mut self, t: f64) {
        std::mem::swap(&mut self.begin, &mut self.end);
        std::mem::swap(&mut self.begin_rates, &mut self.end_rates);
        self.t = t;
    }

    pub(super) fn y(&self) -> &[f64] {
        entries(&self.begin, self.n)
    }

    pub(crate) fn y_mut(&mut self) -> &mut [f64] {
        entries_mut(&mut self.begin, self.n)
    }
}

/// Maximum ratio of the speed of unknowns between stages to that at stages.
const FASTER: f64 = 2.0;

/// A box around the unknowns in some fours, which move by no more over a step than so much faster
/// than the fastest of these rates.
#[inline(always)]
pub(super) fn surround<const N: usize>(frame: &Frame, fours: &[u32], rates: [&Quads; N], (least, most): (&mut [Quad], &mut [Quad])) {
    let reach = FASTER * frame.h;
    for &i in fours {
        let i = i as usize;
        let mut fastest = [0.0_f64; 4];
        for rate in rates {
            for (fastest, rate) in fastest.iter_mut().zip(&rate[i]) {
                *fastest = if rate.abs() > *fastest { rate.abs() } else { *fastest };
            }
        }
        for lane in 0..fastest.len() {
            least[i][lane] = frame.begin[i][lane] - reach * fastest[lane];
            most[i][lane] = frame.begin[i][lane] + reach * fastest[lane];
        }
    }
}

/// Adds the squares of four weighted numbers to sums.
#[inline(always)]
fn add_squares(sums: &mut Quad, x: Quad, weights: Quad) {
    for lane in 0..sums.len() {
        let scaled = x[lane] * weights[lane];
        sums[lane] += scaled * scaled;
    }
}

impl Functions {
    /// F(t, y, 0).
    #[inline]
    pub(super) fn rates(&mut self, system: &mut dyn System, t: f64, y: &[Quad], out: &mut [Quad]) {
        self.counts.residuals += 1;
        system.residual(t, entries(y, self.n), entries(&self.zeros, self.n), entries_mut(out, self.n));
        if self.checks {
            self.check(t, out);
        }
    }

    /// ∂F/∂t with y' = 0; whether the system gives it.
    pub(crate) fn by_time(&self, system: &mut dyn System, t: f64, y: &[Quad], out: &mut [Quad]) -> bool {
        let out = entries_mut(out, self.n);
        system.by_time(t, entries(y, self.n), entries(&self.zeros, self.n), out) && out.iter().all(|x| x.is_finite())
    }

    /// Notes what is not finite, the first time.
    #[cold]
    pub(super) fn check(&mut self, time: f64, rates: &[Quad]) {
        let found = entries(rates, self.n).iter().position(|x| !x.is_finite());
        if let (None, Some(row)) = (self.trouble, found) {
            self.trouble = Some(Trouble::Residual { time, row });
        }
    }

    /// ∂F/∂y + `cj` ∂F/∂y', with y' = 0; whether it is finite.
    #[inline]
    pub(super) fn jacobian(&mut self, system: &mut dyn System, t: f64, cj: f64, y: &[Quad], values: &mut [f64]) -> bool {
        self.counts.jacobians += 1;
        system.jacobian(t, entries(y, self.n), entries(&self.zeros, self.n), cj, values);
        let finite = all_finite(values);
        if !finite {
            let entry = values.iter().position(|x| !x.is_finite()).unwrap_or(0);
            self.trouble = Some(Trouble::Jacobian { time: t, entry });
        }
        finite
    }
}
