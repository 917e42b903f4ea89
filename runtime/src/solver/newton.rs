//! Newton's method of a step, as IDA's own, in fewer passes over the vectors.
//!
//! IDA's implementation calls a vector operation for each addition, sign and copy; a correction takes some twenty streams of
//! memory, and the systems of a control problem are so small, or memory so near, that these are a third of the time. Here an
//! iteration is residual, solve, and one pass that corrects and measures. The convergence test is that of IDA
//! (Hindmarsh et al., *SUNDIALS*, ACM TOMS 31, 2005, section 2.3): steps and orders are the same.
//!
//! Derivatives along directions follow when the unknowns have converged (the staggered corrector of W. F. Feehery, J. E. Tolsma and P. I. Barton,
//! *Appl. Numer. Math.* 25 (1997) 41). Their equations are linear: with the Jacobian there, factorised once for all directions, one solution is the exact one. It
//! serves the next step's iterations too. (A few iterations with an older matrix take longer where directions are many: each of them is a product and a solution for all.)

use std::os::raw::{c_int, c_long, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;

use sundials_sys::{
    _generic_SUNNonlinearSolver, _generic_SUNNonlinearSolver_Ops, IDAGetNonlinearSystemData, N_Vector, SUN_NLS_CONV_RECVR, SUNContext,
    SUNNonlinSolConvTestFn, SUNNonlinSolLSetupFn, SUNNonlinSolLSolveFn, SUNNonlinSolSysFn, SUNNonlinearSolver, SUNNonlinearSolver_Type,
    SUNNonlinearSolver_Type_SUNNONLINEARSOLVER_ROOTFIND,
};

use super::callbacks::Bridge;
use super::kernels::LANES;
use super::vector::{Operations, Vector, entries, entries_mut};

/// Iterations at most.
const MAX_ITERATIONS: c_int = 4;

/// A convergence rate above this is divergence.
const WORST_RATE: f64 = 0.9;

/// A first correction of this many tolerances is roundoff.
const ROUNDOFF: f64 = 1e-8;

/// rate / (1 − rate) that is assumed after a new factorisation.
const AFTER_SETUP: f64 = 20.0;

/// The same when the step or the order has changed since.
const AFTER_CHANGE: f64 = 100.0;

/// IDA's code for a residual that asks for a smaller step.
const RESIDUAL_RECOVERABLE: c_int = 1;

/// Leading coefficients of this ratio need no new matrix: IDA's bound.
const NEAR: f64 = 0.6;

/// What lasts from one solve to the next.
pub(crate) struct Newton {
    correction: Vector,
    /// IDA's function that leads to a new Jacobian and its factorisation.
    setup: SUNNonlinSolLSetupFn,
    /// Leading coefficient of the last solve, and of the last setup.
    cj: f64,
    setup_cj: f64,
    /// rate / (1 − rate).
    rate_factor: f64,
    /// Whether the factorisation belongs to the present step.
    current: bool,
    iterations: c_long,
    failures: c_long,
}

impl Newton {
    pub fn new(length: usize, operations: Operations, context: SUNContext) -> Self {
        Self {
            correction: Vector::zeros(length, operations, context),
            setup: None,
            cj: f64::NAN,
            setup_cj: f64::NAN,
            rate_factor: AFTER_SETUP,
            current: false,
            iterations: 0,
            failures: 0,
        }
    }

    /// The last correction of the last solve; zero for derivatives along directions.
    pub fn corrections(&self) -> &[f64] {
        self.correction.entries()
    }

    /// Forgets the matrix: the next solve is the first one after a restart.
    pub fn restart(&mut self) {
        self.setup_cj = f64::NAN;
    }

    /// Forgets earlier solves.
    pub fn forget(&mut self) {
        self.cj = f64::NAN;
        self.setup_cj = f64::NAN;
        self.rate_factor = AFTER_SETUP;
        self.current = false;
    }
}

/// The present step, as IDA keeps it.
struct Step {
    time: f64,
    cj: f64,
    predicted: N_Vector,
    predicted_derivative: N_Vector,
    y: N_Vector,
    yp: N_Vector,
    residual: N_Vector,
}

impl Step {
    unsafe fn of(memory: *mut c_void) -> Self {
        let mut step = Self {
            time: 0.0,
            cj: 0.0,
            predicted: ptr::null_mut(),
            predicted_derivative: ptr::null_mut(),
            y: ptr::null_mut(),
            yp: ptr::null_mut(),
            residual: ptr::null_mut(),
        };
        let mut data = ptr::null_mut();
        unsafe {
            IDAGetNonlinearSystemData(
                memory,
                &mut step.time,
                &mut step.predicted,
                &mut step.predicted_derivative,
                &mut step.y,
                &mut step.yp,
                &mut step.residual,
                &mut step.cj,
                &mut data,
            );
        }
        step
    }
}

/// A solve. The bridge is reached through its address, since IDA's setup comes back to it by its own callbacks; no reference
/// to it lives across that.
struct Solve {
    bridge: *mut Bridge,
    memory: *mut c_void,
    step: Step,
    /// The corrections so far, which IDA has set to zero.
    sum: N_Vector,
    weights: N_Vector,
    tolerance: f64,
    /// Number of unknowns that are iterated for, and of blocks with them.
    leading: usize,
    blocks: usize,
    /// Others follow.
    followed: bool,
}

impl Solve {
    unsafe fn new(bridge: *mut Bridge, memory: *mut c_void, sum: N_Vector, weights: N_Vector, tolerance: f64) -> Self {
        let step = unsafe { Step::of(memory) };
        let (leading, length) = unsafe { ((*bridge).leading, entries(sum).len()) };
        let blocks = leading.div_ceil(LANES);
        Self { bridge, memory, step, sum, weights, tolerance, leading, blocks, followed: leading < length }
    }

    /// The bridge, for the time of one call.
    #[allow(clippy::mut_from_ref)] // behind a pointer that this struct does not own
    unsafe fn bridge(&self) -> &mut Bridge {
        unsafe { &mut *self.bridge }
    }

    /// IDA's result of a solve; `setup` says whether a new Jacobian is due.
    unsafe fn run(&self, mut setup: bool) -> c_int {
        let newton = unsafe { &mut self.bridge().newton };
        newton.iterations = 0;
        newton.failures = 0;
        if self.step.cj != newton.cj {
            newton.rate_factor = AFTER_CHANGE;
            newton.cj = self.step.cj;
        }
        // The matrix of the last step serves where its leading coefficient is near.
        setup &= !(self.followed && (NEAR..1.0 / NEAR).contains(&(self.step.cj / newton.setup_cj)));
        let mut stale = false;
        loop {
            let (outcome, iterated) = match unsafe { self.begin(setup.then_some(stale)) } {
                0 => (unsafe { self.iterate() }, true),
                failure => (failure, false),
            };
            if outcome == 0 {
                let followed = if self.followed { unsafe { self.follow() } } else { 0 };
                unsafe { self.bridge().newton.current = false };
                return followed;
            }
            let newton = unsafe { &mut self.bridge().newton };
            newton.failures += 1;
            if outcome < 0 || newton.current || !iterated {
                return outcome;
            }
            // Once more, with a Jacobian of this step.
            (setup, stale) = (true, true);
            unsafe { entries_mut(self.sum) }.fill(0.0);
        }
    }

    /// The residual of the prediction, and a new Jacobian where `setup` says so, and whether the old one failed.
    unsafe fn begin(&self, setup: Option<bool>) -> c_int {
        // Where there is no correction yet, y and y' are the predictions; only a setup looks at IDA's copies.
        let outcome = unsafe { self.evaluate(self.step.predicted, self.step.predicted_derivative) };
        let Some(stale) = setup.filter(|_| outcome == 0) else { return outcome };
        // A fault of the residual would be reported as one of the Jacobian.
        if !unsafe { self.is_finite() } {
            return RESIDUAL_RECOVERABLE;
        }
        unsafe {
            self.move_to_sum();
            self.set_up(stale)
        }
    }

    /// Iterations to convergence.
    unsafe fn iterate(&self) -> c_int {
        let mut first = 0.0;
        for iteration in 0..MAX_ITERATIONS {
            let size = unsafe { self.correct() };
            if !size.is_finite() {
                let finite = unsafe { self.is_finite() };
                return if finite { SUN_NLS_CONV_RECVR } else { RESIDUAL_RECOVERABLE };
            }
            let newton = unsafe { &mut self.bridge().newton };
            if iteration == 0 {
                if size <= ROUNDOFF * self.tolerance {
                    return 0;
                }
                first = size;
            } else {
                let rate = if iteration == 1 { size / first } else { (size / first).powf(1.0 / f64::from(iteration)) };
                if rate > WORST_RATE {
                    return SUN_NLS_CONV_RECVR;
                }
                newton.rate_factor = rate / (1.0 - rate);
            }
            if newton.rate_factor * size <= self.tolerance {
                return 0;
            }
            if iteration + 1 < MAX_ITERATIONS {
                unsafe { self.move_to_sum() };
                let outcome = unsafe { self.evaluate(self.step.y, self.step.yp) };
                if outcome != 0 {
                    return outcome;
                }
            }
        }
        SUN_NLS_CONV_RECVR
    }

    unsafe fn evaluate(&self, y: N_Vector, yp: N_Vector) -> c_int {
        unsafe { self.bridge().evaluate_leading(self.step.time, y, yp, self.step.residual).err().unwrap_or(0) }
    }

    unsafe fn is_finite(&self) -> bool {
        unsafe { self.bridge().is_finite(self.step.time, self.step.residual) }
    }

    /// Moves y and y' to the prediction plus the corrections so far.
    unsafe fn move_to_sum(&self) {
        let step = &self.step;
        unsafe {
            self.bridge().operations.correct(
                self.blocks,
                step.cj,
                self.sum,
                (step.predicted, step.y),
                (step.predicted_derivative, step.yp),
            );
        }
    }

    /// Adds a correction; its weighted root mean square.
    unsafe fn correct(&self) -> f64 {
        let bridge = unsafe { self.bridge() };
        bridge.newton.iterations += 1;
        bridge.counts.linear_solves += 1;
        // The factorisation may belong to another leading coefficient.
        let factor = -2.0 / (1.0 + self.step.cj / bridge.newton.setup_cj);
        let delta = bridge.newton.correction.raw();
        unsafe {
            let (residual, correction) = (entries(self.step.residual), entries_mut(delta));
            bridge.factorisation.solve_scaled(factor, &residual[..self.leading], &mut correction[..self.leading]);
            bridge.operations.accumulate(self.blocks, delta, self.weights, self.sum)
        }
    }

    /// The derivatives along directions at the unknowns that were found.
    unsafe fn follow(&self) -> c_int {
        let Step { time, cj, y, yp, residual, predicted, predicted_derivative } = self.step;
        unsafe {
            self.move_to_sum();
            let bridge = self.bridge();
            if let Err(code) = bridge.jacobian(time, cj, y, yp) {
                return code;
            }
            let code = bridge.factorise();
            bridge.newton.setup_cj = cj;
            if code != 0 {
                return code;
            }
            let done = bridge.follow((time, cj), (y, yp), (predicted, predicted_derivative), residual);
            done.err().unwrap_or_else(|| bridge.solve_following(time, residual, self.sum))
        }
    }

    /// A new Jacobian and its factorisation.
    unsafe fn set_up(&self, stale: bool) -> c_int {
        let Some(setup) = (unsafe { self.bridge().newton.setup }) else { return -1 };
        let mut current = 0;
        let outcome = unsafe { setup(c_int::from(stale), &mut current, self.memory) };
        let newton = unsafe { &mut self.bridge().newton };
        newton.current = true;
        newton.setup_cj = self.step.cj;
        newton.rate_factor = AFTER_SETUP;
        outcome
    }
}

/// The bridge behind the nonlinear solver.
unsafe fn bridge<'a>(solver: SUNNonlinearSolver) -> &'a mut Bridge {
    unsafe { &mut *(*solver).content.cast() }
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
    unsafe {
        bridge(solver).shared.set_corrections(sum);
        let solve = || Solve::new((*solver).content.cast(), memory, sum, weights, tolerance).run(setup != 0);
        catch_unwind(AssertUnwindSafe(solve)).unwrap_or_else(|_| bridge(solver).panicked())
    }
}

/// IDA's functions for residual, linear solve and convergence are not needed: all of them lead back here.
unsafe extern "C" fn take_system(_: SUNNonlinearSolver, _: SUNNonlinSolSysFn) -> c_int {
    0
}

unsafe extern "C" fn take_setup(solver: SUNNonlinearSolver, setup: SUNNonlinSolLSetupFn) -> c_int {
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
    unsafe { *count = bridge(solver).newton.iterations };
    0
}

unsafe extern "C" fn failures(solver: SUNNonlinearSolver, count: *mut c_long) -> c_int {
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
pub(crate) fn object(bridge: *mut Bridge, sunctx: SUNContext) -> Box<_generic_SUNNonlinearSolver> {
    // SUNDIALS only reads the table.
    Box::new(_generic_SUNNonlinearSolver { content: bridge.cast(), ops: ptr::from_ref(&OPERATIONS).cast_mut(), sunctx })
}
