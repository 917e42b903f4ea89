//! Alignment of consecutive lines in columns.

mod table;

use super::tokens::{Token, TokenKind};
use super::{GAP, render};
use crate::words::keywords;

/// Wider cells do not widen their column.
const WIDEST: usize = 72;
/// Lines whose names differ more in length are not aligned.
const SPREAD: usize = 12;

/// Content between two line ends.
pub(super) enum Row {
    /// An empty line.
    Blank,
    /// Lines that are final.
    Plain(Vec<String>),
    /// A statement.
    Line(Line),
}

/// A statement, in cells if it is a single line that may be aligned with its neighbours.
pub(super) struct Line {
    /// Lines with the same key are aligned.
    key: Option<String>,
    cells: Vec<Cell>,
    lines: Vec<String>,
    comment: Option<String>,
}

/// A part of a line that starts in its own column.
struct Cell {
    slot: usize,
    text: String,
    /// Blanks before it where it is alone, and in a group.
    gaps: (usize, usize),
}

impl Line {
    /// Lines that are aligned with nothing.
    pub(super) fn plain(lines: Vec<String>) -> Self {
        Self { key: None, cells: Vec::new(), lines, comment: None }
    }

    /// A block on one line: head and braces.
    pub(super) fn block(head: String, inner: String) -> Self {
        let key = head.split_whitespace().next().map(str::to_owned);
        let cells = vec![Cell { slot: 0, text: head, gaps: (0, 0) }, Cell { slot: 1, text: inner, gaps: (1, 1) }];
        Self { key, cells, lines: Vec::new(), comment: None }
    }

    /// Adds a comment behind the statement.
    pub(super) fn comment(&mut self, text: &str) {
        self.comment = Some(match self.comment.take() {
            Some(first) => format!("{first} {text}"),
            None => text.to_owned(),
        });
    }

    /// The statement on one line, if it is one.
    pub(super) fn single(&self) -> Option<String> {
        match self.lines.as_slice() {
            [] => Some(self.padded(&[], false).trim_start().to_owned()),
            [line] => Some(line.trim_start().to_owned()),
            _ => None,
        }
    }

    /// The cells with blanks that put them in their columns.
    fn padded(&self, widths: &[(usize, usize)], group: bool) -> String {
        let mut text = String::new();
        let mut column = 0;
        let mut next_slot = 0;
        for cell in &self.cells {
            for (gap, width) in widths.iter().take(cell.slot).skip(next_slot) {
                column += gap + width;
            }
            let own = if group { cell.gaps.1 } else { cell.gaps.0 };
            let gap = widths.get(cell.slot).map_or(own, |(gap, _)| *gap);
            let length = text.chars().count();
            let start = if text.is_empty() { 0 } else { (column + gap).max(length + own) };
            text.push_str(&" ".repeat(start.saturating_sub(length)));
            text.push_str(&cell.text);
            column += gap + widths.get(cell.slot).map_or(0, |(_, width)| *width);
            next_slot = cell.slot + 1;
        }
        text
    }

    fn finish(mut self, widths: &[(usize, usize)], group: bool) -> Vec<String> {
        if self.lines.is_empty() {
            self.lines.push(self.padded(widths, group));
        }
        if let (Some(comment), Some(last)) = (self.comment, self.lines.last_mut()) {
            last.push_str(&format!("{:GAP$}{comment}", ""));
        }
        self.lines
    }
}

/// The final lines: runs of lines with one key are aligned.
pub(super) fn align(rows: Vec<Row>) -> Vec<String> {
    let mut lines = Vec::new();
    let mut group: Vec<Line> = Vec::new();
    for row in rows {
        match row {
            Row::Line(line) => {
                if !joins(&group, &line) {
                    flush(&mut group, &mut lines);
                }
                group.push(line);
            }
            Row::Plain(plain) => {
                flush(&mut group, &mut lines);
                lines.extend(plain);
            }
            Row::Blank => {
                flush(&mut group, &mut lines);
                lines.push(String::new());
            }
        }
    }
    flush(&mut group, &mut lines);
    lines
}

/// Returns `true` if a line is aligned with the group before it.
fn joins(group: &[Line], line: &Line) -> bool {
    let Some(last) = group.last() else { return true };
    let lengths = || group.iter().chain([line]).filter_map(|line| line.cells.first()).map(|cell| cell.text.chars().count());
    let spread = lengths().max().unwrap_or(0) - lengths().min().unwrap_or(0);
    last.key.is_some() && last.key == line.key && spread <= SPREAD
}

fn flush(group: &mut Vec<Line>, lines: &mut Vec<String>) {
    let many = group.len() > 1;
    let slots = group.iter().flat_map(|line| &line.cells).map(|cell| cell.slot + 1).max().unwrap_or(0);
    let mut widths = vec![(0, 0); slots];
    for line in group.iter() {
        for (index, cell) in line.cells.iter().enumerate() {
            let (gap, width) = &mut widths[cell.slot];
            *gap = if many { cell.gaps.1 } else { cell.gaps.0 };
            let length = cell.text.chars().count();
            if length <= WIDEST && index + 1 < line.cells.len() {
                *width = (*width).max(length);
            }
        }
    }
    if !many {
        widths.clear();
    }
    lines.extend(group.drain(..).flat_map(|line| line.finish(&widths, many)));
}

/// A statement without block as a line: in cells where its kind is aligned and it is on one line.
/// `source` is its text unchanged.
pub(super) fn line(tokens: &[Token<'_>], source: &str, indent: usize, padding: usize) -> Line {
    let keyword = tokens.first().map_or("", |token| token.text);
    let broken = tokens.iter().skip(1).any(|token| token.newline_before || token.kind == TokenKind::Comment);
    if broken && keyword == "table" {
        return Line::plain(table::aligned(render::lines(tokens, indent, padding), source));
    }
    if broken || keyword == "table" {
        return Line::plain(render::lines(tokens, indent, padding));
    }
    if keyword == "expect" || !keywords().any(|known| known == keyword) {
        // What a test sets and runs begins with its own name.
        return Line::plain(vec![format!("{:indent$}{}", "", render::inline(tokens))]);
    }
    let cells = cells(keyword, tokens);
    let head = |text: String| format!("{:indent$}{keyword}{:padding$}{}", "", "", text.strip_prefix(keyword).unwrap_or(&text).trim_start());
    let key = match keyword {
        "model" | "use" | "connect" | "fail" | "success" | "constraint" | "event" | "observe" => None,
        _ => Some(format!("{keyword} {}", cells.last().map_or(0, |cell| cell.slot / SLOTS))),
    };
    let mut cells = cells;
    match cells.first_mut() {
        Some(first) if tokens.len() > 1 => first.text = head(std::mem::take(&mut first.text)),
        Some(first) => first.text = format!("{:indent$}{keyword}", ""),
        None => {}
    }
    Line { key, cells, lines: Vec::new(), comment: None }
}

/// Columns of one declaration: name, unit, value, sample, bounds, scale, nonnegative and prefer,
/// text.
const SLOTS: usize = 8;
const TEXT: usize = 7;

/// Splits the tokens of a statement where a column begins.
fn cells(keyword: &str, tokens: &[Token<'_>]) -> Vec<Cell> {
    let mut cells: Vec<Cell> = Vec::new();
    let mut start = 0;
    let mut slot = 0;
    let mut depth = 0_usize;
    let mut colons = 0;
    let clause = if matches!(keyword, "eq" | "initial" | "next" | "reset") { clause(tokens) } else { None };
    for (index, token) in tokens.iter().enumerate() {
        match token.text {
            "(" | "[" | "{" if token.kind == TokenKind::Symbol => depth += 1,
            ")" | "]" | "}" if token.kind == TokenKind::Symbol => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > 0 || index == 0 {
            continue;
        }
        let declaration = slot - slot % SLOTS;
        let after_comma = is_declaration(keyword) && tokens[index - 1].text == ",";
        let column = match tokens[index - 1].text {
            _ if after_comma => Some(SLOTS),
            // The pattern of names is part of the name.
            "named" => None,
            _ if clause == Some(index) => Some(TEXT),
            // A name may be the word of a clause.
            _ if index == 1 && is_declaration(keyword) => None,
            _ => column(keyword, token, colons).filter(|column| !matches!(column, 4..TEXT) || ends_operand(&tokens[index - 1])),
        };
        let Some(column) = column.filter(|column| declaration + column > slot) else { continue };
        cells.push(cell(slot, &tokens[start..index]));
        colons = if after_comma { 0 } else { colons + usize::from(token.text == ":") };
        (start, slot) = (index, declaration + column);
    }
    cells.push(cell(slot, &tokens[start..]));
    cells
}

fn cell(slot: usize, tokens: &[Token<'_>]) -> Cell {
    let gaps = match slot % SLOTS {
        0 if slot > 0 => (1, 2),
        0 => (0, 0),
        6 if tokens.first().is_some_and(|token| token.text == "rate") => (GAP, GAP),
        4..TEXT => (1, 2),
        TEXT => (GAP, GAP),
        _ => (1, 1),
    };
    Cell { slot, text: render::inline(tokens), gaps }
}

/// Returns `true` if something that a clause may follow ends here: behind an operator its word is a
/// name.
fn ends_operand(token: &Token<'_>) -> bool {
    matches!(token.kind, TokenKind::Word | TokenKind::Number | TokenKind::Text) || matches!(token.text, ")" | "]" | "}")
}

/// Start of the clause `for` of the whole statement.
fn clause(tokens: &[Token<'_>]) -> Option<usize> {
    let mut depth = 0_usize;
    tokens.iter().position(|token| {
        match (token.kind, token.text) {
            (TokenKind::Symbol, "(" | "[" | "{") => depth += 1,
            (TokenKind::Symbol, ")" | "]" | "}") => depth = depth.saturating_sub(1),
            _ => {}
        }
        depth == 0 && token.kind == TokenKind::Word && token.text == "for"
    })
}

/// The column that a token begins, by the kind of statement.
fn column(keyword: &str, token: &Token<'_>, colons: usize) -> Option<usize> {
    let text = token.text;
    if token.kind == TokenKind::Text {
        let heading = matches!(keyword, "model" | "use" | "component" | "variant" | "level" | "policy" | "table" | "test");
        return (!heading).then_some(TEXT);
    }
    match keyword {
        _ if is_declaration(keyword) => match text {
            ":" if colons == 0 => Some(1),
            "=" => Some(2),
            "~" => Some(3),
            "in" => Some(4),
            "scale" => Some(5),
            "nonnegative" | "prefer" => Some(6),
            _ => None,
        },
        "reaction" if text == "rate" => Some(6),
        "eq" | "initial" | "next" | "reset" | "reward" | "invariant" | "choice" if matches!(text, "=" | "~") => Some(2),
        _ => None,
    }
}

fn is_declaration(keyword: &str) -> bool {
    matches!(keyword, "param" | "action" | "state" | "var" | "let" | "discrete" | "disturbance" | "random")
}
