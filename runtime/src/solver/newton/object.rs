//! Newton's method of a step, as IDA's own, in fewer passes over the vectors.
//!
//! IDA's implementation calls a vector operation for each addition, sign and copy. A correction
//! takes some twenty streams of memory, and the systems of a control problem are so small, or
//! memory so near, that these are a third of the time. Here an iteration is residual, solve, and
//! one pass that corrects and measures. The convergence test is that of IDA (Hindmarsh et al.,
//! *SUNDIALS*, ACM TOMS 31, 2005, section 2.3): steps and orders are the same.

use std::os::raw::{c_int, c_long, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;

use sundials_sys::{
    _generic_SUNNonlinearSolver, _generic_SUNNonlinearSolver_Ops, IDAGetNonlinearSystemData, N_Vector, SUN_NLS_CONV_RECVR,
    SUNNonlinSolConvTestFn, SUNNonlinSolLSetupFn, SUNNonlinSolLSolveFn, SUNNonlinSolSysFn, SUNNonlinearSolver, SUNNonlinearSolver_Type,
    SUNNonlinearSolver_Type_SUNNONLINEARSOLVER_ROOTFIND,
};

use smpl_compiler::kernels;

use super::AFTER_SETUP;
use crate::solver::callbacks::Bridge;
use crate::solver::sundials::{Context, Kept, Lent};
use crate::solver::vector::Handle;

/// Iterations at most.
const MAX_ITERATIONS: c_int = 4;

/// A convergence rate above this is divergence.
const WORST_RATE: f64 = 0.9;

/// A first correction of this many tolerances is roundoff.
const ROUNDOFF: f64 = 1e-8;

/// The same when the step or the order has changed since.
const AFTER_CHANGE: f64 = 100.0;

/// IDA's code for a residual that asks for a smaller step.
const RESIDUAL_RECOVERABLE: c_int = 1;

/// The present step, as IDA keeps it.
struct IdaStep {
    time: f64,
    cj: f64,
    predicted: Handle,
    predicted_derivative: Handle,
    y: Handle,
    yp: Handle,
    residual: Handle,
}

impl IdaStep {
    /// The step that IDA is taking.
    ///
    /// # Safety
    /// `memory` is IDA's, in a call of the nonlinear solver. While the step lives, its vectors are
    /// used through it alone, but for callbacks that IDA makes while no reference to them lives.
    unsafe fn of(memory: *mut c_void) -> Self {
        let (mut time, mut cj, mut data) = (0.0, 0.0, ptr::null_mut());
        let [mut predicted, mut predicted_derivative, mut y, mut yp, mut residual] = [ptr::null_mut(); 5];
        // SAFETY: IDA's memory by the contract; the other pointers are to variables of this
        // function. Within a call of the nonlinear solver IDA has all five vectors, different ones.
        unsafe {
            IDAGetNonlinearSystemData(
                memory,
                &mut time,
                &mut predicted,
                &mut predicted_derivative,
                &mut y,
                &mut yp,
                &mut residual,
                &mut cj,
                &mut data,
            );
            let [predicted, predicted_derivative, y, yp, residual] =
                [predicted, predicted_derivative, y, yp, residual].map(|vector| Handle::new(vector));
            Self { time, cj, predicted, predicted_derivative, y, yp, residual }
        }
    }
}

/// A solve. The bridge and the vectors are reached through their addresses, since IDA's setup comes
/// back to them by its own callbacks. No reference to them lives across that, because
/// [`set_up`](Self::set_up) takes the solve exclusively.
struct Solve {
    bridge: Lent<Bridge>,
    memory: *mut c_void,
    step: IdaStep,
    /// The corrections so far, which IDA has set to zero.
    sum: Handle,
    weights: Handle,
    tolerance: f64,
}

impl Solve {
    /// The solve that IDA asks for.
    ///
    /// # Safety
    /// `memory` is IDA's, in a call of the nonlinear solver, of which the other arguments are. No
    /// code uses the bridge and the vectors during that but by this, and by callbacks that IDA
    /// makes.
    unsafe fn new(bridge: Lent<Bridge>, memory: *mut c_void, sum: Handle, weights: Handle, tolerance: f64) -> Self {
        // SAFETY: by the contract.
        let step = unsafe { IdaStep::of(memory) };
        Self { bridge, memory, step, sum, weights, tolerance }
    }

    /// IDA's result of a solve; `setup` says whether a new Jacobian is due.
    fn run(&mut self, mut setup: bool) -> c_int {
        let newton = &mut self.bridge.newton;
        newton.iterations = 0;
        newton.failures = 0;
        if self.step.cj != newton.cj {
            newton.rate_factor = AFTER_CHANGE;
            newton.cj = self.step.cj;
        }
        let mut stale = false;
        loop {
            let (outcome, iterated) = match self.begin(setup.then_some(stale)) {
                0 => (self.iterate(), true),
                failure => (failure, false),
            };
            if outcome == 0 {
                self.bridge.newton.current = false;
                return self.raise();
            }
            let newton = &mut self.bridge.newton;
            newton.failures += 1;
            if outcome < 0 || newton.current || !iterated {
                return outcome;
            }
            // Once more, with a Jacobian of this step.
            (setup, stale) = (true, true);
            self.sum.entries_mut().fill(0.0);
        }
    }

    /// Sets nonnegative states that are slightly negative at the end of the step to zero, and asks
    /// for a shorter step where one is far below.
    fn raise(&mut self) -> c_int {
        let Bridge { nonnegative, .. } = &mut *self.bridge;
        nonnegative.begin();
        for number in 0..nonnegative.states().len() {
            let at = nonnegative.states()[number] as usize;
            let predicted = self.step.predicted.entries()[at];
            match nonnegative.raises(number, predicted + self.sum.entries()[at]) {
                Ok(false) => {}
                Ok(true) => self.sum.entries_mut()[at] = -predicted,
                Err(state) => {
                    self.bridge.note_negative(self.step.time, state);
                    return SUN_NLS_CONV_RECVR;
                }
            }
        }
        0
    }

    /// The residual of the prediction, and a new Jacobian where `setup` says so, and whether the
    /// old one failed.
    fn begin(&mut self, setup: Option<bool>) -> c_int {
        // Where there is no correction yet, y and y' are the predictions; only a setup looks at
        // IDA's copies.
        let outcome = self.evaluate_prediction();
        let Some(stale) = setup.filter(|_| outcome == 0) else { return outcome };
        // A fault of the residual would be reported as one of the Jacobian.
        if !self.is_finite() {
            return RESIDUAL_RECOVERABLE;
        }
        self.move_to_sum();
        self.set_up(stale)
    }

    /// Iterations to convergence.
    fn iterate(&mut self) -> c_int {
        let mut first = 0.0;
        for iteration in 0..MAX_ITERATIONS {
            let size = self.correct();
            if !size.is_finite() {
                let finite = self.is_finite();
                return if finite { SUN_NLS_CONV_RECVR } else { RESIDUAL_RECOVERABLE };
            }
            let newton = &mut self.bridge.newton;
            if iteration == 0 {
                if size <= ROUNDOFF * self.tolerance {
                    return 0;
                }
                first = size;
            } else {
                let rate = if iteration == 1 { size / first } else { kernels::pow(size / first, 1.0 / f64::from(iteration)) };
                if rate > WORST_RATE {
                    return SUN_NLS_CONV_RECVR;
                }
                newton.rate_factor = rate / (1.0 - rate);
            }
            let factor = if iteration == 0 { newton.rate_factor.max(newton.least_factor) } else { newton.rate_factor };
            if factor * size <= self.tolerance {
                return 0;
            }
            if iteration + 1 < MAX_ITERATIONS {
                self.move_to_sum();
                let outcome = self.evaluate();
                if outcome != 0 {
                    return outcome;
                }
            }
        }
        SUN_NLS_CONV_RECVR
    }

    /// The residual of the prediction.
    fn evaluate_prediction(&mut self) -> c_int {
        let IdaStep { time, predicted, predicted_derivative, residual, .. } = &mut self.step;
        self.bridge.evaluate(*time, predicted, predicted_derivative, residual).err().unwrap_or(0)
    }

    /// The residual at y and y'.
    fn evaluate(&mut self) -> c_int {
        let IdaStep { time, y, yp, residual, .. } = &mut self.step;
        self.bridge.evaluate(*time, y, yp, residual).err().unwrap_or(0)
    }

    fn is_finite(&mut self) -> bool {
        self.bridge.is_finite(self.step.time, &self.step.residual)
    }

    /// Moves y and y' to the prediction plus the corrections so far.
    fn move_to_sum(&mut self) {
        let IdaStep { cj, predicted, predicted_derivative, y, yp, .. } = &mut self.step;
        self.bridge.operations.correct(*cj, &self.sum, (predicted, y), (predicted_derivative, yp));
    }

    /// Adds a correction; its weighted root mean square.
    fn correct(&mut self) -> f64 {
        let Bridge { newton, counts, factorisation, operations, .. } = &mut *self.bridge;
        newton.iterations += 1;
        counts.linear_solves += 1;
        // The factorisation may belong to another leading coefficient.
        let factor = -2.0 / (1.0 + self.step.cj / newton.setup_cj);
        factorisation.solve_scaled(factor, self.step.residual.entries(), newton.correction.entries_mut());
        operations.accumulate(&newton.correction, &self.weights, &mut self.sum)
    }

    /// A new Jacobian and its factorisation.
    fn set_up(&mut self, stale: bool) -> c_int {
        let Some(setup) = self.bridge.newton.setup else { return -1 };
        let mut current = 0;
        // SAFETY: IDA's own function with IDA's memory, within a call of the nonlinear solver, as
        // IDA's own solvers call it. It comes back to the bridge and the vectors, to which no
        // reference lives now: the solve is borrowed exclusively.
        let outcome = unsafe { setup(c_int::from(stale), &mut current, self.memory) };
        let newton = &mut self.bridge.newton;
        newton.current = true;
        newton.setup_cj = self.step.cj;
        newton.rate_factor = AFTER_SETUP;
        outcome
    }
}

/// The bridge behind the nonlinear solver.
///
/// # Safety
/// `solver` is that of [`object`], in a call of IDA's: no other code has a reference to the bridge
/// (see `callbacks::entry`).
unsafe fn bridge(solver: SUNNonlinearSolver) -> Lent<Bridge> {
    // SAFETY: by the contract.
    unsafe { Lent::new((*solver).content.cast()) }
}

unsafe extern "C" fn solver_type(_: SUNNonlinearSolver) -> SUNNonlinearSolver_Type {
    SUNNonlinearSolver_Type_SUNNONLINEARSOLVER_ROOTFIND
}

unsafe extern "C" fn solver_initialize(_: SUNNonlinearSolver) -> c_int {
    0
}

unsafe extern "C" fn solver_solve(
    solver: SUNNonlinearSolver,
    _: N_Vector,
    sum: N_Vector,
    weights: N_Vector,
    tolerance: f64,
    setup: c_int,
    memory: *mut c_void,
) -> c_int {
    // SAFETY: IDA calls with our solver, its own memory and vectors, two different ones.
    let mut solve = unsafe {
        let sum = Handle::new(sum);
        bridge(solver).shared.set_corrections(&sum);
        Solve::new(bridge(solver), memory, sum, Handle::new(weights), tolerance)
    };
    let outcome = catch_unwind(AssertUnwindSafe(|| solve.run(setup != 0)));
    outcome.unwrap_or_else(|_| solve.bridge.panicked())
}

/// IDA's functions for residual, linear solve and convergence are not needed: all of them lead back
/// here.
unsafe extern "C" fn take_system(_: SUNNonlinearSolver, _: SUNNonlinSolSysFn) -> c_int {
    0
}

unsafe extern "C" fn take_setup(solver: SUNNonlinearSolver, setup: SUNNonlinSolLSetupFn) -> c_int {
    // SAFETY: IDA calls with our solver.
    unsafe { bridge(solver) }.newton.setup = setup;
    0
}

unsafe extern "C" fn take_linear_solve(_: SUNNonlinearSolver, _: SUNNonlinSolLSolveFn) -> c_int {
    0
}

unsafe extern "C" fn take_test(_: SUNNonlinearSolver, _: SUNNonlinSolConvTestFn, _: *mut c_void) -> c_int {
    0
}

unsafe extern "C" fn take_limit(_: SUNNonlinearSolver, _: c_int) -> c_int {
    0
}

unsafe extern "C" fn iterations(solver: SUNNonlinearSolver, count: *mut c_long) -> c_int {
    // SAFETY: IDA calls with our solver and its own variable.
    unsafe { *count = bridge(solver).newton.iterations };
    0
}

unsafe extern "C" fn failures(solver: SUNNonlinearSolver, count: *mut c_long) -> c_int {
    // SAFETY: IDA calls with our solver and its own variable.
    unsafe { *count = bridge(solver).newton.failures };
    0
}

static OPERATIONS: _generic_SUNNonlinearSolver_Ops = _generic_SUNNonlinearSolver_Ops {
    gettype: Some(solver_type),
    initialize: Some(solver_initialize),
    setup: None,
    solve: Some(solver_solve),
    free: None,
    setsysfn: Some(take_system),
    setlsetupfn: Some(take_setup),
    setlsolvefn: Some(take_linear_solve),
    setctestfn: Some(take_test),
    setmaxiters: Some(take_limit),
    getnumiters: Some(iterations),
    getcuriter: None,
    getnumconvfails: Some(failures),
};

/// The solver as IDA knows it; its data are the bridge's.
pub(crate) fn object(bridge: &Kept<Bridge>, context: &Context) -> _generic_SUNNonlinearSolver {
    // SUNDIALS only reads the table.
    let ops = ptr::from_ref(&OPERATIONS).cast_mut();
    _generic_SUNNonlinearSolver { content: bridge.address().cast(), ops, sunctx: context.raw() }
}
