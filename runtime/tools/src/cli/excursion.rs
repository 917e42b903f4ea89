//! States that leave their declared bounds in the course of a run.

use smpl_runtime::environment::Environment;
use smpl_runtime::failure::{Short, unit_suffix};

/// Part of the range, or of the scale where bounds are open, beyond a bound from which an excursion
/// is reported.
const REPORTED: f64 = 0.1;

/// The largest excursion so far, at the ends of steps.
#[derive(Debug, Default)]
pub(super) struct Excursion {
    worst: Option<Worst>,
}

/// Time and place.
#[derive(Debug)]
struct Worst {
    /// Place among the states.
    element: usize,
    /// Distance from the bound in ranges.
    excess: f64,
    value: f64,
    time: f64,
}

impl Excursion {
    /// Looks at the present states.
    pub(super) fn look(&mut self, environment: &Environment) {
        let y = environment.unknowns();
        for (element, e) in environment.catalogue().states.elements().iter().enumerate() {
            let value = y[e.at];
            let beyond = (e.low - value).max(value - e.high);
            if beyond <= 0.0 {
                continue;
            }
            let range = e.high - e.low;
            let range = if range.is_finite() && range > 0.0 { range } else { e.scale.abs().max(f64::MIN_POSITIVE) };
            let excess = beyond / range;
            if excess > REPORTED && excess.is_finite() && self.worst.as_ref().is_none_or(|worst| excess > worst.excess) {
                self.worst = Some(Worst { element, excess, value, time: environment.time() });
            }
        }
    }

    /// The excursion in words, if there was one: `x = 5e12 m at t = 3 h is above its bound 10 m`.
    pub(super) fn describe(&self, environment: &Environment) -> Option<String> {
        let Worst { element, value, time, .. } = self.worst.as_ref()?;
        let e = environment.catalogue().states.elements().get(*element)?;
        let (unit, clock) = (unit_suffix(&e.unit), unit_suffix(&environment.setup().model().interface().time.unit));
        let (side, bound) = if *value > e.high { ("above", e.high) } else { ("below", e.low) };
        let (value, time, bound) = (Short(*value), Short(*time), Short(bound));
        Some(format!("`{}` leaves its declared bounds: {value}{unit} at t = {time}{clock} is {side} {bound}{unit}", e.name))
    }
}
