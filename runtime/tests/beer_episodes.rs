//! Episodes of the beer: reference trajectories, success, time limit, discrete variables, policies.

mod support;

use smpl_runtime::environment::{Environment, ResetOptions, Start, StateInput};
use smpl_runtime::setup::{EnvironmentOptions, SolverOverrides};
use smpl_runtime::solver::Method;
use support::{beer, environment, reference};

const STATES: [&str; 7] = ["X_A", "X_L", "X_D", "S", "EtOH", "DY", "EA"];
const RANGES: [f64; 7] = [15.0, 15.0, 15.0, 150.0, 150.0, 10.0, 10.0];

fn state(environment: &Environment) -> Vec<f64> {
    let mut state = vec![0.0; 7];
    environment.state(&mut state);
    state
}

/// Replays a file; the largest deviation of the states, and the step in which the batch finished.
fn replay(file: &str, suffix: &str, method: &str, rtol: Option<f64>) -> Option<(f64, u32)> {
    let table = reference::table(file)?;
    let (integrate, limit) = if suffix == "tight" { (0.99, 201) } else { (1.0, 200) };
    let mut env = environment(
        beer::model(integrate, limit),
        EnvironmentOptions {
            solver: SolverOverrides { rtol, method: Some(Method::from_name(method).expect("a method")), ..SolverOverrides::default() },
            ..EnvironmentOptions::default()
        },
    );
    let columns: Vec<String> = STATES.iter().map(|s| format!("{s}.{suffix}")).collect();
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let start = StateInput::Array(table.row(0, &columns));
    env.reset(Some(0), &ResetOptions { state: start, ..ResetOptions::default() }).expect("resets");
    let mut worst: f64 = 0.0;
    for row in 1..table.len() {
        let result = env.step(&[table.get(row, "T")]).expect("steps");
        for ((x, reference), range) in state(&env).iter().zip(table.row(row, &columns)).zip(RANGES) {
            worst = worst.max((x - reference).abs() / range);
        }
        let expected = table.get(row, &format!("finish.{suffix}"));
        assert_eq!(result.reward, expected, "{file}: reward of step {row}");
        if result.terminated || result.truncated {
            assert!(result.success, "{file}: {}", env.failure_message());
            return Some((worst, env.steps()));
        }
    }
    panic!("{file} should finish");
}

const METHODS: [&str; 4] = ["ida", "rosenbrock", "explicit", "auto"];

/// Steps of the specification, section 10.
const FILES: [(&str, u32, u32); 6] = [
    ("beer_1.csv", 146, 145),
    ("beer_2.csv", 184, 182),
    ("beer_3.csv", 149, 149),
    ("beer_extra_const13.csv", 189, 187),
    ("beer_extra_lowsugar.csv", 146, 145),
    ("beer_extra_sampled.csv", 145, 145),
];

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn shipped_tolerances_follow_the_reference_trajectories_to_a_millionth() {
    for (file, legacy, default) in FILES {
        for (suffix, step) in [("tight", legacy), ("tight1h", default)] {
            for method in METHODS {
                let Some((worst, finished)) = replay(file, suffix, method, None) else {
                    return;
                };
                eprintln!("{file} {suffix} {method}: {worst:.1e}");
                assert!(worst <= 1e-6, "{file}.{suffix}, {method}: {worst:e}");
                assert_eq!(finished, step, "{file}.{suffix}, {method}");
            }
        }
    }
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn tight_tolerances_follow_the_reference_trajectories_to_a_hundred_millionth() {
    for (file, ..) in FILES {
        for method in METHODS {
            let Some((worst, _)) = replay(file, "tight1h", method, Some(1e-10)) else {
                return;
            };
            assert!(worst <= 1e-8, "{file}, {method}: {worst:e}");
        }
    }
}

/// Section 7 of the specification: from the nominal start the profile finishes in step 145 with a return of 56.
#[test]
fn the_profile_finishes_the_nominal_batch_in_step_145() {
    let mut env = environment(beer::model(1.0, 200), EnvironmentOptions::default());
    env.reset(Some(0), &ResetOptions { start: Start::Nominal, ..ResetOptions::default() }).expect("resets");
    assert_eq!(state(&env), [0.0, 2.0, 2.0, 130.0, 0.0, 0.0, 0.0]);
    let (mut total, mut action) = (0.0, [0.0]);
    while env.is_running() {
        env.policy(0, &mut action);
        total += env.step(&action).expect("steps").reward;
    }
    assert_eq!((env.steps(), total), (145, 56.0));
    assert_eq!(env.discretes()[0], 145.0, "elapsed");
}

#[test]
fn a_batch_that_never_finishes_is_truncated_at_the_limit() {
    let mut env = environment(beer::model(1.0, 200), EnvironmentOptions::default());
    env.reset(Some(0), &ResetOptions { start: Start::Nominal, ..ResetOptions::default() }).expect("resets");
    let mut total = 0.0;
    while env.is_running() {
        let result = env.step(&[9.0]).expect("steps");
        total += result.reward;
        assert!(!result.terminated);
    }
    assert_eq!((env.steps(), total, env.last().map(|r| r.truncated)), (200, -399.0, Some(true)));
}

/// In step 201 `elapsed` is 201, outside its box: -200 and a failure, which wins over the time limit.
#[test]
fn the_legacy_limit_ends_in_a_failure() {
    let mut env = environment(beer::model(0.99, 201), EnvironmentOptions::default());
    env.reset(Some(0), &ResetOptions { start: Start::Nominal, ..ResetOptions::default() }).expect("resets");
    let mut total = 0.0;
    while env.is_running() {
        total += env.step(&[9.0]).expect("steps").reward;
    }
    assert_eq!((env.steps(), total), (201, -400.0));
    assert_eq!(env.failure_message(), "state_box: elapsed = 201 h is above 200 h");
}

#[test]
fn discrete_variables_are_set_by_name() {
    let mut env = environment(beer::model(1.0, 200), EnvironmentOptions::default());
    let discrete = [("elapsed".to_owned(), 7.0)].into();
    env.reset(Some(0), &ResetOptions { discrete, ..ResetOptions::default() }).expect("resets");
    let biomass: f64 = state(&env)[..3].iter().sum();
    assert_eq!(env.discretes(), [7.0, biomass]);
    env.step(&[13.0]).expect("steps");
    assert_eq!(env.discretes()[0], 8.0);
}
