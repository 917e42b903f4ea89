//! The conditions of events and switches of the equations: whether they hold, and when they become
//! true.
//!
//! A root function is positive where its condition holds. It is evaluated at every accepted state,
//! and bounded in between (see [`inside`](super::inside)); where a condition has become true, the
//! instant is found on the interpolating polynomial. At the threshold itself, to rounding, a sign
//! has no meaning. There the motion decides, so that a condition that has just become true and is
//! being left may become true again.

use std::os::raw::c_int;

use serde::{Deserialize, Serialize};

use super::enclosure::hull;
use super::{RootKind, RootRole};

/// State of the condition of one event.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Edge {
    /// It holds.
    pub holds: bool,
    /// While the root function is no larger than this it is at the threshold; negative: it is away
    /// from it.
    band: f64,
}

/// A root function that has left its threshold.
const AWAY: f64 = -1.0;

/// A tie is looked for within so many tolerances.
pub(crate) const TIE: f64 = 10.0;

/// Part of the tolerance of a root function below which the search inside of a step does not look
/// for events and jumps.
const SHALLOW: f64 = 1e-3;

/// Motion is steady that at a part of the way is no less than this part of what it would be there
/// along a straight line.
const STEADY: f64 = 0.5;

/// The polynomial of a kink over a step is widened by this part.
const DOUBT: f64 = 0.5;

/// A kink is far from its threshold that is further than this many times what its values bow over a
/// step.
const BOW: f64 = 4.0;

/// Factor by which a kink may move faster than in the last step that was examined, and number of
/// such steps for which it is not examined.
const SUDDEN: f64 = 8.0;
const QUIET: f64 = 32.0;

/// Reason to look for the instant of a kink that changed its sign over a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Closely {
    /// None: the error test has seen it.
    No,
    /// The step is short: the equations may hold the solution there.
    Ties,
    /// The estimate of the error vanishes for some places of a kink, and may do so here.
    Doubt,
}

/// Root functions that bounds over a step leave open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Open {
    /// Nothing has happened in it but what its ends show.
    Nothing,
    /// Kinks may have been passed to and fro.
    Kinks,
    /// Something may have happened.
    Everything,
}

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

    /// Returns `true` if the value is at the threshold that it was at before.
    fn stays(&self, value: f64) -> bool {
        self.band >= 0.0 && value.abs() <= self.band
    }
}

/// Work since time last moved by a part of the interval.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Crawl {
    /// That time.
    pub since: f64,
    /// Steps tried until then.
    pub begin: u64,
    /// Stops since.
    pub stops: u64,
}

/// Conditions at the last accepted state, and root functions there and nearby.
#[derive(Default)]
pub(crate) struct Watch {
    kinds: Box<[RootKind]>,
    pub edges: Box<[Edge]>,
    /// Root functions at the state looked at.
    pub values: Box<[f64]>,
    /// The same where the last step began.
    pub begin: Box<[f64]>,
    /// The same a little later.
    pub ahead: Box<[f64]>,
    /// Lower bounds of the root functions over a part of a step, then upper ones.
    pub bounds: Box<[f64]>,
    /// By how much they differ within the tolerances of the unknowns.
    tolerances: Box<[f64]>,
    /// Conditions where the last step began that was looked at closely.
    origin: Box<[Edge]>,
    /// Kinks of which a step may have passed a form unseen.
    unseen: Box<[bool]>,
    /// Kinks that may hold the solution: steps have become short there.
    tied: Box<[bool]>,
    /// Kinks that are looked at in every step, and a time before which they are far from their
    /// thresholds.
    loose: Vec<usize>,
    quiet: f64,
    /// Root functions at three quarters of the last step, one after another.
    pub samples: [Box<[f64]>; 3],
    /// The values are those of an earlier state.
    pub stale: bool,
    /// The switch at which the integration stopped.
    pub switched: Option<usize>,
    /// The last two different switches at which it stopped, the last one first.
    pub last_switches: [Option<usize>; 2],
    /// No tie is looked for before this time; and how many were tried.
    pub loose_until: f64,
    pub ties: u32,
    /// Progress between switches, and stops at each root function since.
    pub crawl: Crawl,
    pub returns: Box<[u32]>,
    /// Their motion there.
    motion: Box<[f64]>,
    /// Their rounding.
    noise: Box<[f64]>,
    /// By how much they differ at states nearby.
    moved: Box<[f64]>,
    /// Their motion just before the integration stopped, if it was evaluated.
    before: Box<[f64]>,
    /// Time of the last accepted state in which nothing happened, and of the first one after
    /// something did.
    pub since: f64,
    pub until: f64,
    /// Something has happened between the two.
    pub passed: bool,
    /// The integration stopped for switches alone.
    pub at_switch: bool,
    /// It stopped at a kink that may hold the solution.
    pub at_tie: bool,
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
            begin: zeros(),
            ahead: zeros(),
            bounds: vec![0.0; 2 * roots].into(),
            tolerances: zeros(),
            origin: vec![Edge::default(); roots].into(),
            unseen: vec![false; roots].into(),
            tied: vec![false; roots].into(),
            loose: Vec::with_capacity(roots),
            samples: std::array::from_fn(|_| zeros()),
            motion: zeros(),
            noise: zeros(),
            moved: zeros(),
            before: zeros(),
            returns: vec![0; roots].into(),
            ..Self::default()
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    fn is_event(&self, i: usize) -> bool {
        self.kinds[i].role == RootRole::Event
    }

    /// Notes values of events that are not numbers.
    fn note_undefined(&mut self) {
        let found = self.values.iter().enumerate().position(|(i, value)| value.is_nan() && self.is_event(i));
        self.undefined = self.undefined.or(found);
    }

    /// Takes the values at an accepted state; whether a condition has become true since the one
    /// before.
    pub(super) fn accept(&mut self, time: f64) -> bool {
        self.passed = (0..self.edges.len()).any(|i| self.stops(i));
        if self.passed {
            self.until = time;
            return true;
        }
        self.note_undefined();
        self.since = time;
        let each = self.edges.iter_mut().zip(&self.values).zip(self.kinds.iter().zip(&self.unseen));
        for ((edge, &value), (kind, &unseen)) in each {
            let band = edge.band.max(0.0);
            if matches!(kind.role, RootRole::Kink { .. }) {
                // Inside of a step that one has its value of the beginning of the step, until the
                // integration stops.
                if value.abs() > band && !unseen {
                    *edge = Edge::known(value > 0.0);
                }
            } else if value < -band {
                *edge = Edge::default();
            } else if edge.holds && value > band {
                edge.band = AWAY;
            }
        }
        false
    }

    /// Returns `true` if the integration stops for a root function. NaN stops nothing.
    fn stops(&self, i: usize) -> bool {
        let (edge, value, kind) = (self.edges[i], self.values[i], self.kinds[i]);
        let band = edge.band.max(0.0);
        if let RootRole::Kink { .. } = kind.role {
            let least = if self.tied[i] { band } else { band.max(self.tolerances[i]) };
            return (self.tied[i] || self.unseen[i]) && edge.holds != (value > 0.0) && value.abs() > least;
        }
        match edge.holds {
            true => kind.both && value < -band,
            false => value > band || (value == 0.0 && !kind.strict && edge.band < 0.0),
        }
    }

    /// Forgets what was found out of the step before.
    pub(super) fn begin_step(&mut self) {
        self.unseen.fill(false);
        self.tied.fill(false);
        self.stale = false;
        self.origin.copy_from_slice(&self.edges);
    }

    /// Takes conditions as they were where the last step began.
    pub(super) fn go_back(&mut self) {
        self.edges.copy_from_slice(&self.origin);
    }

    /// Nothing is known of ties.
    pub(super) fn forget_ties(&mut self) {
        (self.loose_until, self.ties) = (f64::NEG_INFINITY, 0);
        self.begin_crawl(f64::NEG_INFINITY, 0);
        self.last_switches = [None; 2];
    }

    /// Counts stops from a time on at which so many steps had been tried.
    pub(super) fn begin_crawl(&mut self, since: f64, begin: u64) {
        self.crawl = Crawl { since, begin, stops: 0 };
        self.returns.fill(0);
    }

    /// The next kink from a number on.
    pub(super) fn kink_from(&self, from: usize) -> Option<usize> {
        (from..self.kinds.len()).find(|&i| matches!(self.kinds[i].role, RootRole::Kink { .. }))
    }

    /// Returns `true` if equations have switches.
    pub(super) fn has_switches(&self) -> bool {
        self.kinds.iter().any(|kind| kind.role != RootRole::Event)
    }

    /// Returns `true` if bounds say that no event happens and no equation jumps. Kinks of which
    /// they say nothing are kept: they are looked at in every step.
    pub(super) fn is_safe(&mut self) -> bool {
        let n = self.edges.len();
        self.loose.clear();
        self.quiet = f64::NEG_INFINITY;
        for i in 0..n {
            let (low, high) = (self.bounds[i], self.bounds[n + i]);
            // What may not be a number is looked at.
            let certain = self.kinds[i].bounded && low <= high && if self.edges[i].holds { low > 0.0 } else { high < 0.0 };
            match self.kinds[i].role {
                _ if certain => {}
                RootRole::Kink { .. } => self.loose.push(i),
                _ => return false,
            }
        }
        for (i, edge) in self.edges.iter_mut().enumerate() {
            if !self.loose.contains(&i) {
                edge.band = AWAY;
            }
        }
        true
    }

    /// Returns whether conditions of events hold or not as these, all away from their thresholds.
    pub(super) fn agrees(&self, holds: &[bool]) -> bool {
        let each = self.edges.iter().zip(&self.kinds).zip(holds);
        each.into_iter().all(|((edge, kind), &holds)| kind.role != RootRole::Event || (edge.holds == holds && edge.band < 0.0))
    }

    /// Takes the jumps as these, away from their thresholds.
    pub(super) fn take_jumps_from(&mut self, holds: &[bool]) {
        for ((edge, kind), &holds) in self.edges.iter_mut().zip(&self.kinds).zip(holds) {
            if kind.role != RootRole::Event {
                *edge = Edge::known(holds);
            }
        }
    }

    /// Returns `true` if there are kinks to be looked at in every step.
    #[inline]
    pub(super) fn has_loose(&self, to: f64) -> bool {
        !self.loose.is_empty() && to > self.quiet
    }

    /// Nothing is known of how kinks move.
    pub(super) fn forget_quiet(&mut self) {
        self.quiet = f64::NEG_INFINITY;
    }

    /// Returns whether all there is are kinks that are far from their thresholds.
    #[inline]
    pub(super) fn is_quiet(&self, to: f64) -> bool {
        to <= self.quiet && self.loose.len() == self.edges.len()
    }

    /// Notes how long kinks that have not been passed in a step stay far from their thresholds, by
    /// their motion in it: values as for [`is_loose_still`](Self::is_loose_still).
    pub(super) fn note_quiet(&mut self, (from, to): (f64, f64)) {
        let step = to - from;
        let steps = self.loose.iter().map(|&i| {
            let (begin, middle, end) = (self.begin[i], self.ahead[i], self.values[i]);
            let fastest = 2.0 * (middle - begin).abs().max((end - middle).abs());
            if end == 0.0 { 0.0 } else { end.abs() / (SUDDEN * fastest) }
        });
        self.quiet = to + step * steps.fold(QUIET, f64::min);
    }

    /// Returns `true` if a step that ends at the present values has not passed such kinks to and
    /// fro, by the values in its middle, which are those ahead.
    pub(super) fn is_loose_still(&self) -> bool {
        self.loose.iter().all(|&i| {
            let (begin, middle, end) = (self.begin[i], self.ahead[i], self.values[i]);
            let sizes = [begin.abs(), middle.abs(), end.abs()];
            let bow = (middle - 0.5 * (begin + end)).abs();
            let one_side = (begin > 0.0) == (end > 0.0) && (middle > 0.0) == (end > 0.0) && self.edges[i].holds == (end > 0.0);
            let far = one_side && sizes.iter().all(|&size| size > BOW * bow);
            far || sizes.iter().all(|&size| size <= self.tolerances[i])
        })
    }

    /// Goes to a time up to which nothing can have happened.
    #[inline]
    pub(super) fn pass(&mut self, time: f64) {
        (self.since, self.passed, self.stale) = (time, false, true);
    }

    /// Events and kinks that the bounds over the whole step leave open.
    pub(super) fn what_is_open(&self, closely: Closely) -> Open {
        let mut open = Open::Nothing;
        for i in 0..self.edges.len() {
            if self.is_kink_that_changed(i) {
                if closely != Closely::No || self.interferes(i) {
                    return Open::Everything;
                }
                continue;
            }
            let (edge, kind) = (self.edges[i], self.kinds[i]);
            let (low, high, band) = (self.bounds[i], self.bounds[self.edges.len() + i], edge.band.max(0.0));
            // What is not a number leaves it open.
            let same = if edge.holds { low >= -band } else { high < 0.0 || high <= band };
            match kind.role {
                _ if same || !kind.bounded => {}
                RootRole::Kink { .. } => open = Open::Kinks,
                _ => return Open::Everything,
            }
        }
        open
    }

    fn is_kink_that_changed(&self, i: usize) -> bool {
        let (edge, value) = (self.edges[i], self.values[i]);
        matches!(self.kinds[i].role, RootRole::Kink { .. }) && edge.holds != (value > 0.0) && value.abs() > edge.band.max(0.0)
    }

    /// Returns `true` if another kink of the same quantity changed its sign, too: the step may have
    /// passed a form in between.
    fn interferes(&self, i: usize) -> bool {
        (0..self.edges.len()).any(|j| j != i && self.kinds[j].role == self.kinds[i].role && self.is_kink_that_changed(j))
    }

    /// Begins a search inside of the step that ends at the present values, where the bounds are
    /// those within the tolerances of its unknowns.
    pub(super) fn begin_search(&mut self, closely: Closely) {
        let n = self.edges.len();
        for i in 0..n {
            let width = 0.5 * (self.bounds[n + i] - self.bounds[i]);
            self.tolerances[i] = if width.is_finite() { width } else { 0.0 };
        }
        for i in (0..n).filter(|&i| matches!(self.kinds[i].role, RootRole::Kink { .. })) {
            self.unseen[i] = if self.is_kink_that_changed(i) { closely == Closely::Doubt || self.interferes(i) } else { self.may_hide(i) };
            self.tied[i] = closely == Closely::Ties && self.is_kink_that_changed(i) && self.values[i].abs() <= TIE * self.tolerances[i];
        }
    }

    /// A switch is held at its threshold while it is not further from it than this.
    pub(super) fn hold(&mut self, i: usize, band: f64) {
        self.edges[i].band = band;
    }

    /// Returns `true` if a search inside of the step has something to look for.
    pub(super) fn is_search_due(&self, open: Open) -> bool {
        open == Open::Everything || self.unseen.contains(&true) || self.tied.contains(&true)
    }

    /// Returns `true` if a kink may have changed its sign to and fro, by its values at the quarters
    /// of the step: bounds of a long expression say little. The polynomial through them is widened
    /// by half than it is.
    fn may_hide(&self, i: usize) -> bool {
        // The sign at the beginning is that of the end.
        let [a, b, c] = [0, 1, 2].map(|k| self.samples[k][i]);
        let begin = if self.edges[i].holds { self.begin[i].max(0.0) } else { self.begin[i].min(0.0) };
        let (low, high) = hull([begin, a, b, c, self.values[i]]);
        let margin = DOUBT * (high - low);
        let tolerance = self.tolerances[i];
        !(low - margin >= -tolerance || high + margin <= tolerance)
    }

    /// Returns `true` if the bounds over a part of a step leave a sign open.
    pub(super) fn may_change(&self) -> bool {
        let n = self.edges.len();
        (0..n).any(|i| {
            let (kind, tolerance) = (self.kinds[i], self.tolerances[i]);
            let kink = matches!(kind.role, RootRole::Kink { .. });
            let matters = kind.bounded && (self.unseen[i] || self.tied[i] || !kink);
            let shallow = if self.unseen[i] { tolerance } else { SHALLOW * tolerance };
            let (low, high) = (self.bounds[i], self.bounds[n + i]);
            matters && !(low > 0.0 || high < 0.0 || (low >= -shallow && high <= shallow))
        })
    }

    /// Returns `true` if there are root functions of which no bounds are known.
    pub(super) fn has_unbounded(&self) -> bool {
        self.kinds.iter().any(|kind| !kind.bounded)
    }

    /// Returns `true` if a root function is at its threshold, or just there.
    pub(crate) fn is_at_threshold(&mut self) -> bool {
        self.motion.fill(0.0);
        self.edges.iter().zip(&self.values).any(|(edge, &value)| value == 0.0 || edge.stays(value))
    }

    /// The root function of an event that is nearest to its threshold in terms of its motion to the
    /// values ahead, within a thousand times that.
    pub(crate) fn nearest(&self) -> Option<usize> {
        let distance = |i: usize| self.values[i].abs() / (self.ahead[i] - self.values[i]).abs();
        let near = (0..self.edges.len()).filter(|&i| self.is_event(i) && distance(i) < 1e3);
        near.min_by(|&a, &b| distance(a).total_cmp(&distance(b)))
    }

    /// Takes the motion from the values ahead, where it did not show yet; whether it shows for all
    /// that are at their threshold.
    pub(crate) fn look_ahead(&mut self) -> bool {
        for i in 0..self.motion.len() {
            if self.motion[i] == 0.0 {
                self.motion[i] = self.ahead[i] - self.values[i];
            }
        }
        self.motion_shows()
    }

    fn motion_shows(&self) -> bool {
        (0..self.motion.len()).all(|i| {
            let value = self.values[i];
            self.motion[i] != 0.0 || !(value == 0.0 || self.edges[i].stays(value))
        })
    }

    /// Notes motion to values that are further ahead, and at a part of the way there: it counts
    /// where it goes along with the way.
    pub(crate) fn note_far(&mut self, first: bool, part: f64) {
        for i in 0..self.moved.len() {
            let motion = self.ahead[i] - self.values[i];
            if first {
                self.moved[i] = motion;
            } else if !(motion * self.moved[i] > 0.0 && motion.abs() >= STEADY * part * self.moved[i].abs()) {
                self.moved[i] = 0.0;
            }
        }
    }

    /// Takes what was noted, where motion did not show yet; whether it shows for all that are at
    /// their threshold.
    pub(crate) fn take_far(&mut self) -> bool {
        for (motion, &far) in self.motion.iter_mut().zip(&self.moved) {
            if *motion == 0.0 {
                *motion = far;
            }
        }
        self.motion_shows()
    }

    /// Conditions after the state, the inputs or the equations may have changed; whether one became
    /// true. Switches are taken as they are.
    pub(super) fn settle(&mut self, fired: &mut [c_int]) -> bool {
        self.note_undefined();
        for (i, fired) in fired.iter_mut().enumerate() {
            let (value, kind, edge) = (self.values[i], self.kinds[i], self.edges[i]);
            let (motion, noise, stays) = (self.motion[i], self.noise[i], edge.stays(value));
            self.edges[i] = match value {
                value if value.is_nan() => edge,
                _ if stays && motion != 0.0 => Edge { holds: motion > 0.0, ..edge },
                _ if stays => edge,
                0.0 => Edge { holds: if kind.strict { motion > 0.0 } else { true }, band: noise },
                // Where the step begins, its polynomial is off by rounding.
                _ => Edge { holds: value > 0.0, band: if value.abs() <= noise { noise } else { AWAY } },
            };
            *fired = if kind.role == RootRole::Event { change(edge, self.edges[i], kind) } else { 0 };
        }
        fired.iter().any(|&f| f != 0)
    }

    /// Returns `true` if a condition that is away from its threshold moves over it within rounding
    /// or `reach` times the motion to the values ahead.
    pub(crate) fn is_about_to_stop(&self, reach: f64) -> bool {
        (0..self.edges.len()).filter(|&i| self.edges[i].band < 0.0 && self.is_event(i)).any(|i| {
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

    /// Returns `true` if a value that is not zero differs by as much at a state that is the same
    /// but for rounding.
    pub(crate) fn is_lost_in_noise(&self) -> bool {
        self.noise.iter().zip(&self.values).any(|(&noise, &value)| value != 0.0 && noise >= value.abs())
    }

    /// Takes the differences at states that differ by more than rounding: where they are no larger
    /// the root function jumps, and has no noise.
    pub(crate) fn take_jumps(&mut self) {
        for (noise, moved) in self.noise.iter_mut().zip(&self.moved) {
            if *moved <= 2.0 * *noise {
                *noise = 0.0;
            }
        }
    }

    /// Returns `true` if the integration has stopped at a threshold from which the equations lead
    /// back.
    pub(crate) fn is_led_back(&self) -> bool {
        (0..self.edges.len()).any(|i| !self.edges[i].holds && self.stops(i) && self.ahead[i] < self.values[i])
    }

    /// Takes the motion at a state just before the one at which the integration stopped.
    pub(crate) fn note_before(&mut self) {
        for ((before, ahead), value) in self.before.iter_mut().zip(&self.ahead).zip(&self.values) {
            *before = ahead - value;
        }
    }

    /// Conditions where the integration has stopped. What moves over its threshold to within
    /// rounding or `reach` times the motion to the values ahead has passed it. What the equations
    /// move the other way has not, whatever the polynomial says, unless they turn round at the
    /// threshold, where they have moved it by more than rounding. A strict condition waits for the
    /// motion after what happens here, but for that.
    pub(crate) fn arrive(&mut self, reach: f64, fired: &mut [c_int]) {
        self.note_undefined();
        (self.at_switch, self.at_tie, self.switched) = (true, false, None);
        for (i, fired) in fired.iter_mut().enumerate() {
            let (value, kind, edge) = (self.values[i], self.kinds[i], self.edges[i]);
            let motion = self.ahead[i] - value;
            let near = (motion.abs() * reach).max(self.noise[i]);
            let stops = self.stops(i);
            if stops && kind.role != RootRole::Event {
                self.switched = self.switched.or(Some(i));
                self.at_tie |= self.tied[i];
                self.returns[i] += 1;
                if self.last_switches[0] != Some(i) {
                    self.last_switches = [Some(i), self.last_switches[0]];
                }
            }
            let brought = !edge.holds && stops && motion < 0.0 && self.before[i] * reach > self.noise[i];
            self.edges[i] = if value.is_nan() {
                edge
            } else if brought {
                Edge { holds: true, band: near.max(value.abs()) }
            // What stood at its threshold stops just outside of its band.
            } else if value.abs() <= near.max(2.0 * edge.band) {
                let holds = match edge.holds {
                    true => motion >= 0.0 && !stops,
                    false => {
                        // An equation does not wait.
                        let waits = kind.strict && kind.role == RootRole::Event;
                        !waits && (motion > 0.0 || (stops && motion == 0.0)) && (stops || !edge.stays(value))
                    }
                };
                Edge { holds, band: near.max(value.abs()) }
            } else {
                Edge { holds: if edge.holds { value >= 0.0 } else { stops }, band: AWAY }
            };
            *fired = match kind.role {
                RootRole::Kink { .. } => 0,
                _ => change(edge, self.edges[i], kind),
            };
            // Also one that waits for the motion.
            self.at_switch &= !(kind.role == RootRole::Event && (stops || *fired != 0));
        }
        self.before.fill(0.0);
    }

    /// Returns whether the values ahead are behind a jump that the present ones are before.
    pub(super) fn jumps_ahead(&self) -> bool {
        (0..self.edges.len()).any(|i| {
            let (edge, ahead, band) = (self.edges[i], self.ahead[i], self.edges[i].band.max(0.0));
            self.kinds[i].role == RootRole::Jump && if edge.holds { ahead < -band } else { ahead > band }
        })
    }

    /// Returns `true` if the integration stopped for a jump, among what fired.
    pub(super) fn has_jumped(&self, fired: &[c_int]) -> bool {
        fired.iter().zip(&self.kinds).any(|(&fired, kind)| fired != 0 && kind.role == RootRole::Jump)
    }
}

/// Direction of a change: 1 for a condition that became true, -1 for one that ceased to hold if
/// that matters.
fn change(before: Edge, now: Edge, kind: RootKind) -> c_int {
    match (before.holds, now.holds) {
        (false, true) => 1,
        (true, false) if kind.both => -1,
        _ => 0,
    }
}
