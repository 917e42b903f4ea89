//! The functions whose addresses IDA holds, and the objects that name them.
//!
//! IDA calls them with the address of the bridge, which [`Memory`](super::super::sundials::Memory)
//! keeps as long as IDA's memory, and with vectors that are ours or clones of ours. Written vectors
//! are distinct from read ones. No other code has a reference to the bridge meanwhile: `Memory` is
//! borrowed exclusively, and a callback within a callback (Newton's method has IDA set the matrix
//! up) holds none.

use std::os::raw::{c_int, c_void};
use std::ptr;

use sundials_sys::{
    _generic_SUNLinearSolver, _generic_SUNLinearSolver_Ops, _generic_SUNMatrix, _generic_SUNMatrix_Ops, N_Vector, SUNLinearSolver,
    SUNLinearSolver_ID, SUNLinearSolver_ID_SUNLINEARSOLVER_CUSTOM, SUNLinearSolver_Type, SUNLinearSolver_Type_SUNLINEARSOLVER_DIRECT,
    SUNMatrix, SUNMatrix_ID, SUNMatrix_ID_SUNMATRIX_CUSTOM,
};

use super::super::sundials::{Context, Kept, Lent};
use super::super::vector::Handle;
use super::{Bridge, code};

/// The bridge behind IDA's user data.
///
/// # Safety
/// As stated at the top of this file.
unsafe fn bridge(user_data: *mut c_void) -> Lent<Bridge> {
    // SAFETY: by the contract.
    unsafe { Lent::new(user_data.cast()) }
}

/// The residual, refused where it is not finite.
pub(crate) unsafe extern "C" fn residual(t: f64, y: N_Vector, yp: N_Vector, out: N_Vector, data: *mut c_void) -> c_int {
    // SAFETY: see above; so below.
    let (mut bridge, y, yp, mut out) = unsafe { (bridge(data), Handle::new(y), Handle::new(yp), Handle::new(out)) };
    code(bridge.residual(t, &y, &yp, &mut out))
}

/// The Jacobian, which stays with the bridge.
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
    // SAFETY: as above.
    let (mut bridge, y, yp) = unsafe { (bridge(data), Handle::new(y), Handle::new(yp)) };
    code(bridge.jacobian(t, cj, &y, &yp))
}

/// The integrands.
pub(crate) unsafe extern "C" fn quadratures(t: f64, y: N_Vector, yp: N_Vector, out: N_Vector, data: *mut c_void) -> c_int {
    // SAFETY: as above.
    let (mut bridge, y, yp, mut out) = unsafe { (bridge(data), Handle::new(y), Handle::new(yp), Handle::new(out)) };
    code(bridge.integrands(t, &y, &yp, out.entries_mut()))
}

/// Error weights; IDA asks for them once a step, which also makes it the place to watch the steps.
pub(crate) unsafe extern "C" fn error_weights(y: N_Vector, weights: N_Vector, data: *mut c_void) -> c_int {
    // SAFETY: as above; the weights are IDA's.
    unsafe { bridge(data).weigh(&Handle::new(y), &mut Handle::new(weights)) }
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
    // SAFETY: as above; the content of our solver is the bridge.
    unsafe { bridge((*solver).content) }.factorise()
}

unsafe extern "C" fn solver_solve(solver: SUNLinearSolver, _: SUNMatrix, x: N_Vector, b: N_Vector, _: f64) -> c_int {
    // SAFETY: as above.
    let mut bridge = unsafe { bridge((*solver).content) };
    if x != b {
        // SAFETY: as above.
        let (mut x, b) = unsafe { (Handle::new(x), Handle::new(b)) };
        x.entries_mut().copy_from_slice(b.entries());
    }
    // SAFETY: as above.
    bridge.solve(unsafe { Handle::new(x) }.entries_mut())
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

/// The linear solver as IDA knows it; its numbers are the bridge's.
pub(crate) fn linear_solver(bridge: &Kept<Bridge>, context: &Context) -> _generic_SUNLinearSolver {
    // SUNDIALS only reads the table.
    _generic_SUNLinearSolver { content: bridge.address().cast(), ops: ptr::from_ref(&SOLVER).cast_mut(), sunctx: context.raw() }
}

/// The matrix as IDA knows it; no code looks at its content.
pub(crate) fn matrix(context: &Context) -> _generic_SUNMatrix {
    _generic_SUNMatrix { content: ptr::null_mut(), ops: ptr::from_ref(&MATRIX).cast_mut(), sunctx: context.raw() }
}
