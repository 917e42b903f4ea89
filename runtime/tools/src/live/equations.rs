//! The equations of a text, typeset, each with its place.

use std::path::Path;

use serde_json::{Value, json};
use smpl_analysis::equations::{Typeset, equations};
use smpl_analysis::position::{Encoding, Position};
use smpl_analysis::program::Program;

use super::uri::uri_of;
use super::wire::{Answer, Fault, FaultKind};
use crate::lsp::OpenTexts;

/// The answer to `smpl/equations`, from the text as it is; faulty statements are left out.
/// Components and alternatives are headings.
///
/// # Errors
/// A file that cannot be read.
pub(crate) fn answer(path: &Path, texts: &OpenTexts) -> Answer {
    let program = Program::new(path, texts).ok_or_else(|| Fault::new(FaultKind::File, format!("{}: cannot be read", path.display())))?;
    let mut shown: Vec<Value> = Vec::new();
    let mut within: Vec<String> = Vec::new();
    for entry in equations(&program) {
        if entry.within != within {
            within.clone_from(&entry.within);
            if let Some(name) = within.last() {
                shown.push(json!({"latex": "", "kind": "heading", "name": name, "text": within.join(", "), "uri": null, "range": null}));
            }
        }
        shown.extend(one(&program, &entry));
    }
    Ok(json!({"stale": !program.faults.is_empty(), "equations": shown}))
}

fn one(program: &Program, entry: &Typeset) -> Option<Value> {
    let file = program.file(entry.span.file)?;
    let position = |byte: u32| {
        let Position { line, character } = file.lines.position(&file.text, byte as usize, Encoding::Utf16);
        json!({"line": line, "character": character})
    };
    let text = program.text(entry.span).trim_end();
    let kind = if entry.definition { "let" } else { "equation" };
    Some(json!({
        "latex": entry.latex, "kind": kind, "name": "", "text": text, "uri": uri_of(&file.path),
        "range": {"start": position(entry.span.start), "end": position(entry.span.start + text.len() as u32)},
    }))
}
