//! Between the analysis and the protocol: addresses, places, kinds.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use lsp_types::{CompletionItemKind, Location, SymbolKind as Symbol, Uri};
use smpl_analysis::complete::ProposalKind;
use smpl_analysis::outline::Colour;
use smpl_analysis::position::{Encoding, Lines, Position};
use smpl_analysis::symbols::SymbolKind;
use smpl_dsl::syntax::Role;

/// The path of an address: of a file, else the whole address as a name.
pub(super) fn path_of(uri: &Uri) -> PathBuf {
    let text = uri.as_str();
    match text.strip_prefix("file://") {
        Some(path) => {
            let path = path.find('/').map_or(path, |at| &path[at..]);
            PathBuf::from(decoded(path))
        }
        None => PathBuf::from(text),
    }
}

/// The address of a path.
pub(super) fn uri_of(path: &Path) -> Option<Uri> {
    let text = path.to_str()?;
    if !text.starts_with('/') {
        return Uri::from_str(text).ok();
    }
    let mut out = String::from("file://");
    for byte in text.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => out.push(char::from(byte)),
            _ => out.push_str(&format!("%{byte:02X}")),
        }
    }
    Uri::from_str(&out).ok()
}

fn decoded(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        let hex = (bytes[at] == b'%').then(|| text.get(at + 1..at + 3).and_then(|hex| u8::from_str_radix(hex, 16).ok())).flatten();
        out.push(hex.unwrap_or(bytes[at]));
        at += if hex.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&out).into_owned()
}

/// A text with its lines, in the negotiated encoding.
#[derive(Clone, Copy)]
pub(super) struct Places<'t> {
    pub(super) text: &'t str,
    pub(super) lines: &'t Lines,
    pub(super) encoding: Encoding,
}

impl Places<'_> {
    pub(super) fn position(&self, offset: usize) -> lsp_types::Position {
        let Position { line, character } = self.lines.position(self.text, offset, self.encoding);
        lsp_types::Position { line, character }
    }

    pub(super) fn range(&self, range: &Range<usize>) -> lsp_types::Range {
        lsp_types::Range { start: self.position(range.start), end: self.position(range.end) }
    }

    pub(super) fn offset(&self, at: lsp_types::Position) -> usize {
        self.lines.offset(self.text, Position { line: at.line, character: at.character }, self.encoding)
    }

    pub(super) fn bytes(&self, range: lsp_types::Range) -> Range<usize> {
        let start = self.offset(range.start);
        start..self.offset(range.end).max(start)
    }

    pub(super) fn location(&self, path: &Path, range: &Range<usize>) -> Option<Location> {
        Some(Location { uri: uri_of(path)?, range: self.range(range) })
    }
}

/// Kinds of symbol of an outline.
pub(super) fn symbol_kind(kind: SymbolKind) -> Symbol {
    match kind {
        SymbolKind::Model => Symbol::MODULE,
        SymbolKind::Component => Symbol::CLASS,
        SymbolKind::Connector | SymbolKind::Port => Symbol::INTERFACE,
        SymbolKind::Instance => Symbol::OBJECT,
        SymbolKind::Function => Symbol::FUNCTION,
        SymbolKind::Set | SymbolKind::Choice => Symbol::ENUM,
        SymbolKind::Member | SymbolKind::Choose => Symbol::ENUM_MEMBER,
        SymbolKind::Domain | SymbolKind::Table | SymbolKind::TimeTable => Symbol::ARRAY,
        SymbolKind::Variable(Role::Param) | SymbolKind::Structural | SymbolKind::Unit => Symbol::CONSTANT,
        SymbolKind::Variable(Role::State | Role::Discrete) => Symbol::FIELD,
        SymbolKind::Variable(Role::Action | Role::Disturbance | Role::Random) => Symbol::PROPERTY,
        SymbolKind::Variable(Role::Var | Role::Let)
        | SymbolKind::Flux
        | SymbolKind::Time
        | SymbolKind::Index
        | SymbolKind::Argument
        | SymbolKind::Observation => Symbol::VARIABLE,
        SymbolKind::Event
        | SymbolKind::Failure
        | SymbolKind::Success
        | SymbolKind::Constraint
        | SymbolKind::Invariant
        | SymbolKind::Reward
        | SymbolKind::Phase => Symbol::EVENT,
        SymbolKind::Test => Symbol::METHOD,
        SymbolKind::Level | SymbolKind::Policy | SymbolKind::Variant => Symbol::NAMESPACE,
    }
}

/// Kinds of proposal.
pub(super) fn proposal_kind(kind: ProposalKind) -> CompletionItemKind {
    match kind {
        ProposalKind::Keyword => CompletionItemKind::KEYWORD,
        ProposalKind::Function => CompletionItemKind::FUNCTION,
        ProposalKind::Word => CompletionItemKind::VALUE,
        ProposalKind::Unit => CompletionItemKind::UNIT,
        ProposalKind::File => CompletionItemKind::FILE,
        ProposalKind::Symbol(kind) => match kind {
            SymbolKind::Component | SymbolKind::Model => CompletionItemKind::CLASS,
            SymbolKind::Connector | SymbolKind::Port => CompletionItemKind::INTERFACE,
            SymbolKind::Function => CompletionItemKind::FUNCTION,
            SymbolKind::Unit => CompletionItemKind::UNIT,
            SymbolKind::Set | SymbolKind::Choice => CompletionItemKind::ENUM,
            SymbolKind::Member | SymbolKind::Choose => CompletionItemKind::ENUM_MEMBER,
            SymbolKind::Variable(Role::Param) | SymbolKind::Structural | SymbolKind::Table => CompletionItemKind::CONSTANT,
            SymbolKind::Variable(Role::State | Role::Discrete) => CompletionItemKind::FIELD,
            SymbolKind::Variable(Role::Action | Role::Disturbance | Role::Random) => CompletionItemKind::PROPERTY,
            SymbolKind::Event | SymbolKind::Phase => CompletionItemKind::EVENT,
            SymbolKind::Instance => CompletionItemKind::MODULE,
            _ => CompletionItemKind::VARIABLE,
        },
    }
}

/// Names of token types, in the order of their numbers.
pub(super) const TOKEN_TYPES: &[&str] = &[
    "keyword",
    "comment",
    "string",
    "number",
    "operator",
    "type",
    "function",
    "variable",
    "property",
    "parameter",
    "enumMember",
    "class",
    "namespace",
    "event",
    "typeParameter",
];

/// Names of token modifiers, in the order of their bits.
pub(super) const TOKEN_MODIFIERS: &[&str] = &["declaration", "readonly", "defaultLibrary"];

/// Number of the token type and bits of the modifiers.
pub(super) fn token(colour: Colour) -> (u32, u32) {
    match colour {
        Colour::Keyword => (0, 0),
        Colour::Comment => (1, 0),
        Colour::Text => (2, 0),
        Colour::Number => (3, 0),
        Colour::Operator => (4, 0),
        Colour::Unit => (5, 4),
        Colour::Function => (6, 0),
        Colour::Constant => (7, 2),
        Colour::State => (8, 0),
        Colour::Variable => (7, 0),
        Colour::Input => (9, 0),
        Colour::Member => (10, 0),
        Colour::Type => (11, 0),
        Colour::Instance => (12, 0),
        Colour::Label => (13, 0),
        Colour::Parameter => (14, 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_with_blanks_and_letters_of_other_alphabets_lead_to_their_files() {
        let path = Path::new("/tmp/a b/größe°.eq");
        let uri = uri_of(path);
        assert_eq!(uri.as_ref().map(|uri| uri.as_str()), Some("file:///tmp/a%20b/gr%C3%B6%C3%9Fe%C2%B0.eq"));
        assert_eq!(uri.map(|uri| path_of(&uri)).as_deref(), Some(path));
    }
}
