//! Times of restarts and advances. `cargo bench -p smpl-runtime --bench solver [-- FILTER]`.
//!
//! Plain repetition and the least time (the machine may be busy), no framework: times are printed, nothing is judged.

use std::env;
use std::time::Instant;

use smpl_runtime::solver::problems::{self, Problem};
use smpl_runtime::solver::{FirstStep, Ida, Integrator, LinearSolver, Settings, System};

/// First steps compared.
const FIRST_STEPS: [(&str, FirstStep); 8] = [
    ("IDA's rule", FirstStep::Ida),
    ("0.03 of last", FirstStep::Scaled { factor: 0.03 }),
    ("0.1 of last", FirstStep::Scaled { factor: 0.1 }),
    ("0.3 of last", FirstStep::Scaled { factor: 0.3 }),
    ("estimate 0.05", FirstStep::Estimated { safety: 0.05 }),
    ("estimate 0.1", FirstStep::Estimated { safety: 0.1 }),
    ("estimate 0.25", FirstStep::Estimated { safety: 0.25 }),
    ("estimate 0.5", FirstStep::Estimated { safety: 0.5 }),
];

/// An input sequence that jumps at every step, the same for all.
fn jump(step: u32) -> f64 {
    let mut x = u64::from(step).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
}

/// Control steps with a jump of the first input at each; the final state.
fn episode(ida: &mut Ida, problem: &mut Problem, (steps, length, size): (u32, f64, f64)) -> Vec<f64> {
    ida.forget();
    let nominal = problem.inputs.first().copied().unwrap_or_default();
    let mut state = problem.start.clone();
    for step in 0..steps {
        if let Some(input) = problem.inputs.first_mut() {
            *input = nominal + size * jump(step);
        }
        let t = length * f64::from(step);
        let done = ida.restart(problem, t, &state, None).and_then(|()| ida.advance(problem, t + length));
        if let Err(error) = done {
            println!("step {step}: {error}");
            break;
        }
        state.copy_from_slice(ida.state());
    }
    if let Some(input) = problem.inputs.first_mut() {
        *input = nominal;
    }
    state
}

fn settings(problem: &Problem, rtol: f64, atol: f64) -> Settings {
    Settings::new(rtol, vec![atol; problem.dimension()])
}

/// One line: time, work and error of an episode.
fn report(name: &str, mut problem: Problem, settings: Settings, shape: (u32, f64, f64), repeats: usize) {
    let fine = Settings { rtol: 1e-11, atol: settings.atol.iter().map(|a| a * 1e-4).collect(), ..settings.clone() };
    let Ok(mut reference) = Ida::new(&problem, fine) else {
        return println!("{name}: refused");
    };
    let exact = episode(&mut reference, &mut problem, shape);
    let Ok(mut ida) = Ida::new(&problem, settings) else {
        return println!("{name}: refused");
    };
    let mut state = vec![];
    let seconds = (0..repeats)
        .map(|_| {
            let start = Instant::now();
            state = episode(&mut ida, &mut problem, shape);
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min);
    let error = state.iter().zip(&exact).map(|(a, b)| (a - b).abs() / b.abs().max(1e-3)).fold(0.0, f64::max);
    let s = ida.statistics();
    println!(
        "{name:36} {:9.2} us/step  {:6.2} steps {:6.2} residuals {:5.2} Jacobians {:5.2} factorisations {:5.2} rejected  error {error:.1e}  {:?}",
        seconds / f64::from(shape.0) * 1e6,
        s.steps as f64 / f64::from(shape.0),
        s.residuals as f64 / f64::from(shape.0),
        s.jacobians as f64 / f64::from(shape.0),
        s.factorisations as f64 / f64::from(shape.0),
        s.error_test_failures as f64 / f64::from(shape.0),
        ida.method(),
    );
}

fn main() {
    let filter = env::args().skip(1).find(|argument| !argument.starts_with('-')).unwrap_or_default();
    let wanted = |name: &str| name.contains(&filter);
    for (label, first_step) in FIRST_STEPS {
        for (case, size) in [("tank 10 K", 10.0), ("tank 0.1 K", 0.1)] {
            let name = format!("{case}, {label}");
            if wanted(&name) {
                let problem = problems::stirred_tank();
                let settings = Settings { first_step, ..settings(&problem, 1e-6, 1e-8) };
                report(&name, problem, settings, (5_000, 0.1, size), 25);
            }
        }
        let name = format!("reactor 1700, {label}");
        if wanted(&name) {
            let problem = problems::tubular_reactor(425);
            let settings = Settings { first_step, ..settings(&problem, 1e-6, 1e-6) };
            report(&name, problem, settings, (30, 0.1, 0.05), 7);
        }
    }
    if wanted("reactor undisturbed") {
        let problem = problems::tubular_reactor(425);
        let settings = settings(&problem, 1e-6, 1e-6);
        report("reactor undisturbed", problem, settings, (1, 3.0, 0.0), 5);
    }
    if wanted("tanks 1700") {
        let problem = problems::tanks_in_series(1700);
        let settings = settings(&problem, 1e-6, 1e-6);
        report("tanks 1700", problem, settings, (1, 1.5, 0.0), 5);
    }
    for cells in [1, 2, 3, 5, 8, 12, 100] {
        for linear_solver in [LinearSolver::Dense, LinearSolver::Block, LinearSolver::Klu] {
            let name = format!("reactor {} {linear_solver:?}", 4 * cells);
            if wanted(&name) && (cells < 100 || linear_solver != LinearSolver::Dense) {
                let problem = problems::tubular_reactor(cells);
                let settings = Settings { linear_solver, ..settings(&problem, 1e-6, 1e-6) };
                report(&name, problem, settings, (300, 0.1, 0.05), 25);
            }
        }
    }
}
