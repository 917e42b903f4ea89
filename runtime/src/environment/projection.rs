//! Projection of states to constraints by their corrections, which are unknowns of the model.

use super::Environment;
use super::tangent::{FollowError, Follower};

/// Most moves of a projection.
const MOVES: usize = 6;

/// Corrections, in the scale of the states, that are not worth a move: before the end of a step,
/// which moves once more, and elsewhere.
const BEFORE_END: f64 = 1e-8;
const NEGLIGIBLE: f64 = 1e-13;

impl Environment {
    /// Moves states near to constraints before the updates at the end of a step, which move them
    /// once more.
    pub(super) fn project_before_end(&mut self, t: f64) {
        self.project(t, BEFORE_END);
    }

    /// Moves states to constraints after they were set.
    pub(super) fn project_after_reset(&mut self, t: f64) {
        if self.solve_algebraic(t) {
            self.project(t, NEGLIGIBLE);
        }
    }

    fn project(&mut self, t: f64, least: f64) {
        for _ in 0..MOVES {
            if self.is_near(least) || !self.move_states() || !self.solve_algebraic(t) {
                return;
            }
        }
    }

    /// Moves states to constraints after they were set, with derivatives along the directions.
    pub(super) fn follow_projection(&mut self, follower: &mut Follower, t: f64, moving: &[f64]) -> Result<(), FollowError> {
        for pass in 0..MOVES {
            if !self.solve_algebraic(t) {
                return Ok(());
            }
            if pass > 0 && self.is_near(NEGLIGIBLE) {
                return Ok(());
            }
            self.follow_moved(follower, t, moving)?;
            if !self.move_states() {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Returns `true` if no state is farther from its constraints than this part of its scale.
    fn is_near(&self, least: f64) -> bool {
        self.setup.corrections.pairs.iter().all(|pair| self.progress.y[pair.by].abs() <= least * pair.scale)
    }

    /// Moves states by their corrections; `false` if these are not finite.
    fn move_states(&mut self) -> bool {
        let (pairs, y) = (&self.setup.corrections.pairs, &mut self.progress.y);
        if pairs.iter().any(|pair| !y[pair.by].is_finite()) {
            return false;
        }
        pairs.iter().for_each(|pair| y[pair.state] += y[pair.by]);
        true
    }

    /// Solves for the algebraic unknowns at the present states. A failure shows in the restart that
    /// follows.
    fn solve_algebraic(&mut self, t: f64) -> bool {
        let (model, memory) = self.system.parts();
        model.prepare_step(memory);
        let found = self.integrator.restart(&mut self.system, t, &self.progress.y, Some(&self.progress.yp)).is_ok();
        if found {
            self.take_state();
        }
        found
    }
}
