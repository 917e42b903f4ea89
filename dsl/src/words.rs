//! The words of the language: one list for the layout, the formatter, the parser and for those who write texts.

/// First words of statements.
pub(crate) const KEYWORDS: &[&str] = &[
    "model",
    "use",
    "time",
    "set",
    "table",
    "def",
    "param",
    "action",
    "state",
    "var",
    "let",
    "discrete",
    "disturbance",
    "random",
    "eq",
    "domain",
    "flux",
    "connector",
    "component",
    "port",
    "connect",
    "initial",
    "steady",
    "observe",
    "level",
    "reward",
    "fail",
    "success",
    "constraint",
    "invariant",
    "episode",
    "solver",
    "policy",
    "at",
    "next",
    "reset",
    "clamp",
    "event",
    "phase",
    "variant",
    "choice",
    "when",
];

/// Words that cannot be names.
const RESERVED: &[&str] = &["if", "then", "else", "and", "or", "not", "for", "in", "as", "true", "false"];

/// Words that may follow a name inside a statement, so that a keyword before them is an ordinary name.
pub(crate) const CLAUSES: &[&str] = &[
    "if", "then", "else", "and", "or", "for", "in", "as", "every", "delay", "noise", "scale", "clip", "named", "default", "when", "rate",
    "until", "over", "cells",
];

/// Whether the word cannot be a name.
pub(crate) fn is_reserved(word: &str) -> bool {
    RESERVED.contains(&word)
}

/// Words that mean something in one place only.
const INSIDE: &[&str] = &["from", "linear", "bounds", "unit", "dt"];

/// Whether the word has a meaning of its own somewhere in the language. A name may be one where it is no reserved word, but a writer of
/// texts does better without. What is built in is not among them.
#[must_use]
pub fn is_word(name: &str) -> bool {
    [KEYWORDS, RESERVED, CLAUSES, INSIDE].iter().any(|list| list.contains(&name))
}
