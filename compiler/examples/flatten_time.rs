//! Times from text to flat model: `flatten_time models/*.eq` prints the first call and the fastest of many.

use std::path::Path;
use std::time::{Duration, Instant};

use smpl_compiler::compile::flatten;
use smpl_compiler::elaborate::Options;
use smpl_dsl::diagnostic::SourceMap;

fn once(path: &Path, text: &str) -> Duration {
    let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
    let mut loader = |name: &str| Some((name.to_owned(), std::fs::read_to_string(folder.join(name)).ok()?));
    let mut sources = SourceMap::default();
    let main = sources.add(path.display().to_string(), text);
    let start = Instant::now();
    let flat = flatten(&mut sources, main, &mut loader, &Options::default());
    let time = start.elapsed();
    if let Err(faults) = flat {
        println!("{}: {} faults", path.display(), faults.len());
    }
    time
}

fn main() {
    for path in std::env::args().skip(1) {
        let path = Path::new(&path);
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) => {
                println!("{}: {error}", path.display());
                continue;
            }
        };
        let first = once(path, &text);
        let (mut best, since) = (first, Instant::now());
        while since.elapsed() < Duration::from_millis(500) {
            best = best.min(once(path, &text));
        }
        println!("{}: first {first:.2?}, fastest {best:.2?}", path.display());
    }
}
