//! The way to the end of an advance, whatever takes the steps: it stops at breaks, and where events
//! happen.
//!
//! Events are looked for at accepted states and found on the interpolating polynomial of the step
//! in which they happened.

use std::os::raw::c_int;

use super::watch::{Crawl, TIE, Watch};
use super::{Advance, SolveError};

/// Two times this near each other, in parts of the larger one, are one: the tables of a model know
/// them no better.
const NEAR: f64 = 2e-12;

/// Distance of both sides of a break from it, in roundings: the equations are of one form on each.
const ROUNDINGS: f64 = 8.0;

/// Distance ahead at which the motion of a root function is evaluated, over the interval and over
/// the time itself.
const AHEAD: [f64; 2] = [1e-7, 1e4 * f64::EPSILON];

/// Duration within which events are simultaneous, likewise.
const AT_ONCE: [f64; 2] = [1e-10, 100.0 * f64::EPSILON];

/// Distances at which slow motion is looked for, in multiples of the first one; and the parts of
/// the way at which it has to show.
const FAR: [f64; 2] = [1e3, 1e6];
const PARTS: [f64; 3] = [1.0, 0.25, 0.0625];

/// By this many times as much a condition has to move anew, where it became true at the end of an
/// interval.
const AGAIN: f64 = 2.0;

/// Relative rounding of a state.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// Factor by which rounding grows; a jump does not.
const WIDER: f64 = 16.0;

/// Steps of this part of an interval are so short that a kink in them may hold the solution.
pub(crate) const SHORT: f64 = 1e-4;

/// A root function that moves by no more than this part of its tolerance, along the rates and as
/// far as motion is looked for, is held.
const STILL: f64 = 1e-8;

/// Longest step whose polynomial a switch may spoil, over the interval and over the time itself.
const FINE: [f64; 2] = [1e-12, 64.0 * f64::EPSILON];

/// Most repetitions of a step; growth of the short step beyond; and its greatest length, in parts
/// of the step.
const REPEATS: u32 = 4;
const FURTHER: f64 = 16.0;
const COARSE: f64 = 0.1;

/// Greatest distance of a jump that steps have become too short to reach, over the interval and
/// over the time itself.
const NEARBY: [f64; 2] = [1e-8, 1e4 * f64::EPSILON];

/// For this part of the interval no tie is looked for where there was none.
const PATIENCE: f64 = 1e-4;

/// Ties that are tried at most in one advance.
pub(crate) const MOST_TIES: u32 = 64;

/// Corrections of an unknown until a root function is zero.
const CORRECTIONS: u32 = 8;

/// Part of the longest interval by which time moves between two looks at the number of stops.
const PROGRESS: f64 = 1e-3;

/// Fewest stops at one switch within that time, or at all switches, that count as stops without
/// end.
const RETURNS: u32 = 32;
const STOPS: u64 = 100;

/// An integrator between two control instants, with its system at hand.
pub(crate) trait Traverse {
    /// Present time.
    fn time(&self) -> f64;

    /// The longest interval since the last time that everything was forgotten.
    fn longest_interval(&self) -> f64;

    /// Most breaks in one advance.
    fn max_steps(&self) -> u32;

    /// The first time from `t` on at which the equations change their form.
    fn next_break(&mut self, t: f64) -> Result<f64, SolveError>;

    /// Notes the break that is crossed next.
    fn note_break(&mut self, at: f64) -> Result<(), SolveError>;

    /// Begins anew at another time with the present state: algebraic unknowns and derivatives are
    /// others there.
    fn cross(&mut self, to: f64) -> Result<(), SolveError>;

    /// Steps to a time before the next break, or to an event.
    fn solve(&mut self, t_end: f64) -> Result<Advance, SolveError>;

    /// Monitored root functions, and conditions that became true.
    fn watched(&mut self) -> (&mut Watch, &mut [c_int]);

    /// Evaluates the root functions at the present state and this time.
    fn evaluate_roots(&mut self, t: f64) -> Result<(), SolveError>;

    /// Evaluates them a little later, along the derivatives; algebraic unknowns follow their
    /// equations, or go on along their derivatives too.
    fn evaluate_along(&mut self, ahead: f64, consistently: bool) -> Result<(), SolveError>;

    /// Evaluates them at a time where each unknown is multiplied by a factor that depends on its
    /// number.
    fn evaluate_moved(&mut self, time: f64, factor: &dyn Fn(usize) -> f64) -> Result<(), SolveError>;

    /// Makes state, derivatives and quadratures those at a time within the last step.
    fn interpolate(&mut self, t: f64) -> Result<(), SolveError>;

    /// Takes the integrals up to a time within the last step.
    fn take_integrals(&mut self, to: f64) -> Result<(), SolveError>;

    /// The derivatives that the equations give, instead of those of the polynomial, which may be
    /// off by the tolerance.
    fn derive(&mut self) -> Result<(), SolveError>;

    /// Stays at this time, where a restart is needed.
    fn stop_at(&mut self, t: f64);

    /// Steps since everything was forgotten, those that failed included.
    fn steps_tried(&self) -> u64;

    /// Returns whether the integration stops at jumps of the equations, too.
    fn reports_jumps(&self) -> bool;

    /// Moves the states along their rates for a time.
    fn go_along(&mut self, ahead: f64);

    /// An unknown at the present state.
    fn unknown_mut(&mut self, at: usize) -> &mut f64;

    /// The tolerance of an unknown.
    fn tolerance(&self, at: usize) -> f64;

    /// An unknown that root functions read, by its number among these.
    fn watched_unknown(&self, number: usize) -> Option<usize>;

    /// Returns whether the equations give the rates of all states.
    fn is_explicit(&self) -> bool;

    /// Returns whether an integration begins where no event can happen: conditions are as they
    /// were.
    fn begins_safely(&mut self) -> Result<bool, SolveError>;

    /// Returns whether no event can happen at the present state and for a time ahead along its
    /// derivatives.
    fn is_safe(&mut self, ahead: f64) -> bool;

    /// The time at which the last step began, if the integration can go back there.
    fn step_began(&self) -> Option<f64>;

    /// Steps to `t_end` or to the first event, which may be at `t_end` itself.
    fn go_to_event(&mut self, t_end: f64) -> Result<Advance, SolveError> {
        let gone = match self.go(t_end) {
            Err(SolveError::TooManySteps { time, steps, unknown, .. }) => {
                let event = self.nearest_event();
                return Err(SolveError::TooManySteps { time, steps, unknown, event });
            }
            gone => gone?,
        };
        match gone {
            Advance::Reached if self.ends_at_event()? => Ok(Advance::Event),
            advance => Ok(advance),
        }
    }

    /// The root function that is at its threshold, as far as it moves within a small part of the
    /// interval.
    fn nearest_event(&mut self) -> Option<usize> {
        if self.watched().0.is_empty() {
            return None;
        }
        let (time, ahead) = (self.time(), self.span(AHEAD));
        self.evaluate_roots(time).ok()?;
        self.evaluate_along(ahead, false).ok()?;
        self.watched().0.nearest()
    }

    /// Returns `true` if a condition becomes true at the end of the interval although rounding puts
    /// its instant just behind. The next interval may have other inputs, under which it would not.
    fn ends_at_event(&mut self) -> Result<bool, SolveError> {
        let ahead = self.span(AHEAD);
        if self.watched().0.is_empty() || self.is_safe(ahead) {
            return Ok(false);
        }
        if self.watched().0.stale {
            self.evaluate_roots(self.time())?;
        }
        self.evaluate_along(ahead, false)?;
        let (watch, _) = self.watched();
        watch.forget_noise();
        if !watch.is_about_to_stop(1.0) {
            return Ok(false);
        }
        self.measure_noise(self.time())?;
        self.derive()?;
        self.evaluate_along(ahead, true)?;
        let reach = self.span(AT_ONCE) / ahead;
        let time = self.time();
        let (watch, events) = self.watched();
        if !watch.is_about_to_stop(reach) {
            return Ok(false);
        }
        watch.arrive(AGAIN * reach, events);
        self.stop_at(time);
        Ok(true)
    }

    /// Steps to `t_end` or to the first event, beginning anew behind each break.
    fn go(&mut self, t_end: f64) -> Result<Advance, SolveError> {
        let mut stops = 0;
        let mut width = ROUNDINGS * f64::EPSILON * self.time().abs().max(t_end.abs());
        loop {
            let near = NEAR * self.time().abs().max(t_end.abs());
            let at = self.next_break(self.time())?;
            if at.is_nan() || at > t_end + near {
                return self.solve_past_switches(t_end, &mut stops);
            }
            stops += 1;
            if stops > self.max_steps() {
                return Err(SolveError::TooManySteps { time: self.time(), steps: self.max_steps(), unknown: None, event: None });
            }
            if at - width <= self.time() + near {
                // A break that is not left behind by roundings is by a few more of them.
                width *= 2.0;
            } else {
                width = ROUNDINGS * f64::EPSILON * at.abs().max(t_end.abs());
                let advance = self.solve_past_switches((at - width).min(t_end), &mut stops)?;
                if advance == Advance::Event || at - width >= t_end {
                    return Ok(advance);
                }
            }
            let behind = (at.max(self.time()) + width).min(t_end);
            self.note_break(at)?;
            self.cross(behind)?;
            if behind == t_end {
                return self.solve_past_switches(t_end, &mut stops);
            }
        }
    }

    /// Steps to a time before the next break, or to an event, beginning anew behind each switch at
    /// which a step ends.
    fn solve_past_switches(&mut self, t_end: f64, stops: &mut u32) -> Result<Advance, SolveError> {
        loop {
            let advance = match self.solve_precisely(t_end) {
                Err(error) if is_stuck(&error) && *stops < self.max_steps() => {
                    if self.hold_any_tie()? {
                        *stops += 1;
                        let time = self.time();
                        self.cross(time)?;
                        continue;
                    }
                    if !self.passes_jump(t_end)? {
                        return Err(error);
                    }
                    Advance::Event
                }
                advance => advance?,
            };
            let reports = self.reports_jumps();
            let (watch, fired) = self.watched();
            if advance == Advance::Reached || !watch.at_switch || (reports && watch.has_jumped(fired)) {
                return Ok(advance);
            }
            *stops += 1;
            let time = self.time();
            if *stops > self.max_steps() {
                return Err(SolveError::TooManySteps { time, steps: self.max_steps(), unknown: None, event: None });
            }
            let left = t_end - time;
            if let Some(switch) = self.watched().0.switched {
                self.hold_tie(switch)?;
            }
            self.cross(if left <= ROUNDINGS * f64::EPSILON * (time.abs() + t_end.abs()) { t_end } else { time })?;
        }
    }

    /// Steps to a time before the next break, or to an event or switch. Equations that change their
    /// form inside of a step spoil its polynomial: the step is taken again up to where the first
    /// thing happened, and a short one beyond it.
    fn solve_precisely(&mut self, t_end: f64) -> Result<Advance, SolveError> {
        let start = self.time();
        let mut advance = self.solve_on(t_end)?;
        let fine = self.span(FINE);
        for _ in 0..REPEATS {
            let at = self.time();
            // What happens at a restart happens in no step: the last one lies before it.
            let began = self.step_began().map(|began| began.max(start)).filter(|began| at - began > fine);
            let watch = self.watched().0;
            let Some(began) = began.filter(|_| advance == Advance::Event && watch.has_switches() && !watch.at_tie) else { break };
            self.interpolate(began)?;
            self.take_integrals(began)?;
            self.stop_at(began);
            self.watched().0.go_back();
            self.cross(began)?;
            // Where it happened the equations are those beyond already.
            advance = self.solve_on(at - 0.5 * fine)?;
            let mut ahead = fine;
            while advance == Advance::Reached && self.time() < t_end {
                let to = if ahead > COARSE * (at - began) { t_end } else { (at + ahead).min(t_end) };
                advance = match self.solve_on(to) {
                    Err(error) if is_stuck(&error) => return if self.passes_jump(t_end)? { Ok(Advance::Event) } else { Err(error) },
                    advance => advance?,
                };
                ahead *= FURTHER;
            }
        }
        Ok(advance)
    }

    /// Steps as [`solve`](Self::solve) does, and fails where a switch stops the integration so
    /// often that the interval would need more stops than steps are allowed. It also fails where
    /// steps between switches reach their limit while time hardly moves.
    fn solve_on(&mut self, t_end: f64) -> Result<Advance, SolveError> {
        let advance = self.solve(t_end);
        let (time, tried, interval) = (self.time(), self.steps_tried(), self.longest_interval());
        let most = f64::from(self.max_steps());
        let watch = self.watched().0;
        let is_event = matches!(advance, Ok(Advance::Event)) && !watch.at_switch;
        if is_event || time - watch.crawl.since > PROGRESS * interval {
            watch.begin_crawl(time, tried);
        }
        watch.crawl.stops += 1;
        let Crawl { since, begin, stops } = watch.crawl;
        let work = tried.saturating_sub(begin) + stops;
        let returns = watch.returns.iter().copied().max().unwrap_or(0);
        let is_fast = returns >= RETURNS && f64::from(returns) * interval > most * (time - since);
        if matches!(advance, Ok(Advance::Reached)) || !(is_fast || (stops >= STOPS && work as f64 > most)) {
            return advance;
        }
        let steps = self.max_steps();
        Err(SolveError::Switching { time, steps, at: self.states_at_switches() })
    }

    /// The unknowns that move the last two switches most, with their values.
    fn states_at_switches(&mut self) -> [Option<(usize, f64)>; 2] {
        let switches = self.watched().0.last_switches;
        let unknown = |switch: Option<usize>| {
            let (at, _) = self.steepest(switch?).ok()??;
            Some((at, *self.unknown_mut(at)))
        };
        let [last, before] = switches.map(unknown);
        [last, before.filter(|(at, _)| last.is_none_or(|(other, _)| other != *at))]
    }

    /// Goes along the rates to just behind a nearby jump of the equations, after steps have become
    /// too short. No step crosses a jump of algebraic unknowns, or of rates by more than their
    /// tolerances over the shortest step. Returns whether there is such a jump; the integration has
    /// stopped at it.
    fn passes_jump(&mut self, t_end: f64) -> Result<bool, SolveError> {
        let (time, fine) = (self.time(), self.span(FINE));
        let watch = self.watched().0;
        if !watch.has_switches() || watch.ties >= MOST_TIES {
            return Ok(false);
        }
        watch.ties += 1;
        self.evaluate_roots(time)?;
        self.derive()?;
        let (mut low, mut high) = (0.0, fine);
        while !self.jumps_within(high)? {
            (low, high) = (high, high * FURTHER);
            if high > self.span(NEARBY) {
                return Ok(false);
            }
        }
        while high - low > fine {
            let middle = 0.5 * (low + high);
            if self.jumps_within(middle)? {
                high = middle;
            } else {
                low = middle;
            }
        }
        let to = (time + high).min(t_end);
        self.go_along(to - time);
        self.stop_at(to);
        self.evaluate_roots(to)?;
        let ahead = self.span(AHEAD);
        self.derive()?;
        self.evaluate_along(ahead, true)?;
        let reach = self.span(AT_ONCE) / ahead;
        let (watch, events) = self.watched();
        watch.forget_noise();
        watch.arrive(reach, events);
        Ok(true)
    }

    /// Returns whether the equations jump within a time from now, along the present rates.
    fn jumps_within(&mut self, ahead: f64) -> Result<bool, SolveError> {
        self.evaluate_along(ahead, true)?;
        Ok(self.watched().0.jumps_ahead())
    }

    /// Returns whether the equations hold the solution at a kink nearby, after steps have become
    /// too short.
    fn hold_any_tie(&mut self) -> Result<bool, SolveError> {
        let mut next = 0;
        self.watched().0.loose_until = f64::NEG_INFINITY;
        while let Some(kink) = self.watched().0.kink_from(next) {
            if self.hold_tie(kink)? {
                return Ok(true);
            }
            self.watched().0.loose_until = f64::NEG_INFINITY;
            next = kink + 1;
        }
        Ok(false)
    }

    /// Moves the state to the threshold of a switch, within tolerances of one unknown, if the
    /// equations hold it there, as the levels of two vessels that have become equal. Returns
    /// whether they do. Otherwise the solution would be led across and back without end.
    fn hold_tie(&mut self, switch: usize) -> Result<bool, SolveError> {
        let time = self.time();
        let explicit = self.is_explicit();
        let watch = self.watched().0;
        if time < watch.loose_until || watch.ties >= MOST_TIES || !explicit {
            return Ok(false);
        }
        watch.ties += 1;
        let Some((at, slope)) = self.steepest(switch)? else { return Ok(false) };
        let (before, tolerance, ahead) = (*self.unknown_mut(at), self.tolerance(at), self.span(AHEAD));
        if self.moves_to_threshold(switch, (at, slope))? && (*self.unknown_mut(at) - before).abs() <= TIE * tolerance {
            self.derive()?;
            self.evaluate_along(ahead, true)?;
            let band = tolerance * slope.abs();
            let watch = self.watched().0;
            if watch.ahead[switch].abs() <= STILL * band {
                watch.hold(switch, band);
                return Ok(true);
            }
        }
        *self.unknown_mut(at) = before;
        let loose = time + PATIENCE * self.longest_interval();
        self.watched().0.loose_until = loose;
        Ok(false)
    }

    /// The unknown that moves a root function most within its tolerance, and the derivative by it.
    fn steepest(&mut self, switch: usize) -> Result<Option<(usize, f64)>, SolveError> {
        let time = self.time();
        self.evaluate_roots(time)?;
        let value = self.watched().0.values[switch];
        let mut found: Option<(usize, f64)> = None;
        let mut number = 0;
        while let Some(at) = self.watched_unknown(number) {
            number += 1;
            let (own, tolerance) = (*self.unknown_mut(at), self.tolerance(at));
            *self.unknown_mut(at) = own + tolerance;
            self.evaluate_roots(time)?;
            *self.unknown_mut(at) = own;
            let change = self.watched().0.values[switch] - value;
            if change.is_finite() && change.abs() > found.map_or(0.0, |(at, slope)| (slope * self.tolerance(at)).abs()) {
                found = Some((at, change / tolerance));
            }
        }
        Ok(found)
    }

    /// Moves an unknown until a root function is zero; whether it is.
    fn moves_to_threshold(&mut self, switch: usize, (at, slope): (usize, f64)) -> Result<bool, SolveError> {
        let time = self.time();
        for _ in 0..CORRECTIONS {
            self.evaluate_roots(time)?;
            let value = self.watched().0.values[switch];
            if value == 0.0 {
                return Ok(true);
            }
            *self.unknown_mut(at) -= value / slope;
        }
        Ok(false)
    }

    /// A time over the interval or over the time itself, whichever is longer.
    fn span(&self, [of_interval, of_time]: [f64; 2]) -> f64 {
        (of_interval * self.longest_interval()).max(of_time * self.time().abs())
    }

    /// Conditions after a restart; whether one becomes true there.
    fn settle(&mut self) -> Result<bool, SolveError> {
        let time = self.time();
        let (watch, _) = self.watched();
        if watch.is_empty() {
            return Ok(false);
        }
        watch.passed = false;
        watch.at_switch = false;
        watch.since = time;
        watch.forget_quiet();
        if self.begins_safely()? {
            let (watch, events) = self.watched();
            watch.stale = true;
            events.fill(0);
            return Ok(false);
        }
        self.evaluate_roots(time)?;
        if self.watched().0.is_at_threshold() {
            self.measure_noise(time)?;
            let ahead = self.span(AHEAD);
            self.evaluate_along(ahead, true)?;
            if !self.watched().0.look_ahead() {
                self.look_far_ahead(ahead)?;
            }
        }
        let (watch, events) = self.watched();
        let fired = watch.settle(events);
        if fired {
            self.stop_at(time);
        }
        Ok(fired)
    }

    /// Looks for motion that does not show nearby because it is slow compared with the size of what
    /// moves. It has to show on the way, too: what rests at its threshold and would move only
    /// further on, `max(x - 1, 0)`, does not move.
    fn look_far_ahead(&mut self, ahead: f64) -> Result<(), SolveError> {
        for far in FAR {
            for (k, part) in PARTS.into_iter().enumerate() {
                self.evaluate_along(ahead * far * part, true)?;
                self.watched().0.note_far(k == 0, part);
            }
            if self.watched().0.take_far() {
                break;
            }
        }
        Ok(())
    }

    /// Looks at the root functions at a state of the last step; whether a condition has become true
    /// before.
    fn has_passed(&mut self, t: f64) -> Result<bool, SolveError> {
        if self.watched().0.is_empty() {
            return Ok(false);
        }
        self.evaluate_roots(t)?;
        Ok(self.watched().0.accept(t))
    }

    /// Part of the root functions due to rounding of the state, and of the time if another one is
    /// given.
    fn measure_noise(&mut self, time: f64) -> Result<(), SolveError> {
        self.move_by(ROUNDING, time)?;
        self.watched().0.take_noise();
        if self.watched().0.is_lost_in_noise() {
            // A root function that jumps here, `if h < 1 then 1 else -1`, is as clear as any other
            // on both sides.
            self.move_by(WIDER * ROUNDING, time)?;
            self.watched().0.take_jumps();
        }
        Ok(())
    }

    /// Evaluates the root functions at states that differ by this much in each unknown.
    fn move_by(&mut self, part: f64, time: f64) -> Result<(), SolveError> {
        for pattern in [1, 2] {
            // Signs of two patterns: a difference of two unknowns shows in one of them.
            self.evaluate_moved(time, &|i| 1.0 + if i & pattern == 0 { part } else { -part })?;
            self.watched().0.note_moved(pattern == 1);
        }
        Ok(())
    }

    /// Goes to the first instant at which a condition became true, to the rounding of time.
    fn locate(&mut self) -> Result<(), SolveError> {
        let watch = self.watched().0;
        let (begin, mut high) = (watch.since, watch.until);
        let mut low = begin;
        let fine = f64::EPSILON * (high.abs() + (high - low));
        while high - low > fine {
            let middle = low + (high - low) / 2.0;
            self.interpolate(middle)?;
            if self.has_passed(middle)? {
                high = middle;
            } else {
                low = middle;
            }
        }
        self.interpolate(high)?;
        self.take_integrals(high)?;
        self.stop_at(high);
        self.evaluate_roots(high)?;
        let ahead = self.span(AHEAD);
        self.measure_noise(high * (1.0 + ROUNDING))?;
        self.derive()?;
        self.evaluate_along(ahead, true)?;
        if self.watched().0.is_led_back() {
            self.look_behind((high - ahead).max(begin), ahead)?;
            self.watched().0.note_before();
            self.look_behind(high, ahead)?;
        }
        let reach = self.span(AT_ONCE) / ahead;
        let (watch, events) = self.watched();
        watch.arrive(reach, events);
        Ok(())
    }

    /// Goes to a time within the last step once more, and looks at the root functions there and
    /// ahead of it.
    fn look_behind(&mut self, at: f64, ahead: f64) -> Result<(), SolveError> {
        self.interpolate(at)?;
        self.stop_at(at);
        self.evaluate_roots(at)?;
        self.derive()?;
        self.evaluate_along(ahead, true)
    }
}

/// Returns whether steps have become too short to go on.
fn is_stuck(error: &SolveError) -> bool {
    matches!(
        error,
        SolveError::TooManySteps { .. }
            | SolveError::StepTooSmall { .. }
            | SolveError::ErrorTestFailures { .. }
            | SolveError::ConvergenceFailures { .. }
    )
}
