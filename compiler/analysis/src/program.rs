//! A file with its imports: trees, symbols, and where each symbol occurs.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use smpl_compiler::read;
use smpl_dsl::diagnostic::{Diagnostic, SourceMap};
use smpl_dsl::span::{FileId, Span};
use smpl_dsl::stack::on_own_stack;
use smpl_dsl::syntax::{File, Statement, StatementKind};

use crate::position::Lines;
use crate::resolve::{Occurrence, Resolved, resolve};
use crate::symbols::{Symbol, SymbolId, SymbolKind, Symbols};
use crate::texts::Texts;

pub use crate::resolve::{BuiltIn, EquationUse};

/// One text of a program.
#[derive(Clone, Debug)]
pub struct SourceText {
    /// Its file.
    pub path: PathBuf,
    /// The text.
    pub text: Arc<str>,
    /// Its lines.
    pub lines: Lines,
    /// The statements that could be parsed.
    pub tree: File,
}

/// A file of a model with what it imports.
#[derive(Clone, Debug)]
pub struct Program {
    /// Texts; the main one first. A [`FileId`] is an index.
    pub files: Vec<SourceText>,
    /// Faults of the texts alone.
    pub faults: Vec<Diagnostic>,
    resolved: Resolved,
}

impl Program {
    /// Reads a file and its imports; `None` if there is no such file.
    #[must_use]
    pub fn new(main: &Path, texts: &(dyn Texts + Sync)) -> Option<Program> {
        let text = texts.text(main)?;
        Some(on_own_stack(|| Program::of(main, &text, texts)))
    }

    fn of(main: &Path, text: &str, texts: &(dyn Texts + Sync)) -> Program {
        let mut sources = SourceMap::new();
        let id = sources.add(main.display().to_string(), text);
        let read = read::read(&mut sources, id, None, &[], &mut |written| loaded(main, written, texts));
        let files = read.files.into_iter().zip(&read.ids).map(|(tree, id)| {
            let text: Arc<str> = sources.file(*id).map_or("", |file| file.text()).into();
            SourceText { path: sources.name(*id).into(), lines: Lines::new(&text), text, tree }
        });
        let files: Vec<SourceText> = files.collect();
        let resolved = resolve(&files.iter().map(|file| &file.tree).collect::<Vec<_>>());
        Program { files, faults: read.faults.shown(), resolved }
    }

    /// The text of a file of the program.
    #[must_use]
    pub fn file(&self, id: FileId) -> Option<&SourceText> {
        self.files.get(usize::from(id.0))
    }

    /// The file of a path.
    #[must_use]
    pub fn file_of(&self, path: &Path) -> Option<FileId> {
        self.files.iter().position(|file| file.path == path).map(|i| FileId(i as u16))
    }

    /// The text of a span.
    #[must_use]
    pub fn text(&self, span: Span) -> &str {
        self.file(span.file).and_then(|file| file.text.get(span.start as usize..span.end as usize)).unwrap_or("")
    }

    /// Line of the first character of a span, counted from 1.
    #[must_use]
    pub fn line(&self, span: Span) -> usize {
        self.file(span.file).map_or(1, |file| file.lines.line(span.start as usize) + 1)
    }

    /// Symbols.
    #[must_use]
    pub fn symbols(&self) -> &Symbols {
        &self.resolved.symbols
    }

    /// A symbol.
    #[must_use]
    pub fn symbol(&self, id: SymbolId) -> &Symbol {
        self.resolved.symbols.get(id)
    }

    /// All occurrences, by place.
    #[must_use]
    pub fn occurrences(&self) -> &[Occurrence] {
        &self.resolved.occurrences
    }

    /// Occurrences of a symbol, by place.
    pub fn occurrences_of(&self, symbol: SymbolId) -> impl Iterator<Item = &Occurrence> {
        self.resolved.occurrences.iter().filter(move |o| o.symbol == symbol)
    }

    /// The occurrence around or just before a byte.
    #[must_use]
    pub fn occurrence_at(&self, file: FileId, offset: usize) -> Option<&Occurrence> {
        let offset = offset as u32;
        let after = self.resolved.occurrences.partition_point(|o| (o.span.file, o.span.start) <= (file, offset));
        let before = self.resolved.occurrences[..after].last()?;
        (before.span.file == file && offset <= before.span.end).then_some(before)
    }

    /// Built-in names and units, by place.
    #[must_use]
    pub fn built_in(&self) -> &[(Span, BuiltIn)] {
        &self.resolved.built_in
    }

    /// The built-in name or unit around or just before a byte.
    #[must_use]
    pub fn built_in_at(&self, file: FileId, offset: usize) -> Option<(Span, BuiltIn)> {
        let offset = offset as u32;
        let holds = |(span, _): &&(Span, BuiltIn)| span.file == file && span.start <= offset && offset <= span.end;
        self.resolved.built_in.iter().find(holds).copied()
    }

    /// Equations, definitions and connections in the order of the text.
    #[must_use]
    pub fn equations(&self) -> &[EquationUse] {
        &self.resolved.equations
    }

    /// Innermost statement around a byte.
    #[must_use]
    pub fn statement_at(&self, file: FileId, offset: usize) -> Option<&Statement> {
        self.statements_around(file, offset).last().copied()
    }

    /// Statements around a byte, the outermost first.
    #[must_use]
    pub fn statements_around(&self, file: FileId, offset: usize) -> Vec<&Statement> {
        let mut out = Vec::new();
        let mut list = self.file(file).map_or(&[][..], |file| &file.tree.statements);
        let holds = |s: &&Statement| (s.span.start as usize..=s.span.end as usize).contains(&offset);
        while let Some(statement) = list.iter().find(holds) {
            out.push(statement);
            list = statement.kind.block();
        }
        out
    }

    /// The component whose body is around a byte.
    #[must_use]
    pub fn scope_at(&self, file: FileId, offset: usize) -> Option<SymbolId> {
        let around = self.statements_around(file, offset);
        around.iter().rev().find_map(|statement| match &statement.kind {
            StatementKind::Component { name, .. } | StatementKind::Connector { name, .. } => self.symbols().find(None, true, &name.text),
            _ => None,
        })
    }

    /// Returns whether the text has a statement `model`; other files may be parts of models.
    #[must_use]
    pub fn is_model(&self) -> bool {
        let is_model = |s: &Statement| matches!(s.kind, StatementKind::Model { .. });
        self.files.first().is_some_and(|main| main.tree.statements.iter().any(is_model))
    }

    /// Returns whether the text is a library file, which declares components but not a model.
    #[must_use]
    pub fn is_library(&self) -> bool {
        let declares = |s: &Statement| matches!(s.kind, StatementKind::Component { .. } | StatementKind::Connector { .. });
        let Some(main) = self.files.first().filter(|_| !self.is_model()) else { return false };
        let mut statements = main.tree.statements.iter();
        statements.clone().any(declares) && !statements.any(|s| matches!(s.kind, StatementKind::Episode { .. }))
    }

    /// Symbols that can be named at a byte, those of the component first.
    #[must_use]
    pub fn visible(&self, file: FileId, offset: usize) -> Vec<SymbolId> {
        let scope = self.scope_at(file, offset);
        let own: Vec<SymbolId> = scope.iter().flat_map(|scope| self.symbols().members(Some(*scope))).map(|(id, _)| id).collect();
        let outer = self.symbols().members(None).map(|(id, _)| id);
        let hidden = |id: &SymbolId| scope.is_some_and(|s| self.symbols().find(Some(s), true, &self.symbol(*id).name).is_some());
        own.iter()
            .copied()
            .chain(outer.filter(|id| !hidden(id)))
            .filter(|id| !matches!(self.symbol(*id).kind, SymbolKind::Model | SymbolKind::Unit))
            .collect()
    }
}

/// Returns whether a file may import others, by a look at its text.
#[must_use]
pub fn imports(path: &Path, texts: &dyn Texts) -> bool {
    let text = texts.text(path);
    text.is_some_and(|text| {
        text.lines().any(|line| line.trim_start().strip_prefix("use").is_some_and(|rest| rest.trim_start().starts_with('"')))
    })
}

/// The name and text of an imported file.
pub(crate) fn loaded(main: &Path, written: &str, texts: &dyn Texts) -> Option<(String, String)> {
    let path = texts.import(main, written)?;
    let text = texts.text(&path)?;
    Some((path.display().to_string(), text.as_ref().to_owned()))
}
