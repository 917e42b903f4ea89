//! Time-dependent terms between breaks.

use super::super::forcing::Course;
use super::{Ida, SolveError};

/// Ratio by which the shortest dead time grows until steps follow.
const LONGER: f64 = 1.2;

impl Ida {
    /// Looks at what time moves in the interval that begins here, and bounds its steps accordingly.
    pub(super) fn look_inside(&mut self, interval: f64) -> Result<Course, SolveError> {
        let known = if self.has_past { self.bridge().longest_step().map_err(|_| self.fault())? } else { f64::INFINITY };
        if self.forcing.is_empty() {
            if self.has_past {
                self.bound_steps(f64::INFINITY, known)?;
            }
            return Ok(Course::Flat);
        }
        let (bridge, begin, y, yp) = (self.memory.bridge_mut(), self.time, &self.y, &self.yp);
        let look = self.forcing.look(|share, out| bridge.forcings(begin + share * interval, y, yp, out));
        let course = look.map_err(|_| self.fault())?;
        self.bound_steps(course.longest_step(interval), known)?;
        Ok(course)
    }

    /// Lets steps become longer with the dead times.
    pub(super) fn lengthen_steps(&mut self) -> Result<(), SolveError> {
        let known = self.bridge().longest_step().map_err(|_| self.fault())?;
        if known.min(self.course_step) > LONGER * self.longest_step { self.bound_steps(self.course_step, known) } else { Ok(()) }
    }

    /// Bounds steps by what time moves and by what is known of the past.
    fn bound_steps(&mut self, course: f64, known: f64) -> Result<(), SolveError> {
        self.course_step = course.min(self.settings.max_step);
        let longest = self.course_step.min(known);
        self.longest_step = longest;
        // Zero stands for no bound.
        self.memory.set_longest_step(if longest.is_finite() { longest } else { 0.0 })
    }
}
