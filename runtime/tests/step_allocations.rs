//! A step allocates nothing.

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::PathBuf;
use std::sync::Arc;

use smpl_runtime::environment::{Direction, Environment, Follower, ResetOptions, Start, StateInput};
use smpl_runtime::load::{self, LoadOptions};
use smpl_runtime::setup::{EnvironmentOptions, Setup};
use support::{beer, environment, reactor};

struct Counting;

thread_local! {
    /// Each thread counts its own: the test harness allocates in another one.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

fn allocations() -> u64 {
    ALLOCATIONS.with(Cell::get)
}

// SAFETY: passes everything on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
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
        let before = allocations();
        for _ in 0..20 {
            env.step(&action).expect("steps");
            env.observe(true, &mut observation);
        }
        assert_eq!(allocations() - before, 0);
    }
}

/// A pendulum with its angle as an algebraic unknown, which an event brakes: corrections project its states.
const PENDULUM: &str = "model Pendulum\naction M : 1/s^2 = 0 in -2..2\nstate x = 0\nstate y = -1\nstate u : 1/s = 0\nstate v : 1/s = 0\n\
    var a = 0\nvar F : 1/s^2\neq d/dt x = u\neq d/dt y = v\neq d/dt u = -F*x - M*y\neq d/dt v = -F*y + M*x - 9.81[1/s^2]\n\
    eq x = sin(a)\neq y = -cos(a)\nevent side when x > 0.05\nat side { reset u = 0.9*u }\n\
    observe x in -2..2\nepisode { step = 0.1 [s] }";

#[test]
fn steps_that_project_states_by_corrections_allocate_nothing() {
    let loaded = load::load_text(&PathBuf::from("pendulum.eq"), PENDULUM.to_owned(), &LoadOptions::default());
    let loaded = loaded.unwrap_or_else(|error| panic!("{error}"));
    assert!(!loaded.model.interface().reduction.corrections.is_empty());
    let setup = Setup::new(loaded.model, loaded.options, Some(loaded.sources)).expect("ready");
    let mut environment = Environment::new(setup).expect("an environment");
    environment.reset(Some(0), &ResetOptions::default()).expect("a start");
    let mut steps = || {
        let before = allocations();
        for _ in 0..20 {
            environment.step(&[1.0]).expect("a step");
        }
        allocations() - before
    };
    // Space for partial pivoting is made where a pivot is first unfit.
    steps();
    assert_eq!([steps(), steps()], [0, 0]);
}

/// A tank that empties through a valve, with all parts of a step. It has an algebraic loop, an event, a switch of the equations and a break
/// in time that a parameter moves. A step has updates at both ends, a computed parameter and a reward that is an integral.
const TANK: &str = "model Tank\nparam k : 1/s = 0.5\nparam k_2 : 1/s = 2*k\nparam begin : s = 0.31\naction u = 1 in 0..2\n\
    discrete open = 1\nstate h = 2\nstate c = 1\nvar q\n\
    eq q + 0.1*q^3 = open*h\neq d/dt h = u*1[1/s] - k*q + (if t > begin then 0.4 else 0)*1[1/s]\n\
    eq d/dt c = if c < 0.9 then -0.5*k_2*c else -k_2*c\n\
    event low when h < 1.8\nat low { next open = 0.5*open }\nat start { next open = open + 0.1*u }\nat end { next open = open + 0.1*(h - 1) }\n\
    observe q in 0..9\nreward r = integral(c*h) / 1 [s]\nepisode { step = 1 [s] }\nsolver { rtol = 1e-8 }";

#[test]
fn steps_with_derivatives_allocate_nothing() {
    let loaded = load::load_text(&PathBuf::from("tank.eq"), TANK.to_owned(), &LoadOptions::default());
    let loaded = loaded.unwrap_or_else(|error| panic!("{error}"));
    let setup = Setup::new(loaded.model, loaded.options, Some(loaded.sources)).expect("ready");
    let state = StateInput::Array(vec![2.0, 1.0]);
    let options = ResetOptions { start: Start::Nominal, state, expected: true, ..ResetOptions::default() };
    let mut environment = Environment::new(Arc::clone(&setup)).expect("an environment");
    let directions = [
        Direction::State(0),
        Direction::State(1),
        Direction::Action(0),
        Direction::Parameter(0),
        Direction::Parameter(1),
        Direction::Parameter(2),
    ];
    let mut follower = Follower::new(&setup, directions.len()).expect("a follower");
    let mut follow = || {
        environment.reset(Some(0), &options).expect("a start");
        let before = allocations();
        environment.follow(&mut follower, &directions, &options, &[0.7]).expect("derivatives");
        allocations() - before
    };
    let first = follow();
    assert!(first > 0, "space is made once");
    assert_eq!([follow(), follow()], [0, 0]);
}
