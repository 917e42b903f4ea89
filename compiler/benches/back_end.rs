//! Compile times and evaluation times of the back end: the reactor (3 states) and problem B (advection with one exponential rate a
//! cell, 4 × n states). Wall-clock time: medians of compile times, the best of many batches of evaluations.

#[path = "../tests/problems/mod.rs"]
mod problems;

use std::hint::black_box;
use std::time::{Duration, Instant};

use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::kernels::{self, Kernel};
use smpl_compiler::model::Model;

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort();
    times[times.len() / 2]
}

fn compile_time(make: impl Fn() -> Model) -> (Duration, CompiledModel) {
    let build = || {
        let model = make();
        let start = Instant::now();
        let compiled = CompiledModel::build(model, &BackEndSettings::default()).expect("the model compiles");
        (start.elapsed(), compiled)
    };
    let runs: Vec<_> = (0..31).map(|_| build()).collect();
    let time = median(runs.iter().map(|r| r.0).collect());
    (time, build().1)
}

/// Time of one call in the best of many batches, in nanoseconds.
fn call_time(mut call: impl FnMut()) -> f64 {
    let start = Instant::now();
    call();
    let once = start.elapsed().as_secs_f64().max(1e-9);
    let count = ((2e-3 / once) as usize).clamp(10, 100_000);
    let batch = |_| {
        let start = Instant::now();
        (0..count).for_each(|_| call());
        start.elapsed()
    };
    (0..101).map(batch).min().unwrap_or_default().as_secs_f64() / count as f64 * 1e9
}

fn report(name: &str, make: impl Fn() -> Model, y: &[f64]) {
    let (compile, model) = compile_time(make);
    let mut m = model.memory();
    model.prepare_parameters(&mut m);
    model.prepare_step(&mut m);
    let yp = vec![0.0; y.len()];
    let (mut out, mut values) = (vec![0.0; y.len()], vec![0.0; model.pattern().nonzeros()]);
    let residual = call_time(|| model.residual(&mut m, 0.0, black_box(y), &yp, &mut out));
    let jacobian = call_time(|| model.jacobian(&mut m, 0.0, black_box(y), &yp, 1.0, &mut values));
    let prepare = call_time(|| model.prepare_step(&mut m));
    let s = model.statistics();
    println!(
        "{name}: compile {:.0} us (differentiate {:.0}, hoist {:.0}, generate {:.0}), {} bytes, {} non-zeros, residual {residual:.1} ns, \
         Jacobian {jacobian:.1} ns, prepare_step {prepare:.1} ns",
        compile.as_secs_f64() * 1e6,
        s.differentiate.as_secs_f64() * 1e6,
        s.hoist.as_secs_f64() * 1e6,
        s.generate.as_secs_f64() * 1e6,
        s.code_bytes,
        s.nonzeros,
    );
}

fn main() {
    let (arguments, mut values) = (vec![-17.3; 425], vec![0.0; 425]);
    for (name, f) in [("exp", Kernel::Exp), ("ln", Kernel::Ln), ("tanh", Kernel::Tanh)] {
        let kernel = kernels::table().unary_array[f as usize];
        // SAFETY: both vectors have that length.
        let time = call_time(|| unsafe { kernel(black_box(arguments.as_ptr()), values.as_mut_ptr(), 425) });
        println!("{name} of 425 numbers: {time:.0} ns");
    }
    report("reactor", problems::reactor, &[0.55, 72.0, 0.64]);
    for n in [40usize, 425, 4000] {
        let y: Vec<f64> = (0..4 * n).map(|i| [0.8, 0.9, 0.1, 352.0][i / n]).collect();
        report(&format!("problem B, {n} cells"), || problems::advection_reaction(n as u32), &y);
    }
}
