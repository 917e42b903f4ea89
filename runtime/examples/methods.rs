//! Error and work by method and tolerance, and the time of a control step of the reactor by method.
//!
//! `cargo run --release --example methods` prints both tables of the book's page on performance; an argument keeps the lines that contain it.

#[path = "../tests/support/mod.rs"]
mod support;

use std::path::Path;

use rustix::time::{ClockId, clock_gettime};
use smpl_runtime::environment::{Environment, ResetOptions, Start};
use smpl_runtime::load::{LoadOptions, load};
use smpl_runtime::setup::Setup;
use smpl_runtime::solver::problems::{self, Problem};
use smpl_runtime::solver::{Advance, Method, Settings, System, integrator};
use smpl_runtime::system::CompiledSystem;
use support::reactor;

const TOLERANCES: [f64; 4] = [1e-4, 1e-6, 1e-8, 1e-10];

/// Seconds that this thread has worked: the machine may be busy with other things.
fn worked() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// The state at the end and the work on the way, or nothing if it was not reached.
type Run = Option<(Vec<f64>, Work)>;

#[derive(Clone, Copy, Default)]
struct Work {
    steps: u64,
    seconds: f64,
}

fn main() {
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-')).unwrap_or_default();
    let wanted = |name: &str| name.contains(&filter);
    let names = Method::ALL.map(Method::name).join(" | ");
    println!("largest error (relative, or in parts of the scale), steps, time of the processor\n");
    println!("| problem | rtol | {names} |\n|---|---|---|---|---|---|");
    for (name, problem, end, size) in cases() {
        if wanted(name) {
            precision(name, size, |method, rtol| solve(problem.clone(), method, rtol, end));
        }
    }
    for (name, steps) in [("reactor", 30), ("beer", 140), ("pensim", 200), ("atropine", 3), ("mab", 3)] {
        if wanted(name) {
            precision(&format!("{name}, {steps} steps"), 1.0, |method, rtol| episode(name, method, rtol, steps));
        }
    }
    if wanted("control step") {
        println!("\na control step of the reactor, the coolant's temperature changed at each\n\n| rtol | {names} |\n|---|---|---|---|---|");
        for rtol in [1e-4, 1e-6, 1e-8] {
            let times = Method::ALL.map(|method| format!("{:.2} µs", control_step(method, rtol)));
            println!("| {rtol:.0e} | {} |", times.join(" | "));
        }
    }
    if wanted("size") {
        sizes();
    }
}

/// Name, problem, its end, and the size below which errors are no longer relative.
fn cases() -> Vec<(&'static str, Problem, f64, f64)> {
    vec![
        ("robertson", problems::robertson(), 1e4, 1e-12),
        ("robertson_dae", problems::robertson_dae(), 1e4, 1e-12),
        ("van_der_pol", problems::van_der_pol(), 2.0, 1e-3),
        ("hires", problems::hires(), 321.8122, 1e-6),
        (
            "stirred_tank",
            {
                let mut tank = problems::stirred_tank();
                tank.inputs[0] = 305.0;
                tank
            },
            5.0,
            1e-3,
        ),
        ("tubular_reactor 10", problems::tubular_reactor(10), 2.0, 1e-3),
        ("tubular_reactor 100", problems::tubular_reactor(100), 2.0, 1e-3),
        ("arenstorf", problems::arenstorf(), 17.065_216_560_157_964, 1.0),
        ("predator_prey", problems::predator_prey(), 40.0, 1e-3),
    ]
}

/// One line a tolerance: errors against a run of the Rosenbrock method, or IDA, at 1e-12.
fn precision(name: &str, size: f64, mut run: impl FnMut(Method, f64) -> Run) {
    let reference = [Method::Rosenbrock, Method::Ida].into_iter().find_map(|method| run(method, 1e-12));
    let Some((exact, _)) = reference else { return println!("{name}: no reference") };
    for rtol in TOLERANCES {
        print!("| {name} | {rtol:.0e} |");
        for method in Method::ALL {
            match run(method, rtol) {
                Some((state, work)) => {
                    let error = state.iter().zip(&exact).map(|(a, b)| (a - b).abs() / b.abs().max(size)).fold(0.0, f64::max);
                    print!(" {error:.0e}, {}, {} |", work.steps, shown(work.seconds));
                }
                None => print!(" – |"),
            }
        }
        println!();
    }
}

/// A time with two digits.
fn shown(seconds: f64) -> String {
    match seconds {
        s if s < 1e-3 => format!("{:.0} µs", s * 1e6),
        s if s < 1e-2 => format!("{:.1} ms", s * 1e3),
        s => format!("{:.0} ms", s * 1e3),
    }
}

fn solve(mut problem: Problem, method: Method, rtol: f64, end: f64) -> Run {
    let mut settings = Settings::new(rtol, vec![1e-4 * rtol; problem.dimension()]);
    settings.method = method;
    settings.max_steps = 200_000;
    let mut integrator = integrator(&problem, settings).ok()?;
    let start = problem.start.clone();
    let begin = worked();
    integrator.restart(&mut problem, 0.0, &start, None).ok()?;
    (integrator.advance(&mut problem, end) == Ok(Advance::Reached)).then_some(())?;
    let (s, seconds) = (integrator.statistics(), (worked() - begin));
    Some((integrator.state().to_vec(), Work { steps: s.steps, seconds }))
}

/// An episode of a model about its nominal action, from its nominal start; states in parts of their scales. The explicit method is left out where all are stiff.
fn episode(file: &str, method: Method, rtol: f64, steps: u32) -> Run {
    if method == Method::Explicit && matches!(file, "atropine" | "mab") {
        return None;
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../models/{file}.eq"));
    let loaded = load(&path, &LoadOptions::default()).ok()?;
    let mut options = loaded.options;
    options.solver.method = Some(method);
    options.solver.rtol = Some(rtol);
    let mut environment = Environment::new(Setup::new(loaded.model, options, None).ok()?).ok()?;
    environment.reset(Some(1), &ResetOptions { start: Start::Nominal, ..ResetOptions::default() }).ok()?;
    environment.set_keep_going(true);
    let actions = environment.catalogue().actions.elements().to_vec();
    let begin = worked();
    for step in 0..steps {
        // The nominal action and a fiftieth of the range to either side of it, so that there is something to integrate.
        let shift = f64::from(step % 3) - 1.0;
        let action: Vec<f64> = actions.iter().map(|a| a.default + 0.02 * shift * a.range()).collect();
        environment.step(&action).ok()?;
    }
    let (s, seconds) = (environment.statistics(), (worked() - begin));
    let states = environment.catalogue().states.elements().iter();
    let scaled = states.map(|element| environment.unknowns()[element.at] / element.scale).collect();
    Some((scaled, Work { steps: s.steps, seconds }))
}

/// Microseconds of a control step in a loop without an environment; median of nine.
fn control_step(method: Method, rtol: f64) -> f64 {
    let mut system = CompiledSystem::new(support::compile(reactor::model())).expect("a system");
    let mut settings = Settings::new(rtol, vec![1e-2 * rtol, rtol, 1e-2 * rtol]);
    settings.method = method;
    let mut integrator = integrator(&system, settings).expect("takes the system");
    let (model, memory) = system.parts();
    model.prepare_parameters(memory);
    let mut y = [0.877_825_200_550_143_4, 51.346_606_192_950_78, 0.659];
    let mut times: Vec<f64> = (0..9)
        .map(|_| {
            let begin = worked();
            for i in 0..2000 {
                let (model, memory) = system.parts();
                memory.region_mut(smpl_compiler::layout::Region::Action)[0] = 26.0 + f64::from(i % 3);
                model.prepare_step(memory);
                integrator.restart(&mut system, 0.0, &y, None).expect("restarts");
                integrator.advance(&mut system, 0.1).expect("advances");
                y.copy_from_slice(integrator.state());
            }
            (worked() - begin) * 1e6 / 2000.0
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[4]
}

/// Control steps of tubular reactors of several sizes, the inlet's temperature changed at each.
fn sizes() {
    println!("\na control step of a tubular reactor, 1e-6\n\n| unknowns | ida | rosenbrock | explicit |\n|---|---|---|---|");
    for cells in [2, 5, 10, 20, 50, 100, 200, 500] {
        let times = [Method::Ida, Method::Rosenbrock, Method::Explicit].map(|method| tubular_step(cells, method));
        println!("| {} | {} |", 4 * cells, times.join(" | "));
    }
}

fn tubular_step(cells: usize, method: Method) -> String {
    const STEPS: u32 = 60;
    let mut problem = problems::tubular_reactor(cells);
    let mut settings = Settings::new(1e-6, vec![1e-8; problem.dimension()]);
    settings.method = method;
    let mut integrator = integrator(&problem, settings).expect("takes the system");
    let mut state = problem.start.clone();
    let begin = worked();
    for step in 0..STEPS {
        problem.inputs[0] = 1.0 + 0.02 * f64::from(step % 3);
        integrator.restart(&mut problem, f64::from(step) * 0.1, &state, None).expect("restarts");
        integrator.advance(&mut problem, f64::from(step + 1) * 0.1).expect("advances");
        state.copy_from_slice(integrator.state());
    }
    shown((worked() - begin) / f64::from(STEPS))
}
