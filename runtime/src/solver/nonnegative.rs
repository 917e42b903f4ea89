//! States that never fall below zero.
//!
//! The equations see such a state at zero where it is negative (see [`System::nonnegative`]), so
//! that roots and powers stay defined between the ends of steps. A step whose end is negative by
//! more than the absolute tolerance is taken again, shorter; an end within it is set to zero (L. F.
//! Shampine, S. Thompson, J. A. Kierzenka and G. D. Byrne, *Appl. Math. Comput.* 170 (2005) 556).
//! Equations that lead below zero make every step end there: what such steps raise a state by is
//! summed, and limited.

use super::{Settings, System};

/// Absolute tolerances by which steps in a row may raise a state.
const MOST: f64 = 100.0;

/// Part of the way to zero that a step goes after one that went beyond; and bounds of how much
/// shorter it is.
const SHORT_OF: f64 = 0.9;
const LEAST: f64 = 0.1;
const UNKNOWN: f64 = 0.25;

/// The nonnegative states of a system, and how far steps have raised them.
#[derive(Default)]
pub(crate) struct Nonnegative {
    states: Box<[u32]>,
    /// Absolute tolerances.
    slack: Box<[f64]>,
    /// The largest rise in the step that is tried, in tolerances, and its state.
    rise: f64,
    state: usize,
    /// Sum over the accepted steps that ended below zero, one after another.
    sum: f64,
}

impl Nonnegative {
    /// Takes the states of a system and their tolerances.
    pub(crate) fn new(system: &dyn System, settings: &Settings) -> Self {
        let states: Box<[u32]> = system.nonnegative().into();
        let slack = states.iter().map(|&at| settings.atol[at as usize].max(f64::MIN_POSITIVE)).collect();
        Self { states, slack, rise: 0.0, state: 0, sum: 0.0 }
    }

    /// The states, by their places.
    pub(crate) fn states(&self) -> &[u32] {
        &self.states
    }

    /// A step is tried.
    #[inline]
    pub(crate) fn begin(&mut self) {
        self.rise = 0.0;
    }

    /// Returns whether a state, by its number among these, has to be set to zero at the end of a
    /// step.
    ///
    /// # Errors
    /// The place of the state if it is too far below zero.
    #[inline]
    pub(crate) fn raises(&mut self, number: usize, value: f64) -> Result<bool, usize> {
        if value.is_nan() || value >= 0.0 {
            return Ok(false);
        }
        let (at, rise) = (self.states[number] as usize, -value / self.slack[number]);
        if rise > 1.0 {
            return Err(at);
        }
        if rise > self.rise {
            (self.rise, self.state) = (rise, at);
        }
        Ok(true)
    }

    /// Sets negative states within their tolerances to zero.
    ///
    /// # Errors
    /// The place of a state that is further below zero.
    #[inline]
    pub(crate) fn raise(&mut self, y: &mut [f64]) -> Result<(), usize> {
        for number in 0..self.states.len() {
            let at = self.states[number] as usize;
            if self.raises(number, y[at])? {
                y[at] = 0.0;
            }
        }
        Ok(())
    }

    /// Sets all negative states to zero, where an interpolation has led there.
    #[inline]
    pub(crate) fn clip(&self, y: &mut [f64]) {
        for &at in &*self.states {
            let value = &mut y[at as usize];
            *value = if *value < 0.0 { 0.0 } else { *value };
        }
    }

    /// Takes the step that was tried last as accepted.
    ///
    /// # Errors
    /// The place of the state that the equations lead below zero.
    #[inline]
    pub(crate) fn accept(&mut self) -> Result<(), usize> {
        let rise = std::mem::take(&mut self.rise);
        self.sum = if rise > 0.0 { self.sum + rise } else { 0.0 };
        if self.sum > MOST { Err(self.state) } else { Ok(()) }
    }

    /// An integration begins at these unknowns.
    ///
    /// # Errors
    /// The place of a state that is below zero by more than its tolerance.
    pub(crate) fn restart(&mut self, y: &mut [f64]) -> Result<(), usize> {
        (self.rise, self.sum) = (0.0, 0.0);
        self.raise(y)
    }
}

/// Part to which a step has to be shortened after one that led from `begin` to `end`, below zero.
pub(crate) fn shorter(begin: f64, end: f64) -> f64 {
    let part = SHORT_OF * begin / (begin - end);
    if part > LEAST { part } else { UNKNOWN }
}

/// The unknowns that equations see: with nonnegative states at zero where they are below it.
#[inline]
pub(crate) fn seen<'a>(states: &[u32], y: &'a [f64], space: &'a mut [f64]) -> &'a [f64] {
    if states.iter().all(|&at| y[at as usize] >= 0.0) {
        return y;
    }
    let space = &mut space[..y.len()];
    space.copy_from_slice(y);
    for &at in states {
        space[at as usize] = if space[at as usize] < 0.0 { 0.0 } else { space[at as usize] };
    }
    space
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::problems;

    fn one(atol: f64) -> Nonnegative {
        let mut of = Nonnegative::new(&problems::robertson(), &Settings::new(1e-6, vec![atol; 3]));
        (of.states, of.slack) = ([1].into(), [atol].into());
        of
    }

    #[test]
    fn a_state_within_its_tolerance_below_zero_is_set_to_zero() {
        let mut of = one(1e-3);
        let mut y = [-1.0, -1e-4, f64::NAN];
        assert_eq!(of.raise(&mut y), Ok(()));
        assert_eq!(y[..2], [-1.0, 0.0]);
        assert_eq!(of.raise(&mut [0.0, -2e-3, 0.0]), Err(1));
    }

    #[test]
    fn steps_that_end_below_zero_again_and_again_are_refused() {
        let mut of = one(1.0);
        let mut steps = 0;
        while of.raise(&mut [0.0, -0.5, 0.0]).and_then(|()| of.accept()).is_ok() {
            steps += 1;
            of.begin();
        }
        assert_eq!(steps, 200);
        assert_eq!(of.restart(&mut [0.0, 1.0, 0.0]).and_then(|()| of.accept()), Ok(()));
    }

    #[test]
    fn a_shorter_step_ends_short_of_zero() {
        assert!((shorter(1.0, -1.0) - 0.45).abs() < 1e-15);
        assert_eq!(shorter(0.0, -1.0), UNKNOWN);
        assert_eq!(shorter(1e-9, -1.0), UNKNOWN);
    }
}
