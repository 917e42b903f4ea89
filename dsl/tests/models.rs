//! The models and the examples of the language reference parse without a fault.

mod common;

use smpl_dsl::parse;
use smpl_dsl::span::FileId;

#[test]
fn every_model_parses_without_a_fault() {
    let models = common::models();
    assert!(models.len() >= 3);
    for (path, text) in models {
        assert!(parse(&text, FileId(0)).is_ok(), "{path}: {:#?}", parse(&text, FileId(0)).diagnostics);
    }
}

#[test]
fn every_example_of_the_reference_parses() {
    let examples = common::blocks("docs/language.md", "```");
    assert!(examples.len() >= 6);
    for text in examples {
        let text = text.replace("  ...\n", "");
        assert!(parse(&text, FileId(0)).is_ok(), "{text}\n{:#?}", parse(&text, FileId(0)).diagnostics);
    }
}
