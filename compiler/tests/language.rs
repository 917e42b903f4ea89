//! The faults (and the correct models) that `tests/language/*.md` specify.

#[path = "../../dsl/tests/mdtest/runner.rs"]
mod runner;

use std::path::Path;

use smpl_compiler::compile::flatten;
use smpl_compiler::elaborate::Options;
use smpl_dsl::diagnostic::{Diagnostic, SourceMap};

/// Files that the cases may import.
fn library(path: &str) -> Option<(String, String)> {
    let text = match path {
        "lib/streams.eq" => "connector Stream { Q : L/min, c : mol/L }\n",
        "lib/rates.eq" => "def arrhenius(k_0, E, T) = k_0 * exp(-E / T)\n",
        "lib/money.eq" => "unit USD\nunit kUSD = 1000 [USD]\nparam fee : USD/s = 1\n",
        "lib/broken.eq" => "param k : 1/s = = 1\n",
        _ => return None,
    };
    Some((path.to_owned(), text.to_owned()))
}

fn faults(source: &str) -> Vec<Diagnostic> {
    let mut sources = SourceMap::new();
    let main = sources.add("model.eq", source);
    match flatten(&mut sources, main, &mut library, &Options { verify: true, ..Options::default() }) {
        Ok((_, warnings)) => warnings,
        Err(faults) => faults,
    }
}

#[test]
fn models_are_accepted_and_refused_as_specified() {
    runner::run(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/language"), faults);
}
