//! Texts that the page has open.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};

use serde::Deserialize;

/// Open texts by path.
#[derive(Debug, Default)]
pub(crate) struct Texts {
    open: RwLock<HashMap<PathBuf, (i32, Arc<str>)>>,
}

/// A change of a text: of a range, or the whole text.
#[derive(Debug, Deserialize)]
pub(crate) struct Change {
    range: Option<Range>,
    text: String,
}

#[derive(Debug, Deserialize)]
struct Range {
    start: Position,
    end: Position,
}

#[derive(Debug, Deserialize)]
struct Position {
    line: usize,
    character: usize,
}

impl Texts {
    /// The open text of a file.
    pub(crate) fn text(&self, path: &Path) -> Option<String> {
        self.open.read().unwrap_or_else(PoisonError::into_inner).get(path).map(|(_, text)| text.to_string())
    }

    /// The version of an open text.
    pub(crate) fn version(&self, path: &Path) -> Option<i32> {
        self.open.read().unwrap_or_else(PoisonError::into_inner).get(path).map(|(version, _)| *version)
    }

    pub(crate) fn open(&self, path: &Path, version: i32, text: &str) {
        self.open.write().unwrap_or_else(PoisonError::into_inner).insert(path.to_owned(), (version, text.into()));
    }

    pub(crate) fn close(&self, path: &Path) {
        self.open.write().unwrap_or_else(PoisonError::into_inner).remove(path);
    }

    /// Applies changes in their order.
    pub(crate) fn change(&self, path: &Path, version: i32, changes: Vec<Change>) {
        let mut open = self.open.write().unwrap_or_else(PoisonError::into_inner);
        let Some((known, text)) = open.get_mut(path) else { return };
        *known = version;
        let mut now = text.to_string();
        for Change { range, text } in changes {
            match range {
                None => now = text,
                Some(Range { start, end }) => {
                    let (start, end) = (offset(&now, &start), offset(&now, &end));
                    now.replace_range(start..end.max(start), &text);
                }
            }
        }
        *text = now.into();
    }
}

/// The byte of a position that counts UTF-16 units; the end of the line, or of the text, for one beyond it.
fn offset(text: &str, position: &Position) -> usize {
    let start = match position.line {
        0 => 0,
        line => text.match_indices('\n').nth(line - 1).map_or(text.len(), |(at, _)| at + 1),
    };
    let line = text[start..].split('\n').next().unwrap_or_default();
    let mut units = 0;
    for (at, c) in line.char_indices() {
        if units >= position.character {
            return start + at;
        }
        units += c.len_utf16();
    }
    start + line.len()
}
