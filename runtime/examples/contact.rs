//! Chains of gas vessels in contact, of index 2: time of compilation, and of a step for each unknown.
//!
//! `cargo run --release -p smpl-runtime --example contact` prints the table of the book's page on performance; arguments are numbers of
//! vessels.

use std::path::Path;
use std::time::Instant;

use rustix::time::{ClockId, clock_gettime};
use smpl_runtime::environment::{Environment, ResetOptions};
use smpl_runtime::load::{LoadOptions, Loaded, load_text};
use smpl_runtime::setup::Setup;

/// Control steps of a run, and compilations of which the fastest counts.
const STEPS: usize = 50;
const COMPILATIONS: usize = 5;

/// All pressures are equal: what vessel i passes on is F*(1 - i/n), and each amount is 1 mol and the feed over n.
fn chain(n: usize) -> String {
    format!(
        "model Chain\ntime t : s\nset vessels = 1..{n}\nset contacts = 1..{last}\naction F : mol/s = 1 in 0..2\nstate n[vessels] : mol = 1 in 0..1000\n\
         var p[vessels] : mol\nvar w[contacts] : mol/s\neq d/dt n[1] = F - w[1]\n\
         eq d/dt n[i] = w[i-1] - w[i] for i in 2..{last}\neq d/dt n[{n}] = w[{last}]\neq p[i] = n[i]*2 for i in vessels\n\
         eq p[i] = p[i+1] for i in contacts\nobserve n[1] in 0..100\nepisode {{ step = 1 [s], max_steps = {STEPS} }}\n",
        last = n - 1
    )
}

/// Seconds that this thread has worked: the machine may be busy with other things.
fn worked() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

fn compiled(text: &str) -> (Loaded, f64) {
    let begin = Instant::now();
    let loaded = load_text(Path::new("chain.eq"), text.to_owned(), &LoadOptions::default()).expect("a model");
    (loaded, begin.elapsed().as_secs_f64())
}

fn main() {
    let asked: Vec<usize> = std::env::args().skip(1).filter_map(|argument| argument.parse().ok()).filter(|n| *n > 2).collect();
    let sizes = if asked.is_empty() { vec![20, 200, 2000] } else { asked };
    println!("| vessels | unknowns | code | compilation | control step | internal step | for each unknown | error |");
    println!("|---|---|---|---|---|---|---|---|");
    for n in sizes {
        let text = chain(n);
        let (loaded, first) = compiled(&text);
        let compilation = (1..COMPILATIONS).map(|_| compiled(&text).1).fold(first, f64::min);
        let setup = Setup::new(loaded.model, loaded.options, Some(loaded.sources)).expect("a setup");
        let mut environment = Environment::new(setup).expect("an environment");
        environment.reset(Some(0), &ResetOptions::default()).expect("a start");
        let (mut fed, begin) = (0.0, worked());
        for k in 0..STEPS {
            let feed = if k % 2 == 0 { 1.5 } else { 0.5 };
            environment.step(&[feed]).expect("a step");
            fed += feed;
        }
        let seconds = worked() - begin;
        let error = (environment.unknowns()[0] - 1.0 - fed / n as f64).abs();
        let (model, steps) = (environment.setup().model(), environment.statistics().steps as f64);
        let (unknowns, code) = (model.unknowns(), model.statistics().code_bytes);
        let step = seconds / steps;
        println!(
            "| {n} | {unknowns} | {code} bytes | {:.2} ms | {:.1} µs | {:.2} µs | {:.1} ns | {error:.0e} |",
            1e3 * compilation,
            1e6 * seconds / STEPS as f64,
            1e6 * step,
            1e9 * step / unknowns as f64
        );
    }
}
