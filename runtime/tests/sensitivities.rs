//! Steps with their derivatives, against closed solutions.

use std::path::PathBuf;
use std::sync::Arc;

use smpl_runtime::environment::{Direction, Environment, Follower, ResetOptions, Start, StateInput};
use smpl_runtime::load::{self, LoadOptions};
use smpl_runtime::rollout::Given;
use smpl_runtime::sensitivity::{Arrays, Plan, Sensitivities, SensitivityError};
use smpl_runtime::setup::Setup;

const DECAY: &str = "model Decay\nparam k : 1/s = 0.5\naction u = 1 in 0..2\nstate x = 1\nstate y = 2\n\
    eq d/dt x = u*1[1/s] - k*x\neq d/dt y = k*x - k*y\nobserve x in 0..9\nreward r = x*u\nepisode { step = 1 [s] }\nsolver { rtol = 1e-10 }";

fn setup_of_text(text: &str) -> Arc<Setup> {
    let loaded = load::load_text(&PathBuf::from("test.eq"), text.to_owned(), &LoadOptions::default());
    let loaded = loaded.unwrap_or_else(|error| panic!("{error}"));
    Setup::new(loaded.model, loaded.options, Some(loaded.sources)).expect("ready")
}

/// States after a step and their derivatives by two states, an action and a parameter.
fn derivatives(setup: &Arc<Setup>, threads: usize, states: &[f64]) -> Result<(Vec<f64>, Vec<f64>), SensitivityError> {
    let directions = vec![Direction::State(0), Direction::State(1), Direction::Action(0), Direction::Parameter(0)];
    let count = states.len() / 2;
    let mut sensitivities = Sensitivities::new(setup, directions, threads)?;
    let (mut reached, mut by_states) = (vec![0.0; 2 * count], vec![0.0; 8 * count]);
    let (mut rewards, mut observations) = (vec![0.0; count], vec![0.0; count]);
    let (mut by_rewards, mut by_observations) = (vec![0.0; 4 * count], vec![0.0; 4 * count]);
    let given = || Given::new();
    let (parameters, discrete, disturbances) = (given(), given(), given());
    let plan = Plan { count, horizon: 1, states, actions: &[1.0], parameters, discrete, disturbances, first_step: 0 };
    sensitivities.run(
        &plan,
        Arrays {
            states: &mut reached,
            rewards: &mut rewards,
            observations: &mut observations,
            by_states: &mut by_states,
            by_rewards: &mut by_rewards,
            by_observations: &mut by_observations,
        },
    )?;
    Ok((reached, by_states))
}

#[test]
fn a_chain_has_the_derivatives_of_its_solution() {
    let setup = setup_of_text(DECAY);
    let (reached, found) = derivatives(&setup, 1, &[1.0, 2.0]).expect("derivatives");
    // x = u/k + (x0 - u/k) e, y = u/k + (y0 - u/k + (k x0 - u) t) e with e = exp(-k t), t = 1.
    let (k, e) = (0.5_f64, (-0.5_f64).exp());
    let slope = -(1.0 - e) / (k * k);
    let expected = [e, 0.0, (1.0 - e) / k, slope + e, k * e, e, (1.0 - e) / k - e, slope + 1.5 * e];
    assert!((reached[0] - (2.0 - e)).abs() < 1e-9, "{reached:?}");
    for (at, expected) in expected.iter().enumerate() {
        assert!((found[at] - expected).abs() < 1e-8, "{at}: {} {expected}", found[at]);
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let setup = setup_of_text(DECAY);
    let states: Vec<f64> = (0..20).map(|i| 0.3 * f64::from(i)).collect();
    assert_eq!(derivatives(&setup, 1, &states).expect("one"), derivatives(&setup, 3, &states).expect("three"));
}

#[test]
fn the_quick_way_and_the_sure_one_agree() {
    let setup = setup_of_text(DECAY);
    let options =
        ResetOptions { start: Start::Nominal, state: StateInput::Array(vec![0.3, 1.7]), expected: true, ..ResetOptions::default() };
    let mut environment = Environment::new(Arc::clone(&setup)).expect("an environment");
    let directions = [Direction::State(0), Direction::Parameter(0)];
    let mut found = Vec::new();
    for mut follower in [Follower::new(&setup, 2).expect("a follower"), Follower::quick(&setup, 2).expect("made").expect("serves")] {
        environment.reset(Some(0), &options).expect("a start");
        environment.follow(&mut follower, &directions, &options, &[0.7]).expect("derivatives");
        found.push([0, 1].map(|unknown| [0, 1].map(|direction| follower.derivative(unknown, direction))));
        assert!((environment.reward_derivative(&follower, 0, 0) - 0.7 * (-0.5_f64).exp()).abs() < 1e-8);
    }
    // To the tolerance of derivatives.
    for (sure, quick) in found[0].iter().flatten().zip(found[1].iter().flatten()) {
        assert!((sure - quick).abs() < 1e-6, "{sure} {quick}");
    }
}

#[test]
fn lengths_are_checked() {
    let setup = setup_of_text(DECAY);
    let mut sensitivities = Sensitivities::new(&setup, vec![Direction::State(0)], 1).expect("ready");
    let given = || Given::new();
    let (parameters, discrete, disturbances) = (given(), given(), given());
    let plan = Plan { count: 1, horizon: 1, states: &[1.0], actions: &[1.0], parameters, discrete, disturbances, first_step: 0 };
    let arrays = Arrays {
        states: &mut [],
        rewards: &mut [],
        observations: &mut [],
        by_states: &mut [],
        by_rewards: &mut [],
        by_observations: &mut [],
    };
    let error = sensitivities.run(&plan, arrays).expect_err("a state too few").to_string();
    assert_eq!(error, "states has 1 entries, expected 2");
}
