//! Edits that make a diagnostic disappear, from its help.
//!
//! Candidates are read off the help and the place of a diagnostic. Each is tried: the edited text
//! is checked, and a candidate is offered only if the diagnostic is gone and there are no more
//! errors than before.

use std::path::{Path, PathBuf};

use smpl_compiler::elaborate::notes::Observer;
use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;

use crate::check::check;
use crate::program::Program;
use crate::rename::{Changed, Edit};
use crate::texts::Texts;
use crate::token::{TokenKind, tokens};

/// An edit that is offered for a diagnostic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fix {
    /// Effect, for a menu.
    pub title: String,
    /// The edit.
    pub edit: Edit,
}

/// Most candidates that are tried for one diagnostic.
const MOST: usize = 12;

/// Edits after each of which the diagnostic is gone, the likeliest first.
#[must_use]
pub fn fixes(
    program: &Program,
    diagnostics: &[Diagnostic],
    diagnostic: &Diagnostic,
    texts: &(dyn Texts + Sync),
    observer: &Observer,
) -> Vec<Fix> {
    let mut out: Vec<Fix> = Vec::new();
    for fix in candidates(program, diagnostic).into_iter().take(MOST) {
        let is_new = !out.iter().any(|known| known.edit == fix.edit || known.title == fix.title);
        if is_new && helps(program, diagnostics, diagnostic, &fix, texts, observer) {
            out.push(fix);
        }
    }
    out
}

/// Returns whether a diagnostic is gone after an edit, and nothing else is worse.
fn helps(
    program: &Program,
    diagnostics: &[Diagnostic],
    diagnostic: &Diagnostic,
    fix: &Fix,
    texts: &(dyn Texts + Sync),
    observer: &Observer,
) -> bool {
    let changed = Changed::by(texts, std::slice::from_ref(&fix.edit));
    let Some(main) = program.files.first() else { return false };
    let Some(after) = Program::new(&main.path, &changed) else { return false };
    let Some(checked) = check(&after, &changed, &observer.apart(), &|_| Vec::new()) else { return false };
    let errors = |list: &[Diagnostic]| list.iter().filter(|d| d.is_error()).count();
    let syntax = |list: &[Diagnostic]| list.iter().filter(|d| d.code.id().starts_with("E01")).count();
    let same = |list: &[Diagnostic]| list.iter().filter(|d| d.code == diagnostic.code && d.message == diagnostic.message).count();
    let found = &checked.diagnostics;
    same(found) < same(diagnostics) && errors(found) <= errors(diagnostics) && syntax(found) <= syntax(diagnostics)
}

/// Everything that may help.
fn candidates(program: &Program, d: &Diagnostic) -> Vec<Fix> {
    let Some(file) = program.file(d.primary.span.file) else { return Vec::new() };
    let mut maker = Maker { program, path: file.path.clone(), text: &file.text, place: d.primary.span, list: Vec::new() };
    maker.add_for_help(d);
    maker.add_for_code(d);
    maker.list
}

struct Maker<'p> {
    program: &'p Program,
    path: PathBuf,
    text: &'p str,
    place: Span,
    list: Vec<Fix>,
}

impl Maker<'_> {
    fn push(&mut self, title: String, start: usize, end: usize, text: String) {
        let edit = Edit { path: self.path.clone(), start, end, text };
        self.list.push(Fix { title, edit });
    }

    fn start(&self) -> usize {
        self.place.start as usize
    }

    fn end(&self) -> usize {
        self.place.end as usize
    }

    fn written(&self) -> &str {
        self.text.get(self.start()..self.end()).unwrap_or_default()
    }

    /// Texts in back-ticks of the help, instead of the marked text, or where they belong.
    fn add_for_help(&mut self, d: &Diagnostic) {
        let help = d.help.clone().unwrap_or_default();
        if help.starts_with("remove it") || help.starts_with("use it, or take it away") || help.starts_with("keep one of the two") {
            self.remove();
        }
        for code in help.split('`').skip(1).step_by(2) {
            self.add_for_code_of_help(code, &help);
        }
    }

    fn add_for_code_of_help(&mut self, code: &str, help: &str) {
        let (start, end) = (self.start(), self.end());
        if let Some(clause) = code.strip_prefix("for ") {
            return self.append_for(clause);
        }
        if let Some(left) = code.strip_suffix("= ...") {
            return self.add_statement(&format!("{left}= 0"));
        }
        if help.starts_with("decimals follow a point") {
            return self.point_for_comma();
        }
        if help.starts_with("add `") {
            let (at, line_end) = (self.end_of_statement(), self.end_of_line(start));
            [at, line_end].into_iter().for_each(|at| self.push(format!("Add `{code}`"), at, at, code.to_owned()));
            let lead = if code.starts_with(|c: char| c.is_ascii_alphanumeric()) { " " } else { "" };
            return self.push(format!("Add `{code}`"), end, end, format!("{lead}{code}"));
        }
        if let Some(value) = code.strip_prefix("= ") {
            let value = if value == "value" || value == "expression" { "0" } else { value };
            let at = self.end_of_declaration();
            return self.push(format!("Add `= {value}`"), at, at, format!(" = {value}"));
        }
        if code.starts_with("in low..high") {
            let at = self.end_of_declaration();
            return self.push("Add bounds".into(), at, at, " in 0..1".into());
        }
        if code.starts_with("episode {") {
            let (at, lead) = (self.text.len(), if self.text.ends_with('\n') { "\n" } else { "\n\n" });
            return self.push("Add an `episode` block".into(), at, at, format!("{lead}{code}\n"));
        }
        if code == "*" {
            self.insert_times();
        }
        if code == "state" {
            self.change_keyword(code);
        }
        if let Some(function) = code.strip_suffix("(T)") {
            self.wrap(function);
        }
        if ["did you mean `", "write `", "give the number its unit"].iter().any(|begin| help.starts_with(begin)) {
            self.push(format!("Replace by `{code}`"), start, end, code.to_owned());
        }
    }

    /// Writes a statement on a new line after the one at the place.
    fn add_statement(&mut self, statement: &str) {
        let at = self.end_of_statement();
        let next = self.text[at..].find('\n').map_or(self.text.len(), |end| at + end + 1);
        let line = self.text[..self.start()].rfind('\n').map_or(0, |at| at + 1);
        let indent: String = self.text[line..].chars().take_while(|c| *c == ' ').collect();
        self.push(format!("Add `{statement}`"), next, next, format!("{indent}{statement}\n"));
    }

    /// Replaces the comma before the place by a point.
    fn point_for_comma(&mut self) {
        let before = self.text[..self.start()].trim_end();
        if before.ends_with(',') {
            let (at, end) = (before.len() - 1, self.start());
            self.push("Write the decimal point".into(), at, end, ".".into());
        }
    }

    fn add_for_code(&mut self, d: &Diagnostic) {
        if d.code == codes::UNKNOWN_NAME {
            self.declare();
        }
        if d.code == codes::AFFINE_UNIT {
            self.wrap("kelvin");
        }
        if d.code == codes::UNIT_MISMATCH || d.code == codes::NOT_DIMENSIONLESS {
            self.add_units(d);
        }
        if d.code == codes::UNCLOSED_TEXT {
            let at = self.end_of_line(self.start());
            self.push("Add the closing quote".into(), at, at, "\"".into());
        }
        if d.code == codes::UNEXPECTED_CHARACTER {
            let instead = match self.written() {
                "×" | "·" | "⋅" => "*",
                "²" => "^2",
                "³" => "^3",
                "−" | "–" | "—" => "-",
                "\u{a0}" | "\u{202f}" | "\u{2009}" => " ",
                "“" | "”" | "„" => "\"",
                _ => return,
            };
            let (start, end) = (self.start(), self.end());
            self.push(format!("Replace by `{instead}`"), start, end, instead.into());
        }
    }

    fn remove(&mut self) {
        let (start, end) = (self.start(), self.end());
        let line = self.text[..start].rfind('\n').map_or(0, |at| at + 1);
        let next = self.text[end..].find('\n').map_or(self.text.len(), |at| end + at + 1);
        self.push("Remove it".into(), start, end, String::new());
        self.push("Remove the line".into(), line, next, String::new());
    }

    /// Declares an unknown name before the statement: as a parameter, as an algebraic variable.
    fn declare(&mut self) {
        let name = self.written().to_owned();
        if name.is_empty() || !name.chars().all(crate::token::is_word) {
            return;
        }
        let around = self.program.statements_around(self.place.file, self.start());
        let at = around.last().map_or(self.start(), |statement| statement.span.start as usize);
        let line = self.text[..at].rfind('\n').map_or(0, |at| at + 1);
        let indent: String = self.text[line..].chars().take_while(|c| *c == ' ').collect();
        self.push(format!("Declare `{name}` as a parameter"), line, line, format!("{indent}param {name} = 1\n"));
        self.push(format!("Declare `{name}` as a variable"), line, line, format!("{indent}var {name}\n"));
    }

    /// Gives bare numbers of the marked text the unit that a label or the help names.
    fn add_units(&mut self, d: &Diagnostic) {
        let labels = d.secondary.iter().chain([&d.primary]).map(|label| label.text.as_str());
        let texts = labels.chain([d.message.as_str()]).chain(d.help.as_deref());
        let units: Vec<String> = texts.flat_map(bracketed).collect();
        let numbers: Vec<usize> = tokens(self.written())
            .into_iter()
            .filter(|token| token.kind == TokenKind::Number)
            .map(|token| self.start() + token.range.end)
            .filter(|&end| !self.text[end..].trim_start().starts_with('['))
            .collect();
        for end in numbers {
            for unit in &units {
                self.push(format!("Add the unit [{unit}]"), end, end, format!(" [{unit}]"));
            }
        }
    }

    fn wrap(&mut self, function: &str) {
        let (start, end) = (self.start(), self.end());
        let text = format!("{function}({})", self.written());
        self.push(format!("Wrap in `{function}(..)`"), start, end, text);
    }

    /// Puts `*` between a name and the bracket behind it.
    fn insert_times(&mut self) {
        let place = self.written();
        if let Some(at) = place.find(['(', '[']) {
            let at = self.start() + at;
            self.push("Multiply with `*`".into(), at, at, "*".into());
        }
        let end = self.end();
        self.push("Multiply with `*`".into(), end, end, "*".into());
    }

    /// Changes the keyword of the declaration that the marked name refers to.
    fn change_keyword(&mut self, keyword: &str) {
        let place = self.place;
        let inside = self.program.occurrences().iter().filter(|o| place.contains(o.span));
        let names: Vec<Span> = inside.map(|o| self.program.symbol(o.symbol).span()).collect();
        for name in names.into_iter().filter(|name| name.file == place.file) {
            let Some(statement) = self.program.statement_at(name.file, name.start as usize) else { continue };
            let start = statement.span.start as usize;
            let length = self.text[start..].find(' ').unwrap_or(0);
            self.push(format!("Declare it with `{keyword}`"), start, start + length, keyword.to_owned());
        }
    }

    fn append_for(&mut self, clause: &str) {
        let at = self.end_of_statement();
        let line = self.text[..at].rfind('\n').map_or(0, |at| at + 1);
        let text = if self.text[line..at].contains(" for ") { format!(", {clause}") } else { format!(" for {clause}") };
        self.push(format!("Add `for {clause}`"), at, at, text);
    }

    /// The end of the statement around the place, else of its line without a comment.
    fn end_of_statement(&self) -> usize {
        match self.program.statement_at(self.place.file, self.start()) {
            Some(statement) => statement.span.end as usize,
            None => self.end_of_line(self.start()),
        }
    }

    /// The end of the marked declaration, before its describing text.
    fn end_of_declaration(&self) -> usize {
        let end = self.end_of_statement();
        let text = &self.text[self.start().min(end)..end];
        let length = text.find('"').unwrap_or(text.len());
        self.start().min(end) + text[..length].trim_end().len()
    }

    fn end_of_line(&self, at: usize) -> usize {
        let line = &self.text[at..];
        let line = &line[..line.find(['\n', '\r']).unwrap_or(line.len())];
        let comment = tokens(line).into_iter().find(|token| token.kind == TokenKind::Comment).map_or(line.len(), |t| t.range.start);
        at + line[..comment].trim_end().len()
    }
}

/// Units in square brackets of a text.
fn bracketed(text: &str) -> Vec<String> {
    text.split('[').skip(1).filter_map(|rest| rest.split_once(']')).map(|(unit, _)| unit.to_owned()).collect()
}

/// The file of a diagnostic.
#[must_use]
pub fn file_of<'p>(program: &'p Program, d: &Diagnostic) -> Option<&'p Path> {
    program.file(d.primary.span.file).map(|file| file.path.as_path())
}
