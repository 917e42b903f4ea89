//! Derivatives of the recorded past, along directions.
//!
//! A delayed expression has the past v, the derivatives w at fixed times and the dead time θ. Its
//! delayed value v(t - θ) has the derivatives w(t - θ) - v'(t - θ) dθ. The equations hold the
//! second term; the first one is recorded here with each step of the derivatives. Where v jumps at
//! a time that moves, the delayed value jumps at a time that moves with it and with θ.

use smpl_compiler::compiled::tangent::TangentProgram;
use smpl_compiler::ir::DelaySlot;
use smpl_compiler::layout::Region;

use super::marks::are_near;
use super::record::{Record, TERMS, nodes};
use super::{Past, SLOTS};
use crate::sensitivity::tangents::{Point, Tangents};
use crate::solver::Nodes;
use crate::system::CompiledSystem;

/// Two derivatives of one time that differ by more than this part of them are of two jumps.
const TOGETHER: f64 = 1e-9;

/// Derivatives of the past.
pub(crate) struct MovedPast {
    /// Derivatives of inputs and unknowns, for the expressions that are delayed.
    tangents: Tangents,
    /// Those of each element along each direction.
    record: Record,
    /// Times of jumps of an element, and their derivatives; not a number where two at one time
    /// differ.
    motions: Vec<(f64, usize, Vec<f64>)>,
    /// Directions along which something has moved.
    awake: Vec<bool>,
    /// Values at the present time.
    pub(crate) values: Vec<f64>,
    samples: Vec<f64>,
    /// The break that was crossed last.
    crossed: Option<f64>,
    /// An episode has begun.
    recorded: bool,
}

impl MovedPast {
    /// Of a model along so many directions; `None` for one without delays.
    pub(crate) fn new(system: &CompiledSystem, width: usize) -> Option<Box<Self>> {
        let elements = system.model().model().delayed();
        (elements > 0).then(|| {
            Box::new(Self {
                tangents: Tangents::new(system, width),
                record: Record::new(elements * width),
                motions: Vec::new(),
                awake: vec![false; width],
                values: vec![0.0; elements * width],
                samples: vec![0.0; TERMS * elements * width],
                crossed: None,
                recorded: false,
            })
        })
    }

    /// An episode is about to begin.
    pub(crate) fn clear(&mut self) {
        self.record.clear();
        self.motions.clear();
        self.awake.fill(false);
        self.crossed = None;
        self.recorded = false;
    }

    fn width(&self) -> usize {
        self.awake.len()
    }

    /// Records what was before the start, of which `tangents` hold the derivatives as those of
    /// delayed values.
    ///
    /// # Errors
    /// In words, if a value before the start cannot be differentiated.
    pub(crate) fn start(&mut self, system: &mut CompiledSystem, from: &Tangents, (y, yp): (&[f64], &[f64])) -> Result<(), String> {
        self.tangents.copy_all(from);
        let Some(past) = system.past_mut().cloned() else { return Ok(()) };
        let (elements, width) = (past.values.len(), self.width());
        let first = system.memory().layout().range(Region::Delayed).start;
        let mut samples = std::mem::take(&mut self.samples);
        for (begin, end) in past.kept.record.spans() {
            for (node, out) in nodes().into_iter().zip(samples.chunks_exact_mut(elements * width)) {
                let point = Point { time: begin + node * (end - begin), moving: &[], y, yp };
                if past.given.contains(&true) {
                    self.tangents.run(system, TangentProgram::Before, point, elements)?;
                }
                for (element, out) in out.chunks_exact_mut(width).enumerate() {
                    let cell = first + element * SLOTS + DelaySlot::Value as usize;
                    let tangents = &self.tangents;
                    let value = |j| if past.given[element] { tangents.output(element, j) } else { tangents.work(cell, j) };
                    out.iter_mut().enumerate().for_each(|(j, out)| *out = value(j));
                }
            }
            self.record.push(begin, (begin, end), &samples);
        }
        self.samples = samples;
        self.recorded = true;
        self.wake(from);
        Ok(())
    }

    /// An integration begins at a time: what was recorded later is forgotten.
    pub(crate) fn begin(&mut self, time: f64, crossed: Option<f64>) {
        self.crossed = crossed;
        self.record.cut(time);
        self.motions.retain(|(at, ..)| *at <= crossed.unwrap_or(time).max(time));
    }

    /// Notes which directions move something, from the derivatives of inputs and unknowns.
    pub(crate) fn wake(&mut self, tangents: &Tangents) {
        let width = self.width();
        for (j, awake) in self.awake.iter_mut().enumerate().filter(|(_, awake)| !**awake) {
            *awake = tangents.moves(j) || (j..self.values.len()).step_by(width).any(|value| self.record.size(value) > 0.0);
        }
    }

    /// Marks the delayed values that move as such in the derivatives of the workspace.
    pub(crate) fn write_awake(&mut self, system: &CompiledSystem, tangents: &mut Tangents) {
        let width = self.width();
        let awake = &self.awake;
        self.values.iter_mut().enumerate().for_each(|(at, value)| *value = if awake[at % width] { 1.0 } else { 0.0 });
        Self::write(&self.values, system, tangents);
    }

    /// Takes the derivatives of inputs and unknowns where an integration begins.
    pub(crate) fn take(&mut self, tangents: &Tangents) {
        self.tangents.copy_all(tangents);
    }

    /// Returns `true` if an episode has begun.
    pub(crate) fn has_begun(&self) -> bool {
        self.recorded
    }

    /// Returns `true` if something has moved along a direction.
    pub(crate) fn is_awake(&self, direction: usize) -> bool {
        self.awake[direction]
    }

    /// Derivatives of the delayed values at a time, for the dead times that the past has looked up
    /// last.
    pub(crate) fn look_up(&mut self, past: &Past, now: f64) {
        let (width, reach) = (self.width(), past.reach_at(now));
        let mut spot = None;
        for (values, (element, &lag)) in self.values.chunks_exact_mut(width).zip(past.kept.lags.iter().enumerate()) {
            let earlier = now - lag;
            let found = match spot {
                Some((known, found)) if known == earlier => found,
                _ => self.record.locate(earlier, reach),
            };
            spot = Some((earlier, found));
            for (j, value) in values.iter_mut().enumerate() {
                *value = if self.awake[j] { self.record.at(&found, element * width + j).0 } else { 0.0 };
            }
        }
    }

    /// Writes the values that were looked up to the derivatives of the workspace.
    pub(crate) fn write(values: &[f64], system: &CompiledSystem, tangents: &mut Tangents) {
        let (first, width) = (system.memory().layout().range(Region::Delayed).start, tangents.width());
        for (element, values) in values.chunks_exact(width).enumerate() {
            let cell = first + element * SLOTS + DelaySlot::Value as usize;
            values.iter().enumerate().for_each(|(j, &value)| tangents.set_work(cell, j, value));
        }
    }

    /// Records a step of the derivatives from its nodes, along those directions that are
    /// integrated; along others derivatives of unknowns stay.
    ///
    /// # Errors
    /// In words, if a delayed expression cannot be differentiated.
    pub(crate) fn accept(&mut self, system: &mut CompiledSystem, live: &[usize], nodes: &Nodes) -> Result<(), String> {
        let (n, width, elements) = (system.model().unknowns(), self.width(), self.values.len() / self.width().max(1));
        let times = nodes.times();
        let (from, to) = (times[0], times[TERMS - 1]);
        if !self.recorded || to <= from {
            return Ok(());
        }
        self.record.cut(from);
        let mut samples = std::mem::take(&mut self.samples);
        for (node, out) in samples.chunks_exact_mut(elements * width).enumerate() {
            let (time, (y, yp)) = (times[node], nodes.at(node));
            system.look_back(time, &y[..n], &yp[..n]);
            if let Some(past) = system.past_mut() {
                self.look_up(past, time);
            }
            Self::write(&self.values, system, &mut self.tangents);
            self.tangents.take_y(&y[n..], live);
            self.tangents.take_yp(&yp[n..], live);
            let point = Point { time, moving: &[], y: &y[..n], yp: &yp[..n] };
            self.tangents.run(system, TangentProgram::Delayed, point, elements)?;
            for (element, out) in out.chunks_exact_mut(width).enumerate() {
                out.iter_mut().enumerate().for_each(|(j, out)| *out = self.tangents.output(element, j));
            }
        }
        let behind = self.crossed.take().filter(|at| *at <= from).unwrap_or(from);
        self.record.push(behind, (from, to), &samples);
        self.samples = samples;
        Ok(())
    }

    /// Notes that those delayed expressions that jump at a time do so at one that moves like this.
    pub(crate) fn note_jumps(&mut self, past: &Past, time: f64, moving: &[f64]) {
        let still = |j: usize| moving.get(j).copied().unwrap_or(0.0);
        let width = self.width();
        for element in (0..past.jumped.len()).filter(|&element| past.jumped[element]) {
            match self.motions.iter_mut().find(|(at, of, _)| *of == element && are_near(*at, time)) {
                Some((_, _, along)) => along.iter_mut().enumerate().for_each(|(j, along)| *along = together(*along, still(j))),
                None => self.motions.push((time, element, (0..width).map(still).collect())),
            }
        }
    }

    /// Derivatives of the time at which delayed values jump in a span of time. `tangents` hold
    /// those of the dead times as outputs. NaN where they differ.
    pub(crate) fn motion_of_breaks(&self, past: &Past, span: (f64, f64), motion: &mut Motion<'_>) {
        for (source, lag) in past.kept.marks.jumps_in(span) {
            for element in past.elements_with(lag) {
                let of_source = self.motions.iter().find(|(at, of, _)| *of == element && are_near(*at, source));
                if let Some((_, _, along)) = of_source {
                    motion.add(|j| along[j] + self.tangents.output(element, j));
                }
            }
        }
    }

    /// Finds the derivatives of the dead times at a point, as outputs.
    ///
    /// # Errors
    /// In words, if they cannot be differentiated.
    pub(crate) fn find_lags(&mut self, system: &CompiledSystem, point: Point<'_>) -> Result<(), String> {
        self.tangents.run(system, TangentProgram::Lags, point, self.values.len() / self.width().max(1))
    }

    /// Forgets what no dead time reaches from a time on.
    pub(crate) fn trim(&mut self, past: &Past, time: f64) {
        let reach = time - past.longest * (1.0 + super::SLACK);
        self.record.trim(reach);
        self.motions.retain(|(at, ..)| *at >= reach);
    }
}

/// Derivatives of the time of several breaks along each direction; not a number where they differ.
pub(crate) struct Motion<'a> {
    along: &'a mut Vec<f64>,
    /// No break was added so far.
    pub(crate) first: bool,
}

impl<'a> Motion<'a> {
    /// Of no break so far.
    pub(crate) fn new(along: &'a mut Vec<f64>, width: usize) -> Self {
        along.clear();
        along.resize(width, 0.0);
        Self { along, first: true }
    }

    /// Adds a break.
    pub(crate) fn add(&mut self, of: impl Fn(usize) -> f64) {
        let first = std::mem::replace(&mut self.first, false);
        self.along.iter_mut().enumerate().for_each(|(j, along)| *along = if first { of(j) } else { together(*along, of(j)) });
    }
}

/// The derivative that two have in common; not a number where they differ.
fn together(a: f64, b: f64) -> f64 {
    if (a - b).abs() <= TOGETHER * a.abs().max(b.abs()) { a } else { f64::NAN }
}
