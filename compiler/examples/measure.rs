//! Compiles model files and prints sizes, compile times and evaluation times: `measure models/*.eq`.

use std::path::Path;
use std::time::Instant;

use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::elaborate::Options;
use smpl_compiler::front::flatten;
use smpl_compiler::model::Model;
use smpl_dsl::diagnostic::SourceMap;

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

/// Nanoseconds of one call, the median of batches.
fn nanoseconds(mut call: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..21)
        .map(|_| {
            let start = Instant::now();
            (0..100).for_each(|_| call());
            start.elapsed().as_secs_f64() * 1e7
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[10]
}

fn main() {
    for path in std::env::args().skip(1) {
        let start = Instant::now();
        let model = match load(Path::new(&path)) {
            Ok(model) => model,
            Err(message) => {
                println!("{path}: {}", message.chars().take(600).collect::<String>());
                continue;
            }
        };
        let front = start.elapsed();
        let start = Instant::now();
        let compiled = match CompiledModel::build(model, &BackEndSettings::default()) {
            Ok(compiled) => compiled,
            Err(error) => {
                println!("{path}: {error}");
                continue;
            }
        };
        let back = start.elapsed();
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
        let s = compiled.statistics();
        println!(
            "{path}: {n} unknowns, {} non-zeros, front {front:.1?}, back {back:.1?}, differentiate {:.1?}, hoist {:.1?}, {} bytes, {} cached",
            s.nonzeros, s.differentiate, s.hoist, s.code_bytes, s.cached
        );
        println!("    {:?}", s.functions);
        println!(
            "    residual {residual:.0} ns, Jacobian {jacobian:.0} ns, prepare {prepare:.0} / {parameters:.0} ns, not finite {finite:?}"
        );
    }
}
