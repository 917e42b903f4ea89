//! What IDA calls back: the system's functions, the error weights, the linear solver and the message handler.
//!
//! All of them find their data in one [`Bridge`], whose address IDA holds as user data. No panic leaves a callback (it
//! would end the process); it is caught, noted and returned as a failure.

use std::ffi::CStr;
use std::os::raw::{c_char, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::{self, NonNull};
use std::rc::Rc;

use sundials_sys::{
    _generic_SUNLinearSolver, _generic_SUNLinearSolver_Ops, _generic_SUNMatrix, _generic_SUNMatrix_Ops, IDAGetCurrentTime, IDAGetDky,
    IDAGetLastStep, N_Vector, SUNContext, SUNLinearSolver, SUNLinearSolver_ID, SUNLinearSolver_ID_SUNLINEARSOLVER_CUSTOM,
    SUNLinearSolver_Type, SUNLinearSolver_Type_SUNLINEARSOLVER_DIRECT, SUNMatrix, SUNMatrix_ID, SUNMatrix_ID_SUNMATRIX_CUSTOM,
};

use super::kernels::Block;
use super::linear::Factorisation;
use super::linear::columns::all_finite;
use super::newton::Newton;
use super::vector::{self, Operations, Shared, Vector, entries, entries_mut};
use super::watch::Watch;
use super::{Following, Statistics, System};
use crate::interrupt::Pace;

/// Returned to IDA: try again with a smaller step.
const RECOVERABLE: c_int = 1;

/// Returned to IDA: give up.
const FATAL: c_int = -1;

/// Accepted steps after which a failed evaluation no longer counts as the cause of a later end.
const MEMORY: u32 = 10;

/// Steps in a row at the roundoff of time after which the integration is given up.
const TINY_STEPS: u32 = 20;

/// Bytes kept of IDA's last message.
const MESSAGE: usize = 256;

/// What went wrong in a callback.
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
    /// A function of the system panicked.
    Panic,
    /// Somebody wants the computation to stop.
    Interrupted,
}

/// What the callbacks work with.
pub(crate) struct Bridge {
    /// The system, while it is lent.
    system: Option<NonNull<dyn System>>,
    pub memory: *mut c_void,
    pub operations: Operations,
    /// What IDA's vectors know of each other.
    pub shared: Rc<Shared>,
    pub rtol: f64,
    /// Unknowns that derivatives along directions follow, or all; and those together.
    pub leading: usize,
    length: usize,
    /// Tolerances of the derivatives in those of the unknowns.
    pub looseness: f64,
    /// For many right-hand sides.
    space: Vec<f64>,
    /// Absolute tolerances, filled up with infinity.
    pub atol: Box<[Block]>,
    /// Entries of the Newton matrix.
    pub values: Box<[f64]>,
    pub factorisation: Factorisation,
    pub newton: Newton,
    pub watch: Watch,
    /// Derivatives at the accepted state, where root functions look at them.
    pub derivative: Option<Vector>,
    pub counts: Statistics,
    pub trouble: Option<Trouble>,
    steps_since_trouble: u32,
    tiny_steps: u32,
    pace: Pace,
    /// Length of the last step that was followed by another.
    pub last_step: f64,
    message: [u8; MESSAGE],
    message_length: usize,
}

impl Bridge {
    pub fn new(
        operations: Operations,
        rtol: f64,
        atol: &[f64],
        entries: usize,
        factorisation: Factorisation,
        newton: Newton,
        watch: Watch,
    ) -> Self {
        let mut blocks = vector::zeroed_blocks(atol.len());
        let all = blocks.iter_mut().flat_map(|block| block.0.iter_mut());
        let filled = atol.iter().copied().chain(std::iter::repeat(f64::INFINITY));
        all.zip(filled).for_each(|(to, from)| *to = from);
        Self {
            system: None,
            memory: ptr::null_mut(),
            operations,
            shared: Rc::default(),
            rtol,
            leading: atol.len(),
            length: atol.len(),
            looseness: 1.0,
            space: Vec::new(),
            atol: blocks,
            values: vec![0.0; entries].into_boxed_slice(),
            factorisation,
            newton,
            watch,
            derivative: None,
            counts: Statistics::default(),
            trouble: None,
            steps_since_trouble: 0,
            tiny_steps: 0,
            pace: Pace::default(),
            last_step: 0.0,
            message: [0; MESSAGE],
            message_length: 0,
        }
    }

    /// Lends the system to the callbacks until [`take_back`](Self::take_back).
    pub(crate) fn lend(&mut self, system: &mut dyn System) {
        let system: NonNull<dyn System + '_> = NonNull::from(system);
        // SAFETY: only the lifetime changes; the pointer is taken back before the borrow ends.
        self.system = Some(unsafe { std::mem::transmute::<NonNull<dyn System + '_>, NonNull<dyn System>>(system) });
    }

    pub(crate) fn take_back(&mut self) {
        self.system = None;
    }

    /// Clears what belongs to the time before a call of IDA.
    pub fn begin(&mut self) {
        self.trouble = None;
        self.tiny_steps = 0;
        self.message_length = 0;
    }

    /// IDA's last message.
    pub fn message(&self) -> String {
        String::from_utf8_lossy(&self.message[..self.message_length]).trim().to_owned()
    }

    fn note(&mut self, trouble: Trouble) {
        // What follows an interruption is not what ended the integration.
        if self.trouble != Some(Trouble::Interrupted) {
            self.trouble = Some(trouble);
        }
        self.steps_since_trouble = 0;
    }

    /// Runs `call` on the system; no panic gets out.
    fn guarded(&mut self, call: impl FnOnce(&mut dyn System)) -> Result<(), c_int> {
        let Some(mut system) = self.system else {
            return Err(FATAL);
        };
        if self.pace.stops() {
            self.note(Trouble::Interrupted);
            return Err(FATAL);
        }
        // SAFETY: the lender holds the exclusive borrow as long as the pointer is here.
        let system = unsafe { system.as_mut() };
        catch_unwind(AssertUnwindSafe(|| call(system))).map_err(|_| self.panicked())
    }

    /// Evaluates the residual at `y`, `yp` into `out`; whether it is finite is left open.
    pub fn evaluate(&mut self, time: f64, y: N_Vector, yp: N_Vector, out: N_Vector) -> Result<(), c_int> {
        self.counts.residuals += 1;
        self.guarded(|system| unsafe {
            system.residual(time, entries(y), entries(yp), entries_mut(out));
        })
    }

    /// Evaluates the residual of the leading unknowns; what else is in `out` stays.
    pub fn evaluate_leading(&mut self, time: f64, y: N_Vector, yp: N_Vector, out: N_Vector) -> Result<(), c_int> {
        let n = self.leading;
        if n == self.length {
            return self.evaluate(time, y, yp, out);
        }
        self.counts.residuals += 1;
        self.guarded(|system| unsafe {
            system.leading(time, &entries(y)[..n], &entries(yp)[..n], &mut entries_mut(out)[..n]);
        })
    }

    /// Evaluates the residual of the derivatives along directions, at unknowns for which [`jacobian`](Self::jacobian) was evaluated.
    pub fn follow(
        &mut self,
        (time, cj): (f64, f64),
        (y, yp): (N_Vector, N_Vector),
        (predicted, derivative): (N_Vector, N_Vector),
        out: N_Vector,
    ) -> Result<(), c_int> {
        let n = self.leading;
        let values = std::mem::take(&mut self.values);
        let done = self.guarded(|system| unsafe {
            let at = Following { t: time, y: &entries(y)[..n], yp: &entries(yp)[..n], cj, jacobian: &values };
            system.following(at, (&entries(predicted)[n..], &entries(derivative)[n..]), &mut entries_mut(out)[n..]);
        });
        self.values = values;
        done
    }

    /// Solves for the corrections of derivatives along directions from their residual, with the factorised matrix in place.
    pub fn solve_following(&mut self, time: f64, residual: N_Vector, corrections: N_Vector) -> c_int {
        let n = self.leading;
        let (from, to) = unsafe { (&entries(residual)[n..], &mut entries_mut(corrections)[n..]) };
        to.iter_mut().zip(from).for_each(|(to, from)| *to = -from);
        self.counts.linear_solves += 1;
        let width = to.len() / n;
        match catch_unwind(AssertUnwindSafe(|| self.factorisation.solve_many(width, to, &mut self.space))) {
            Ok(()) if all_finite(to) => 0,
            Ok(()) => {
                self.is_finite(time, residual);
                unsafe { entries_mut(residual)[n..].fill(0.0) };
                RECOVERABLE
            }
            Err(_) => self.panicked(),
        }
    }

    /// Whether a residual is finite; notes the trouble if it is not.
    pub fn is_finite(&mut self, time: f64, residual: N_Vector) -> bool {
        if self.operations.all_finite(unsafe { vector::block_slice(residual) }) {
            return true;
        }
        self.counts.not_finite += 1;
        let row = unsafe { entries(residual) }.iter().position(|x| !x.is_finite()).unwrap_or(0);
        self.note(Trouble::Residual { time, row });
        false
    }

    /// Evaluates the residual at `y`, `yp` into `out`; an error if it is not finite.
    pub fn residual(&mut self, time: f64, y: N_Vector, yp: N_Vector, out: N_Vector) -> Result<(), c_int> {
        self.evaluate(time, y, yp, out)?;
        if self.is_finite(time, out) { Ok(()) } else { Err(RECOVERABLE) }
    }

    /// Evaluates the Jacobian into `values`.
    pub fn jacobian(&mut self, time: f64, cj: f64, y: N_Vector, yp: N_Vector) -> Result<(), c_int> {
        self.counts.jacobians += 1;
        let mut values = std::mem::take(&mut self.values);
        let done = self.guarded(|system| unsafe {
            system.jacobian(time, entries(y), entries(yp), cj, &mut values);
        });
        self.values = values;
        done?;
        if all_finite(&self.values) {
            return Ok(());
        }
        let entry = self.values.iter().position(|x| !x.is_finite()).unwrap_or(0);
        self.note(Trouble::Jacobian { time, entry });
        Err(RECOVERABLE)
    }

    /// The first time from `t` on at which the equations change their form.
    pub fn next_break(&mut self, t: f64) -> Result<f64, c_int> {
        let mut next = f64::INFINITY;
        self.guarded(|system| next = system.next_break(t))?;
        Ok(next)
    }

    /// Evaluates what time itself moves into `out`.
    pub fn forcings(&mut self, t: f64, y: &Vector, yp: &Vector, out: &mut [f64]) -> Result<(), c_int> {
        self.guarded(|system| system.forcings(t, y.entries(), yp.entries(), out))
    }

    /// Evaluates the integrands into `out`.
    pub(crate) fn integrands(&mut self, t: f64, y: &Vector, yp: &Vector, out: &mut [f64]) -> Result<(), c_int> {
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

    /// Looks at the root functions at an accepted state; whether a condition has become true.
    pub(crate) fn has_passed(&mut self, t: f64, y: &[f64], yp: &[f64]) -> Result<bool, c_int> {
        if self.watch.is_empty() {
            return Ok(false);
        }
        self.evaluate_roots(t, y, yp)?;
        Ok(self.watch.accept(t))
    }

    /// The same within IDA's calls, which keep y' in their history.
    fn has_passed_in_step(&mut self, t: f64, y: &[f64]) -> Result<bool, c_int> {
        let yp = match &self.derivative {
            Some(derivative) if unsafe { IDAGetDky(self.memory, t, 1, derivative.raw()) } < 0 => return Err(FATAL),
            // SAFETY: nobody else touches the vector during the call.
            Some(derivative) => unsafe { entries(derivative.raw()) },
            None => y,
        };
        self.has_passed(t, y, yp)
    }

    /// Solves with the factorised matrix in place.
    fn solve(&mut self, x: &mut [f64]) -> c_int {
        self.counts.linear_solves += 1;
        let solve = || {
            let (own, following) = x.split_at_mut(self.leading);
            self.factorisation.solve(own);
            if !following.is_empty() {
                self.factorisation.solve_many(following.len() / own.len(), following, &mut self.space);
            }
        };
        match catch_unwind(AssertUnwindSafe(solve)) {
            Ok(()) => 0,
            Err(_) => self.panicked(),
        }
    }

    /// Error weights at `y`, and a look at the step that led there.
    unsafe fn weigh(&mut self, y: N_Vector, weights: N_Vector) -> c_int {
        let weighed = catch_unwind(AssertUnwindSafe(|| {
            unsafe { self.operations.error_weights(self.rtol, y, &self.atol, weights) };
            unsafe { self.emphasise(entries_mut(weights)) };
            self.shared.renew(weights);
            code(self.step_accepted(unsafe { entries(y) }))
        }));
        weighed.unwrap_or_else(|_| self.panicked())
    }

    /// The leading unknowns count as much as if they were alone; derivatives along directions have tolerances of their own.
    pub fn emphasise(&self, weights: &mut [f64]) {
        if self.leading < weights.len() {
            let factor = (weights.len() as f64 / self.leading as f64).sqrt();
            weights[..self.leading].iter_mut().for_each(|weight| *weight *= factor);
            let tighter = 1.0 / self.looseness;
            weights[self.leading..].iter_mut().for_each(|weight| *weight *= tighter);
        }
    }

    /// Notes a panic, which is not to leave a callback.
    pub(crate) fn panicked(&mut self) -> c_int {
        self.note(Trouble::Panic);
        FATAL
    }

    /// Factorises the matrix.
    pub fn factorise(&mut self) -> c_int {
        self.counts.factorisations += 1;
        match catch_unwind(AssertUnwindSafe(|| self.factorisation.factorise(&self.values))) {
            Err(_) => self.panicked(),
            Ok(Ok(())) => 0,
            Ok(Err(singular)) => {
                let mut time = 0.0;
                unsafe { IDAGetCurrentTime(self.memory, &mut time) };
                self.note(Trouble::Singular { time, column: singular.column });
                RECOVERABLE
            }
        }
    }

    /// Looks at the step that was just accepted; an error when the steps have become too small to get anywhere, or an
    /// event lies in the step.
    fn step_accepted(&mut self, y: &[f64]) -> Result<(), c_int> {
        let (mut step, mut time) = (0.0, 0.0);
        unsafe {
            IDAGetLastStep(self.memory, &mut step);
            IDAGetCurrentTime(self.memory, &mut time);
        }
        if step > 0.0 {
            self.last_step = step;
            self.steps_since_trouble += 1;
            if self.steps_since_trouble > MEMORY {
                self.trouble = None;
            }
        }
        let tiny = step > 0.0 && step <= 4.0 * f64::EPSILON * time.abs();
        self.tiny_steps = if tiny { self.tiny_steps + 1 } else { 0 };
        if step > 0.0 && self.has_passed_in_step(time, y)? {
            return Err(FATAL);
        }
        if self.tiny_steps < TINY_STEPS {
            return Ok(());
        }
        // Where equations stopped being finite, that is the cause.
        self.trouble.get_or_insert(Trouble::TinySteps { step });
        Err(FATAL)
    }
}

/// The bridge behind IDA's user data.
///
/// # Safety
/// `user_data` is the address given to `IDASetUserData`, and nobody else uses the bridge during the call.
unsafe fn bridge<'a>(user_data: *mut c_void) -> &'a mut Bridge {
    unsafe { &mut *user_data.cast() }
}

fn code(result: Result<(), c_int>) -> c_int {
    result.err().unwrap_or(0)
}

pub(crate) unsafe extern "C" fn residual(t: f64, y: N_Vector, yp: N_Vector, out: N_Vector, data: *mut c_void) -> c_int {
    code(unsafe { bridge(data) }.residual(t, y, yp, out))
}

pub(crate) unsafe extern "C" fn jacobian(
    t: f64,
    cj: f64,
    y: N_Vector,
    yp: N_Vector,
    _residual: N_Vector,
    _matrix: SUNMatrix,
    data: *mut c_void,
    _work: N_Vector,
    _work2: N_Vector,
    _work3: N_Vector,
) -> c_int {
    code(unsafe { bridge(data) }.jacobian(t, cj, y, yp))
}

pub(crate) unsafe extern "C" fn quadratures(t: f64, y: N_Vector, yp: N_Vector, out: N_Vector, data: *mut c_void) -> c_int {
    let done = unsafe { bridge(data) }.guarded(|system| unsafe {
        system.quadratures(t, entries(y), entries(yp), entries_mut(out));
    });
    code(done)
}

/// Error weights; IDA asks for them once a step, which also makes it the place to watch the steps.
pub(crate) unsafe extern "C" fn error_weights(y: N_Vector, weights: N_Vector, data: *mut c_void) -> c_int {
    unsafe { bridge(data).weigh(y, weights) }
}

/// Keeps the last message in place of printing it: SUNDIALS 6.
#[cfg(not(feature = "vendored"))]
pub(crate) unsafe extern "C" fn message(
    _code: c_int,
    _module: *const c_char,
    _function: *const c_char,
    text: *mut c_char,
    data: *mut c_void,
) {
    unsafe { keep_message(text, data) }
}

/// Keeps the last message in place of printing it: SUNDIALS 7.
#[cfg(feature = "vendored")]
pub(crate) unsafe extern "C" fn message(
    _line: c_int,
    _function: *const c_char,
    _file: *const c_char,
    text: *const c_char,
    _code: sundials_sys::SUNErrCode,
    data: *mut c_void,
    _context: SUNContext,
) {
    unsafe { keep_message(text, data) }
}

unsafe fn keep_message(text: *const c_char, data: *mut c_void) {
    if text.is_null() {
        return;
    }
    let bridge = unsafe { bridge(data) };
    let text = unsafe { CStr::from_ptr(text) }.to_bytes();
    let length = text.len().min(MESSAGE);
    bridge.message[..length].copy_from_slice(&text[..length]);
    bridge.message_length = length;
}

unsafe extern "C" fn solver_type(_: SUNLinearSolver) -> SUNLinearSolver_Type {
    SUNLinearSolver_Type_SUNLINEARSOLVER_DIRECT
}

unsafe extern "C" fn solver_id(_: SUNLinearSolver) -> SUNLinearSolver_ID {
    SUNLinearSolver_ID_SUNLINEARSOLVER_CUSTOM
}

unsafe extern "C" fn solver_initialize(_: SUNLinearSolver) -> c_int {
    0
}

unsafe extern "C" fn solver_setup(solver: SUNLinearSolver, _: SUNMatrix) -> c_int {
    unsafe { bridge((*solver).content) }.factorise()
}

unsafe extern "C" fn solver_solve(solver: SUNLinearSolver, _: SUNMatrix, x: N_Vector, b: N_Vector, _: f64) -> c_int {
    let x = unsafe { entries_mut(x) };
    x.copy_from_slice(unsafe { entries(b) });
    unsafe { bridge((*solver).content) }.solve(x)
}

unsafe extern "C" fn solver_last_flag(_: SUNLinearSolver) -> i64 {
    0
}

static SOLVER: _generic_SUNLinearSolver_Ops = _generic_SUNLinearSolver_Ops {
    gettype: Some(solver_type),
    getid: Some(solver_id),
    initialize: Some(solver_initialize),
    setup: Some(solver_setup),
    solve: Some(solver_solve),
    lastflag: Some(solver_last_flag),
    // SAFETY: every other field is an optional function pointer, for which all zeros mean `None`.
    ..unsafe { std::mem::zeroed() }
};

unsafe extern "C" fn matrix_id(_: SUNMatrix) -> SUNMatrix_ID {
    SUNMatrix_ID_SUNMATRIX_CUSTOM
}

/// The Jacobian's function writes every entry, so there is nothing to clear.
unsafe extern "C" fn matrix_zero(_: SUNMatrix) -> c_int {
    0
}

static MATRIX: _generic_SUNMatrix_Ops = _generic_SUNMatrix_Ops {
    getid: Some(matrix_id),
    zero: Some(matrix_zero),
    // SAFETY: as above.
    ..unsafe { std::mem::zeroed() }
};

/// The linear solver and the matrix as IDA knows them; the numbers are the bridge's.
pub(crate) struct LinearObjects {
    pub solver: Box<_generic_SUNLinearSolver>,
    pub matrix: Box<_generic_SUNMatrix>,
}

impl LinearObjects {
    pub fn new(bridge: *mut Bridge, sunctx: SUNContext) -> Self {
        // SUNDIALS only reads the tables.
        let solver = _generic_SUNLinearSolver { content: bridge.cast(), ops: ptr::from_ref(&SOLVER).cast_mut(), sunctx };
        let matrix = _generic_SUNMatrix { content: bridge.cast(), ops: ptr::from_ref(&MATRIX).cast_mut(), sunctx };
        Self { solver: Box::new(solver), matrix: Box::new(matrix) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{LinearSolver, Pattern};
    use super::*;

    /// A bridge whose matrix has no values: to factorise it panics, and so does a solve with a vector that is too short.
    fn bridge() -> Bridge {
        let operations = Operations::detect();
        let factorisation = Factorisation::new(&Pattern::full(2), LinearSolver::Dense).expect("a factorisation");
        let newton = Newton::new(2, operations, ptr::null_mut());
        Bridge::new(operations, 1e-6, &[1e-6, 1e-6], 0, factorisation, newton, Watch::new(0, &[]))
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
