//! Time to parse each file given on the command line: the median of many runs.

use std::time::Instant;

use smpl_dsl::parse;
use smpl_dsl::span::FileId;

fn main() {
    for path in std::env::args().skip(1) {
        let Ok(text) = std::fs::read_to_string(&path) else {
            println!("{path}: not readable");
            continue;
        };
        let mut times: Vec<f64> = (0..400).map(|_| seconds(&text)).collect();
        times.sort_by(f64::total_cmp);
        let faults = parse(&text, FileId(0)).diagnostics.len();
        println!("{path}: {:.0} us, {} bytes, {faults} faults", times[200] * 1e6, text.len());
    }
}

fn seconds(text: &str) -> f64 {
    let start = Instant::now();
    std::hint::black_box(parse(std::hint::black_box(text), FileId(0)));
    start.elapsed().as_secs_f64()
}
