//! The functions of a compiled model, with their lengths checked.

use super::CompiledModel;
use crate::functions::{Function, finish_len, start_conditions, steady_len};
use crate::interpret::{Tape, View};
use crate::layout::Memory;

/// Checked memory of a call.
struct Call<'a> {
    t: f64,
    factor: f64,
    y: *mut f64,
    yp: *const f64,
    memory: &'a mut Memory,
    out: *mut f64,
}

impl CompiledModel {
    /// Panics if a vector has the wrong length: compiled code does not check.
    #[track_caller]
    fn check(&self, m: &Memory, y: &[f64], yp: &[f64]) {
        self.check_memory(m);
        assert_eq!(y.len(), self.unknowns(), "length of y");
        assert_eq!(yp.len(), self.unknowns(), "length of y'");
    }

    #[track_caller]
    fn check_memory(&self, m: &Memory) {
        assert_eq!(m.layout().len(), self.layout.len(), "memory of another model");
    }

    // A call may take a few nanoseconds only: it stays in registers up to the code.
    #[inline(always)]
    fn call(&self, function: Function, call: Call<'_>) {
        let Call { t, factor, y, yp, memory, out } = call;
        let Some(code) = self.functions[function as usize] else {
            return self.call_pieces(function, Call { t, factor, y, yp, memory, out });
        };
        let work = memory.all_mut().as_mut_ptr();
        // SAFETY: the code stays within the lengths of `y`, `y'`, output and workspace that it was
        // generated for. `schedule::blocks` checks every address against its variable's extent, and
        // the public functions assert those lengths. Null is passed for memory that the code does
        // not touch. It writes to output and workspace, which are borrowed exclusively, and to `y`
        // only in functions that take it mutably.
        unsafe { code(t, factor, y, yp, work, out, &raw const self.surroundings) }
    }

    /// Functions of several pieces, which are long.
    #[cold]
    #[inline(never)]
    fn call_pieces(&self, function: Function, call: Call<'_>) {
        let work = call.memory.all_mut().as_mut_ptr();
        for code in &self.pieces[function as usize] {
            // SAFETY: as in `call`: the pieces together are the one function.
            unsafe { code(call.t, call.factor, call.y, call.yp, work, call.out, &raw const self.surroundings) }
        }
    }

    #[inline(always)]
    fn evaluate(&self, function: Function, memory: &mut Memory, (t, factor): (f64, f64), (y, yp): (&[f64], &[f64]), out: &mut [f64]) {
        self.check(memory, y, yp);
        let call = Call { t, factor, y: y.as_ptr().cast_mut(), yp: yp.as_ptr(), memory, out: out.as_mut_ptr() };
        self.call(function, call);
    }

    fn in_place(&self, function: Function, memory: &mut Memory, t: f64, y: &mut [f64]) {
        self.check(memory, y, y);
        let call = Call { t, factor: 0.0, y: y.as_mut_ptr(), yp: std::ptr::null(), memory, out: std::ptr::null_mut() };
        self.call(function, call);
    }

    fn interpret(&self, tape: &Tape, m: &mut Memory, t: f64, y: &mut [f64], yp: &[f64], out: &mut [f64]) {
        self.check_memory(m);
        let tables = &self.parts.tables;
        tape.run(&mut View { time: t, factor: 0.0, y, yp, work: m.all_mut(), out, tables });
    }

    /// Fills the caches that depend on parameters and random numbers drawn at reset. Call after
    /// parameters have changed.
    pub fn prepare_parameters(&self, m: &mut Memory) {
        self.interpret(&self.tapes.prepare_parameters, m, 0.0, &mut [], &[], &mut []);
    }

    /// Fills the caches that depend on actions, discrete variables, disturbances, frames and
    /// builtins. Call after any of them has changed, and after
    /// [`CompiledModel::prepare_parameters`].
    pub fn prepare_step(&self, m: &mut Memory) {
        self.check_memory(m);
        let (y, yp, out) = (std::ptr::null_mut(), std::ptr::null(), std::ptr::null_mut());
        self.call(Function::PrepareStep, Call { t: 0.0, factor: 0.0, y, yp, memory: m, out });
    }

    /// `out = F(t, y, y')`, one number a row, rows in the order of `y`.
    ///
    /// # Panics
    /// If a vector's length is not [`CompiledModel::unknowns`]; likewise below.
    #[inline]
    pub fn residual(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.unknowns(), "length of the residual");
        self.evaluate(Function::Residual, m, (t, 0.0), (y, yp), out);
    }

    /// `values = ∂F/∂y + cj ∂F/∂y'` in the order of [`CompiledModel::pattern`].
    #[inline]
    pub fn jacobian(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], cj: f64, values: &mut [f64]) {
        assert_eq!(values.len(), self.pattern().nonzeros(), "length of the Jacobian's values");
        self.evaluate(Function::Jacobian, m, (t, cj), (y, yp), values);
    }

    /// Values of the root functions, in the order of [`CompiledModel::watched`].
    #[inline]
    pub fn roots(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.watched().len(), "number of roots");
        self.evaluate(Function::Roots, m, (t, 0.0), (y, yp), out);
    }

    /// Lower bounds of the root functions, then upper ones, from `begin` to `end` and over a box of
    /// unknowns from `least` to `most`. Bounds of root functions that read rates are infinite; one
    /// that is not a number says nothing.
    #[inline]
    pub fn bounds(&self, m: &mut Memory, (begin, end): (f64, f64), (least, most): (&[f64], &[f64]), out: &mut [f64]) {
        assert_eq!(out.len(), 2 * self.watched().len(), "number of bounds");
        self.evaluate(Function::Bounds, m, (begin, end), (least, most), out);
    }

    /// Integrands of the quadratures.
    pub fn quadrature_rates(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.quadratures(), "number of quadratures");
        self.evaluate(Function::Quadratures, m, (t, 0.0), (y, yp), out);
    }

    /// The first time from `t` on at which an equation changes its form; infinite if it never does.
    pub fn next_break(&self, m: &mut Memory, t: f64) -> f64 {
        if self.breaks() == 0 {
            return f64::INFINITY;
        }
        self.check_memory(m);
        let mut next = f64::INFINITY;
        let (y, yp) = (std::ptr::null_mut(), std::ptr::null());
        self.call(Function::NextBreak, Call { t, factor: 0.0, y, yp, memory: m, out: &raw mut next });
        next
    }

    /// The expressions that time moves other than along straight lines.
    pub fn forcings(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.forcings_len(), "number of forcings");
        self.evaluate(Function::Forcings, m, (t, 0.0), (y, yp), out);
    }

    /// `out = ∂F/∂t`, unknowns and their rates held; whether it is known, which it is wherever time
    /// occurs in the equations but for extrema and products over loops that move with it.
    pub fn by_time(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) -> bool {
        assert_eq!(out.len(), self.unknowns(), "length of the derivative by time");
        if self.parts.has_slopes {
            self.evaluate(Function::ByTime, m, (t, 0.0), (y, yp), out);
        }
        self.parts.has_slopes
    }

    /// Failures, successes, constraints, rewards, observations, as [`crate::model::Finish`] lays
    /// them out.
    pub fn finish(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.finish_len(), "length of the finishing values");
        self.evaluate(Function::Finish, m, (t, 0.0), (y, yp), out);
    }

    /// Algebraic outputs, all elements in the order of [`crate::model::Quantities::algebraics`].
    pub fn outputs(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let expected = self.interface().quantities.algebraics.iter().map(crate::model::Quantity::len).sum::<usize>();
        assert_eq!(out.len(), expected, "number of algebraic outputs");
        self.evaluate(Function::Outputs, m, (t, 0.0), (y, yp), out);
    }

    /// Length of the output of [`CompiledModel::finish`].
    #[must_use]
    pub fn finish_len(&self) -> usize {
        finish_len(&self.parts.model)
    }

    /// Updates at the start of a step: discrete variables, resets of `y`.
    pub fn start(&self, m: &mut Memory, t: f64, y: &mut [f64]) {
        self.in_place(Function::Start, m, t, y);
    }

    /// Updates at the end of a step: discrete variables, clamps of `y`.
    pub fn end(&self, m: &mut Memory, t: f64, y: &mut [f64]) {
        self.in_place(Function::End, m, t, y);
    }

    /// Next values of the disturbances.
    pub fn disturb(&self, m: &mut Memory, t: f64) {
        self.check_memory(m);
        let (y, yp, out) = (std::ptr::null_mut(), std::ptr::null(), std::ptr::null_mut());
        self.call(Function::Disturb, Call { t, factor: 0.0, y, yp, memory: m, out });
    }

    /// Computed and drawn parameters.
    pub fn parameters(&self, m: &mut Memory) {
        self.interpret(&self.tapes.parameters, m, 0.0, &mut [], &[], &mut []);
    }

    /// Initial values of the states, into `y`.
    pub fn initial_states(&self, m: &mut Memory, y: &mut [f64]) {
        self.check(m, y, y);
        self.interpret(&self.tapes.initial_states, m, 0.0, y, &[], &mut []);
    }

    /// Initial values of discrete variables and disturbances.
    pub fn initial_discretes(&self, m: &mut Memory, y: &mut [f64]) {
        self.check(m, y, y);
        self.interpret(&self.tapes.initial_discretes, m, 0.0, y, &[], &mut []);
    }

    /// Fixed values of the steady problem: one number an action element, then one a state of
    /// [`crate::model::Steady::fixed`], then by how much each condition is missed at `y`.
    pub fn steady(&self, m: &mut Memory, y: &mut [f64], out: &mut [f64]) {
        self.check(m, y, y);
        let expected = self.actions_len() + steady_len(self.model());
        assert_eq!(out.len(), expected, "numbers of the steady problem");
        self.interpret(&self.tapes.steady, m, 0.0, y, &[], out);
    }

    /// Left less right side of each condition at the start, at time `t` and the unknowns `y`.
    pub fn start_conditions(&self, m: &mut Memory, t: f64, y: &mut [f64], out: &mut [f64]) {
        self.check(m, y, y);
        assert_eq!(out.len(), start_conditions(self.model()), "conditions at the start");
        self.interpret(&self.tapes.start_conditions, m, t, y, &[], out);
    }

    /// Runs an event program in place.
    pub fn event(&self, index: usize, m: &mut Memory, t: f64, y: &mut [f64]) {
        self.check(m, y, y);
        self.interpret(&self.tapes.events[index], m, t, y, &[], &mut []);
    }

    /// The actions of a named policy.
    pub fn policy(&self, index: usize, m: &mut Memory, t: f64, y: &[f64], out: &mut [f64]) {
        self.check(m, y, y);
        assert_eq!(out.len(), self.actions_len(), "number of actions");
        self.interpret(&self.tapes.policies[index], m, t, &mut y.to_vec(), &[], out);
    }

    /// Value and rate of each invariant.
    pub fn invariants(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.check(m, y, yp);
        assert_eq!(out.len(), 2 * self.interface().invariants.len(), "values and rates of invariants");
        self.interpret(&self.tapes.invariants, m, t, &mut y.to_vec(), yp, out);
    }

    /// The value of each item of each failure that is a box.
    pub fn boxes(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.check(m, y, yp);
        let expected = self.interface().finish.failures.iter().map(|f| f.items.len()).sum::<usize>();
        assert_eq!(out.len(), expected, "number of box items");
        self.interpret(&self.tapes.boxes, m, t, &mut y.to_vec(), yp, out);
    }

    /// Present values of the delayed expressions, one number an element.
    pub fn delayed(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.model().delayed(), "number of delayed values");
        self.evaluate(Function::Delayed, m, (t, 0.0), (y, yp), out);
    }

    /// Dead times, one number an element.
    pub fn lags(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.model().delayed(), "number of dead times");
        self.evaluate(Function::Lags, m, (t, 0.0), (y, yp), out);
    }

    /// Values before the start, one number an element; those of elements without one are left as
    /// they are.
    pub fn before(&self, m: &mut Memory, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.check(m, y, yp);
        assert_eq!(out.len(), self.model().delayed(), "number of values before the start");
        self.interpret(&self.tapes.before, m, t, &mut y.to_vec(), yp, out);
    }

    fn actions_len(&self) -> usize {
        self.interface().quantities.actions.iter().map(crate::model::Quantity::len).sum()
    }
}
