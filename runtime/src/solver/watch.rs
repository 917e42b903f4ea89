//! Watching for events without looking for them.
//!
//! IDA's root finding interpolates y and y' at the end of every step, which takes up to a quarter of the time of small systems, and
//! almost always finds no change of sign. Here the root functions are evaluated at the accepted state itself, with the error
//! weights; where a sign has changed, the interval is integrated again with IDA's root finding. Steps are the same in both, so
//! that events are those that IDA alone would have found.

use std::os::raw::c_int;

/// Root functions at the last accepted state, and where the interval began.
#[derive(Default)]
pub(crate) struct Watch {
    /// Whether signs are watched, in place of IDA's search.
    pub active: bool,
    /// Whether one has changed.
    pub changed: bool,
    values: Box<[f64]>,
    next: Box<[f64]>,
    /// Time, unknowns, their derivatives and quadratures at the beginning.
    pub time: f64,
    pub y: Box<[f64]>,
    pub yp: Box<[f64]>,
    pub quadratures: Box<[f64]>,
}

impl Watch {
    /// For so many root functions, unknowns and quadratures.
    pub fn new(roots: usize, unknowns: usize, quadratures: usize) -> Self {
        let zeros = |length| vec![0.0; length].into_boxed_slice();
        let kept = if roots == 0 { 0 } else { unknowns };
        let quadratures = if roots == 0 { 0 } else { quadratures };
        Self {
            active: false,
            changed: false,
            values: zeros(roots),
            next: zeros(roots),
            time: 0.0,
            y: zeros(kept),
            yp: zeros(kept),
            quadratures: zeros(quadratures),
        }
    }

    /// Takes the values at the beginning. A root function that is zero there is left to IDA, which waits for it to move.
    pub fn begin(&mut self, evaluate: impl FnOnce(&mut [f64]) -> Result<(), c_int>) -> Result<(), c_int> {
        self.changed = false;
        evaluate(&mut self.values)?;
        self.active = self.values.iter().all(|&value| value != 0.0);
        Ok(())
    }

    /// Takes the values at an accepted state; whether a sign has changed since the one before.
    pub fn accept(&mut self, evaluate: impl FnOnce(&mut [f64]) -> Result<(), c_int>) -> Result<bool, c_int> {
        evaluate(&mut self.next)?;
        // As IDA's: a value that is not a number changes nothing.
        let changes = |before: f64, now: f64| now == 0.0 || (before < 0.0 && now > 0.0) || (before > 0.0 && now < 0.0);
        self.changed = self.values.iter().zip(&self.next).any(|(&before, &now)| changes(before, now));
        std::mem::swap(&mut self.values, &mut self.next);
        Ok(self.changed)
    }
}
