//! Words on which the layout of a text depends.

use crate::words::{CLAUSES, is_reserved, keywords};

/// Returns `true` if statements that begin with this word hold statements in braces.
pub(crate) fn has_block(keyword: &str) -> bool {
    matches!(keyword, "component" | "at" | "variant" | "when" | "level" | "phase" | "test")
}

/// Returns `true` if a line cannot end after this word.
pub(super) fn continues_line(word: &str) -> bool {
    is_reserved(word) && !matches!(word, "true" | "false")
}

/// Returns `true` if a line that begins so goes on with the statement of the line before.
pub(super) fn continues_statement(line: &str) -> bool {
    match line.as_bytes() {
        [b'+' | b'-' | b'*' | b'/' | b'^' | b'<' | b'>' | b'=' | b'|' | b'~' | b'"', ..] => true,
        [b'!', b'=', ..] | [b'.', b'.', ..] => true,
        _ => matches!(leading_word(line), "for" | "else" | "then" | "and" | "or" | "in" | "as"),
    }
}

/// Returns `true` if a line begins as only a statement does: a keyword, then another word, a block
/// or a path.
pub(super) fn begins_statement(line: &str) -> bool {
    let keyword = leading_word(line);
    if keywords().all(|word| word != keyword) {
        return false;
    }
    let rest = line[keyword.len()..].trim_start_matches([' ', '\t']);
    let blank = rest.len() < line.len() - keyword.len();
    match rest.as_bytes().first() {
        Some(b'{') => matches!(keyword, "steady" | "episode" | "solver"),
        Some(b'"') => matches!(keyword, "use" | "test"),
        Some(byte) if byte.is_ascii_alphabetic() && blank => !CLAUSES.contains(&leading_word(rest)),
        _ => false,
    }
}

/// The name that a line begins with; empty where it begins with something else.
pub(super) fn leading_word(line: &str) -> &str {
    let length = line.bytes().take_while(|b| b.is_ascii_alphanumeric() || *b == b'_').count();
    &line[..length]
}

/// Replacement of a character that the language does not use.
pub(super) fn character_help(character: char, after: &str) -> String {
    let instead = match character {
        '\u{b0}' if after.starts_with('K') => "write `K`: the kelvin has no degree sign",
        '\u{b0}' if !after.starts_with(['C', 'F']) => "write `deg` for an angle, `degC` for a temperature in degrees Celsius",
        '\u{b0}' => "write `degC` or `°C` for a temperature in degrees Celsius",
        '\u{b5}' | '\u{3bc}' => "write `u` for the prefix micro and `mu` for the letter",
        '\u{d7}' | '\u{b7}' | '\u{22c5}' => "write `*` to multiply",
        '\u{2212}' | '\u{2013}' | '\u{2014}' => "write `-` for minus",
        '\u{2264}' => "write `<=`",
        '\u{2265}' => "write `>=`",
        '\u{2260}' => "write `!=`",
        '\u{b2}' | '\u{b3}' => "write a power as `^2`",
        '\'' => "a rate is written `d/dt x`, a text between straight double quotes",
        '\u{201c}' | '\u{201d}' | '\u{201e}' | '`' => "write texts between straight double quotes",
        '\u{a0}' | '\u{202f}' | '\u{2009}' => "this is a special blank; write an ordinary one",
        '&' => "write `and`",
        '@' | '$' | '?' | '\\' => "remove it",
        _ => "names are made of the letters a to z, digits and `_`",
    };
    instead.to_owned()
}
