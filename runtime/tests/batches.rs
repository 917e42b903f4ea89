//! Batches: equal to single environments on any number of threads; autoreset modes.

mod support;

use smpl_runtime::batch::{Autoreset, Batch, BatchError, BatchOptions, StepArrays};
use smpl_runtime::environment::{Environment, ResetOptions};
use smpl_runtime::observe::denormalise;
use smpl_runtime::setup::{EnvironmentOptions, SolverOverrides};
use smpl_runtime::solver::Method;
use support::{reactor, setup};

/// Buffers of a caller.
struct Arrays {
    observations: Vec<f64>,
    rewards: Vec<f64>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
}

impl Arrays {
    fn new(n: usize) -> Self {
        Self { observations: vec![0.0; 3 * n], rewards: vec![0.0; n], terminated: vec![false; n], truncated: vec![false; n] }
    }

    fn step(&mut self, batch: &mut Batch, actions: &[f64]) -> Result<(), BatchError> {
        batch.step(
            actions,
            StepArrays {
                observations: &mut self.observations,
                rewards: &mut self.rewards,
                terminated: &mut self.terminated,
                truncated: &mut self.truncated,
            },
        )
    }
}

fn batch(n: usize, autoreset: Autoreset, threads: usize, max_steps: u32) -> Batch {
    let setup = setup(reactor::model(), EnvironmentOptions { max_steps: Some(max_steps), ..EnvironmentOptions::default() });
    Batch::new(&setup, n, BatchOptions { autoreset, threads, ..BatchOptions::default() }).expect("a batch")
}

fn actions(n: usize, step: usize) -> Vec<f64> {
    (0..2 * n).map(|i| ((i * 7 + step * 3) % 11) as f64 / 11.0 - 0.5).collect()
}

#[test]
fn each_instance_is_the_single_environment_of_its_seed_on_any_number_of_threads() {
    let (n, steps, seed) = (40, 25, 11_u64);
    let run = |threads| {
        let mut batch = batch(n, Autoreset::Disabled, threads, 1000);
        let mut arrays = Arrays::new(n);
        let seeds = batch.seeds(seed);
        batch.reset(Some(&seeds), None, &mut arrays.observations).expect("resets");
        let mut bits: Vec<Vec<u64>> = vec![Vec::new(); n];
        for step in 0..steps {
            let over = (0..n).any(|i| !batch.environment(i).expect("exists").is_running());
            if over {
                break;
            }
            arrays.step(&mut batch, &actions(n, step)).expect("steps");
            for (i, bits) in bits.iter_mut().enumerate() {
                bits.extend(arrays.observations[3 * i..3 * i + 3].iter().map(|x| x.to_bits()));
                bits.push(arrays.rewards[i].to_bits());
            }
        }
        bits
    };
    let one = run(1);
    assert_eq!(one, run(2));
    let setup = setup(reactor::model(), EnvironmentOptions { max_steps: Some(1000), ..EnvironmentOptions::default() });
    for (i, bits) in one.iter().enumerate() {
        let mut env = Environment::new(std::sync::Arc::clone(&setup)).expect("makes");
        env.reset(Some(seed + i as u64), &ResetOptions::default()).expect("resets");
        let mut single = Vec::new();
        for step in 0..bits.len() / 4 {
            let all = actions(n, step);
            let action = [denormalise(all[2 * i], 15.0, 35.0), denormalise(all[2 * i + 1], 0.05, 0.2)];
            let result = env.step(&action).expect("steps");
            let mut observation = [0.0_f64; 3];
            env.observe(true, &mut observation);
            single.extend(observation.iter().map(|x| x.to_bits()));
            single.push(result.reward.to_bits());
        }
        assert_eq!(&single, bits, "instance {i}");
    }
}

#[test]
fn next_step_resets_in_the_step_after_the_end() {
    let mut batch = batch(2, Autoreset::NextStep, 1, 2);
    let mut arrays = Arrays::new(2);
    batch.reset(Some(&[1, 2]), None, &mut arrays.observations).expect("resets");
    let first = arrays.observations.clone();
    let still = [0.185, -1.0 / 3.0, 0.185, -1.0 / 3.0];
    arrays.step(&mut batch, &still).expect("steps");
    arrays.step(&mut batch, &still).expect("steps");
    assert_eq!(arrays.truncated, [true, true]);
    // The action of the resetting step is ignored, be it NaN.
    arrays.step(&mut batch, &[f64::NAN; 4]).expect("resets");
    assert_eq!((arrays.rewards.as_slice(), arrays.truncated.as_slice()), ([0.0, 0.0].as_slice(), [false, false].as_slice()));
    assert_ne!(arrays.observations, first, "it is the next episode of the seed");
    assert_eq!(batch.environment(0).map(Environment::steps), Some(0));
}

#[test]
fn same_step_keeps_the_final_observation_and_info() {
    let mut batch = batch(1, Autoreset::SameStep, 1, 1);
    let mut arrays = Arrays::new(1);
    batch.reset(Some(&[1]), None, &mut arrays.observations).expect("resets");
    arrays.step(&mut batch, &[0.185, -1.0 / 3.0]).expect("steps");
    assert_eq!(arrays.truncated, [true]);
    let (observation, info) = batch.final_info(0).expect("an episode ended");
    assert_ne!(observation, arrays.observations);
    assert!((info.time - 0.1).abs() < 1e-12);
    assert_eq!(batch.info(0).map(|i| i.time), Some(0.0));
}

#[test]
fn disabled_resets_only_what_the_mask_says() {
    let mut batch = batch(2, Autoreset::Disabled, 1, 1);
    let mut arrays = Arrays::new(2);
    batch.reset(Some(&[1, 2]), None, &mut arrays.observations).expect("resets");
    let still = [0.185, -1.0 / 3.0, 0.185, -1.0 / 3.0];
    arrays.step(&mut batch, &still).expect("steps");
    let ended = arrays.observations.clone();
    assert!(matches!(arrays.step(&mut batch, &still), Err(BatchError::Step { index: 0, .. })));
    batch.reset(None, Some(&[false, true]), &mut arrays.observations).expect("resets");
    assert_eq!(arrays.observations[..3], ended[..3]);
    assert_ne!(arrays.observations[3..], ended[3..]);
}

#[test]
fn a_nan_or_a_wrong_length_steps_nothing() {
    let mut batch = batch(2, Autoreset::NextStep, 1, 10);
    let mut arrays = Arrays::new(2);
    batch.reset(Some(&[1, 2]), None, &mut arrays.observations).expect("resets");
    assert!(matches!(arrays.step(&mut batch, &[0.0, 0.0, 0.0, f64::NAN]), Err(BatchError::Step { index: 1, .. })));
    assert!(matches!(arrays.step(&mut batch, &[0.0; 3]), Err(BatchError::Length { name: "actions", given: 3, expected: 4 })));
    assert_eq!(batch.environment(0).map(Environment::steps), Some(0));
}

#[test]
fn instances_that_share_an_integrator_go_their_own_ways_and_count_their_own_work() {
    for method in Method::ALL {
        let options = EnvironmentOptions {
            max_steps: Some(1000),
            solver: SolverOverrides { method: Some(method), ..SolverOverrides::default() },
            ..EnvironmentOptions::default()
        };
        let setup = setup(reactor::model(), options);
        let mut batch = Batch::new(&setup, 3, BatchOptions::default()).expect("a batch");
        let mut arrays = Arrays::new(3);
        batch.reset(Some(&[5, 6, 7]), None, &mut arrays.observations).expect("resets");
        for step in 0..5 {
            arrays.step(&mut batch, &actions(3, step)).expect("steps");
        }
        for i in 0..3 {
            let mut single = Environment::new(std::sync::Arc::clone(&setup)).expect("makes");
            single.reset(Some(5 + i as u64), &ResetOptions::default()).expect("resets");
            for step in 0..5 {
                let all = actions(3, step);
                single.step(&[denormalise(all[2 * i], 15.0, 35.0), denormalise(all[2 * i + 1], 0.05, 0.2)]).expect("steps");
            }
            let member = batch.environment(i).expect("exists");
            assert_eq!(member.unknowns(), single.unknowns(), "{method}, instance {i}");
            assert_eq!(member.statistics(), single.statistics(), "{method}, instance {i}");
        }
    }
}
