//! Callbacks of IDA: the system's functions, the error weights, the linear solver and the message
//! handler.
//!
//! All of them find their data in one [`Bridge`], whose address IDA holds as user data. No panic
//! leaves a callback (it would end the process); it is caught, noted and returned as a failure.

mod entry;
mod history;
mod message;

use std::os::raw::c_int;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::NonNull;
use std::rc::Rc;

use super::inside::{Inside, looks_into, stays};
use super::kernels::Block;
use super::linear::Factorisation;
use super::linear::columns::all_finite;
use super::newton::Newton;
use super::nonnegative::Nonnegative;
use super::sundials::Inquiry;
use super::vector::{self, Content, Handle, Operations, Shared, Vector};
use super::watch::{Closely, Open, Watch};
use super::{Following, Statistics, System};
use crate::interrupt::Pace;
pub(crate) use entry::{error_weights, jacobian, linear_solver, matrix, quadratures, residual};
pub(crate) use history::History;
pub(crate) use message::{Message, message};

/// Returned to IDA: try again with a smaller step.
const RECOVERABLE: c_int = 1;

/// Returned to IDA: give up.
const FATAL: c_int = -1;

/// Accepted steps after which a failed evaluation no longer counts as the cause of a later end.
const MEMORY: u32 = 10;

/// Steps in a row at the roundoff of time after which the integration is given up.
const TINY_STEPS: u32 = 20;

/// Failure of a callback.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Trouble {
    /// This row of the residual is not finite.
    Residual { time: f64, row: usize },
    /// This entry of the Jacobian's pattern is not finite.
    Jacobian { time: f64, entry: usize },
    /// The Newton matrix is singular.
    Singular { time: f64, column: Option<usize> },
    /// The steps came down to the roundoff of time.
    TinySteps { step: f64 },
    /// This nonnegative state would become negative.
    Negative { time: f64, state: usize },
    /// A function of the system panicked.
    Panic,
    /// An interrupt requests the computation to stop.
    Interrupted,
}

/// The lent system.
#[derive(Default)]
struct Lender {
    system: Option<NonNull<dyn System>>,
    pace: Pace,
}

/// Tolerances of the error test.
pub(crate) struct Tolerances {
    rtol: f64,
    /// Absolute ones, filled up with infinity.
    atol: Box<[Block]>,
}

impl Tolerances {
    /// Those of unknowns.
    pub(crate) fn new(rtol: f64, atol: &[f64]) -> Self {
        let mut blocks = vector::zeroed_blocks(atol.len());
        let all = blocks.iter_mut().flat_map(|block| block.0.iter_mut());
        let filled = atol.iter().copied().chain(std::iter::repeat(f64::INFINITY));
        all.zip(filled).for_each(|(to, from)| *to = from);
        Self { rtol, atol: blocks }
    }
}

/// The steps that were accepted last.
#[derive(Default)]
struct Steps {
    since_trouble: u32,
    /// So many in a row were tiny.
    tiny: u32,
    /// Length of the last one that was followed by another.
    last: f64,
}

/// Data of the callbacks.
pub(crate) struct Bridge {
    lender: Lender,
    /// IDA's, where there is one.
    memory: Option<Inquiry>,
    pub operations: Operations,
    /// Shared data of IDA's vectors.
    pub shared: Rc<Shared>,
    tolerances: Tolerances,
    /// Entries of the Newton matrix.
    pub values: Box<[f64]>,
    pub factorisation: Factorisation,
    pub newton: Newton,
    pub nonnegative: Nonnegative,
    pub watch: Watch,
    /// Derivatives at the accepted state, where root functions look at them.
    pub derivative: Option<Vector>,
    /// The last accepted steps, where bounds of root functions are known.
    pub history: Option<Box<History>>,
    pub counts: Statistics,
    pub trouble: Option<Trouble>,
    steps: Steps,
}

impl Bridge {
    /// A bridge for a system with so many entries in its Jacobian.
    pub(super) fn new(
        operations: Operations,
        tolerances: Tolerances,
        entries: usize,
        factorisation: Factorisation,
        newton: Newton,
        nonnegative: Nonnegative,
        watch: Watch,
    ) -> Self {
        Self {
            lender: Lender::default(),
            memory: None,
            operations,
            shared: Rc::default(),
            tolerances,
            values: vec![0.0; entries].into_boxed_slice(),
            factorisation,
            newton,
            nonnegative,
            watch,
            derivative: None,
            history: None,
            counts: Statistics::default(),
            trouble: None,
            steps: Steps::default(),
        }
    }

    /// IDA's memory, of which the callbacks ask how far it is.
    pub(crate) fn set_memory(&mut self, memory: Inquiry) {
        self.memory = Some(memory);
    }

    /// Lends the system to the callbacks until [`take_back`](Self::take_back).
    ///
    /// # Safety
    /// The system is taken back before the borrow ends.
    pub(crate) unsafe fn lend(&mut self, system: &mut dyn System) {
        let system: NonNull<dyn System + '_> = NonNull::from(system);
        // SAFETY: only the lifetime changes; by the contract no code has the pointer when the
        // borrow ends.
        self.lender.system = Some(unsafe { std::mem::transmute::<NonNull<dyn System + '_>, NonNull<dyn System>>(system) });
    }

    pub(crate) fn take_back(&mut self) {
        self.lender.system = None;
    }

    /// Clears what belongs to the time before a call of IDA.
    pub(super) fn begin(&mut self) {
        self.trouble = None;
        self.steps.tiny = 0;
    }

    /// Length of the last step that was followed by another.
    pub(crate) fn last_step(&self) -> f64 {
        self.steps.last
    }

    fn note(&mut self, trouble: Trouble) {
        // What follows an interruption is not what ended the integration.
        if self.trouble != Some(Trouble::Interrupted) {
            self.trouble = Some(trouble);
        }
        self.steps.since_trouble = 0;
    }

    /// Runs `call` on the system; no panic gets out.
    fn guarded(&mut self, call: impl FnOnce(&mut dyn System)) -> Result<(), c_int> {
        let Some(mut system) = self.lender.system else {
            return Err(FATAL);
        };
        if self.lender.pace.stops() {
            self.note(Trouble::Interrupted);
            return Err(FATAL);
        }
        // SAFETY: the lender holds the exclusive borrow as long as the pointer is here.
        let system = unsafe { system.as_mut() };
        catch_unwind(AssertUnwindSafe(|| call(system))).map_err(|_| self.panicked())
    }

    /// Evaluates the residual at `y`, `yp` into `out`; whether it is finite is left open.
    pub(super) fn evaluate(&mut self, time: f64, y: &Content, yp: &Content, out: &mut Content) -> Result<(), c_int> {
        self.counts.residuals += 1;
        self.guarded(|system| system.residual(time, y.entries(), yp.entries(), out.entries_mut()))
    }

    /// Evaluates the Jacobian at a state into `values`; whether it is finite is left open.
    pub(super) fn jacobian_at(&mut self, time: f64, cj: f64, (y, yp): (&Content, &Content), values: &mut [f64]) -> Result<(), c_int> {
        self.counts.jacobians += 1;
        self.guarded(|system| system.jacobian(time, y.entries(), yp.entries(), cj, values))
    }

    /// The residual of derivatives along directions, see [`System::following`].
    pub(super) fn following(&mut self, at: Following<'_>, s: (&[f64], &[f64]), out: &mut [f64]) -> Result<(), c_int> {
        self.guarded(|system| system.following(at, s, out))
    }

    /// Quantities that move them, see [`System::moving`].
    pub(super) fn moving(&mut self, at: Following<'_>, rates: &mut [f64]) -> Result<(), c_int> {
        self.guarded(|system| system.moving(at, rates))
    }

    /// Returns `true` if an integrand reads derivatives of the unknowns.
    pub(super) fn integrands_read_rates(&mut self) -> Result<bool, c_int> {
        let mut reads = false;
        self.guarded(|system| reads = system.integrands_read_rates())?;
        Ok(reads)
    }

    /// Derivatives of the integrands along directions.
    pub(super) fn following_integrands(
        &mut self,
        t: f64,
        (y, yp): (&Content, &Content),
        s: (&[f64], &[f64]),
        out: &mut [f64],
    ) -> Result<(), c_int> {
        self.guarded(|system| system.following_integrands(t, (y.entries(), yp.entries()), s, out))
    }

    /// Returns `true` if a residual is finite; notes the trouble if it is not.
    pub(super) fn is_finite(&mut self, time: f64, residual: &Content) -> bool {
        if self.operations.all_finite(residual.blocks()) {
            return true;
        }
        let row = residual.entries().iter().position(|x| !x.is_finite()).unwrap_or(0);
        self.note_not_finite(time, row);
        false
    }

    /// Evaluates the residual at `y`, `yp` into `out`; an error if it is not finite.
    pub(super) fn residual(&mut self, time: f64, y: &Content, yp: &Content, out: &mut Content) -> Result<(), c_int> {
        self.evaluate(time, y, yp, out)?;
        if self.is_finite(time, out) { Ok(()) } else { Err(RECOVERABLE) }
    }

    /// Evaluates the Jacobian into `values`.
    pub(super) fn jacobian(&mut self, time: f64, cj: f64, y: &Content, yp: &Content) -> Result<(), c_int> {
        self.counts.jacobians += 1;
        let mut values = std::mem::take(&mut self.values);
        let done = self.guarded(|system| system.jacobian(time, y.entries(), yp.entries(), cj, &mut values));
        self.values = values;
        done?;
        if all_finite(&self.values) {
            return Ok(());
        }
        let entry = self.values.iter().position(|x| !x.is_finite()).unwrap_or(0);
        self.note(Trouble::Jacobian { time, entry });
        Err(RECOVERABLE)
    }

    /// Evaluates the Jacobian into `values`, of which only these entries must be finite.
    pub(super) fn jacobian_of(&mut self, entries: &[usize], time: f64, y: &Content, yp: &Content) -> Result<(), c_int> {
        let mut values = std::mem::take(&mut self.values);
        let done = self.jacobian_at(time, 0.0, (y, yp), &mut values);
        self.values = values;
        done?;
        match entries.iter().find(|&&entry| !self.values[entry].is_finite()) {
            None => Ok(()),
            Some(&entry) => {
                self.note(Trouble::Jacobian { time, entry });
                Err(RECOVERABLE)
            }
        }
    }

    /// Notes that an equation is not finite.
    pub(super) fn note_not_finite(&mut self, time: f64, row: usize) {
        self.counts.not_finite += 1;
        self.note(Trouble::Residual { time, row });
    }

    /// The first time from `t` on at which the equations change their form.
    pub(super) fn next_break(&mut self, t: f64) -> Result<f64, c_int> {
        let mut next = f64::INFINITY;
        self.guarded(|system| next = system.next_break(t))?;
        Ok(next)
    }

    /// Calls a function of a system that reads its past.
    pub(super) fn with_past(&mut self, call: impl FnOnce(&mut dyn System)) -> Result<(), c_int> {
        self.guarded(call)
    }

    /// The longest step in which the equations read nothing of the step itself.
    pub(super) fn longest_step(&mut self) -> Result<f64, c_int> {
        let mut longest = f64::INFINITY;
        self.guarded(|system| longest = system.longest_step())?;
        Ok(longest)
    }

    /// Lets a system that reads its past record the last step.
    pub(super) fn record(&mut self, span: (f64, f64), rtol: f64, (y, yp): (&mut Vector, &mut Vector)) -> Result<(), c_int> {
        let Some(memory) = self.memory.take() else { return Err(FATAL) };
        let mut known = true;
        let done = self.guarded(|system| {
            system.record(span, rtol, &mut |t, unknowns, rates| {
                known &= memory.interpolate(t, 0, y).is_ok() && memory.interpolate(t, 1, yp).is_ok();
                unknowns.copy_from_slice(y.entries());
                rates.copy_from_slice(yp.entries());
            });
        });
        self.memory = Some(memory);
        if known { done } else { Err(FATAL) }
    }

    /// Evaluates what time itself moves into `out`.
    pub(super) fn forcings(&mut self, t: f64, y: &Content, yp: &Content, out: &mut [f64]) -> Result<(), c_int> {
        self.guarded(|system| system.forcings(t, y.entries(), yp.entries(), out))
    }

    /// Evaluates the integrands into `out`.
    pub(crate) fn integrands(&mut self, t: f64, y: &Content, yp: &Content, out: &mut [f64]) -> Result<(), c_int> {
        self.guarded(|system| system.quadratures(t, y.entries(), yp.entries(), out))
    }

    /// Evaluates the root functions at a state.
    pub(crate) fn evaluate_roots(&mut self, t: f64, y: &[f64], yp: &[f64]) -> Result<(), c_int> {
        let mut values = std::mem::take(&mut self.watch.values);
        let done = self.guarded(|system| system.roots(t, y, yp, &mut values));
        self.watch.values = values;
        done
    }

    /// Evaluates them at a state a little later.
    pub(crate) fn evaluate_roots_ahead(&mut self, t: f64, y: &[f64], yp: &[f64]) -> Result<(), c_int> {
        let mut values = std::mem::take(&mut self.watch.ahead);
        let done = self.guarded(|system| system.roots(t, y, yp, &mut values));
        self.watch.ahead = values;
        done
    }

    /// Looks at the root functions at the end of the step that was just accepted, and inside of it;
    /// whether a condition has become true. IDA keeps y' in its history.
    pub(super) fn has_passed_in_step(&mut self, t: f64, y: &[f64]) -> Result<bool, c_int> {
        if self.watch.is_empty() {
            return Ok(false);
        }
        let Some(mut history) = self.history.take() else {
            self.evaluate_roots_in_step(t, y)?;
            return Ok(self.watch.accept(t));
        };
        let passed = self.look_into_step(&mut history, t, y);
        self.history = Some(history);
        passed
    }

    /// Evaluates the root functions at a time within the last step, where unknowns are these.
    fn evaluate_roots_in_step(&mut self, t: f64, y: &[f64]) -> Result<(), c_int> {
        let Some(mut derivative) = self.derivative.take() else { return self.evaluate_roots(t, y, y) };
        let evaluated = match self.interpolate(t, 1, &mut derivative) {
            Ok(()) => self.evaluate_roots(t, y, derivative.entries()),
            Err(_) => Err(FATAL),
        };
        self.derivative = Some(derivative);
        evaluated
    }

    fn look_into_step(&mut self, history: &mut History, t: f64, y: &[f64]) -> Result<bool, c_int> {
        if !history.push(t, y) {
            self.evaluate_roots_in_step(t, y)?;
            return Ok(self.watch.accept(t));
        }
        if self.watch.is_quiet(t) {
            self.watch.pass(t);
            return Ok(false);
        }
        let from = history.step_began();
        history.surround();
        if history.safe.holds(t, &history.unknowns, (&history.least, &history.most)) || self.is_safe_beyond(history, (from, t))? {
            if !self.watch.has_loose(t) {
                self.watch.pass(t);
                return Ok(false);
            }
            if stays(&mut Within { bridge: self, history }, (from, t))? {
                return Ok(self.watch.accept(t));
            }
        }
        history.enclose_step(self.memory.as_ref().map_or(0, Inquiry::last_order));
        self.watch.begin_step();
        self.evaluate_roots_in_step(t, y)?;
        self.bound_roots(history, (from, t))?;
        let open = self.watch.what_is_open(Closely::No);
        if open == Open::Nothing && !self.watch.has_unbounded() {
            return Ok(self.watch.accept(t));
        }
        history.enclose_tolerances(|unknown, value| self.tolerance(unknown, value));
        self.bound_roots(history, (t, t))?;
        looks_into(&mut Within { bridge: self, history }, (from, t), (open, Closely::No))
    }

    /// Returns whether an integration begins where nothing can happen, see
    /// [`Safe::begin`](super::safe::Safe::begin).
    pub(super) fn begins_safely(&mut self, y: &[f64]) -> Result<bool, c_int> {
        let Some(mut history) = self.history.take() else { return Ok(false) };
        let taken = self.guarded(|system| history.safe.take_inputs(system));
        let begins = history.safe.begin(&history.unknowns, y, &mut self.watch);
        self.history = Some(history);
        taken.map(|()| begins)
    }

    /// Returns whether nothing can happen at a state and for a time ahead along its derivatives.
    pub(super) fn is_safe(&self, times: (f64, f64), state: (&[f64], &[f64])) -> bool {
        let holds = |history: &History| history.safe.contains_along(times, &history.unknowns, state);
        !self.watch.has_loose(f64::INFINITY) && self.history.as_deref().is_some_and(holds)
    }

    /// Returns `true` if nothing can happen in a box that reaches beyond the last step.
    fn is_safe_beyond(&mut self, history: &mut History, step: (f64, f64)) -> Result<bool, c_int> {
        let History { safe, unknowns, least, most, .. } = history;
        let Some((span, least, most)) = safe.beyond(step, unknowns, (least, most)) else { return Ok(false) };
        let mut bounds = std::mem::take(&mut self.watch.bounds);
        let done = self.guarded(|system| {
            system.root_bounds(span, least, most, &mut bounds);
        });
        self.watch.bounds = bounds;
        done?;
        let is_safe = self.watch.is_safe();
        safe.tried(is_safe.then_some(span.1), &self.watch.edges);
        Ok(is_safe)
    }

    /// Bounds of the root functions over the box of the history.
    fn bound_roots(&mut self, history: &History, span: (f64, f64)) -> Result<(), c_int> {
        let mut bounds = std::mem::take(&mut self.watch.bounds);
        let done = self.guarded(|system| {
            system.root_bounds(span, &history.least, &history.most, &mut bounds);
        });
        self.watch.bounds = bounds;
        done
    }

    /// The unknowns' derivatives of this order at a time within IDA's last step.
    pub(crate) fn interpolate(&self, t: f64, order: c_int, to: &mut Handle) -> Result<(), c_int> {
        self.memory.as_ref().map_or(Err(FATAL), |memory| memory.interpolate(t, order, to))
    }

    /// Solves with the factorised matrix in place.
    fn solve(&mut self, x: &mut [f64]) -> c_int {
        self.counts.linear_solves += 1;
        match catch_unwind(AssertUnwindSafe(|| self.factorisation.solve(x))) {
            Ok(()) => 0,
            Err(_) => self.panicked(),
        }
    }

    /// Error weights at `y`, and a look at the step that led there.
    ///
    /// # Safety
    /// The weights are IDA's own, so that they live as long as it works on vectors.
    unsafe fn weigh(&mut self, y: &Content, weights: &mut Handle) -> c_int {
        let weighed = catch_unwind(AssertUnwindSafe(|| {
            self.error_weights(y, weights);
            // SAFETY: by the contract; they have the length of all of IDA's vectors.
            unsafe { self.shared.renew(weights) };
            code(self.step_accepted(y.entries()))
        }));
        weighed.unwrap_or_else(|_| self.panicked())
    }

    /// The tolerance of an unknown.
    pub(crate) fn tolerance(&self, unknown: usize, value: f64) -> f64 {
        let width = self.tolerances.atol[0].0.len();
        self.tolerances.rtol * value.abs() + self.tolerances.atol[unknown / width].0[unknown % width]
    }

    /// A part of an unknown in its relative tolerance.
    pub(crate) fn in_tolerances(&self, part: f64) -> f64 {
        if self.tolerances.rtol > 0.0 { part / self.tolerances.rtol } else { 0.0 }
    }

    /// Error weights at `y`: reciprocal tolerances.
    pub(crate) fn error_weights(&self, y: &Content, weights: &mut Content) {
        self.operations.error_weights(self.tolerances.rtol, y, &self.tolerances.atol, weights);
    }

    /// Notes that a nonnegative state would become negative.
    pub(super) fn note_negative(&mut self, time: f64, state: usize) {
        self.note(Trouble::Negative { time, state });
    }

    /// Notes a panic, which is not to leave a callback.
    pub(crate) fn panicked(&mut self) -> c_int {
        self.note(Trouble::Panic);
        FATAL
    }

    /// Factorises the matrix.
    pub(super) fn factorise(&mut self) -> c_int {
        self.counts.factorisations += 1;
        match catch_unwind(AssertUnwindSafe(|| self.factorisation.factorise(&self.values))) {
            Err(_) => self.panicked(),
            Ok(Ok(())) => 0,
            Ok(Err(singular)) => {
                let time = self.memory.as_ref().map_or(0.0, Inquiry::current_time);
                self.note(Trouble::Singular { time, column: singular.column });
                RECOVERABLE
            }
        }
    }

    /// Looks at the step that was just accepted; an error when the steps have become too small to
    /// get anywhere, or an event lies in the step.
    fn step_accepted(&mut self, y: &[f64]) -> Result<(), c_int> {
        let (step, time) = self.memory.as_ref().map_or((0.0, 0.0), |memory| (memory.last_step(), memory.current_time()));
        if step > 0.0 {
            self.steps.last = step;
            self.steps.since_trouble += 1;
            // A step that was cut short of zero has led further.
            if self.steps.since_trouble > MEMORY || matches!(self.trouble, Some(Trouble::Negative { .. })) {
                self.trouble = None;
            }
            if let Err(state) = self.nonnegative.accept() {
                self.note_negative(time, state);
                return Err(FATAL);
            }
        }
        let tiny = step > 0.0 && step <= 4.0 * f64::EPSILON * time.abs();
        self.steps.tiny = if tiny { self.steps.tiny + 1 } else { 0 };
        if step > 0.0 && self.has_passed_in_step(time, y)? {
            return Err(FATAL);
        }
        if self.steps.tiny < TINY_STEPS {
            return Ok(());
        }
        // Where equations stopped being finite, that is the cause.
        self.trouble.get_or_insert(Trouble::TinySteps { step });
        Err(FATAL)
    }
}

/// The step that IDA accepted last.
struct Within<'a> {
    bridge: &'a mut Bridge,
    history: &'a mut History,
}

impl Inside for Within<'_> {
    type Error = c_int;

    fn watch(&mut self) -> &mut Watch {
        &mut self.bridge.watch
    }

    fn bound(&mut self, from: f64, to: f64) -> Result<(), c_int> {
        self.history.enclose((from, to));
        self.bridge.bound_roots(self.history, (from, to))
    }

    fn look(&mut self, t: f64) -> Result<(), c_int> {
        self.bridge.interpolate(t, 0, &mut self.history.inside).map_err(|_| FATAL)?;
        self.bridge.evaluate_roots_in_step(t, self.history.inside.entries())
    }
}

fn code(result: Result<(), c_int>) -> c_int {
    result.err().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::super::sundials::Context;
    use super::super::{LinearSolver, Pattern};
    use super::*;

    /// A bridge whose matrix has no values: to factorise it panics, and so does a solve with a
    /// vector that is too short.
    fn bridge() -> Bridge {
        let operations = Operations::detect();
        let factorisation = Factorisation::new(&Pattern::full(2), LinearSolver::Dense).expect("a factorisation");
        let newton = Newton::new(2, operations, &Context::new().expect("a context"));
        let tolerances = Tolerances::new(1e-6, &[1e-6, 1e-6]);
        Bridge::new(operations, tolerances, 0, factorisation, newton, Nonnegative::default(), Watch::new(0, &[]))
    }

    #[test]
    fn a_panic_leaves_no_callback() {
        let mut bridge = bridge();
        assert_eq!(bridge.factorise(), FATAL);
        assert_eq!(bridge.trouble, Some(Trouble::Panic));
        bridge.begin();
        assert_eq!(bridge.solve(&mut []), FATAL);
        assert_eq!(bridge.trouble, Some(Trouble::Panic));
    }
}
