//! Places of names in the text of a scenario.

use smpl_dsl::diagnostic::SourceMap;
use smpl_dsl::span::{FileId, Span};

use super::Scenario;

impl Scenario {
    /// Place of a name in the scenario's file, or the key with escaped characters (`"\u006b"`);
    /// `None` without either, or without a file.
    #[must_use]
    pub fn place_of(&self, sources: &SourceMap, name: &str) -> Option<Span> {
        let file = self.file?;
        let text = sources.file(file)?.text();
        let span = find_name(text, name, file);
        if span.end > span.start {
            return Some(span);
        }
        let keys = [("parameters", &self.parameters), ("settings", &self.settings), ("initial", &self.initial)];
        let key = keys.iter().find(|(_, values)| values.contains_key(name)).map(|(key, _)| *key);
        let key = key.or_else(|| self.grid.contains_key(name).then_some("grid"))?;
        Some(find_under(text, key, name, file))
    }

    /// The beginning of the scenario's file.
    #[must_use]
    pub fn start(&self) -> Option<Span> {
        self.file.map(|file| Span { file, start: 0, end: 0 })
    }

    /// Place of a name under a key of the scenario, else anywhere.
    #[must_use]
    pub(crate) fn place_under(&self, sources: &SourceMap, key: &str, name: &str) -> Span {
        let Some(file) = self.file else { return Span::default() };
        find_under(sources.file(file).map_or("", |f| f.text()), key, name, file)
    }
}

/// Place of a name under a key of the file, else anywhere, else the key.
pub(super) fn find_under(text: &str, key: &str, name: &str, file: FileId) -> Span {
    let Some(from) = section(text, key) else { return find_name(text, name, file) };
    let inside = find_name(&text[from..], name, file);
    if inside.end > inside.start {
        return Span { start: inside.start + from as u32, end: inside.end + from as u32, ..inside };
    }
    let anywhere = find_name(text, name, file);
    if anywhere.end > anywhere.start { anywhere } else { Span { file, start: from as u32, end: (from + key.len()) as u32 } }
}

/// Start of a key of the file.
fn section(text: &str, key: &str) -> Option<usize> {
    let begins = |line: &str| line.strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with(':'));
    text.split_inclusive('\n')
        .scan(0, |at, line| Some((std::mem::replace(at, *at + line.len()), line)))
        .find(|(_, line)| begins(line))
        .map(|(at, _)| at)
}

/// The second place where a name is a key, from where its mapping begins (or from that place
/// itself).
pub(super) fn second_key(text: &str, name: &str, from: usize, file: FileId) -> Span {
    let is_key = |at: &usize| {
        let line = text[..*at].rfind('\n').map_or(0, |n| n + 1);
        let before = text[..*at].chars().next_back();
        let after = text[at + name.len()..].trim_start_matches(['"', '\'']).trim_start();
        let is_word = before.is_none_or(|c| !c.is_alphanumeric() && c != '_');
        is_word && after.starts_with(':') && !text[line..*at].contains('#')
    };
    let places: Vec<usize> = text.match_indices(name).map(|(at, _)| at).filter(is_key).collect();
    let inside: Vec<usize> = places.iter().copied().filter(|at| *at >= from).collect();
    let at = inside.get(1).or(inside.first()).or(places.last());
    at.map_or_else(|| find_name(text, name, file), |&at| Span { file, start: at as u32, end: (at + name.len()) as u32 })
}

/// Place of a name as a separate word in the text; the beginning if it is missing.
pub(super) fn find_name(text: &str, name: &str, file: FileId) -> Span {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let at = text.match_indices(name).map(|(at, _)| at).find(|&at| {
        let line = text[..at].rfind('\n').map_or(0, |n| n + 1);
        let comment = text[line..at].contains('#');
        !comment && !text[..at].ends_with(is_word) && !text[at + name.len()..].starts_with(is_word)
    });
    let (start, end) = at.map_or((0, 0), |at| (at, at + name.len()));
    Span { file, start: start as u32, end: end as u32 }
}
