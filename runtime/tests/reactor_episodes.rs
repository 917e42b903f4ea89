//! Episodes of the reactor: reference trajectories, failures, rewards, seeds, snapshots.

mod support;

use smpl_runtime::environment::{Environment, ResetOptions, Snapshot, SnapshotError, Start, StateInput, StepError};
use smpl_runtime::failure::Failure;
use smpl_runtime::setup::{EnvironmentOptions, SolverOverrides};
use smpl_runtime::solver::Method;
use support::reactor::{self, Alternatives};
use support::{environment, reference};

const STATES: [&str; 3] = ["c_A.tight", "T.tight", "h.tight"];
const RANGES: [f64; 3] = [1.0, 100.0, 1.0];
const NOMINAL: [f64; 2] = [26.85, 0.1];

fn with(options: EnvironmentOptions) -> Environment {
    environment(reactor::model(), options)
}

fn at(state: &[f64]) -> ResetOptions {
    ResetOptions { state: StateInput::Array(state.to_vec()), ..ResetOptions::default() }
}

fn state(environment: &Environment) -> Vec<f64> {
    let mut state = vec![0.0; 3];
    environment.state(&mut state);
    state
}

/// Replays a reference file open loop; the largest deviation as a fraction of the ranges, but for a failing last row.
fn deviation(file: &str, method: &str, tight: bool) -> Option<f64> {
    let table = reference::table(file)?;
    let mut options = EnvironmentOptions {
        max_steps: Some(1000),
        solver: SolverOverrides { method: Some(Method::from_name(method).expect("a method")), ..SolverOverrides::default() },
        ..EnvironmentOptions::default()
    };
    if tight {
        (options.solver.rtol, options.solver.atol_factor) = (Some(1e-11), Some(0.01));
    }
    let mut env = with(options);
    env.reset(Some(0), &at(&table.row(0, &STATES))).expect("the start is consistent");
    let mut worst: f64 = 0.0;
    for row in 1..table.len() {
        let result = env.step(&table.row(row, &["T_c", "q_out"])).expect("a finite action");
        let failing = table.get(row, "done.tight") != 0.0 && row + 1 == table.len() && row < 101;
        if failing {
            assert!(result.failure.is_some(), "{file}: step {row} should fail");
            break;
        }
        assert_eq!(result.failure, None, "{file}: step {row}");
        for ((x, reference), range) in state(&env).iter().zip(table.row(row, &STATES)).zip(RANGES) {
            worst = worst.max((x - reference).abs() / range);
        }
    }
    Some(worst)
}

const METHODS: [&str; 4] = ["ida", "rosenbrock", "explicit", "auto"];

const FILES: [&str; 6] =
    ["reactor_1.csv", "reactor_2.csv", "reactor_3.csv", "reactor_extra_ignition.csv", "reactor_extra_drain.csv", "reactor_extra_mpc.csv"];

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn shipped_tolerances_follow_the_reference_trajectories_to_a_millionth() {
    for (file, method) in FILES.into_iter().flat_map(|file| METHODS.map(|method| (file, method))) {
        if let Some(worst) = deviation(file, method, false) {
            eprintln!("{file}, {method}: {worst:.1e}");
            assert!(worst <= 1e-6, "{file}, {method}: {worst:e}");
        }
    }
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn tight_tolerances_follow_the_reference_trajectories_to_a_hundred_millionth() {
    for (file, method) in FILES.into_iter().flat_map(|file| METHODS.map(|method| (file, method))) {
        if let Some(worst) = deviation(file, method, true) {
            eprintln!("{file}, {method}: {worst:.1e}");
            assert!(worst <= 1e-8, "{file}, {method}: {worst:e}");
        }
    }
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn legacy_rewards_are_those_of_the_reference() {
    let Some(table) = reference::table("reactor_2.csv") else {
        return;
    };
    let options =
        EnvironmentOptions { solver: SolverOverrides { rtol: Some(1e-11), ..SolverOverrides::default() }, ..EnvironmentOptions::default() };
    let mut env = environment(reactor::build(Alternatives { legacy: true }), options);
    env.reset(Some(0), &at(&table.row(0, &STATES))).expect("the start is consistent");
    for row in 1..table.len() {
        let result = env.step(&table.row(row, &["T_c", "q_out"])).expect("a finite action");
        let expected = table.get(row, "setpoint.tight");
        assert!((result.reward - expected).abs() <= 1e-6 * expected.abs().max(1e-3), "{row}: {} {expected}", result.reward);
        assert_eq!(result.truncated, row == 101);
    }
}

/// Steady state of the specification, section 2.
#[test]
fn the_steady_state_is_that_of_the_specification() {
    let env = with(EnvironmentOptions::default());
    let expected = [0.877_825_200_550_143_4, 51.346_606_192_950_78, 0.659];
    for (x, e) in env.setup().steady_state().iter().zip(expected) {
        assert!((x - e).abs() < 1e-11 * e, "{x} {e}");
    }
    assert_eq!(env.setup().steady_action(), NOMINAL);
}

#[test]
fn the_time_limit_truncates_after_exactly_the_given_steps() {
    let mut env = with(EnvironmentOptions { max_steps: Some(3), ..EnvironmentOptions::default() });
    env.reset(Some(1), &ResetOptions { start: Start::Steady, ..ResetOptions::default() }).expect("resets");
    for step in 1..=3 {
        let result = env.step(&NOMINAL).expect("steps");
        assert_eq!((result.terminated, result.truncated), (false, step == 3));
        assert!((result.time - 0.1 * f64::from(step)).abs() < 1e-12);
    }
    assert_eq!(env.step(&NOMINAL), Err(StepError::EpisodeOver));
}

#[test]
fn a_failure_in_the_last_step_wins_over_the_time_limit() {
    let mut env = with(EnvironmentOptions { max_steps: Some(1), ..EnvironmentOptions::default() });
    env.reset(Some(1), &ResetOptions::default()).expect("resets");
    let result = env.step(&[40.0, 0.1]).expect("steps");
    assert_eq!((result.terminated, result.truncated, result.failure), (true, false, Some(Failure::ActionBox)));
}

#[test]
fn an_action_outside_its_box_is_integrated_and_fails() {
    let mut env = with(EnvironmentOptions::default());
    env.reset(Some(1), &ResetOptions { start: Start::Steady, ..ResetOptions::default() }).expect("resets");
    let before = state(&env);
    let result = env.step(&[40.0, 0.1]).expect("steps");
    assert!(state(&env)[1] > before[1] + 1.0, "the hot jacket acted");
    assert_eq!((result.reward, result.failure), (-1000.0, Some(Failure::ActionBox)));
    assert_eq!(env.rewards(), [-1000.0, -1000.0]);
    assert!((env.violations()[0] - 0.25).abs() < 1e-12, "5 K over a range of 20 K");
    assert_eq!(result.cost, env.violations().iter().sum::<f64>());
    assert_eq!(env.failure_message(), "action_box: T_c = 40 degC is above 35 degC");
}

#[test]
fn a_single_precision_bound_is_inside_the_action_box() {
    let mut env = with(EnvironmentOptions::default());
    env.reset(Some(1), &ResetOptions { start: Start::Steady, ..ResetOptions::default() }).expect("resets");
    let result = env.step(&[26.85, f64::from(0.2_f32)]).expect("steps");
    assert_eq!((result.failure, env.violations()[0]), (None, 0.0));
}

#[test]
fn an_infinite_action_fails_without_being_integrated() {
    let mut env = with(EnvironmentOptions::default());
    env.reset(Some(1), &ResetOptions::default()).expect("resets");
    let before = state(&env);
    let result = env.step(&[f64::INFINITY, 0.1]).expect("steps");
    assert_eq!((result.failure, state(&env)), (Some(Failure::ActionBox), before));
    assert!(env.failure_message().starts_with("action_box"));
}

#[test]
fn a_nan_action_is_refused_and_nothing_is_stepped() {
    let mut env = with(EnvironmentOptions::default());
    env.reset(Some(1), &ResetOptions::default()).expect("resets");
    let before = state(&env);
    assert_eq!(env.step(&[26.0, f64::NAN]), Err(StepError::NotANumber { name: "q_out".into() }));
    assert_eq!((env.steps(), state(&env)), (0, before));
    assert!(env.step(&NOMINAL).is_ok());
}

#[test]
fn an_emptying_tank_stops_at_the_event() {
    let mut env = with(EnvironmentOptions::default());
    env.reset(Some(1), &at(&[0.9, 30.0, 0.05])).expect("resets");
    let result = env.step(&[15.0, 0.2]).expect("steps");
    // h falls by 0.1/0.15067 m a minute: 0.066 m in the step.
    assert_eq!(result.failure, Some(Failure::Declared(1)));
    assert!(state(&env)[2].abs() < 1e-6);
    assert!(env.failure_message().contains("empty: the tank has run empty"), "{}", env.failure_message());
}

#[test]
fn a_state_outside_its_box_is_named_with_its_value() {
    let mut env = with(EnvironmentOptions::default());
    env.reset(Some(1), &at(&[0.9, 30.0, 0.99])).expect("resets");
    let result = env.step(&[26.0, 0.05]).expect("steps");
    assert_eq!(result.failure, Some(Failure::Declared(0)));
    assert_eq!(env.failure_message(), "state_box: h = 1.023184 m is above 1 m");
    let names: Vec<&str> = env.constraint_names().collect();
    assert_eq!(names, ["action_box", "state_box", "empty"]);
    assert!((env.violations()[1] - 0.023_184).abs() < 1e-5);
}

#[test]
fn a_given_state_is_simulated_as_it_is() {
    let mut env = with(EnvironmentOptions::default());
    env.reset(Some(1), &at(&[1.5, 20.0, 0.5])).expect("resets");
    assert_eq!(state(&env), [1.5, 20.0, 0.5]);
    let mut observation = [0.0; 3];
    env.observe(false, &mut observation);
    assert_eq!(observation, [1.0, 20.0, 0.5], "the observation is clipped, the state is not");
}

#[test]
fn a_partly_given_state_keeps_the_sampled_rest() {
    let mut env = with(EnvironmentOptions::default());
    env.reset(Some(5), &ResetOptions::default()).expect("resets");
    let sampled = state(&env);
    let named = StateInput::Named([("T".to_owned(), 40.0)].into());
    env.reset(Some(5), &ResetOptions { state: named, ..ResetOptions::default() }).expect("resets");
    assert_eq!(state(&env), [sampled[0], 40.0, sampled[2]]);
}

#[test]
fn unknown_names_are_refused_with_the_right_ones() {
    let mut env = with(EnvironmentOptions::default());
    let named = StateInput::Named([("Temp".to_owned(), 40.0)].into());
    let error = env.reset(Some(5), &ResetOptions { state: named, ..ResetOptions::default() }).expect_err("unknown");
    assert_eq!(error.to_string(), "unknown state `Temp`; known: c_A, T, h");
    let parameters = [("k0".to_owned(), 1.0)].into();
    let error = env.reset(Some(5), &ResetOptions { parameters, ..ResetOptions::default() }).expect_err("unknown");
    assert!(error.to_string().contains("did you mean `k_0`?"), "{error}");
    assert_eq!(env.step(&NOMINAL), Err(StepError::EpisodeOver));
}

/// Sampling of the specification, section 4: c_A = 1 exactly with probability 26.8 %, T in 35.94..66.75, h in 0.4613..0.8567.
#[test]
fn starts_are_sampled_around_the_set_point_and_clipped() {
    let mut env = with(EnvironmentOptions::default());
    let (mut clipped, n) = (0, 2000);
    for seed in 0..n {
        env.reset(Some(seed), &ResetOptions::default()).expect("resets");
        let x = state(&env);
        clipped += u64::from(x[0] == 1.0);
        assert!((0.6144..=1.0).contains(&x[0]) && (35.94..66.76).contains(&x[1]) && (0.4612..0.8568).contains(&x[2]));
    }
    let part = clipped as f64 / n as f64;
    assert!((part - 0.268).abs() < 0.03, "{part}");
}

#[test]
fn the_same_seed_gives_the_same_episode_whatever_came_before() {
    let episode = |env: &mut Environment, seed: Option<u64>| -> Vec<u64> {
        env.reset(seed, &ResetOptions::default()).expect("resets");
        let mut bits = Vec::new();
        for _ in 0..5 {
            env.step(&[20.0, 0.09]).expect("steps");
            bits.extend(state(env).iter().map(|x| x.to_bits()));
        }
        bits
    };
    let (mut a, mut b) = (with(EnvironmentOptions::default()), with(EnvironmentOptions::default()));
    let first = episode(&mut a, Some(3));
    episode(&mut b, Some(99));
    assert_eq!(first, episode(&mut b, Some(3)));
    let second = episode(&mut a, None);
    assert_ne!(first, second, "the next episode of a seed is another one");
    assert_eq!(second, episode(&mut b, None), "and the same one every time");
}

#[test]
fn a_snapshot_continues_bit_for_bit() {
    let mut env = with(EnvironmentOptions::default());
    env.reset(Some(8), &ResetOptions::default()).expect("resets");
    for _ in 0..10 {
        env.step(&[26.0, 0.101]).expect("steps");
    }
    let snapshot = env.snapshot();
    let run = |env: &mut Environment| -> Vec<u64> {
        (0..20)
            .flat_map(|i| {
                let result = env.step(&[20.0 + f64::from(i) * 0.2, 0.1]).expect("steps");
                let mut bits: Vec<u64> = state(env).iter().map(|x| x.to_bits()).collect();
                bits.push(result.reward.to_bits());
                bits
            })
            .collect()
    };
    let first = run(&mut env);
    env.restore(&snapshot).expect("its own");
    assert_eq!(first, run(&mut env));
    let mut other = Environment::new(std::sync::Arc::clone(env.setup())).expect("makes");
    other.restore(&snapshot).expect("of the same model");
    assert_eq!(first, run(&mut other));
}

#[test]
fn a_snapshot_as_bytes_continues_bit_for_bit_in_another_compilation_of_the_same_model_only() {
    let mut env = with(EnvironmentOptions::default());
    env.reset(Some(8), &ResetOptions::default()).expect("resets");
    env.step(&[26.0, 0.101]).expect("steps");
    let bytes = env.snapshot().to_bytes().expect("encodes");
    let snapshot = Snapshot::from_bytes(&bytes).expect("its own bytes");
    env.step(&[20.0, 0.1]).expect("steps");

    let mut same = with(EnvironmentOptions { max_steps: Some(50), ..EnvironmentOptions::default() });
    same.restore(&snapshot).expect("of the same model");
    same.step(&[20.0, 0.1]).expect("steps");
    assert_eq!(state(&same), state(&env));

    let mut tighter = with(EnvironmentOptions {
        solver: SolverOverrides { rtol: Some(1e-10), ..SolverOverrides::default() },
        ..EnvironmentOptions::default()
    });
    assert!(matches!(tighter.restore(&snapshot), Err(SnapshotError::Foreign { .. })));
    assert!(matches!(Snapshot::from_bytes(&bytes[1..]), Err(SnapshotError::Damaged(_))));
    assert!(matches!(Snapshot::from_bytes(&bytes[..bytes.len() - 1]), Err(SnapshotError::Damaged(_))));
}

#[test]
fn a_sparse_reward_is_the_sum_at_the_end() {
    let options = |sparse| EnvironmentOptions { sparse, max_steps: Some(20), ..EnvironmentOptions::default() };
    let (mut dense, mut sparse) = (with(options(false)), with(options(true)));
    let mut sum = 0.0;
    dense.reset(Some(4), &ResetOptions::default()).expect("resets");
    sparse.reset(Some(4), &ResetOptions::default()).expect("resets");
    for step in 1..=20 {
        sum += dense.step(&NOMINAL).expect("steps").reward;
        let reward = sparse.step(&NOMINAL).expect("steps").reward;
        assert_eq!(reward, if step == 20 { sum } else { 0.0 });
    }
}

#[test]
fn the_chosen_reward_is_returned() {
    let mut env = with(EnvironmentOptions { reward: Some("setpoint_change".into()), ..EnvironmentOptions::default() });
    env.reset(Some(4), &ResetOptions::default()).expect("resets");
    let result = env.step(&NOMINAL).expect("steps");
    // The distance of the start is -1, so the change is that of the other reward.
    assert!((result.reward - (env.rewards()[0] + 1.0)).abs() < 1e-12);
    assert_eq!(result.reward, env.rewards()[1]);
}

#[test]
fn a_parameter_of_an_episode_moves_its_steady_state_and_is_forgotten() {
    let mut env = with(EnvironmentOptions::default());
    let nominal = env.setup().steady_state().to_vec();
    let parameters = [("k_0".to_owned(), 6.0e10)].into();
    env.reset(Some(4), &ResetOptions { parameters, start: Start::Steady, ..ResetOptions::default() }).expect("resets");
    assert!(env.steady_state()[0] > nominal[0] + 0.005, "a slower reaction leaves more A");
    let before = state(&env);
    env.step(&NOMINAL).expect("steps");
    assert!(state(&env).iter().zip(&before).all(|(a, b)| (a - b).abs() < 1e-7 * b), "it is at rest there");
    env.reset(Some(4), &ResetOptions::default()).expect("resets");
    assert_eq!(env.steady_state(), nominal);
}
