//! The canonical layout of a model's text.
//!
//! Statements are on their own lines, indented by two blanks a block; blank lines separate groups,
//! one at a time. Consecutive declarations of one role are aligned in columns, as are the two sides
//! of consecutive equations. Cells of a table are aligned by their starts, or by their ends or
//! decimal points if the author has done so. Heads of columns and rows with units are aligned if
//! the author has aligned them. Comments stay where they are. A long statement keeps its author's
//! line breaks, with the indentation put right. `*`, `/`, `+` and `-` keep their author's choice of
//! blanks on both sides or on none, since `2*U/(r*rho) * (T_c - T)` says something that neither
//! form alone does.
//!
//! Only blanks and line ends between tokens change (and `;` between statements), so that the
//! meaning cannot.

mod columns;
mod render;
mod tokens;

use std::ops::Range;

use crate::diagnostic::Diagnostic;
use crate::layout::{Layout, RawBody, RawStatement, layout};
use crate::parse::parse;
use crate::span::FileId;
use crate::stack::on_own_stack;

use columns::{Line, Row, align};
use tokens::{Token, tokens};

/// Blanks a block.
const INDENT: usize = 2;
/// Blanks before a comment or a text that follows something on its line.
const GAP: usize = 4;
/// One-line blocks that would be longer are broken.
const WIDTH: usize = 140;

/// Formats a text.
///
/// # Errors
/// The syntax errors of a text that cannot be parsed.
pub fn format(text: &str) -> Result<String, Vec<Diagnostic>> {
    on_own_stack(|| formatted(text))
}

fn formatted(text: &str) -> Result<String, Vec<Diagnostic>> {
    let parsed = parse(text, FileId(0));
    if !parsed.is_ok() {
        return Err(parsed.diagnostics.shown());
    }
    let layout = layout(text, FileId(0));
    let formatter = Formatter { text, layout: &layout };
    let lines = formatter.block(&layout.statements, 0..text.len(), 0);
    Ok(lines.into_iter().map(|line| line.trim_end().to_owned() + "\n").collect())
}

struct Formatter<'t> {
    text: &'t str,
    layout: &'t Layout,
}

impl Formatter<'_> {
    /// The lines of the statements in a range of the text, with the comments and blank lines
    /// between them.
    fn block(&self, statements: &[RawStatement], range: Range<usize>, indent: usize) -> Vec<String> {
        let mut rows: Vec<Row> = Vec::new();
        let mut at = range.start;
        for (index, statement) in statements.iter().enumerate() {
            self.between(at..statement.start, indent, &mut rows);
            rows.push(self.statement(statements, index, indent));
            at = end_of(statement);
        }
        self.between(at..range.end, indent, &mut rows);
        while matches!(rows.last(), Some(Row::Blank)) {
            rows.pop();
        }
        align(rows)
    }

    /// Comments and blank lines between two statements. A comment on the line of the statement
    /// before belongs to that statement.
    fn between(&self, gap: Range<usize>, indent: usize, rows: &mut Vec<Row>) {
        let mut at = gap.start;
        for comment in self.comments(&gap) {
            let lines = self.text[at..comment.start].matches('\n').count();
            let text = &self.text[comment.clone()];
            match rows.last_mut() {
                Some(Row::Line(line)) if lines == 0 => line.comment(text),
                _ => {
                    blank(rows, lines);
                    rows.push(Row::Plain(vec![format!("{:indent$}{text}", "")]));
                }
            }
            at = comment.end;
        }
        blank(rows, self.text[at..gap.end].matches('\n').count());
    }

    fn comments(&self, range: &Range<usize>) -> Vec<Range<usize>> {
        let first = self.layout.comments.partition_point(|comment| comment.start < range.start);
        self.layout.comments[first..].iter().take_while(|comment| comment.start < range.end).cloned().collect()
    }

    fn statement(&self, siblings: &[RawStatement], index: usize, indent: usize) -> Row {
        let raw = &siblings[index];
        let tokens = tokens(self.text, raw.start..raw.end, &self.comments(&(raw.start..raw.end)));
        let padding = self.keyword_padding(siblings, index);
        match &raw.body {
            None => Row::Line(columns::line(&tokens, &self.text[raw.start..raw.end], indent, padding)),
            Some(body) => self.block_statement(&tokens, body, indent, padding),
        }
    }

    fn block_statement(&self, head: &[Token<'_>], body: &RawBody, indent: usize, padding: usize) -> Row {
        let inner = body.open + 1..body.close - 1;
        if let Some(line) = self.one_line(head, body, indent, padding) {
            return Row::Line(line);
        }
        let mut lines = render::lines(head, indent, padding);
        if let Some(last) = lines.last_mut() {
            last.push_str(" {");
        }
        // A comment behind the opening brace would be read as the brace's own line.
        lines.extend(self.block(&body.statements, inner, indent + INDENT));
        lines.push(format!("{:indent$}}}", ""));
        Row::Line(Line::plain(lines))
    }

    /// `at start { next x = 1; next y = 2 }`, where it was on one line.
    fn one_line(&self, head: &[Token<'_>], body: &RawBody, indent: usize, padding: usize) -> Option<Line> {
        if self.text[body.open..body.close].contains('\n') || !self.comments(&(body.open..body.close)).is_empty() {
            return None;
        }
        let parts = body.statements.iter().enumerate().map(|(index, _)| match self.statement(&body.statements, index, 0) {
            Row::Line(line) => line.single(),
            _ => None,
        });
        let parts: Vec<String> = parts.collect::<Option<_>>()?;
        let inner = if parts.is_empty() { "{ }".to_owned() } else { format!("{{ {} }}", parts.join("; ")) };
        let mut heads = render::lines(head, indent, padding);
        let head = heads.pop().filter(|_| heads.is_empty())?;
        (head.len() + inner.len() < WIDTH).then(|| Line::block(head, inner))
    }

    /// Blanks between the keyword and what follows: one, unless the author has aligned the line
    /// with the one before or after it.
    fn keyword_padding(&self, siblings: &[RawStatement], index: usize) -> usize {
        let Some((keyword, offset)) = self.second_token(&siblings[index]) else { return 1 };
        let neighbours =
            [index.checked_sub(1), Some(index + 1)].into_iter().flatten().filter_map(|other| siblings.get(other).map(|raw| (other, raw)));
        let adjacent = neighbours.filter(|(other, _)| {
            let (first, second) = (&siblings[index.min(*other)], &siblings[index.max(*other)]);
            self.text[end_of(first)..second.start].matches('\n').count() == 1
        });
        let aligned = adjacent.filter_map(|(_, raw)| self.second_token(raw)).any(|(_, other)| other == offset);
        if aligned { offset - keyword } else { 1 }
    }

    /// Length of the keyword and offset of what follows it, both from the start of the statement.
    fn second_token(&self, raw: &RawStatement) -> Option<(usize, usize)> {
        let text = &self.text[raw.start..end_of(raw)];
        let keyword = text.find(|c: char| !c.is_ascii_alphanumeric() && c != '_')?;
        let rest = &text[keyword..];
        let blanks = rest.len() - rest.trim_start_matches(' ').len();
        (blanks > 0 && blanks < 12).then_some((keyword, keyword + blanks))
    }
}

/// A blank line, if there was one and something is before it.
fn blank(rows: &mut Vec<Row>, newlines: usize) {
    if newlines > 1 && !rows.is_empty() && !matches!(rows.last(), Some(Row::Blank)) {
        rows.push(Row::Blank);
    }
}

fn end_of(raw: &RawStatement) -> usize {
    raw.body.as_ref().map_or(raw.end, |body| body.close)
}
