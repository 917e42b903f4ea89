//! Integrals beside the unknowns: their values, their tolerances, and what a first step has to know of them.

use sundials_sys::SUNContext;

use super::callbacks::Bridge;
use super::vector::{Operations, Vector};
use super::{Quadratures, System};

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
}

impl Integrals {
    /// Those of a system; `None` if it has none.
    pub fn new(system: &dyn System, settings: &Quadratures, operations: Operations, context: SUNContext) -> Option<Self> {
        let count = system.quadrature_count();
        let zeros = || Vector::zeros(count, operations, context);
        let checked = match *settings {
            Quadratures::Unchecked => None,
            Quadratures::Checked { rtol, atol } => Some((rtol, atol)),
        };
        let (rates, there) = (vec![0.0; count].into(), vec![0.0; count].into());
        (count > 0).then(|| Self { values: zeros(), tolerances: zeros(), rates, there, checked })
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
