//! From text to syntax tree: layout, then the grammar, statement by statement.
//!
//! A statement that cannot be parsed is reported once and left out; the others are not touched by
//! its fault. So all independent errors of a file come in one run.

mod control;
mod data;
mod declaration;
mod expression;
mod message;
mod parts;
mod problem;
mod reaction;
mod rules;
mod statement;
mod table;
mod test;
mod unit;

use std::thread;

use grammar::{Grammar, Rule};
use parts::{Children, Context};
use pest::Parser;

use crate::diagnostic::{Diagnostic, Faults, codes, did_you_mean};
use crate::layout::{RawStatement, has_block, layout};
use crate::span::{FileId, span};
use crate::stack::{SIZES, make_room};
use crate::syntax::{File, Statement, StatementKind, UnitExpr};
use crate::words::keywords;

/// Shorter texts are read sooner than a thread has started.
const WORTH_A_THREAD: usize = 8 * 1024;

/// The parser that pest makes of `grammar.pest`.
mod grammar {
    #![allow(missing_docs, reason = "generated")]
    /// The grammar of statements and expressions.
    #[derive(pest_derive::Parser)]
    #[grammar = "grammar.pest"]
    pub(super) struct Grammar;
}

/// Result of parsing one file: the statements that could be read, and all faults found.
#[derive(Clone, Debug, Default)]
pub struct Parsed {
    /// The syntax tree; invalid statements are left out.
    pub file: File,
    /// Faults in the order of the text.
    pub diagnostics: Faults,
}

impl Parsed {
    /// Returns `true` if nothing was invalid.
    #[must_use]
    pub fn is_ok(&self) -> bool {
        self.diagnostics.is_empty()
    }
}

/// Parses the text of one file. Never fails and never panics: what is wrong is in
/// [`Parsed::diagnostics`].
#[must_use]
pub fn parse(text: &str, file: FileId) -> Parsed {
    let layout = layout(text, file);
    let parse = |raw: &[RawStatement]| {
        let mut parser = StatementParser { text: &layout.text, file, around: "", diagnostics: Faults::default() };
        (parser.statements(raw), parser.diagnostics)
    };
    let middle = layout.statements.partition_point(|statement| statement.start < text.len() / 2);
    let (first, second) = layout.statements.split_at(if text.len() < WORTH_A_THREAD { 0 } else { middle });
    let ((mut statements, faults), rest) = thread::scope(|scope| {
        let help = || {
            make_room();
            parse(first)
        };
        let helper = (!first.is_empty()).then(|| thread::Builder::new().stack_size(SIZES[1]).spawn_scoped(scope, help).ok()).flatten();
        let rest = parse(second);
        // Without a second thread this one does it all.
        let first = helper.and_then(|helper| helper.join().ok()).unwrap_or_else(|| parse(first));
        (first, rest)
    });
    statements.extend(rest.0);
    let mut diagnostics = layout.diagnostics;
    diagnostics.append(faults);
    diagnostics.append(rest.1);
    diagnostics.sort();
    Parsed { file: File { statements }, diagnostics }
}

/// The unit that a text such as `kJ/(kg K)` is, whose first byte is at `offset` of a file; `None`
/// where it is not a unit.
#[must_use]
pub fn parse_unit(text: &str, file: FileId, offset: usize) -> Option<UnitExpr> {
    let bracketed = format!("[{text}]");
    let pair = Grammar::parse(Rule::unit_brackets, &bracketed).ok()?.next().filter(|pair| pair.as_str() == bracketed)?;
    let context = Context { file, offset: offset.checked_sub(1)?, keyword: "table" };
    unit::brackets(&context, pair).ok()
}

/// A fault ends its statement. Boxed, since it is rare and large.
type Fallible<T> = Result<T, Box<Diagnostic>>;

struct StatementParser<'t> {
    text: &'t str,
    file: FileId,
    /// Keyword of the statement in whose block the present ones are.
    around: &'t str,
    diagnostics: Faults,
}

impl<'t> StatementParser<'t> {
    fn statements(&mut self, raw: &[RawStatement]) -> Vec<Statement> {
        let mut statements = Vec::with_capacity(raw.len());
        for statement in raw {
            self.statement(statement, &mut statements);
        }
        statements
    }

    /// Reads one statement. Its block is read even where its head is invalid, for the faults
    /// within.
    fn statement(&mut self, raw: &RawStatement, into: &mut Vec<Statement>) {
        let text: &'t str = self.text;
        let around = std::mem::replace(&mut self.around, leading_word(&text[raw.start..raw.end]));
        let body = raw.body.as_ref().map(|body| self.statements(&body.statements));
        self.around = around;
        if raw.damaged {
            return;
        }
        let end = raw.body.as_ref().map_or(raw.end, |body| body.close);
        let span = span(self.file, raw.start, end);
        match self.kinds(raw, body) {
            Ok(kinds) => into.extend(kinds.into_iter().map(|kind| Statement { span, kind })),
            Err(fault) => self.diagnostics.push(*fault),
        }
    }

    fn kinds(&self, raw: &RawStatement, body: Option<Vec<Statement>>) -> Fallible<Vec<StatementKind>> {
        let text = &self.text[raw.start..raw.end];
        let keyword = leading_word(text);
        if self.around == "test" {
            return test::statement(self.file, raw, text, keyword);
        }
        let known = keywords().find(|known| *known == keyword);
        let Some(keyword) = known else { return Err(Box::new(self.unknown_statement(raw, keyword))) };
        if keyword == "expect" {
            let place = span(self.file, raw.start, raw.start + keyword.len());
            let fault = Diagnostic::error(codes::UNKNOWN_STATEMENT, "`expect` outside of a test", place);
            return Err(Box::new(fault.help("write it into `test \"name\" { ... }`")));
        }
        check_block(keyword, raw, self.file)?;
        let rest = text[keyword.len()..].trim_start();
        let context = Context { file: self.file, offset: raw.end - rest.len(), keyword };
        let pairs = Grammar::parse(statement::rule(keyword, rest), rest)
            .map_err(|error| Box::new(message::syntax_error(&error, rest, &context, raw.start)))?;
        statement::lower(&context, Children::of_statement(pairs), body.unwrap_or_default())
    }

    fn unknown_statement(&self, raw: &RawStatement, word: &str) -> Diagnostic {
        let text = &self.text[raw.start..raw.end];
        let end = raw.start + word.len().max(text.chars().next().map_or(0, char::len_utf8));
        let place = span(self.file, raw.start, end);
        let message =
            if word.is_empty() { "a statement begins with a keyword".to_owned() } else { format!("unknown statement keyword `{word}`") };
        Diagnostic::error(codes::UNKNOWN_STATEMENT, message, place)
            .label("expected a keyword such as `param`, `state`, `let` or `eq`")
            .maybe_help(message::statement_hint(word, text, self.around).or_else(|| did_you_mean(word, keywords())))
    }
}

/// Statements that must have a block, and where the brace is missing.
fn check_block(keyword: &str, raw: &RawStatement, file: FileId) -> Fallible<()> {
    if raw.body.is_some() || !has_block(keyword) || keyword == "phase" {
        return Ok(());
    }
    let place = span(file, raw.end, raw.end);
    let message = format!("`{keyword}` needs a block of statements");
    let fault = Diagnostic::error(codes::MISPLACED_BLOCK, message, place).label("expected `{` here");
    Err(Box::new(fault.help("write the statements between `{` and `}`")))
}

/// The name or keyword that a text begins with.
fn leading_word(text: &str) -> &str {
    let length = text.bytes().take_while(|b| b.is_ascii_alphanumeric() || *b == b'_').count();
    &text[..length]
}
