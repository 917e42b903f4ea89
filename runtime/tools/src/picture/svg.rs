//! Drawings as SVG.

use std::fmt::Write;

use super::drawing::{Anchor, Colour, Drawing, Frame, Group, Mark, Stroke, Text};
use super::font::Weight;
use super::raster;

/// The font of the layout, then ones of nearly its widths.
const FAMILIES: &str = "'DejaVu Sans Condensed','DejaVu Sans',Arial,Helvetica,sans-serif";

/// The drawing as the text of an SVG file.
#[must_use]
pub(super) fn text(drawing: &Drawing) -> String {
    let mut out = String::with_capacity(64 * 1024);
    let (w, h) = (number(drawing.width), number(drawing.height));
    // Writing into a string cannot fail; so in all of this file.
    let _ = write!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" role=\"img\" \
         font-family=\"{FAMILIES}\" font-stretch=\"condensed\">\n<title>{}</title>\n",
        escaped(&drawing.title)
    );
    clips(&mut out, drawing);
    for mark in &drawing.marks {
        write_mark(&mut out, mark);
    }
    out.push_str("</svg>\n");
    out
}

/// Visible part of the groups of curves.
fn clips(out: &mut String, drawing: &Drawing) {
    out.push_str("<defs>\n");
    for mark in &drawing.marks {
        if let Mark::Open(Group::Curves(panel), frame) = mark {
            let _ = writeln!(out, "<clipPath id=\"seen-{panel}\"><rect {}/></clipPath>", rectangle(frame));
        }
    }
    out.push_str("</defs>\n");
}

fn write_mark(out: &mut String, mark: &Mark) {
    let _ = match mark {
        Mark::Rect(frame, colour) => writeln!(out, "<rect {} fill=\"{}\"/>", rectangle(frame), hex(*colour)),
        Mark::Polygon(points, colour) => writeln!(out, "<polygon points=\"{}\" fill=\"{}\"/>", listed(points), hex(*colour)),
        Mark::Lines(pieces, stroke) => writeln!(out, "<path d=\"{}\" fill=\"none\" {}/>", path(pieces), stroked(stroke)),
        Mark::Dots(points, radius, colour) => writeln!(
            out,
            "<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-linecap=\"round\" vector-effect=\"non-scaling-stroke\"/>",
            points.iter().map(|p| format!("M{} {}h0", number(p.0), number(p.1))).collect::<String>(),
            hex(*colour),
            number(2.0 * radius)
        ),
        Mark::Image { frame, columns, pixels } => image(out, frame, *columns, pixels),
        Mark::Text(text) => write_text(out, text),
        Mark::Open(Group::Curves(panel), _) => {
            writeln!(out, "<g clip-path=\"url(#seen-{panel})\"><g class=\"curves\" data-panel=\"{panel}\">")
        }
        Mark::Open(Group::Ticks(panel), _) => writeln!(out, "<g><g class=\"ticks\" data-panel=\"{panel}\">"),
        Mark::Close => writeln!(out, "</g></g>"),
    };
}

fn write_text(out: &mut String, text: &Text) -> std::fmt::Result {
    let anchor = match text.anchor {
        Anchor::Start => "",
        Anchor::Middle => " text-anchor=\"middle\"",
        Anchor::End => " text-anchor=\"end\"",
    };
    let weight = if text.weight == Weight::Bold { " font-weight=\"bold\"" } else { "" };
    let (x, y, size, colour) = (number(text.x), number(text.y), number(text.size), hex(text.colour));
    writeln!(out, "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\" fill=\"{colour}\"{anchor}{weight}>{}</text>", escaped(&text.letters))
}

fn image(out: &mut String, frame: &Frame, columns: usize, pixels: &[Colour]) -> std::fmt::Result {
    let Some(png) = raster::pixels_as_png(columns, pixels) else { return Ok(()) };
    writeln!(
        out,
        "<image {} preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{}\"/>",
        rectangle(frame),
        base64(&png)
    )
}

fn rectangle(frame: &Frame) -> String {
    let [x, y, w, h] = [frame.x, frame.y, frame.width, frame.height].map(number);
    format!("x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\"")
}

fn stroked(stroke: &Stroke) -> String {
    let mut text = format!(
        "stroke=\"{}\" stroke-width=\"{}\" stroke-linejoin=\"round\" vector-effect=\"non-scaling-stroke\"",
        hex(stroke.colour),
        number(stroke.width)
    );
    if !stroke.dashes.is_empty() {
        let dashes: Vec<String> = stroke.dashes.iter().map(|d| number(*d)).collect();
        let _ = write!(text, " stroke-dasharray=\"{}\"", dashes.join(" "));
    }
    text
}

fn path(pieces: &[Vec<(f64, f64)>]) -> String {
    let mut out = String::new();
    for piece in pieces {
        for (i, (x, y)) in piece.iter().enumerate() {
            let command = if i == 0 { 'M' } else { 'L' };
            let _ = write!(out, "{command}{} {}", number(*x), number(*y));
        }
    }
    out
}

fn listed(points: &[(f64, f64)]) -> String {
    points.iter().map(|(x, y)| format!("{},{}", number(*x), number(*y))).collect::<Vec<_>>().join(" ")
}

/// A length to a hundredth of a pixel.
fn number(x: f64) -> String {
    let text = format!("{x:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

pub(super) fn hex(colour: Colour) -> String {
    format!("#{:02x}{:02x}{:02x}", colour.0, colour.1, colour.2)
}

/// Text within an element or an attribute. Characters that XML does not know are left out.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if (c < ' ' && !matches!(c, '\t' | '\n')) || matches!(c, '\u{fffe}' | '\u{ffff}') => {}
            c => out.push(c),
        }
    }
    out
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let at = |i: usize| u32::from(chunk.get(i).copied().unwrap_or_default());
        let word = (at(0) << 16) | (at(1) << 8) | at(2);
        for digit in 0..4 {
            let value = (word >> (18 - 6 * digit)) as usize & 63;
            out.push(if digit <= chunk.len() { DIGITS[value] as char } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test vectors of RFC 4648, section 10.
    #[test]
    fn bytes_become_base64() {
        for (bytes, text) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("fooba", "Zm9vYmE="), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    #[test]
    fn names_with_signs_of_markup_stay_what_they_are() {
        let mut drawing = Drawing::new(10.0, 10.0, "a < b & \"c\"\u{1}");
        let letters = "p<q> & 'r'".to_owned();
        let text = Text { x: 1.0, y: 5.0, size: 5.0, anchor: Anchor::Start, colour: Colour(0, 0, 0), weight: Weight::Bold, letters };
        drawing.marks.push(Mark::Text(text));
        let svg = super::text(&drawing);
        let tree = roxmltree::Document::parse(&svg).expect("XML");
        let texts: Vec<&str> = tree.descendants().filter(|n| n.has_tag_name("text")).filter_map(|n| n.text()).collect();
        assert_eq!(texts, ["p<q> & 'r'"]);
        assert_eq!(tree.descendants().find(|n| n.has_tag_name("title")).and_then(|n| n.text()), Some("a < b & \"c\""));
    }
}
