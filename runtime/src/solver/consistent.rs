//! Start of an integration: consistent values, derivatives and the first step of an explicit
//! system.
//!
//! With y the differential and z the algebraic unknowns of y' = f(t, y, z), 0 = g(t, y, z):
//!
//! * z by Newton's method on g alone, damped by the natural monotonicity test (Deuflhard, *Newton
//!   Methods for Nonlinear Problems*, 2004, section 3.3);
//! * y' = f, and z' from g_z z' = −(g_t + g_y y'), so that IDA's first prediction is right to first
//!   order in z too;
//! * y'' = f_t + f_y y' + f_z z', which gives the local error of a first step of order one, h²
//!   y''/2, beforehand.

mod inside;

use super::callbacks::Bridge;
use super::linear::Factorisation;
use super::quadrature::Integrals;
use super::sundials::Context;
use super::vector::{Operations, Vector};
use super::{LinearSolver, Pattern, SolveError, System};

/// Newton iterations at most: exp(z) = x comes down from a large z by one in each.
const MAX_ITERATIONS: u32 = 400;

/// A correction below this many tolerances is the last: the next one would be its square.
const LAST_CORRECTION: f64 = 1e-3;

/// Rounding level of corrections, relative to the unknowns: with tolerances as tight as this they
/// do not get smaller; in tolerances, at most.
const ROUNDING: f64 = 100.0 * f64::EPSILON;
const MOST_ROUNDING: f64 = 0.1;

/// A correction by factors of an earlier g_z, in tolerances, that is small. The part of it that
/// the next one may be: then they are as good as new.
const SMALL_CORRECTION: f64 = 1.0;
const CONTRACTION: f64 = 0.25;

/// Remaining correction at the end of an advance, in tolerances.
const FINAL_CORRECTION: f64 = 1e-6;

/// A correction that is nothing though the factors were wrong by a million times; also what
/// rounding leaves.
const NEGLIGIBLE: f64 = 1e-9;

/// Smallest fraction of a Newton correction that is tried: exp(z) = x asks for one of exp(z) where
/// z is very negative.
const MIN_DAMPING: f64 = 1e-15;

/// A first step is looked at before it is taken if it is longer than this part of what it may be at
/// most.
const LONG: f64 = 0.25;

/// Unknowns that move by fewer tolerances than this in a first step are at rest.
const AT_REST: f64 = 1e-3;

/// Parts of a first step at which the rates are looked at; no simple fractions, since a period
/// might be one.
const LOOKS: [f64; 8] = [0.031, 0.107, 0.229, 0.353, 0.491, 0.617, 0.773, 0.911];

/// A solution that moves by more than this part of a range from inside of the bounds to outside of
/// them is another branch.
pub(crate) const JUMP: f64 = 0.1;

/// Reason why no consistent state was found.
pub(crate) enum Inconsistent {
    /// A callback failed; the bridge knows how.
    Callback,
    /// g_z is singular in this unknown.
    Singular(Option<usize>),
    /// Newton's method did not converge.
    Diverged { iterations: u32, correction: f64, unknown: Option<usize> },
    /// The solution has jumped out of the declared bounds of this unknown, and none inside was
    /// found.
    Outside { unknown: Option<usize> },
}

/// A consistent state from which a first step is sought.
pub(crate) struct Start<'a> {
    pub bridge: &'a mut Bridge,
    pub time: f64,
    /// Time to the end of the integration, over which a change of the equations counts.
    pub interval: f64,
    pub y: &'a Vector,
    /// The algebraic entries are found with the first step.
    pub yp: &'a mut Vector,
    pub quadratures: Option<&'a mut Integrals>,
}

/// End of a step.
pub(crate) struct End<'a> {
    pub t: f64,
    pub y: &'a mut Vector,
    /// Zero.
    pub yp: &'a Vector,
    /// And an advance with it.
    pub last: bool,
}

/// Space for the computations above, all of which go through most of it: a list of vectors rather
/// than parts that hold together.
pub(crate) struct Consistent {
    /// The algebraic unknowns.
    algebraic: Box<[usize]>,
    differential: Box<[bool]>,
    pattern: Pattern,
    /// For each entry of g_z, by columns, its place in the Jacobian's pattern.
    block_entries: Box<[usize]>,
    block_values: Box<[f64]>,
    block: Option<Factorisation>,
    /// It holds factors.
    factorised: bool,
    correction: Box<[f64]>,
    /// A trial state; then ∂F/∂t, then y''.
    work: Vector,
    residual: Vector,
    weights: Vector,
    /// The weights where a Newton step begins: a step is judged by one measure, also where it makes
    /// unknowns small.
    reference: Vector,
    /// Newton correction with zeros in the differential unknowns.
    spread: Vector,
    start: Box<[f64]>,
    /// Bounds of the algebraic unknowns, where there are any.
    inside: Option<inside::Inside>,
    /// All rows have been finite; until then, rows of states need not be: a rate is 1/x, and the
    /// guess of x is 0.
    whole: bool,
}

impl Consistent {
    pub(super) fn new(system: &dyn System, operations: Operations, context: &Context) -> Result<Self, SolveError> {
        let pattern = system.pattern().clone();
        let n = system.dimension();
        let differential: Box<[bool]> = system.differential().into();
        let algebraic: Box<[usize]> = (0..n).filter(|&i| !differential[i]).collect();
        let mut number = vec![usize::MAX; n];
        algebraic.iter().enumerate().for_each(|(k, &i)| number[i] = k);
        let (mut starts, mut rows, mut block_entries) = (vec![0], vec![], vec![]);
        for &column in &algebraic {
            for entry in pattern.column(column) {
                let row = pattern.rows()[entry];
                if !differential[row] {
                    rows.push(number[row]);
                    block_entries.push(entry);
                }
            }
            starts.push(rows.len());
        }
        let block_pattern = Pattern::new(starts, rows)?;
        let block = match algebraic.len() {
            0 => None,
            _ => Some(Factorisation::new(&block_pattern, LinearSolver::Auto)?),
        };
        let zeros = || Vector::zeros(n, operations, context);
        Ok(Self {
            correction: vec![0.0; algebraic.len()].into(),
            start: vec![0.0; algebraic.len()].into(),
            inside: system.bounds().map(|bounds| inside::Inside::new(bounds, n)),
            whole: true,
            algebraic,
            differential,
            pattern,
            block_values: vec![0.0; block_entries.len()].into(),
            block_entries: block_entries.into(),
            block,
            factorised: false,
            work: zeros(),
            residual: zeros(),
            weights: zeros(),
            reference: zeros(),
            spread: zeros(),
        })
    }

    /// Returns `true` if there are unknowns to be solved for.
    pub(super) fn has_algebraic(&self) -> bool {
        !self.algebraic.is_empty()
    }

    pub(super) fn forget(&mut self) {
        self.factorised = false;
        if let Some(block) = &mut self.block {
            block.forget();
        }
    }

    /// Makes the algebraic unknowns of `y` consistent and sets the differential entries of `yp`,
    /// the others to zero.
    pub(super) fn initialise(&mut self, bridge: &mut Bridge, t: f64, y: &mut Vector, yp: &mut Vector) -> Result<(), Inconsistent> {
        yp.entries_mut().fill(0.0);
        self.whole = false;
        self.evaluate(bridge, t, y, yp)?;
        if !self.algebraic.is_empty() {
            self.solve_algebraic(bridge, t, y, yp)?;
        }
        self.take_rates(bridge, t, yp)
    }

    /// Sets the differential entries of `yp` from the residual of the solution, the others to zero.
    fn take_rates(&mut self, bridge: &mut Bridge, t: f64, yp: &mut Vector) -> Result<(), Inconsistent> {
        if !self.whole && !bridge.is_finite(t, &self.residual) {
            return Err(Inconsistent::Callback);
        }
        self.whole = true;
        let rows = yp.entries_mut().iter_mut().zip(self.residual.entries()).zip(&self.differential);
        rows.for_each(|((rate, residual), &differential)| *rate = if differential { *residual } else { 0.0 });
        Ok(())
    }

    /// Brings the algebraic unknowns of `y`, which are nearly consistent, to their equations by the
    /// factors of the last g_z, and writes the residual there to `rates`. `off` is that before.
    /// False where the corrections do not fall as they would by the present g_z: nothing of `y`
    /// counts then. Where an advance ends, hardly anything is left; within it, what is below the
    /// last correction of Newton's method.
    pub(super) fn follow(&mut self, bridge: &mut Bridge, end: End<'_>, (off, rates): (&[f64], &mut [f64])) -> bool {
        let End { t, y, yp, last } = end;
        let enough = if last { FINAL_CORRECTION } else { LAST_CORRECTION }.max(rounding(bridge));
        if !self.factorised {
            return false;
        }
        self.whole = true;
        let mut size = self.correct_small(bridge, y, Some(off));
        if size <= NEGLIGIBLE {
            rates.copy_from_slice(off);
            return true;
        }
        // A correction says how far off the unknowns are only where the next one is much smaller.
        while size <= SMALL_CORRECTION {
            let entries = y.entries_mut();
            self.algebraic.iter().zip(&self.correction).for_each(|(&i, correction)| entries[i] += correction);
            if self.evaluate(bridge, t, y, yp).is_err() {
                return false;
            }
            let next = self.correct_small(bridge, y, None);
            if next <= enough.min(CONTRACTION * size).max(NEGLIGIBLE) {
                rates.copy_from_slice(self.residual.entries());
                return true;
            }
            size = if next <= CONTRACTION * size { next } else { f64::INFINITY };
        }
        false
    }

    /// Sets the correction from `off`, or from the residual, and returns its size in tolerances.
    fn correct_small(&mut self, bridge: &Bridge, y: &Vector, off: Option<&[f64]>) -> f64 {
        let off = off.unwrap_or(self.residual.entries());
        self.correction.iter_mut().zip(&self.algebraic).for_each(|(correction, &i)| *correction = -off[i]);
        if let Some(block) = &mut self.block {
            block.solve(&mut self.correction);
        }
        let y = y.entries();
        let parts = self.correction.iter().zip(&self.algebraic).map(|(correction, &i)| correction / bridge.tolerance(i, y[i]));
        (parts.map(|part| part * part).sum::<f64>() / y.len() as f64).sqrt()
    }

    fn evaluate(&mut self, bridge: &mut Bridge, t: f64, y: &Vector, yp: &Vector) -> Result<(), Inconsistent> {
        bridge.evaluate(t, y, yp, &mut self.residual).map_err(|_| Inconsistent::Callback)?;
        if bridge.operations.all_finite(self.residual.blocks()) {
            self.whole = true;
            return Ok(());
        }
        let residual = self.residual.entries();
        let own = self.algebraic.iter().copied().find(|&row| !residual[row].is_finite());
        match own.or_else(|| self.whole.then(|| residual.iter().position(|x| !x.is_finite())).flatten()) {
            None => Ok(()),
            Some(row) => {
                bridge.note_not_finite(t, row);
                Err(Inconsistent::Callback)
            }
        }
    }

    /// Newton's method on the algebraic rows; leaves the residual of the solution.
    fn solve_algebraic(&mut self, bridge: &mut Bridge, t: f64, y: &mut Vector, yp: &Vector) -> Result<(), Inconsistent> {
        self.factorise_block(bridge, t, y, yp)?;
        let enough = LAST_CORRECTION.max(rounding(bridge));
        let mut size = self.correct(bridge, y);
        for iterations in 1..=MAX_ITERATIONS {
            if size == 0.0 {
                return Ok(());
            }
            let last = size <= enough;
            let next = self.damped_step(bridge, t, (y, yp), enough).ok_or_else(|| self.diverged(iterations, size))?;
            if last {
                return Ok(());
            }
            // The correction just computed used the old g_z; a fresh one makes the convergence
            // quadratic.
            size = if next <= enough {
                next
            } else {
                self.factorise_block(bridge, t, y, yp)?;
                self.correct(bridge, y)
            };
        }
        Err(self.diverged(MAX_ITERATIONS, size))
    }

    /// Newton's method gave up: the unknown with the largest correction, in tolerances, is to
    /// blame.
    fn diverged(&self, iterations: u32, correction: f64) -> Inconsistent {
        Inconsistent::Diverged { iterations, correction, unknown: largest(self.work.entries(), self.reference.entries()) }
    }

    fn factorise_block(&mut self, bridge: &mut Bridge, t: f64, y: &Vector, yp: &Vector) -> Result<(), Inconsistent> {
        bridge.jacobian_of(&self.block_entries, t, y, yp).map_err(|_| Inconsistent::Callback)?;
        self.factorise_values(bridge)
    }

    /// Factorises g_z, taken from the Jacobian that the bridge holds.
    fn factorise_values(&mut self, bridge: &Bridge) -> Result<(), Inconsistent> {
        for (value, &entry) in self.block_values.iter_mut().zip(&self.block_entries) {
            *value = bridge.values[entry];
        }
        let Some(block) = &mut self.block else {
            return Ok(());
        };
        let done = block.factorise(&self.block_values);
        self.factorised = done.is_ok();
        done.map_err(|singular| Inconsistent::Singular(singular.column.map(|k| self.algebraic[k])))
    }

    /// Sets the correction from the residual and returns its size in tolerances.
    fn correct(&mut self, bridge: &Bridge, y: &Vector) -> f64 {
        for (correction, &i) in self.correction.iter_mut().zip(&self.algebraic) {
            *correction = -self.residual.entries()[i];
        }
        if let Some(block) = &mut self.block {
            block.solve(&mut self.correction);
        }
        let spread = self.spread.entries_mut();
        self.algebraic.iter().zip(&self.correction).for_each(|(&i, &value)| spread[i] = value);
        Self::norm(&mut self.weights, bridge, y, &self.spread)
    }

    /// Weighted root mean square of `x` with the error weights at `y`.
    fn norm(weights: &mut Vector, bridge: &Bridge, y: &Vector, x: &Vector) -> f64 {
        bridge.error_weights(y, weights);
        bridge.operations.norm(x, weights)
    }

    /// Moves `y` along the correction so far that the next correction, with the same g_z, gets
    /// smaller; returns its size in tolerances.
    fn damped_step(&mut self, bridge: &mut Bridge, t: f64, (y, yp): (&mut Vector, &Vector), enough: f64) -> Option<f64> {
        self.work.entries_mut().copy_from_slice(self.spread.entries());
        bridge.error_weights(y, &mut self.reference);
        let operations = bridge.operations;
        let size = operations.norm(&self.spread, &self.reference);
        for (start, &i) in self.start.iter_mut().zip(&self.algebraic) {
            *start = y.entries()[i];
        }
        let mut damping = 1.0;
        while damping >= MIN_DAMPING {
            for (start, &i) in self.start.iter().zip(&self.algebraic) {
                y.entries_mut()[i] = start + damping * self.work.entries()[i];
            }
            if self.evaluate(bridge, t, y, yp).is_ok() {
                let next = self.correct(bridge, y);
                // Below the last correction only roundoff is left.
                if operations.norm(&self.spread, &self.reference) <= (1.0 - 0.5 * damping) * size || next <= enough {
                    return Some(next);
                }
            }
            damping *= 0.5;
        }
        None
    }

    /// Sets the algebraic entries of y' and returns the first step whose estimated local error is
    /// `safety` tolerances (infinite if y'' is zero).
    pub(super) fn first_step(&mut self, start: &mut Start<'_>, safety: f64) -> Result<f64, Inconsistent> {
        let Start { bridge, time, interval, y, yp, quadratures } = start;
        let (t, later) = (*time, *time + (1e-7 * *interval).max(1e-8 * time.abs()).min(*interval));
        bridge.jacobian(t, 0.0, y, yp).map_err(|_| Inconsistent::Callback)?;
        self.factorise_values(bridge)?;
        self.time_derivative(bridge, t, later, y, yp)?;
        self.accumulate(bridge, yp, |differential, row_differential| differential && !row_differential);
        std::mem::swap(&mut self.work, &mut self.residual);
        self.solve_rates(yp);
        std::mem::swap(&mut self.work, &mut self.residual);
        self.accumulate(bridge, yp, |_, row_differential| row_differential);
        self.clear_algebraic();
        let mut size = Self::norm(&mut self.weights, bridge, y, &self.work);
        if let Some(quadratures) = quadratures {
            self.move_ahead(y, yp, later - t);
            let change = quadratures.change(bridge, later, &self.work, yp).map_err(|_| Inconsistent::Callback)?;
            size = size.max(change / (later - t));
        }
        Ok((2.0 * safety / size).sqrt())
    }

    /// Sets the rates of the algebraic unknowns from what their equations' other terms amount to,
    /// in `residual`.
    fn solve_rates(&mut self, yp: &mut Vector) {
        let Some(block) = &mut self.block else { return };
        for (correction, &i) in self.correction.iter_mut().zip(&self.algebraic) {
            *correction = -self.residual.entries()[i];
        }
        block.solve(&mut self.correction);
        let rates = yp.entries_mut();
        self.algebraic.iter().zip(&self.correction).for_each(|(&i, &value)| rates[i] = value);
    }

    /// Zeros in `work` where unknowns are algebraic.
    fn clear_algebraic(&mut self) {
        let work = self.work.entries_mut();
        self.algebraic.iter().for_each(|&i| work[i] = 0.0);
    }

    /// Leaves the state that is `ahead` on the straight line from `y` in `work`.
    fn move_ahead(&mut self, y: &Vector, yp: &Vector, ahead: f64) {
        let there = self.work.entries_mut().iter_mut().zip(y.entries()).zip(yp.entries());
        there.for_each(|((there, y), yp)| *there = ahead.mul_add(*yp, *y));
    }

    /// Shortens a first `step`, at most `bound`, over which the rates change, although they may be
    /// the same again at its end, where the error test looks. What rests and is not `forced` stays
    /// at rest.
    pub(super) fn look_ahead(&mut self, start: &mut Start<'_>, step: f64, bound: f64, forced: bool) -> f64 {
        if step < LONG * bound || !(forced || Self::norm(&mut self.weights, start.bridge, start.y, start.yp) * step > AT_REST) {
            return step;
        }
        let mut before = 0.0;
        for share in LOOKS {
            let ahead = share * step;
            match self.change_ahead(start, ahead) {
                Ok(change) if change * ahead <= 1.0 => before = ahead,
                Ok(_) => return 0.5 * ahead,
                Err(_) => {
                    // The integrator is to find out by itself what happens there.
                    start.bridge.trouble = None;
                    return if before > 0.0 { before } else { 0.5 * ahead };
                }
            }
        }
        step
    }

    /// The change of the rates on the straight line from the start, in tolerances a unit of time.
    fn change_ahead(&mut self, start: &mut Start<'_>, ahead: f64) -> Result<f64, Inconsistent> {
        let Start { bridge, time, y, yp, quadratures, .. } = start;
        let t = *time + ahead;
        self.move_ahead(y, yp, ahead);
        bridge.residual(t, &self.work, yp, &mut self.residual).map_err(|_| Inconsistent::Callback)?;
        let of_integrals = match quadratures {
            Some(quadratures) => quadratures.change(bridge, t, &self.work, yp).map_err(|_| Inconsistent::Callback)?,
            None => 0.0,
        };
        self.follow_algebraic(bridge, y);
        Ok(Self::norm(&mut self.weights, bridge, y, &self.residual).max(of_integrals))
    }

    /// From the residual, the change of the rates if the algebraic unknowns follow, by the Jacobian
    /// at the beginning.
    fn follow_algebraic(&mut self, bridge: &Bridge, y: &Vector) {
        if self.algebraic.is_empty() {
            return;
        }
        self.correct(bridge, y);
        let change = self.residual.entries_mut();
        for (&column, &correction) in self.algebraic.iter().zip(&self.correction) {
            change[column] = 0.0;
            for entry in self.pattern.column(column) {
                let row = self.pattern.rows()[entry];
                if self.differential[row] {
                    change[row] = bridge.values[entry].mul_add(correction, change[row]);
                }
            }
        }
    }

    /// Leaves ∂F/∂t in `work`: zero to the bit in rows where time does not occur.
    fn time_derivative(&mut self, bridge: &mut Bridge, t: f64, later: f64, y: &Vector, yp: &Vector) -> Result<(), Inconsistent> {
        bridge
            .residual(t, y, yp, &mut self.residual)
            .and_then(|()| bridge.residual(later, y, yp, &mut self.work))
            .map_err(|_| Inconsistent::Callback)?;
        let work = self.work.entries_mut();
        for (work, &now) in work.iter_mut().zip(self.residual.entries()) {
            *work = (*work - now) / (later - t);
        }
        Ok(())
    }

    /// Adds ∂F/∂y `yp` to `work`, over the entries where `takes(column is differential, row is
    /// differential)`.
    fn accumulate(&mut self, bridge: &Bridge, yp: &Vector, takes: impl Fn(bool, bool) -> bool) {
        let work = self.work.entries_mut();
        for (column, &slope) in yp.entries().iter().enumerate() {
            for entry in self.pattern.column(column) {
                let row = self.pattern.rows()[entry];
                if takes(self.differential[column], self.differential[row]) {
                    work[row] = bridge.values[entry].mul_add(slope, work[row]);
                }
            }
        }
    }
}

/// Rounding level of corrections, in tolerances.
fn rounding(bridge: &Bridge) -> f64 {
    bridge.in_tolerances(ROUNDING).min(MOST_ROUNDING)
}

/// Index of the largest entry in tolerances; NaN is larger than all others.
pub(crate) fn largest(entries: &[f64], weights: &[f64]) -> Option<usize> {
    let sizes = entries.iter().zip(weights).map(|(x, w)| (x * w).abs());
    let order = |x: f64| if x.is_nan() { f64::INFINITY } else { x };
    sizes.map(order).enumerate().filter(|&(_, size)| size > 0.0).max_by(|a, b| a.1.total_cmp(&b.1)).map(|(at, _)| at)
}
