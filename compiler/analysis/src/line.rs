//! The statement before the cursor, read from its tokens, and what can follow it.

use std::ops::Range;

use smpl_dsl::span::FileId;
use smpl_dsl::units::Unit;
use smpl_dsl::words;

use crate::check::Facts;
use crate::hover::{self, unit_of};
use crate::program::Program;
use crate::symbols::{SymbolId, SymbolKind};
use crate::token::{Token, TokenKind, tokens};

/// Kinds of things that a place in a statement takes.
pub(crate) enum Wanted {
    Nothing,
    Statement,
    Members(Vec<String>),
    Units(Option<Unit>),
    Kinds(&'static [SymbolKind]),
    Files,
    Index(Vec<String>, usize),
    Arguments(String),
    Entries(String),
    Words(&'static [&'static str]),
    Options(String),
    Expression,
    Random,
    Instants,
}

/// The statement before the cursor as tokens.
pub(crate) struct Line<'t> {
    text: &'t str,
    /// Tokens of the statement, from its keyword to the word that is being written.
    pub(crate) tokens: Vec<Token>,
    /// The word that is being written.
    pub(crate) prefix: Range<usize>,
    /// The cursor is inside of this token: a text or a comment.
    inside: Option<TokenKind>,
    /// Keyword before the innermost open brace, and whether a statement may begin after the last
    /// token.
    pub(crate) block: Option<String>,
}

impl<'t> Line<'t> {
    /// The statement before a byte.
    pub(crate) fn new(text: &'t str, offset: usize) -> Self {
        let mut all = tokens(&text[..offset]);
        let open_text = |t: &Token| t.kind == TokenKind::Text && (t.range.len() < 2 || !text[t.range.clone()].ends_with('"'));
        let inside = all.last().filter(|t| t.range.end == offset && (t.kind == TokenKind::Comment || open_text(t))).map(|t| t.kind);
        let prefix = match all.last() {
            Some(last) if last.kind == TokenKind::Word && last.range.end == offset => {
                let range = last.range.clone();
                all.pop();
                range
            }
            Some(last) if inside == Some(TokenKind::Text) => last.range.start + 1..offset,
            _ => offset..offset,
        };
        let block = open_block(text, &all);
        let start = statement_start(text, &all);
        let tokens = all.split_off(start).into_iter().filter(|t| !matches!(t.kind, TokenKind::Comment | TokenKind::Newline)).collect();
        Line { text, tokens, prefix, inside, block }
    }

    /// A word by its number.
    pub(crate) fn word(&self, i: usize) -> &str {
        self.tokens.get(i).map_or("", |t| &self.text[t.range.clone()])
    }

    /// The word at a distance from the end: 0 is the last token.
    fn back(&self, i: usize) -> &str {
        self.tokens.len().checked_sub(i + 1).map_or("", |at| self.word(at))
    }

    fn is_name(&self, i: usize) -> bool {
        self.tokens.len().checked_sub(i + 1).is_some_and(|at| self.tokens[at].kind == TokenKind::Word)
    }

    /// Open brackets with the index of their token, the innermost last.
    pub(crate) fn open(&self) -> Vec<(usize, char)> {
        let mut open = Vec::new();
        for i in 0..self.tokens.len() {
            match self.word(i) {
                "(" => open.push((i, '(')),
                "[" => open.push((i, '[')),
                "{" => open.push((i, '{')),
                ")" | "]" | "}" => {
                    open.pop();
                }
                _ => {}
            }
        }
        open
    }

    /// The first word of the statement.
    pub(crate) fn first_word(&self) -> &str {
        self.word(0)
    }

    /// The innermost open parenthesis after a name, with that name.
    pub(crate) fn call(&self) -> Option<(usize, String)> {
        let (at, _) = self.open().into_iter().rev().find(|(at, bracket)| *bracket == '(' && *at > 0)?;
        (self.tokens[at - 1].kind == TokenKind::Word).then(|| (at, self.word(at - 1).to_owned()))
    }

    /// Number of commas directly inside of an open bracket.
    pub(crate) fn commas_after(&self, open: usize) -> usize {
        let mut depth = 0_i32;
        let mut commas = 0;
        for i in open + 1..self.tokens.len() {
            match self.word(i) {
                "(" | "[" | "{" => depth += 1,
                ")" | "]" | "}" => depth -= 1,
                "," if depth == 0 => commas += 1,
                _ => {}
            }
        }
        commas
    }

    /// Names that end before a token: `R1.inlet` before a `.` or `[`.
    fn path_before(&self, token: usize) -> Vec<String> {
        let mut out = Vec::new();
        let mut at = token;
        while let Some(i) = at.checked_sub(1) {
            let name = if self.word(i) == "]" { self.opening(i).and_then(|o| o.checked_sub(1)) } else { Some(i) };
            let Some(name) = name.filter(|&n| self.tokens[n].kind == TokenKind::Word) else { break };
            out.push(self.word(name).to_owned());
            match name.checked_sub(1) {
                Some(dot) if self.word(dot) == "." => at = dot,
                _ => break,
            }
        }
        out.reverse();
        out
    }

    fn opening(&self, close: usize) -> Option<usize> {
        let mut depth = 0_usize;
        (0..=close).rev().find(|&i| {
            match self.word(i) {
                ")" | "]" | "}" => depth += 1,
                "(" | "[" | "{" => depth -= 1,
                _ => {}
            }
            depth == 0
        })
    }

    /// Completions after the tokens.
    pub(crate) fn wanted(&self, program: &Program, facts: &Facts, file: FileId) -> Wanted {
        match self.inside {
            Some(TokenKind::Text) if self.word(0) == "use" => return Wanted::Files,
            Some(_) => return Wanted::Nothing,
            None => {}
        }
        let keyword = self.word(0);
        if self.tokens.is_empty() {
            return match self.block.as_deref() {
                Some(block @ ("episode" | "solver" | "steady" | "policy")) => Wanted::Entries(block.to_owned()),
                Some("table" | "set" | "connector") => Wanted::Nothing,
                _ => Wanted::Statement,
            };
        }
        if self.back(0) == "." {
            return Wanted::Members(self.path_before(self.tokens.len() - 1));
        }
        let open = self.open();
        match open.last() {
            Some(&(at, '[')) => self.in_index(program, facts, file, at),
            Some(&(at, '(')) => self.in_call(keyword, at),
            Some(&(_, '{')) => self.in_braces(keyword),
            _ => self.in_statement(keyword),
        }
    }

    /// In square brackets: a unit after a number, `as` or a column's name, else an index.
    fn in_index(&self, program: &Program, facts: &Facts, file: FileId, at: usize) -> Wanted {
        let before = at.checked_sub(1);
        let is_unit = before.is_none_or(|i| self.tokens[i].kind == TokenKind::Number || matches!(self.word(i), "as" | ")"))
            || self.word(0) == "table"
                && self.text[..self.tokens[at].range.start].rfind("columns").is_some_and(|c| c > self.tokens[0].range.start);
        if is_unit {
            return Wanted::Units(self.expected_unit(program, facts, file));
        }
        let commas = (at + 1..self.tokens.len()).filter(|&i| self.word(i) == ",").count();
        if self.declares() && !self.word(at + 1).is_empty() && self.back(0) == "in" || self.declares() && at == 2 {
            return Wanted::Kinds(&[SymbolKind::Set, SymbolKind::Domain]);
        }
        Wanted::Index(self.path_before(at), commas)
    }

    fn declares(&self) -> bool {
        matches!(self.word(0), "param" | "action" | "state" | "var" | "let" | "discrete" | "disturbance" | "random" | "flux" | "table")
    }

    fn in_call(&self, keyword: &str, at: usize) -> Wanted {
        if keyword == "use" && matches!(self.back(0), "(" | ",") {
            return Wanted::Arguments(self.word(1).to_owned());
        }
        match self.back(0) {
            "for" | "in" => Wanted::Kinds(&[SymbolKind::Set, SymbolKind::Domain]),
            _ if at >= 1 && self.word(at - 1) == "bounds" => Wanted::Expression,
            _ if self.is_operand_end() => Wanted::Words(&["for", "if", "and", "or"]),
            _ => Wanted::Expression,
        }
    }

    fn in_braces(&self, keyword: &str) -> Wanted {
        let begins = matches!(self.back(0), "{" | ",");
        match keyword {
            "episode" | "solver" | "steady" | "policy" if begins => Wanted::Entries(keyword.to_owned()),
            "solver" | "episode" if self.back(0) == "=" => Wanted::Options(self.back(1).to_owned()),
            "connector" if self.back(0) == ":" => Wanted::Units(None),
            "set" | "table" | "connector" if begins => Wanted::Nothing,
            _ if self.back(0) == "{" => Wanted::Statement,
            _ => Wanted::Expression,
        }
    }

    /// Returns whether the last token ends an operand, so that an operator or a clause follows.
    fn is_operand_end(&self) -> bool {
        let Some(last) = self.tokens.last() else { return false };
        let word = &self.text[last.range.clone()];
        match last.kind {
            TokenKind::Number | TokenKind::Text => true,
            TokenKind::Word => !words::is_reserved(word) && !["when", "until", "rate", "at", "scale", "event"].contains(&word),
            TokenKind::Sign => matches!(word, ")" | "]"),
            TokenKind::Comment | TokenKind::Newline => false,
        }
    }

    fn in_statement(&self, keyword: &str) -> Wanted {
        let (last, count) = (self.back(0), self.tokens.len());
        match (keyword, last) {
            ("use", "use") => Wanted::Kinds(&[SymbolKind::Component]),
            ("port", ":") => Wanted::Kinds(&[SymbolKind::Connector]),
            ("at", "at") => Wanted::Instants,
            ("phase", "then") => Wanted::Kinds(&[SymbolKind::Phase]),
            ("when", "when") => Wanted::Kinds(&[SymbolKind::Choice]),
            ("when", "=") => Wanted::Options(self.word(1).to_owned()),
            ("domain", "scheme") => Wanted::Words(&["upwind", "upwind2", "downwind", "central", "limited"]),
            ("domain", "geometry") => Wanted::Words(&["planar", "cylindrical", "spherical"]),
            ("table", "over") => Wanted::Kinds(&[SymbolKind::Set, SymbolKind::Time]),
            (_, "for" | "in") if last == "for" || self.after_binder() => Wanted::Kinds(&[SymbolKind::Set, SymbolKind::Domain]),
            _ if self.in_unit() => Wanted::Units(None),
            (_, "~") => Wanted::Random,
            ("eq" | "connect" | "next" | "reset" | "clamp" | "initial" | "observe" | "control", _) if count == 1 => Wanted::Expression,
            _ if count == 1 || self.names_something(keyword) => Wanted::Nothing,
            _ if self.is_operand_end() => Wanted::Words(clauses(keyword)),
            _ => Wanted::Expression,
        }
    }

    /// After `for i in`: a set.
    fn after_binder(&self) -> bool {
        self.back(0) == "in" && self.is_name(1) && matches!(self.back(2), "for" | ",")
    }

    /// After the comma of a list of declarations: a new name.
    fn names_something(&self, keyword: &str) -> bool {
        self.back(0) == "," && (self.declares() && keyword != "flux" || matches!(keyword, "port" | "use"))
    }

    /// In the unit of a declaration: after its colon, with nothing but parts of a unit since.
    fn in_unit(&self) -> bool {
        if !self.declares() && !matches!(self.word(0), "time" | "reward" | "observe") {
            return false;
        }
        let Some(colon) = (0..self.tokens.len()).rev().find(|&i| self.word(i) == ":") else { return false };
        let since = colon + 1..self.tokens.len();
        let operator = since.is_empty() || matches!(self.back(0), "/" | "*" | "(");
        operator && since.into_iter().all(|i| self.tokens[i].kind != TokenKind::Text && !matches!(self.word(i), "=" | "in" | "~" | ","))
    }

    /// The unit of what the statement declares, or of the argument before the cursor.
    fn expected_unit(&self, program: &Program, facts: &Facts, file: FileId) -> Option<Unit> {
        let scope = program.scope_at(file, self.prefix.start);
        let of = |id: SymbolId| {
            let symbol = program.symbol(id);
            unit_of(program, symbol, facts.get(&program.symbols().path(id)))
        };
        let equals = (0..self.tokens.len()).rev().find(|&i| self.word(i) == "=")?;
        let name = self.path_before(equals);
        if self.word(0) == "use" {
            let component = program.symbols().find(None, true, self.word(1))?;
            return of(program.symbols().find(Some(component), true, name.last()?)?);
        }
        if matches!(self.word(0), "episode") {
            let time = program.symbols().members(None).find(|(_, symbol)| symbol.kind == SymbolKind::Time)?;
            return of(time.0);
        }
        let declared = self.declares().then(|| self.word(1).to_owned());
        let id = program.symbols().lookup(scope, declared.as_deref().or(name.first().map(String::as_str))?)?;
        of(id)
    }
}

/// Clauses that may follow an operand of a statement.
fn clauses(keyword: &str) -> &'static [&'static str] {
    match keyword {
        "state" => &["in", "scale", "nonnegative", "prefer"],
        "disturbance" => &["in", "scale", "clip bounds", "from"],
        "param" | "action" | "discrete" | "var" | "let" | "random" => &["in", "scale", "clip bounds"],
        "reaction" => &["rate"],
        "eq" | "next" | "reset" | "connect" => &["for"],
        "initial" => &["clip bounds", "for"],
        "observe" => &["in", "noise", "every", "delay", "for"],
        "fail" => &["when", "event"],
        "success" | "event" | "constraint" | "clamp" => &["when", "at"],
        "control" => &["from", "setpoint", "gain", "reset", "limits", "manual", "every", "for"],
        "at" => &["every"],
        "invariant" => &["rate"],
        "phase" => &["for", "until", "then"],
        "domain" => &["cells", "scheme", "geometry", "stretch", "faces", "areas", "volumes", "periodic"],
        "use" => &["as"],
        "reward" => &["default"],
        "table" => &["over", "default", "until", "from", "linear", "step", "cubic", "outside"],
        _ => &[],
    }
}

/// Keyword of the statement whose brace is open before the end of the tokens.
fn open_block(text: &str, tokens: &[Token]) -> Option<String> {
    let mut depth = 0_usize;
    let brace = tokens.iter().rposition(|t| {
        match &text[t.range.clone()] {
            "}" => depth += 1,
            "{" if depth == 0 => return true,
            "{" => depth -= 1,
            _ => {}
        }
        false
    })?;
    let start = statement_start(text, &tokens[..brace]);
    tokens.get(start).map(|t| text[t.range.clone()].to_owned())
}

/// Index of the token that begins the last statement.
fn statement_start(text: &str, tokens: &[Token]) -> usize {
    let word = |i: usize| tokens.get(i).map_or("", |t| &text[t.range.clone()]);
    let mut depth = 0_usize;
    for i in (0..tokens.len()).rev() {
        let begins_line = i == 0 || tokens[i - 1].kind == TokenKind::Newline || matches!(word(i - 1), "{" | ";");
        match word(i) {
            ")" | "]" | "}" => depth += 1,
            "(" | "[" | "{" => depth = depth.saturating_sub(1),
            _ => {}
        }
        if begins_line && hover::is_keyword(word(i)) && word(i + 1) != "=" {
            return i;
        }
        let open = matches!(word(i), "{") && depth == 0 && !before_is_block(text, tokens, i);
        // A line end outside of brackets or the brace of a block of statements ends the statement.
        if depth == 0 && (tokens[i].kind == TokenKind::Newline && !is_open(text, &tokens[..i]) && !continues(word(i + 1)) || open) {
            return i + 1;
        }
    }
    0
}

/// Returns whether the line of a brace begins with the keyword of a block of entries, whose content
/// belongs to that statement.
fn before_is_block(text: &str, tokens: &[Token], brace: usize) -> bool {
    let line = tokens[..brace].iter().rposition(|t| t.kind == TokenKind::Newline).map_or(0, |i| i + 1);
    let word = tokens.get(line).map_or("", |t| &text[t.range.clone()]);
    matches!(word, "episode" | "solver" | "steady" | "policy" | "set" | "table" | "connector")
}

/// Returns whether a bracket of the same statement is still open at the end of the tokens.
fn is_open(text: &str, tokens: &[Token]) -> bool {
    let mut depth = 0_i32;
    for (i, token) in tokens.iter().enumerate().rev() {
        let word = &text[token.range.clone()];
        match word {
            "(" | "[" => depth += 1,
            ")" | "]" => depth -= 1,
            _ => {}
        }
        let begins_line = i == 0 || tokens[i - 1].kind == TokenKind::Newline;
        if depth > 0 || begins_line && hover::is_keyword(word) {
            return depth > 0;
        }
    }
    false
}

/// Returns whether a line that begins so goes on with the statement before.
fn continues(word: &str) -> bool {
    matches!(word, "+" | "-" | "*" | "/" | "^" | "<" | ">" | "=" | "|" | "~" | "for" | "else" | "then" | "and" | "or" | "in" | "as")
}
