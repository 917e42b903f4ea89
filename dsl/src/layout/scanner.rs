//! The scan: comments, texts and brackets out of the way, a statement for each line or block.

use std::ops::Range;

use super::{Layout, MAX_NESTING, RawBody, RawStatement, has_block, words};
use crate::diagnostic::{Diagnostic, Faults, codes};
use crate::span::{FileId, Span, span};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Bracket {
    Round,
    Square,
    Entries,
    Block,
}

impl Bracket {
    fn closing(self) -> char {
        match self {
            Bracket::Round => ')',
            Bracket::Square => ']',
            Bracket::Entries | Bracket::Block => '}',
        }
    }
}

#[derive(Debug)]
struct Frame {
    bracket: Bracket,
    open: usize,
    /// Conditions opened and not yet ended at this level.
    conditions: usize,
}

/// A statement whose end has not been found.
#[derive(Debug)]
struct Pending {
    start: usize,
    keyword: Range<usize>,
    damaged: bool,
    /// Frames below this one belong to enclosing blocks.
    frames: usize,
}

/// An open block: the statement that owns it, and those found in it so far.
#[derive(Debug)]
struct OpenBlock {
    owner: RawStatement,
    open: usize,
    statements: Vec<RawStatement>,
}

/// The token read last.
#[derive(Debug, Default)]
struct LastToken {
    end: usize,
    /// A line cannot end after it.
    continues: bool,
    is_else: bool,
}

/// One scan over a text.
pub(super) struct Scanner<'t> {
    text: &'t str,
    bytes: &'t [u8],
    file: FileId,
    at: usize,
    clean: Vec<u8>,
    frames: Vec<Frame>,
    depth: usize,
    /// Conditions of a statement outside all brackets.
    conditions: usize,
    blocks: Vec<OpenBlock>,
    top: Vec<RawStatement>,
    pending: Option<Pending>,
    last: LastToken,
    /// First byte of the next token after the newline looked at last.
    next_token: usize,
    comments: Vec<Range<usize>>,
    diagnostics: Faults,
}

impl<'t> Scanner<'t> {
    pub(super) fn new(text: &'t str, file: FileId) -> Self {
        Self {
            text,
            bytes: text.as_bytes(),
            file,
            at: 0,
            clean: text.as_bytes().to_vec(),
            frames: Vec::new(),
            depth: 0,
            conditions: 0,
            blocks: Vec::new(),
            top: Vec::new(),
            pending: None,
            last: LastToken::default(),
            next_token: 0,
            comments: Vec::new(),
            diagnostics: Faults::default(),
        }
    }

    pub(super) fn run(mut self) -> Layout {
        if self.text.starts_with('\u{feff}') {
            self.blank(0..3);
            self.at = 3;
        }
        while self.at < self.bytes.len() && self.depth <= MAX_NESTING {
            self.step();
        }
        self.finish();
        Layout {
            text: String::from_utf8(self.clean).unwrap_or_default(),
            statements: self.top,
            comments: self.comments,
            diagnostics: self.diagnostics,
        }
    }

    fn step(&mut self) {
        let at = self.at;
        match self.bytes[at] {
            b' ' => self.at += 1,
            b'\t' | b'\r' => {
                self.clean[at] = b' ';
                self.at += 1;
            }
            b'\n' => self.newline(),
            b'#' => self.comment(),
            b'"' => self.quoted(),
            b'(' => self.open(Bracket::Round),
            b'[' => self.open(Bracket::Square),
            b'{' => self.open_brace(),
            b')' => self.close(&[Bracket::Round]),
            b']' => self.close(&[Bracket::Square]),
            b'}' => self.close(&[Bracket::Entries, Bracket::Block]),
            b';' if self.at_statement_level() => {
                self.end_statement();
                self.at += 1;
            }
            byte if byte.is_ascii_alphanumeric() || byte == b'_' => self.word(),
            byte if b"+-*/^<>=!|~.,:;%".contains(&byte) => self.operator(byte),
            _ if self.is_degree() => self.token(self.at + "\u{b0}C".len(), false),
            _ => self.stray_character(),
        }
    }

    // ---- tokens

    fn token(&mut self, end: usize, continues: bool) {
        if self.pending.is_none() {
            let keyword = self.at..end;
            self.pending = Some(Pending { start: self.at, keyword, damaged: false, frames: self.frames.len() });
        }
        self.at = end;
        self.last.end = end;
        self.last.continues = continues;
        self.last.is_else = false;
    }

    fn word(&mut self) {
        let start = self.at;
        let end = start + self.bytes[start..].iter().take_while(|b| b.is_ascii_alphanumeric() || **b == b'_').count();
        let word = &self.text[start..end];
        let after_else = self.last.is_else;
        self.token(end, words::continues_line(word));
        match word {
            "else" => self.last.is_else = true,
            "if" if !after_else => self.count_condition(),
            _ => {}
        }
    }

    /// `°C` or `°F`
    fn is_degree(&self) -> bool {
        let after = self.text[self.at..].strip_prefix('\u{b0}').and_then(|rest| rest.strip_prefix(['C', 'F']));
        after.is_some_and(|rest| !rest.starts_with(|c: char| c.is_ascii_alphanumeric() || c == '_'))
    }

    fn operator(&mut self, byte: u8) {
        if byte == b',' {
            self.end_conditions();
        }
        let continues = match byte {
            b'.' => self.bytes[..self.at].ends_with(b"."),
            b'%' | b';' => false,
            _ => true,
        };
        self.token(self.at + 1, continues);
    }

    fn quoted(&mut self) {
        let rest = &self.bytes[self.at + 1..];
        let line = rest.iter().position(|b| matches!(b, b'"' | b'\n')).unwrap_or(rest.len());
        if rest.get(line) == Some(&b'"') {
            self.token(self.at + line + 2, false);
            return;
        }
        let start = self.at;
        self.token(start + 1 + line, false);
        let message = "this text has no closing quote";
        let fault = Diagnostic::error(codes::UNCLOSED_TEXT, message, self.span(start..start + 1))
            .label("opened here")
            .secondary(self.span(self.at..self.at), "the line ends here")
            .help("write a text on one line between double quotes");
        self.report(fault);
    }

    fn comment(&mut self) {
        let length = self.bytes[self.at..].iter().take_while(|b| **b != b'\n').count();
        let mut end = self.at + length;
        while end > self.at && matches!(self.bytes[end - 1], b'\r' | b' ' | b'\t') {
            end -= 1;
        }
        self.comments.push(self.at..end);
        self.blank(self.at..self.at + length);
        self.at += length;
    }

    fn stray_character(&mut self) {
        let Some(character) = self.text[self.at..].chars().next() else {
            self.at = self.bytes.len();
            return;
        };
        let range = self.at..self.at + character.len_utf8();
        let seen = self.pending.as_ref().is_some_and(|pending| pending.damaged);
        self.token(range.end, false);
        if seen {
            return;
        }
        let after = &self.text[range.end..];
        let message = format!("unexpected character `{}`", character.escape_debug());
        let fault = Diagnostic::error(codes::UNEXPECTED_CHARACTER, message, self.span(range))
            .label("not part of the language")
            .help(words::character_help(character, after));
        self.report(fault);
    }

    // ---- newlines

    fn newline(&mut self) {
        let at = self.at;
        self.at += 1;
        if self.pending.is_none() {
            return;
        }
        if self.next_token <= at {
            self.next_token = self.find_next_token(self.at);
        }
        let next = self.next_token;
        let begins = words::begins_statement(&self.text[next..]) && !self.defines_a_local(next);
        if begins {
            self.give_up_brackets(next);
        }
        let continued = self.last.continues && !begins;
        let blank = match self.innermost() {
            Bracket::Round | Bracket::Square => true,
            _ => continued || words::continues_statement(&self.text[next..]) && !self.runs_a_test(next),
        };
        if blank {
            self.clean[at] = b' ';
        } else if self.at_statement_level() {
            self.end_statement();
        } else {
            self.end_conditions();
        }
    }

    /// Returns whether a line of a test begins with `for`, which is a separate statement.
    fn runs_a_test(&self, next: usize) -> bool {
        let inside = |block: &OpenBlock| words::leading_word(&self.text[block.owner.start..]) == "test";
        words::leading_word(&self.text[next..]) == "for" && self.at_statement_level() && self.blocks.last().is_some_and(inside)
    }

    /// Returns whether a line is a `let` between the braces of a function.
    fn defines_a_local(&self, next: usize) -> bool {
        let function = self.pending.as_ref().is_some_and(|pending| &self.text[pending.keyword.clone()] == "def");
        function && self.innermost() == Bracket::Entries && words::leading_word(&self.text[next..]) == "let"
    }

    /// Skips blanks, newlines and comments.
    fn find_next_token(&self, mut at: usize) -> usize {
        while let Some(byte) = self.bytes.get(at) {
            match byte {
                b' ' | b'\t' | b'\r' | b'\n' => at += 1,
                b'#' => at += self.bytes[at..].iter().take_while(|b| **b != b'\n').count(),
                _ => break,
            }
        }
        at
    }

    // ---- brackets

    fn innermost(&self) -> Bracket {
        self.frames.last().map_or(Bracket::Block, |frame| frame.bracket)
    }

    fn at_statement_level(&self) -> bool {
        self.innermost() == Bracket::Block
    }

    fn open(&mut self, bracket: Bracket) {
        let open = self.at;
        self.token(open + 1, false);
        self.frames.push(Frame { bracket, open, conditions: 0 });
        self.deepen();
    }

    fn open_brace(&mut self) {
        let keyword = self.pending.as_ref().map(|pending| pending.keyword.clone());
        let block = keyword.is_some_and(|range| has_block(&self.text[range]));
        if !(block && self.at_statement_level()) {
            return self.open(Bracket::Entries);
        }
        let open = self.at;
        let Some(owner) = self.take_statement() else { return };
        self.blocks.push(OpenBlock { owner, open, statements: Vec::new() });
        self.at += 1;
        self.last.end = self.at;
        self.last.continues = false;
        self.frames.push(Frame { bracket: Bracket::Block, open, conditions: 0 });
        self.deepen();
    }

    fn close(&mut self, kinds: &[Bracket]) {
        let at = self.at;
        let floor = self.pending.as_ref().map_or(self.frames.len(), |pending| pending.frames);
        let own = self.frames[floor..].iter().rposition(|frame| kinds.contains(&frame.bracket)).map(|index| floor + index);
        let block = floor.checked_sub(1).filter(|_| kinds.contains(&Bracket::Block));
        match own.or(block) {
            Some(index) => {
                if index + 1 < self.frames.len() {
                    self.report_unclosed(index + 1, at..at + 1, "closed by this");
                    self.truncate_frames(index + 1);
                }
                self.close_top();
            }
            None if self.frames.len() > floor => self.mismatched(),
            None => self.unmatched(),
        }
    }

    fn close_top(&mut self) {
        if !self.at_statement_level() {
            self.truncate_frames(self.frames.len() - 1);
            self.token(self.at + 1, false);
            return;
        }
        self.end_statement();
        self.truncate_frames(self.frames.len().saturating_sub(1));
        self.at += 1;
        self.last.end = self.at;
        self.close_block(self.at);
    }

    fn close_block(&mut self, close: usize) {
        if let Some(block) = self.blocks.pop() {
            let body = RawBody { open: block.open, close, statements: block.statements };
            self.push_statement(RawStatement { body: Some(body), ..block.owner });
        }
    }

    /// A bracket closed by one of another kind: treated as the right one.
    fn mismatched(&mut self) {
        let top = self.frames.len() - 1;
        self.report_unclosed(top, self.at..self.at + 1, "closed by this");
        self.truncate_frames(top);
        self.token(self.at + 1, false);
    }

    fn unmatched(&mut self) {
        let range = self.at..self.at + 1;
        let message = format!("`{}` closes nothing", &self.text[range.clone()]);
        let fault = Diagnostic::error(codes::UNMATCHED_CLOSING, message, self.span(range.clone()))
            .label("no bracket is open here")
            .help("remove it, or open the bracket before it");
        if self.pending.is_none() {
            self.diagnostics.push(fault);
            self.at += 1;
        } else {
            self.token(range.end, false);
            self.report(fault);
        }
    }

    /// Ends brackets that are still open where the next statement begins.
    fn give_up_brackets(&mut self, next: usize) {
        let floor = self.pending.as_ref().map_or(self.frames.len(), |pending| pending.frames);
        if self.frames.len() > floor {
            let word = words::leading_word(&self.text[next..]).len();
            self.report_unclosed(floor, next..next + word, "the next statement begins here");
            self.truncate_frames(floor);
        }
    }

    fn report_unclosed(&mut self, index: usize, end: Range<usize>, what: &str) {
        let Frame { bracket, open, .. } = self.frames[index];
        let (opening, closing) = (&self.text[open..=open], bracket.closing());
        let message = format!("`{opening}` is not closed");
        let fault = Diagnostic::error(codes::UNCLOSED_BRACKET, message, self.span(open..open + 1))
            .label("opened here")
            .secondary(self.span(end), what)
            .help(format!("add `{closing}`"));
        self.report(fault);
    }

    fn truncate_frames(&mut self, length: usize) {
        for frame in self.frames.drain(length..) {
            self.depth -= 1 + frame.conditions;
        }
    }

    // ---- depth

    fn deepen(&mut self) {
        self.depth += 1;
        if self.depth > MAX_NESTING {
            let message = format!("brackets and conditions are nested more than {MAX_NESTING} deep");
            let range = self.last.end.saturating_sub(1)..self.last.end;
            self.report(Diagnostic::error(codes::TOO_LARGE, message, self.span(range)).help("name parts with `let`"));
        }
    }

    fn count_condition(&mut self) {
        *self.frames.last_mut().map_or(&mut self.conditions, |frame| &mut frame.conditions) += 1;
        self.deepen();
    }

    fn end_conditions(&mut self) {
        let conditions = self.frames.last_mut().map_or(&mut self.conditions, |frame| &mut frame.conditions);
        self.depth -= std::mem::take(conditions);
    }

    // ---- statements

    fn take_statement(&mut self) -> Option<RawStatement> {
        let Pending { start, damaged, .. } = self.pending.take()?;
        Some(RawStatement { start, end: self.last.end, body: None, damaged })
    }

    fn end_statement(&mut self) {
        self.end_conditions();
        if let Some(statement) = self.take_statement() {
            self.push_statement(statement);
        }
    }

    fn push_statement(&mut self, statement: RawStatement) {
        match self.blocks.last_mut() {
            Some(block) => block.statements.push(statement),
            None => self.top.push(statement),
        }
    }

    fn finish(&mut self) {
        let end = self.bytes.len();
        let floor = self.pending.as_ref().map_or(self.frames.len(), |pending| pending.frames);
        let too_deep = self.depth > MAX_NESTING;
        let unclosed = if self.frames.len() > floor { Some(floor) } else { self.frames.len().checked_sub(1) };
        if let Some(index) = unclosed.filter(|_| !too_deep) {
            self.report_unclosed(index, end..end, "the file ends here");
        }
        self.end_statement();
        while !self.blocks.is_empty() {
            self.close_block(self.last.end);
        }
    }

    // ---- faults

    fn report(&mut self, fault: Diagnostic) {
        if let Some(pending) = &mut self.pending {
            pending.damaged = true;
        }
        self.diagnostics.push(fault);
    }

    fn blank(&mut self, range: Range<usize>) {
        self.clean[range].fill(b' ');
    }

    fn span(&self, range: Range<usize>) -> Span {
        span(self.file, range.start, range.end)
    }
}
