//! Integrals in addition to the unknowns: their values, their tolerances, and what a first step has
//! to know of them.
//!
//! IDA integrates along with its steps. Its order follows the unknowns: where these rest or run
//! along straight lines it stays at one, whatever the integrands do. Therefore the integrals of a
//! small system are taken step by step on the interpolating polynomial. Boole's rule integrates
//! pieces, which are halved if Simpson's rule does not agree with it. One jump, as of
//! `if c > limit then 1 else 0`, costs some hundred points. Each point costs an interpolation of
//! all unknowns, which is why large systems, whose unknowns never all rest, leave their integrals
//! to IDA.

use std::array;

use super::callbacks::Bridge;
use super::sundials::Context;
use super::vector::{Operations, Vector};
use super::{Quadratures, System};

/// Unknowns up to which integrals are taken on the interpolating polynomials.
const SMALL: usize = 200;

/// Most halvings of a piece of a step: in one that is so short nothing counts, whatever jumps
/// there.
const MOST_HALVINGS: u32 = 40;

/// Pieces of a step, and halvings of what is left of it where there are so many of them.
const MOST_PIECES: u32 = 1024;
const EVENLY: u32 = 6;

/// The least part of the tolerance that a piece has: pieces in which an integrand jumps are few.
const LEAST_SHARE: f64 = 1.0 / 64.0;

/// The integrals of an integrator.
pub(crate) struct Integrals {
    /// Their values, which IDA adds to.
    pub values: Vector,
    /// Absolute tolerances from the present start on.
    pub tolerances: Vector,
    /// Integrands at the present start, and elsewhere.
    rates: Box<[f64]>,
    there: Box<[f64]>,
    /// Relative and absolute tolerance, where they are part of the error test.
    checked: Option<(f64, f64)>,
    /// Data of integrals that are computed step by step.
    pub by_steps: Option<BySteps>,
    /// Unknowns and derivatives at a point of a step.
    inside: [Vector; 2],
}

/// Integrals over one step after the other, along the interpolating polynomial.
pub(crate) struct BySteps {
    rtol: f64,
    atol: f64,
    /// Boole's and Simpson's sums over a piece.
    sums: [Box<[f64]>; 2],
    /// Integrands at the ends of a piece, in its middle and half way.
    points: [Box<[f64]>; 5],
    /// Estimate of the whole step in one piece.
    expected: Box<[f64]>,
    /// Values before the last step, and where it began.
    before: Box<[f64]>,
    begin: f64,
}

impl Integrals {
    /// Those of a system; `None` if it has none.
    pub(super) fn new(system: &dyn System, settings: &Quadratures, operations: Operations, context: &Context) -> Option<Self> {
        let count = system.quadrature_count();
        let zeros = || Vector::zeros(count, operations, context);
        let checked = match *settings {
            Quadratures::Unchecked => None,
            Quadratures::Checked { rtol, atol } => Some((rtol, atol)),
        };
        let numbers = || vec![0.0; count].into_boxed_slice();
        let unknown = || Vector::zeros(system.dimension(), operations, context);
        let small = count > 0 && system.dimension() <= SMALL;
        let by_steps = checked.filter(|_| small).map(|tolerances| BySteps::new(count, tolerances));
        let checked = checked.filter(|_| by_steps.is_none());
        let inside = [unknown(), unknown()];
        let mut tolerances = zeros();
        // IDA looks at them before a start is known: none may be zero.
        tolerances.entries_mut().fill(checked.map_or(0.0, |(_, atol)| atol.max(f64::MIN_POSITIVE)));
        (count > 0).then(|| Self { values: zeros(), tolerances, rates: numbers(), there: numbers(), checked, by_steps, inside })
    }

    /// Zero at a restart.
    pub(super) fn restart(&mut self, t: f64) {
        self.values.entries_mut().fill(0.0);
        if let Some(steps) = &mut self.by_steps {
            steps.restart(t);
        }
    }

    /// Begins a step: what has come to so far stays.
    pub(crate) fn next_step(&mut self, t: f64) {
        if let Some(steps) = &mut self.by_steps {
            steps.next_step(t, self.values.entries());
        }
    }

    /// Takes the integrals from the beginning of IDA's last step to a time in it.
    pub(super) fn take(&mut self, bridge: &mut Bridge, to: f64) -> Result<(), i32> {
        let Some(steps) = &mut self.by_steps else { return Ok(()) };
        let [y, yp] = &mut self.inside;
        steps.take(to, self.values.entries_mut(), |t, rates| {
            bridge.interpolate(t, 0, y)?;
            bridge.interpolate(t, 1, yp)?;
            bridge.integrands(t, y, yp, rates)
        })
    }

    /// Relative tolerance, if the integrals are part of the error test.
    pub(super) fn checked(&self) -> Option<f64> {
        self.checked.map(|(rtol, _)| rtol)
    }

    /// Evaluates the integrands where an interval begins. What they would amount to in it gives the
    /// tolerances: an integral that begins at zero is not asked for more digits than at its end.
    pub(super) fn begin(&mut self, bridge: &mut Bridge, t: f64, interval: f64, y: &Vector, yp: &Vector) -> Result<(), i32> {
        let Some((rtol, atol)) = self.checked else { return Ok(()) };
        bridge.integrands(t, y, yp, &mut self.rates)?;
        for (tolerance, rate) in self.tolerances.entries_mut().iter_mut().zip(&self.rates) {
            let amount = (rate * interval).abs();
            *tolerance = if amount.is_finite() { rtol.mul_add(amount, atol) } else { atol };
        }
        Ok(())
    }

    /// Root mean square of the change of the integrands from the beginning to another point, in
    /// tolerances a unit of time. It is 0 if they are not part of the error test.
    pub(super) fn change(&mut self, bridge: &mut Bridge, t: f64, y: &Vector, yp: &Vector) -> Result<f64, i32> {
        let Some((rtol, _)) = self.checked else { return Ok(0.0) };
        bridge.integrands(t, y, yp, &mut self.there)?;
        let tolerances = self.tolerances.entries().iter().zip(self.values.entries()).map(|(atol, value)| rtol.mul_add(value.abs(), *atol));
        let changes = self.there.iter().zip(&self.rates).zip(tolerances).map(|((there, here), tolerance)| (there - here) / tolerance);
        Ok((changes.map(|x| x * x).sum::<f64>() / self.rates.len() as f64).sqrt())
    }
}

impl BySteps {
    /// For so many integrals, with a relative and an absolute tolerance.
    pub(super) fn new(count: usize, (rtol, atol): (f64, f64)) -> Self {
        let numbers = || vec![0.0; count].into_boxed_slice();
        Self {
            rtol,
            atol,
            sums: array::from_fn(|_| numbers()),
            points: array::from_fn(|_| numbers()),
            expected: numbers(),
            before: numbers(),
            begin: 0.0,
        }
    }

    /// Everything begins at zero.
    pub(super) fn restart(&mut self, t: f64) {
        self.before.fill(0.0);
        self.begin = t;
    }

    /// Begins a step: what has come to so far stays.
    pub(crate) fn next_step(&mut self, t: f64, values: &[f64]) {
        self.before.copy_from_slice(values);
        self.begin = t;
    }

    /// Takes the integrals to a time within the step; `integrands` writes their rates at a time.
    pub(super) fn take<E>(
        &mut self,
        to: f64,
        values: &mut [f64],
        mut integrands: impl FnMut(f64, &mut [f64]) -> Result<(), E>,
    ) -> Result<(), E> {
        values.copy_from_slice(&self.before);
        let (mut piece, mut pieces, mut fresh) = (Piece::default(), 0, &[0, 1, 2, 3, 4][..]);
        loop {
            for &point in fresh {
                integrands(piece.time(self.begin, to, point), &mut self.points[point])?;
            }
            self.sum_up((to - self.begin) * piece.share());
            if piece.halvings == 0 {
                self.expected.copy_from_slice(&self.sums[0]);
            }
            let most = if pieces < MOST_PIECES { MOST_HALVINGS } else { EVENLY };
            if piece.halvings < most && !self.agree(values, piece.share()) {
                piece = piece.first_half();
                // The first three points of the whole are the outer ones and the middle of its
                // first half.
                self.points.swap(2, 4);
                self.points.swap(1, 2);
                fresh = &[1, 3];
                continue;
            }
            values.iter_mut().zip(&self.sums[0]).for_each(|(value, sum)| *value += sum);
            pieces += 1;
            let Some(next) = piece.next() else { return Ok(()) };
            piece = next;
            self.points.swap(0, 4);
            fresh = &[1, 2, 3, 4];
        }
    }

    /// Boole's and Simpson's rule over a piece of this width.
    fn sum_up(&mut self, width: f64) {
        let [boole, simpson] = &mut self.sums;
        boole.fill(0.0);
        simpson.fill(0.0);
        for (rates, (in_boole, in_simpson)) in self.points.iter().zip([(7.0, 1.0), (32.0, 0.0), (12.0, 4.0), (32.0, 0.0), (7.0, 1.0)]) {
            for ((boole, simpson), rate) in boole.iter_mut().zip(simpson.iter_mut()).zip(rates) {
                *boole += width * in_boole / 90.0 * rate;
                *simpson += width * in_simpson / 6.0 * rate;
            }
        }
    }

    /// Returns `true` if both rules agree over a piece that is this share of the step: to its share
    /// of the tolerance, or to the least one.
    fn agree(&self, values: &[f64], share: f64) -> bool {
        let (rtol, atol, share) = (self.rtol, self.atol, share.max(LEAST_SHARE));
        let [boole, simpson] = &self.sums;
        let sizes = self.before.iter().zip(&self.expected).zip(values.iter().zip(boole));
        let sizes = sizes.map(|((before, expected), (value, boole))| (before + expected).abs().max((value + boole).abs()));
        // What is not a number is stated elsewhere.
        boole
            .iter()
            .zip(simpson)
            .zip(sizes)
            .map(|((boole, simpson), size)| (boole - simpson).abs() > share * (rtol * size + atol))
            .all(|far| !far)
    }
}

/// A piece of a step, which was halved so often: that of this number.
#[derive(Clone, Copy, Default)]
struct Piece {
    halvings: u32,
    number: u64,
}

impl Piece {
    /// Its part of the step.
    fn share(self) -> f64 {
        1.0 / (1_u64 << self.halvings) as f64
    }

    /// The time of one of its five points in a step from `begin` to `end`.
    fn time(self, begin: f64, end: f64, point: usize) -> f64 {
        let quarters = 4 * self.number + point as u64;
        if quarters == 4 << self.halvings { end } else { begin + (end - begin) * self.share() / 4.0 * quarters as f64 }
    }

    fn first_half(self) -> Self {
        Self { halvings: self.halvings + 1, number: 2 * self.number }
    }

    /// The largest piece that begins where this one ends; `None` at the end of the step.
    fn next(self) -> Option<Self> {
        let behind = self.number + 1;
        let whole = behind.trailing_zeros().min(self.halvings);
        (whole < self.halvings).then(|| Self { halvings: self.halvings - whole, number: behind >> whole })
    }
}

#[cfg(test)]
mod tests {
    use super::BySteps;

    /// Integrals from 0 to `end`, and how often the integrands were asked for.
    fn integrals(end: f64, integrands: impl Fn(f64) -> [f64; 2]) -> ([f64; 2], u32) {
        let (mut steps, mut values, mut asked) = (BySteps::new(2, (1e-10, 1e-12)), [0.0; 2], 0);
        steps.restart(0.0);
        let taken: Result<(), ()> = steps.take(end, &mut values, |t, rates| {
            asked += 1;
            rates.copy_from_slice(&integrands(t));
            Ok(())
        });
        assert_eq!(taken, Ok(()));
        (values, asked)
    }

    fn assert_near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
    }

    #[test]
    fn jumps_and_kinks_are_found_to_the_tolerance() {
        let begin = 2.0_f64.sqrt();
        let ([time, area], asked) = integrals(3.0, |t| [f64::from(t > begin), (t - begin).max(0.0)]);
        assert_near(time, 3.0 - begin, 2e-10);
        assert_near(area, (3.0 - begin).powi(2) / 2.0, 2e-10);
        assert!(asked < 300, "{asked} evaluations");
    }

    #[test]
    fn many_jumps_are_found_one_by_one() {
        let ([odd, _], _) = integrals(10.0, |t| [(0.3 * t).fract().mul_add(2.0, -1.0).signum(), 0.0]);
        assert_near(odd, 0.0, 2e-9);
    }

    #[test]
    fn smooth_integrands_take_five_points_and_more_where_they_turn() {
        let ([square, _], asked) = integrals(2.0, |t| [t * t, 1.0]);
        assert_near(square, 8.0 / 3.0, 1e-15);
        assert_eq!(asked, 5);
        let ([sine, cosine], _) = integrals(30.0, |t| [t.sin(), t.cos()]);
        assert_near(sine, 1.0 - 30.0_f64.cos(), 1e-10);
        assert_near(cosine, 30.0_f64.sin(), 1e-10);
    }
}
