//! What can be written at a position, also while the statement is half-written.

use std::ops::Range;
use std::path::Path;

use smpl_compiler::elaborate::{BUILTINS, block_entries, built_in_names};
use smpl_dsl::span::FileId;
use smpl_dsl::syntax::Role;
use smpl_dsl::units::{Unit, symbols};
use smpl_dsl::words;

use crate::check::Facts;
use crate::hover::{self, unit_of};
use crate::program::Program;
use crate::reference;
use crate::symbols::{SymbolId, SymbolKind};
use crate::texts::Texts;
use crate::token::{Token, TokenKind, tokens};

/// Kinds of proposal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProposalKind {
    /// A statement keyword with its form.
    Keyword,
    /// A symbol.
    Symbol(SymbolKind),
    /// A built-in function.
    Function,
    /// A built-in name, an option or another word of the place.
    Word,
    /// A unit.
    Unit,
    /// A file.
    File,
}

/// Something that can be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Proposal {
    /// Shown name.
    pub label: String,
    /// Kind.
    pub kind: ProposalKind,
    /// Short text behind the name: unit, meaning.
    pub detail: String,
    /// Inserted text; a snippet with `${1:..}` if [`Self::snippet`].
    pub insert: String,
    /// Whether `insert` is a snippet.
    pub snippet: bool,
    /// Order: smaller first.
    pub rank: u8,
}

/// Proposals, and the bytes that one of them replaces.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Completion {
    /// The word that was begun.
    pub replaces: Range<usize>,
    /// Proposals, the likeliest first.
    pub proposals: Vec<Proposal>,
}

/// Statement keywords: what they do, and a snippet.
const STATEMENTS: &[(&str, &str, &str)] = &[
    ("model", "names the model", "model ${1:Name} \"${2:text}\""),
    ("use", "imports a file or makes an instance of a component", "use ${1:Component} as ${2:name}($3)"),
    ("time", "names the independent variable and its unit", "time ${1:t} : ${2:min}"),
    ("set", "declares an index set", "set ${1:species} = { ${2:a, b} }"),
    ("table", "declares numbers over sets or over time", "table ${1:name}[${2:set}] : ${3:unit} = {\n  ${4:member}: ${5:0}\n}"),
    ("def", "declares a function", "def ${1:f}(${2:x}) = ${3:x}"),
    ("param", "declares a constant of an episode", "param ${1:k} : ${2:1/min} = ${3:1} \"${4:text}\""),
    ("action", "declares an input that is held over a step", "action ${1:u} : ${2:L/min} = ${3:0} in ${4:0}..${5:1} \"${6:text}\""),
    ("state", "declares a differential state", "state ${1:x} : ${2:mol/L} = ${3:0} in ${4:0}..${5:1} \"${6:text}\""),
    ("var", "declares an algebraic variable, determined by an equation", "var ${1:y} : ${2:mol/L} \"${3:text}\""),
    ("let", "names an expression", "let ${1:y} = ${2:expression}"),
    ("discrete", "declares a variable that changes at sampling instants", "discrete ${1:x} : ${2:1} = ${3:0} \"${4:text}\""),
    ("disturbance", "declares an exogenous sequence", "disturbance ${1:d} : ${2:1} = ${3:0} ~ ${4:normal(0, 1)} \"${5:text}\""),
    ("random", "declares a random number that is drawn at reset", "random ${1:zeta} ~ ${2:normal(0, 1)} \"${3:text}\""),
    ("eq", "states an equation", "eq ${1:d/dt x} = ${2:expression}"),
    ("domain", "declares a spatial domain", "domain ${1:z} in ${2:0}..${3:L} cells ${4:20} scheme ${5:upwind}"),
    ("flux", "declares a flux along a domain", "flux ${1:J}[${2:z}] = ${3:v*c[z]}, low = ${4:v*c_in}"),
    ("connector", "declares what flows through ports", "connector ${1:Stream} { ${2:Q : L/min} }"),
    ("component", "declares a unit that can be used many times", "component ${1:Name} \"${2:text}\" {\n  $0\n}"),
    ("port", "declares the ports of a component", "port ${1:inlet, outlet} : ${2:Stream}"),
    ("connect", "connects ports", "connect ${1:A.outlet} -> ${2:B.inlet}"),
    ("initial", "sets or draws the start of a state", "initial ${1:x} ~ ${2:uniform(0.5, 1.5)}"),
    ("steady", "sets actions and states of the steady state", "steady { ${1:u} = ${2:0} }"),
    ("observe", "lists what the agent observes", "observe ${1:x}"),
    ("level", "names a set of observations", "level ${1:online} \"${2:text}\" {\n  observe ${3:x}\n}"),
    ("reward", "declares a reward", "reward ${1:name} ${2:default} = ${3:expression} \"${4:text}\""),
    ("fail", "declares a condition that ends the episode as a failure", "fail ${1:name} when ${2:outside bounds(x)} \"${3:text}\""),
    ("success", "declares a condition that ends the episode as a success", "success ${1:name} when ${2:condition} \"${3:text}\""),
    ("constraint", "declares a limit whose violation is reported", "constraint ${1:name} when ${2:x > limit} \"${3:text}\""),
    ("invariant", "declares a quantity that the equations keep", "invariant ${1:name} = ${2:expression}"),
    ("episode", "sets the sampling interval and the length of an episode", "episode { step = ${1:1} [${2:min}], max_steps = ${3:100} }"),
    ("solver", "sets options of the solver", "solver { ${1:rtol} = ${2:1e-6} }"),
    ("policy", "names open-loop values of the actions", "policy ${1:nominal} { ${2:u} = ${3:0} }"),
    ("at", "holds what happens at an instant", "at ${1:start} {\n  $0\n}"),
    ("next", "updates a discrete variable", "next ${1:x} = ${2:expression}"),
    ("reset", "sets a state at an instant", "reset ${1:x} = ${2:expression}"),
    ("clamp", "limits a state at an instant", "clamp ${1:x} at ${2:value} when ${3:condition}"),
    ("event", "names a condition that is located in time", "event ${1:name} when ${2:condition}"),
    ("phase", "declares a phase of a schedule", "phase ${1:name} for ${2:60} [${3:min}] then ${4:next}"),
    ("variant", "declares an alternative that can be turned on", "variant ${1:name} \"${2:text}\" {\n  $0\n}"),
    ("choice", "declares alternatives of which one is chosen", "choice ${1:name} = ${2:first} | ${3:second} \"${4:text}\""),
    ("when", "holds the statements of an option", "when ${1:choice} = ${2:option} {\n  $0\n}"),
];

/// What a statement keyword does, in a few words.
#[must_use]
pub fn keyword_meaning(keyword: &str) -> &'static str {
    STATEMENTS.iter().find(|(word, ..)| *word == keyword).map_or("a statement", |(_, meaning, _)| meaning)
}

/// Units of process models, offered when no dimension is known.
const COMMON_UNITS: &[&str] = &[
    "1",
    "%",
    "s",
    "min",
    "h",
    "m",
    "cm",
    "mm",
    "m^2",
    "m^3",
    "L",
    "mL",
    "kg",
    "g",
    "mg",
    "mol",
    "mol/L",
    "g/L",
    "kg/m^3",
    "K",
    "degC",
    "Pa",
    "kPa",
    "bar",
    "J",
    "kJ",
    "kW",
    "kg/s",
    "kg/h",
    "L/min",
    "L/h",
    "m^3/h",
    "1/s",
    "1/min",
    "1/h",
    "J/mol",
    "J/(mol K)",
    "kJ/(kg K)",
    "W/(m^2 K)",
    "mol/(L min)",
    "g/(L h)",
    "Pa s",
    "m^2/s",
    "N",
    "V",
    "A",
];

/// What a place in a statement takes.
enum Wanted {
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

/// Proposals at a byte of a file.
#[must_use]
pub fn complete(program: &Program, facts: &Facts, texts: &dyn Texts, file: FileId, offset: usize) -> Completion {
    let Some(source) = program.file(file) else { return Completion::default() };
    let offset = source.text.floor_char_boundary(offset.min(source.text.len()));
    let line = Line::new(&source.text, offset);
    let wanted = line.wanted(program, facts, file);
    let mut out = Proposals { program, facts, file, offset, list: Vec::new() };
    out.fill(&wanted, &line, texts, &source.path);
    out.list.sort_by(|a, b| (a.rank, &a.label).cmp(&(b.rank, &b.label)));
    let mut seen = std::collections::HashSet::new();
    out.list.retain(|p| seen.insert(p.label.clone()));
    Completion { replaces: line.prefix.clone(), proposals: out.list }
}

/// The statement before the cursor as tokens.
pub(crate) struct Line<'t> {
    text: &'t str,
    /// Tokens of the statement, from its keyword to the word that is being written.
    pub(crate) tokens: Vec<Token>,
    /// The word that is being written.
    prefix: Range<usize>,
    /// The cursor is inside of this token: a text or a comment.
    inside: Option<TokenKind>,
    /// Keyword before the innermost open brace, and whether a statement may begin after the last token.
    block: Option<String>,
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

    fn word(&self, i: usize) -> &str {
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

    fn wanted(&self, program: &Program, facts: &Facts, file: FileId) -> Wanted {
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
        if self.declares() && self.word(at + 1) != "" && self.back(0) == "in" || self.declares() && at == 2 {
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

    /// Whether the last token ends an operand, so that an operator or a clause follows.
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
            ("eq" | "connect" | "next" | "reset" | "clamp" | "initial" | "observe", _) if count == 1 => Wanted::Expression,
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
            unit_of(symbol, facts.get(&program.symbols().path(id)))
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
        "param" | "action" | "state" | "discrete" | "disturbance" | "var" | "let" | "random" => &["in", "scale", "clip bounds", "for"],
        "eq" | "next" | "reset" | "connect" => &["for"],
        "initial" => &["clip bounds", "for"],
        "observe" => &["in", "noise", "every", "delay", "for"],
        "fail" => &["when", "event"],
        "success" | "event" | "constraint" | "clamp" => &["when", "at"],
        "invariant" => &["rate"],
        "phase" => &["for", "until", "then"],
        "domain" => &["cells", "scheme", "geometry", "stretch", "faces", "areas", "volumes"],
        "use" => &["as"],
        "reward" => &["default"],
        "table" => &["over", "default", "until", "from", "linear"],
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
        // A line end outside of brackets ends the statement, and so does the brace of a block of statements.
        if depth == 0 && (tokens[i].kind == TokenKind::Newline && !is_open(text, &tokens[..i]) && !continues(word(i + 1)) || open) {
            return i + 1;
        }
    }
    0
}

/// Whether the line of a brace begins with the keyword of a block of entries, whose content belongs to that statement.
fn before_is_block(text: &str, tokens: &[Token], brace: usize) -> bool {
    let line = tokens[..brace].iter().rposition(|t| t.kind == TokenKind::Newline).map_or(0, |i| i + 1);
    let word = tokens.get(line).map_or("", |t| &text[t.range.clone()]);
    matches!(word, "episode" | "solver" | "steady" | "policy" | "set" | "table" | "connector")
}

/// Whether a bracket of the same statement is still open at the end of the tokens.
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

/// Whether a line that begins so goes on with the statement before.
fn continues(word: &str) -> bool {
    matches!(word, "+" | "-" | "*" | "/" | "^" | "<" | ">" | "=" | "|" | "~" | "for" | "else" | "then" | "and" | "or" | "in" | "as")
}

struct Proposals<'p> {
    program: &'p Program,
    facts: &'p Facts,
    file: FileId,
    offset: usize,
    list: Vec<Proposal>,
}

impl Proposals<'_> {
    fn fill(&mut self, wanted: &Wanted, line: &Line<'_>, texts: &dyn Texts, path: &Path) {
        match wanted {
            Wanted::Nothing => {}
            Wanted::Statement => self.statements(line),
            Wanted::Members(path) => self.members(path),
            Wanted::Units(expected) => self.units(expected.as_ref()),
            Wanted::Kinds(kinds) => self.kinds(kinds),
            Wanted::Files => self.files(texts, path),
            Wanted::Index(path, position) => self.index(path, *position, line),
            Wanted::Arguments(component) => self.arguments(component),
            Wanted::Entries(block) => self.entries(block),
            Wanted::Words(list) => list.iter().for_each(|word| self.word(word, "", 0)),
            Wanted::Options(name) => self.options(name),
            Wanted::Expression => self.expression(line),
            Wanted::Random => {
                ["uniform", "normal", "lognormal"].into_iter().for_each(|name| self.function(name, 0));
                self.expression(line);
            }
            Wanted::Instants => {
                self.word("start", "the begin of every step", 0);
                self.word("end", "the end of every step", 0);
                self.kinds(&[SymbolKind::Event, SymbolKind::Phase]);
            }
        }
    }

    fn push(&mut self, label: &str, kind: ProposalKind, detail: String, rank: u8) {
        let insert = label.to_owned();
        self.list.push(Proposal { label: label.to_owned(), kind, detail, insert, snippet: false, rank });
    }

    fn word(&mut self, word: &str, detail: &str, rank: u8) {
        self.push(word, ProposalKind::Word, detail.to_owned(), rank);
    }

    fn symbol(&mut self, id: SymbolId, rank: u8) {
        let symbol = self.program.symbol(id);
        let unit = unit_of(symbol, self.facts.get(&self.program.symbols().path(id)));
        let unit = unit.filter(|unit| !unit.is_one()).map(|unit| format!("[{unit}]"));
        let text = symbol.text.clone().unwrap_or_else(|| symbol.kind.words().to_owned());
        let detail = unit.into_iter().chain([text]).collect::<Vec<_>>().join(" ");
        let label = symbol.name.clone();
        let call = symbol.kind == SymbolKind::Function || symbol.kind == SymbolKind::TimeTable;
        let insert = if call { format!("{label}($1)") } else { label.clone() };
        self.list.push(Proposal { label, kind: ProposalKind::Symbol(symbol.kind), detail, insert, snippet: call, rank });
    }

    fn function(&mut self, name: &str, rank: u8) {
        let Some(builtin) = reference::function(name) else { return };
        let detail = format!("{} — {}", reference::usage(builtin), builtin.meaning);
        let insert = format!("{name}($1)");
        let (label, kind) = (name.to_owned(), ProposalKind::Function);
        self.list.push(Proposal { label, kind, detail, insert, snippet: true, rank });
    }

    fn statements(&mut self, line: &Line<'_>) {
        for (word, meaning, snippet) in STATEMENTS {
            let inside = matches!(*word, "next" | "reset" | "clamp");
            let block = line.block.as_deref();
            let fits = if block == Some("at") { inside } else { !inside || block == Some("phase") };
            let (label, insert) = ((*word).to_owned(), (*snippet).to_owned());
            let rank = u8::from(!fits);
            self.list.push(Proposal { label, kind: ProposalKind::Keyword, detail: (*meaning).to_owned(), insert, snippet: true, rank });
        }
    }

    /// Members of what a path names: a component's names, a connector's, the ends of a domain.
    fn members(&mut self, path: &[String]) {
        let symbols = self.program.symbols();
        let mut at = path.first().and_then(|name| symbols.lookup(self.program.scope_at(self.file, self.offset), name));
        for name in path.iter().skip(1) {
            at = at.and_then(|id| symbols.scope_of(id)).and_then(|scope| symbols.find(Some(scope), true, name));
        }
        let Some(id) = at else { return };
        match self.program.symbol(id).kind {
            SymbolKind::Domain => {
                ["first", "last", "low", "high", "number"].into_iter().for_each(|word| self.word(word, "of the domain", 0))
            }
            _ => {
                let scope = symbols.scope_of(id);
                let members: Vec<SymbolId> = scope.iter().flat_map(|s| symbols.members(Some(*s))).map(|(id, _)| id).collect();
                members.into_iter().for_each(|id| self.symbol(id, 0));
            }
        }
    }

    /// Units: those of the expected dimension first.
    fn units(&mut self, expected: Option<&Unit>) {
        if let Some(unit) = expected.filter(|unit| !unit.is_one()) {
            let written = unit.to_string();
            self.push(&written, ProposalKind::Unit, "the declared unit".to_owned(), 0);
        }
        let fits = |unit: &Unit| expected.is_some_and(|e| e.commensurable(unit));
        for written in COMMON_UNITS {
            let unit = composed(written);
            let rank = if unit.as_ref().is_some_and(fits) { 1 } else { 2 };
            let detail = unit.map(|unit| unit.dimension().describe()).unwrap_or_default();
            self.push(written, ProposalKind::Unit, detail, rank);
        }
        for symbol in symbols() {
            let rank = if Unit::named(symbol.symbol).as_ref().is_some_and(fits) { 1 } else { 3 };
            self.push(symbol.symbol, ProposalKind::Unit, format!("{}: {}", symbol.name, symbol.dimension().describe()), rank);
        }
        self.used_units(expected);
    }

    /// Units that the model writes.
    fn used_units(&mut self, expected: Option<&Unit>) {
        let mut used: Vec<Unit> =
            self.program.symbols().iter().filter_map(|(_, symbol)| symbol.unit.as_ref().and_then(hover::resolved)).collect();
        used.dedup_by_key(|unit| unit.to_string());
        for unit in used {
            let rank = if expected.is_some_and(|e| e.commensurable(&unit)) { 1 } else { 2 };
            self.push(&unit.to_string(), ProposalKind::Unit, unit.dimension().describe(), rank);
        }
    }

    fn kinds(&mut self, kinds: &[SymbolKind]) {
        let found: Vec<SymbolId> =
            self.program.visible(self.file, self.offset).into_iter().filter(|id| kinds.contains(&self.program.symbol(*id).kind)).collect();
        found.into_iter().for_each(|id| self.symbol(id, 0));
    }

    fn files(&mut self, texts: &dyn Texts, path: &Path) {
        let folder = path.parent().unwrap_or(Path::new(""));
        for model in texts.models(path) {
            if let Ok(relative) = model.strip_prefix(folder)
                && model != path
            {
                self.push(&relative.to_string_lossy().replace('\\', "/"), ProposalKind::File, String::new(), 0);
            }
        }
    }

    /// Members of the set of an index, and names in scope.
    fn index(&mut self, path: &[String], position: usize, line: &Line<'_>) {
        let symbols = self.program.symbols();
        let scope = self.program.scope_at(self.file, self.offset);
        let mut at = path.first().and_then(|name| symbols.lookup(scope, name));
        for name in path.iter().skip(1) {
            at = at.and_then(|id| symbols.scope_of(id)).and_then(|scope| symbols.find(Some(scope), true, name));
        }
        let set =
            at.and_then(|id| symbols.lookup(self.program.symbol(id).within.or(scope), self.program.symbol(id).indices.get(position)?));
        if let Some(set) = set {
            let members: Vec<SymbolId> = symbols.members(Some(set)).map(|(id, _)| id).collect();
            members.into_iter().for_each(|id| self.symbol(id, 1));
            if self.program.symbol(set).kind == SymbolKind::Domain {
                let name = self.program.symbol(set).name.clone();
                ["", ".first", ".last"].into_iter().for_each(|end| self.word(&format!("{name}{end}"), "cell", 1));
            }
        }
        self.bound(line);
    }

    /// Indices that the statement binds.
    fn bound(&mut self, line: &Line<'_>) {
        for i in 1..line.tokens.len() {
            if line.word(i) == "in" && line.tokens[i - 1].kind == TokenKind::Word && i >= 2 && matches!(line.word(i - 2), "for" | "," | "[")
            {
                let name = line.word(i - 1).to_owned();
                self.push(&name, ProposalKind::Symbol(SymbolKind::Index), format!("index over {}", line.word(i + 1)), 0);
            }
        }
        // A `for` may follow behind the cursor.
        let Some(source) = self.program.file(self.file) else { return };
        let rest = source.text[self.offset..].lines().next().unwrap_or_default();
        let Some((_, clause)) = rest.split_once(" for ") else { return };
        for binder in clause.split(',') {
            let name = binder.split_whitespace().next().unwrap_or_default();
            if !name.is_empty() && name.chars().all(crate::token::is_word) {
                self.push(name, ProposalKind::Symbol(SymbolKind::Index), "index".to_owned(), 0);
            }
        }
    }

    fn arguments(&mut self, component: &str) {
        let symbols = self.program.symbols();
        let Some(component) = symbols.find(None, true, component) else { return };
        let takes = |kind| matches!(kind, SymbolKind::Structural | SymbolKind::Variable(Role::Param));
        let list: Vec<SymbolId> = symbols.members(Some(component)).filter(|(_, s)| takes(s.kind)).map(|(id, _)| id).collect();
        for id in list {
            self.symbol(id, 0);
            if let Some(last) = self.list.last_mut() {
                let unit = unit_of(self.program.symbol(id), None).filter(|unit| !unit.is_one());
                let unit = unit.map(|unit| format!(" [{unit}]")).unwrap_or_default();
                last.insert = format!("{} = ${{1:0}}{unit}", last.label);
                last.snippet = true;
            }
        }
    }

    fn entries(&mut self, block: &str) {
        for (name, words) in block_entries(block) {
            let detail = words.map(|words| format!("one of {words}")).unwrap_or_default();
            let (label, insert) = (name.to_owned(), format!("{name} = $1"));
            self.list.push(Proposal { label, kind: ProposalKind::Word, detail, insert, snippet: true, rank: 0 });
        }
        match block {
            "policy" => self.kinds(&[SymbolKind::Variable(Role::Action)]),
            "steady" => self.kinds(&[SymbolKind::Variable(Role::Action), SymbolKind::Variable(Role::State)]),
            _ => {}
        }
    }

    /// Options of a choice, or words that an entry takes.
    fn options(&mut self, name: &str) {
        let symbols = self.program.symbols();
        let scope = self.program.scope_at(self.file, self.offset);
        if let Some(choice) = symbols.lookup(scope, name) {
            let options: Vec<SymbolId> = symbols.members(Some(choice)).map(|(id, _)| id).collect();
            options.into_iter().for_each(|id| self.symbol(id, 0));
        }
        let words =
            ["episode", "solver"].into_iter().flat_map(block_entries).find(|(entry, _)| *entry == name).and_then(|(_, words)| words);
        for word in words.unwrap_or_default().split(|c: char| !crate::token::is_word(c)).filter(|w| !w.is_empty() && *w != "or") {
            self.word(word, "", 0);
        }
    }

    fn expression(&mut self, line: &Line<'_>) {
        self.bound(line);
        for id in self.program.visible(self.file, self.offset) {
            let rank = match self.program.symbol(id).kind {
                SymbolKind::Variable(_) | SymbolKind::Time | SymbolKind::Port => 1,
                SymbolKind::Instance | SymbolKind::Table | SymbolKind::TimeTable | SymbolKind::Function | SymbolKind::Flux => 2,
                SymbolKind::Structural => 2,
                SymbolKind::Domain | SymbolKind::Event | SymbolKind::Phase => 3,
                _ => continue,
            };
            self.symbol(id, rank);
        }
        if line.word(0) == "eq" && line.tokens.len() == 1 {
            self.word("d/dt ", "time derivative", 0);
        }
        BUILTINS.iter().for_each(|builtin| self.function(builtin.name, 4));
        built_in_names().for_each(|(name, meaning)| self.word(name, meaning, 5));
        ["if", "not", "true", "false"].into_iter().for_each(|word| self.word(word, "", 5));
    }
}

/// The meaning of a unit as written.
#[must_use]
pub fn composed(written: &str) -> Option<Unit> {
    let text = format!("param x : {written}");
    let parsed = smpl_dsl::parse(&text, FileId(0));
    let smpl_dsl::syntax::StatementKind::Declare { declarations, .. } = &parsed.file.statements.first()?.kind else { return None };
    hover::resolved(declarations.first()?.unit.as_ref()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_statement_keyword_has_a_snippet() {
        for keyword in words::keywords() {
            assert!(STATEMENTS.iter().any(|(word, ..)| *word == keyword), "{keyword}");
        }
    }

    #[test]
    fn common_units_exist() {
        for unit in COMMON_UNITS {
            assert!(composed(unit).is_some(), "{unit}");
        }
    }
}
