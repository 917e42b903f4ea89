//! Derivatives of the unknowns along directions, integrated behind them with their own steps.
//!
//! With F(t, y, y') = 0 a matrix S of derivatives obeys F_y S + F_y' S' + B = 0, which is linear.
//! With the derivative of a backward differentiation formula, S' = c S + R, one factorisation of
//! F_y + c F_y' gives all columns (the staggered direct method of M. Caracotsios and W. E. Stewart,
//! *Comput. Chem. Eng.* 9 (1985) 359). The interpolant of IDA gives F_y between its steps, so that
//! S has its own steps and order. It takes fewer steps than y if its tolerance is looser, more
//! where y rests and S does not. Nothing is kept but the last values of S: each step is one pass
//! over them, a solution, and one pass for the error.

mod formula;

use std::os::raw::c_int;

use smpl_compiler::kernels;

use self::formula::{Formula, MAX_ORDER, POINTS, Points, combine, distance};
use super::callbacks::Bridge;
use super::linear::{Factorisation, columns::all_finite};
use super::sundials::Context;
use super::vector::{Operations, Vector};
use super::{Following, Nodes, Pattern, Quadratures, Settings, SolveError, System};

/// Steps of the unknowns that one of the derivatives may pass over.
const PASSED: usize = 8;

/// The first step of the derivatives in those of the unknowns, whose tolerance is tighter.
const FIRST: f64 = 10.0;

/// Local errors of many steps add up: each is held to the tolerance over this.
const MARGIN: f64 = 2.0;

/// Part of the step that the error would allow: of the present order, of the one below and of the
/// one above.
const SAFETY: [f64; 3] = [1.1, 1.2, 1.3];

/// Bounds of the change from step to step: less is not worth it, more is not stable.
const WORTH: f64 = 1.1;
const MOST: f64 = 2.0;
const MOST_OF_FIRST: f64 = 10.0;

/// Rejections in a row after which there is no step that fits.
const MOST_REJECTIONS: u32 = 40;

/// Part of the steps before in which derivatives of algebraic unknowns may jump.
const SUDDEN: f64 = 0.05;

/// Part by which the length of the steps before counts in the next one.
const FADING: f64 = 0.9;

/// Reason why the integration cannot continue.
pub(super) enum Stuck {
    /// A callback gave up, and has noted why.
    Callback,
    /// There is no step that fits.
    Error(SolveError),
}

impl From<c_int> for Stuck {
    fn from(_: c_int) -> Self {
        Self::Callback
    }
}

/// A state of the unknowns.
struct State {
    time: f64,
    y: Vector,
    yp: Vector,
}

/// Numbers of directions, of derivatives of unknowns, and of all with those of integrals.
struct Size {
    width: usize,
    own: usize,
    all: usize,
}

/// Properties of the equations.
struct Equations {
    pattern: Pattern,
    differential: Box<[bool]>,
    explicit: bool,
    integrands_read_rates: bool,
    /// They read their past, which is recorded with each step.
    has_past: bool,
}

/// Relative tolerances of both, absolute ones of each number; infinite for what is not tested.
struct Tolerances {
    rtol: [f64; 2],
    atol: Box<[f64]>,
    /// The same without algebraic unknowns.
    of_states: Box<[f64]>,
    /// Numbers that are tested.
    tested: f64,
}

/// The matrix of the equations for derivatives.
struct Matrix {
    factorisation: Factorisation,
    /// Entries of the Jacobian.
    values: Vec<f64>,
    others: Vec<f64>,
    space: Vec<f64>,
}

/// The last values and their times, latest first, and room for the next.
struct History {
    points: Vec<Vec<f64>>,
    times: [f64; POINTS],
    /// So many of them are of the solution.
    known: usize,
}

/// Order and length of steps.
#[derive(Default)]
struct Pace {
    order: usize,
    /// Length of the next step; zero where none is known.
    length: f64,
    /// Steps since order or length changed.
    steady: usize,
    steps: u32,
    /// Rejections since the last step.
    rejections: u32,
    /// Length of the steps before, which falls slowly: steps before a jump become shorter and
    /// shorter.
    usual: f64,
}

/// States of the unknowns.
struct Path {
    /// From the latest point of the derivatives on.
    passed: Vec<State>,
    count: usize,
    /// One between them.
    inside: State,
}

/// Derivatives along directions, row after row, with those of the integrals behind them.
pub(super) struct Variational {
    size: Size,
    equations: Equations,
    max_order: usize,
    max_steps: u32,
    tolerances: Tolerances,
    matrix: Matrix,
    history: History,
    next: Vec<f64>,
    predicted: Vec<f64>,
    integrands: Vec<f64>,
    /// S' at the latest point.
    rates: Vec<f64>,
    formula: Formula,
    pace: Pace,
    path: Path,
    /// States within the last step, for the past.
    nodes: Nodes,
}

impl Variational {
    /// For a system with directions.
    ///
    /// # Errors
    /// What the linear solvers say of the pattern.
    pub(super) fn new(system: &dyn System, settings: &Settings, operations: Operations, context: &Context) -> Result<Self, SolveError> {
        let (pattern, width) = (system.pattern(), system.directions());
        let n = pattern.dimension();
        let integrals = system.quadrature_count() / (1 + width);
        let (own, all) = (n * width, (n + integrals) * width);
        let (atol, rtol) = tolerances(system, settings, integrals);
        let of_states = of_states(system, &atol);
        let state = || State { time: 0.0, y: Vector::zeros(n, operations, context), yp: Vector::zeros(n, operations, context) };
        let numbers = |length| vec![0.0; length];
        Ok(Self {
            size: Size { width, own, all },
            equations: Equations {
                pattern: pattern.clone(),
                differential: system.differential()[..n].into(),
                explicit: system.is_explicit(),
                integrands_read_rates: false,
                has_past: system.has_past(),
            },
            max_order: (settings.max_order as usize).min(MAX_ORDER),
            max_steps: settings.max_steps,
            tolerances: Tolerances { rtol, tested: atol.iter().filter(|atol| atol.is_finite()).count().max(1) as f64, atol, of_states },
            matrix: Matrix {
                factorisation: Factorisation::new(pattern, settings.linear_solver)?,
                values: numbers(pattern.entries()),
                others: numbers(pattern.entries()),
                space: Vec::new(),
            },
            history: History { points: (0..POINTS).map(|_| numbers(all)).collect(), times: [0.0; POINTS], known: 0 },
            next: numbers(all),
            predicted: numbers(all),
            integrands: numbers(all - own),
            rates: numbers(all),
            formula: Formula::default(),
            pace: Pace::default(),
            path: Path { passed: (0..PASSED + 1).map(|_| state()).collect(), count: 0, inside: state() },
            nodes: Nodes::default(),
        })
    }

    /// Forgets the pivots of earlier factorisations.
    pub(super) fn forget(&mut self) {
        self.matrix.factorisation.forget();
    }

    /// The derivatives of the unknowns.
    pub(super) fn derivatives(&self) -> &[f64] {
        &self.history.points[0][..self.size.own]
    }

    /// Their rates.
    pub(super) fn rates(&self) -> &[f64] {
        &self.rates[..self.size.own]
    }

    /// The derivatives of the integrals.
    pub(super) fn integrals(&self) -> &[f64] {
        &self.history.points[0][self.size.own..]
    }

    /// Begins with derivatives of the differential unknowns at a consistent state: those of the
    /// algebraic ones, and rates, follow.
    pub(super) fn begin(&mut self, bridge: &mut Bridge, time: f64, (y, yp): (&Vector, &Vector), s: &[f64]) -> Result<(), Stuck> {
        self.pace = Pace { order: 1, ..Pace::default() };
        self.history.known = 1;
        self.history.times[0] = time;
        let first = &mut self.history.points[0];
        first[..self.size.own].copy_from_slice(s);
        first[self.size.own..].fill(0.0);
        self.path.passed[0].set(time, y, yp);
        self.path.count = 1;
        self.equations.integrands_read_rates = bridge.integrands_read_rates()?;
        self.path.inside.set(time, y, yp);
        self.find_rates(bridge)
    }

    /// Rates of differential unknowns' derivatives and of the integrals, and derivatives of the
    /// algebraic unknowns, at the state that was placed.
    fn find_rates(&mut self, bridge: &mut Bridge) -> Result<(), Stuck> {
        let width = self.size.width;
        self.rates.fill(0.0);
        let State { time, y, yp } = &self.path.inside;
        let time = *time;
        for (row, _) in self.history.points[0][..self.size.own]
            .chunks_exact_mut(width)
            .zip(&self.equations.differential)
            .filter(|(_, differential)| !**differential)
        {
            row.fill(0.0);
        }
        bridge.jacobian_at(time, 0.0, (y, yp), &mut self.matrix.values)?;
        let at = Following { t: time, y: y.entries(), yp: yp.entries(), cj: 0.0, jacobian: &self.matrix.values };
        bridge.following(at, (&self.history.points[0][..self.size.own], &self.rates[..self.size.own]), &mut self.next[..self.size.own])?;
        let explicit = self.equations.explicit && !self.equations.differential.contains(&false);
        if !explicit {
            bridge.jacobian_at(time, 1.0, (y, yp), &mut self.matrix.others)?;
            self.take_rates();
            self.next.iter_mut().for_each(|x| *x = -*x);
            self.solve(bridge, time)?;
        }
        for (i, &differential) in self.equations.differential.iter().enumerate() {
            let row = i * width..(i + 1) * width;
            let to = if differential { &mut self.rates } else { &mut self.history.points[0] };
            to[row.clone()].copy_from_slice(&self.next[row]);
        }
        if self.size.all > self.size.own {
            let (rates, integrals) = self.rates.split_at_mut(self.size.own);
            let State { y, yp, .. } = &self.path.inside;
            bridge.following_integrands(time, (y, yp), (&self.history.points[0][..self.size.own], rates), integrals)?;
        }
        Ok(())
    }

    /// Puts the derivatives by rates into the columns of differential unknowns.
    fn take_rates(&mut self) {
        for column in (0..self.equations.differential.len()).filter(|&column| self.equations.differential[column]) {
            for entry in self.equations.pattern.column(column) {
                self.matrix.values[entry] = self.matrix.others[entry] - self.matrix.values[entry];
            }
        }
    }

    /// Factorises the matrix and replaces the right-hand sides by the solutions.
    fn solve(&mut self, bridge: &mut Bridge, time: f64) -> Result<(), Stuck> {
        bridge.counts.factorisations += 1;
        self.matrix
            .factorisation
            .factorise(&self.matrix.values)
            .map_err(|s| Stuck::Error(SolveError::SingularJacobian { time, column: s.column }))?;
        self.matrix.factorisation.solve_many(self.size.width, &mut self.next[..self.size.own], &mut self.matrix.space);
        Ok(())
    }

    /// Goes on as far as steps fit into what the unknowns have come to, `to`; exactly to it if that
    /// is the `end`.
    pub(super) fn catch_up(&mut self, bridge: &mut Bridge, to: f64, end: f64) -> Result<(), Stuck> {
        let Path { passed, count, .. } = &mut self.path;
        if to > passed[*count - 1].time {
            let state = &mut passed[*count];
            state.time = to;
            bridge.interpolate(to, 0, &mut state.y)?;
            bridge.interpolate(to, 1, &mut state.yp)?;
            *count += 1;
        }
        let known = if self.equations.has_past { bridge.longest_step()? } else { f64::INFINITY };
        while let Some(time) = self.target(to, end, known) {
            self.place(bridge, time)?;
            if self.step(bridge)? {
                self.pace.rejections = 0;
                self.pace.steps += 1;
                self.record(bridge)?;
            }
            let (now, least) = (self.history.times[0], 4.0 * f64::EPSILON * self.history.times[0].abs());
            if self.pace.rejections > MOST_REJECTIONS || self.pace.length <= least {
                return Err(Stuck::Error(SolveError::StepTooSmall {
                    time: now,
                    step: self.pace.length,
                    unknown: self.largest(&self.next),
                }));
            }
            if self.pace.steps > self.max_steps {
                return Err(Stuck::Error(SolveError::TooManySteps {
                    time: now,
                    steps: self.max_steps,
                    unknown: self.largest(&self.history.points[0]),
                    event: None,
                }));
            }
        }
        if self.pace.steps > 0 && self.history.times[0] == end {
            let (new, behind) = self.history.points.split_at(1);
            differentiate(&self.formula, behind, &new[0], &mut self.rates);
        }
        self.leave_behind();
        Ok(())
    }

    /// End of the next step, which is no longer than `longest`; `None` if it has to wait for the
    /// unknowns.
    fn target(&mut self, to: f64, end: f64, longest: f64) -> Option<f64> {
        let now = self.history.times[0];
        if now >= to {
            return None;
        }
        if self.pace.length == 0.0 {
            self.pace.length = FIRST * (to - now);
        }
        let (left, length) = (end - now, self.pace.length.min(longest));
        let pieces = (left / length - 1e-9).ceil();
        let step = if pieces <= 4.0 { left / pieces.max(1.0) } else { length };
        let time = if pieces <= 1.0 { end } else { now + step };
        let waits = time > to && to < end && self.path.count <= PASSED;
        (!waits).then_some(time.min(to))
    }

    /// Forgets the states before the latest point of the derivatives, but for one.
    fn leave_behind(&mut self) {
        let behind = self.path.passed[1..self.path.count].iter().filter(|state| state.time <= self.history.times[0]).count();
        self.path.passed[..self.path.count].rotate_left(behind);
        self.path.count -= behind;
    }

    /// Finds the state of the unknowns at a time: on IDA's polynomial in its last step, by
    /// Hermite's interpolation in those before.
    fn place(&mut self, bridge: &mut Bridge, time: f64) -> Result<(), Stuck> {
        self.path.inside.time = time;
        if self.path.count < 2 || time >= self.path.passed[self.path.count - 2].time {
            bridge.interpolate(time, 0, &mut self.path.inside.y)?;
            // What is explicit in its rates has derivatives that do not depend on them.
            if !self.equations.explicit || self.equations.integrands_read_rates || self.equations.has_past {
                bridge.interpolate(time, 1, &mut self.path.inside.yp)?;
            }
            return Ok(());
        }
        let after = self.path.passed[..self.path.count].iter().position(|state| state.time > time).unwrap_or(self.path.count - 1).max(1);
        let [before, after] = [&self.path.passed[after - 1], &self.path.passed[after]];
        self.path.inside.interpolate(before, after);
        Ok(())
    }

    /// Tries a step to the state that was placed; whether its error is within the tolerance.
    fn step(&mut self, bridge: &mut Bridge) -> Result<bool, Stuck> {
        let time = self.path.inside.time;
        if self.history.known == 1 {
            self.continue_backwards(time);
        }
        self.formula = Formula::new(self.pace.order, time, &self.history.times);
        combine(&points(&self.history.points), &self.formula, &mut self.next, &mut self.predicted);
        if !self.find_next(bridge)? || !all_finite(&self.next) {
            bridge.counts.not_finite += 1;
            return Ok(self.reject(f64::INFINITY));
        }
        let error = self.formula.error * self.distance(&self.tolerances.atol);
        if error > 1.0 && self.jumps(error) {
            self.jump(bridge)?;
            return Ok(true);
        }
        if error > 1.0 || error.is_nan() {
            bridge.counts.error_test_failures += 1;
            return Ok(self.reject(error));
        }
        self.choose(error);
        self.accept();
        Ok(true)
    }

    /// Returns whether derivatives of algebraic unknowns jump over a step that failed with this
    /// error, and the step is so short that integrals of them do not change.
    fn jumps(&self, error: f64) -> bool {
        let share = (self.path.inside.time - self.history.times[0]) / self.pace.usual;
        let may = self.history.known > 1 && share <= SUDDEN && error * share <= 1.0;
        may && self.formula.error * self.distance(&self.tolerances.of_states) <= 1.0
    }

    /// Takes a step over which only derivatives of algebraic unknowns jump, and begins anew behind
    /// it: slopes of recorded values jump from one step that recorded them to the next.
    fn jump(&mut self, bridge: &mut Bridge) -> Result<(), Stuck> {
        self.accept();
        self.history.known = 1;
        (self.pace.order, self.pace.steady, self.pace.length) = (1, 0, self.pace.usual);
        self.find_rates(bridge)
    }

    /// Before the first step: a value behind it on the straight line, for a prediction.
    fn continue_backwards(&mut self, time: f64) {
        let behind = time - self.history.times[0];
        self.history.times[1] = self.history.times[0] - behind;
        let [first, second, ..] = &mut self.history.points[..] else { return };
        second.iter_mut().zip(&*first).zip(&self.rates).for_each(|((to, s), rate)| *to = s - behind * rate);
    }

    /// Solves for the next values; whether the matrix allows it.
    fn find_next(&mut self, bridge: &mut Bridge) -> Result<bool, Stuck> {
        let State { time, y, yp } = &self.path.inside;
        let cj = self.formula.weight;
        bridge.jacobian_at(*time, cj, (y, yp), &mut self.matrix.values)?;
        if !all_finite(&self.matrix.values) {
            return Ok(false);
        }
        let at = Following { t: *time, y: y.entries(), yp: yp.entries(), cj, jacobian: &self.matrix.values };
        bridge.moving(at, &mut self.next[..self.size.own])?;
        if self.solve(bridge, self.path.inside.time).is_err() {
            return Ok(false);
        }
        if self.size.all > self.size.own {
            self.integrate(bridge)?;
        }
        Ok(true)
    }

    /// The integrals at the next values.
    fn integrate(&mut self, bridge: &mut Bridge) -> Result<(), Stuck> {
        if self.equations.integrands_read_rates {
            differentiate(&self.formula, &self.history.points, &self.next, &mut self.rates[..self.size.own]);
        }
        let (s, integrals) = self.next.split_at_mut(self.size.own);
        let State { time, y, yp } = &self.path.inside;
        bridge.following_integrands(*time, (y, yp), (s, &self.rates[..self.size.own]), &mut self.integrands)?;
        integrals.iter_mut().zip(&self.integrands).for_each(|(x, rate)| *x = (rate - *x) / self.formula.weight);
        Ok(())
    }

    /// Root mean square of the difference of the next values to their prediction, in tolerances of
    /// a step.
    fn distance(&self, atol: &[f64]) -> f64 {
        let own = self.size.own;
        let part = |range: std::ops::Range<usize>, rtol: f64| {
            let [new, old, predicted] = [&self.next, &self.history.points[0], &self.predicted].map(|x| &x[range.clone()]);
            distance(new, old, predicted, rtol, &atol[range.clone()])
        };
        MARGIN
            * ((part(0..own, self.tolerances.rtol[0]) + part(own..self.size.all, self.tolerances.rtol[1])) / self.tolerances.tested).sqrt()
    }

    /// Lets equations that read their past record the last step.
    fn record(&mut self, bridge: &mut Bridge) -> Result<(), Stuck> {
        if !self.equations.has_past {
            return Ok(());
        }
        let (n, own) = (self.equations.differential.len(), self.size.own);
        let mut nodes = std::mem::take(&mut self.nodes);
        nodes.place((self.history.times[1], self.history.times[0]), n + own);
        for (node, time) in nodes.times().into_iter().enumerate() {
            self.place(bridge, time)?;
            let (y, yp) = nodes.at_mut(node);
            y[..n].copy_from_slice(self.path.inside.y.entries());
            yp[..n].copy_from_slice(self.path.inside.yp.entries());
            self.history.interpolate(self.formula.order, time, &mut y[n..], &mut yp[n..]);
        }
        let recorded = bridge.with_past(|system| system.record_following(&nodes));
        self.nodes = nodes;
        Ok(recorded?)
    }

    /// The derivative of an unknown that is furthest from its prediction, in tolerances, counted
    /// behind the unknowns; NaN is further than all.
    fn largest(&self, new: &[f64]) -> Option<usize> {
        let size = |at: usize| {
            let size = (new[at] - self.predicted[at]).abs() / (self.tolerances.atol[at] + self.tolerances.rtol[0] * new[at].abs());
            if size.is_nan() { f64::INFINITY } else { size }
        };
        let furthest = (0..self.size.own).max_by(|&a, &b| size(a).total_cmp(&size(b)))?;
        Some(self.equations.differential.len() + furthest)
    }

    /// Shortens the next attempt; false.
    fn reject(&mut self, error: f64) -> bool {
        let taken = self.path.inside.time - self.history.times[0];
        self.pace.rejections += 1;
        let least = if self.history.known == 1 { 1e-3 } else { 0.1 };
        let factor = if error.is_finite() { 0.9 / kernels::pow(error, 1.0 / (self.pace.order + 1) as f64) } else { 0.25 };
        self.pace.length = taken * factor.clamp(least, 0.9);
        // Where the last step was rejected too, what lies behind is not a guide.
        if self.pace.steady == 0 && self.pace.order > 1 {
            self.pace.order -= 1;
        }
        self.pace.steady = 0;
        false
    }

    /// Length and order of what follows a step with this error; looked at anew when order and
    /// length have been the same for a while.
    fn choose(&mut self, error: f64) {
        self.pace.steady += 1;
        // Behind the beginning, where every step allows a longer one, each is looked at.
        if self.pace.steady < self.pace.order && self.history.known == POINTS {
            return;
        }
        let taken = self.path.inside.time - self.history.times[0];
        let growth = |error: f64, order: usize, safety: f64| 1.0 / (safety * kernels::pow(error, 1.0 / (order + 1) as f64) + 1e-6);
        let (mut order, mut factor) = (self.pace.order, growth(error, self.pace.order, SAFETY[0]));
        // A lower order is asked for where this one allows no longer step.
        let lower = if factor < WORTH { self.pace.order - 1 } else { 0 };
        for (other, safety) in [(lower, SAFETY[1]), (self.pace.order + 1, SAFETY[2])] {
            if other >= 1 && other <= self.max_order && other < self.history.known {
                let other_factor = growth(self.error_of(other), other, safety);
                if other_factor > factor {
                    (order, factor) = (other, other_factor);
                }
            }
        }
        let most = if self.history.known <= 2 { MOST_OF_FIRST } else { MOST };
        if factor >= WORTH || order < self.pace.order || taken < self.pace.length {
            let next = taken * factor.clamp(0.5, most);
            self.pace.length = if factor >= 1.0 { next.max(self.pace.length) } else { next };
            self.pace.order = order;
            self.pace.steady = 0;
        }
    }

    /// The error that another order would have had.
    fn error_of(&mut self, order: usize) -> f64 {
        let time = self.path.inside.time;
        let formula = Formula::new(order, time, &self.history.times);
        combine(&points(&self.history.points), &formula, &mut self.rates, &mut self.predicted);
        formula.error_of_other(time, &self.history.times) * self.distance(&self.tolerances.atol)
    }

    /// The next values become the latest.
    fn accept(&mut self) {
        self.pace.usual = (FADING * self.pace.usual).max(self.path.inside.time - self.history.times[0]);
        self.history.points.rotate_right(1);
        std::mem::swap(&mut self.history.points[0], &mut self.next);
        self.history.times.rotate_right(1);
        self.history.times[0] = self.path.inside.time;
        self.history.known = (self.history.known + 1).min(POINTS);
    }
}

impl History {
    /// Values and rates at a time on the polynomial of an order through the last points.
    fn interpolate(&self, order: usize, time: f64, values: &mut [f64], rates: &mut [f64]) {
        values.fill(0.0);
        rates.fill(0.0);
        let times = &self.times[..=order];
        for (i, point) in self.points[..=order].iter().enumerate() {
            let (weight, rate) = weights(time, times, i);
            values.iter_mut().zip(point).for_each(|(to, x)| *to += weight * x);
            rates.iter_mut().zip(point).for_each(|(to, x)| *to += rate * x);
        }
    }
}

/// Lagrange's polynomial of a point, and its derivative.
fn weights(time: f64, times: &[f64], i: usize) -> (f64, f64) {
    let others = times.iter().enumerate().filter(|&(j, _)| j != i).map(|(_, &other)| other);
    others.fold((1.0, 0.0), |(value, rate), other| {
        let span = times[i] - other;
        (value * (time - other) / span, (rate * (time - other) + value) / span)
    })
}

impl State {
    fn set(&mut self, time: f64, y: &Vector, yp: &Vector) {
        self.time = time;
        self.y.entries_mut().copy_from_slice(y.entries());
        self.yp.entries_mut().copy_from_slice(yp.entries());
    }

    /// On the cubic between two others.
    fn interpolate(&mut self, before: &Self, after: &Self) {
        let length = after.time - before.time;
        let x = (self.time - before.time) / length;
        let rest = 1.0 - x;
        let (ends, slopes) = ([before.y.entries(), after.y.entries()], [before.yp.entries(), after.yp.entries()]);
        let (y, yp) = (self.y.entries_mut(), self.yp.entries_mut());
        for i in 0..y.len() {
            let change = ends[1][i] - ends[0][i];
            let (first, last) = (length * slopes[0][i] - change, change - length * slopes[1][i]);
            y[i] = ends[0][i] + x * (change + rest * (rest * first + x * last));
            yp[i] = (change + (rest - x) * (rest * first + x * last) + x * rest * (last - first)) / length;
        }
    }
}

/// The derivative of a formula's polynomial at its new point.
fn differentiate(formula: &Formula, behind: &[Vec<f64>], new: &[f64], rates: &mut [f64]) {
    rates.iter_mut().zip(new).for_each(|(rate, new)| *rate = formula.weight * new);
    for (point, weight) in behind.iter().zip(&formula.rates[..formula.order]) {
        rates.iter_mut().zip(point).for_each(|(rate, x)| *rate += weight * x);
    }
}

/// All points, as slices.
fn points(all: &[Vec<f64>]) -> Points<'_> {
    std::array::from_fn(|i| &all[i][..])
}

/// Absolute tolerances of each derivative, infinite for what is not tested, and relative ones of
/// those of unknowns and of integrals.
fn tolerances(system: &dyn System, settings: &Settings, integrals: usize) -> (Box<[f64]>, [f64; 2]) {
    let (width, loose) = (system.directions(), settings.looseness);
    let tested = |(&atol, &differential): (&f64, &bool)| {
        if differential || settings.tests_algebraic() { loose * atol } else { f64::INFINITY }
    };
    let own = settings.atol.iter().zip(system.differential()).take(system.pattern().dimension()).map(tested);
    let (rtol, atol) = match settings.quadratures {
        Quadratures::Unchecked => (0.0, f64::INFINITY),
        Quadratures::Checked { rtol, atol } => (loose * rtol, loose * atol),
    };
    let rows = own.chain(std::iter::repeat_n(atol, integrals));
    (rows.flat_map(|atol| std::iter::repeat_n(atol, width)).collect(), [loose * settings.rtol, rtol])
}

/// These tolerances, infinite for derivatives of algebraic unknowns.
fn of_states(system: &dyn System, atol: &[f64]) -> Box<[f64]> {
    let rows = system.differential().iter().take(system.pattern().dimension());
    let each = rows.flat_map(|&differential| std::iter::repeat_n(differential, system.directions())).chain(std::iter::repeat(true));
    atol.iter().zip(each).map(|(&atol, differential)| if differential { atol } else { f64::INFINITY }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Between two states on a cubic lies the cubic.
    #[test]
    fn states_between_two_others_are_on_a_cubic() {
        let context = Context::new().expect("a context");
        let state = |t: f64| {
            let vector = || Vector::zeros(1, Operations::detect(), &context);
            let mut state = State { time: t, y: vector(), yp: vector() };
            state.y.entries_mut()[0] = t * t * t - 2.0 * t * t + 5.0;
            state.yp.entries_mut()[0] = 3.0 * t * t - 4.0 * t;
            state
        };
        let (before, after) = (state(-1.0), state(2.0));
        for t in [-1.0, -0.3, 0.5, 1.9, 2.0] {
            let (mut between, expected) = (state(t), state(t));
            between.y.entries_mut()[0] = f64::NAN;
            between.yp.entries_mut()[0] = f64::NAN;
            between.interpolate(&before, &after);
            assert!((between.y.entries()[0] - expected.y.entries()[0]).abs() < 1e-13, "{t}");
            assert!((between.yp.entries()[0] - expected.yp.entries()[0]).abs() < 1e-13, "{t}");
        }
    }
}
