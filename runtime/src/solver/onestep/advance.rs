//! From step to step.

use std::os::raw::c_int;

use super::super::callbacks::Trouble;
use super::super::forcing::Course;
use super::super::inside::{Inside, looks_into, stays};
use super::super::nonnegative::shorter;
use super::super::traverse::{MOST_TIES, SHORT as SHORT_STEP, Traverse};
use super::super::watch::{Closely, Open, Watch};
use super::super::{Advance, FirstStep, Method, SolveError, System};
use super::algebra::Failure;
use super::control::{Control, first_step};
use super::numbers::{Quad, entries, entries_mut, set, sum};
use super::{Events, Integrals, OneStep, Phase};

/// Accepted steps after which a failed evaluation no longer counts as the cause of a later end.
const MEMORY: u32 = 10;

/// Rejections in a row after which there is no step that fits.
const MOST_REJECTIONS: u32 = 60;

/// An error, in tolerances, that comes from a kink if forcings turn often. (Orbits have such errors
/// too where bodies meet, and nothing to correct.)
const DOUBTFUL: f64 = 10.0;

/// Steps of this part of an interval are those at switches.
const TINY: f64 = 1e-9;

/// The least bound of steps where a forcing turns, in roundings of time.
const SHORTEST: f64 = 64.0;

/// Tolerances by which algebraic unknowns may be off before they are brought to their equations.
/// The part of a control step below which steps are not repeated for that alone: what is still
/// off then jumps.
const STRAY: f64 = 10.0;
const SHORT: f64 = 1e-8;

/// An integrator with its system at hand.
pub(super) struct Run<'a> {
    pub one: &'a mut OneStep,
    pub system: &'a mut dyn System,
}

impl Run<'_> {
    /// Consistent values and derivatives at a time; `first` where the algebraic unknowns are
    /// guesses.
    pub(crate) fn initialise(&mut self, t: f64, first: bool) -> Result<(), SolveError> {
        self.one.frame.t = t;
        self.system.begin(t, self.one.frame.y());
        self.make_consistent(t, first)?;
        let frame = &mut self.one.frame;
        frame.functions.rates(self.system, t, &frame.begin, &mut frame.begin_rates);
        if !is_finite(&frame.begin_rates) {
            frame.functions.counts.not_finite += 1;
            frame.functions.check(t, &frame.begin_rates);
            return Err(self.failure(0.0));
        }
        if self.one.algebra.is_none() {
            self.one.derivative.copy_from_slice(&self.one.frame.begin_rates);
        }
        let OneStep { frame, derivative, settings, .. } = &*self.one;
        self.system.begun(t, frame.y(), entries(derivative, frame.n), settings.rtol);
        Ok(())
    }

    /// Solves for algebraic unknowns.
    fn make_consistent(&mut self, t: f64, first: bool) -> Result<(), SolveError> {
        let Some(algebra) = &mut self.one.algebra else { return Ok(()) };
        let n = self.one.frame.n;
        let yp = entries_mut(&mut self.one.derivative, n);
        match algebra.begin(self.system, (t, first), self.one.frame.y_mut(), yp) {
            Ok(()) => Ok(()),
            Err(Failure::Method(error)) => Err(error),
            Err(Failure::Noted(trouble)) => {
                self.one.frame.functions.trouble = Some(trouble);
                Err(self.failure(0.0))
            }
        }
    }

    /// Reason why the integration cannot continue, at the smallest step.
    fn failure(&mut self, step: f64) -> SolveError {
        let time = self.one.time;
        let unknown = self.one.methods.unknown_to_blame(&mut self.one.frame);
        match self.one.frame.functions.trouble {
            Some(Trouble::Residual { time, row }) => SolveError::NotFinite { time, row },
            Some(Trouble::Jacobian { time, entry }) => {
                let (row, column) = self.one.methods.place_of(entry);
                SolveError::JacobianNotFinite { time, row, column }
            }
            Some(Trouble::Singular { time, column }) => SolveError::SingularJacobian { time, column },
            Some(Trouble::Negative { time, state }) => SolveError::Negative { time, unknown: state },
            Some(Trouble::Panic) => SolveError::Panicked { time },
            Some(Trouble::Interrupted) => SolveError::Interrupted { time },
            Some(Trouble::TinySteps { .. }) | None => SolveError::StepTooSmall { time, step, unknown },
        }
    }

    /// Looks at what time moves in the interval that begins here.
    fn look_inside(&mut self, interval: f64) -> Result<Course, SolveError> {
        let OneStep { forcing, frame, derivative, time, .. } = &mut *self.one;
        if forcing.is_empty() {
            return Ok(Course::Flat);
        }
        let (n, system) = (frame.n, &mut *self.system);
        forcing.look(|share, out| {
            system.forcings(*time + share * interval, frame.y(), entries(derivative, n), out);
            Ok(())
        })
    }

    /// The step that an integration begins with: the one that fitted before, or an estimate.
    fn begin(&mut self, interval: f64, longest: f64) {
        if let FirstStep::Fixed(step) = self.one.settings.first_step {
            self.one.control = Control::begin(step);
        }
        if self.one.control.proposed == 0.0 {
            let step = self.estimate(interval);
            self.one.control = Control::begin(step);
        }
        self.one.control.proposed = self.one.control.proposed.min(longest);
    }

    /// A first step from rates here and a little later.
    fn estimate(&mut self, interval: f64) -> f64 {
        let growth = self.one.methods.growth();
        let frame = &mut self.one.frame;
        frame.end.copy_from_slice(&frame.begin);
        let moving = |rates: &[Quad], mass: &[Quad], out: &mut [Quad]| set(out, |i, lane| rates[i][lane] * mass[i][lane]);
        let [place, rates] = &mut self.one.inside;
        moving(&frame.begin_rates, &frame.mass, rates);
        let (size, speed) = (frame.norm(&frame.begin), frame.norm(rates));
        let ahead = if speed > 0.0 { (0.01 * size / speed).clamp(1e-6 * interval, interval) } else { 1e-3 * interval };
        set(place, |i, lane| frame.begin[i][lane] + ahead * rates[i][lane]);
        frame.functions.rates(self.system, frame.t + ahead, place, &mut frame.end_rates);
        let (before, after, mass) = (&frame.begin_rates, &frame.end_rates, &frame.mass);
        set(rates, |i, lane| mass[i][lane] * (after[i][lane] - before[i][lane]));
        let change = frame.norm(rates) / ahead;
        if change.is_finite() { first_step(speed, change, ahead, growth).min(interval) } else { 0.01 * ahead }
    }

    /// A step to `t_end` or before it; whether it came there, or an event happened.
    fn step(&mut self, t_end: f64, longest: f64) -> Result<Option<Advance>, SolveError> {
        let mut rejections = 0;
        let (step, last) = loop {
            if self.one.pace.stops() {
                self.one.frame.functions.trouble = Some(Trouble::Interrupted);
                return Err(self.failure(0.0));
            }
            let (t, left) = (self.one.frame.t, t_end - self.one.frame.t);
            if rejections == 0 && left <= longest && self.leap(left) {
                break (left, true);
            }
            let step = self.one.control.fit(left, longest);
            let least = self.one.settings.min_step.max(4.0 * f64::EPSILON * t.abs());
            let fits = step > least || (step >= left && rejections == 0);
            if !fits || rejections > MOST_REJECTIONS {
                return Err(self.failure(step));
            }
            if self.attempt(step, left) {
                break (step, step >= left);
            }
            rejections += 1;
        };
        if self.one.first == 0.0 {
            self.one.first = if rejections > 0 { self.one.control.proposed } else { self.one.control.limit(step) };
        }
        let to = if last { t_end } else { self.one.frame.t + step };
        self.arrive(to, last)
    }

    /// Tries to come to the end by one step of the short pair, if that suits it; whether its error
    /// is within the tolerance.
    fn leap(&mut self, left: f64) -> bool {
        let frame = &mut self.one.frame;
        if !self.one.methods.leaps(left, frame) {
            return false;
        }
        frame.h = left;
        let error = self.one.methods.leap(frame, self.system);
        let fits = error <= 1.0 && is_finite(&frame.end_rates);
        frame.error = error;
        frame.functions.counts.error_test_failures += u64::from(!fits);
        fits && self.raise().is_ok()
    }

    /// Sets nonnegative states that are slightly negative at the end of the step to zero.
    ///
    /// # Errors
    /// The place of one that is far below.
    #[inline]
    fn raise(&mut self) -> Result<(), usize> {
        let OneStep { frame, nonnegative, .. } = &mut *self.one;
        nonnegative.begin();
        nonnegative.raise(entries_mut(&mut frame.end, frame.n))
    }

    /// Shortens a step that leads a nonnegative state below zero.
    #[cold]
    fn shorten(&mut self, state: usize) {
        let OneStep { frame, control, .. } = &mut *self.one;
        let [begin, end] = [&frame.begin, &frame.end].map(|y| entries(y, frame.n)[state]);
        control.shorten(frame.h * shorter(begin, end));
        frame.functions.trouble = Some(Trouble::Negative { time: frame.t, state });
        self.one.since_trouble = 0;
    }

    /// Tries a step, of what is left; whether its error is within the tolerance.
    fn attempt(&mut self, step: f64, left: f64) -> bool {
        self.one.frame.h = step;
        let growth = self.one.methods.growth();
        let mut error = self.compute();
        if error <= 1.0 {
            if let Err(state) = self.raise() {
                self.shorten(state);
                return false;
            }
            self.one.frame.evaluate_end(self.system);
            let closed = if is_finite(&self.one.frame.end_rates) { self.close(step >= left) } else { f64::NAN };
            if closed <= 1.0 {
                (self.one.frame.doubtful, self.one.frame.error) = (false, error.max(closed));
                self.one.control.accept(step, error.max(closed), growth);
                return true;
            }
            error = closed;
        }
        if error.is_finite() {
            self.one.frame.functions.counts.error_test_failures += 1;
        } else {
            self.find_trouble();
        }
        self.one.frame.doubtful |= self.one.frame.careful && error > DOUBTFUL;
        self.one.control.reject(step, if error.is_finite() { error } else { f64::INFINITY }, growth);
        false
    }

    /// Solves the equations of the algebraic unknowns at the end of a step. A linearly implicit
    /// step satisfies only their slopes at its beginning, and the error test omits them. Returns
    /// what that changes, in tolerances: the step times the change of the rates, or the unknowns
    /// themselves, of which the polynomial is then as far off. NaN where there is no solution.
    fn close(&mut self, last: bool) -> f64 {
        let OneStep { frame, algebra, inside: [before, rates], longest_interval, .. } = &mut *self.one;
        let Some(algebra) = algebra else { return 0.0 };
        let (n, to) = (frame.n, frame.t + frame.h);
        before.copy_from_slice(&frame.end);
        let off = entries(&frame.end_rates, n);
        if let Err(failure) = algebra.follow(self.system, (to, last), entries_mut(&mut frame.end, n), (off, entries_mut(rates, n))) {
            if let Failure::Noted(trouble) = failure {
                frame.functions.trouble = Some(trouble);
            }
            return f64::NAN;
        }
        let change =
            frame.h * frame.norm_of(|i| std::array::from_fn(|lane| frame.mass[i][lane] * (rates[i][lane] - frame.end_rates[i][lane])));
        let strayed = frame.largest_change(before) / STRAY;
        if change <= 1.0 && strayed > 1.0 && frame.h > SHORT * *longest_interval {
            return strayed;
        }
        frame.end_rates.copy_from_slice(rates);
        change
    }

    #[inline]
    fn compute(&mut self) -> f64 {
        self.one.methods.attempt(&mut self.one.frame, self.system)
    }

    /// Repeats what was not finite with a look at every evaluation.
    #[cold]
    fn find_trouble(&mut self) {
        self.one.frame.functions.counts.not_finite += 1;
        let counts = self.one.frame.functions.counts;
        self.one.frame.functions.trouble = None;
        self.one.frame.functions.checks = true;
        if self.compute() <= 1.0 {
            self.one.frame.evaluate_end(self.system);
        }
        self.one.frame.functions.checks = false;
        self.one.frame.functions.counts = counts;
        self.one.since_trouble = 0;
    }

    /// Goes to the end of an accepted step, and looks there.
    fn arrive(&mut self, to: f64, last: bool) -> Result<Option<Advance>, SolveError> {
        let one = &mut *self.one;
        one.frame.functions.counts.steps += 1;
        one.since_trouble += 1;
        if one.since_trouble > MEMORY || matches!(one.frame.functions.trouble, Some(Trouble::Negative { .. })) {
            one.frame.functions.trouble = None;
        }
        if let Err(unknown) = one.nonnegative.accept() {
            return Err(SolveError::Negative { time: one.frame.t, unknown });
        }
        if one.settings.method == Method::Auto {
            one.choose();
        }
        one.methods.renew(&one.frame);
        let differentiates = one.algebra.is_some() && (last || self.system.roots_use_derivatives());
        if one.integrals.is_some() || differentiates {
            self.prepare();
        }
        self.derive_end(to, differentiates);
        self.record(to);
        self.integrate(to)?;
        let passed = self.looks_passed(to)?;
        if passed {
            self.prepare();
        }
        self.one.step_began = self.one.frame.t;
        self.one.frame.go_on(to);
        self.one.time = to;
        if passed {
            self.locate()?;
            return Ok(Some(Advance::Event));
        }
        Ok(last.then_some(Advance::Reached))
    }

    /// Lets a system that reads its past record the step.
    fn record(&mut self, to: f64) {
        if !self.system.has_past() {
            return;
        }
        self.prepare();
        let OneStep { frame, methods, settings, inside: [y, yp], .. } = &mut *self.one;
        let n = frame.n;
        self.system.record((frame.t, to), settings.rtol, &mut |t, unknowns, rates| {
            methods.interpolate(t, y, Some(&mut **yp));
            unknowns.copy_from_slice(entries(y, n));
            rates.copy_from_slice(entries(yp, n));
        });
    }

    /// Makes the polynomial of the step, once.
    fn prepare(&mut self) {
        self.one.methods.prepare(&mut self.one.frame, self.system);
    }

    /// Derivatives at the end of the step: those of the equations; of algebraic unknowns, where
    /// they are wanted, those of the polynomial.
    fn derive_end(&mut self, to: f64, by_polynomial: bool) {
        let one = &mut *self.one;
        if by_polynomial {
            let [y, _] = &mut one.inside;
            one.methods.interpolate_algebraic(to, y, &mut one.derivative);
        }
        let (rates, mass) = (&one.frame.end_rates, &one.frame.mass);
        for ((derivative, rates), mass) in one.derivative.iter_mut().zip(rates).zip(mass) {
            let algebraic = |lane: usize| if by_polynomial { derivative[lane] } else { 0.0 };
            *derivative = std::array::from_fn(|lane| if mass[lane] == 1.0 { rates[lane] } else { algebraic(lane) });
        }
    }

    /// Takes the integrals over the step up to a time.
    fn integrate(&mut self, to: f64) -> Result<(), SolveError> {
        if let Some(Integrals { rule, values }) = &mut self.one.integrals {
            rule.next_step(self.one.frame.t, values);
        }
        self.take_integrals(to)
    }

    /// Returns `true` if a condition became true in the step that ends here, or inside of it.
    #[inline]
    fn looks_passed(&mut self, to: f64) -> Result<bool, SolveError> {
        let OneStep { frame, events, methods, .. } = &mut *self.one;
        if events.watch.is_empty() {
            return Ok(false);
        }
        if events.watch.is_quiet(to) {
            events.watch.pass(to);
            return Ok(false);
        }
        let Events { bounded, unknowns, fours, enclosure, safe, .. } = events;
        if *bounded {
            let (least, most) = (enclosure.least.as_chunks_mut().0, enclosure.most.as_chunks_mut().0);
            methods.surround(frame, fours, least, most);
            if safe.holds(to, unknowns, (&enclosure.least, &enclosure.most)) {
                return self.passes_safely(to);
            }
        }
        self.looks_at_step(to)
    }

    /// Goes to the end of a step in which no event happens and no equation jumps.
    #[inline]
    fn passes_safely(&mut self, to: f64) -> Result<bool, SolveError> {
        if !self.one.events.watch.has_loose(to) {
            self.one.events.watch.pass(to);
            return Ok(false);
        }
        let from = self.one.frame.t;
        self.one.methods.prepare(&mut self.one.frame, self.system);
        if stays(self, (from, to))? {
            return Ok(self.one.events.watch.accept(to));
        }
        self.looks_closely(to)
    }

    /// The reason to look for kinks that changed their sign in the step that ends here.
    fn closely(&self, to: f64) -> Closely {
        let (one, from) = (&self.one, self.one.frame.t);
        if to - from > SHORT_STEP * one.longest_interval {
            return if one.methods.may_miss_kinks(&one.frame) { Closely::Doubt } else { Closely::No };
        }
        let may_tie = from >= one.events.watch.loose_until && one.events.watch.ties < MOST_TIES;
        if may_tie { Closely::Ties } else { Closely::No }
    }

    /// The same where the step leaves what is known to be safe.
    fn looks_at_step(&mut self, to: f64) -> Result<bool, SolveError> {
        let OneStep { frame, events, .. } = &mut *self.one;
        let Events { watch, bounded, unknowns, enclosure, safe, .. } = events;
        let (n, from) = (frame.n, frame.t);
        if *bounded && let Some((span, least, most)) = safe.beyond((from, to), unknowns, (&enclosure.least, &enclosure.most)) {
            self.system.root_bounds(span, &least[..n], &most[..n], &mut watch.bounds);
            let is_safe = watch.is_safe();
            safe.tried(is_safe.then_some(span.1), &watch.edges);
            if is_safe {
                return self.passes_safely(to);
            }
        }
        self.looks_closely(to)
    }

    /// The same by the bounds over the step itself.
    fn looks_closely(&mut self, to: f64) -> Result<bool, SolveError> {
        let closely = self.closely(to);
        let OneStep { frame, events, derivative, methods, .. } = &mut *self.one;
        let Events { watch, bounded, fours, enclosure, .. } = events;
        let (n, from) = (frame.n, frame.t);
        watch.begin_step();
        self.system.roots(to, entries(&frame.end, n), entries(derivative, n), &mut watch.values);
        if !*bounded {
            return Ok(watch.accept(to));
        }
        methods.enclose(frame, fours, enclosure.least.as_chunks_mut().0, enclosure.most.as_chunks_mut().0);
        self.system.root_bounds((from, to), &enclosure.least[..n], &enclosure.most[..n], &mut watch.bounds);
        let open = watch.what_is_open(closely);
        if open == Open::Nothing && !watch.has_unbounded() {
            return Ok(watch.accept(to));
        }
        self.search(to, (open, closely))
    }

    /// Looks for what happens inside of the step that ends here.
    #[cold]
    fn search(&mut self, to: f64, open: (Open, Closely)) -> Result<bool, SolveError> {
        let OneStep { frame, events: Events { watch, unknowns, enclosure, .. }, methods, .. } = &mut *self.one;
        let (n, from) = (frame.n, frame.t);
        let end = entries(&frame.end, n);
        for at in unknowns.iter().map(|&at| at as usize) {
            let tolerance = 1.0 / frame.reciprocal_tolerance(at);
            (enclosure.least[at], enclosure.most[at]) = (end[at] - tolerance, end[at] + tolerance);
        }
        self.system.root_bounds((to, to), &enclosure.least[..n], &enclosure.most[..n], &mut watch.bounds);
        methods.prepare(frame, self.system);
        looks_into(self, (from, to), open)
    }
}

impl Inside for Run<'_> {
    type Error = SolveError;

    fn watch(&mut self) -> &mut Watch {
        &mut self.one.events.watch
    }

    fn bound(&mut self, from: f64, to: f64) -> Result<(), SolveError> {
        let OneStep { frame, events: Events { watch, enclosure, .. }, methods, pace, .. } = &mut *self.one;
        if pace.stops() {
            self.one.frame.functions.trouble = Some(Trouble::Interrupted);
            return Err(self.failure(0.0));
        }
        let n = frame.n;
        enclosure.bound(methods.degree(), (from, to), |t, values| {
            methods.interpolate(t, values.as_chunks_mut().0, None);
            Ok::<_, SolveError>(())
        })?;
        self.system.root_bounds((from, to), &enclosure.least[..n], &enclosure.most[..n], &mut watch.bounds);
        Ok(())
    }

    fn look(&mut self, t: f64) -> Result<(), SolveError> {
        let OneStep { frame, events: Events { watch, .. }, derivative, methods, inside: [y, yp], .. } = &mut *self.one;
        let n = frame.n;
        if t >= frame.t + frame.h {
            self.system.roots(t, entries(&frame.end, n), entries(derivative, n), &mut watch.values);
        } else {
            methods.interpolate(t, y, Some(&mut *yp));
            self.system.roots(t, entries(y, n), entries(yp, n), &mut watch.values);
        }
        Ok(())
    }
}

impl OneStep {
    /// Goes on with the other method where that would have served better.
    fn choose(&mut self) {
        if self.methods.choose(&self.frame) {
            self.control = Control::begin(self.control.proposed);
        }
    }
}

impl Traverse for Run<'_> {
    fn time(&self) -> f64 {
        self.one.time
    }

    fn longest_interval(&self) -> f64 {
        self.one.longest_interval
    }

    fn max_steps(&self) -> u32 {
        self.one.settings.max_steps
    }

    fn next_break(&mut self, t: f64) -> Result<f64, SolveError> {
        Ok(self.system.next_break(t))
    }

    fn note_break(&mut self, at: f64) -> Result<(), SolveError> {
        self.system.crosses(at);
        Ok(())
    }

    fn cross(&mut self, to: f64) -> Result<(), SolveError> {
        self.one.time = to;
        // A step that ended at a switch says nothing of what comes.
        if self.one.control.proposed < TINY * self.one.longest_interval {
            self.one.control = Control::default();
        }
        self.initialise(to, false)?;
        self.one.frame.functions.counts.restarts += 1;
        self.one.phase = Phase::Restarted;
        Ok(())
    }

    fn solve(&mut self, t_end: f64) -> Result<Advance, SolveError> {
        let (interval, fresh) = (t_end - self.one.time, self.one.phase == Phase::Restarted);
        self.one.longest_interval = self.one.longest_interval.max(interval);
        if fresh && self.settle()? {
            return Ok(Advance::Event);
        }
        if interval == 0.0 {
            return Ok(Advance::Reached);
        }
        let course = self.look_inside(interval)?;
        self.one.frame.careful = matches!(course, Course::Structured(_));
        // Steps have to be longer than time is rounded.
        let shortest = SHORTEST * f64::EPSILON * (self.one.time.abs() + t_end.abs());
        let longest = course.longest_step(interval).max(shortest).min(self.one.settings.max_step).min(self.system.longest_step());
        if fresh {
            self.begin(interval, course.longest_first_step(interval).min(longest));
        }
        self.one.phase = Phase::Running;
        for _ in 0..self.one.settings.max_steps {
            if let Some(advance) = self.step(t_end, longest.min(self.system.longest_step()))? {
                return Ok(advance);
            }
        }
        let unknown = self.one.methods.unknown_to_blame(&mut self.one.frame);
        let (time, steps) = (self.one.time, self.one.settings.max_steps);
        Err(match self.one.frame.functions.trouble {
            Some(_) => self.failure(0.0),
            None => SolveError::TooManySteps { time, steps, unknown, event: None },
        })
    }

    fn watched(&mut self) -> (&mut Watch, &mut [c_int]) {
        (&mut self.one.events.watch, &mut self.one.events.fired)
    }

    fn evaluate_roots(&mut self, t: f64) -> Result<(), SolveError> {
        let OneStep { frame, events: Events { watch, .. }, derivative, .. } = &mut *self.one;
        self.system.roots(t, frame.y(), entries(derivative, frame.n), &mut watch.values);
        Ok(())
    }

    fn evaluate_along(&mut self, ahead: f64, consistently: bool) -> Result<(), SolveError> {
        let OneStep { frame, events: Events { watch, .. }, derivative, inside: [later, rate], algebra, time, .. } = &mut *self.one;
        set(later, |i, lane| frame.begin[i][lane] + ahead * derivative[i][lane]);
        rate.copy_from_slice(derivative);
        let (n, t) = (frame.n, *time + ahead);
        if let Some(algebra) = algebra.as_mut().filter(|_| consistently) {
            // Where there is no solution ahead, the present algebraic unknowns have to do.
            let _ = algebra.solve(self.system, t, entries_mut(later, n), entries_mut(rate, n));
        }
        self.system.roots(t, entries(later, n), entries(rate, n), &mut watch.ahead);
        Ok(())
    }

    fn evaluate_moved(&mut self, time: f64, factor: &dyn Fn(usize) -> f64) -> Result<(), SolveError> {
        let OneStep { frame, events: Events { watch, .. }, derivative, inside: [moved, _], .. } = &mut *self.one;
        set(moved, |i, lane| frame.begin[i][lane] * factor(4 * i + lane));
        self.system.roots(time, entries(moved, frame.n), entries(derivative, frame.n), &mut watch.ahead);
        Ok(())
    }

    fn interpolate(&mut self, t: f64) -> Result<(), SolveError> {
        let OneStep { frame, derivative, methods, algebra, nonnegative, inside: [_, rates], .. } = &mut *self.one;
        methods.interpolate(t, &mut frame.begin, Some(&mut *derivative));
        nonnegative.clip(frame.y_mut());
        if let Some(algebra) = algebra {
            // The polynomial meets their equations to the tolerance only. Where there is no
            // solution, it has to do.
            let n = frame.n;
            let _ = algebra.solve(self.system, t, frame.y_mut(), entries_mut(rates, n));
        }
        Ok(())
    }

    fn take_integrals(&mut self, to: f64) -> Result<(), SolveError> {
        let OneStep { frame, methods, integrals, inside: [y, yp], .. } = &mut *self.one;
        let (n, system) = (frame.n, &mut *self.system);
        let Some(Integrals { rule, values }) = integrals else { return Ok(()) };
        let derivatives = system.integrands_read_rates();
        rule.take(to, values, |t, rates| {
            methods.interpolate(t, y, derivatives.then_some(&mut **yp));
            system.quadratures(t, entries(y, n), entries(yp, n), rates);
            Ok(())
        })
    }

    fn derive(&mut self) -> Result<(), SolveError> {
        let OneStep { frame, derivative, inside: [place, rates], algebra, time, .. } = &mut *self.one;
        let n = frame.n;
        let Some(algebra) = algebra else {
            frame.functions.rates(self.system, *time, &frame.begin, derivative);
            return Ok(());
        };
        place.copy_from_slice(&frame.begin);
        if algebra.solve(self.system, *time, entries_mut(place, n), entries_mut(rates, n)).is_ok() {
            derivative.copy_from_slice(rates);
        }
        Ok(())
    }

    fn stop_at(&mut self, t: f64) {
        self.one.time = t;
        self.one.phase = Phase::Idle;
    }

    fn steps_tried(&self) -> u64 {
        self.one.frame.functions.counts.tried()
    }

    fn reports_jumps(&self) -> bool {
        self.one.events.reports_jumps
    }

    fn go_along(&mut self, ahead: f64) {
        let OneStep { frame, derivative, .. } = &mut *self.one;
        for ((y, rate), mass) in frame.begin.iter_mut().zip(derivative.iter()).zip(&frame.mass) {
            *y = std::array::from_fn(|lane| y[lane] + ahead * mass[lane] * rate[lane]);
        }
    }

    fn unknown_mut(&mut self, at: usize) -> &mut f64 {
        &mut self.one.frame.y_mut()[at]
    }

    fn tolerance(&self, at: usize) -> f64 {
        1.0 / self.one.frame.reciprocal_tolerance(at)
    }

    fn watched_unknown(&self, number: usize) -> Option<usize> {
        self.system.watched_unknowns().get(number).map(|&at| at as usize)
    }

    fn is_explicit(&self) -> bool {
        true
    }

    fn begins_safely(&mut self) -> Result<bool, SolveError> {
        let OneStep { frame, events: Events { watch, bounded, unknowns, safe, .. }, .. } = &mut *self.one;
        if !*bounded {
            return Ok(false);
        }
        safe.take_inputs(self.system);
        Ok(safe.begin(unknowns, frame.y(), watch))
    }

    fn is_safe(&mut self, ahead: f64) -> bool {
        let OneStep { frame, events: Events { watch, bounded, unknowns, safe, .. }, derivative, .. } = &*self.one;
        let state = (frame.y(), entries(derivative, frame.n));
        *bounded && !watch.has_loose(f64::INFINITY) && safe.contains_along((frame.t, ahead), unknowns, state)
    }

    fn step_began(&self) -> Option<f64> {
        Some(self.one.step_began)
    }
}

/// Returns `true` if all numbers are finite.
fn is_finite(x: &[Quad]) -> bool {
    sum(x.len(), |i, lane| x[i][lane] * 0.0) == 0.0
}
