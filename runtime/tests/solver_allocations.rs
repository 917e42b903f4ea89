//! Restarts and advances allocate nothing.

use std::alloc::{GlobalAlloc, Layout, System as Allocator};
use std::cell::Cell;

use smpl_runtime::solver::problems::{self, Problem};
use smpl_runtime::solver::{FirstStep, Ida, Integrator, LinearSolver, Settings, System};

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        unsafe { Allocator.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { Allocator.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Vectors and matrices all come from this allocator, so a clone made by SUNDIALS is counted too; `mallinfo2` counts the C side.
fn heap_in_use() -> usize {
    #[repr(C)]
    struct MallInfo2([usize; 10]);
    unsafe extern "C" {
        fn mallinfo2() -> MallInfo2;
    }
    // The eighth field is the space in use.
    unsafe { mallinfo2() }.0[7]
}

fn assert_no_allocation(mut problem: Problem, choice: LinearSolver, first_step: FirstStep) {
    let mut settings = Settings::new(1e-6, vec![1e-8; problem.dimension()]);
    settings.linear_solver = choice;
    settings.first_step = first_step;
    let mut ida = Ida::new(&problem, settings).expect("valid");
    let mut state = problem.start.clone();
    let mut before = (0, 0);
    for step in 0..20 {
        if step == 2 {
            before = (ALLOCATIONS.with(Cell::get), heap_in_use());
        }
        if let Some(input) = problem.inputs.first_mut() {
            *input *= if step % 2 == 0 { 1.02 } else { 1.0 / 1.02 };
        }
        let t = 0.1 * f64::from(step);
        ida.restart(&mut problem, t, &state, None).expect("consistent");
        ida.advance(&mut problem, t + 0.1).expect("reaches the end");
        state.copy_from_slice(ida.state());
    }
    assert_eq!(ALLOCATIONS.with(Cell::get), before.0, "allocations in Rust");
    assert_eq!(heap_in_use(), before.1, "space taken in C");
}

#[test]
fn restarts_and_advances_allocate_nothing() {
    for first_step in [FirstStep::default(), FirstStep::Scaled { factor: 0.1 }, FirstStep::Ida] {
        for choice in [LinearSolver::Dense, LinearSolver::Block, LinearSolver::Klu] {
            assert_no_allocation(problems::stirred_tank(), choice, first_step);
            assert_no_allocation(problems::robertson_dae(), choice, first_step);
        }
        for choice in [LinearSolver::Block, LinearSolver::Klu] {
            assert_no_allocation(problems::tubular_reactor(20), choice, first_step);
        }
    }
}
