//! The structure of a text: outline, folding, selections, links and colours.

use std::ops::Range;
use std::path::PathBuf;

use smpl_dsl::span::{FileId, Span};
use smpl_dsl::syntax::{Statement, StatementKind};
use smpl_dsl::words;

use crate::program::{BuiltIn, Program};
use crate::symbols::{SymbolId, SymbolKind};
use crate::texts::Texts;
use crate::token::{TokenKind, tokens, word_at};

/// An entry of the outline.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Name.
    pub name: String,
    /// Kind.
    pub kind: SymbolKind,
    /// Describing text.
    pub detail: String,
    /// The whole statement or declaration.
    pub range: Range<usize>,
    /// The name.
    pub name_range: Range<usize>,
    /// Entries inside.
    pub children: Vec<Entry>,
}

fn bytes(span: Span) -> Range<usize> {
    span.start as usize..span.end as usize
}

/// The outline of a file: declarations and named statements, those of components and variants
/// inside of them.
#[must_use]
pub fn outline(program: &Program, file: FileId) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    let declared =
        program.symbols().iter().filter(|(_, s)| !s.kind.is_local() && !matches!(s.kind, SymbolKind::Member | SymbolKind::Choose));
    for (_, symbol) in declared {
        for site in symbol.sites.iter().filter(|site| site.name.file == file) {
            let (range, name_range) = (bytes(site.declaration), bytes(site.name));
            let detail = symbol.text.clone().unwrap_or_else(|| symbol.kind.words().to_owned());
            entries.push(Entry { name: symbol.name.clone(), kind: symbol.kind, detail, range, name_range, children: Vec::new() });
        }
    }
    entries.sort_by_key(|entry| (entry.range.start, std::cmp::Reverse(entry.range.end), entry.name_range.start));
    let mut out: Vec<Entry> = Vec::new();
    for entry in entries {
        place(&mut out, entry);
    }
    out
}

/// Puts an entry into the last one that holds it.
fn place(list: &mut Vec<Entry>, entry: Entry) {
    match list.last_mut() {
        Some(last) if last.range.start <= entry.range.start && entry.range.end <= last.range.end && last.range != entry.range => {
            place(&mut last.children, entry);
        }
        _ => list.push(entry),
    }
}

/// Parts of a file that an editor can fold, as lines counted from 0: blocks, long statements,
/// comments, and sections.
#[must_use]
pub fn folds(program: &Program, file: FileId) -> Vec<Range<usize>> {
    let Some(source) = program.file(file) else { return Vec::new() };
    let mut out = Vec::new();
    blocks(&source.tree.statements, &mut |span| {
        let (first, last) = (source.lines.line(span.start as usize), source.lines.line((span.end as usize).saturating_sub(1)));
        out.push(first..last);
    });
    let comment = |line: usize| source.text[source.lines.range(&source.text, line)].trim_start().starts_with('#');
    let title = |line: usize| source.text[source.lines.range(&source.text, line)].trim_start().starts_with("# --");
    let count = source.lines.count();
    let mut line = 0;
    while line < count {
        let end = (line..count).find(|&l| !comment(l)).unwrap_or(count);
        if end > line {
            out.push(line..end - 1);
        }
        line = end.max(line + 1);
    }
    // A line of dashes begins a section, which ends before the next one.
    let titles: Vec<usize> = (0..count).filter(|&l| title(l)).chain([count]).collect();
    out.extend(titles.windows(2).map(|pair| pair[0]..pair[1] - 1));
    out.retain(|range| range.end > range.start);
    out.sort_by_key(|range| (range.start, range.end));
    out.dedup();
    out
}

fn blocks(statements: &[Statement], visit: &mut dyn FnMut(Span)) {
    for statement in statements {
        visit(statement.span);
        blocks(statement.kind.block(), visit);
    }
}

/// Ranges around a byte, the smallest first: word, expressions, statements, file.
#[must_use]
pub fn selections(program: &Program, file: FileId, offset: usize) -> Vec<Range<usize>> {
    let Some(source) = program.file(file) else { return Vec::new() };
    let mut out = vec![word_at(&source.text, offset)];
    let around = program.statements_around(file, offset);
    if let Some(statement) = around.last() {
        let mut found: Vec<Range<usize>> = Vec::new();
        for outer in statement.kind.expressions() {
            outer.walk(&mut |e| {
                let range = bytes(e.span);
                if range.start <= offset && offset <= range.end {
                    found.push(range);
                }
            });
        }
        found.sort_by_key(|range| range.end - range.start);
        out.extend(found);
    }
    out.extend(around.iter().rev().map(|s| bytes(s.span)));
    out.push(0..source.text.len());
    out.retain(|range| range.start < range.end);
    let mut kept: Vec<Range<usize>> = Vec::new();
    for range in out {
        if kept.last().is_none_or(|last| range.start <= last.start && last.end <= range.end && range != *last) {
            kept.push(range);
        }
    }
    kept
}

/// Files that `use "path"` names, with the bytes of the path.
#[must_use]
pub fn links(program: &Program, texts: &dyn Texts) -> Vec<(Range<usize>, PathBuf)> {
    let Some(main) = program.files.first() else { return Vec::new() };
    let mut out = Vec::new();
    imports(&main.tree.statements, &mut |path, span| {
        if let Some(file) = texts.import(&main.path, path) {
            out.push((bytes(span), file));
        }
    });
    out
}

fn imports(statements: &[Statement], visit: &mut dyn FnMut(&str, Span)) {
    for statement in statements {
        match &statement.kind {
            StatementKind::Import { path, path_span } => visit(path, *path_span),
            _ => imports(statement.kind.block(), visit),
        }
    }
}

/// Colours of words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names are those of the protocol's token types")]
pub enum Colour {
    Keyword,
    Comment,
    Text,
    Number,
    Operator,
    Unit,
    Function,
    Constant,
    Parameter,
    State,
    Variable,
    Input,
    Member,
    Type,
    Instance,
    Label,
}

/// A coloured word.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coloured {
    /// Bytes.
    pub range: Range<usize>,
    /// Colour.
    pub colour: Colour,
    /// The name is declared here.
    pub declares: bool,
}

/// Colours of a file's words, by place.
#[must_use]
pub fn colours(program: &Program, file: FileId) -> Vec<Coloured> {
    let Some(source) = program.file(file) else { return Vec::new() };
    let occurrences = program.occurrences().iter().filter(|o| o.span.file == file);
    let mut known: Vec<Coloured> = occurrences
        .map(|o| Coloured { range: bytes(o.span), colour: of_symbol(program, o.symbol), declares: o.declares })
        .chain(program.built_in().iter().filter(|(span, _)| span.file == file).map(|(span, kind)| {
            let colour = match kind {
                BuiltIn::Unit => Colour::Unit,
                BuiltIn::Name if crate::reference::function(program.text(*span)).is_some() => Colour::Function,
                BuiltIn::Name => Colour::Constant,
            };
            Coloured { range: bytes(*span), colour, declares: false }
        }))
        .collect();
    known.sort_by_key(|c| c.range.start);
    tokens(&source.text)
        .into_iter()
        .filter_map(|token| {
            let word = &source.text[token.range.clone()];
            let colour = match token.kind {
                TokenKind::Comment => Colour::Comment,
                TokenKind::Text => Colour::Text,
                TokenKind::Number => Colour::Number,
                TokenKind::Word => {
                    let at = known.binary_search_by_key(&token.range.start, |c| c.range.start);
                    match at {
                        Ok(i) => return Some(Coloured { range: token.range, ..known[i].clone() }),
                        Err(_) if words::is_word(word) => Colour::Keyword,
                        Err(_) => return None,
                    }
                }
                TokenKind::Sign
                    if matches!(word, "+" | "-" | "*" | "/" | "^" | "=" | "==" | "!=" | "<" | ">" | "<=" | ">=" | "~" | "->") =>
                {
                    Colour::Operator
                }
                TokenKind::Sign | TokenKind::Newline => return None,
            };
            Some(Coloured { range: token.range, colour, declares: false })
        })
        .collect()
}

fn of_symbol(program: &Program, id: SymbolId) -> Colour {
    use smpl_dsl::syntax::Role;
    match program.symbol(id).kind {
        SymbolKind::Variable(Role::Param) | SymbolKind::Structural | SymbolKind::Table | SymbolKind::TimeTable => Colour::Constant,
        SymbolKind::Variable(Role::State | Role::Discrete) => Colour::State,
        SymbolKind::Variable(Role::Action | Role::Disturbance | Role::Random) => Colour::Input,
        SymbolKind::Variable(Role::Var | Role::Let) | SymbolKind::Flux | SymbolKind::Time => Colour::Variable,
        SymbolKind::Argument | SymbolKind::Index => Colour::Parameter,
        SymbolKind::Member | SymbolKind::Choose => Colour::Member,
        SymbolKind::Unit | SymbolKind::Set | SymbolKind::Domain | SymbolKind::Connector | SymbolKind::Component | SymbolKind::Model => {
            Colour::Type
        }
        SymbolKind::Instance | SymbolKind::Port => Colour::Instance,
        SymbolKind::Function => Colour::Function,
        SymbolKind::Level
        | SymbolKind::Observation
        | SymbolKind::Reward
        | SymbolKind::Failure
        | SymbolKind::Success
        | SymbolKind::Constraint
        | SymbolKind::Invariant
        | SymbolKind::Policy
        | SymbolKind::Event
        | SymbolKind::Phase
        | SymbolKind::Test
        | SymbolKind::Variant
        | SymbolKind::Choice => Colour::Label,
    }
}
