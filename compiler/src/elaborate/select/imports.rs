//! The statements of the main file, with imports replaced by the statements of their files.

use std::collections::HashMap;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{File, Statement, StatementKind};

use crate::elaborate::select::items::{Item, Selection, items, overlay, plain, selected};

/// The items of `files[0]` and of its imports under a selection, and the imports that were not
/// found; `imports` maps a path to its file.
pub(in crate::elaborate) fn gathered<'a>(
    files: &'a [File],
    imports: &HashMap<String, usize>,
    selection: &Selection,
) -> (Vec<Item<'a>>, Vec<Diagnostic>) {
    let mut gather = Gather { files, imports, selection, seen: vec![false; files.len()], faults: Vec::new() };
    let mut out = Vec::new();
    gather.file(0, &mut out);
    (out, gather.faults)
}

struct Gather<'a, 'i> {
    files: &'a [File],
    imports: &'i HashMap<String, usize>,
    selection: &'i Selection,
    /// Files that are there already.
    seen: Vec<bool>,
    faults: Vec<Diagnostic>,
}

impl<'a> Gather<'a, '_> {
    /// Items of a file after those of its imports.
    fn file(&mut self, file: usize, out: &mut Vec<Item<'a>>) {
        if std::mem::replace(&mut self.seen[file], true) {
            return;
        }
        let statements = &self.files[file].statements;
        self.items(plain(statements), out);
        // Variants and choices may replace what is imported.
        for body in selected(statements, self.selection) {
            let mut over = Vec::new();
            self.items(items(body, self.selection), &mut over);
            overlay(out, over);
        }
    }

    /// Items, with imports replaced by the items of their files.
    fn items(&mut self, list: Vec<Item<'a>>, out: &mut Vec<Item<'a>>) {
        for item in list {
            let Item::Other(Statement { kind: StatementKind::Import { path, path_span }, .. }) = item else {
                out.push(item);
                continue;
            };
            match self.imports.get(path) {
                Some(&imported) => self.file(imported, out),
                None => {
                    let message = format!("the file `{path}` was not found next to the model or in the library");
                    self.faults.push(Diagnostic::error(codes::UNKNOWN_IMPORT, message, *path_span));
                }
            }
        }
    }
}
