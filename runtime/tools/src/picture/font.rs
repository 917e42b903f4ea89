//! Letters: DejaVu Sans Condensed, whose widths lay out every page and whose outlines are in the
//! bitmaps and PDF files.
//!
//! Programs that show an SVG file without this font take one that is hardly wider (see `svg`).

use std::sync::OnceLock;

use ttf_parser::{Face, GlyphId, OutlineBuilder};

/// Weight of letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Weight {
    /// Text.
    Regular,
    /// Headings.
    Bold,
}

impl Weight {
    /// The font's file.
    pub(super) fn file(self) -> &'static [u8] {
        match self {
            Weight::Regular => dejavu::sans_condensed::regular(),
            Weight::Bold => dejavu::sans_condensed::bold(),
        }
    }
}

/// The font of a weight; `None` only if its file were damaged.
pub(super) fn face(weight: Weight) -> Option<&'static Face<'static>> {
    static FACES: [OnceLock<Option<Face<'static>>>; 2] = [OnceLock::new(), OnceLock::new()];
    FACES[weight as usize].get_or_init(|| Face::parse(weight.file(), 0).ok()).as_ref()
}

/// The letter for a character, that for an unknown one where the font has none.
pub(super) fn glyph(face: &Face<'_>, character: char) -> GlyphId {
    face.glyph_index(character).unwrap_or_default()
}

/// Width of a letter, over the size.
pub(super) fn advance(face: &Face<'_>, glyph: GlyphId) -> f64 {
    f64::from(face.glyph_hor_advance(glyph).unwrap_or_default()) / f64::from(face.units_per_em())
}

/// Width of a text.
#[must_use]
pub(super) fn width(letters: &str, size: f64, weight: Weight) -> f64 {
    const USUAL: f64 = 0.55;
    let letter = |face: &Face<'_>, c: char| advance(face, glyph(face, c));
    size * letters.chars().map(|c| face(weight).map_or(USUAL, |face| letter(face, c))).sum::<f64>()
}

/// The size, at most `size`, at which a text is at most as wide than `room`.
#[must_use]
pub(super) fn fitting(letters: &str, size: f64, weight: Weight, room: f64) -> f64 {
    let wide = width(letters, size, weight);
    if wide > room && wide > 0.0 { size * room.max(0.0) / wide } else { size }
}

/// Draws the outline of a letter; coordinates are in units of the font, upwards.
pub(super) fn outline(face: &Face<'_>, glyph: GlyphId, pen: &mut dyn OutlineBuilder) {
    face.outline_glyph(glyph, pen);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Advances of the font's table `hmtx`, over 2048 units: A 1260, i 512, ° 922.
    #[test]
    fn widths_are_those_of_the_font() {
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(close(width("A", 2048.0, Weight::Regular), 1260.0), "{}", width("A", 2048.0, Weight::Regular));
        assert!(close(width("Ai", 10.0, Weight::Regular), 10.0 * (1260.0 + 512.0) / 2048.0), "{}", width("i", 2048.0, Weight::Regular));
        assert!(width("A", 10.0, Weight::Bold) > width("A", 10.0, Weight::Regular));
    }

    #[test]
    fn a_long_text_is_made_smaller_until_it_fits() {
        let text = "a name that is much too long for its place";
        let size = fitting(text, 11.0, Weight::Regular, 50.0);
        assert!(size < 11.0 && (width(text, size, Weight::Regular) - 50.0).abs() < 1e-9);
        assert_eq!(fitting("short", 11.0, Weight::Regular, 500.0), 11.0);
    }
}
