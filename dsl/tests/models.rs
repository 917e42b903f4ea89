//! The models that ship with smpl parse without a fault.

use std::path::PathBuf;

use smpl_dsl::parse;
use smpl_dsl::span::FileId;

fn models() -> Vec<(PathBuf, String)> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../models");
    let entries = std::fs::read_dir(folder).expect("the models' folder");
    let paths = entries.map(|entry| entry.expect("an entry").path());
    let sources = paths.filter(|path| path.extension().is_some_and(|extension| extension == "eq"));
    sources.map(|path| (path.clone(), std::fs::read_to_string(path).expect("a model"))).collect()
}

#[test]
fn every_model_parses_without_a_fault() {
    let models = models();
    assert!(models.len() >= 3);
    for (path, text) in models {
        let parsed = parse(&text, FileId(0));
        let faults: Vec<_> = parsed.diagnostics.iter().map(|fault| (text[..fault.primary.span.start as usize].matches('\n').count() + 1, &fault.message, &fault.help)).collect();
        assert!(faults.is_empty(), "{}: {faults:#?}", path.display());
    }
}
