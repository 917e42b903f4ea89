//! Events: watched by signs, found by IDA where a sign has changed.

use std::os::raw::c_int;

use sundials_sys::{IDARootInit, IDASetNoInactiveRootWarn};

use super::super::callbacks;
use super::setup::check;
use super::{Ida, SolveError};

impl Ida {
    /// Switches IDA's root finding on or off.
    pub(super) fn set_root_finding(&mut self, on: bool) -> Result<(), SolveError> {
        if self.finding == on || self.events.is_empty() {
            return Ok(());
        }
        self.finding = on;
        let count = if on { self.events.len() as c_int } else { 0 };
        unsafe {
            check("IDARootInit", IDARootInit(self.memory, count, on.then_some(callbacks::roots)))?;
            check("IDASetNoInactiveRootWarn", IDASetNoInactiveRootWarn(self.memory))
        }
    }

    /// Watches for events in the interval that begins here, `fresh` if after a restart.
    pub(super) fn watch(&mut self, fresh: bool) -> Result<(), SolveError> {
        if !self.watches {
            return Ok(());
        }
        let bridge = unsafe { &mut *self.bridge };
        if fresh && bridge.begin_watch(self.time, self.y.entries(), self.yp.entries()).is_err() {
            return Err(self.fault());
        }
        if !bridge.watch.active {
            // IDA cannot take up its search on the way, but it goes on with one.
            return if fresh { self.set_root_finding(true) } else { Ok(()) };
        }
        bridge.watch.time = self.time;
        bridge.watch.y.copy_from_slice(self.y.entries());
        bridge.watch.yp.copy_from_slice(self.yp.entries());
        bridge.watch.quadratures.copy_from_slice(self.quadratures.as_ref().map_or(&[], |quadratures| quadratures.values.entries()));
        if fresh { self.set_root_finding(false) } else { Ok(()) }
    }

    /// Whether a sign has changed in the interval that was just integrated, to its end if it was `reached`.
    pub(super) fn has_passed_event(&mut self, reached: bool) -> Result<bool, SolveError> {
        let bridge = unsafe { &mut *self.bridge };
        if !reached || !bridge.watch.active || bridge.watch.changed {
            return Ok(bridge.watch.active && bridge.watch.changed);
        }
        bridge.has_crossed(self.time, self.y.entries()).map_err(|_| self.fault())
    }

    /// Goes back to the beginning of the interval, with IDA's root finding from there on.
    pub(super) fn rewind(&mut self) -> Result<(), SolveError> {
        let bridge = unsafe { &mut *self.bridge };
        bridge.begin();
        bridge.watch.active = false;
        self.time = bridge.watch.time;
        self.y.entries_mut().copy_from_slice(&bridge.watch.y);
        self.yp.entries_mut().copy_from_slice(&bridge.watch.yp);
        if let Some(quadratures) = &mut self.quadratures {
            quadratures.values.entries_mut().copy_from_slice(&bridge.watch.quadratures);
        }
        self.set_root_finding(true)
    }
}
