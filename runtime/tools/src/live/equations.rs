//! The equations of a text, typeset, each with its place.

use std::path::Path;

use serde_json::{Value, json};
use smpl_compiler::read::read;
use smpl_dsl::diagnostic::SourceMap;

use super::describe::range;
use super::texts::Texts;
use super::wire::{Answer, Fault, Kind};
use crate::document::{Typeset, typeset};

/// The answer to `smpl/equations`, from the text as it is; faulty statements are left out.
///
/// # Errors
/// A file that cannot be read.
pub(crate) fn answer(path: &Path, texts: &Texts) -> Answer {
    let text = match texts.text(path) {
        Some(text) => text,
        None => smpl_runtime::files::read_text(path).map_err(|error| Fault::new(Kind::File, smpl_runtime::files::plain(&error)))?,
    };
    let mut sources = SourceMap::new();
    let main = sources.add(path.display().to_string(), text);
    let folder = path.parent().map(Path::to_owned).unwrap_or_default();
    let open = |path: &Path| texts.text(path);
    let found = read(&mut sources, main, None, &mut |name| smpl_runtime::load::import_open(&folder, name, &open));
    let entries: Vec<Typeset> = found.files.iter().flat_map(typeset).collect();
    let shown = |entry: &Typeset| {
        json!({
            "latex": entry.latex, "kind": entry.kind, "name": entry.name, "range": range(&sources, entry.span),
            "text": sources.text(entry.span).trim_end(),
        })
    };
    Ok(json!({"stale": !found.faults.is_empty(), "equations": entries.iter().map(shown).collect::<Vec<Value>>()}))
}
