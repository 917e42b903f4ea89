//! Byte offsets of a text and positions as editors count them.

use std::ops::Range;

/// Units in which an editor counts the characters of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// Bytes.
    Utf8,
    /// Code units of UTF-16: an emoji counts two.
    #[default]
    Utf16,
    /// Characters.
    Utf32,
}

impl Encoding {
    fn length(self, text: &str) -> usize {
        match self {
            Encoding::Utf8 => text.len(),
            Encoding::Utf16 => text.chars().map(char::len_utf16).sum(),
            Encoding::Utf32 => text.chars().count(),
        }
    }

    fn of(self, character: char) -> usize {
        match self {
            Encoding::Utf8 => character.len_utf8(),
            Encoding::Utf16 => character.len_utf16(),
            Encoding::Utf32 => 1,
        }
    }
}

/// A line and a character in it, both counted from 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
    /// Line.
    pub line: u32,
    /// Character, in the units of an [`Encoding`].
    pub character: u32,
}

/// Offsets of the lines of a text.
#[derive(Clone, Debug)]
pub struct Lines {
    starts: Vec<usize>,
    length: usize,
}

impl Lines {
    /// Lines of a text; they end in LF, CR LF or CR.
    #[must_use]
    pub fn new(text: &str) -> Self {
        let bytes = text.as_bytes();
        let ends = |&(at, byte): &(usize, &u8)| *byte == b'\n' || *byte == b'\r' && bytes.get(at + 1) != Some(&b'\n');
        let starts = std::iter::once(0).chain(bytes.iter().enumerate().filter(ends).map(|(at, _)| at + 1)).collect();
        Self { starts, length: text.len() }
    }

    /// Number of lines.
    #[must_use]
    pub fn count(&self) -> usize {
        self.starts.len()
    }

    /// Line of a byte.
    #[must_use]
    pub fn line(&self, offset: usize) -> usize {
        self.starts.partition_point(|&start| start <= offset).max(1) - 1
    }

    /// First byte of a line; the end of the text for lines after the last.
    #[must_use]
    pub fn start(&self, line: usize) -> usize {
        self.starts.get(line).copied().unwrap_or(self.length)
    }

    /// Bytes of a line, without its end.
    #[must_use]
    pub fn range(&self, text: &str, line: usize) -> Range<usize> {
        let start = self.start(line).min(text.len());
        let end = self.start(line + 1).min(text.len());
        start..start + text[start..end].trim_end_matches(['\r', '\n']).len()
    }

    /// Position of a byte of the text; beyond the end: the end.
    #[must_use]
    pub fn position(&self, text: &str, offset: usize, encoding: Encoding) -> Position {
        let offset = text.floor_char_boundary(offset.min(text.len()));
        let line = self.line(offset);
        let character = encoding.length(&text[self.start(line).min(offset)..offset]);
        Position { line: line as u32, character: character as u32 }
    }

    /// Byte of a position; beyond the end of a line: its end; inside of a character: its begin.
    #[must_use]
    pub fn offset(&self, text: &str, position: Position, encoding: Encoding) -> usize {
        let range = self.range(text, position.line as usize);
        let mut left = position.character as usize;
        for (at, character) in text[range.clone()].char_indices() {
            let length = encoding.of(character);
            if left < length {
                return range.start + at;
            }
            left -= length;
        }
        range.end
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "param T : °C = 5 \"a²😀b\"\r\nx\n";

    /// Counted by hand: `°` and `²` have 2 bytes and 1 unit, the emoji 4 bytes and 2 units of
    /// UTF-16.
    #[test]
    fn positions_are_counted_in_the_negotiated_units() {
        let lines = Lines::new(TEXT);
        let at = TEXT.find('b').unwrap_or(0);
        let character = |encoding| lines.position(TEXT, at, encoding).character;
        assert_eq!((character(Encoding::Utf8), character(Encoding::Utf16), character(Encoding::Utf32)), (26, 22, 21));
    }

    #[test]
    fn every_position_leads_back_to_its_byte() {
        let lines = Lines::new(TEXT);
        for encoding in [Encoding::Utf8, Encoding::Utf16, Encoding::Utf32] {
            for (at, character) in TEXT.char_indices().filter(|(_, c)| !matches!(c, '\r' | '\n')) {
                let position = lines.position(TEXT, at, encoding);
                assert_eq!(lines.offset(TEXT, position, encoding), at, "{character}");
            }
        }
    }

    #[test]
    fn positions_beyond_a_line_or_inside_of_a_character_are_moved_to_the_nearest_boundary() {
        let lines = Lines::new(TEXT);
        let at = |line, character| lines.offset(TEXT, Position { line, character }, Encoding::Utf16);
        assert_eq!(at(0, 900), TEXT.find('\r').unwrap_or(0));
        assert_eq!(at(9, 3), TEXT.len());
        let emoji = TEXT.find('😀').unwrap_or(0);
        assert_eq!(at(0, 21), emoji);
    }

    #[test]
    fn lines_end_in_any_of_the_three_ways() {
        assert_eq!(Lines::new("a\rb\nc\r\nd").count(), 4);
    }
}
