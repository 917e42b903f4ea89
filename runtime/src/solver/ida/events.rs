//! Breaks and events: what [`Traverse`] asks of IDA.

use std::os::raw::c_int;

use sundials_sys::{IDA_SUCCESS, IDA_TSTOP_RETURN};

use super::super::traverse::Traverse;
use super::super::watch::Watch;
use super::{Advance, Ida, Phase, SolveError};

impl Ida {
    /// Returns `true` if a condition has become true in what was just integrated.
    pub(super) fn has_passed_event(&mut self, value: c_int) -> Result<bool, SolveError> {
        let passed = self.watched().0.passed;
        if passed || !matches!(value, IDA_SUCCESS | IDA_TSTOP_RETURN) {
            return Ok(passed);
        }
        self.looks_passed()
    }

    /// Looks at the step that ends at the present state; whether a condition has become true in it.
    pub(super) fn looks_passed(&mut self) -> Result<bool, SolveError> {
        let bridge = self.memory.bridge_mut();
        bridge.has_passed_in_step(self.time, self.y.entries()).map_err(|_| self.fault())
    }
}

impl Ida {
    /// Brings algebraic unknowns to their equations, which the polynomial meets to the tolerance
    /// only. Where there is no solution, it has to do.
    fn correct_algebraic(&mut self, t: f64) {
        let bridge = self.memory.bridge_mut();
        let (Some((later, rate)), Some(consistent)) = (&mut self.later, &mut self.consistent) else { return };
        if !consistent.has_algebraic() {
            return;
        }
        later.entries_mut().copy_from_slice(self.y.entries());
        match consistent.initialise(bridge, t, later, rate) {
            Ok(()) => self.y.entries_mut().copy_from_slice(later.entries()),
            Err(_) => bridge.trouble = None,
        }
    }
}

impl Traverse for Ida {
    fn time(&self) -> f64 {
        self.time
    }

    fn longest_interval(&self) -> f64 {
        self.past.longest_interval
    }

    fn max_steps(&self) -> u32 {
        self.settings.max_steps
    }

    fn next_break(&mut self, t: f64) -> Result<f64, SolveError> {
        self.bridge().next_break(t).map_err(|_| self.fault())
    }

    fn note_break(&mut self, at: f64) -> Result<(), SolveError> {
        if !self.has_past {
            return Ok(());
        }
        self.bridge().with_past(|system| system.crosses(at)).map_err(|_| self.fault())
    }

    fn cross(&mut self, to: f64) -> Result<(), SolveError> {
        self.time = to;
        self.initialise(false)?;
        self.bridge().counts.restarts += 1;
        self.phase = Phase::Restarted;
        Ok(())
    }

    fn solve(&mut self, t_end: f64) -> Result<Advance, SolveError> {
        self.integrate(t_end)
    }

    fn watched(&mut self) -> (&mut Watch, &mut [c_int]) {
        (&mut self.memory.bridge_mut().watch, &mut self.events)
    }

    fn evaluate_roots(&mut self, t: f64) -> Result<(), SolveError> {
        let bridge = self.memory.bridge_mut();
        bridge.evaluate_roots(t, self.y.entries(), self.yp.entries()).map_err(|_| self.fault())
    }

    fn evaluate_along(&mut self, ahead: f64, consistently: bool) -> Result<(), SolveError> {
        let bridge = self.memory.bridge_mut();
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

    fn evaluate_moved(&mut self, time: f64, factor: &dyn Fn(usize) -> f64) -> Result<(), SolveError> {
        let bridge = self.memory.bridge_mut();
        let Some((later, _)) = &mut self.later else { return Ok(()) };
        let moved = self.y.entries().iter().enumerate().map(|(i, y)| y * factor(i));
        later.entries_mut().iter_mut().zip(moved).for_each(|(to, from)| *to = from);
        bridge.evaluate_roots_ahead(time, later.entries(), self.yp.entries()).map_err(|_| self.fault())
    }

    fn interpolate(&mut self, t: f64) -> Result<(), SolveError> {
        self.memory.interpolate(t, 0, &mut self.y)?;
        self.memory.bridge().nonnegative.clip(self.y.entries_mut());
        self.memory.interpolate(t, 1, &mut self.yp)?;
        if let Some(quadratures) = self.quadratures.as_mut().filter(|q| q.by_steps.is_none()) {
            self.memory.interpolate_integrals(t, &mut quadratures.values)?;
        }
        self.correct_algebraic(t);
        Ok(())
    }

    fn take_integrals(&mut self, to: f64) -> Result<(), SolveError> {
        self.take(to)?;
        self.follow(to, to)
    }

    fn derive(&mut self) -> Result<(), SolveError> {
        let bridge = self.memory.bridge_mut();
        let (Some((later, rate)), Some(consistent)) = (&mut self.later, &mut self.consistent) else { return Ok(()) };
        later.entries_mut().copy_from_slice(self.y.entries());
        rate.entries_mut().fill(0.0);
        match consistent.initialise(bridge, self.time, later, rate) {
            Ok(()) => self.yp.entries_mut().copy_from_slice(rate.entries()),
            Err(_) => bridge.trouble = None,
        }
        Ok(())
    }

    fn stop_at(&mut self, t: f64) {
        self.time = t;
        self.phase = Phase::Idle;
    }

    fn steps_tried(&self) -> u64 {
        self.memory.bridge().counts.tried()
    }

    fn reports_jumps(&self) -> bool {
        self.reports_jumps
    }

    fn go_along(&mut self, ahead: f64) {
        let rates = self.yp.entries().iter().zip(&self.shape.differential);
        for (y, (rate, _)) in self.y.entries_mut().iter_mut().zip(rates).filter(|(_, (_, differential))| **differential) {
            *y += ahead * rate;
        }
    }

    fn unknown_mut(&mut self, at: usize) -> &mut f64 {
        &mut self.y.entries_mut()[at]
    }

    fn tolerance(&self, at: usize) -> f64 {
        self.memory.bridge().tolerance(at, self.y.entries()[at])
    }

    fn watched_unknown(&self, number: usize) -> Option<usize> {
        self.memory.bridge().history.as_ref().and_then(|history| history.unknown(number))
    }

    fn is_explicit(&self) -> bool {
        self.consistent.is_some()
    }

    fn begins_safely(&mut self) -> Result<bool, SolveError> {
        self.memory.bridge_mut().begins_safely(self.y.entries()).map_err(|_| self.fault())
    }

    fn is_safe(&mut self, ahead: f64) -> bool {
        self.memory.bridge().is_safe((self.time, ahead), (self.y.entries(), self.yp.entries()))
    }

    fn step_began(&self) -> Option<f64> {
        // Derivatives that follow do not go back.
        let history = self.memory.bridge().history.as_ref().filter(|_| self.following.is_none());
        history.map(|history| history.step_began())
    }
}
