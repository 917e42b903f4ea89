//! Breaks and events: what [`Traverse`] asks of IDA.

use std::os::raw::c_int;

use sundials_sys::{IDA_SUCCESS, IDA_TSTOP_RETURN};

use super::super::traverse::Traverse;
use super::super::watch::Watch;
use super::{Advance, Ida, Phase, SolveError};

impl Ida {
    /// Whether a condition has become true in what was just integrated.
    pub(super) fn has_passed_event(&mut self, value: c_int) -> Result<bool, SolveError> {
        let passed = self.watched().0.passed;
        if passed || !matches!(value, IDA_SUCCESS | IDA_TSTOP_RETURN) {
            return Ok(passed);
        }
        self.has_passed(self.time)
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
        self.memory.interpolate(t, 1, &mut self.yp)?;
        if let Some(quadratures) = self.quadratures.as_mut().filter(|q| q.by_steps.is_none()) {
            self.memory.interpolate_integrals(t, &mut quadratures.values)?;
        }
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
}
