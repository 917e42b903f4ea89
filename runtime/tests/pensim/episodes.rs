//! Ends, reports, draws, and the command line.

use smpl_runtime::environment::{Environment, ResetOptions, Start, StateInput};
use smpl_runtime::failure::Failure;
use smpl_runtime::load::LoadOptions;

use super::support::pensim::{environment, options, pensim};
use super::support::reference;

const RECIPE_START: [f64; 6] = [0.0, 8.0, 22.0, 30.0, 0.6, 0.0];

fn started(load: &LoadOptions, reset: &ResetOptions) -> Environment {
    let mut env = environment(pensim(load), Some(1e-6));
    env.reset(Some(0), reset).expect("a start");
    env
}

fn with_states(states: &[(&str, f64)]) -> ResetOptions {
    let named = states.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect();
    ResetOptions { start: Start::Nominal, state: StateInput::Named(named), ..ResetOptions::default() }
}

fn observation(env: &Environment) -> Vec<f64> {
    let mut out = vec![0.0; env.observation_len()];
    env.observe(false, &mut out);
    out
}

fn state(env: &Environment, name: &str) -> f64 {
    env.unknowns()[env.catalogue().states.find(name).expect("a state").at]
}

#[test]
fn an_action_outside_its_box_is_integrated_and_ends_the_episode() {
    let mut env = started(&LoadOptions::default(), &with_states(&[]));
    let mut action = RECIPE_START;
    action[4] = 1.2000000476837158;
    let inside = env.step(&action).expect("a finite action");
    assert!(inside.failure.is_none(), "single precision is within the slack");
    action[4] = 1.3;
    let before = state(&env, "V");
    let result = env.step(&action).expect("a finite action");
    assert_eq!(result.failure, Some(Failure::ActionBox));
    assert!(result.terminated && !result.truncated && !result.success);
    assert_eq!(result.reward, -100.0);
    assert_ne!(state(&env, "V"), before);
}

#[test]
fn a_drained_vessel_leaves_the_observation_box() {
    let mut env = started(&LoadOptions::default(), &with_states(&[("Wt", 25_100.0)]));
    let mut action = RECIPE_START;
    action[0] = 4000.0;
    let result = env.step(&action).expect("a finite action");
    assert!(result.terminated && result.reward == -100.0, "{result:?}");
    let message = env.failure_message();
    assert!(message.starts_with("observation_box") && message.contains("Wt"), "{message}");
    assert_eq!(observation(&env)[7], 25_003.258, "observations are clipped to their box");
}

#[test]
fn a_state_out_of_its_domain_is_a_failure_not_a_crash() {
    for (name, value) in [("V", -1.0), ("a0", -0.1), ("H", 10.0), ("O2", 1.5), ("T", 100.0)] {
        let mut env = started(&LoadOptions::default(), &with_states(&[(name, value)]));
        let result = env.step(&RECIPE_START).expect("a finite action");
        assert!(result.terminated && result.reward == -100.0, "{name}: {result:?}");
        assert!(!env.failure_message().is_empty());
    }
}

#[test]
fn a_very_bad_reward_ends_the_episode() {
    // Much product in an acid that hydrolyses a tenth of it an hour.
    let start = with_states(&[("P", 100.0), ("H", 0.03)]);
    let mut env = started(&LoadOptions::default(), &start);
    let result = env.step(&RECIPE_START).expect("a finite action");
    assert!(result.terminated && result.reward == -100.0, "{result:?}");
    let message = env.failure_message();
    assert!(message.contains("reward_floor"), "{message}");
}

#[test]
fn observations_at_reset_are_those_of_the_sampled_batch() {
    let env = started(&LoadOptions::default(), &ResetOptions::default());
    let s = |name| state(&env, name);
    let expected = [0.0, -s("H").log10(), s("T"), 0.0, 0.0, 0.0, 0.0, s("Wt"), s("DO2")];
    for (got, expected) in observation(&env).iter().zip(expected) {
        assert!((got - expected).abs() <= 1e-14 * expected.abs(), "{got} {expected}");
    }
}

#[test]
fn legacy_reports_constants_at_reset_and_a_late_clock() {
    let mut env = started(&options("legacy", &[]), &ResetOptions::default());
    let constants = [0.2, 6.5, 300.0, 0.0, 10.828493, 0.0001, 150.0, 62500.0, 14.75];
    assert_eq!(observation(&env), constants);
    for step in 0..3 {
        env.step(&RECIPE_START).expect("a finite action");
        assert!((observation(&env)[0] - 0.2 * f64::from(step)).abs() < 1e-12);
        assert!((env.time() - 0.2 * f64::from(step + 1)).abs() < 1e-12);
    }
}

#[test]
fn legacy_takes_no_initial_inventory_off_the_first_reward() {
    let start = with_states(&[("P", 1.0)]);
    let first = |load: &LoadOptions| started(load, &start).step(&RECIPE_START).expect("a step").reward;
    let off = ["disturbances=false"];
    let (default, legacy) = (first(&options("default", &off)), first(&options("legacy", &off)));
    assert!(default.abs() < 1.0, "{default}");
    assert!((legacy - 58.0).abs() < 1.0, "58000 L of 1 g/L: {legacy}");
}

/// Section 4.2 against a thousand resets: 5 standard errors.
#[test]
fn draws_have_the_distributions_of_the_specification() {
    const N: usize = 1000;
    let mut env = environment(pensim(&LoadOptions::default()), None);
    let state_names: Vec<String> = env.catalogue().states.names().map(str::to_owned).collect();
    let parameter = |env: &Environment, name: &str| env.parameters()[env.catalogue().parameters.find(name).expect("a parameter").at];
    let drawn: [(&str, f64, f64); 16] = [
        ("S", 1.0, 0.1),
        ("DO2", 15.0, 0.5),
        ("V", 58000.0, 500.0),
        ("Wt", 62000.0, 500.0),
        ("CO2out", 0.038, 0.001),
        ("O2", 0.2, 0.05),
        ("H", 6.5, 0.1),
        ("T", 297.0, 0.5),
        ("PAA", 1400.0, 50.0),
        ("NH3", 1700.0, 50.0),
        ("a0", 0.5 / 3.0, 0.05 / 3.0),
        ("mux_max", 0.41, 0.025),
        ("mu_p", 0.041, 0.0025),
        ("alpha_kla", 85.0, 10.0),
        ("PAA_c", 530_000.0, 20_000.0),
        ("N_conc_paa", 150_000.0, 2000.0),
    ];
    let mut scores = vec![Vec::with_capacity(N); drawn.len()];
    for seed in 0..N as u64 {
        env.reset(Some(seed), &ResetOptions::default()).expect("a start");
        for ((name, mean, deviation), scores) in drawn.iter().zip(&mut scores) {
            let value = match *name {
                "H" => -state(&env, "H").log10(),
                name if state_names.iter().any(|s| s == name) => state(&env, name),
                name => parameter(&env, name),
            };
            scores.push((value - mean) / deviation);
        }
        assert!((state(&env, "a1") - 2.0 * state(&env, "a0")).abs() < 1e-15);
        assert_eq!(state(&env, "P") + state(&env, "Q") + state(&env, "age"), 0.0);
        assert_eq!(state(&env, "visc"), 4.0);
    }
    let average = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / N as f64;
    let bound = 5.0 / (N as f64).sqrt();
    for (i, (name, ..)) in drawn.iter().enumerate() {
        let mean = average(&mut scores[i].iter().copied());
        let variance = average(&mut scores[i].iter().map(|x| x * x));
        assert!(mean.abs() <= bound, "{name}: mean {mean}");
        assert!((variance - 1.0).abs() <= bound * 2f64.sqrt(), "{name}: variance {variance}");
        for (j, (other, ..)) in drawn.iter().enumerate().skip(i + 1) {
            let correlation = average(&mut scores[i].iter().zip(&scores[j]).map(|(a, b)| a * b));
            // The inoculum and its growth rate share their number.
            let expected = f64::from(u8::from((*name, *other) == ("a0", "mux_max")));
            assert!((correlation - expected).abs() <= bound * 2f64.sqrt(), "{name}, {other}: {correlation}");
        }
    }
}

/// Section 4.3: variance of z_k is 0.005² (1 - 0.995^2k) / (1 - 0.995²).
#[test]
fn the_disturbance_is_a_filtered_noise_from_zero() {
    const N: u64 = 300;
    const K: i32 = 40;
    let mut env = environment(pensim(&LoadOptions::default()), Some(1e-3));
    let (mut sum, mut squares) = (0.0, 0.0);
    for seed in 0..N {
        env.reset(Some(seed), &ResetOptions::default()).expect("a start");
        assert_eq!(env.disturbances(), [0.0]);
        for _ in 0..K {
            env.step(&RECIPE_START).expect("a step");
        }
        let z = env.disturbances()[0];
        sum += z;
        squares += z * z;
    }
    let variance = 0.005f64.powi(2) * (1.0 - 0.995f64.powi(2 * K)) / (1.0 - 0.995f64.powi(2));
    let bound = 5.0 / (N as f64).sqrt();
    assert!((sum / N as f64 / variance.sqrt()).abs() <= bound);
    assert!((squares / N as f64 / variance - 1.0).abs() <= bound * 2f64.sqrt());
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn a_nominal_start_puts_everything_at_its_mean() {
    let env = started(&LoadOptions::default(), &with_states(&[]));
    for (name, mean) in [("mu_p", 0.041), ("mux_max", 0.41), ("alpha_kla", 85.0), ("PAA_c", 530_000.0), ("N_conc_paa", 150_000.0)] {
        let at = env.catalogue().parameters.find(name).expect("a parameter").at;
        assert_eq!(env.parameters()[at], mean, "{name}");
    }
    let Some(init) = reference::table("pensim_1_init.csv") else {
        return;
    };
    for element in env.catalogue().states.elements() {
        let expected = init.get(0, &element.name);
        let got = env.unknowns()[element.at];
        assert!((got - expected).abs() <= 1e-15 * expected.abs(), "{}: {got} {expected}", element.name);
    }
}
