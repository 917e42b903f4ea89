//! Past values of delayed expressions, and the times at which they change their form.
//!
//! A model with `delay(e, theta)` reads inputs that follow from its past. Every accepted step is
//! sampled into polynomials (`record`). Places at which these are not smooth become breaks of the
//! integration (`marks`), so that a step sees one form of each delayed value. No step is longer
//! than the shortest dead time, so that what it reads is known.

mod given;
mod marks;
pub(crate) mod moved;
mod record;

use serde::{Deserialize, Serialize};
use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::ir::{DELAY_SLOTS, DelaySlot};
use smpl_compiler::layout::{Memory, Region};
use smpl_compiler::model::Lag;

pub use self::given::History;
pub(crate) use self::given::Samples;
use self::marks::{Marks, are_near};
use self::record::{ROUNDINGS, Record, TERMS, nodes};
use crate::solver::Within;

/// Numbers of one element.
const SLOTS: usize = DELAY_SLOTS as usize;

/// Most repetitions until values that read each other at the start agree.
const ROUNDS: u32 = 200;

/// Most halvings of a step until polynomials go through its values.
const HALVINGS: u32 = 8;

/// Part of the relative tolerance to which they do.
const PRECISION: f64 = 0.01;

/// Relative tolerances that a value or its rate has to change by, to jump.
const JUMP: f64 = 10.0;
const KINK: f64 = 100.0;

/// Part of a dead time over which a rate is looked at.
const AHEAD: f64 = 1e-7;

/// Part of a step in which values may be looked at instead of at its ends.
const END: f64 = 1e-3;

/// Part of a dead time by which a time may exceed what is recorded.
const SLACK: f64 = 1e-9;

/// Source of the delayed values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Source {
    /// They are the present ones.
    Rest,
    /// They are those before the start, which are the present ones where none are given.
    Start,
    /// From the record.
    Record,
}

/// Delayed values that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PastError {
    /// A dead time that is not positive.
    #[error("the dead time of `{delay}` is {value}: it must be positive and finite")]
    DeadTime {
        /// The call.
        delay: String,
        /// The dead time.
        value: f64,
    },
    /// A delayed expression that does not follow from states and actions.
    #[error("a history gives states and actions, and `{delay}` delays more: an algebraic variable, a rate or a delayed value")]
    History {
        /// The call.
        delay: String,
    },
    /// The value before the start depends on itself.
    #[error("the value of `{delay}` before the start depends on itself: give one, `delay(e, theta, before = e0)`")]
    Start {
        /// The call.
        delay: String,
    },
}

/// Data of a snapshot.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Kept {
    source: Source,
    record: Record,
    marks: Marks,
    lags: Vec<f64>,
    /// The time at which the last integration began: breaks near it are behind.
    began: f64,
}

/// The past of the delayed expressions of one instance.
#[derive(Clone)]
pub(crate) struct Past {
    kept: Kept,
    /// When the dead time of each element changes.
    changes: Box<[Lag]>,
    /// Largest dead time of each element that changes.
    most: Box<[f64]>,
    /// Elements with a value before the start.
    given: Box<[bool]>,
    /// Values that are delayed read delayed ones, algebraic unknowns or rates.
    directly: bool,
    /// Some dead time changes within a step, or at its ends.
    varies: bool,
    held: bool,
    /// Distinct dead times that do not change within a step.
    distinct: Vec<f64>,
    /// The break that the integration is about to cross, and the one that it has crossed last.
    coming: Option<f64>,
    crossed: Option<f64>,
    /// Elements whose values jump where the last integration began.
    jumped: Box<[bool]>,
    /// The shortest and the longest dead time; infinite for residence times, of which all is kept.
    shortest: f64,
    longest: f64,
    values: Box<[f64]>,
    other: Box<[f64]>,
    /// Values inside of a span, near its ends.
    near: Box<[f64]>,
    far: Box<[f64]>,
    samples: Box<[f64]>,
    /// Unknowns and rates within a step.
    y: Box<[f64]>,
    yp: Box<[f64]>,
}

/// A point of the integration.
#[derive(Clone, Copy)]
pub(crate) struct Point<'a> {
    pub t: f64,
    pub y: &'a [f64],
    pub yp: &'a [f64],
}

impl Past {
    /// The past of a model; `None` for one without delays.
    pub(crate) fn new(model: &CompiledModel) -> Option<Self> {
        let delays = &model.model().delays;
        let width = model.model().delayed();
        if width == 0 {
            return None;
        }
        let each = || delays.iter().flat_map(|delay| std::iter::repeat_n(delay, delay.count as usize));
        let numbers = |n: usize| vec![0.0; n].into_boxed_slice();
        Some(Self {
            kept: Kept {
                source: Source::Rest,
                record: Record::new(width),
                marks: Marks::default(),
                lags: vec![f64::NAN; width],
                began: 0.0,
            },
            changes: each().map(|delay| delay.lag).collect(),
            most: each().map(|delay| delay.bounds.1).collect(),
            given: each().map(|delay| delay.before).collect(),
            directly: model.model().delays_follow(),
            varies: delays.iter().any(|delay| delay.lag == Lag::Varying),
            held: delays.iter().any(|delay| delay.lag == Lag::Held),
            distinct: Vec::with_capacity(width),
            coming: None,
            crossed: None,
            jumped: vec![false; width].into_boxed_slice(),
            shortest: f64::INFINITY,
            longest: 0.0,
            values: numbers(width),
            other: numbers(width),
            near: numbers(width),
            far: numbers(width),
            samples: numbers(TERMS * width),
            y: numbers(model.unknowns()),
            yp: numbers(model.unknowns()),
        })
    }

    /// Data of a snapshot.
    pub(crate) fn kept(&self) -> &Kept {
        &self.kept
    }

    /// Takes what a snapshot kept; whether it fits.
    pub(crate) fn take(&mut self, kept: &Kept) -> bool {
        let width = self.values.len();
        if !kept.record.fits(width) || kept.lags.len() != width {
            return false;
        }
        self.kept.clone_from(kept);
        self.measure();
        true
    }

    /// There is no past: delayed values are the present ones.
    pub(crate) fn rest(&mut self) {
        self.kept.source = Source::Rest;
        self.kept.record.clear();
        self.kept.marks.clear();
    }

    /// An episode is about to start.
    pub(crate) fn start(&mut self) {
        self.rest();
        self.kept.source = Source::Start;
    }

    /// The longest step whose delayed values are known.
    pub(crate) fn longest_step(&self) -> f64 {
        if self.kept.source == Source::Record { self.shortest } else { f64::INFINITY }
    }

    /// The next time at which a delayed value is not smooth.
    pub(crate) fn next_break(&self) -> f64 {
        if self.kept.source == Source::Record { self.kept.marks.next() } else { f64::INFINITY }
    }

    /// Fills the delayed values at a point. `strictly`: those of a time that is not recorded yet
    /// are not numbers, so that a step to there is shortened; otherwise they go on along straight
    /// lines.
    pub(crate) fn fill(&mut self, model: &CompiledModel, memory: &mut Memory, at: Point<'_>, strictly: bool) {
        if self.kept.source != Source::Record {
            self.fill_present(model, memory, at);
            return;
        }
        if self.varies {
            model.lags(memory, at.t, at.y, at.yp, &mut self.kept.lags);
            self.shortest = self.kept.lags.iter().copied().fold(f64::INFINITY, f64::min);
        }
        let Kept { record, lags, .. } = &self.kept;
        let reach = self.reach_at(at.t);
        let slots = memory.region_mut(Region::Delayed);
        let mut spot = None;
        for (element, (slots, &lag)) in slots.chunks_exact_mut(SLOTS).zip(lags).enumerate() {
            let earlier = at.t - lag;
            let (_, found) = match spot {
                Some((known, found)) if known == earlier => (known, found),
                _ => (earlier, record.locate(earlier, reach)),
            };
            spot = Some((earlier, found));
            let (mut value, slope) = record.at(&found, element);
            let allowed = lag > 0.0 && !(strictly && self.changes[element] == Lag::Varying && found.beyond > SLACK * lag);
            let within = self.changes[element] == Lag::Constant || lag <= self.most[element] * (1.0 + SLACK);
            if !(allowed && within) {
                value = f64::NAN;
            }
            slots[DelaySlot::Value as usize] = value;
            slots[DelaySlot::Slope as usize] = slope;
            slots[DelaySlot::At as usize] = earlier;
        }
    }

    /// The time by which an earlier time may miss a jump and still be behind it. Where an
    /// integration begins it is as long as times are one: breaks there have been crossed.
    fn reach_at(&self, now: f64) -> f64 {
        if are_near(now, self.kept.began) { marks::near(now) } else { ROUNDINGS * now.abs() }
    }

    /// Fills the delayed values without a record; repeatedly, where they read each other or what
    /// follows from them. Returns by how much they differ in the last two repetitions, in parts of
    /// themselves.
    fn fill_present(&mut self, model: &CompiledModel, memory: &mut Memory, at: Point<'_>) -> f64 {
        model.lags(memory, at.t, at.y, at.yp, &mut self.other);
        for (slots, lag) in memory.region_mut(Region::Delayed).chunks_exact_mut(SLOTS).zip(&self.other) {
            slots[DelaySlot::Slope as usize] = 0.0;
            slots[DelaySlot::At as usize] = at.t - lag;
        }
        let mut change = 0.0;
        for _ in 0..if self.directly { ROUNDS } else { 1 } {
            model.delayed(memory, at.t, at.y, at.yp, &mut self.values);
            if self.kept.source == Source::Start {
                self.fill_before(model, memory, at);
            }
            change = 0.0_f64;
            for (slots, value) in memory.region_mut(Region::Delayed).chunks_exact_mut(SLOTS).zip(&self.values) {
                let own = (slots[DelaySlot::Value as usize] - value).abs() / value.abs().max(f64::MIN_POSITIVE);
                change = if own.is_nan() { f64::INFINITY } else { change.max(own) };
                slots[DelaySlot::Value as usize] = *value;
            }
            if change <= 4.0 * f64::EPSILON {
                break;
            }
        }
        if self.directly { change } else { 0.0 }
    }

    /// Replaces values at the start by those before it, where they are given: a dead time earlier.
    fn fill_before(&mut self, model: &CompiledModel, memory: &mut Memory, at: Point<'_>) {
        for element in (0..self.given.len()).filter(|&element| self.given[element]) {
            let mut all = std::mem::take(&mut self.samples);
            let width = self.values.len();
            model.before(memory, at.t - self.other[element], at.y, at.yp, &mut all[..width]);
            self.values[element] = all[element];
            self.samples = all;
        }
    }

    /// Records what was before the start, which is at this point.
    ///
    /// # Errors
    /// A dead time that is not positive, or values that depend on themselves.
    pub(crate) fn record_start(&mut self, model: &CompiledModel, memory: &mut Memory, at: Point<'_>, rtol: f64) -> Result<(), PastError> {
        self.start();
        let change = self.fill_present(model, memory, at);
        let named = |element: usize| name_of(model, element);
        if let Some(element) = (0..self.values.len()).find(|&element| change > rtol || !self.values[element].is_finite()) {
            return Err(PastError::Start { delay: named(element) });
        }
        self.kept.lags.copy_from_slice(&self.other);
        if let Some(element) = self.kept.lags.iter().position(|lag| !(*lag > 0.0 && lag.is_finite())) {
            return Err(PastError::DeadTime { delay: named(element), value: self.kept.lags[element] });
        }
        self.measure();
        let span = (at.t - self.reach(), at.t);
        let own = self.values.clone();
        let given = self.given.contains(&true);
        self.record_span(span, rtol, &mut |past, t, out| {
            if given {
                model.before(memory, t, at.y, at.yp, out);
            }
            out.iter_mut().zip(&past.given).zip(&own).filter(|((_, given), _)| !**given).for_each(|((out, _), own)| *out = *own);
        });
        (self.kept.source, self.kept.began) = (Source::Record, at.t);
        Ok(())
    }

    /// Limits that follow from the dead times.
    fn measure(&mut self) {
        self.distinct.clear();
        for (lag, changes) in self.kept.lags.iter().zip(&self.changes) {
            if *changes != Lag::Varying && !self.distinct.contains(lag) {
                self.distinct.push(*lag);
            }
        }
        self.shortest = self.kept.lags.iter().copied().fold(f64::INFINITY, f64::min);
        let unlimited = self.changes.iter().zip(&self.most).any(|(changes, most)| *changes == Lag::Varying && most.is_infinite());
        self.longest = if unlimited { f64::INFINITY } else { self.reach() };
    }

    /// The longest dead time that is known: the bounds of those that change, and the present ones.
    fn reach(&self) -> f64 {
        let most = |(lag, most): (&f64, &f64)| if most.is_finite() { lag.max(*most) } else { *lag };
        self.kept.lags.iter().zip(&self.most).map(most).fold(0.0, f64::max)
    }

    /// Records values over a span of time as few polynomials as they need.
    fn record_span(&mut self, (begin, end): (f64, f64), rtol: f64, value: &mut dyn FnMut(&mut Self, f64, &mut [f64])) {
        let width = self.values.len();
        let (mut from, mut length) = (begin, end - begin);
        let least = length * 0.5_f64.powi(HALVINGS as i32);
        while from < end {
            let to = if from + 1.5 * length > end && from + length >= end * (1.0 - f64::EPSILON) { end } else { (from + length).min(end) };
            if to <= from {
                break;
            }
            let mut samples = std::mem::take(&mut self.samples);
            for (node, out) in nodes().into_iter().zip(samples.chunks_exact_mut(width)) {
                value(self, if node == 1.0 { to } else { from + node * (to - from) }, out);
            }
            let behind = self.crossed.take().filter(|at| *at <= from).unwrap_or(from);
            self.kept.record.push(behind, (from, to), &samples);
            let mut resolved = self.kept.record.is_resolved(PRECISION * rtol);
            if !resolved && self.continue_to_ends((from, to), rtol, &mut samples, value) {
                self.kept.record.pop();
                self.kept.record.push(behind, (from, to), &samples);
                resolved = self.kept.record.is_resolved(PRECISION * rtol);
            }
            self.samples = samples;
            if !resolved && length > 1.5 * least {
                self.kept.record.pop();
                self.crossed = (behind < from).then_some(behind);
                length *= 0.5;
                continue;
            }
            from = to;
        }
    }

    /// Replaces samples at the ends of a span that belong to the other side of a jump there by the
    /// straight line from within. A step may end, and the next one begin, within a rounding of a
    /// threshold. Returns whether there was one.
    fn continue_to_ends(
        &mut self,
        (from, to): (f64, f64),
        rtol: f64,
        samples: &mut [f64],
        value: &mut dyn FnMut(&mut Self, f64, &mut [f64]),
    ) -> bool {
        let width = self.values.len();
        let inside = (AHEAD * self.shortest).max(1e3 * f64::EPSILON * to.abs()).min(END * (to - from));
        let (mut near, mut far) = (std::mem::take(&mut self.near), std::mem::take(&mut self.far));
        let mut any = false;
        for (first, end, step) in [(0, from, inside), (samples.len() - width, to, -inside)] {
            value(self, end + step, &mut near);
            value(self, end + 2.0 * step, &mut far);
            for (element, sample) in samples[first..first + width].iter_mut().enumerate() {
                let (jump, size) = ((near[element] - *sample).abs(), self.kept.record.size(element));
                if jump > JUMP * rtol * size && (far[element] - near[element]).abs() < 0.5 * jump {
                    (*sample, any) = (2.0 * near[element] - far[element], true);
                }
            }
        }
        (self.near, self.far) = (near, far);
        any
    }

    /// An integration begins at a time and state, which may not be consistent yet: what was
    /// recorded later is forgotten.
    pub(crate) fn begin(&mut self, model: &CompiledModel, memory: &mut Memory, at: Point<'_>) {
        if self.kept.source != Source::Record {
            return;
        }
        self.crossed = self.coming.take();
        self.kept.began = at.t;
        self.kept.record.cut(at.t);
        self.kept.record.forget_short(SLACK * self.shortest);
        if self.held {
            model.lags(memory, at.t, at.y, at.yp, &mut self.other);
            let each = self.changes.iter().zip(&self.other).zip(&mut self.kept.lags);
            let mut moved = false;
            for ((_, new), lag) in each.filter(|((changes, new), lag)| **changes == Lag::Held && new != lag) {
                (*lag, moved) = (*new, true);
            }
            if moved {
                self.measure();
                self.kept.marks.renew(at.t, &self.distinct);
            }
        }
        let Kept { marks, .. } = &mut self.kept;
        marks.begin(at.t, self.directly, &self.distinct);
    }

    /// An integration has begun at this point: notes whether delayed expressions jump there, or
    /// have a kink.
    pub(crate) fn begun(&mut self, model: &CompiledModel, memory: &mut Memory, at: Point<'_>, rtol: f64) {
        if self.kept.source != Source::Record {
            return;
        }
        self.fill(model, memory, at, false);
        let mut values = std::mem::take(&mut self.values);
        model.delayed(memory, at.t, at.y, at.yp, &mut values);
        let ahead = (AHEAD * self.shortest).max(1e3 * f64::EPSILON * at.t.abs());
        let width = values.len();
        let (mut y, mut later) = (std::mem::take(&mut self.y), std::mem::take(&mut self.samples));
        for (far, out) in [ahead, 2.0 * ahead].into_iter().zip(later.chunks_exact_mut(width)) {
            y.iter_mut().zip(at.y.iter().zip(at.yp)).for_each(|(to, (y, yp))| *to = y + far * yp);
            self.fill(model, memory, Point { t: at.t + far, y: &y, yp: at.yp }, false);
            model.delayed(memory, at.t + far, &y, at.yp, out);
        }
        self.fill(model, memory, at, false);
        let spot = self.kept.record.locate(self.kept.record.end(), 0.0);
        let mut level = u8::MAX;
        for element in 0..width {
            let (before, slope) = self.kept.record.at(&spot, element);
            let (mut now, near, far) = (values[element], later[element], later[width + element]);
            let mut rate = (near - now) / ahead;
            let size = self.kept.record.size(element).max(now.abs());
            // A condition at its threshold is of one value there and of the other one behind it.
            if (near - now).abs() > JUMP * rtol * size && (far - near).abs() < 0.5 * (near - now).abs() {
                (now, rate) = (near, (far - near) / ahead);
            }
            let lag = self.kept.lags[element];
            self.jumped[element] = (now - before).abs() > JUMP * rtol * size;
            level = if self.jumped[element] {
                0
            } else if (rate - slope).abs() * lag > KINK * rtol * size {
                level.min(1)
            } else {
                level
            };
        }
        (self.y, self.samples, self.values) = (y, later, values);
        self.kept.marks.add(self.crossed.unwrap_or(at.t), level, &self.distinct);
    }

    /// Notes that derivatives are not smooth where the last integration began at a time, whatever
    /// the values are.
    pub(crate) fn mark(&mut self, time: f64) {
        if self.kept.source == Source::Record {
            self.kept.marks.add(self.crossed.unwrap_or(time), 1, &self.distinct);
        }
    }

    /// The place at which the last integration began, and the first delayed expression that jumps
    /// there, if one does.
    pub(crate) fn jump(&self, time: f64) -> Option<(f64, usize)> {
        self.jumped.iter().position(|&jumps| jumps).map(|element| (self.crossed.unwrap_or(time), element))
    }

    /// Extent of the next times at which delayed values are not smooth, as far as they are near
    /// each other.
    pub(crate) fn next_breaks(&self) -> (f64, f64) {
        if self.kept.source == Source::Record { self.kept.marks.next_span() } else { (f64::INFINITY, f64::INFINITY) }
    }

    /// The break that was crossed where the last integration began.
    pub(crate) fn crossed(&self) -> Option<f64> {
        self.crossed
    }

    /// The time before the start at which an element is read at the start, if its value there is
    /// given.
    pub(crate) fn before_start(&self, element: usize, start: f64) -> Option<f64> {
        self.given[element].then(|| start - self.kept.lags[element])
    }

    /// An element whose dead time changes within a step, if there is one.
    pub(crate) fn varying(&self) -> Option<usize> {
        self.changes.iter().position(|&lag| lag == Lag::Varying)
    }

    /// Elements with this dead time.
    fn elements_with(&self, lag: f64) -> impl Iterator<Item = usize> {
        let each = self.kept.lags.iter().zip(&self.changes).enumerate();
        each.filter(move |(_, (own, changes))| **changes != Lag::Varying && (*own - lag).abs() <= SLACK * lag).map(|(at, _)| at)
    }

    /// The integration is about to cross a break.
    pub(crate) fn crosses(&mut self, at: f64) {
        self.coming = Some(at);
    }

    /// Records an accepted step, of which unknowns and rates are known at any time within.
    pub(crate) fn accept(&mut self, model: &CompiledModel, memory: &mut Memory, span: (f64, f64), rtol: f64, within: Within<'_>) {
        if self.kept.source != Source::Record || span.1 <= span.0 {
            return;
        }
        self.kept.record.cut(self.crossed.unwrap_or(span.0).min(span.0));
        let (mut y, mut yp) = (std::mem::take(&mut self.y), std::mem::take(&mut self.yp));
        self.record_span(span, rtol, &mut |past, t, out| {
            within(t, &mut y, &mut yp);
            past.fill(model, memory, Point { t, y: &y, yp: &yp }, false);
            model.delayed(memory, t, &y, &yp, out);
        });
        (self.y, self.yp) = (y, yp);
    }

    /// Forgets what no dead time reaches from a time on.
    pub(crate) fn trim(&mut self, time: f64) {
        if self.kept.source == Source::Record {
            self.kept.record.trim(time - self.longest * (1.0 + SLACK));
            self.kept.marks.trim(time, self.longest);
        }
    }

    /// Writes bounds of the delayed values over a span of time.
    pub(crate) fn bound(&mut self, memory: &mut Memory, (from, to): (f64, f64)) {
        let Kept { source, record, lags, .. } = &self.kept;
        let slots = memory.region_mut(Region::Delayed);
        for (element, (slots, lag)) in slots.chunks_exact_mut(SLOTS).zip(lags).enumerate() {
            let known = *source == Source::Record && self.changes[element] != Lag::Varying;
            let all = (f64::NEG_INFINITY, f64::INFINITY);
            let (low, high) = if known { record.bounds((from - lag, to - lag), element) } else { all };
            (slots[DelaySlot::Low as usize], slots[DelaySlot::High as usize]) = (low, high);
        }
    }
}

/// The call of an element.
pub(crate) fn name_of(model: &CompiledModel, element: usize) -> String {
    let mut ends = model.model().delays.iter().scan(0, |end, delay| {
        *end += delay.count as usize;
        Some((*end, &delay.name))
    });
    ends.find(|&(end, _)| element < end).map_or_else(String::new, |(_, name)| name.clone())
}
