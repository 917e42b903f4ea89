//! Times at which the equations change their form, and what time moves between them.

use sundials_sys::IDASetMaxStep;

use super::super::forcing::Course;
use super::setup::check;
use super::{Advance, Ida, Phase, SolveError};

/// Two times this near each other, in parts of the larger one, are one: the tables of a model know them no better.
const NEAR: f64 = 2e-12;

/// Distance of both sides of a break from it, in roundings: the equations are of one form on each.
const ROUNDINGS: f64 = 8.0;

impl Ida {
    /// Steps to `t_end` or to the first event, beginning anew behind each break.
    pub(super) fn go(&mut self, t_end: f64) -> Result<Advance, SolveError> {
        let mut stops = 0;
        let mut width = ROUNDINGS * f64::EPSILON * self.time.abs().max(t_end.abs());
        loop {
            let near = NEAR * self.time.abs().max(t_end.abs());
            let now = self.time;
            let at = self.bridge().next_break(now).map_err(|_| self.fault())?;
            if at.is_nan() || at > t_end + near {
                return self.solve(t_end);
            }
            stops += 1;
            if stops > self.settings.max_steps {
                return Err(SolveError::TooManySteps { time: self.time, steps: self.settings.max_steps, unknown: None });
            }
            if at - width <= self.time + near {
                // A break that is not left behind by roundings is by a few more of them.
                width *= 2.0;
            } else {
                width = ROUNDINGS * f64::EPSILON * at.abs().max(t_end.abs());
                let advance = self.solve((at - width).min(t_end))?;
                if advance == Advance::Event || at - width >= t_end {
                    return Ok(advance);
                }
            }
            let behind = (at.max(self.time) + width).min(t_end);
            self.cross(behind)?;
            if behind == t_end {
                return self.solve(t_end);
            }
        }
    }

    /// Goes to the other side of a break, where algebraic unknowns and derivatives are others, and so may be what holds: the next step looks.
    fn cross(&mut self, to: f64) -> Result<(), SolveError> {
        self.time = to;
        self.initialise()?;
        self.bridge().counts.restarts += 1;
        self.phase = Phase::Restarted;
        Ok(())
    }

    /// Looks at what time moves in the interval that begins here, and bounds its steps accordingly.
    pub(super) fn look_inside(&mut self, interval: f64) -> Result<Course, SolveError> {
        if self.forcing.is_empty() {
            return Ok(Course::Flat);
        }
        let (bridge, begin, y, yp) = (unsafe { &mut *self.bridge }, self.time, &self.y, &self.yp);
        let look = self.forcing.look(|share, out| bridge.forcings(begin + share * interval, y, yp, out));
        let course = look.map_err(|_| self.fault())?;
        let longest = course.longest_step(interval).min(self.settings.max_step);
        // Zero stands for no bound.
        let longest = if longest.is_finite() { longest } else { 0.0 };
        check("IDASetMaxStep", unsafe { IDASetMaxStep(self.memory, longest) })?;
        Ok(course)
    }
}
