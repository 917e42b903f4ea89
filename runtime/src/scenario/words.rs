//! Messages of the YAML reader about a value, in the words of scenarios.

use std::borrow::Cow;

/// Expected kinds of the reader, and their names here.
const EXPECTED: [(&str, &str); 10] = [
    ("struct File", "a mapping of keys with values"),
    ("struct SolverOverrides", "a mapping from solver settings to values"),
    ("a nonzero u32", "a whole number from 1 on"),
    ("u32", "a whole number that is not negative"),
    ("f64", "a number"),
    ("a boolean", "true or false"),
    ("a string", "a text"),
    // What it expects of one of several names.
    ("a YAML tag starting with '!'", "a text"),
    ("a sequence", "a list"),
    ("a map", "a mapping"),
];

/// Variants are read as one of two kinds, of which the reader says nothing more.
const VARIANT: &str = "data did not match any variant of untagged enum VariantEntry";

/// Found value: `integer `3`` is 3.
const FOUND: [(&str, &str); 5] =
    [("sequence", "a list"), ("map", "a mapping"), ("unit value", "nothing"), ("Option value", "a value"), ("byte array", "bytes")];

/// Kinds that it puts before a value in back-ticks or quotes.
const KINDS: [&str; 5] = ["boolean ", "integer ", "floating point ", "string ", "character "];

/// Longest text of a file that a message repeats, in bytes.
const LONGEST: usize = 60;

/// `noise: invalid type: integer 3, expected a mapping` as a sentence: "`noise` is a mapping, not
/// 3".
pub(super) fn sentence(message: &str) -> String {
    let (key, rest) = match message.split_once(": ") {
        Some((key, rest)) if key != "invalid type" && key != "invalid value" => (format!("`{}`", shortened(key)), rest),
        _ => ("a scenario".to_owned(), message),
    };
    let kind = rest.strip_prefix("invalid type: ").or_else(|| rest.strip_prefix("invalid value: "));
    if let Some((found, known)) = rest.strip_prefix("unknown variant ").and_then(|rest| rest.split_once(", expected one of ")) {
        return format!("{key} is {}, not {}", one_of(known), self::found(found));
    }
    match kind.and_then(|rest| rest.rsplit_once(", expected ")) {
        Some((found, wanted)) => format!("{key} is {}, not {}", expected(wanted), self::found(found)),
        None => message.replace(VARIANT, "a variant is a name, NAME=CHOICE or a mapping with a choice"),
    }
}

fn expected(text: &str) -> &str {
    EXPECTED.iter().find(|(theirs, _)| text == *theirs).map_or(text, |(_, ours)| ours)
}

/// `a`, `b`, `c` as "a, b or c".
fn one_of(names: &str) -> String {
    let names = names.replace('`', "");
    names.rsplit_once(", ").map_or(names.clone(), |(others, last)| format!("{others} or {last}"))
}

fn found(text: &str) -> String {
    if let Some((_, ours)) = FOUND.iter().find(|(theirs, _)| text == *theirs) {
        return (*ours).into();
    }
    let value = KINDS.iter().find_map(|kind| text.strip_prefix(kind)).unwrap_or(text);
    match value.strip_prefix('"').and_then(|value| value.strip_suffix('"')) {
        Some(inside) => format!("\"{}\"", shortened(inside)),
        None => shortened(value.trim_matches('`')).into_owned(),
    }
}

/// A name or a value of a file as a message repeats it: a long one is cut.
pub(crate) fn shortened(text: &str) -> Cow<'_, str> {
    match text.len() {
        n if n > LONGEST => format!("{}...", &text[..text.floor_char_boundary(LONGEST)]).into(),
        _ => text.into(),
    }
}

/// A message whose names, in back-ticks, are cut likewise.
pub(crate) fn shortened_names(message: &str) -> String {
    let parts = message.split('`').enumerate();
    let cut = parts.map(|(i, part)| if i % 2 == 1 { shortened(part) } else { part.into() });
    cut.collect::<Vec<_>>().join("`")
}
