//! Consistent values of implicit systems.

use sundials_sys::IDA_SUCCESS;

use super::super::SolveError;
use super::super::consistent::JUMP;
use super::Ida;

/// Other guesses of algebraic unknowns.
const OTHER_GUESSES: u64 = 12;

impl Ida {
    /// IDA's own search for y' and the algebraic unknowns of an implicit system.
    pub(super) fn calculate_initial_condition(&mut self) -> Result<(), SolveError> {
        let first = self.time + self.past.last_interval;
        let value = self.memory.calculate_start(self.time, &mut self.y, &mut self.yp, first);
        if value == IDA_SUCCESS {
            return Ok(());
        }
        let (time, flag, unknown) = (self.time, self.flag(value), self.largest_residual());
        Err(self.trouble().unwrap_or(SolveError::ImplicitInitialConditions { time, flag, unknown }))
    }

    /// As [`calculate_initial_condition`](Self::calculate_initial_condition), with the algebraic
    /// unknowns inside of their bounds where such values are found from other guesses. With `first`
    /// unset the unknowns were consistent before: values that have jumped out of the bounds are
    /// not.
    pub(super) fn search_initial_condition(&mut self, first: bool) -> Result<(), SolveError> {
        let Some(bounds) = self.shape.bounds.clone() else { return self.calculate_initial_condition() };
        let algebraic: Vec<usize> = (0..self.shape.differential.len()).filter(|&i| !self.shape.differential[i]).collect();
        let guess = self.y.entries().to_vec();
        let is_inside = |ida: &Self| bounds.outside(&algebraic, ida.y.entries()).is_none();
        let result = self.calculate_initial_condition();
        if result.is_ok() && is_inside(self) || matches!(result, Err(SolveError::Interrupted { .. })) {
            return result;
        }
        let jumps = |y: &[f64]| bounds.distance(&algebraic, &guess, y) > JUMP;
        let leaves = !first && result.is_ok() && bounds.outside(&algebraic, &guess).is_none() && jumps(self.y.entries());
        if !first && !leaves {
            return result;
        }
        let found = (self.y.entries().to_vec(), self.yp.entries().to_vec());
        for number in 0..=OTHER_GUESSES {
            self.y.entries_mut().copy_from_slice(&guess);
            self.yp.entries_mut().fill(0.0);
            if number > 0 {
                bounds.other_guess(number, &algebraic, self.y.entries_mut());
            }
            bounds.clip(&algebraic, self.y.entries_mut());
            self.memory.begin();
            match self.calculate_initial_condition() {
                Err(error @ SolveError::Interrupted { .. }) => return Err(error),
                done if done.is_ok() && is_inside(self) => return done,
                _ => {}
            }
        }
        if leaves {
            return Err(SolveError::Outside { time: self.time, unknown: bounds.outside(&algebraic, &found.0) });
        }
        self.memory.begin();
        self.y.entries_mut().copy_from_slice(&found.0);
        self.yp.entries_mut().copy_from_slice(&found.1);
        result
    }
}
