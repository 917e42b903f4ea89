//! A step allocates nothing.

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, Ordering};

use smpl_runtime::environment::{ResetOptions, Start};
use smpl_runtime::setup::EnvironmentOptions;
use support::{beer, environment, reactor};

struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

// SAFETY: passes everything on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps the contract of the same method.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn steps_of_reactor_and_beer_allocate_nothing() {
    let start = ResetOptions { start: Start::Nominal, ..ResetOptions::default() };
    let cases = [(reactor::model(), vec![26.0, 0.1]), (beer::model(1.0, 200), vec![13.0])];
    for (model, action) in cases {
        let mut env = environment(model, EnvironmentOptions::default());
        env.reset(Some(1), &start).expect("resets");
        env.step(&action).expect("steps");
        let mut observation = [0.0_f32; 8];
        let before = ALLOCATIONS.load(Ordering::Relaxed);
        for _ in 0..20 {
            env.step(&action).expect("steps");
            env.observe(true, &mut observation);
        }
        assert_eq!(ALLOCATIONS.load(Ordering::Relaxed) - before, 0);
    }
}
