//! Measures a control step of the small models, what of it is not the integrator, and the gain of a second thread.

#[path = "../tests/support/mod.rs"]
mod support;

use std::time::Instant;

use smpl_runtime::batch::{Autoreset, Batch, BatchOptions, StepArrays};
use smpl_runtime::environment::{Environment, ResetOptions, Start};
use smpl_runtime::setup::{EnvironmentOptions, SolverOverrides};
use smpl_runtime::solver::{Ida, Integrator, Settings};
use smpl_runtime::system::CompiledSystem;
use support::{beer, environment, reactor, setup};

fn main() {
    let reactor = environment(reactor::model(), EnvironmentOptions { max_steps: Some(u32::MAX), ..EnvironmentOptions::default() });
    println!("reactor step, rtol 1e-9: {:.2} us", step_time(reactor, |i| vec![26.0 + f64::from(i % 3), 0.1]));
    let options = EnvironmentOptions {
        max_steps: Some(u32::MAX),
        solver: SolverOverrides { rtol: Some(1e-6), ..SolverOverrides::default() },
        ..EnvironmentOptions::default()
    };
    println!(
        "reactor step, rtol 1e-6: {:.2} us",
        step_time(environment(reactor::model(), options), |i| vec![26.0 + f64::from(i % 3), 0.1])
    );
    println!("integrator alone, 1e-9:  {:.2} us", integrator_time(3));
    println!(
        "reactor at rest:         {:.2} us",
        step_time(
            environment(reactor::model(), EnvironmentOptions { max_steps: Some(u32::MAX), ..EnvironmentOptions::default() }),
            |_| vec![26.85, 0.1]
        )
    );
    println!("integrator alone, there: {:.2} us", integrator_time(0));
    let beer = environment(beer::model(1.0, u32::MAX), EnvironmentOptions::default());
    println!("beer step, rtol 1e-8:    {:.2} us", step_time(beer, |_| vec![10.0]));
    for threads in [1, 2] {
        println!("batch of 64, {threads} threads: {:.2} us a step and instance", batch_time(64, threads));
    }
}

fn step_time(mut env: Environment, action: impl Fn(u32) -> Vec<f64>) -> f64 {
    let start = ResetOptions { start: Start::Nominal, ..ResetOptions::default() };
    env.reset(Some(1), &start).expect("resets");
    env.set_keep_going(true);
    let actions: Vec<Vec<f64>> = (0..3).map(action).collect();
    let mut times: Vec<f64> = (0..7)
        .map(|_| {
            let begin = Instant::now();
            for i in 0..1000 {
                env.step(&actions[i % 3]).expect("steps");
            }
            begin.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[3]
}

fn integrator_time(jumps: usize) -> f64 {
    let mut system = CompiledSystem::new(support::compile(reactor::model())).expect("a system");
    let mut settings = Settings::new(1e-9, vec![1e-11, 1e-9, 1e-11]);
    settings.max_steps = 20_000;
    let mut ida = Ida::new(&system, settings).expect("takes the system");
    let (model, memory) = system.parts();
    model.prepare_parameters(memory);
    let mut y = [0.877_825_200_550_143_4, 51.346_606_192_950_78, 0.659];
    let mut times: Vec<f64> = (0..7)
        .map(|_| {
            let begin = Instant::now();
            for i in 0..1000 {
                let (model, memory) = system.parts();
                memory.region_mut(smpl_compiler::layout::Region::Action)[0] = if jumps == 0 { 26.85 } else { 26.0 + (i % jumps) as f64 };
                model.prepare_step(memory);
                ida.restart(&mut system, 0.0, &y, None).expect("restarts");
                ida.advance(&mut system, 0.1).expect("advances");
                y.copy_from_slice(ida.state());
            }
            begin.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[3]
}

fn batch_time(n: usize, threads: usize) -> f64 {
    let setup = setup(reactor::model(), EnvironmentOptions::default());
    let options = BatchOptions { autoreset: Autoreset::SameStep, threads, ..BatchOptions::default() };
    let mut batch = Batch::new(&setup, n, options).expect("a batch");
    let (mut observations, mut rewards) = (vec![0.0_f32; 3 * n], vec![0.0; n]);
    let (mut terminated, mut truncated) = (vec![false; n], vec![false; n]);
    let seeds = batch.seeds(0);
    batch.reset(Some(&seeds), None, &mut observations).expect("resets");
    let actions: Vec<f64> = (0..2 * n).map(|i| (i % 5) as f64 * 0.1 - 0.3).collect();
    let begin = Instant::now();
    for _ in 0..200 {
        let arrays =
            StepArrays { observations: &mut observations, rewards: &mut rewards, terminated: &mut terminated, truncated: &mut truncated };
        batch.step(&actions, arrays).expect("steps");
    }
    begin.elapsed().as_secs_f64() * 1e6 / 200.0 / n as f64
}
