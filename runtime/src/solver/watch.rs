//! The conditions of events: whether they hold, and when they become true.
//!
//! A root function is positive where its condition holds. It is evaluated at every accepted state; where a condition has become
//! true in between, the instant is found on the interpolating polynomial. At the threshold itself, to rounding, a sign says nothing: there
//! the motion decides, so that a condition that has just become true and is being left may become true again.

use std::os::raw::c_int;

use serde::{Deserialize, Serialize};

use super::RootKind;

/// What is known of the condition of one event.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Edge {
    /// It holds.
    pub holds: bool,
    /// While the root function is no larger than this it is at the threshold; negative: it is away from it.
    band: f64,
}

/// A root function that has left its threshold.
const AWAY: f64 = -1.0;

impl Default for Edge {
    /// Does not hold: what is true at the start becomes true there.
    fn default() -> Self {
        Self { holds: false, band: AWAY }
    }
}

impl Edge {
    /// A condition that is known to hold or not.
    pub fn known(holds: bool) -> Self {
        Self { holds, band: AWAY }
    }

    /// Whether the value is at the threshold that it was at before.
    fn stays(&self, value: f64) -> bool {
        self.band >= 0.0 && value.abs() <= self.band
    }
}

/// Conditions at the last accepted state, and root functions there and nearby.
#[derive(Default)]
pub(crate) struct Watch {
    kinds: Box<[RootKind]>,
    pub edges: Box<[Edge]>,
    /// Root functions at the state looked at.
    pub values: Box<[f64]>,
    /// The same a little later.
    pub ahead: Box<[f64]>,
    /// How they move there.
    motion: Box<[f64]>,
    /// What of them is rounding.
    noise: Box<[f64]>,
    /// By how much they differ at states nearby.
    moved: Box<[f64]>,
    /// How they moved just before the integration stopped, where that was looked at.
    before: Box<[f64]>,
    /// Time of the last accepted state in which nothing happened, and of the first one after something did.
    pub since: f64,
    pub until: f64,
    /// Something has happened between the two.
    pub passed: bool,
    /// A root function that was not a number.
    pub undefined: Option<usize>,
}

impl Watch {
    /// For root functions of these kinds; those left out are of the default one.
    pub(super) fn new(roots: usize, kinds: &[RootKind]) -> Self {
        let zeros = || vec![0.0; roots].into_boxed_slice();
        Self {
            kinds: (0..roots).map(|i| kinds.get(i).copied().unwrap_or_default()).collect(),
            edges: vec![Edge::default(); roots].into(),
            values: zeros(),
            ahead: zeros(),
            motion: zeros(),
            noise: zeros(),
            moved: zeros(),
            before: zeros(),
            ..Self::default()
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// Notes values that are no numbers.
    fn note_undefined(&mut self) {
        let found = self.values.iter().position(|value| value.is_nan());
        self.undefined = self.undefined.or(found);
    }

    /// Takes the values at an accepted state; whether a condition has become true since the one before.
    pub(super) fn accept(&mut self, time: f64) -> bool {
        self.passed = (0..self.edges.len()).any(|i| self.stops(i));
        if self.passed {
            self.until = time;
            return true;
        }
        self.note_undefined();
        self.since = time;
        for (edge, &value) in self.edges.iter_mut().zip(&self.values) {
            let band = edge.band.max(0.0);
            if value < -band {
                *edge = Edge::default();
            } else if edge.holds && value > band {
                edge.band = AWAY;
            }
        }
        false
    }

    /// Whether the integration stops for a root function. NaN stops nothing.
    fn stops(&self, i: usize) -> bool {
        let (edge, value, kind) = (self.edges[i], self.values[i], self.kinds[i]);
        let band = edge.band.max(0.0);
        match edge.holds {
            true => kind.both && value < -band,
            false => value > band || (value == 0.0 && !kind.strict && edge.band < 0.0),
        }
    }

    /// Whether a root function is at its threshold, or just there.
    pub(crate) fn is_at_threshold(&mut self) -> bool {
        self.motion.fill(0.0);
        self.edges.iter().zip(&self.values).any(|(edge, &value)| value == 0.0 || edge.stays(value))
    }

    /// The root function that is nearest to its threshold in terms of its motion to the values ahead, within a thousand times that.
    pub(crate) fn nearest(&self) -> Option<usize> {
        let distance = |i: usize| self.values[i].abs() / (self.ahead[i] - self.values[i]).abs();
        (0..self.edges.len()).filter(|&i| distance(i) < 1e3).min_by(|&a, &b| distance(a).total_cmp(&distance(b)))
    }

    /// Takes the motion from the values ahead, where it did not show yet; whether it shows for all that are at their threshold.
    pub(crate) fn look_ahead(&mut self) -> bool {
        let mut shows = true;
        for (i, motion) in self.motion.iter_mut().enumerate() {
            if *motion == 0.0 {
                *motion = self.ahead[i] - self.values[i];
                let value = self.values[i];
                shows &= *motion != 0.0 || !(value == 0.0 || self.edges[i].stays(value));
            }
        }
        shows
    }

    /// Conditions after the state, the inputs or the equations may have changed; whether one became true.
    pub(super) fn settle(&mut self, fired: &mut [c_int]) -> bool {
        self.note_undefined();
        for (i, fired) in fired.iter_mut().enumerate() {
            let (value, kind, edge) = (self.values[i], self.kinds[i], self.edges[i]);
            let (motion, stays) = (self.motion[i], edge.stays(value));
            self.edges[i] = match value {
                value if value.is_nan() => edge,
                _ if stays && motion != 0.0 => Edge { holds: motion > 0.0, ..edge },
                _ if stays => edge,
                0.0 => Edge { holds: if kind.strict { motion > 0.0 } else { true }, band: 0.0 },
                _ => Edge { holds: value > 0.0, band: AWAY },
            };
            *fired = change(edge, self.edges[i], kind);
        }
        fired.iter().any(|&f| f != 0)
    }

    /// Whether a condition that is away from its threshold moves over it within rounding or `reach` times the motion to the values ahead.
    pub(crate) fn is_about_to_stop(&self, reach: f64) -> bool {
        (0..self.edges.len()).filter(|&i| self.edges[i].band < 0.0).any(|i| {
            let (edge, value, motion) = (self.edges[i], self.values[i], self.ahead[i] - self.values[i]);
            let (value, motion) = if edge.holds { (-value, -motion) } else { (value, motion) };
            let matters = !edge.holds || self.kinds[i].both;
            matters && value <= 0.0 && motion > 0.0 && -value <= (motion * reach).max(self.noise[i])
        })
    }

    /// Nothing is known of rounding.
    pub(crate) fn forget_noise(&mut self) {
        self.noise.fill(0.0);
    }

    /// Adds by how much the values differ at a state nearby; `first` begins anew.
    pub(crate) fn note_moved(&mut self, first: bool) {
        for ((moved, ahead), value) in self.moved.iter_mut().zip(&self.ahead).zip(&self.values) {
            *moved = (ahead - value).abs() + if first { 0.0 } else { *moved };
        }
    }

    /// Takes the differences at states that differ by rounding.
    pub(crate) fn take_noise(&mut self) {
        self.noise.copy_from_slice(&self.moved);
    }

    /// Whether a value that is not zero differs by as much at a state that is the same but for rounding.
    pub(crate) fn is_lost_in_noise(&self) -> bool {
        self.noise.iter().zip(&self.values).any(|(&noise, &value)| value != 0.0 && noise >= value.abs())
    }

    /// Takes the differences at states that differ by more than rounding: where they are no larger the root function jumps, and has no noise.
    pub(crate) fn take_jumps(&mut self) {
        for (noise, moved) in self.noise.iter_mut().zip(&self.moved) {
            if *moved <= 2.0 * *noise {
                *noise = 0.0;
            }
        }
    }

    /// Whether the integration has stopped at a threshold from which the equations lead back.
    pub(crate) fn is_led_back(&self) -> bool {
        (0..self.edges.len()).any(|i| !self.edges[i].holds && self.stops(i) && self.ahead[i] < self.values[i])
    }

    /// Takes the motion at a state just before the one at which the integration stopped.
    pub(crate) fn note_before(&mut self) {
        for ((before, ahead), value) in self.before.iter_mut().zip(&self.ahead).zip(&self.values) {
            *before = ahead - value;
        }
    }

    /// Conditions where the integration has stopped. What moves over its threshold to within rounding or `reach` times the motion to the values ahead
    /// has passed it; what the equations move the other way has not, whatever the polynomial says, unless they turn round at the threshold, where they have
    /// moved it by more than rounding. A strict condition waits for the motion after what happens here, but for that.
    pub(crate) fn arrive(&mut self, reach: f64, fired: &mut [c_int]) {
        self.note_undefined();
        for (i, fired) in fired.iter_mut().enumerate() {
            let (value, kind, edge) = (self.values[i], self.kinds[i], self.edges[i]);
            let motion = self.ahead[i] - value;
            let near = (motion.abs() * reach).max(self.noise[i]);
            let stops = self.stops(i);
            let brought = !edge.holds && stops && motion < 0.0 && self.before[i] * reach > self.noise[i];
            self.edges[i] = if value.is_nan() {
                edge
            } else if brought {
                Edge { holds: true, band: near.max(value.abs()) }
            // What stood at its threshold stops just outside of its band.
            } else if value.abs() <= near.max(2.0 * edge.band) {
                let holds = match edge.holds {
                    true => motion >= 0.0 && !stops,
                    false => !kind.strict && (motion > 0.0 || (stops && motion == 0.0)) && (stops || !edge.stays(value)),
                };
                Edge { holds, band: near.max(value.abs()) }
            } else {
                Edge { holds: if edge.holds { value >= 0.0 } else { stops }, band: AWAY }
            };
            *fired = change(edge, self.edges[i], kind);
        }
        self.before.fill(0.0);
    }
}

/// What an event has to say about a change: 1 for a condition that became true, -1 for one that ceased to hold where that matters.
fn change(before: Edge, now: Edge, kind: RootKind) -> c_int {
    match (before.holds, now.holds) {
        (false, true) => 1,
        (true, false) if kind.both => -1,
        _ => 0,
    }
}
