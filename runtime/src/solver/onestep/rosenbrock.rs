//! Steps by the Rosenbrock method Rodas5P.

use super::super::callbacks::Trouble;
use super::super::{LinearSolver, SolveError, System};
use super::frame::Frame;
use super::matrix::Matrix;
use super::numbers::{Quad, Quads, combine, entries_mut, set, weighted, zeros};
use super::rodas5p::*;

/// Distance of the points at which ∂f/∂t is taken, in parts of the step.
const TIME_DIFFERENCE: f64 = 1e-4;

/// Space for a step, and its polynomial.
pub struct Rosenbrock {
    matrix: Matrix,
    values: Box<[f64]>,
    columns: Box<[u32]>,
    rows: Box<[u32]>,
    /// The stages.
    u: [Quads; 8],
    /// Unknowns and rates at a stage, then the right-hand side.
    place: Quads,
    rates: Quads,
    right: Quads,
    /// ∂f/∂t.
    slope: Quads,
    /// The polynomial: values at both ends and three more terms.
    terms: [Quads; 5],
    begin: f64,
    length: f64,
}

impl Rosenbrock {
    /// Space for a system's dimension and pattern.
    ///
    /// # Errors
    /// What the linear solvers say of the pattern.
    pub fn new(system: &dyn System, choice: LinearSolver) -> Result<Self, SolveError> {
        let (n, pattern) = (system.dimension(), system.pattern());
        let space = || zeros(n);
        Ok(Self {
            matrix: Matrix::new(pattern, choice)?,
            values: vec![0.0; pattern.entries()].into(),
            columns: (0..n).flat_map(|column| pattern.column(column).map(move |_| column as u32)).collect(),
            rows: pattern.rows().iter().map(|&row| row as u32).collect(),
            u: std::array::from_fn(|_| space()),
            place: space(),
            rates: space(),
            right: space(),
            slope: space(),
            terms: std::array::from_fn(|_| space()),
            begin: 0.0,
            length: 0.0,
        })
    }

    /// Forgets the pivots of earlier factorisations.
    pub fn forget(&mut self) {
        self.matrix.forget();
    }

    /// Where entries of the pattern stand, for messages.
    pub fn place_of(&self, entry: usize) -> (usize, usize) {
        (self.rows[entry] as usize, self.columns[entry] as usize)
    }

    /// Takes a step from the frame's beginning to its end; the error in tolerances, not a number where something is not finite.
    pub fn attempt(&mut self, frame: &mut Frame, system: &mut dyn System) -> f64 {
        let (t, h) = (frame.t, frame.h);
        let functions = &mut frame.functions;
        if !functions.jacobian(system, t, 1.0 / (h * GAMMA), &frame.begin, &mut self.values) {
            return f64::NAN;
        }
        functions.counts.factorisations += 1;
        if let Err(singular) = self.matrix.factorise(&self.values) {
            functions.trouble.get_or_insert(Trouble::Singular { time: t, column: singular.column });
            return f64::NAN;
        }
        if frame.timed {
            self.differentiate_by_time(frame, system);
        }
        self.stages(frame, system);
        let [.., last] = &self.u;
        set(&mut frame.end, |i, lane| self.place[i][lane] + last[i][lane]);
        frame.norm(last)
    }

    fn stages(&mut self, frame: &mut Frame, system: &mut dyn System) {
        let (t, h, timed) = (frame.t, frame.h, frame.timed);
        let Frame { begin, begin_rates, mass, functions, .. } = frame;
        let Self { matrix, u, place, rates, right, slope, .. } = self;
        functions.counts.linear_solves += 8;
        let [u1, u2, u3, u4, u5, u6, u7, u8] = u;
        let slope = |stage: usize| (h * SLOPES[stage], &**slope);
        first(right, begin_rates, timed.then(|| slope(0)));
        matrix.solve_negative(right, u1);
        macro_rules! stage {
            ($number:literal, $out:ident, $c:ident, $($from:ident),+) => {{
                functions.rates(system, t + NODES[$number] * h, place, rates);
                let slope = (timed && $number < 5).then(|| slope($number.min(4)));
                add(right, rates, mass, 1.0 / h, &$c, [$(&*$from),+], slope);
                matrix.solve_negative(right, $out);
            }};
        }
        combine(place, begin, 1.0, &A2, [&*u1]);
        stage!(1, u2, C2, u1);
        combine(place, begin, 1.0, &A3, [&*u1, &*u2]);
        stage!(2, u3, C3, u1, u2);
        combine(place, begin, 1.0, &A4, [&*u1, &*u2, &*u3]);
        stage!(3, u4, C4, u1, u2, u3);
        combine(place, begin, 1.0, &A5, [&*u1, &*u2, &*u3, &*u4]);
        stage!(4, u5, C5, u1, u2, u3, u4);
        combine(place, begin, 1.0, &A6, [&*u1, &*u2, &*u3, &*u4, &*u5]);
        stage!(5, u6, C6, u1, u2, u3, u4, u5);
        increase(place, u6);
        stage!(6, u7, C7, u1, u2, u3, u4, u5, u6);
        increase(place, u7);
        stage!(7, u8, C8, u1, u2, u3, u4, u5, u6, u7);
    }

    /// ∂f/∂t as the system gives it, or by a difference of order two, inside of the step: the equations may be of another form before it.
    fn differentiate_by_time(&mut self, frame: &mut Frame, system: &mut dyn System) {
        let (t, functions) = (frame.t, &mut frame.functions);
        if functions.by_time(system, t, &frame.begin, &mut self.slope) {
            return;
        }
        let next = |from: f64| {
            let least = 1e3 * f64::EPSILON * t.abs();
            from + (TIME_DIFFERENCE * frame.h).max(least).min(0.5 * frame.h)
        };
        let middle = next(t);
        let far = next(middle);
        functions.rates(system, middle, &frame.begin, &mut self.rates);
        functions.rates(system, far, &frame.begin, &mut self.right);
        let (a, b) = (middle - t, far - t);
        let (first, second) = (b / (a * (b - a)), -a / (b * (b - a)));
        let (rates, right, now) = (&self.rates, &self.right, &frame.begin_rates);
        set(&mut self.slope, |i, lane| first * (rates[i][lane] - now[i][lane]) + second * (right[i][lane] - now[i][lane]));
    }

    /// The largest row sum of |∂f/∂y| in tolerances, which bounds its spectral radius, at the beginning of the last step.
    pub(crate) fn spectral_bound(&mut self, frame: &Frame) -> f64 {
        let (weights, sums) = (entries_mut(&mut self.right, frame.n), entries_mut(&mut self.rates, frame.n));
        weights.iter_mut().enumerate().for_each(|(at, weight)| *weight = frame.reciprocal_tolerance(at));
        sums.fill(0.0);
        let diagonal = 1.0 / (frame.h * GAMMA);
        for ((&value, &row), &column) in self.values.iter().zip(&self.rows).zip(&self.columns) {
            let value = if row == column { value + diagonal } else { value };
            sums[row as usize] += value.abs() / weights[column as usize];
        }
        sums.iter().zip(&*weights).map(|(sum, weight)| sum * weight).fold(0.0, f64::max)
    }

    /// Makes the polynomial of the last step.
    pub fn prepare(&mut self, frame: &Frame) {
        let [u1, u2, u3, u4, u5, u6, u7, u8] = &self.u;
        let [first, last, higher @ ..] = &mut self.terms;
        first.copy_from_slice(&frame.begin);
        last.copy_from_slice(&frame.end);
        for (term, factors) in higher.iter_mut().zip(&H) {
            for (i, term) in term.iter_mut().enumerate() {
                *term = weighted(i, factors, &[&u1[..], &u2[..], &u3[..], &u4[..], &u5[..], &u6[..], &u7[..], &u8[..]]);
            }
        }
        (self.begin, self.length) = (frame.t, frame.h);
    }

    /// Unknowns and derivatives at a time within the last step.
    pub fn interpolate(&self, t: f64, y: &mut [Quad], yp: &mut [Quad]) {
        let x = ((t - self.begin) / self.length).clamp(0.0, 1.0);
        let (rest, per_length) = (1.0 - x, 1.0 / self.length);
        let [first, last, a, b, c] = &self.terms;
        for (i, (y, yp)) in y.iter_mut().zip(yp).enumerate() {
            for (lane, (y, yp)) in y.iter_mut().zip(yp).enumerate() {
                let (k1, k2, k3) = (a[i][lane], b[i][lane], c[i][lane]);
                let inner = k1 + x * (k2 + x * k3);
                *y = rest * first[i][lane] + x * (last[i][lane] + rest * inner);
                let slope = last[i][lane] - first[i][lane] + (rest - x) * inner + x * rest * (k2 + 2.0 * x * k3);
                *yp = slope * per_length;
            }
        }
    }

    /// What the error of the last step was measured by.
    pub fn error(&self) -> &[Quad] {
        &self.u[7]
    }
}

/// The right-hand side of the first stage.
#[inline(always)]
fn first(right: &mut [Quad], rates: &[Quad], slope: Option<(f64, &[Quad])>) {
    match slope {
        Some((factor, slope)) => set(right, |i, lane| rates[i][lane] + factor * slope[i][lane]),
        None => right.copy_from_slice(rates),
    }
}

/// That of another: `rates + mass * factor * sum over j of factors[j] terms[j]`.
#[inline(always)]
fn add<const N: usize>(
    right: &mut [Quad],
    rates: &[Quad],
    mass: &[Quad],
    factor: f64,
    factors: &[f64; N],
    terms: [&Quads; N],
    slope: Option<(f64, &[Quad])>,
) {
    let n = right.len();
    let terms = terms.map(|term| &term[..n]);
    for (i, ((right, rates), mass)) in right.iter_mut().zip(rates).zip(mass).enumerate() {
        let sum = weighted(i, factors, &terms);
        *right = std::array::from_fn(|lane| rates[lane] + mass[lane] * (factor * sum[lane]));
    }
    if let Some((factor, slope)) = slope {
        for (right, slope) in right.iter_mut().zip(slope) {
            *right = std::array::from_fn(|lane| right[lane] + factor * slope[lane]);
        }
    }
}

#[inline(always)]
fn increase(sum: &mut [Quad], by: &[Quad]) {
    for (sum, by) in sum.iter_mut().zip(by) {
        *sum = std::array::from_fn(|lane| sum[lane] + by[lane]);
    }
}
