//! The length of steps.
//!
//! By the error of the last two steps (a PI controller: K. Gustafsson, Control of error and
//! convergence in ODE solvers, thesis, Lund 1992). Before an ignition, steps have to become shorter
//! and shorter. Those of order eight then follow his prediction: the step that fits changes again
//! by the ratio by which it changed last. Powers are taken by square roots, which every processor
//! rounds alike.

/// Part of the step that the error would allow.
const SAFETY: f64 = 0.9;

/// Bounds of the change from step to step.
const LEAST: f64 = 0.1;
const MOST: f64 = 8.0;

/// Errors below count as this.
const SMALLEST_ERROR: f64 = 1e-9;

/// An error below this is worth the longest step of the method of order eight: `(SAFETY / MOST)^8`
/// is a little more.
const NEGLIGIBLE: f64 = 2e-8;

/// Growth of a method's error with its step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Growth {
    /// With its fifth power.
    Fifth,
    /// With its eighth power.
    Eighth,
}

/// Data for the choice of the next step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Control {
    /// The step that fits; zero where none is known.
    pub proposed: f64,
    /// A root of the error of the last accepted step: of order 32, or eight with that method.
    last: f64,
    /// Length of that step if its error shows which step fits; zero otherwise.
    before: f64,
    /// The last attempt was rejected.
    rejected: bool,
}

/// The root of order eight.
fn root8(x: f64) -> f64 {
    x.sqrt().sqrt().sqrt()
}

/// The root of order 32.
fn root32(x: f64) -> f64 {
    root8(x).sqrt().sqrt()
}

/// The first step for rates that amount to `speed` tolerances a unit of time and change by `change`
/// of them in one, found by a look `ahead`. Infinite for what rests (Hairer, Nørsett and Wanner,
/// *Solving Ordinary Differential Equations I*, section II.4).
pub(super) fn first_step(speed: f64, change: f64, ahead: f64, growth: Growth) -> f64 {
    let most = speed.max(change);
    if most == 0.0 {
        return f64::INFINITY;
    }
    let root = root32(0.01 / most);
    let power = root * root * root * root;
    let step = match growth {
        Growth::Fifth => power * root * root,
        Growth::Eighth => power,
    };
    step.min(100.0 * ahead)
}

impl Control {
    /// Begins with a step, without history.
    pub(super) fn begin(step: f64) -> Self {
        Self { proposed: step, last: 1.0, before: 0.0, rejected: false }
    }

    /// The step to take where so much is left: equal ones where few fit.
    pub(crate) fn fit(&self, left: f64, longest: f64) -> f64 {
        let step = self.proposed.min(longest);
        // Rounding is not a reason for one more.
        let pieces = (left / step - 1e-9).ceil();
        if pieces <= 1.0 {
            left
        } else if pieces <= 4.0 {
            left / pieces
        } else {
            step
        }
    }

    /// Notes the error of an accepted step, in tolerances.
    pub(super) fn accept(&mut self, step: f64, error: f64, growth: Growth) {
        if growth == Growth::Eighth && error < NEGLIGIBLE {
            // As below, without its roots; `last` is the other method's, and that begins anew.
            let next = step * if self.rejected { 1.0 } else { MOST };
            *self = Self::begin(if step < self.proposed { next.max(self.proposed) } else { next });
            return;
        }
        let error = error.max(SMALLEST_ERROR);
        let (root, factor) = match growth {
            Growth::Fifth => {
                // Exponents 5/32 and 1/32.
                let root = root32(error);
                (root, SAFETY * self.last / (root * root * root * root * root))
            }
            Growth::Eighth => {
                let root = root8(error);
                (root, self.predict(step, root))
            }
        };
        let most = if self.rejected { 1.0 } else { MOST };
        let next = step * factor.clamp(LEAST, most);
        // A step that was cut at the end says nothing against a longer one.
        self.proposed = if factor >= 1.0 && step < self.proposed { next.max(self.proposed) } else { next };
        self.last = root;
        self.rejected = false;
    }

    /// Factor of the step after an accepted one of order eight, by the root of its error. A step
    /// that fits less than the one before is followed by one that fits less again. Notes the step.
    fn predict(&mut self, step: f64, root: f64) -> f64 {
        let factor = SAFETY / root;
        let before = std::mem::replace(&mut self.before, if factor < MOST { step } else { 0.0 });
        let change = (step * self.last) / (before * root);
        if before > 0.0 && self.before > 0.0 && change < 1.0 { factor * change } else { factor }
    }

    /// The step that the error of the one just accepted asks for; infinite where it was so small
    /// that growth alone is bounded.
    pub(crate) fn limit(&self, step: f64) -> f64 {
        if self.proposed < MOST * step { self.proposed } else { f64::INFINITY }
    }

    /// Notes that a step was rejected for another reason than its error, and a length that may fit.
    pub(crate) fn shorten(&mut self, step: f64) {
        self.proposed = step;
        self.rejected = true;
    }

    /// Notes the error of a step that was rejected; infinite if missing.
    pub(crate) fn reject(&mut self, step: f64, error: f64, growth: Growth) {
        let factor = match growth {
            Growth::Fifth => {
                let root = root32(error);
                SAFETY / (root * root * root * root * root * root)
            }
            Growth::Eighth => SAFETY / root8(error),
        };
        self.proposed = step * if error.is_finite() { factor.clamp(LEAST, SAFETY) } else { 0.25 };
        self.rejected = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_steps_are_made_equal_and_the_last_one_ends_exactly() {
        let control = Control::begin(0.4);
        assert_eq!(control.fit(1.0, f64::INFINITY), 1.0 / 3.0);
        assert_eq!(control.fit(0.4, f64::INFINITY), 0.4);
        assert_eq!(control.fit(100.0, f64::INFINITY), 0.4);
        assert_eq!(control.fit(100.0, 0.1), 0.1);
    }

    #[test]
    fn a_step_that_was_cut_does_not_shorten_the_next_one() {
        let mut control = Control::begin(2.0);
        control.accept(0.1, 1e-3, Growth::Fifth);
        assert_eq!(control.proposed, 2.0);
        control.accept(0.1, 2.0, Growth::Fifth);
        assert!(control.proposed < 0.1);
    }

    #[test]
    fn a_negligible_error_needs_no_roots_for_the_same_step() {
        assert!(SAFETY / root8(NEGLIGIBLE) > MOST);
        for (rejected, proposed) in [(false, 1.0), (false, 20.0), (true, 0.5)] {
            let lengths = [0.999 * NEGLIGIBLE, 1.001 * NEGLIGIBLE].map(|error| {
                let mut control = Control { rejected, ..Control::begin(proposed) };
                control.accept(1.0, error, Growth::Eighth);
                control.proposed
            });
            assert_eq!(lengths[0], lengths[1], "{rejected} {proposed}");
        }
    }

    #[test]
    fn steps_that_become_shorter_go_on_to_do_so() {
        // The step that fits falls by a twentieth from step to step.
        let error = |step: f64, fitting: f64| (step / fitting).powi(8);
        let mut control = Control::begin(0.9);
        let mut fitting = 1.0;
        for k in 0..6 {
            let step = control.proposed;
            let found = error(step, fitting);
            assert!(found <= 1.0, "step {k} is rejected with an error of {found}");
            control.accept(step, found, Growth::Eighth);
            fitting *= 0.95;
        }
        assert!((control.proposed / (SAFETY * fitting) - 1.0).abs() < 0.01, "{}", control.proposed);
    }

    #[test]
    fn a_step_that_fits_for_longer_grows_by_its_error_alone() {
        let mut control = Control::begin(1.0);
        control.accept(1.0, 0.5, Growth::Eighth);
        control.accept(1.0, 0.01, Growth::Eighth);
        let expected = SAFETY / 0.01_f64.powf(0.125);
        assert!((control.proposed / expected - 1.0).abs() < 1e-12, "{}", control.proposed);
    }

    #[test]
    fn after_a_rejection_steps_do_not_grow_at_once() {
        let mut control = Control::begin(1.0);
        control.reject(1.0, 100.0, Growth::Eighth);
        let step = control.proposed;
        assert!((0.1..0.9).contains(&step), "{step}");
        control.accept(step, 1e-6, Growth::Eighth);
        assert_eq!(control.proposed, step);
        control.reject(step, f64::INFINITY, Growth::Fifth);
        assert_eq!(control.proposed, 0.25 * step);
    }
}
