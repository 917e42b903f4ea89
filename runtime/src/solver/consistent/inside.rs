//! Consistent values inside of the declared bounds.

use super::super::bounds::Bounds;
use super::super::callbacks::{Bridge, Trouble};
use super::super::vector::Vector;
use super::{Consistent, Inconsistent, JUMP, LAST_CORRECTION, MIN_DAMPING, rounding};

/// Newton iterations from one guess, and other guesses.
const ITERATIONS: u32 = 60;
const GUESSES: u64 = 12;
/// Bounds of the algebraic unknowns, with space for three points.
pub(super) struct Inside {
    bounds: Bounds,
    guess: Box<[f64]>,
    found: Box<[f64]>,
    nearest: Box<[f64]>,
}

impl Inside {
    pub(super) fn new(bounds: &Bounds, n: usize) -> Self {
        let zeros = || vec![0.0; n].into();
        Self { bounds: bounds.clone(), guess: zeros(), found: zeros(), nearest: zeros() }
    }
}

/// A point whose algebraic unknowns are sought.
struct Point<'a> {
    t: f64,
    y: &'a mut Vector,
    yp: &'a mut Vector,
}

impl Consistent {
    /// As [`initialise`](Self::initialise), with a solution inside of the bounds of the algebraic
    /// unknowns if there is one. The guess is moved into the bounds, steps are cut there, and other
    /// guesses are tried. With `first` unset, `y` was consistent before: the nearest solution
    /// inside is taken if it is nearer than the one outside, or if that one is far away. Where that
    /// one is far away and none is found inside, there is no solution. A first solution is outside
    /// of the bounds where none is found inside.
    pub(in super::super) fn begin(
        &mut self,
        bridge: &mut Bridge,
        first: bool,
        t: f64,
        (y, yp): (&mut Vector, &mut Vector),
    ) -> Result<(), Inconsistent> {
        let Some(mut inside) = self.inside.take() else { return self.initialise(bridge, t, y, yp) };
        let done = self.begin_inside(bridge, &mut inside, first, Point { t, y, yp });
        self.inside = Some(inside);
        done
    }

    fn begin_inside(&mut self, bridge: &mut Bridge, inside: &mut Inside, first: bool, point: Point<'_>) -> Result<(), Inconsistent> {
        let Point { t, y, yp } = point;
        let Inside { bounds, guess, found, nearest } = inside;
        guess.copy_from_slice(y.entries());
        let result = self.initialise(bridge, t, y, yp);
        let is_inside = |this: &Self, y: &[f64]| bounds.outside(&this.algebraic, y).is_none();
        let solved = result.is_ok();
        if solved && is_inside(self, y.entries()) || !(first || solved && is_inside(self, guess)) || is_interrupted(bridge) {
            return result;
        }
        found.copy_from_slice(y.entries());
        let trouble = bridge.trouble;
        let mut least = f64::INFINITY;
        for number in 0..=GUESSES {
            y.entries_mut().copy_from_slice(guess);
            if number > 0 {
                bounds.other_guess(number, &self.algebraic, y.entries_mut());
            }
            let done = self.initialise_inside(bridge, bounds, t, (&mut *y, &mut *yp));
            if is_interrupted(bridge) {
                return Err(Inconsistent::Callback);
            }
            let away = bounds.distance(&self.algebraic, guess, y.entries());
            if done.is_ok() && first {
                return done;
            }
            if done.is_ok() && away < least {
                least = away;
                nearest.copy_from_slice(y.entries());
            }
        }
        // What was noted on the way is not the cause.
        bridge.trouble = trouble;
        let away = bounds.distance(&self.algebraic, guess, found);
        if solved && !first && away > JUMP && least.is_infinite() {
            return Err(Inconsistent::Outside { unknown: bounds.outside(&self.algebraic, found) });
        }
        let inward = least.is_finite() && (away > JUMP || least <= away);
        y.entries_mut().copy_from_slice(match solved {
            true if inward => nearest,
            true => found,
            false => guess,
        });
        if solved { self.initialise(bridge, t, y, yp) } else { result }
    }

    /// Newton's method on the algebraic rows with steps that are cut at the bounds; then as
    /// [`initialise`](Self::initialise).
    fn initialise_inside(
        &mut self,
        bridge: &mut Bridge,
        bounds: &Bounds,
        t: f64,
        (y, yp): (&mut Vector, &mut Vector),
    ) -> Result<(), Inconsistent> {
        yp.entries_mut().fill(0.0);
        bounds.clip(&self.algebraic, y.entries_mut());
        self.whole = false;
        self.evaluate(bridge, t, y, yp)?;
        let enough = LAST_CORRECTION.max(rounding(bridge));
        for iterations in 1..=ITERATIONS {
            self.factorise_block(bridge, t, y, yp)?;
            let size = self.correct(bridge, y);
            if size > 0.0 && !self.step_inside(bridge, bounds, t, (&mut *y, &*yp), (size, enough)) {
                return Err(self.diverged(iterations, size));
            }
            if size <= enough {
                return self.take_rates(bridge, t, yp);
            }
        }
        Err(self.diverged(ITERATIONS, f64::INFINITY))
    }

    /// Moves `y` along the correction, cut at the bounds, as far as the next correction gets
    /// smaller or a bound is met.
    fn step_inside(&mut self, bridge: &mut Bridge, bounds: &Bounds, t: f64, point: (&mut Vector, &Vector), limits: (f64, f64)) -> bool {
        let ((y, yp), (size, enough)) = (point, limits);
        self.work.entries_mut().copy_from_slice(self.spread.entries());
        bridge.error_weights(y, &mut self.reference);
        for (start, &i) in self.start.iter_mut().zip(&self.algebraic) {
            *start = y.entries()[i];
        }
        let mut damping = 1.0;
        while damping >= MIN_DAMPING {
            for (start, &i) in self.start.iter().zip(&self.algebraic) {
                y.entries_mut()[i] = start + damping * self.work.entries()[i];
            }
            let clipped = bounds.clip(&self.algebraic, y.entries_mut());
            let moved = self.start.iter().zip(&self.algebraic).any(|(start, &i)| y.entries()[i] != *start);
            if clipped && !moved && size > enough {
                return false;
            }
            if self.evaluate(bridge, t, y, yp).is_ok() {
                let next = self.correct(bridge, y);
                if clipped || next <= enough || bridge.operations.norm(&self.spread, &self.reference) <= (1.0 - 0.5 * damping) * size {
                    return true;
                }
            }
            damping *= 0.5;
        }
        false
    }
}

fn is_interrupted(bridge: &Bridge) -> bool {
    bridge.trouble == Some(Trouble::Interrupted)
}
