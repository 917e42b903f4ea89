//! Start of derivatives: at a reset, and at the start of a step.

use std::ops::Range;
use std::sync::Arc;

use smpl_compiler::compiled::tangent::TangentProgram;
use smpl_compiler::ir::{DELAY_SLOTS, DelaySlot};
use smpl_compiler::layout::Region;

use super::{Direction, Environment, FollowError, Follower, ResetOptions};
use crate::catalogue::{Element, Family};
use crate::setup::Setup;

/// Most repetitions until derivatives that read each other at the start agree, and the part of one
/// to which they do.
const MOST_ROUNDS: u32 = 200;
const SETTLED: f64 = 4.0 * f64::EPSILON;

impl Follower {
    /// Takes directions, with a magnitude of what each is taken by, so that derivatives are of the
    /// size of the unknowns.
    pub(super) fn choose(&mut self, setup: &Setup, parameters: &[f64], directions: &[Direction]) {
        let magnitude = |x: f64| if x.is_finite() && x > 0.0 { x } else { 1.0 };
        let element = |family: &Family, at: usize, value: fn(&Element) -> f64| {
            magnitude(family.elements().iter().find(|e| e.at == at).map_or(1.0, value))
        };
        let catalogue = &setup.catalogue;
        let scale = |direction: &Direction| match *direction {
            Direction::State(at) => element(&catalogue.states, at, |e| e.scale),
            Direction::Action(at) | Direction::ActionIn(_, at) => element(&catalogue.actions, at, Element::range),
            Direction::Parameter(at) => magnitude(parameters[at].abs()),
            Direction::Discrete(at) => element(&catalogue.discretes, at, |e| e.scale),
            Direction::Disturbance(at) => element(&catalogue.disturbances, at, |e| e.scale),
        };
        let width = self.width();
        self.directions.clear();
        self.directions.extend(directions.iter().take(width));
        self.scales.clear();
        self.scales.extend(self.directions.iter().map(scale));
        self.scales.resize(width, 1.0);
    }

    /// Place and magnitude of a direction, if it is of a kind.
    fn of(&self, number: usize, place: impl Fn(Direction) -> Option<usize>) -> Option<(usize, f64)> {
        Some((place(self.directions[number])?, self.scales[number]))
    }

    /// Along a direction of a kind, what it is taken by moves by its magnitude. Along other
    /// directions it moves as before: additional directions do not change the others.
    fn seed(&mut self, region: &Range<usize>, place: impl Fn(Direction) -> Option<usize>) {
        for direction in 0..self.directions.len() {
            if let Some((at, scale)) = self.of(direction, &place) {
                self.tangents.set_work(region.start + at, direction, scale);
            }
        }
    }
}

impl Environment {
    /// Derivatives at the reset.
    pub(super) fn begin_following(&mut self, follower: &mut Follower, options: &ResetOptions) -> Result<(), FollowError> {
        let setup = Arc::clone(&self.setup);
        follower.tangents.clear();
        follower.moving.clear();
        follower.past.iter_mut().for_each(|past| past.clear());
        self.follow_parameters(follower)?;
        for direction in 0..follower.directions.len() {
            if let Some((at, scale)) = follower.of(direction, |d| if let Direction::State(at) = d { Some(at) } else { None }) {
                follower.tangents.set_y(at, direction, scale);
            }
        }
        let time = self.time();
        let discretes = self.system.memory().layout().range(Region::Discrete);
        for _ in 0..=setup.programs.start_passes {
            self.run_tangent(follower, TangentProgram::InitialDiscretes, (time, &[]), 0)?;
            let given = options.discrete.keys().chain(setup.options.initial.keys());
            for element in given.filter_map(|name| setup.catalogue.discretes.find(name)) {
                follower.tangents.hold(discretes.start + element.at..discretes.start + element.at + 1);
            }
            follower.seed(&discretes, |d| if let Direction::Discrete(at) = d { Some(at) } else { None });
            self.follow_start(follower, time)?;
        }
        follower.tangents.keep(&self.system, Region::Initial);
        follower.tangents.keep(&self.system, Region::Previous);
        let Some(past) = &mut follower.past else { return Ok(()) };
        let point = (self.progress.y.as_slice(), self.progress.yp.as_slice());
        past.start(&mut self.system, &follower.tangents, point).map_err(FollowError::Refused)
    }

    /// Derivatives of algebraic unknowns at the start, and of delayed values, which are those
    /// before it: repeatedly, as they read each other.
    fn follow_start(&mut self, follower: &mut Follower, time: f64) -> Result<(), FollowError> {
        let elements = self.system.model().model().delayed();
        let cells = self.system.memory().layout().range(Region::Delayed);
        follower.tangents.hold(cells.clone());
        for _ in 0..MOST_ROUNDS {
            self.follow_algebraic(follower, time, &[])?;
            if elements == 0 {
                return Ok(());
            }
            let (mut settled, mut given) = (true, false);
            for element in 0..elements {
                // A given past is run by itself, at its own time.
                let before = self.system.past_mut().and_then(|past| past.before_start(element, time));
                let (part, at) = before.map_or((TangentProgram::Delayed, time), |at| (TangentProgram::Before, at));
                if before.is_some() || element == 0 || given {
                    self.run_tangent(follower, part, (at, &[]), elements)?;
                }
                given = before.is_some();
                let cell = cells.start + element * DELAY_SLOTS as usize + DelaySlot::Value as usize;
                for j in 0..follower.width() {
                    let (value, known) = (follower.tangents.output(element, j), follower.tangents.work(cell, j));
                    settled &= (value - known).abs() <= SETTLED * value.abs();
                    follower.tangents.set_work(cell, j, value);
                }
            }
            if settled {
                return Ok(());
            }
        }
        Err(FollowError::Refused("the derivatives of delayed values before the start depend on themselves".into()))
    }

    /// Parameters, and those that are computed from them.
    fn follow_parameters(&mut self, follower: &mut Follower) -> Result<(), FollowError> {
        let parameter = |d| if let Direction::Parameter(at) = d { Some(at) } else { None };
        if !follower.directions.iter().any(|&d| parameter(d).is_some()) {
            return Ok(());
        }
        let elements = self.setup.catalogue.parameters.elements();
        if let Some(element) = elements.iter().find(|e| e.structural && follower.directions.contains(&Direction::Parameter(e.at))) {
            let text = format!("the parameter `{}` shapes the model when it is compiled", element.name);
            return Err(FollowError::Refused(text));
        }
        let range = self.system.memory().layout().range(Region::Param);
        follower.seed(&range, parameter);
        self.run_tangent(follower, TangentProgram::Parameters, (0.0, &[]), 0)?;
        // By a parameter that is computed from others derivatives are taken as if it were given,
        // but only by that one. Each run writes all columns: what is found is put in when the last
        // has run.
        follower.space.columns.clear();
        for direction in 0..follower.directions.len() {
            let Some((at, scale)) = follower.of(direction, parameter) else { continue };
            if follower.tangents.work(range.start + at, direction) == scale {
                continue;
            }
            let given = std::mem::replace(&mut self.system.region_mut(Region::ParamGiven)[at], 1.0);
            range.clone().for_each(|cell| follower.tangents.set_work(cell, direction, 0.0));
            follower.tangents.set_work(range.start + at, direction, scale);
            let ran = self.run_tangent(follower, TangentProgram::Parameters, (0.0, &[]), 0);
            self.system.region_mut(Region::ParamGiven)[at] = given;
            ran?;
            let Follower { tangents, space, .. } = &mut *follower;
            space.columns.extend(range.clone().map(|cell| (cell, direction, tangents.work(cell, direction))));
        }
        let Follower { tangents, space, .. } = follower;
        space.columns.iter().for_each(|&(cell, direction, value)| tangents.set_work(cell, direction, value));
        if self.setup.steady.by_step {
            follower.steady.follow(&self.system, &self.setup.catalogue, &mut follower.tangents).map_err(FollowError::Refused)?;
        }
        Ok(())
    }

    /// Values and derivatives of the inputs of the step, in the order of a step.
    pub(super) fn follow_inputs(&mut self, follower: &mut Follower, action: &[f64]) -> Result<(), FollowError> {
        follower.tangents.keep(&self.system, Region::Previous);
        self.apply(action);
        let layout = self.system.memory().layout();
        let (actions, disturbances) = (layout.range(Region::Action), layout.range(Region::Disturbance));
        follower.tangents.hold(actions.clone());
        let step = follower.step;
        follower.seed(&actions, |d| match d {
            Direction::Action(at) if step == 0 => Some(at),
            Direction::ActionIn(of, at) if step == of => Some(at),
            _ => None,
        });
        self.draw_disturbances();
        let begin = self.begin;
        if self.setup.programs.has_disturbances {
            self.run_tangent(follower, TangentProgram::Disturb, (begin, &[]), 0)?;
            let (model, memory) = self.system.parts();
            model.disturb(memory, begin);
        }
        self.replay_disturbances();
        for replay in &self.replay {
            follower.tangents.hold(disturbances.start + replay.at..disturbances.start + replay.at + 1);
        }
        follower.seed(&disturbances, |d| if let Direction::Disturbance(at) = d { Some(at) } else { None });
        if self.setup.programs.has_start {
            self.run_tangent(follower, TangentProgram::Start, (begin, &[]), 0)?;
            let (model, memory) = self.system.parts();
            model.start(memory, begin, &mut self.progress.y);
        }
        let (model, memory) = self.system.parts();
        model.prepare_step(memory);
        if self.setup.corrections.set_at_start {
            self.follow_projection(follower, begin, &[])?;
        }
        Ok(())
    }
}
