//! The syntax errors that `tests/language/syntax/*.md` specify.

#[path = "mdtest/runner.rs"]
mod runner;

use std::path::Path;

use smpl_dsl::parse;
use smpl_dsl::span::FileId;

#[test]
fn syntax_errors_are_as_specified() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/language/syntax");
    runner::run(&folder, |source| parse(source, FileId(0)).diagnostics.shown());
}
