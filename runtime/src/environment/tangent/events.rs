//! The integration of derivatives from event to event, and what happens to them there.

use smpl_compiler::compiled::tangent::TangentProgram;
use smpl_compiler::ir::Builtin;
use smpl_compiler::layout::Region;
use smpl_compiler::model::RootAction;

use super::space::{BEFORE, BEHIND, Space};
use super::{Direction, Engine, Environment, FollowError, Follower};
use crate::past::moved::Motion;
use crate::past::name_of;
use crate::sensitivity::augmented::Augmented;
use crate::sensitivity::tangents::Point;
use crate::solver::{Advance, System};

/// Two times this near each other, in parts of the larger one, are one; both sides of a break are
/// so many roundings from it: as in `solver::traverse`.
const NEAR: f64 = 2e-12;
const ROUNDINGS: f64 = 8.0;

/// Distance from a switch of the equations at which they have one form, over the interval.
const ASIDE: f64 = 1e-9;

/// Relative difference of the motion of two events that are one.
const TOGETHER: f64 = 1e-6;

/// Extent of a piece of the integration.
struct Stop {
    time: f64,
    /// A break at its end, which moves as the space of the follower shows, and a time behind it.
    break_: Option<(f64, f64)>,
}

/// Beginning of a piece of the integration.
#[derive(Clone, Copy, PartialEq)]
enum Beginning {
    /// That of the step.
    Step,
    /// An event.
    Event,
    /// A break at this time.
    Break(f64),
}

impl Environment {
    /// Integrates to the end of the interval.
    pub(super) fn follow_integration(&mut self, follower: &mut Follower) -> Result<(), FollowError> {
        self.collect_statistics();
        self.integrator.forget();
        follower.engine.integrator.forget();
        self.integrals.fill(0.0);
        follower.integrals.fill(0.0);
        follower.moving.clear();
        follower.pending = false;
        self.system.trim_past(self.begin);
        if let (Some(moved), Some(past)) = (&mut follower.past, self.system.past_mut()) {
            moved.trim(past, self.begin);
        }
        let (end, mut t, mut pieces) = (self.end_time(), self.begin, 0);
        let mut beginning = Beginning::Step;
        loop {
            self.choose_live(follower, pieces == 0)?;
            self.write_followed(follower);
            if pieces == 0 {
                // Switches are taken as they are.
                let edges = follower.engine.integrator.edges_mut();
                edges[..self.progress.edges.len()].copy_from_slice(&self.progress.edges);
            }
            pieces += 1;
            if pieces > self.setup.max_events.saturating_add(self.setup.settings.max_steps) {
                return Err(FollowError::Failed(format!("events without end at t = {t}")));
            }
            let Follower { engine: Engine { augmented, .. }, tangents, live, moving_inputs, past, .. } = &mut *follower;
            augmented.past = past.take();
            augmented.system.exchange_past(&mut self.system);
            let taken = augmented.set_inputs(&self.system, tangents, moving_inputs, live).map_err(FollowError::Refused);
            let advanced = taken.and_then(|()| self.advance_piece(follower, (t, end, pieces), beginning));
            let augmented = &mut follower.engine.augmented;
            augmented.system.exchange_past(&mut self.system);
            follower.past = augmented.past.take();
            let (advance, stop) = advanced?;
            self.take_followed(follower);
            if advance == Advance::Event {
                let found = follower.engine.integrator.time();
                let found = if end - found <= 8.0 * f64::EPSILON * (found.abs() + end.abs()) { end } else { found };
                self.pass_event(follower, (t, found, end))?;
                (t, beginning) = (found, Beginning::Event);
                continue;
            }
            let Some((at, behind)) = stop.break_ else { break };
            self.pass_break(follower, (at, behind))?;
            (t, beginning) = (behind, Beginning::Break(at));
        }
        let edges = follower.engine.integrator.edges();
        let count = self.progress.edges.len();
        self.progress.edges.copy_from_slice(&edges[..count]);
        Ok(())
    }

    /// Integrates from the beginning of a piece to its end.
    fn advance_piece(
        &mut self,
        follower: &mut Follower,
        (t, end, pieces): (f64, f64, u32),
        beginning: Beginning,
    ) -> Result<(Advance, Stop), FollowError> {
        self.restart_following(follower, t, beginning)?;
        let stop = self.next_stop(follower, t, end, pieces)?;
        let engine = &mut follower.engine;
        // What is left may be less than an integrator takes.
        let least = 4.0 * f64::EPSILON * (t.abs() + stop.time.abs());
        if stop.time - t <= least && (stop.time != t || stop.break_.is_some()) {
            return Ok((Advance::Reached, stop));
        }
        match engine.integrator.advance(&mut engine.augmented, stop.time) {
            Ok(advance) => Ok((advance, stop)),
            Err(error) => Err(self.solver_fault(&error, t, follower.live.len())),
        }
    }

    /// Leaves directions out that move nothing in the equations; those that are integrated already
    /// stay, but at the beginning of a step.
    fn choose_live(&mut self, follower: &mut Follower, begins: bool) -> Result<(), FollowError> {
        let Follower { tangents, moving_inputs, moved, live, past, .. } = &mut *follower;
        if let Some(past) = past {
            past.wake(tangents);
            past.write_awake(&self.system, tangents);
        }
        self.system.model().find_inputs(|cells| tangents.is_active(cells), moving_inputs);
        Augmented::find_moved(&self.system, tangents, moving_inputs, moved).map_err(FollowError::Refused)?;
        if !begins {
            live.iter().for_each(|&j| moved[j] = true);
        }
        if !moved.contains(&true) {
            // One at least, for which there is something to integrate.
            moved.iter_mut().take(1).for_each(|first| *first = true);
        }
        let made = follower.integrate_moved();
        made.map_err(|e| self.solver_fault(&e, self.begin, follower.width()))
    }

    /// The end, or the next break before it.
    fn next_stop(&mut self, follower: &mut Follower, t: f64, end: f64, pieces: u32) -> Result<Stop, FollowError> {
        let near = NEAR * t.abs().max(end.abs());
        let own = self.system.next_break_of_equations(t);
        let past = follower.engine.augmented.system.past_mut();
        let of_past = past.map_or((f64::INFINITY, f64::INFINITY), |past| past.next_breaks());
        let at = own.min(of_past.0);
        if at.is_nan() || at > end + near || t >= end {
            return Ok(Stop { time: end, break_: None });
        }
        let width = ROUNDINGS * f64::EPSILON * at.abs().max(end.abs());
        let left_behind = at - width <= t + near;
        if !left_behind && at - width >= end {
            return Ok(Stop { time: end, break_: None });
        }
        let [own, of_past] = [(own, own), of_past].map(|span| Some(span).filter(|(first, _)| *first <= at + near));
        let last = own.iter().chain(&of_past).fold(at, |last, span| last.max(span.1));
        self.find_motion_of_breaks(follower, t, own.map(|own| (own.0, width)), of_past)?;
        // A break that is not left behind by roundings is by a few more of them.
        let width = if left_behind { width * f64::from(1 + pieces.min(1000)) } else { width };
        let behind = (last.max(t) + width).min(end);
        Ok(Stop { time: if left_behind { t } else { (at - width).min(end) }, break_: Some((at, behind)) })
    }

    /// Derivatives of the time of the next breaks: of the equations about a time, and of delayed
    /// values that jump in a span of time.
    fn find_motion_of_breaks(
        &mut self,
        follower: &mut Follower,
        t: f64,
        own: Option<(f64, f64)>,
        of_past: Option<(f64, f64)>,
    ) -> Result<(), FollowError> {
        let mut along = std::mem::take(&mut follower.space.next_break);
        let mut motion = Motion::new(&mut along, follower.width());
        let augmented = &mut follower.engine.augmented;
        if let (Some(span), Some(moved)) = (of_past, &mut augmented.past) {
            let point = Point { time: t, moving: &[], y: &self.progress.y, yp: &self.progress.yp };
            moved.find_lags(&augmented.system, point).map_err(FollowError::Refused)?;
            if let Some(past) = augmented.system.past_mut() {
                moved.motion_of_breaks(past, span, &mut motion);
            }
        }
        if let Some((at, reach)) = own {
            let breaks = self.system.model().breaks();
            self.run_tangent(follower, TangentProgram::Breaks, (t, &[]), breaks)?;
            let tangents = &follower.tangents;
            let here = (0..breaks).filter(|&k| (tangents.value(k) - at).abs() <= reach);
            here.for_each(|k| motion.add(|j| tangents.output(k, j)));
        }
        follower.space.jumps = !motion.first;
        follower.space.next_break = along;
        Ok(())
    }

    fn restart_following(&mut self, follower: &mut Follower, t: f64, beginning: Beginning) -> Result<(), FollowError> {
        let (n, width) = (self.progress.y.len(), follower.live.len());
        follower.engine.y[..n].copy_from_slice(&self.progress.y);
        follower.engine.yp[..n].copy_from_slice(&self.progress.yp);
        let Engine { integrator, augmented, y, yp } = &mut follower.engine;
        if let Beginning::Break(at) = beginning {
            augmented.crosses(at);
        }
        integrator.restart(augmented, t, y, Some(yp)).map_err(|e| self.solver_fault(&e, t, width))?;
        self.note_jumps(follower, t, beginning)
    }

    /// Notes where delayed expressions jump, and where their derivatives may.
    fn note_jumps(&mut self, follower: &mut Follower, t: f64, beginning: Beginning) -> Result<(), FollowError> {
        let Follower { engine: Engine { augmented, .. }, moving, directions, step, space, .. } = follower;
        let (Some(moved), Some(past)) = (&mut augmented.past, augmented.system.past_mut()) else { return Ok(()) };
        let first = *step == 0;
        let starts = |d: &Direction| matches!(d, Direction::ActionIn(of, _) if of == step) || matches!(d, Direction::Disturbance(_));
        let moves = moving.iter().any(|&tau| tau != 0.0);
        if match beginning {
            Beginning::Step => first || directions.iter().any(starts),
            Beginning::Event => true,
            Beginning::Break(_) => moves,
        } {
            past.mark(t);
        }
        let Some((at, element)) = past.jump(t) else { return Ok(()) };
        if matches!(beginning, Beginning::Break(_)) && !space.jumps {
            // What jumps at a smooth place belongs to an event that follows at once.
            return Ok(());
        }
        if let Some(varying) = past.varying() {
            let (jumping, varying) = (name_of(self.system.model(), element), name_of(self.system.model(), varying));
            let text = format!("what `{jumping}` delays jumps at t = {at}, and the dead time of `{varying}` changes within steps");
            return Err(FollowError::Refused(text));
        }
        moved.note_jumps(past, at, moving);
        Ok(())
    }

    /// Takes state, derivatives and integrals from the integrator.
    fn take_followed(&mut self, follower: &mut Follower) {
        let (n, count) = (self.progress.y.len(), self.integrals.len());
        follower.engine.y.copy_from_slice(follower.engine.integrator.state());
        follower.engine.yp.copy_from_slice(follower.engine.integrator.derivative());
        self.progress.y.copy_from_slice(&follower.engine.y[..n]);
        self.progress.yp.copy_from_slice(&follower.engine.yp[..n]);
        follower.tangents.take_y(&follower.engine.y[n..], &follower.live);
        let (own, others) = follower.engine.integrator.quadratures().split_at(count.min(follower.engine.integrator.quadratures().len()));
        self.integrals.iter_mut().zip(own).for_each(|(sum, part)| *sum += part);
        self.system.look_back(follower.engine.integrator.time(), &self.progress.y, &self.progress.yp);
        let width = follower.width();
        for (sums, parts) in follower.integrals.chunks_exact_mut(width.max(1)).zip(others.chunks_exact(follower.live.len().max(1))) {
            follower.live.iter().zip(parts).for_each(|(&j, part)| sums[j] += part);
        }
    }

    /// Goes behind a break, whose time may move.
    fn pass_break(&mut self, follower: &mut Follower, (at, behind): (f64, f64)) -> Result<(), FollowError> {
        self.take_rates(follower, BEFORE);
        let before = follower.engine.integrator.time();
        self.take_integrands(follower, BEFORE, before, 0.0);
        self.system.crosses(at);
        self.restart_plain(behind, follower.width())?;
        follower.moving.clone_from(&follower.space.next_break);
        self.take_rates(follower, BEHIND);
        self.take_integrands(follower, BEHIND, behind, 0.0);
        self.refuse_two_motions(follower, at)?;
        self.shift(follower, BEFORE, 1.0);
        self.shift(follower, BEHIND, -1.0);
        add_moved(follower);
        Ok(())
    }

    /// Refuses a break at which two jumps come together that move differently, if rates or
    /// integrands jump there.
    fn refuse_two_motions(&mut self, follower: &mut Follower, at: f64) -> Result<(), FollowError> {
        let Follower { moving, space, .. } = follower;
        let Some(direction) = moving.iter().position(|tau| tau.is_nan()) else { return Ok(()) };
        let jump = |[before, behind]: &[Vec<f64>; 2], count: usize| {
            let jumps = |(a, b): (&f64, &f64)| (a - b).abs() > TOGETHER * a.abs().max(b.abs());
            before.iter().zip(behind).take(count).any(jumps)
        };
        if jump(&space.rates, self.system.model().states()) || jump(&space.integrands, self.integrals.len()) {
            let text = format!("values jump together at t = {at}, at times that move differently along direction {direction}");
            return Err(FollowError::Refused(text));
        }
        moving.iter_mut().filter(|tau| tau.is_nan()).for_each(|tau| *tau = 0.0);
        Ok(())
    }

    /// Updates at an event between the beginning of the piece and the end of the interval.
    fn pass_event(&mut self, follower: &mut Follower, times: (f64, f64, f64)) -> Result<(), FollowError> {
        let mut fired = std::mem::take(&mut follower.space.fired);
        fired.clear();
        fired.extend(follower.engine.integrator.events().iter().enumerate().filter(|(_, sign)| **sign != 0).map(|(k, _)| k));
        let passed = if fired.is_empty() {
            // A strict condition at its threshold is decided by the motion after a restart.
            follower.pending = true;
            Ok(())
        } else {
            self.pass_fired(follower, &fired, times)
        };
        follower.space.fired = fired;
        passed
    }

    fn pass_fired(&mut self, follower: &mut Follower, fired: &[usize], (begin, t, end): (f64, f64, f64)) -> Result<(), FollowError> {
        let roots = self.progress.edges.len();
        let action = |k: usize, environment: &Self| (k < roots).then(|| environment.setup.model().roots_info()[k].action);
        if let Some(&k) = fired.iter().find(|&&k| matches!(action(k, self), Some(RootAction::Fail(_) | RootAction::Succeed(_)))) {
            let text = format!("the step ends at the event `{}`, t = {t}", self.event_name(k));
            return Err(FollowError::Failed(text));
        }
        let runs = fired.iter().any(|&k| matches!(action(k, self), Some(RootAction::Run(_))));
        let aside = if runs { 0.0 } else { 1.0 };
        self.take_rates_aside(follower, BEFORE, t, -aside);
        // What becomes true where the piece begins moves as its beginning does.
        if std::mem::take(&mut follower.pending) || t > begin {
            self.move_with(follower, fired, t)?;
        }
        let moves = follower.moving.iter().any(|&tau| tau != 0.0);
        if moves && t >= end {
            let text = format!("{} happens at the very end of the step", self.describe_event(fired[0]));
            return Err(FollowError::Refused(text));
        }
        self.take_integrands(follower, BEFORE, t, -aside);
        self.shift(follower, BEFORE, 1.0);
        if runs {
            self.run_event_programs(follower, fired, t)?;
        }
        let (model, memory) = self.system.parts();
        model.prepare_step(memory);
        if self.broken_variable().is_some() {
            return Err(FollowError::Failed(format!("{} makes something that is not finite", self.describe_event(fired[0]))));
        }
        self.restart_plain(t, follower.width())?;
        self.take_rates_aside(follower, BEHIND, t, aside);
        self.take_integrands(follower, BEHIND, t, aside);
        self.shift(follower, BEHIND, -1.0);
        add_moved(follower);
        Ok(())
    }

    fn run_event_programs(&mut self, follower: &mut Follower, fired: &[usize], t: f64) -> Result<(), FollowError> {
        let moving = std::mem::take(&mut follower.moving);
        let done = self.run_moving(follower, &moving, fired, t);
        follower.moving = moving;
        done
    }

    fn run_moving(&mut self, follower: &mut Follower, moving: &[f64], fired: &[usize], t: f64) -> Result<(), FollowError> {
        self.follow_algebraic(follower, t, moving)?;
        let clock = self.system.memory().layout().range(Region::Builtin).start + Builtin::Clock as usize;
        moving.iter().enumerate().for_each(|(j, &tau)| follower.tangents.set_work(clock, j, tau));
        self.set_builtin(Builtin::Clock, t);
        let (roots, mut moved) = (self.progress.edges.len(), false);
        for &k in fired.iter().filter(|&&k| k < roots) {
            if let (1, RootAction::Run(program)) = (follower.engine.integrator.events()[k], self.setup.model().roots_info()[k].action) {
                self.run_tangent(follower, TangentProgram::Event(program), (t, moving), 0)?;
                let (model, memory) = self.system.parts();
                model.event(program as usize, memory, t, &mut self.progress.y);
                moved |= self.setup.corrections.set_by[k];
            }
        }
        let begin = self.begin;
        self.set_builtin(Builtin::Clock, begin);
        follower.tangents.hold(clock..clock + 1);
        if moved { self.follow_projection(follower, t, moving) } else { Ok(()) }
    }

    /// The present unknowns and rates are those of a restart.
    fn restart_plain(&mut self, t: f64, width: usize) -> Result<(), FollowError> {
        let (y, yp) = (&self.progress.y, Some(self.progress.yp.as_slice()));
        self.integrator.restart(&mut self.system, t, y, yp).map_err(|e| self.solver_fault(&e, t, width))?;
        self.take_state();
        Ok(())
    }

    /// Adds `factor` times rates to the derivatives of the states, as far as the present time
    /// moves.
    fn shift(&self, follower: &mut Follower, side: usize, factor: f64) {
        let Follower { moving, tangents, space, .. } = follower;
        for (j, &tau) in moving.iter().enumerate().filter(|(_, tau)| **tau != 0.0) {
            for (at, rate) in space.rates[side].iter().enumerate().take(self.system.model().states()) {
                let value = tangents.y(at, j) + factor * rate * tau;
                tangents.set_y(at, j, value);
            }
        }
    }

    fn write_followed(&self, follower: &mut Follower) {
        let n = self.progress.y.len();
        follower.tangents.write_y(&mut follower.engine.y[n..], &follower.live);
    }

    /// Integrands at the present state, or a little before or behind it.
    fn take_integrands(&mut self, follower: &mut Follower, place: usize, t: f64, side: f64) {
        let t = self.go_aside(follower, t, side);
        let Space { integrands, before: y, .. } = &mut follower.space;
        let rates = &mut integrands[place];
        rates.clear();
        rates.resize(self.integrals.len(), 0.0);
        if !rates.is_empty() && !follower.integrals.is_empty() {
            self.system.quadratures(t, y, &self.progress.yp, rates);
        }
    }

    /// The present rates.
    fn take_rates(&self, follower: &mut Follower, place: usize) {
        follower.space.rates[place].clone_from(&self.progress.yp);
    }

    /// Rates of the states a little before or behind a switch of the equations.
    fn take_rates_aside(&mut self, follower: &mut Follower, place: usize, t: f64, side: f64) {
        self.take_rates(follower, place);
        if side == 0.0 || !self.system.is_explicit() {
            return;
        }
        let t = self.go_aside(follower, t, side);
        let Space { rates, before: y, still, .. } = &mut follower.space;
        still.resize(y.len(), 0.0);
        self.system.residual(t, y, still, &mut rates[place]);
    }

    /// Makes the unknowns before or behind the present ones by a little; gives the time.
    fn go_aside(&self, follower: &mut Follower, t: f64, side: f64) -> f64 {
        let ahead = side * ASIDE * self.setup.model().interface().episode.integrate;
        let y = &mut follower.space.before;
        y.clear();
        y.extend(self.progress.y.iter().zip(&self.progress.yp).map(|(y, yp)| y + ahead * yp));
        t + ahead
    }

    /// Notes how the time of what fired moves along each direction.
    fn move_with(&mut self, follower: &mut Follower, fired: &[usize], t: f64) -> Result<(), FollowError> {
        follower.moving.clear();
        for &k in fired {
            self.find_motion(follower, k, t)?;
            let Follower { moving, space, .. } = &mut *follower;
            if moving.is_empty() {
                moving.clone_from(&space.motion);
                continue;
            }
            let differ = |(a, b): (&f64, &f64)| (a - b).abs() > TOGETHER * a.abs().max(b.abs());
            if space.motion.iter().zip(moving).any(|(a, b)| differ((a, b))) {
                let text = format!("{} and {} happen at the same time, t = {t}", self.describe_event(fired[0]), self.describe_event(k));
                return Err(FollowError::Refused(text));
            }
        }
        Ok(())
    }

    /// Derivatives of the time of one condition along each direction.
    fn find_motion(&mut self, follower: &mut Follower, k: usize, t: f64) -> Result<(), FollowError> {
        let (roots, outputs) = (self.progress.edges.len(), self.system.model().watched().len());
        self.run_tangent(follower, TangentProgram::Roots, (t, &[]), outputs)?;
        let Follower { tangents, space: Space { motion, .. }, .. } = &mut *follower;
        motion.clear();
        motion.extend((0..tangents.width()).map(|j| tangents.output(k, j)));
        if motion.iter().all(|&along| along == 0.0) {
            return Ok(());
        }
        let model = self.setup.model().model();
        if k < roots && model.exprs.has_derivative(model.roots[k].value) {
            return Err(FollowError::Refused(format!("the condition of {} reads rates", self.describe_event(k))));
        }
        let rate = self.rate_of(follower, (k, outputs), t)?;
        let motion = &mut follower.space.motion;
        motion.iter_mut().for_each(|along| *along = -*along / rate);
        if rate == 0.0 || motion.iter().any(|tau| !tau.is_finite()) {
            return Err(FollowError::Refused(format!("{} touches its threshold without crossing it, t = {t}", self.describe_event(k))));
        }
        Ok(())
    }

    /// Derivative by time of a root function along the solution before the present time.
    fn rate_of(&mut self, follower: &mut Follower, (at, outputs): (usize, usize), t: f64) -> Result<f64, FollowError> {
        let mut along = std::mem::replace(&mut follower.along, super::Tangents::none());
        along.clear();
        for (unknown, &rate) in follower.space.rates[BEFORE].iter().enumerate().take(self.system.model().states()) {
            along.set_y(unknown, 0, rate);
        }
        std::mem::swap(&mut along, &mut follower.tangents);
        // The past moves by its rates, which the equations hold.
        let past = follower.past.take();
        let done = self
            .follow_algebraic(follower, t, &[1.0])
            .and_then(|()| self.run_tangent(follower, TangentProgram::Roots, (t, &[1.0]), outputs));
        follower.past = past;
        std::mem::swap(&mut along, &mut follower.tangents);
        let found = done.map(|()| along.output(at, 0));
        follower.along = along;
        found
    }

    fn event_name(&self, k: usize) -> &str {
        self.setup.model().roots_info().get(k).map_or("", |root| root.name.as_str())
    }

    fn describe_event(&self, k: usize) -> String {
        if k < self.progress.edges.len() { format!("the event `{}`", self.event_name(k)) } else { "a switch of the equations".into() }
    }
}

/// Integrals up to a time that moves.
fn add_moved(follower: &mut Follower) {
    let width = follower.width();
    let Follower { integrals, moving, space: Space { integrands: [before, behind], .. }, .. } = follower;
    for ((row, before), after) in integrals.chunks_exact_mut(width).zip(before.iter()).zip(behind.iter()) {
        row.iter_mut().zip(&*moving).for_each(|(sum, tau)| *sum += (before - after) * tau);
    }
}
