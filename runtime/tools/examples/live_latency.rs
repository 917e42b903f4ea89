//! Prints the latencies of `smpl live` as a page sees them: the first curves, a slider that moves, diagnostics after a keystroke.
//!
//! ```sh
//! cargo build --release --bin smpl && cargo run --release -p smpl-tools --example live_latency [MODEL.eq ...]
//! ```

#[path = "../tests/client/mod.rs"]
mod client;

use std::path::PathBuf;
use std::time::Instant;

use client::{Live, Page};
use serde_json::{Value, json};

/// Requests of each kind.
const COUNT: usize = 40;

fn main() {
    let given: Vec<PathBuf> = std::env::args().skip(1).map(PathBuf::from).collect();
    let names = ["reactor", "beer", "pensim", "atropine", "mab"];
    let usual = || names.iter().map(|name| PathBuf::from(format!("models/{name}.eq"))).collect();
    let paths: Vec<PathBuf> = if given.is_empty() { usual() } else { given };
    println!("{:<12} {:>10} {:>12} {:>12} {:>14} {:>14}", "model", "first run", "slider", "slider 95 %", "diagnostics", "diagn. 95 %");
    for path in paths {
        let path = path.canonicalize().expect("a model");
        let row = measure(&path);
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        println!("{name:<12} {:>7.1} ms {:>9.1} ms {:>9.1} ms {:>11.1} ms {:>11.1} ms", row[0], row[1], row[2], row[3], row[4]);
    }
}

fn measure(path: &std::path::Path) -> [f64; 5] {
    let live = Live::start(&[path.to_str().expect("utf-8")]);
    let mut page = live.page();
    page.result("initialize", json!({"capabilities": {}}));
    page.notify("initialized", json!({}));
    let text = std::fs::read_to_string(path).expect("a text");
    let uri = page.open(path, &text);
    let begin = Instant::now();
    page.run(&uri, json!({}));
    let first = begin.elapsed().as_secs_f64() * 1e3;
    let model = page.result("smpl/model", json!({"uri": uri}));
    let slider = moves(&model).map(|settings| timed(&mut page, &uri, settings)).collect();
    let typed = (0..COUNT).map(|i| keystroke(&mut page, &uri, &text, i as i32 + 2)).collect();
    let ((median, high), (typed, typed_high)) = (quantiles(slider), quantiles(typed));
    [first, median, high, typed, typed_high]
}

/// Settings of a slider on the first parameter that does not shape the model, on its way from 90 to 110 % of its value.
fn moves(model: &Value) -> impl Iterator<Item = Value> {
    let parameters = model["parameters"].as_array().cloned().unwrap_or_default();
    let usable = |p: &&Value| p["structural"] == false && p["value"].as_f64().is_some_and(|x| x != 0.0);
    let parameter = parameters.iter().find(usable).cloned().unwrap_or(Value::Null);
    (0..COUNT).map(move |i| {
        let factor = 0.9 + 0.2 * i as f64 / COUNT as f64;
        match (parameter["name"].as_str(), parameter["value"].as_f64()) {
            (Some(name), Some(value)) => json!({"parameters": {name: value * factor}}),
            _ => json!({"seed": i}),
        }
    })
}

fn timed(page: &mut Page, uri: &str, settings: Value) -> f64 {
    let begin = Instant::now();
    // A value beyond the bounds is an answer too.
    let _ = page.call("smpl/run", json!({"uri": uri, "settings": settings}));
    begin.elapsed().as_secs_f64() * 1e3
}

fn keystroke(page: &mut Page, uri: &str, text: &str, version: i32) -> f64 {
    let begin = Instant::now();
    page.change(uri, version, &format!("{text}# {version}\n"));
    let published = |message: &Value| {
        message["method"] == "textDocument/publishDiagnostics" && message["params"]["version"] == version && message["params"]["uri"] == uri
    };
    page.wait("diagnostics", published);
    begin.elapsed().as_secs_f64() * 1e3
}

fn quantiles(mut times: Vec<f64>) -> (f64, f64) {
    times.sort_by(f64::total_cmp);
    (times[times.len() / 2], times[times.len() * 95 / 100])
}
