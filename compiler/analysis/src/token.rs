//! Words, numbers and signs of a text, also where no statement can be parsed.

use std::ops::Range;

use smpl_dsl::words::{number, word};

/// Kinds of token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TokenKind {
    /// A name, a keyword or a unit symbol.
    Word,
    /// A number.
    Number,
    /// A text in double quotes; it ends at the end of its line if the quote is missing.
    Text,
    /// A comment, from `#` to the end of the line.
    Comment,
    /// An operator or bracket.
    Sign,
    /// The end of a line.
    Newline,
}

/// A token and its bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Token {
    /// Kind.
    pub kind: TokenKind,
    /// Bytes of the text.
    pub range: Range<usize>,
}

/// Signs of two characters.
const PAIRS: &[&str] = &["..", "->", "==", "!=", "<=", ">="];

/// Tokens of a text, in its order.
#[must_use]
pub fn tokens(text: &str) -> Vec<Token> {
    let mut out = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let (kind, length) = measure(&text[at..], first);
        if let Some(kind) = kind {
            out.push(Token { kind, range: at..at + length });
        }
        at += length.max(1);
    }
    out
}

/// Kind and length of the token that a text begins with; no kind for blanks.
fn measure(text: &str, first: char) -> (Option<TokenKind>, usize) {
    let until = |end: fn(char) -> bool| text.find(end).unwrap_or(text.len());
    match first {
        '\n' | '\r' => (Some(TokenKind::Newline), 1),
        _ if first.is_whitespace() => (None, first.len_utf8()),
        '#' => (Some(TokenKind::Comment), until(|c| matches!(c, '\n' | '\r'))),
        '"' => {
            let line = until(|c| matches!(c, '\n' | '\r'));
            (Some(TokenKind::Text), text[1..line].find('"').map_or(line, |end| end + 2))
        }
        _ if first.is_ascii_digit() => (Some(TokenKind::Number), number(text)),
        _ if word(text) > 0 => (Some(TokenKind::Word), word(text)),
        _ => {
            let length = PAIRS.iter().find(|pair| text.starts_with(**pair)).map_or(first.len_utf8(), |pair| pair.len());
            (Some(TokenKind::Sign), length)
        }
    }
}

/// Returns whether a character may occur in a name.
#[must_use]
pub fn is_word(character: char) -> bool {
    character.is_ascii_alphanumeric() || character == '_'
}

/// Bytes of the word around or just before an offset; empty at the offset without a word.
#[must_use]
pub fn word_at(text: &str, offset: usize) -> Range<usize> {
    let offset = text.floor_char_boundary(offset.min(text.len()));
    let before: usize = text[..offset].chars().rev().take_while(|c| is_word(*c)).map(char::len_utf8).sum();
    let after: usize = text[offset..].chars().take_while(|c| is_word(*c)).map(char::len_utf8).sum();
    offset - before..offset + after
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_with_a_percent_sign_is_one_word() {
        let text = "param a : mol% = 2 [°C]";
        let words: Vec<&str> = tokens(text).into_iter().map(|token| &text[token.range]).collect();
        assert_eq!(words, ["param", "a", ":", "mol%", "=", "2", "[", "°C", "]"]);
    }

    #[test]
    fn tokens_cover_everything_but_blanks() {
        let text = "eq d/dt x = 1e-3 [°C] # to\n\"open\n";
        let list: Vec<&str> = tokens(text).into_iter().map(|token| &text[token.range]).collect();
        assert_eq!(list, ["eq", "d", "/", "dt", "x", "=", "1e-3", "[", "°C", "]", "# to", "\n", "\"open", "\n"]);
    }

    #[test]
    fn a_word_is_found_from_its_end_too() {
        assert_eq!(word_at("a + k_0 ", 7), 4..7);
        assert_eq!(word_at("a + k_0 ", 3), 3..3);
    }
}
