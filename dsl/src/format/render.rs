//! Lines of one statement: blanks between tokens, the author's line breaks, indentation.

use super::tokens::{Token, TokenKind, spaced};
use super::{GAP, INDENT};

/// An open bracket.
struct Open {
    bracket: u8,
    /// Column behind the bracket.
    content: usize,
    /// Indentation of the line on which it is.
    indent: usize,
    /// True if the line ends right behind it.
    hanging: bool,
    /// Braces of values by member, `= { A: 1 }`.
    labels: bool,
}

struct Writer {
    lines: Vec<String>,
    indent: usize,
    line_indent: usize,
    open: Vec<Open>,
    /// Column behind the first `=` of the statement or entry, outside all brackets but braces.
    assigned: Option<usize>,
    padding: usize,
    table: bool,
    reaction: bool,
    /// Braces with entries that are on several lines.
    entries: bool,
}

/// The lines of a statement, the first one indented too; `padding` blanks follow the keyword.
pub(super) fn lines(tokens: &[Token<'_>], indent: usize, padding: usize) -> Vec<String> {
    let mut writer = Writer {
        lines: vec![" ".repeat(indent)],
        indent,
        line_indent: indent,
        open: Vec::new(),
        assigned: None,
        padding,
        table: tokens.first().is_some_and(|token| token.text == "table"),
        reaction: is_reaction(tokens),
        entries: has_entries_on_lines(tokens),
    };
    for (index, token) in tokens.iter().enumerate() {
        let previous = index.checked_sub(1).map(|before| &tokens[before]);
        writer.write(previous, token, tokens.get(index + 1), index == 1);
    }
    writer.lines
}

/// Returns `true` if a statement has entries in braces, and they are on several lines.
fn has_entries_on_lines(tokens: &[Token<'_>]) -> bool {
    let keyword = tokens.first().map_or("", |token| token.text);
    let inside = tokens.iter().skip_while(|token| token.text != "{");
    matches!(keyword, "policy" | "steady" | "episode" | "solver") && inside.skip(1).any(|token| token.newline_before)
}

/// The text of tokens on one line.
pub(super) fn inline(tokens: &[Token<'_>]) -> String {
    let mut text = String::new();
    let reaction = is_reaction(tokens);
    let mut open: Vec<bool> = Vec::new();
    for (index, token) in tokens.iter().enumerate() {
        let labels = open.last().copied().unwrap_or(reaction);
        if index > 0 && spaced(&tokens[index - 1], token, labels) {
            text.push(' ');
        }
        text.push_str(token.text);
        match (token.kind, token.text) {
            (TokenKind::Symbol, "(" | "[") => open.push(false),
            (TokenKind::Symbol, "{") => open.push(index > 0 && tokens[index - 1].text == "="),
            (TokenKind::Symbol, ")" | "]" | "}") => {
                open.pop();
            }
            _ => {}
        }
    }
    text
}

/// Returns `true` for a reaction, whose name is a label.
fn is_reaction(tokens: &[Token<'_>]) -> bool {
    tokens.first().is_some_and(|token| token.text == "reaction")
}

impl Writer {
    fn write(&mut self, previous: Option<&Token<'_>>, token: &Token<'_>, next: Option<&Token<'_>>, second: bool) {
        let after_comment = previous.is_some_and(|previous| previous.kind == TokenKind::Comment);
        if let Some(previous) = previous {
            if token.newline_before || after_comment || self.opens_up(previous, token) {
                self.break_line(previous, token);
            } else {
                self.push_gap(previous, token, second);
            }
        }
        self.track(token, next);
        self.push(token.text);
        if matches!(token.text, "(" | "[" | "{") && token.kind == TokenKind::Symbol {
            let hanging = next.is_some_and(|next| next.newline_before || next.kind == TokenKind::Comment);
            let bracket = token.text.as_bytes().first().copied().unwrap_or(b'(');
            let labels = token.text == "{" && previous.is_some_and(|previous| previous.text == "=");
            self.open.push(Open { bracket, content: self.column(), indent: self.line_indent, hanging, labels });
        }
    }

    /// Returns `true` if a token begins the describing text or the clause `for` of the whole
    /// statement, behind its continued lines.
    fn ends_statement(&self, previous: &Token<'_>, token: &Token<'_>) -> bool {
        self.open.is_empty()
            && (token.kind == TokenKind::Text && previous.text != "named" || token.kind == TokenKind::Word && token.text == "for")
    }

    /// Returns `true` if a line ends inside the braces of entries that are on several lines: behind
    /// `{` and before `}`.
    fn opens_up(&self, previous: &Token<'_>, token: &Token<'_>) -> bool {
        let symbol = |token: &Token<'_>, text| token.kind == TokenKind::Symbol && token.text == text;
        self.entries
            && token.kind != TokenKind::Comment
            && self.open.len() == 1
            && self.in_braces()
            && symbol(previous, "{") != symbol(token, "}")
    }

    fn push_gap(&mut self, previous: &Token<'_>, token: &Token<'_>, second: bool) {
        let blanks = match token.kind {
            TokenKind::Comment => GAP,
            _ if self.lines.len() > 1 && self.ends_statement(previous, token) => GAP,
            _ if self.reaction && self.open.is_empty() && token.text == "rate" => GAP,
            _ if second && previous.kind == TokenKind::Word => self.padding,
            _ => usize::from(spaced(previous, token, self.is_label())),
        };
        self.push(&" ".repeat(blanks));
    }

    /// Closing brackets and separators end what has been tracked.
    fn track(&mut self, token: &Token<'_>, next: Option<&Token<'_>>) {
        if token.kind != TokenKind::Symbol {
            return;
        }
        match token.text {
            ")" | "]" | "}" => {
                self.open.pop();
            }
            "=" | "~" if self.assigned.is_none() && self.outside_parentheses() => {
                let wide = next.is_none_or(|next| next.newline_before);
                self.assigned = (!wide).then_some(self.column() + 2);
            }
            ":" if self.assigned.is_none() && self.in_braces() => {
                let wide = next.is_none_or(|next| next.newline_before);
                self.assigned = (!wide).then_some(self.column() + 2);
            }
            "," if self.in_braces() => self.assigned = None,
            "{" => self.assigned = None,
            _ => {}
        }
    }

    fn break_line(&mut self, previous: &Token<'_>, token: &Token<'_>) {
        let column = self.break_column(previous, token);
        if let Some(line) = self.lines.last_mut() {
            line.truncate(line.trim_end().len());
        }
        self.lines.push(" ".repeat(column));
        self.line_indent = column;
    }

    fn break_column(&mut self, previous: &Token<'_>, token: &Token<'_>) -> usize {
        let Some(open) = self.open.last() else { return self.continuation(self.indent, token) };
        let closing = matches!(token.text, ")" | "]" | "}") && token.kind == TokenKind::Symbol;
        match (open.bracket, closing) {
            (_, true) if open.hanging || open.bracket == b'{' => open.indent,
            (b'{', _) => self.entry_column(open.indent + INDENT, previous, token),
            _ if open.hanging => open.indent + INDENT,
            _ => open.content,
        }
    }

    /// A new entry of a block, or the continuation of one.
    fn entry_column(&mut self, indent: usize, previous: &Token<'_>, token: &Token<'_>) -> usize {
        let unfinished = previous.kind == TokenKind::Symbol && !matches!(previous.text, "," | "{" | ")" | "]" | "}")
            || matches!(previous.kind, TokenKind::Operator(_) | TokenKind::Sign)
            || matches!(previous.text, "then" | "else" | "and" | "or");
        let continued = matches!(token.text, "then" | "else" | "and" | "or" | "for")
            || matches!(token.kind, TokenKind::Operator(_) | TokenKind::Text)
            || token.kind == TokenKind::Symbol && !matches!(token.text, "(" | "[" | "{");
        if (unfinished || continued) && token.kind != TokenKind::Comment {
            return self.continuation(indent, token);
        }
        self.assigned = None;
        indent
    }

    /// A continued line is behind the `=`, unless that is far to the right or the line is a
    /// separate clause.
    fn continuation(&self, indent: usize, token: &Token<'_>) -> usize {
        let clause = token.kind == TokenKind::Text || token.text == "for";
        self.assigned.filter(|column| !clause && *column <= 40).unwrap_or(indent + 2 * INDENT)
    }

    fn in_braces(&self) -> bool {
        self.open.last().is_some_and(|open| open.bracket == b'{')
    }

    /// Returns `true` where a colon is behind the label of a row, a member or a reaction.
    fn is_label(&self) -> bool {
        self.open.last().map_or(self.reaction, |open| open.labels || self.table && open.bracket == b'{')
    }

    fn outside_parentheses(&self) -> bool {
        self.open.last().is_none_or(|open| open.bracket == b'{')
    }

    fn column(&self) -> usize {
        self.lines.last().map_or(0, |line| line.chars().count())
    }

    fn push(&mut self, text: &str) {
        if let Some(line) = self.lines.last_mut() {
            line.push_str(text);
        }
    }
}
