//! Text of others on a terminal.

use std::borrow::Cow;

/// The text without characters that a terminal would interpret. Control characters become their
/// pictures (`␛` for escape); those without one and marks of the direction of writing become `�`.
/// Newlines and tabs stay. As many characters as before.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    if text.contains(is_obeyed) { Cow::Owned(text.chars().map(shown).collect()) } else { Cow::Borrowed(text) }
}

fn is_obeyed(c: char) -> bool {
    let turns = matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    turns || c.is_control() && !matches!(c, '\n' | '\t')
}

fn shown(c: char) -> char {
    match c {
        '\u{7f}' => '\u{2421}',
        '\0'..='\u{1f}' if is_obeyed(c) => char::from_u32(0x2400 + u32::from(c)).unwrap_or(char::REPLACEMENT_CHARACTER),
        _ if is_obeyed(c) => char::REPLACEMENT_CHARACTER,
        _ => c,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_control_character_is_left_but_newlines_and_tabs() {
        let all: String = (0..0x3000).filter_map(char::from_u32).collect();
        let out = printable(&all);
        assert_eq!(out.chars().count(), all.chars().count());
        assert_eq!(out.chars().filter(|c| c.is_control()).collect::<String>(), "\t\n");
        assert!(!out.contains(['\u{202e}', '\u{2066}']));
    }

    #[test]
    fn a_sequence_for_the_terminal_is_shown_as_text() {
        // Sets the title of the window, turns the text red, and the same with the one-character
        // introducer.
        assert_eq!(printable("\x1b]0;title\x07 \x1b[31m \u{9b}31m\x7f"), "\u{241b}]0;title\u{2407} \u{241b}[31m \u{fffd}31m\u{2421}");
    }

    #[test]
    fn other_text_stays_as_it_is() {
        assert!(matches!(printable("5 \u{b5}m\n\tstate x = 1 \u{1f600}"), Cow::Borrowed(_)));
    }
}
