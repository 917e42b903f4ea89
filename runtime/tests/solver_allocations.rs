//! Restarts and advances allocate nothing.

use std::cell::Cell;
use std::ffi::c_void;

use smpl_runtime::solver::problems::{self, Problem};
use smpl_runtime::solver::{FirstStep, LinearSolver, Method, Settings, System, integrator};

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    ALLOCATIONS.with(|count| count.set(count.get() + 1));
}

fn allocations() -> u64 {
    ALLOCATIONS.with(Cell::get)
}

// The C library's own names for its allocator: `malloc` if it is not replaced.
unsafe extern "C" {
    fn __libc_malloc(size: usize) -> *mut c_void;
    fn __libc_calloc(count: usize, size: usize) -> *mut c_void;
    fn __libc_realloc(pointer: *mut c_void, size: usize) -> *mut c_void;
}

/// Takes the place of the C library's `malloc` for this program and for SUNDIALS and KLU in it; Rust's allocator calls it as well.
/// Each thread counts its own calls: the test harness allocates in another one.
#[unsafe(no_mangle)]
unsafe extern "C" fn malloc(size: usize) -> *mut c_void {
    count();
    // SAFETY: the caller keeps to the contract of `malloc`.
    unsafe { __libc_malloc(size) }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn calloc(number: usize, size: usize) -> *mut c_void {
    count();
    // SAFETY: the caller keeps to the contract of `calloc`.
    unsafe { __libc_calloc(number, size) }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn realloc(pointer: *mut c_void, size: usize) -> *mut c_void {
    count();
    // SAFETY: the caller keeps to the contract of `realloc`.
    unsafe { __libc_realloc(pointer, size) }
}

#[test]
fn allocations_in_rust_and_in_c_are_counted() {
    let before = allocations();
    let boxed = std::hint::black_box(Box::new(1.0));
    assert_eq!(allocations(), before + 1, "{boxed}");
    // SAFETY: SUNDIALS allocates the context, the content and the data of a vector, each by `malloc`.
    unsafe {
        let mut context = std::ptr::null_mut();
        sundials_sys::SUNContext_Create(std::ptr::null_mut(), &raw mut context);
        let before = allocations();
        let vector = sundials_sys::N_VNew_Serial(10, context);
        assert!(allocations() >= before + 2);
        sundials_sys::N_VDestroy(vector);
        sundials_sys::SUNContext_Free(&raw mut context);
    }
}

fn assert_no_allocation(mut problem: Problem, method: Method, choice: LinearSolver, first_step: FirstStep) {
    let mut settings = Settings::new(1e-6, vec![1e-8; problem.dimension()]);
    settings.method = method;
    settings.linear_solver = choice;
    settings.first_step = first_step;
    let mut ida = integrator(&problem, settings).expect("valid");
    let mut state = problem.start.clone();
    let mut before = 0;
    // Longer than the time after which a computation asks whether it is to stop.
    let begin = std::time::Instant::now();
    for step in 0.. {
        if step >= 20 && begin.elapsed() > 2 * smpl_runtime::interrupt::PERIOD {
            break;
        }
        if step == 2 {
            before = allocations();
        }
        if let Some(input) = problem.inputs.first_mut() {
            *input *= if step % 2 == 0 { 1.02 } else { 1.0 / 1.02 };
        }
        let t = 0.1 * f64::from(step);
        ida.restart(&mut problem, t, &state, None).expect("consistent");
        ida.advance(&mut problem, t + 0.1).expect("reaches the end");
        state.copy_from_slice(ida.state());
    }
    assert_eq!(allocations(), before, "calls of malloc with {method}, {choice:?} and {first_step:?}");
}

#[test]
fn restarts_and_advances_allocate_nothing() {
    for first_step in [FirstStep::default(), FirstStep::Scaled { factor: 0.1 }, FirstStep::Ida] {
        for choice in [LinearSolver::Dense, LinearSolver::Block, LinearSolver::Klu] {
            assert_no_allocation(problems::stirred_tank(), Method::Ida, choice, first_step);
            assert_no_allocation(problems::robertson_dae(), Method::Ida, choice, first_step);
        }
        for choice in [LinearSolver::Block, LinearSolver::Klu] {
            assert_no_allocation(problems::tubular_reactor(20), Method::Ida, choice, first_step);
        }
    }
}

#[test]
fn one_step_methods_allocate_nothing_either() {
    for method in [Method::Rosenbrock, Method::Auto] {
        for choice in [LinearSolver::Auto, LinearSolver::Block, LinearSolver::Klu] {
            assert_no_allocation(problems::stirred_tank(), method, choice, FirstStep::default());
            assert_no_allocation(problems::robertson_dae(), method, choice, FirstStep::default());
            assert_no_allocation(problems::tubular_reactor(20), method, choice, FirstStep::default());
        }
    }
    assert_no_allocation(problems::stirred_tank(), Method::Explicit, LinearSolver::Auto, FirstStep::default());
}
