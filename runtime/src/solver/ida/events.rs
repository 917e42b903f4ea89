//! Events: looked for at accepted states, found on the interpolating polynomial of the step in which they happened.

use std::os::raw::c_int;

use sundials_sys::{IDA_SUCCESS, IDA_TSTOP_RETURN, IDAGetDky, IDAGetQuadDky};

use super::setup::check;
use super::{Advance, Ida, Phase, SolveError};

/// How far ahead the motion of a root function is looked for, over the interval and over the time itself.
const AHEAD: [f64; 2] = [1e-7, 1e4 * f64::EPSILON];

/// What happens within this time happens at once, likewise.
const AT_ONCE: [f64; 2] = [1e-10, 100.0 * f64::EPSILON];

/// By this many times as much a condition has to move anew, where it became true at the end of an interval.
const AGAIN: f64 = 2.0;

/// Relative rounding of a state.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

impl Ida {
    fn span(&self, [of_interval, of_time]: [f64; 2]) -> f64 {
        (of_interval * self.scale).max(of_time * self.time.abs())
    }

    /// Conditions after a restart; whether one becomes true there.
    pub(super) fn settle(&mut self) -> Result<bool, SolveError> {
        let bridge = unsafe { &mut *self.bridge };
        if bridge.watch.is_empty() {
            return Ok(false);
        }
        bridge.watch.passed = false;
        bridge.watch.since = self.time;
        if bridge.evaluate_roots(self.time, self.y.entries(), self.yp.entries()).is_err() {
            return Err(self.fault());
        }
        if bridge.watch.is_at_threshold() {
            let ahead = self.span(AHEAD);
            // What is slow beside its own size shows further ahead.
            for ahead in [ahead, 1e3 * ahead, 1e6 * ahead] {
                self.evaluate_ahead(ahead)?;
                if bridge.watch.look_ahead() {
                    break;
                }
            }
        }
        let fired = bridge.watch.settle(&mut self.events);
        if fired {
            self.phase = Phase::Idle;
        }
        Ok(fired)
    }

    /// Steps to `t_end` or to the first event, which may be at `t_end` itself.
    pub(super) fn go_to_event(&mut self, t_end: f64) -> Result<Advance, SolveError> {
        match self.go(t_end)? {
            Advance::Reached if self.ends_at_event()? => Ok(Advance::Event),
            advance => Ok(advance),
        }
    }

    /// Whether a condition becomes true at the end of the interval although rounding puts its instant just behind: the next interval begins with
    /// other inputs, perhaps, under which it would not.
    fn ends_at_event(&mut self) -> Result<bool, SolveError> {
        let bridge = unsafe { &mut *self.bridge };
        if bridge.watch.is_empty() {
            return Ok(false);
        }
        let ahead = self.span(AHEAD);
        self.evaluate_along(ahead, false)?;
        bridge.watch.forget_noise();
        if !bridge.watch.is_about_to_stop(1.0) {
            return Ok(false);
        }
        self.measure_noise(self.time)?;
        self.derive();
        self.evaluate_ahead(ahead)?;
        let reach = self.span(AT_ONCE) / ahead;
        if !bridge.watch.is_about_to_stop(reach) {
            return Ok(false);
        }
        bridge.watch.arrive(AGAIN * reach, &mut self.events);
        self.phase = Phase::Idle;
        Ok(true)
    }

    /// Root functions a little later, along the derivatives; algebraic unknowns follow their equations.
    fn evaluate_ahead(&mut self, ahead: f64) -> Result<(), SolveError> {
        self.evaluate_along(ahead, true)
    }

    /// The same, where algebraic unknowns may go on along their derivatives too.
    fn evaluate_along(&mut self, ahead: f64, consistently: bool) -> Result<(), SolveError> {
        let bridge = unsafe { &mut *self.bridge };
        let Some((later, rate)) = &mut self.later else { return Ok(()) };
        let moved = self.y.entries().iter().zip(self.yp.entries()).map(|(y, yp)| y + ahead * yp);
        later.entries_mut().iter_mut().zip(moved).for_each(|(to, from)| *to = from);
        rate.entries_mut().copy_from_slice(self.yp.entries());
        if let Some(consistent) = self.consistent.as_mut().filter(|c| consistently && c.has_algebraic()) {
            // Where there is no solution ahead, the present algebraic unknowns have to do.
            if consistent.initialise(bridge, self.time + ahead, later, rate).is_err() {
                bridge.trouble = None;
            }
        }
        bridge.evaluate_roots_ahead(self.time + ahead, later.entries(), rate.entries()).map_err(|_| self.fault())
    }

    /// The derivatives that the equations give, in place of those of the polynomial, which may be off by the tolerance.
    fn derive(&mut self) {
        let bridge = unsafe { &mut *self.bridge };
        let (Some((later, rate)), Some(consistent)) = (&mut self.later, &mut self.consistent) else { return };
        later.entries_mut().copy_from_slice(self.y.entries());
        rate.entries_mut().fill(0.0);
        match consistent.initialise(bridge, self.time, later, rate) {
            Ok(()) => self.yp.entries_mut().copy_from_slice(rate.entries()),
            Err(_) => bridge.trouble = None,
        }
    }

    /// What of the root functions is rounding of the state, and of the time if another one is given.
    fn measure_noise(&mut self, time: f64) -> Result<(), SolveError> {
        let bridge = unsafe { &mut *self.bridge };
        let Some((later, _)) = &mut self.later else { return Ok(()) };
        for pattern in [1, 2] {
            // Signs of two patterns: a difference of two unknowns shows in one of them.
            let factor = |i: usize| 1.0 + if i & pattern == 0 { ROUNDING } else { -ROUNDING };
            let moved = self.y.entries().iter().enumerate().map(|(i, y)| y * factor(i));
            later.entries_mut().iter_mut().zip(moved).for_each(|(to, from)| *to = from);
            if bridge.evaluate_roots_ahead(time, later.entries(), self.yp.entries()).is_err() {
                return Err(self.fault());
            }
            bridge.watch.note_noise(pattern == 1);
        }
        Ok(())
    }

    /// Whether a condition has become true in what was just integrated.
    pub(super) fn has_passed_event(&mut self, value: c_int) -> Result<bool, SolveError> {
        let bridge = unsafe { &mut *self.bridge };
        if bridge.watch.passed || !matches!(value, IDA_SUCCESS | IDA_TSTOP_RETURN) {
            return Ok(bridge.watch.passed);
        }
        bridge.has_passed(self.time, self.y.entries(), self.yp.entries()).map_err(|_| self.fault())
    }

    /// Goes to the first instant at which a condition became true, to the rounding of time.
    pub(super) fn locate(&mut self) -> Result<(), SolveError> {
        let bridge = unsafe { &mut *self.bridge };
        let (mut low, mut high) = (bridge.watch.since, bridge.watch.until);
        let fine = f64::EPSILON * (high.abs() + (high - low));
        while high - low > fine {
            let middle = low + (high - low) / 2.0;
            self.interpolate(middle)?;
            if bridge.has_passed(middle, self.y.entries(), self.yp.entries()).map_err(|_| self.fault())? {
                high = middle;
            } else {
                low = middle;
            }
        }
        self.interpolate(high)?;
        self.take_integrals(high)?;
        self.time = high;
        if bridge.evaluate_roots(high, self.y.entries(), self.yp.entries()).is_err() {
            return Err(self.fault());
        }
        let ahead = self.span(AHEAD);
        self.measure_noise(self.time * (1.0 + ROUNDING))?;
        self.derive();
        self.evaluate_ahead(ahead)?;
        bridge.watch.arrive(self.span(AT_ONCE) / ahead, &mut self.events);
        self.phase = Phase::Idle;
        Ok(())
    }

    /// State, derivatives and quadratures at a time within the last step.
    fn interpolate(&mut self, t: f64) -> Result<(), SolveError> {
        unsafe {
            check("IDAGetDky", IDAGetDky(self.memory, t, 0, self.y.raw()))?;
            check("IDAGetDky", IDAGetDky(self.memory, t, 1, self.yp.raw()))?;
            if let Some(quadratures) = self.quadratures.as_ref().filter(|q| q.by_steps.is_none()) {
                check("IDAGetQuadDky", IDAGetQuadDky(self.memory, t, 0, quadratures.values.raw()))?;
            }
        }
        Ok(())
    }
}
