//! Tokens of one statement, with what stood between them.

use std::ops::Range;

use crate::words::{is_reserved, number, word};

/// Kind of a token, as far as blanks depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TokenKind {
    Word,
    Number,
    Text,
    Symbol,
    /// `*`, `/`, `+` or `-` between two operands; `true` where the author put blanks round it.
    Operator(bool),
    /// A sign before an operand.
    Sign,
    Comment,
}

/// A token and whether blanks or a line end stood before it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Token<'t> {
    pub(super) text: &'t str,
    pub(super) kind: TokenKind,
    pub(super) blank_before: bool,
    pub(super) newline_before: bool,
}

/// Symbols of two characters.
const PAIRS: &[&str] = &["..", "->", "==", "!=", "<=", ">="];

/// Words before which an expression has not begun, so that a sign behind them belongs to a number.
const BEFORE_EXPRESSION: &[&str] = &[
    "at", "scale", "every", "delay", "noise", "until", "when", "event", "rate", "cells", "default", "clip", "from", "setpoint", "gain",
    "limits", "manual",
];

/// The tokens of a range of the text; comments are tokens too.
pub(super) fn tokens<'t>(text: &'t str, range: Range<usize>, comments: &[Range<usize>]) -> Vec<Token<'t>> {
    let mut tokens: Vec<Token<'t>> = Vec::new();
    let mut comments = comments.iter();
    let mut at = range.start;
    while at < range.end {
        let rest = &text[at..range.end];
        let start = at + rest.len() - rest.trim_start().len();
        let gap = &text[at..start];
        if start >= range.end {
            break;
        }
        let (length, kind) = if text[start..].starts_with('#') {
            (comments.next().map_or(1, |comment| comment.len()), TokenKind::Comment)
        } else {
            measure(&text[start..range.end])
        };
        let end = start + length;
        tokens.push(Token { text: &text[start..end], kind, blank_before: !gap.is_empty(), newline_before: gap.contains('\n') });
        at = end;
    }
    classify_operators(&mut tokens);
    tokens
}

/// Length and kind of the token that a text begins with.
fn measure(text: &str) -> (usize, TokenKind) {
    let first = text.chars().next().unwrap_or(' ');
    match first {
        '"' => (text[1..].find('"').map_or(text.len(), |end| end + 2), TokenKind::Text),
        _ if first.is_ascii_digit() => (number(text), TokenKind::Number),
        _ if word(text) > 0 => (word(text), TokenKind::Word),
        _ => (PAIRS.iter().find(|pair| text.starts_with(**pair)).map_or(first.len_utf8(), |pair| pair.len()), TokenKind::Symbol),
    }
}

fn classify_operators(tokens: &mut [Token<'_>]) {
    for index in 0..tokens.len() {
        if tokens[index].kind != TokenKind::Symbol || !matches!(tokens[index].text, "+" | "-" | "*" | "/") {
            continue;
        }
        let previous = tokens[..index].iter().rfind(|token| token.kind != TokenKind::Comment).copied();
        let next = tokens.get(index + 1).copied();
        let attached = tokens[index].blank_before && next.is_some_and(|token| !token.blank_before);
        // What follows the keyword of a statement begins an expression.
        let begins = index == 1;
        let sign = matches!(tokens[index].text, "+" | "-") && (begins || previous.is_none_or(|token| opens_expression(&token, attached)));
        let rate = previous.is_some_and(|token| token.text == "d") && next.is_some_and(|token| token.text == "dt");
        let spaced = !rate && (tokens[index].blank_before || next.is_some_and(|token| token.blank_before));
        tokens[index].kind = if sign { TokenKind::Sign } else { TokenKind::Operator(spaced) };
    }
}

/// Returns `true` if an operand must follow the token; a word that may be a name or a keyword does
/// where the author wrote `at -1`.
fn opens_expression(token: &Token<'_>, attached: bool) -> bool {
    match token.kind {
        TokenKind::Word if BEFORE_EXPRESSION.contains(&token.text) => attached,
        TokenKind::Word => is_reserved(token.text) && !matches!(token.text, "true" | "false"),
        TokenKind::Number | TokenKind::Text => false,
        TokenKind::Symbol => !matches!(token.text, ")" | "]" | "}" | "%"),
        TokenKind::Operator(_) | TokenKind::Sign | TokenKind::Comment => true,
    }
}

/// Returns `true` if a blank is between two tokens of one line.
pub(super) fn spaced(previous: &Token<'_>, next: &Token<'_>, label_colon: bool) -> bool {
    match (previous.text, next.text) {
        (_, "," | ")" | "]" | "." | ".." | "^") | ("(" | "[" | "." | ".." | "^", _) => false,
        (_, ":") => !label_colon,
        ("," | ":" | "{" | "}", _) | (_, "{" | "}") => true,
        _ => spaced_by_kind(previous, next),
    }
}

fn spaced_by_kind(previous: &Token<'_>, next: &Token<'_>) -> bool {
    match (previous.kind, next.kind) {
        (TokenKind::Sign, _) => false,
        (TokenKind::Operator(blank), _) | (_, TokenKind::Operator(blank)) => blank,
        (TokenKind::Number, TokenKind::Symbol) if next.text == "[" => true,
        (TokenKind::Word, TokenKind::Symbol) if is_reserved(previous.text) => true,
        (TokenKind::Word, TokenKind::Symbol) | (TokenKind::Symbol, TokenKind::Symbol)
            if matches!(next.text, "(" | "[") && !is_infix(previous.text) =>
        {
            next.blank_before
        }
        _ => true,
    }
}

fn is_infix(symbol: &str) -> bool {
    matches!(symbol, "=" | "==" | "!=" | "<" | ">" | "<=" | ">=" | "~" | "|" | "->")
}
