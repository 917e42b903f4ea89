//! Compiles model files and prints sizes, compile times and evaluation times: `measure models/*.eq`.
//!
//! Times of each model, for the first compilation of the process (cold) and the fastest of those that follow (warm). They are wall-clock
//! time, processor time of all threads, and the wall-clock time of each phase that is not negligible.

use std::path::Path;
use std::time::{Duration, Instant};

use smpl_compiler::compile::flatten;
use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::elaborate::Options;
use smpl_compiler::model::Model;
use smpl_dsl::diagnostic::SourceMap;

/// For how long compilations are repeated.
const REPEAT: Duration = Duration::from_millis(1500);

fn load(path: &Path) -> Result<Model, String> {
    let text = std::fs::read_to_string(path).map_err(|e| e.to_string())?;
    let mut sources = SourceMap::default();
    let main = sources.add(path.display().to_string(), text);
    let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
    let mut loader = |name: &str| {
        let file = folder.join(name);
        Some((name.to_owned(), std::fs::read_to_string(file).ok()?))
    };
    let flat = flatten(&mut sources, main, &mut loader, &Options::default());
    flat.map(|(model, _)| model).map_err(|d| format!("{d:#?}"))
}

/// Time that this process has used of the processors.
fn cpu() -> Duration {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer goes to a live value.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &raw mut time) };
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// Times of a compilation, all in milliseconds.
struct Times {
    wall: f64,
    processor: f64,
    phases: Vec<(String, f64)>,
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// One compilation.
fn compile(path: &Path) -> Result<(Times, CompiledModel), String> {
    let (start, processor) = (Instant::now(), cpu());
    let model = load(path)?;
    let front = start.elapsed();
    let compiled = CompiledModel::build(model, &BackEndSettings::default()).map_err(|e| e.to_string())?;
    let wall = start.elapsed();
    let s = compiled.statistics();
    let fixed =
        [("front", front), ("back", wall - front), ("differentiate", s.differentiate), ("hoist", s.hoist), ("generate", s.generate)];
    let fixed = fixed.map(|(name, time)| (name.to_owned(), milliseconds(time)));
    let functions = s.functions.iter().map(|(name, time, _)| (name.clone(), milliseconds(*time)));
    let phases = fixed.into_iter().chain(functions).collect();
    Ok((Times { wall: milliseconds(wall), processor: milliseconds(cpu() - processor), phases }, compiled))
}

/// The first compilation, then the fastest time of each phase of many.
fn compile_times(path: &Path) -> Result<CompiledModel, String> {
    let (cold, compiled) = compile(path)?;
    let (mut warm, _) = compile(path)?;
    let since = Instant::now();
    while since.elapsed() < REPEAT {
        let (again, _) = compile(path)?;
        warm.wall = warm.wall.min(again.wall);
        warm.processor = warm.processor.min(again.processor);
        warm.phases.iter_mut().zip(again.phases).for_each(|(best, time)| best.1 = best.1.min(time.1));
    }
    let s = compiled.statistics();
    println!(
        "{}: {} unknowns, {} non-zeros, {} nodes, {} cached, {} bytes of code",
        path.display(),
        compiled.unknowns(),
        s.nonzeros,
        s.expressions,
        s.cached,
        s.code_bytes
    );
    for (times, which) in [(cold, "cold"), (warm, "warm")] {
        let phases = times.phases.iter().filter(|(_, time)| *time >= 0.05).map(|(name, time)| format!("{name} {time:.2}"));
        let phases = phases.collect::<Vec<_>>().join(", ");
        println!("    {which} {:.2} ms, processor {:.2} ms: {phases}", times.wall, times.processor);
    }
    Ok(compiled)
}

/// Nanoseconds of one call, the best of batches.
fn nanoseconds(mut call: impl FnMut()) -> f64 {
    let times = (0..201).map(|_| {
        let start = Instant::now();
        (0..100).for_each(|_| call());
        start.elapsed().as_secs_f64() * 1e7
    });
    times.fold(f64::INFINITY, f64::min)
}

fn evaluation_times(compiled: &CompiledModel) {
    let n = compiled.unknowns();
    let mut m = compiled.memory();
    let (mut y, yp) = (vec![0.5; n], vec![0.0; n]);
    compiled.parameters(&mut m);
    compiled.prepare_parameters(&mut m);
    compiled.initial_states(&mut m, &mut y);
    compiled.initial_discretes(&mut m, &mut y);
    compiled.prepare_step(&mut m);
    let (mut out, mut values) = (vec![0.0; n], vec![0.0; compiled.pattern().nonzeros()]);
    let residual = nanoseconds(|| compiled.residual(&mut m, 0.0, &y, &yp, &mut out));
    let jacobian = nanoseconds(|| compiled.jacobian(&mut m, 0.0, &y, &yp, 1.0, &mut values));
    let prepare = nanoseconds(|| compiled.prepare_step(&mut m));
    let parameters = nanoseconds(|| compiled.prepare_parameters(&mut m));
    let finite = (out.iter().filter(|x| !x.is_finite()).count(), values.iter().filter(|x| !x.is_finite()).count());
    println!("    residual {residual:.1} ns, Jacobian {jacobian:.1} ns, prepare {prepare:.0} / {parameters:.0} ns, not finite {finite:?}");
}

fn main() {
    for path in std::env::args().skip(1) {
        match compile_times(Path::new(&path)) {
            Ok(compiled) => evaluation_times(&compiled),
            Err(message) => println!("{path}: {}", message.chars().take(600).collect::<String>()),
        }
    }
}
