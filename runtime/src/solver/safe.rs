//! Boxes of unknowns in which no event happens.

use super::watch::Watch;
use super::{Edge, RootRole, System};

/// A box of unknowns, and a time up to which, in which no event happens and no equation jumps:
/// steps inside of it need no look at root functions.
///
/// If root functions do not read the time, and there are no kinks, a box lasts until it is left. It
/// also lasts into the next integration if what they read besides unknowns is the same.
pub(crate) struct Safe {
    least: Box<[f64]>,
    most: Box<[f64]>,
    until: f64,
    /// Steps for which no such box is looked for, where there was none.
    pause: u32,
    lasting: Option<Lasting>,
}

/// Data of a box that lasts.
struct Lasting {
    /// Inputs that root functions read in addition to unknowns: those of the box, and those of now.
    inputs: Box<[f64]>,
    now: Box<[f64]>,
    /// Conditions inside of the box.
    holds: Box<[bool]>,
    /// Reach of the next box, in widths of the bounds over a step, and the largest that is tried.
    reach: f64,
    largest: f64,
}

/// Reach of a box beyond the bounds over a step, in parts of their width, and in steps.
const REACH: f64 = 1.0;
const AHEAD: f64 = 8.0;

/// Growth of the reach of boxes that last, and the largest.
const WIDER: f64 = 4.0;
const WIDEST: f64 = 256.0;

/// Steps after which a box is looked for again.
const PAUSE: u32 = 8;

impl Safe {
    /// For so many unknowns of a system; not yet known.
    pub(crate) fn new(unknowns: usize, system: &dyn System) -> Self {
        let numbers = |n: usize| vec![0.0; n].into_boxed_slice();
        let kinks = system.root_kinds().iter().any(|kind| matches!(kind.role, RootRole::Kink { .. }));
        let lasting = system.watched_input_count().filter(|_| !kinks && unknowns > 0).map(|inputs| Lasting {
            inputs: numbers(inputs),
            now: numbers(inputs),
            holds: vec![false; system.root_count()].into(),
            reach: REACH,
            largest: WIDEST,
        });
        Self { least: numbers(unknowns), most: numbers(unknowns), until: f64::NEG_INFINITY, pause: 0, lasting }
    }

    /// Takes what root functions read besides unknowns, where an integration begins.
    pub(crate) fn take_inputs(&mut self, system: &dyn System) {
        if let Some(lasting) = &mut self.lasting {
            system.watched_inputs(&mut lasting.now);
        }
    }

    /// Forgets a box that was found under other inputs or conditions, where an integration begins.
    /// Returns whether it begins inside of one that is kept, where jumps are as they are there.
    pub(crate) fn begin(&mut self, unknowns: &[u32], y: &[f64], watch: &mut Watch) -> bool {
        let known = self.until == f64::INFINITY && self.lasting.as_ref().is_some_and(|l| l.now == l.inputs && watch.agrees(&l.holds));
        if !known {
            (self.until, self.pause) = (f64::NEG_INFINITY, 0);
            if let Some(Lasting { inputs, now, reach, largest, .. }) = &mut self.lasting {
                inputs.copy_from_slice(now);
                (*reach, *largest) = (REACH, WIDEST);
            }
            return false;
        }
        let inside = self.contains(f64::NEG_INFINITY, unknowns, y);
        if let Some(lasting) = self.lasting.as_ref().filter(|_| inside) {
            watch.take_jumps_from(&lasting.holds);
        }
        inside
    }

    /// Returns whether unknowns are inside of the box at a time.
    #[inline]
    pub(crate) fn contains(&self, time: f64, unknowns: &[u32], y: &[f64]) -> bool {
        self.holds(time, unknowns, (y, y))
    }

    /// Returns whether unknowns are inside of the box at a time, and so are those a little later,
    /// along their derivatives.
    pub(crate) fn contains_along(&self, (time, ahead): (f64, f64), unknowns: &[u32], (y, yp): (&[f64], &[f64])) -> bool {
        let inside = |at: usize| {
            let later = y[at] + ahead * yp[at];
            self.least[at] <= y[at].min(later) && y[at].max(later) <= self.most[at]
        };
        time + ahead <= self.until && unknowns.iter().all(|&at| inside(at as usize))
    }

    /// Returns whether bounds of these unknowns up to a time are inside of the box.
    #[inline]
    pub(crate) fn holds(&self, to: f64, unknowns: &[u32], (least, most): (&[f64], &[f64])) -> bool {
        to <= self.until
            && unknowns.iter().all(|&at| {
                let at = at as usize;
                self.least[at] <= least[at] && most[at] <= self.most[at]
            })
    }

    /// A box that reaches beyond bounds over a step, to be tried: its times and its ends; `None`
    /// where none is due.
    pub(crate) fn beyond(&mut self, (from, to): (f64, f64), unknowns: &[u32], (least, most): (&[f64], &[f64])) -> Option<Reach<'_>> {
        self.until = f64::NEG_INFINITY;
        if self.pause > 0 {
            self.pause -= 1;
            return None;
        }
        let reach = self.lasting.as_ref().map_or(REACH, |lasting| lasting.reach);
        for &at in unknowns {
            let at = at as usize;
            let reach = reach * (most[at] - least[at]);
            self.least[at] = least[at] - reach;
            self.most[at] = most[at] + reach;
        }
        Some(((from, to + AHEAD * (to - from)), &self.least, &self.most))
    }

    /// The box that was tried is one, up to a time, or is not.
    pub(crate) fn tried(&mut self, until: Option<f64>, edges: &[Edge]) {
        let Some(Lasting { holds, reach, largest, .. }) = &mut self.lasting else {
            match until {
                Some(until) => self.until = until,
                None => self.pause = PAUSE,
            }
            return;
        };
        if until.is_some() {
            self.until = f64::INFINITY;
            holds.iter_mut().zip(edges).for_each(|(holds, edge)| *holds = edge.holds);
            *reach = (WIDER * *reach).min(*largest);
        } else if *reach > REACH {
            *largest = (*reach / WIDER).max(REACH);
            *reach = REACH;
        } else {
            self.pause = PAUSE;
        }
    }
}

/// A box with the times over which it reaches.
type Reach<'a> = ((f64, f64), &'a [f64], &'a [f64]);
