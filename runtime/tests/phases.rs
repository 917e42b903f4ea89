//! Phases end when they should, wherever the ends of the steps lie.

use std::path::PathBuf;

use smpl_runtime::environment::{Environment, ResetOptions};
use smpl_runtime::load::{LoadOptions, load};
use smpl_runtime::setup::Setup;
use smpl_runtime::solver::Method;

const METHODS: [&str; 3] = ["ida", "rosenbrock", "explicit"];

/// Phases of 6.24, `second` and 0 min, in which x rises by 1, 2 and 3 a minute, stepped every `step` minutes for 10 minutes: phase, its start, x.
fn run(method: &str, step: f64, second: f64) -> (f64, f64, f64) {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join(format!("phases_{method}_{step}_{second}.eq"));
    let text = format!(
        "model M\ntime t : min\n\
         phase first for 6.24 [min] then second\nphase second for {second} [min] then third\nphase third for 0 [min] then last\nphase last\n\
         table over phase {{\n columns: slope [1]\n first: 1\n second: 2\n third: 3\n last: 0\n}}\n\
         state x = 0\neq d/dt x = slope[phase] / 1 [min]\n\
         action u = 0 in 0..1\nobserve x in 0..10\nreward r default = x\n\
         episode {{ step = {step} [min], max_steps = 10000, error_reward = -100 }}\n"
    );
    std::fs::write(&path, text).expect("writes");
    let loaded = load(&path, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    let mut options = loaded.options;
    options.solver.method = Some(Method::from_name(method).expect("a method"));
    let setup = Setup::new(loaded.model, options, Some(loaded.sources)).expect("a setup");
    let mut environment = Environment::new(setup).expect("the solver takes it");
    environment.reset(Some(0), &ResetOptions::default()).expect("a start");
    for _ in 0..(10.0 / step).round() as u32 {
        assert_eq!(environment.step(&[0.0]).expect("steps").failure, None);
    }
    let discrete = |name: &str| environment.discretes()[environment.catalogue().discretes.find(name).expect("there").at];
    (discrete("phase"), discrete("phase_start"), environment.unknowns()[0])
}

#[test]
fn a_phase_ends_within_a_step_at_its_end_or_a_rounding_error_beside_it() {
    // 6.22 + 0.02 lies a rounding error before 312 * 0.02 = 6.24.
    for step in [0.02, 0.04, 0.26, 0.1, 1.0, 2.5] {
        for method in METHODS {
            let (phase, since, x) = run(method, step, 1.0);
            assert_eq!(phase, 4.0, "{method}, step {step}");
            assert!((since - 7.24).abs() < 1e-8 && (x - 8.24).abs() < 1e-5, "{method}, step {step}: since {since}, x = {x}");
        }
    }
}

#[test]
fn a_phase_without_a_duration_is_passed_at_once() {
    for step in [0.1, 1.0] {
        for method in METHODS {
            let (phase, since, x) = run(method, step, 0.0);
            assert_eq!(phase, 4.0, "{method}, step {step}");
            assert!((since - 6.24).abs() < 1e-6 && (x - 6.24).abs() < 1e-5, "{method}, step {step}: since {since}, x = {x}");
        }
    }
}
