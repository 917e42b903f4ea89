//! Backward differentiation formulas on steps of any lengths, and passes over matrices that carry
//! them out.
//!
//! The polynomial through the new point and the last k ones has the derivative `weight` S + Σ
//! `rates`ᵢ Sᵢ at the new point. The one through the last k + 1 points predicts Σ `values`ᵢ Sᵢ
//! there (R. K. Brayton, F. G. Gustavson and G. D. Hachtel, *Proc. IEEE* 60 (1972) 98).

use super::super::linear::columns::with_fma;

/// Highest order.
pub(super) const MAX_ORDER: usize = 5;

/// Points that are kept: one more than a prediction of one order more takes.
pub(super) const POINTS: usize = MAX_ORDER + 2;

/// Numbers that stay in registers.
const PIECE: usize = 16;

/// A formula of an order at a new point.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Formula {
    pub order: usize,
    /// Weights of the new value and of the last `order` ones in its derivative.
    pub weight: f64,
    pub rates: [f64; POINTS],
    /// Weights of the last `order + 1` values in the prediction.
    pub values: [f64; POINTS],
    /// Local error in parts of the difference to the prediction.
    pub error: f64,
}

impl Formula {
    /// Of an order at a time, behind points at `times`, latest first.
    pub(super) fn new(order: usize, time: f64, times: &[f64]) -> Self {
        let mut formula = Self { order, ..Self::default() };
        let last = &times[..order];
        formula.weight = last.iter().map(|&other| 1.0 / (time - other)).sum();
        for (i, &at) in last.iter().enumerate() {
            formula.rates[i] = product(time, last, i) / (at - time);
        }
        (0..=order).for_each(|i| formula.values[i] = product(time, &times[..=order], i));
        let own = 1.0 / formula.weight;
        formula.error = own / (time - times[order] + own);
        formula
    }

    /// The local error of this order in parts of the difference of another order's solution to this
    /// one's prediction.
    pub(super) fn error_of_other(&self, time: f64, times: &[f64]) -> f64 {
        1.0 / (self.weight * (time - times[self.order]))
    }
}

/// ∏ (time − tⱼ) / (tᵢ − tⱼ) over all j but i.
fn product(time: f64, times: &[f64], i: usize) -> f64 {
    let others = times.iter().enumerate().filter(|&(j, _)| j != i);
    others.map(|(_, &other)| (time - other) / (times[i] - other)).product()
}

/// Last points, latest first.
pub(super) type Points<'a> = [&'a [f64]; POINTS];

with_fma! {
    /// Sums of the last points by two lists of weights.
    pub(super) fn combine(points: &Points<'_>, formula: &Formula, rates: &mut [f64], values: &mut [f64]) = combine_portable
}

#[inline(always)]
fn combine_portable(points: &Points<'_>, formula: &Formula, rates: &mut [f64], values: &mut [f64]) {
    let length = rates.len().min(values.len());
    let mut first = 0;
    while first + PIECE <= length {
        let (a, b) = sums::<PIECE>(points, formula, first);
        rates[first..first + PIECE].copy_from_slice(&a);
        values[first..first + PIECE].copy_from_slice(&b);
        first += PIECE;
    }
    for at in first..length {
        let ([a], [b]) = sums::<1>(points, formula, at);
        (rates[at], values[at]) = (a, b);
    }
}

#[inline(always)]
fn sums<const B: usize>(points: &Points<'_>, formula: &Formula, first: usize) -> ([f64; B], [f64; B]) {
    let (mut a, mut b) = ([0.0; B], [0.0; B]);
    let weights = formula.rates.iter().zip(&formula.values);
    for (point, (&rate, &value)) in points.iter().zip(weights).take(formula.order + 1) {
        let point = &point[first..first + B];
        for lane in 0..B {
            a[lane] = rate.mul_add(point[lane], a[lane]);
            b[lane] = value.mul_add(point[lane], b[lane]);
        }
    }
    (a, b)
}

with_fma! {
    /// Sum of squares of the differences to a prediction, in tolerances: `atol` + `rtol` times the
    /// larger of new and old size.
    pub(super) fn distance(new: &[f64], old: &[f64], predicted: &[f64], rtol: f64, atol: &[f64]) -> f64 = distance_portable
}

#[inline(always)]
fn distance_portable(new: &[f64], old: &[f64], predicted: &[f64], rtol: f64, atol: &[f64]) -> f64 {
    let square = |new: f64, old: f64, predicted: f64, atol: f64| {
        let x = (new - predicted) / rtol.mul_add(new.abs().max(old.abs()), atol);
        x * x
    };
    let mut sums = [0.0; PIECE];
    let pieces = new.len() / PIECE * PIECE;
    for first in (0..pieces).step_by(PIECE) {
        let end = first + PIECE;
        let (new, old, predicted, atol) = (&new[first..end], &old[first..end], &predicted[first..end], &atol[first..end]);
        for lane in 0..PIECE {
            sums[lane] += square(new[lane], old[lane], predicted[lane], atol[lane]);
        }
    }
    let rest: f64 = (pieces..new.len()).map(|at| square(new[at], old[at], predicted[at], atol[at])).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On a polynomial of the formula's degree prediction and derivative are exact.
    #[test]
    fn polynomials_are_differentiated_exactly() {
        let times = [1.0, 0.7, 0.5, -0.1, -0.4, -1.3];
        for order in 1..=MAX_ORDER {
            let (time, formula) = (1.6, Formula::new(order, 1.6, &times));
            let power = |t: f64| (t - 0.3).powi(order as i32);
            let points: Vec<[f64; 1]> = times.iter().map(|&t| [power(t)]).collect();
            let points: Points<'_> = std::array::from_fn(|i| points.get(i).map_or(&[][..], |p| &p[..]));
            let (mut rate, mut value) = ([0.0], [0.0]);
            combine(&points, &formula, &mut rate, &mut value);
            let slope = order as f64 * (time - 0.3_f64).powi(order as i32 - 1);
            assert!((formula.weight * power(time) + rate[0] - slope).abs() < 1e-12 * slope, "order {order}");
            assert!((value[0] - power(time)).abs() < 1e-12 * power(time), "order {order}");
        }
    }

    /// Order k leaves the term of degree k + 1: its error and the difference to the prediction are
    /// known for a single step of S' = f(t).
    #[test]
    fn the_error_is_that_of_the_next_power() {
        let times = [1.0, 0.7, 0.5, -0.1, -0.4, -1.3];
        for order in 1..=MAX_ORDER {
            let (time, formula) = (1.6, Formula::new(order, 1.6, &times));
            let degree = order as i32 + 1;
            let sum = |weights: &[f64]| weights.iter().zip(times).map(|(w, t)| w * (t - 0.3).powi(degree)).sum::<f64>();
            let new = (f64::from(degree) * (time - 0.3_f64).powi(degree - 1) - sum(&formula.rates)) / formula.weight;
            let (error, difference) = (new - (time - 0.3_f64).powi(degree), new - sum(&formula.values));
            assert!((error.abs() - formula.error * difference.abs()).abs() < 1e-10 * error.abs(), "order {order}");
        }
    }
}
