//! Time-dependent terms between breaks.

use super::super::forcing::Course;
use super::{Ida, SolveError};

impl Ida {
    /// Looks at what time moves in the interval that begins here, and bounds its steps accordingly.
    pub(super) fn look_inside(&mut self, interval: f64) -> Result<Course, SolveError> {
        let known = if self.has_past { self.bridge().longest_step().map_err(|_| self.fault())? } else { f64::INFINITY };
        if self.forcing.is_empty() {
            if self.has_past {
                self.bound_steps(known)?;
            }
            return Ok(Course::Flat);
        }
        let (bridge, begin, y, yp) = (self.memory.bridge_mut(), self.time, &self.y, &self.yp);
        let look = self.forcing.look(|share, out| bridge.forcings(begin + share * interval, y, yp, out));
        let course = look.map_err(|_| self.fault())?;
        self.bound_steps(course.longest_step(interval).min(known))?;
        Ok(course)
    }

    fn bound_steps(&mut self, longest: f64) -> Result<(), SolveError> {
        let longest = longest.min(self.settings.max_step);
        self.longest_step = longest;
        // Zero stands for no bound.
        self.memory.set_longest_step(if longest.is_finite() { longest } else { 0.0 })
    }
}
