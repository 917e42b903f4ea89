//! A control step with its derivatives along directions: of states, actions, parameters, discrete
//! variables and disturbances.
//!
//! The derivatives follow the order of a step: the start of an episode, updates at the start,
//! equations ([`Augmented`]), events by their jump conditions, updates at the end, rewards,
//! observations. A condition g = 0 has a time that moves by τ = −(dg along the direction) /
//! (dg/dt). With rates f⁻ before and f⁺ after, S⁺ = D(S⁻ + f⁻ τ) − f⁺ τ, D the derivative of the
//! event (M. A. Aizerman and F. R. Gantmacher, *Q. J. Mech. Appl. Math.* 11 (1958) 243).

mod events;
mod space;
mod start;

use std::sync::Arc;

use smpl_compiler::compiled::tangent::TangentProgram;
use smpl_compiler::layout::Region;

use super::{Environment, ResetOptions, StepResult, finish, interval};
use crate::failure::describe_solver;
use crate::past::moved::MovedPast;
use crate::sensitivity::augmented::{Augmented, Input};
use crate::sensitivity::tangents::{Point, Tangents};
use crate::setup::{Setup, SetupError};
use crate::solver::linear::Factorisation;
use crate::solver::{Integrator, Method, OneStep, Settings, SolveError, Staggered, Statistics, System};
use crate::steady::Motion;
use crate::system::CompiledSystem;
use space::Space;

/// Unknowns up to which the explicit method is tried first, and its steps: more of them cost more
/// than those of IDA (PenSim's 33 unknowns take it a quarter more).
const SMALL: usize = 16;
const FEW: u32 = 64;

/// Numbers of directions, in addition to the present one, for which space is kept.
const SPARE: usize = 3;

/// Tolerances of derivatives, as a multiple of those of the unknowns: as many as this, but up to
/// this relative tolerance at most.
const MOST_LOOSE: f64 = 100.0;
const LOOSE_ENOUGH: f64 = 1e-6;

/// Variable of a derivative: a place of its family in internal order (`Element::at`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// A state at the start.
    State(usize),
    /// An action, in the first step.
    Action(usize),
    /// An action in one of several steps, which is counted from 0 and comes first.
    ActionIn(usize, usize),
    /// A parameter.
    Parameter(usize),
    /// A discrete variable at the start.
    Discrete(usize),
    /// A disturbance during the step.
    Disturbance(usize),
}

/// Reason why there are no derivatives.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FollowError {
    /// The step does not come to its end.
    #[error("{0}")]
    Failed(String),
    /// The step has no derivative, or none that is known.
    #[error("the step has no derivative that can be computed: {0}")]
    Refused(String),
    /// Somebody wanted it to stop.
    #[error("the step was interrupted")]
    Interrupted,
}

/// Derivatives of an instance along a fixed number of directions.
pub struct Follower {
    engine: Engine,
    /// Directions that are integrated: the others move nothing in the equations.
    live: Vec<usize>,
    /// Inputs that move, and which directions something moves in the equations.
    moving_inputs: Vec<Input>,
    moved: Vec<bool>,
    /// Integrators for other numbers of directions, and their construction.
    spare: Vec<Engine>,
    settings: Settings,
    tangents: Tangents,
    /// Derivatives by time.
    along: Tangents,
    /// Derivatives of the steady state by parameters.
    steady: Motion,
    /// Directions in force, and what each derivative is multiplied with: a magnitude of what it is
    /// taken by.
    directions: Vec<Direction>,
    scales: Vec<f64>,
    /// Derivatives of the integrals.
    integrals: Vec<f64>,
    /// Derivatives of the present start of the integration; empty if they are zero.
    moving: Vec<f64>,
    /// The integration has stopped at a threshold and waits for what the motion says.
    pending: bool,
    /// Derivatives of the past, but while they are integrated.
    past: Option<Box<MovedPast>>,
    /// Number of the step, from 0.
    step: usize,
    /// For rates and algebraic unknowns.
    rates: Factorisation,
    entries: [Vec<f64>; 2],
    space: Space,
}

/// Integrator for a number of directions.
struct Engine {
    augmented: Augmented,
    integrator: Box<dyn Integrator>,
    /// Unknowns with derivatives along the directions, and rates of both.
    y: Vec<f64>,
    yp: Vec<f64>,
}

impl Engine {
    fn new(system: &CompiledSystem, width: usize, of_model: &Settings) -> Result<Self, SolveError> {
        let mut augmented = Augmented::new(system, width);
        let settings = settings(of_model, width);
        let integrator: Box<dyn Integrator> = match settings.method {
            Method::Ida => Box::new(Staggered::new(&mut augmented, settings)?),
            _ => Box::new(OneStep::new(&augmented, settings)?),
        };
        let numbers = || vec![0.0; system.dimension() * (1 + width)];
        Ok(Self { integrator, augmented, y: numbers(), yp: numbers() })
    }
}

impl Follower {
    /// Of instances of a setup, along so many directions at once.
    ///
    /// # Errors
    /// What the solver says of the equations.
    pub fn new(setup: &Arc<Setup>, width: usize) -> Result<Self, SetupError> {
        let method = if setup.settings.method == Method::Explicit { Method::Explicit } else { Method::Ida };
        Self::with_settings(setup, width, Settings { method, ..setup.settings.clone() })
    }

    /// The same by the explicit method, for models that it takes, in few steps: it gives up where
    /// equations are stiff. `None` for others, and where it would be the method anyway.
    ///
    /// # Errors
    /// As for [`Follower::new`].
    pub fn quick(setup: &Arc<Setup>, width: usize) -> Result<Option<Self>, SetupError> {
        let model = setup.model();
        let serves = model.explicit() && model.unknowns() == model.states() && model.unknowns() <= SMALL;
        if !serves || setup.settings.method == Method::Explicit {
            return Ok(None);
        }
        let max_steps = FEW.min(setup.settings.max_steps);
        Self::with_settings(setup, width, Settings { method: Method::Explicit, max_steps, ..setup.settings.clone() }).map(Some)
    }

    fn with_settings(setup: &Arc<Setup>, width: usize, settings: Settings) -> Result<Self, SetupError> {
        let system = &setup.system;
        let entries = system.pattern().entries();
        let numbers = |length| vec![0.0; length];
        Ok(Self {
            engine: Engine::new(system, width, &settings)?,
            live: (0..width).collect(),
            moving_inputs: Vec::new(),
            moved: vec![false; width],
            spare: Vec::new(),
            settings,
            tangents: Tangents::new(system, width),
            along: Tangents::new(system, 1),
            steady: Motion::default(),
            directions: Vec::new(),
            scales: Vec::new(),
            integrals: numbers(system.quadrature_count() * width),
            moving: Vec::new(),
            pending: false,
            past: MovedPast::new(system, width),
            step: 0,
            rates: Factorisation::new(system.pattern(), setup.settings.linear_solver)?,
            entries: [numbers(entries), numbers(entries)],
            space: Space::default(),
        })
    }

    /// Integrates the directions that are moved from now on, with space for them that is made once.
    fn integrate_moved(&mut self) -> Result<(), SolveError> {
        self.live.clear();
        self.live.extend(self.moved.iter().enumerate().filter(|&(_, &moved)| moved).map(|(j, _)| j));
        let count = self.live.len();
        if count != self.engine.augmented.directions() {
            let place = self.spare.iter().position(|engine| engine.augmented.directions() == count);
            let mut other = match place {
                Some(place) => self.spare.remove(place),
                None => Engine::new(&self.engine.augmented.system, count, &self.settings)?,
            };
            other.integrator.forget();
            other.integrator.edges_mut().copy_from_slice(self.engine.integrator.edges());
            std::mem::swap(&mut self.engine, &mut other);
            self.spare.truncate(SPARE - 1);
            self.spare.insert(0, other);
        }
        Ok(())
    }

    /// Number of directions.
    #[must_use]
    pub fn width(&self) -> usize {
        self.tangents.width()
    }

    /// Derivative of an unknown along a direction, after a step.
    #[must_use]
    pub fn derivative(&self, unknown: usize, direction: usize) -> f64 {
        self.tangents.y(unknown, direction) / self.scales[direction]
    }

    /// Work of its integrator in the last step.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        self.engine.integrator.statistics()
    }

    /// Derivative of an output of the `finish` program along a direction, after a step.
    fn finished(&self, at: usize, direction: usize) -> f64 {
        self.tangents.output(at, direction) / self.scales[direction]
    }
}

/// Tolerances of unknowns, and for their derivatives, which are in their units, looser ones.
fn settings(of_model: &Settings, width: usize) -> Settings {
    let each = of_model.atol.iter().flat_map(|&atol| std::iter::repeat_n(atol, width));
    let looseness = (LOOSE_ENOUGH / of_model.rtol).clamp(1.0, MOST_LOOSE);
    Settings { atol: of_model.atol.iter().copied().chain(each).collect(), looseness, ..of_model.clone() }
}

impl Environment {
    /// Begins an episode as [`reset`](Environment::reset) did with the same options and takes one
    /// step, with derivatives along `directions` (at most as many as the follower has). The
    /// follower then knows the derivatives of the unknowns, [`Environment::reward_derivative`] and
    /// its like those of rewards and observations.
    ///
    /// # Errors
    /// A step that does not come to its end, or that has no derivative.
    pub fn follow(
        &mut self,
        follower: &mut Follower,
        directions: &[Direction],
        options: &ResetOptions,
        action: &[f64],
    ) -> Result<StepResult, FollowError> {
        follower.choose(&self.setup, self.system.region(Region::Param), directions);
        follower.step = 0;
        self.follow_step(follower, action, Some(options))
    }

    /// Takes another step behind one that was [followed](Environment::follow), with derivatives
    /// along the same directions.
    ///
    /// # Errors
    /// A step that does not come to its end, or that has no derivative.
    pub fn follow_on(&mut self, follower: &mut Follower, action: &[f64]) -> Result<StepResult, FollowError> {
        follower.step += 1;
        self.follow_step(follower, action, None)
    }

    fn follow_step(&mut self, follower: &mut Follower, action: &[f64], begins: Option<&ResetOptions>) -> Result<StepResult, FollowError> {
        self.check(action).map_err(|e| FollowError::Failed(e.to_string()))?;
        if let Some(at) = action.iter().position(|a| !a.is_finite()) {
            let name = &self.setup.catalogue.actions.elements()[at].name;
            return Err(FollowError::Failed(format!("action `{name}` is not finite")));
        }
        let excess = self.action_excess(action);
        self.progress.chatter = None;
        let begun = begins.map_or(Ok(()), |options| self.begin_following(follower, options));
        let done = begun.and_then(|()| self.follow_interval(follower, action));
        if done.is_err() {
            self.abandon();
        }
        done?;
        // When it is judged the step already counts, so that this would be the end of the next one.
        let end = self.end_time();
        let result = self.judge(interval::IntervalEnd::Completed, excess);
        self.follow_finish(follower, end)?;
        Ok(result)
    }

    fn follow_interval(&mut self, follower: &mut Follower, action: &[f64]) -> Result<(), FollowError> {
        self.follow_inputs(follower, action)?;
        if self.broken_variable().is_some() {
            return Err(FollowError::Failed("an update at the start of the step makes something that is not finite".into()));
        }
        self.follow_integration(follower)?;
        let quadratures = self.system.memory().layout().range(Region::Quadrature);
        self.system.region_mut(Region::Quadrature).copy_from_slice(&self.integrals);
        let width = follower.width();
        for (at, row) in follower.integrals.chunks_exact(width).enumerate() {
            row.iter().enumerate().for_each(|(j, &value)| follower.tangents.set_work(quadratures.start + at, j, value));
        }
        if self.setup.programs.has_end {
            let time = self.end_time();
            follower.space.before.clone_from(&self.progress.y);
            self.run_tangent(follower, TangentProgram::End, (time, &[]), 0)?;
            self.run_end();
            if follower.space.before != self.progress.y && self.system.model().unknowns() > self.system.model().states() {
                self.follow_algebraic(follower, time, &[])?;
            }
        }
        Ok(())
    }

    /// Runs a part with derivatives at the present state.
    fn run_tangent(
        &mut self,
        follower: &mut Follower,
        part: TangentProgram,
        (time, moving): (f64, &[f64]),
        outputs: usize,
    ) -> Result<(), FollowError> {
        self.follow_past(follower, time);
        let point = Point { time, moving, y: &self.progress.y, yp: &self.progress.yp };
        follower.tangents.run(&self.system, part, point, outputs).map_err(FollowError::Refused)
    }

    /// Fills the delayed values at the present state, with their derivatives.
    fn follow_past(&mut self, follower: &mut Follower, time: f64) {
        let Some(moved) = follower.past.as_mut().filter(|past| past.has_begun()) else { return };
        self.system.look_back(time, &self.progress.y, &self.progress.yp);
        if let Some(past) = self.system.past_mut() {
            moved.look_up(past, time);
        }
        MovedPast::write(&moved.values, &self.system, &mut follower.tangents);
    }

    /// Derivatives of algebraic unknowns from those of states and inputs.
    fn follow_algebraic(&mut self, follower: &mut Follower, time: f64, moving: &[f64]) -> Result<(), FollowError> {
        if self.system.model().unknowns() == self.system.model().states() { Ok(()) } else { self.follow_rates(follower, time, moving) }
    }

    /// Derivatives of states that move by their corrections, which are known at the present state.
    pub(super) fn follow_moved(&mut self, follower: &mut Follower, time: f64, moving: &[f64]) -> Result<(), FollowError> {
        self.follow_algebraic(follower, time, moving)?;
        for pair in &self.setup.corrections.pairs {
            for j in 0..follower.width() {
                let moved = follower.tangents.y(pair.state, j) + follower.tangents.y(pair.by, j);
                follower.tangents.set_y(pair.state, j, moved);
            }
        }
        Ok(())
    }

    /// Derivatives of rates and algebraic unknowns from those of states and inputs: 0 = F_x S_x +
    /// F_w W + F_t τ + F_z S_z + F_x' S_x'.
    fn follow_rates(&mut self, follower: &mut Follower, time: f64, moving: &[f64]) -> Result<(), FollowError> {
        let (n, states) = (self.system.model().unknowns(), self.system.model().states());
        let width = follower.width();
        for j in 0..width {
            (states..n).for_each(|at| follower.tangents.set_y(at, j, 0.0));
        }
        follower.tangents.still_rates();
        self.run_tangent(follower, TangentProgram::Rows, (time, moving), n)?;
        let [values, mass] = &mut follower.entries;
        let (y, yp) = (&self.progress.y, &self.progress.yp);
        self.system.jacobian(time, y, yp, 0.0, values);
        self.system.jacobian(time, y, yp, 1.0, mass);
        for column in 0..states {
            for entry in self.system.pattern().column(column) {
                values[entry] = mass[entry] - values[entry];
            }
        }
        let refused = |_| FollowError::Refused("the algebraic equations are singular".into());
        follower.rates.factorise(values).map_err(refused)?;
        let Follower { rates, tangents, space: Space { column, .. }, .. } = follower;
        for j in 0..width {
            column.clear();
            column.extend((0..n).map(|at| -tangents.output(at, j)));
            rates.solve(column);
            (states..n).for_each(|at| tangents.set_y(at, j, column[at]));
            (0..states).for_each(|at| tangents.set_yp(at, j, column[at]));
        }
        Ok(())
    }

    /// Derivatives of rewards and observations at the end of the step.
    fn follow_finish(&mut self, follower: &mut Follower, time: f64) -> Result<(), FollowError> {
        if self.setup.programs.derivatives_at_end {
            self.follow_rates(follower, time, &[])?;
            let (n, states, width) = (self.system.model().unknowns(), self.system.model().states(), follower.live.len());
            // Rates of algebraic unknowns are those of the integrator's polynomial, as their values
            // are.
            for at in states..n {
                (0..follower.width()).for_each(|j| follower.tangents.set_yp(at, j, 0.0));
                for (place, &j) in follower.live.iter().enumerate() {
                    follower.tangents.set_yp(at, j, follower.engine.yp[n + at * width + place]);
                }
            }
        }
        let outputs = self.finish.all().len();
        self.run_tangent(follower, TangentProgram::Finish, (time, &[]), outputs)
    }

    /// Derivative of a reward (as declared) along a direction, after a step that was followed. A
    /// failing step's reward is that of the error, which nothing moves.
    #[must_use]
    pub fn reward_derivative(&self, follower: &Follower, reward: usize, direction: usize) -> f64 {
        if self.progress.verdict.last.is_none_or(|result| result.failure.is_some()) {
            return 0.0;
        }
        follower.finished(self.finish.start(finish::FinishPart::Rewards) + reward, direction)
    }

    /// Derivative of an observation along a direction: of what is measured at the end of the step,
    /// without noise, delay or clipping.
    #[must_use]
    pub(crate) fn observation_derivative(&self, follower: &Follower, observation: usize, direction: usize) -> f64 {
        follower.finished(self.finish.start(finish::FinishPart::Observations) + observation, direction)
    }

    /// Measurements at the end of the last step, without noise, delay or clipping.
    #[must_use]
    pub(crate) fn measured(&self) -> &[f64] {
        self.finish.part(finish::FinishPart::Observations)
    }

    fn solver_fault(&self, error: &SolveError, start: f64, width: usize) -> FollowError {
        if matches!(error, SolveError::Interrupted { .. }) {
            return FollowError::Interrupted;
        }
        let failure = interval::blame(error, start);
        let n = self.system.model().unknowns();
        // Derivatives are named by the unknown that they belong to.
        let unknown = failure.unknown.map(|at| if at < n { at } else { (at - n) / width.max(1) });
        let setup = &self.setup;
        let text = describe_solver(&crate::failure::SolverFailure { unknown, ..failure }, setup.model(), &setup.catalogue, setup.sources());
        FollowError::Failed(format!("{}: {text}", crate::failure::SOLVER))
    }
}
