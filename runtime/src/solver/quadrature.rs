//! Integrals beside the unknowns: their values, their tolerances, and what a first step has to know of them.
//!
//! IDA integrates along with its steps. Its order follows the unknowns: where these rest or run along straight lines it stays at one, whatever the
//! integrands do. So the integrals of a small system are taken step by step on the interpolating polynomial instead, by Boole's rule on as many
//! pieces as Simpson's rule needs to agree with it. Each point costs an interpolation of all unknowns, which is why large systems,
//! whose unknowns never all rest, leave their integrals to IDA.

use super::callbacks::Bridge;
use super::sundials::Context;
use super::vector::{Operations, Vector};
use super::{Quadratures, System};

/// Unknowns up to which integrals are taken on the interpolating polynomials.
const SMALL: usize = 200;

/// Most pieces of a step: beyond, an integrand jumps.
const MOST_PIECES: u32 = 64;

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
    /// Where they are taken step by step.
    pub by_steps: Option<BySteps>,
    /// Unknowns and derivatives at a point of a step.
    inside: [Vector; 2],
}

/// Integrals over one step after the other, along the interpolating polynomial.
pub(crate) struct BySteps {
    rtol: f64,
    atol: f64,
    /// Boole's and Simpson's sums.
    sums: [Box<[f64]>; 2],
    /// Integrands at a point of the step.
    rates: Box<[f64]>,
    /// Values before the last step, and where it began.
    before: Box<[f64]>,
    begin: f64,
}

impl Integrals {
    /// Those of a system; `None` if it has none.
    pub fn new(system: &dyn System, settings: &Quadratures, operations: Operations, context: &Context) -> Option<Self> {
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
    pub fn restart(&mut self, t: f64) {
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
    pub fn take(&mut self, bridge: &mut Bridge, to: f64) -> Result<(), i32> {
        let Some(steps) = &mut self.by_steps else { return Ok(()) };
        let [y, yp] = &mut self.inside;
        steps.take(to, self.values.entries_mut(), |t, rates| {
            bridge.interpolate(t, 0, y)?;
            bridge.interpolate(t, 1, yp)?;
            bridge.integrands(t, y, yp, rates)
        })
    }

    /// Relative tolerance, if the integrals are part of the error test.
    pub fn checked(&self) -> Option<f64> {
        self.checked.map(|(rtol, _)| rtol)
    }

    /// Evaluates the integrands where an interval begins. What they would amount to in it gives the tolerances: an integral that begins
    /// at zero is not asked for more digits than at its end.
    pub fn begin(&mut self, bridge: &mut Bridge, t: f64, interval: f64, y: &Vector, yp: &Vector) -> Result<(), i32> {
        let Some((rtol, atol)) = self.checked else { return Ok(()) };
        bridge.integrands(t, y, yp, &mut self.rates)?;
        for (tolerance, rate) in self.tolerances.entries_mut().iter_mut().zip(&self.rates) {
            let amount = (rate * interval).abs();
            *tolerance = if amount.is_finite() { rtol.mul_add(amount, atol) } else { atol };
        }
        Ok(())
    }

    /// Root mean square of the change of the integrands from the beginning to another point, in tolerances a unit of time; 0 if they are not part of the
    /// error test.
    pub fn change(&mut self, bridge: &mut Bridge, t: f64, y: &Vector, yp: &Vector) -> Result<f64, i32> {
        let Some((rtol, _)) = self.checked else { return Ok(0.0) };
        bridge.integrands(t, y, yp, &mut self.there)?;
        let tolerances = self.tolerances.entries().iter().zip(self.values.entries()).map(|(atol, value)| rtol.mul_add(value.abs(), *atol));
        let changes = self.there.iter().zip(&self.rates).zip(tolerances).map(|((there, here), tolerance)| (there - here) / tolerance);
        Ok((changes.map(|x| x * x).sum::<f64>() / self.rates.len() as f64).sqrt())
    }
}

impl BySteps {
    /// For so many integrals, with a relative and an absolute tolerance.
    pub fn new(count: usize, (rtol, atol): (f64, f64)) -> Self {
        let numbers = || vec![0.0; count].into_boxed_slice();
        Self { rtol, atol, sums: [numbers(), numbers()], rates: numbers(), before: numbers(), begin: 0.0 }
    }

    /// Everything begins at zero.
    pub fn restart(&mut self, t: f64) {
        self.before.fill(0.0);
        self.begin = t;
    }

    /// Begins a step: what has come to so far stays.
    pub(crate) fn next_step(&mut self, t: f64, values: &[f64]) {
        self.before.copy_from_slice(values);
        self.begin = t;
    }

    /// Takes the integrals to a time within the step; `integrands` writes their rates at a time.
    pub fn take<E>(&mut self, to: f64, values: &mut [f64], mut integrands: impl FnMut(f64, &mut [f64]) -> Result<(), E>) -> Result<(), E> {
        let mut pieces = 1;
        while !self.agree(to, pieces, &mut integrands)? && pieces < MOST_PIECES {
            pieces *= 2;
        }
        let sums = self.before.iter().zip(&self.sums[0]);
        values.iter_mut().zip(sums).for_each(|(value, (before, sum))| *value = before + sum);
        Ok(())
    }

    /// Boole's and Simpson's rule over so many pieces of the step up to a time; whether they agree to the tolerance.
    fn agree<E>(&mut self, to: f64, pieces: u32, integrands: &mut impl FnMut(f64, &mut [f64]) -> Result<(), E>) -> Result<bool, E> {
        let [boole, simpson] = &mut self.sums;
        boole.fill(0.0);
        simpson.fill(0.0);
        let points = 4 * pieces;
        let width = (to - self.begin) / f64::from(pieces);
        for point in 0..=points {
            let t = if point == points { to } else { self.begin + width * f64::from(point) / 4.0 };
            integrands(t, &mut self.rates)?;
            let end = point == 0 || point == points;
            let (in_boole, in_simpson) = match point % 4 {
                0 if end => (7.0, 1.0),
                0 => (14.0, 2.0),
                2 => (12.0, 4.0),
                _ => (32.0, 0.0),
            };
            for ((boole, simpson), rate) in boole.iter_mut().zip(simpson.iter_mut()).zip(&self.rates) {
                *boole += width * in_boole / 90.0 * rate;
                *simpson += width * in_simpson / 6.0 * rate;
            }
        }
        let sums = boole.iter().zip(simpson.iter()).zip(&self.before);
        let (rtol, atol) = (self.rtol, self.atol);
        // What is no number is told elsewhere.
        Ok(sums.map(|((boole, simpson), before)| (boole - simpson).abs() > rtol * (before + boole).abs() + atol).all(|far| !far))
    }
}
