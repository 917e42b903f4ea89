//! Steps by the Rosenbrock method Rodas5P.

use super::super::callbacks::Trouble;
use super::super::{LinearSolver, SolveError, System};
use super::frame::Frame;
use super::matrix::Matrix;
use super::numbers::{Quad, Quads, bound_bow, entries_mut, parts, set, weighted, widened, zeros};
use super::rodas5p::*;

/// Distance of the points at which ∂f/∂t is taken, in parts of the step.
const TIME_DIFFERENCE: f64 = 1e-4;

/// Space for a step, and its polynomial.
pub(super) struct Rosenbrock {
    matrix: Matrix,
    values: Box<[f64]>,
    columns: Box<[u32]>,
    rows: Box<[u32]>,
    /// Entries on the diagonal.
    diagonal: Box<[u32]>,
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
    pub(super) fn new(system: &dyn System, choice: LinearSolver) -> Result<Self, SolveError> {
        let (n, pattern) = (system.dimension(), system.pattern());
        let space = || zeros(n);
        let on_diagonal = |column: usize| pattern.column(column).find(move |&entry| pattern.rows()[entry] == column);
        Ok(Self {
            matrix: Matrix::new(pattern, choice)?,
            values: vec![0.0; pattern.entries()].into(),
            columns: (0..n).flat_map(|column| pattern.column(column).map(move |_| column as u32)).collect(),
            diagonal: (0..n).filter_map(on_diagonal).map(|entry| entry as u32).collect(),
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

    /// Returns `true` if the factorisation is a small part of a step.
    pub(crate) fn is_cheap(&self) -> bool {
        self.matrix.is_cheap()
    }

    /// Forgets the pivots of earlier factorisations.
    pub(super) fn forget(&mut self) {
        self.matrix.forget();
    }

    /// Places of entries of the pattern, for messages.
    pub(super) fn place_of(&self, entry: usize) -> (usize, usize) {
        (self.rows[entry] as usize, self.columns[entry] as usize)
    }

    /// Takes a step from the frame's beginning to its end; the error in tolerances, not a number
    /// where something is not finite.
    pub(super) fn attempt(&mut self, frame: &mut Frame, system: &mut dyn System) -> f64 {
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
        take_stages(frame.n, self, frame, system)
    }

    /// The stages, the end of the step and its error.
    #[inline(always)]
    fn stages(&mut self, frame: &mut Frame, system: &mut dyn System) -> f64 {
        let (t, h, timed) = (frame.t, frame.h, frame.timed);
        let Frame { begin, begin_rates, end, mass, functions, .. } = &mut *frame;
        let Self { matrix, u, place, rates, right, slope, .. } = self;
        functions.counts.linear_solves += 8;
        let [u1, u2, u3, u4, u5, u6, u7, u8] = u;
        let slope = |stage: usize| (timed && stage < 5).then(|| (h * SLOPES[stage], &**slope));
        add(right, begin_rates, None, slope(0));
        matrix.solve_negative(right, u1);
        macro_rules! stage {
            ($number:literal, $out:ident) => {{
                functions.rates(system, t + NODES[$number] * h, place, rates);
                add(right, rates, Some(&*$out), slope($number));
                matrix.solve_negative(right, $out);
            }};
        }
        combine(place, u2, (begin, mass, 1.0 / h), (&A2, &C2), [&*u1]);
        stage!(1, u2);
        combine(place, u3, (begin, mass, 1.0 / h), (&A3, &C3), [&*u1, &*u2]);
        stage!(2, u3);
        combine(place, u4, (begin, mass, 1.0 / h), (&A4, &C4), [&*u1, &*u2, &*u3]);
        stage!(3, u4);
        combine(place, u5, (begin, mass, 1.0 / h), (&A5, &C5), [&*u1, &*u2, &*u3, &*u4]);
        stage!(4, u5);
        combine(place, u6, (begin, mass, 1.0 / h), (&A6, &C6), [&*u1, &*u2, &*u3, &*u4, &*u5]);
        stage!(5, u6);
        increase(place, u7, (mass, 1.0 / h), &C7, [&*u1, &*u2, &*u3, &*u4, &*u5, &*u6]);
        stage!(6, u7);
        increase(place, u8, (mass, 1.0 / h), &C8, [&*u1, &*u2, &*u3, &*u4, &*u5, &*u6, &*u7]);
        stage!(7, u8);
        set(end, |i, lane| place[i][lane] + u8[i][lane]);
        frame.norm(u8)
    }

    /// ∂f/∂t as the system gives it, or by a difference of order two, inside of the step: the
    /// equations may be of another form before it.
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

    /// Returns `true` if the largest row sum of |∂f/∂y| in tolerances at the beginning of the last
    /// step, which bounds the spectral radius there, is below `bound`.
    pub(crate) fn is_slow(&mut self, frame: &Frame, bound: f64) -> bool {
        let diagonal = 1.0 / (frame.h * GAMMA);
        // A row sum is no less than its entry on the diagonal, of which one is large as a rule.
        if self.diagonal.iter().any(|&entry| (self.values[entry as usize] + diagonal).abs() >= bound) {
            return false;
        }
        let (weights, sums) = (entries_mut(&mut self.right, frame.n), entries_mut(&mut self.rates, frame.n));
        weights.iter_mut().enumerate().for_each(|(at, weight)| *weight = frame.reciprocal_tolerance(at));
        sums.fill(0.0);
        for ((&value, &row), &column) in self.values.iter().zip(&self.rows).zip(&self.columns) {
            let value = if row == column { value + diagonal } else { value };
            sums[row as usize] += value.abs() / weights[column as usize];
        }
        sums.iter().zip(&*weights).map(|(sum, weight)| sum * weight).fold(0.0, f64::max) < bound
    }

    /// Makes the polynomial of the last step.
    pub(super) fn prepare(&mut self, frame: &Frame) {
        make_terms(frame.n, self, frame);
        (self.begin, self.length) = (frame.t, frame.h);
    }

    #[inline(always)]
    fn terms(&mut self, frame: &Frame) {
        let [u1, u2, u3, u4, u5, u6, u7, u8] = &self.u;
        let [first, last, higher @ ..] = &mut self.terms;
        first.copy_from_slice(&frame.begin);
        last.copy_from_slice(&frame.end);
        for (term, factors) in higher.iter_mut().zip(&H) {
            for (i, term) in term.iter_mut().enumerate() {
                *term = weighted(i, factors, &[&u1[..], &u2[..], &u3[..], &u4[..], &u5[..], &u6[..], &u7[..], &u8[..]]);
            }
        }
    }

    /// Unknowns, and derivatives where they are asked for, at a time within the last step.
    pub(super) fn interpolate(&self, t: f64, y: &mut [Quad], yp: Option<&mut [Quad]>) {
        match yp {
            Some(yp) => evaluate(4 * y.len(), self, t, y, yp),
            None => evaluate_values(4 * y.len(), self, t, y),
        }
    }

    #[inline(always)]
    fn values(&self, t: f64, y: &mut [Quad]) {
        let x = ((t - self.begin) / self.length).clamp(0.0, 1.0);
        let rest = 1.0 - x;
        let [first, last, a, b, c] = &self.terms;
        match x {
            0.0 => y.copy_from_slice(first),
            1.0 => y.copy_from_slice(last),
            _ => set(y, |i, lane| {
                let inner = a[i][lane] + x * (b[i][lane] + x * c[i][lane]);
                rest * first[i][lane] + x * (last[i][lane] + rest * inner)
            }),
        }
    }

    #[inline(always)]
    fn polynomial(&self, t: f64, y: &mut [Quad], yp: &mut [Quad]) {
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

    /// Bounds of the unknowns in some fours over the last step.
    pub(super) fn enclose(&self, frame: &Frame, fours: &[u32], least: &mut [Quad], most: &mut [Quad]) {
        let [u1, u2, u3, u4, u5, u6, u7, u8] = &self.u;
        let stages = [&u1[..], u2, u3, u4, u5, u6, u7, u8];
        for &i in fours {
            let i = i as usize;
            let [k1, k2, k3] = [0, 1, 2].map(|term| weighted(i, &H[term], &stages));
            bound_bow((&frame.begin[i], &frame.end[i]), (&mut least[i], &mut most[i]), |lane| {
                let (k1, k2, k3) = (k1[lane], k2[lane], k2[lane] + k3[lane]);
                (k1 + k2.min(k3).min(0.0), k1 + k2.max(k3).max(0.0))
            });
        }
    }

    /// Scale of the error of the last step.
    pub(super) fn error(&self) -> &[Quad] {
        &self.u[7]
    }
}

widened! {
    fn take_stages(rosenbrock: &mut Rosenbrock, frame: &mut Frame, system: &mut dyn System) -> f64 = Rosenbrock::stages
}

widened! {
    fn make_terms(rosenbrock: &mut Rosenbrock, frame: &Frame) = Rosenbrock::terms
}

widened! {
    fn evaluate(rosenbrock: &Rosenbrock, t: f64, y: &mut [Quad], yp: &mut [Quad]) = Rosenbrock::polynomial
}

widened! {
    fn evaluate_values(rosenbrock: &Rosenbrock, t: f64, y: &mut [Quad]) = Rosenbrock::values
}

/// The unknowns of a stage, `begin + sum over j of a[j] terms[j]`, and what earlier stages are to
/// its right-hand side, `mass * factor * sum over j of c[j] terms[j]`.
#[inline(always)]
fn combine<const N: usize>(
    place: &mut [Quad],
    right: &mut [Quad],
    (begin, mass, factor): (&[Quad], &[Quad], f64),
    (a, c): (&[f64; N], &[f64; N]),
    terms: [&Quads; N],
) {
    let n = place.len();
    let (right, begin, terms) = (&mut right[..n], &begin[..n], parts(&terms, n));
    for (i, (((place, right), begin), mass)) in place.iter_mut().zip(right).zip(begin).zip(mass).enumerate() {
        let (sum, others) = (weighted(i, a, &terms), weighted(i, c, &terms));
        *place = std::array::from_fn(|lane| begin[lane] + sum[lane]);
        *right = std::array::from_fn(|lane| mass[lane] * (factor * others[lane]));
    }
}

/// The same where the unknowns are those of the stage before and its result, the last of the terms.
#[inline(always)]
fn increase<const N: usize>(place: &mut [Quad], right: &mut [Quad], (mass, factor): (&[Quad], f64), c: &[f64; N], terms: [&Quads; N]) {
    let n = place.len();
    let (right, terms) = (&mut right[..n], parts(&terms, n));
    for (i, ((place, right), mass)) in place.iter_mut().zip(right).zip(mass).enumerate() {
        let others = weighted(i, c, &terms);
        let last = terms[N - 1][i];
        *place = std::array::from_fn(|lane| place[lane] + last[lane]);
        *right = std::array::from_fn(|lane| mass[lane] * (factor * others[lane]));
    }
}

/// The right-hand side: rates, what earlier stages are to it, and what moves with time.
#[inline(always)]
fn add(right: &mut [Quad], rates: &[Quad], others: Option<&[Quad]>, slope: Option<(f64, &[Quad])>) {
    match others {
        Some(others) => set(right, |i, lane| rates[i][lane] + others[i][lane]),
        None => right.copy_from_slice(rates),
    }
    if let Some((factor, slope)) = slope {
        for (right, slope) in right.iter_mut().zip(slope) {
            *right = std::array::from_fn(|lane| right[lane] + factor * slope[lane]);
        }
    }
}
