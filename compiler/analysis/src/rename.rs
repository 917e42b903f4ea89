//! Renaming a symbol in all files that name it, and the reasons against it.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use smpl_dsl::span::Span;
use smpl_dsl::units::Unit;
use smpl_dsl::words;

use crate::program::{Program, imports};
use crate::reference::is_built_in;
use crate::scenario;
use crate::symbols::{SymbolId, SymbolKind};
use crate::texts::Texts;

/// A replacement of bytes of a file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Edit {
    /// File.
    pub path: PathBuf,
    /// First byte.
    pub start: usize,
    /// One past the last byte.
    pub end: usize,
    /// New text.
    pub text: String,
}

impl Edit {
    /// The replaced bytes.
    #[must_use]
    pub fn range(&self) -> Range<usize> {
        self.start..self.end
    }
}

/// A text with edits worked in; they must be in order and must not overlap.
#[must_use]
pub fn applied<'e>(text: &str, edits: impl IntoIterator<Item = &'e Edit>) -> String {
    let (mut out, mut at) = (String::with_capacity(text.len()), 0);
    for edit in edits {
        out.push_str(text.get(at..edit.start).unwrap_or_default());
        out.push_str(&edit.text);
        at = edit.end.max(at);
    }
    out.push_str(text.get(at..).unwrap_or_default());
    out
}

/// Texts with some of them replaced.
pub struct Changed<'t> {
    /// Content below.
    pub below: &'t (dyn Texts + Sync),
    /// Replaced texts.
    pub texts: BTreeMap<PathBuf, Arc<str>>,
}

impl<'t> Changed<'t> {
    /// Texts after edits, which need not be in order.
    #[must_use]
    pub fn by(below: &'t (dyn Texts + Sync), edits: &[Edit]) -> Changed<'t> {
        let mut by_file: BTreeMap<&Path, Vec<&Edit>> = BTreeMap::new();
        edits.iter().for_each(|edit| by_file.entry(&edit.path).or_default().push(edit));
        let texts = by_file.into_iter().filter_map(|(path, mut list)| {
            list.sort();
            Some((path.to_owned(), applied(&below.text(path)?, list).into()))
        });
        Changed { below, texts: texts.collect() }
    }
}

impl Texts for Changed<'_> {
    fn text(&self, path: &Path) -> Option<Arc<str>> {
        self.texts.get(path).cloned().or_else(|| self.below.text(path))
    }

    fn import(&self, main: &Path, written: &str) -> Option<PathBuf> {
        self.below.import(main, written)
    }

    fn models(&self, path: &Path) -> Vec<PathBuf> {
        self.below.models(path)
    }

    fn scenarios(&self, model: &Path) -> Vec<PathBuf> {
        self.below.scenarios(model)
    }
}

/// A declared name: file and first byte. It identifies a symbol in every program that reads the
/// file.
type Declared = (PathBuf, u32);

fn declared(program: &Program, id: SymbolId) -> Option<Declared> {
    let span = program.symbol(id).span();
    Some((program.file(span.file)?.path.clone(), span.start))
}

fn found(program: &Program, (path, start): &Declared) -> Option<SymbolId> {
    let file = program.file_of(path)?;
    let of = |o: &&crate::resolve::Occurrence| o.span.file == file && o.span.start == *start && o.declares;
    program.occurrences().iter().find(of).map(|o| o.symbol)
}

/// Programs that read the file in which a symbol is declared, the given one first.
fn readers(program: &Program, path: &Path, texts: &(dyn Texts + Sync)) -> Vec<Program> {
    let own = program.files.first().map(|file| file.path.clone());
    let others = texts.models(path).into_iter().filter(|model| Some(model) != own.as_ref());
    let may_read = |model: &PathBuf| model == path || imports(model, texts);
    let others = others.filter(may_read).filter_map(|model| Program::new(&model, texts));
    let others = others.filter(|other| other.file_of(path).is_some());
    std::iter::once(program.clone()).chain(others).collect()
}

/// All places that name a symbol, in all models and scenarios of the workspace, by file and place.
#[must_use]
pub fn references(program: &Program, id: SymbolId, texts: &(dyn Texts + Sync)) -> Vec<(PathBuf, Range<usize>)> {
    let Some(key) = declared(program, id) else { return Vec::new() };
    named_in(&readers(program, &key.0, texts), &key, texts)
}

/// All places in programs and their scenarios that name what is declared at a place.
fn named_in(readers: &[Program], key: &Declared, texts: &(dyn Texts + Sync)) -> Vec<(PathBuf, Range<usize>)> {
    let mut out = Vec::new();
    for reader in readers {
        let Some(id) = found(reader, key) else { continue };
        let places = reader.occurrences_of(id).filter_map(|o| Some((reader.file(o.span.file)?.path.clone(), range(o.span))));
        out.extend(places);
        for (path, text) in scenarios(reader, texts) {
            let names = scenario::names(reader, &text).into_iter().filter(|(_, named)| *named == id);
            out.extend(names.map(|(range, _)| (path.clone(), range)));
        }
    }
    out.sort_by(|a, b| (&a.0, a.1.start).cmp(&(&b.0, b.1.start)));
    out.dedup();
    out
}

fn range(span: Span) -> Range<usize> {
    span.start as usize..span.end as usize
}

fn scenarios(program: &Program, texts: &(dyn Texts + Sync)) -> Vec<(PathBuf, Arc<str>)> {
    let Some(main) = program.files.first() else { return Vec::new() };
    texts.scenarios(&main.path).into_iter().filter_map(|path| Some((path.clone(), texts.text(&path)?))).collect()
}

/// Edits that give a symbol another name everywhere.
///
/// # Errors
/// The reason, if the new name cannot be used or would change what another name means.
pub fn rename(program: &Program, id: SymbolId, new: &str, texts: &(dyn Texts + Sync)) -> Result<Vec<Edit>, String> {
    valid(program, id, new)?;
    let Some(key) = declared(program, id) else { return Ok(Vec::new()) };
    let readers = readers(program, &key.0, texts);
    let places = named_in(&readers, &key, texts);
    if places.is_empty() {
        return Err(format!("`{}` is not declared in a file that can be edited", program.symbol(id).name));
    }
    let edits: Vec<Edit> =
        places.into_iter().map(|(path, range)| Edit { path, start: range.start, end: range.end, text: new.to_owned() }).collect();
    let changed = Changed::by(texts, &edits);
    for before in &readers {
        let Some(main) = before.files.first() else { continue };
        let Some(after) = Program::new(&main.path, &changed) else { continue };
        same_meaning(before, &after, &edits, new)?;
    }
    Ok(edits)
}

fn valid(program: &Program, id: SymbolId, new: &str) -> Result<(), String> {
    let old = &program.symbol(id).name;
    let letters = new.chars().all(crate::token::is_word) && new.starts_with(|c: char| c.is_ascii_alphabetic());
    let number = program.symbol(id).kind == SymbolKind::Member && !new.is_empty() && new.chars().all(|c| c.is_ascii_digit());
    if !letters && !number {
        return Err(format!("`{new}` is not a name: names are made of the letters a to z, digits and `_`, and begin with a letter"));
    }
    if new == old {
        return Err(format!("`{new}` is the present name"));
    }
    if words::is_word(new) {
        return Err(format!("`{new}` is a word of the language"));
    }
    if program.symbol(id).kind == SymbolKind::Unit && Unit::named(new).is_some() {
        return Err(format!("`{new}` is a built-in unit"));
    }
    if is_built_in(new) && program.symbol(id).kind.is_value() {
        return Err(format!("`{new}` is a built-in name, whose meaning the declaration would hide"));
    }
    Ok(())
}

/// Compares what all names mean before and after.
fn same_meaning(before: &Program, after: &Program, edits: &[Edit], new: &str) -> Result<(), String> {
    let moved = |path: &Path, offset: u32| {
        let grown =
            edits.iter().filter(|e| e.path == path && e.start < offset as usize).map(|e| e.text.len() as i64 - e.range().len() as i64);
        (i64::from(offset) + grown.sum::<i64>()) as u32
    };
    let clash = |line: usize| Err(format!("`{new}` already has a meaning on line {line}, which the new name would change"));
    let shown = |program: &Program| -> Vec<(PathBuf, u32, Option<Declared>, usize)> {
        let of = |o: &crate::resolve::Occurrence| {
            let path = program.file(o.span.file).map(|file| file.path.clone()).unwrap_or_default();
            (path, o.span.start, declared(program, o.symbol), program.line(o.span))
        };
        program.occurrences().iter().map(of).collect()
    };
    let (old, now) = (shown(before), shown(after));
    for (a, b) in old.iter().zip(&now) {
        let place = (&a.0, moved(&a.0, a.1));
        let meaning = a.2.as_ref().map(|(path, start)| (path.clone(), moved(path, *start)));
        if place != (&b.0, b.1) || meaning != b.2 {
            return clash(b.3);
        }
    }
    if old.len() != now.len() {
        return clash(old.get(now.len()).or_else(|| now.get(old.len())).map_or(1, |o| o.3));
    }
    Ok(())
}
