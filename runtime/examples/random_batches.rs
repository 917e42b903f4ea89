//! Runs episodes with random actions until each has ended and prints how often it ended in what:
//! `cargo run -r --example random_batches -- models/pensim.eq [EPISODES [HOLD [RTOL]]] [ACTION=VALUE]...`.
//!
//! Episode i has seed i. Actions are uniform in their boxes and held for HOLD steps (default 1), but for those given. The command fails when an episode ends
//! in a failure without a cause.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::time::Instant;

use smpl_runtime::batch::{Autoreset, Batch, BatchOptions, StepArrays};
use smpl_runtime::load::{LoadOptions, load};
use smpl_runtime::random::{EpisodeKey, Stream};
use smpl_runtime::setup::Setup;

/// Instances in motion at once.
const WIDTH: usize = 50;

/// Ends of episodes: cause, their number, their steps.
type Causes = BTreeMap<String, (u32, u64)>;

fn main() -> Result<(), Box<dyn Error>> {
    let (fixed, arguments): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|text| text.contains('='));
    let path = arguments.first().ok_or("which model?")?;
    let number = |at: usize, default: f64| arguments.get(at).map_or(Ok(default), |text| text.parse::<f64>());
    let (episodes, hold) = (number(1, 1000.0)? as u64, number(2, 1.0)? as u32);
    let loaded = load(Path::new(path), &LoadOptions::default())?;
    let mut options = loaded.options;
    options.solver.rtol = Some(number(3, 1e-6)?);
    let setup = Setup::new(loaded.model, options, Some(loaded.sources))?;
    let threads = std::thread::available_parallelism()?.get();
    let batch_options = BatchOptions { autoreset: Autoreset::Disabled, threads, ..BatchOptions::default() };
    let fixed: Result<Vec<_>, Box<dyn Error>> = fixed.iter().map(|text| fixed_action(&setup, text)).collect();
    let fixed = fixed?;
    let mut batch = Batch::new(&setup, WIDTH, batch_options)?;
    let mut causes = Causes::new();
    let begin = Instant::now();
    for first in (0..episodes).step_by(WIDTH) {
        run(&mut batch, first, hold.max(1), &fixed, &mut causes)?;
    }
    let steps: u64 = causes.values().map(|c| c.1).sum();
    for (cause, (count, steps)) in &causes {
        println!("{count:6}  after {:6.1} steps  {cause}", *steps as f64 / f64::from(*count));
    }
    let time = begin.elapsed().as_secs_f64();
    println!("{steps} steps in {time:.2} s, {:.1} us a step on {threads} threads", time / steps as f64 * 1e6);
    if causes.contains_key("") { Err("a failure without a cause".into()) } else { Ok(()) }
}

/// Place and normalised value of an action from `NAME=VALUE`.
fn fixed_action(setup: &Setup, text: &str) -> Result<(usize, f64), Box<dyn Error>> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    let actions = &setup.catalogue.actions;
    let element = actions.get(name, "action")?;
    let value = (2.0 * value.parse::<f64>()? - element.high - element.low) / element.range();
    Ok((actions.position(name).unwrap_or_default(), value))
}

/// Runs the episodes `first`, `first + 1`, ... of all instances to their ends.
fn run(batch: &mut Batch, first: u64, hold: u32, fixed: &[(usize, f64)], causes: &mut Causes) -> Result<(), Box<dyn Error>> {
    let n = batch.len();
    let (width, actions) = match batch.environment(0) {
        Some(environment) => (environment.observation_len(), environment.catalogue().actions.len()),
        None => return Ok(()),
    };
    let streams: Vec<Stream> = (first..).take(n).map(|seed| Stream::new(EpisodeKey::seeded(seed), "policy:random")).collect();
    let mut observations = vec![0.0; n * width];
    let (mut rewards, mut terminated, mut truncated) = (vec![0.0; n], vec![false; n], vec![false; n]);
    let mut chosen = vec![0.0; n * actions];
    batch.reset(Some(&batch.seeds(first)), None, &mut observations)?;
    let mut running = vec![true; n];
    for step in 0.. {
        for (index, stream) in streams.iter().enumerate() {
            for (action, value) in chosen[index * actions..][..actions].iter_mut().enumerate() {
                *value = 2.0 * stream.uniform(step / hold, action as u32) - 1.0;
            }
            fixed.iter().for_each(|&(action, value)| chosen[index * actions + action] = value);
        }
        let arrays =
            StepArrays { observations: &mut observations, rewards: &mut rewards, terminated: &mut terminated, truncated: &mut truncated };
        batch.step(&chosen, arrays)?;
        let mut over = vec![false; n];
        for index in (0..n).filter(|&i| terminated[i] || truncated[i]) {
            over[index] = true;
            if std::mem::take(&mut running[index]) {
                count(batch, index, truncated[index], u64::from(step) + 1, causes);
            }
        }
        if running.iter().all(|r| !r) {
            return Ok(());
        }
        // Instances that are done go on with another episode, which is not counted.
        batch.reset(None, Some(&over), &mut observations)?;
    }
    Ok(())
}

fn count(batch: &Batch, index: usize, truncated: bool, steps: u64, causes: &mut Causes) {
    let cause = match batch.info(index) {
        Some(info) if info.success => "success".to_owned(),
        Some(_) if truncated => "time limit".to_owned(),
        Some(info) => general(&info.failure),
        None => String::new(),
    };
    let entry = causes.entry(cause).or_default();
    entry.0 += 1;
    entry.1 += steps;
}

/// A message without its numbers, so that like causes fall together.
fn general(message: &str) -> String {
    let words = message.split_whitespace().filter(|w| w.parse::<f64>().is_err());
    words.collect::<Vec<_>>().join(" ")
}
