//! Control steps of the large models: median times with recorded-like inputs, work of the integrator, distance to the goals.

use std::path::{Path, PathBuf};
use std::time::Instant;

use smpl_runtime::environment::{Environment, ResetOptions, Start};
use smpl_runtime::load::{LoadOptions, load};
use smpl_runtime::setup::Setup;
use smpl_runtime::solver::LinearSolver;

struct Case {
    model: &'static str,
    scenario: &'static str,
    rtol: Option<f64>,
    atol_factor: Option<f64>,
    linear_solver: Option<LinearSolver>,
    steps: u32,
    /// Observations whose errors are printed.
    watched: &'static [&'static str],
    /// Goal of the median step, ms.
    goal: f64,
}

const ATROPINE: Case = Case {
    model: "atropine.eq",
    scenario: "default",
    rtol: None,
    atol_factor: None,
    linear_solver: None,
    steps: 60,
    watched: &["E", "SEP.Q_OR"],
    goal: 2.5,
};
const ANTIBODIES: Case =
    Case { model: "mab.eq", scenario: "default", rtol: None, atol_factor: None, linear_solver: None, steps: 63, watched: &[], goal: 1.5 };
const PENICILLIN: Case = Case {
    model: "pensim.eq",
    scenario: "default",
    rtol: Some(1e-6),
    atol_factor: None,
    linear_solver: None,
    steps: 1149,
    watched: &[],
    goal: 0.09,
};
const CASES: [Case; 10] = [
    // Everyday tolerance, and that of the model's figures.
    PENICILLIN,
    Case { rtol: None, ..PENICILLIN },
    // The model's tolerance, the tolerances of the original implementation, and what gives its accuracy (concentrations within 1e-4 mol/L).
    ATROPINE,
    Case { rtol: Some(1e-6), atol_factor: Some(1e-4), ..ATROPINE },
    Case { rtol: Some(1e-6), atol_factor: Some(1e-4), linear_solver: Some(LinearSolver::Klu), ..ATROPINE },
    Case { rtol: Some(1e-5), ..ATROPINE },
    // The model's tolerance is that of the original, whose states are within 2e-6 of their ranges.
    ANTIBODIES,
    Case { linear_solver: Some(LinearSolver::Klu), ..ANTIBODIES },
    Case { rtol: Some(3e-8), ..ANTIBODIES },
    Case { scenario: "legacy", ..ANTIBODIES },
];

fn main() {
    // `cargo bench` passes its own option; anything else selects models by a part of their names.
    let wanted: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    for case in CASES.iter().filter(|case| wanted.is_empty() || wanted.iter().any(|part| case.model.contains(part.as_str()))) {
        run(case);
    }
}

/// A point of the action box that moves with the step, without randomness; a switch of the column every 21 steps.
fn action(environment: &Environment, step: u32, out: &mut [f64]) {
    let actions = environment.catalogue().actions.elements();
    for (i, (out, a)) in out.iter_mut().zip(actions).enumerate() {
        let share = f64::from((step * 7 + 3 * i as u32) % 11) / 10.0;
        *out = match a.name.as_str() {
            "switch" => f64::from(u8::from(step % 21 == 20)),
            _ if a.name.starts_with("dq") => a.low + share * (a.high - a.low),
            _ => a.default,
        };
    }
}

/// Processor time of this thread, s: what others do on a shared machine does not count.
fn processor_time() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// An environment for the case, and where its episodes start.
fn prepared(case: &Case, path: &Path, asked: &LoadOptions, rtol: Option<f64>) -> (Environment, ResetOptions) {
    let loaded = load(path, asked).unwrap_or_else(|e| panic!("{e}"));
    let mut options = loaded.options;
    options.solver.rtol = rtol.or(case.rtol).or(options.solver.rtol);
    options.solver.atol_factor = case.atol_factor.or(options.solver.atol_factor);
    options.solver.linear_solver = case.linear_solver.or(options.solver.linear_solver);
    let setup = Setup::new(loaded.model, options, Some(loaded.sources)).unwrap_or_else(|e| panic!("{e}"));
    let mut environment = Environment::new(setup).unwrap_or_else(|e| panic!("{e}"));
    environment.set_keep_going(true);
    // A batch has no steady state.
    let start = if case.model == PENICILLIN.model { Start::Nominal } else { Start::Steady };
    (environment, ResetOptions { start, ..ResetOptions::default() })
}

/// State of an episode after each step.
#[derive(Default)]
struct Trajectory {
    states: Vec<f64>,
    observations: Vec<f64>,
}

/// Runs an episode. `times` keeps the least time of each step, ms: the machine may be shared.
fn episode(environment: &mut Environment, steps: u32, start: &ResetOptions, times: &mut Vec<f64>) -> Trajectory {
    let mut input = vec![0.0; environment.catalogue().actions.len()];
    let n = environment.catalogue().states.len();
    let width = environment.observation_len();
    let mut trajectory = Trajectory { states: vec![0.0; n * steps as usize], observations: vec![0.0; width * steps as usize] };
    let Trajectory { states, observations } = &mut trajectory;
    environment.reset(Some(0), start).unwrap_or_else(|e| panic!("{e}"));
    let rows = states.chunks_exact_mut(n).zip(observations.chunks_exact_mut(width));
    for (step, (state, observation)) in (0..steps).zip(rows) {
        action(environment, step, &mut input);
        let begin = processor_time();
        environment.step(&input).unwrap_or_else(|e| panic!("{e}"));
        let time = (processor_time() - begin) * 1e3;
        match times.get_mut(step as usize) {
            Some(least) => *least = time.min(*least),
            None => times.push(time),
        }
        environment.state(state);
        environment.observe(false, observation);
    }
    trajectory
}

/// The largest difference of two episodes, and the largest in parts of a state's largest value.
fn errors(states: &[f64], exact: &[f64], n: usize) -> (f64, f64) {
    let mut largest = vec![(0.0_f64, 0.0_f64); n];
    for (i, (a, b)) in states.iter().zip(exact).enumerate() {
        let (error, value) = &mut largest[i % n];
        *error = error.max((a - b).abs());
        *value = value.max(b.abs());
    }
    let relative = largest.iter().filter(|(_, value)| *value > 0.0).map(|(error, value)| error / value);
    (largest.iter().map(|(error, _)| *error).fold(0.0, f64::max), relative.fold(0.0, f64::max))
}

fn run(case: &Case) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../models").join(case.model);
    let asked = LoadOptions { scenario: Some(case.scenario.into()), ..LoadOptions::default() };
    let mut compile = f64::INFINITY;
    for _ in 0..5 {
        let begin = Instant::now();
        load(&path, &asked).unwrap_or_else(|e| panic!("{e}"));
        compile = compile.min(begin.elapsed().as_secs_f64() * 1e3);
    }
    let (mut environment, start) = prepared(case, &path, &asked, None);
    let mut times = Vec::new();
    let mut found = Trajectory::default();
    for _ in 0..3 {
        found = episode(&mut environment, case.steps, &start, &mut times);
    }
    let (mut reference, _) = prepared(case, &path, &asked, Some(1e-11));
    let exact = episode(&mut reference, case.steps, &start, &mut Vec::new());
    times.sort_by(f64::total_cmp);
    let (median, slowest, mean) = (times[times.len() / 2], times[times.len() - 1], times.iter().sum::<f64>() / times.len() as f64);
    let (absolute, relative) = errors(&found.states, &exact.states, environment.catalogue().states.len());
    let observations = &environment.setup().model().interface().finish.observations;
    for (i, element) in observations.iter().enumerate().filter(|(_, e)| case.watched.contains(&e.name.as_str())) {
        let pairs = found.observations.iter().zip(&exact.observations).skip(i).step_by(environment.observation_len());
        let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        println!("    error of {}: {worst:.1e}", element.name);
    }
    let s = environment.statistics();
    let n = f64::from(case.steps - 1);
    let per = |x: u64| x as f64 / n;
    let rtol = case.rtol.map_or("of the model".to_owned(), |rtol| format!("{rtol:.0e}"));
    println!(
        "{} {}, rtol {rtol}, linear solver {}: compile {compile:.1} ms",
        case.model,
        case.scenario,
        case.linear_solver.unwrap_or_default().name()
    );
    println!("    step: median {median:.3} ms (goal {}), mean {mean:.3}, slowest {slowest:.3}", case.goal);
    println!("    error of the states: {absolute:.1e}, and {relative:.1e} of their largest values");
    println!(
        "    per step: {:.0} steps, {:.0} residuals, {:.1} Jacobians, {:.1} factorisations, {:.0} solves, {:.1} rejected",
        per(s.steps),
        per(s.residuals),
        per(s.jacobians),
        per(s.factorisations),
        per(s.linear_solves),
        per(s.error_test_failures)
    );
}
