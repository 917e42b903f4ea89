//! Time-dependent terms between breaks.

use super::super::forcing::Course;
use super::{Ida, SolveError};

impl Ida {
    /// Looks at what time moves in the interval that begins here, and bounds its steps accordingly.
    pub(super) fn look_inside(&mut self, interval: f64) -> Result<Course, SolveError> {
        if self.forcing.is_empty() {
            return Ok(Course::Flat);
        }
        let (bridge, begin, y, yp) = (self.memory.bridge_mut(), self.time, &self.y, &self.yp);
        let look = self.forcing.look(|share, out| bridge.forcings(begin + share * interval, y, yp, out));
        let course = look.map_err(|_| self.fault())?;
        let longest = course.longest_step(interval).min(self.settings.max_step);
        // Zero stands for no bound.
        let longest = if longest.is_finite() { longest } else { 0.0 };
        self.memory.set_longest_step(longest)?;
        Ok(course)
    }
}
