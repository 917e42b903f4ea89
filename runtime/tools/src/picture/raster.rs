//! Drawings as bitmaps.

use tiny_skia::{
    Color, FillRule, FilterQuality, LineJoin, Paint, PathBuilder, Pixmap, PixmapPaint, Rect, Stroke as SkiaStroke, StrokeDash, Transform,
};

use super::drawing::{Colour, Drawing, Frame, Mark, Stroke, Text};
use super::font;

/// Most pixels of a side.
const LARGEST: f64 = 20_000.0;

/// A picture of `scale` pixels for each pixel of the drawing; `None` where it would be empty or
/// beyond reason.
fn paint(drawing: &Drawing, scale: f64) -> Option<Pixmap> {
    let side = |length: f64| (length * scale).ceil().clamp(1.0, LARGEST) as u32;
    let mut map = Pixmap::new(side(drawing.width), side(drawing.height))?;
    let to_pixels = Transform::from_scale(scale as f32, scale as f32);
    for mark in &drawing.marks {
        match mark {
            Mark::Rect(frame, colour) => rectangle(&mut map, frame, *colour, to_pixels),
            Mark::Polygon(points, colour) => polygon(&mut map, points, *colour, to_pixels),
            Mark::Lines(pieces, stroke) => lines(&mut map, pieces, stroke, to_pixels),
            Mark::Dots(points, radius, colour) => dots(&mut map, points, *radius, *colour, to_pixels),
            Mark::Image { frame, columns, pixels } => image(&mut map, frame, *columns, pixels, to_pixels),
            Mark::Text(text) => letters(&mut map, text, to_pixels),
            Mark::Open(..) | Mark::Close => {}
        }
    }
    Some(map)
}

/// A PNG file; two pixels for each pixel of the drawing, which prints well.
///
/// # Errors
/// In words, where the picture is too large to be held.
pub(super) fn png(drawing: &Drawing) -> Result<Vec<u8>, String> {
    let map = paint(drawing, 2.0).ok_or("the picture is too large")?;
    map.encode_png().map_err(|error| error.to_string())
}

/// Red, green and blue of each pixel, row by row, with height and width.
///
/// # Errors
/// As [`png`].
pub(super) fn rgb(drawing: &Drawing, scale: f64) -> Result<(Vec<u8>, usize, usize), String> {
    let map = paint(drawing, scale).ok_or("the picture is too large")?;
    let bytes = map.pixels().iter().flat_map(|p| [p.red(), p.green(), p.blue()]).collect();
    Ok((bytes, map.height() as usize, map.width() as usize))
}

/// Cells as a PNG file of one pixel a cell.
pub(super) fn pixels_as_png(columns: usize, pixels: &[Colour]) -> Option<Vec<u8>> {
    cells(columns, pixels)?.encode_png().ok()
}

fn cells(columns: usize, pixels: &[Colour]) -> Option<Pixmap> {
    let rows = pixels.len().checked_div(columns)?;
    let mut map = Pixmap::new(u32::try_from(columns).ok()?, u32::try_from(rows).ok()?)?;
    for (out, c) in map.data_mut().chunks_exact_mut(4).zip(pixels) {
        out.copy_from_slice(&[c.0, c.1, c.2, 255]);
    }
    Some(map)
}

fn paint_of(colour: Colour) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color(Color::from_rgba8(colour.0, colour.1, colour.2, 255));
    paint.anti_alias = true;
    paint
}

fn rectangle(map: &mut Pixmap, frame: &Frame, colour: Colour, to_pixels: Transform) {
    if let Some(rect) = Rect::from_xywh(frame.x as f32, frame.y as f32, frame.width as f32, frame.height as f32) {
        map.fill_rect(rect, &paint_of(colour), to_pixels, None);
    }
}

fn polygon(map: &mut Pixmap, points: &[(f64, f64)], colour: Colour, to_pixels: Transform) {
    let mut path = PathBuilder::new();
    trace(&mut path, points);
    path.close();
    if let Some(path) = path.finish() {
        map.fill_path(&path, &paint_of(colour), FillRule::Winding, to_pixels, None);
    }
}

fn trace(path: &mut PathBuilder, points: &[(f64, f64)]) {
    for (i, &(x, y)) in points.iter().enumerate() {
        match i {
            0 => path.move_to(x as f32, y as f32),
            _ => path.line_to(x as f32, y as f32),
        }
    }
}

fn lines(map: &mut Pixmap, pieces: &[Vec<(f64, f64)>], stroke: &Stroke, to_pixels: Transform) {
    let mut path = PathBuilder::new();
    pieces.iter().for_each(|piece| trace(&mut path, piece));
    let dashes: Vec<f32> = stroke.dashes.iter().map(|d| *d as f32).collect();
    let pen = SkiaStroke {
        width: stroke.width as f32,
        line_join: LineJoin::Round,
        dash: if dashes.is_empty() { None } else { StrokeDash::new(dashes, 0.0) },
        ..SkiaStroke::default()
    };
    if let Some(path) = path.finish() {
        map.stroke_path(&path, &paint_of(stroke.colour), &pen, to_pixels, None);
    }
}

fn dots(map: &mut Pixmap, points: &[(f64, f64)], radius: f64, colour: Colour, to_pixels: Transform) {
    let mut path = PathBuilder::new();
    for &(x, y) in points {
        path.push_circle(x as f32, y as f32, radius as f32);
    }
    if let Some(path) = path.finish() {
        map.fill_path(&path, &paint_of(colour), FillRule::Winding, to_pixels, None);
    }
}

fn image(map: &mut Pixmap, frame: &Frame, columns: usize, pixels: &[Colour], to_pixels: Transform) {
    let Some(cells) = cells(columns, pixels) else { return };
    let stretch = Transform::from_row(
        (frame.width / f64::from(cells.width())) as f32,
        0.0,
        0.0,
        (frame.height / f64::from(cells.height())) as f32,
        frame.x as f32,
        frame.y as f32,
    );
    let paint = PixmapPaint { quality: FilterQuality::Nearest, ..PixmapPaint::default() };
    map.draw_pixmap(0, 0, cells.as_ref(), &paint, stretch.post_concat(to_pixels), None);
}

/// A pen that writes outlines of letters into a path.
struct Outline {
    path: PathBuilder,
    x: f32,
    y: f32,
    scale: f32,
}

impl Outline {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + self.scale * x, self.y - self.scale * y)
    }
}

impl ttf_parser::OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

fn letters(map: &mut Pixmap, text: &Text, to_pixels: Transform) {
    let Some(face) = font::face(text.weight) else { return };
    let scale = (text.size / f64::from(face.units_per_em())) as f32;
    let mut pen = Outline { path: PathBuilder::new(), x: text.left() as f32, y: text.y as f32, scale };
    for character in text.letters.chars() {
        let glyph = font::glyph(face, character);
        font::outline(face, glyph, &mut pen);
        pen.x += (text.size * font::advance(face, glyph)) as f32;
    }
    if let Some(path) = pen.path.finish() {
        map.fill_path(&path, &paint_of(text.colour), FillRule::Winding, to_pixels, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_painted_in_their_places_and_colours() {
        let (red, blue) = (Colour(255, 0, 0), Colour(0, 0, 255));
        let mut drawing = Drawing::new(20.0, 20.0, "");
        let frame = Frame { x: 4.0, y: 6.0, width: 10.0, height: 8.0 };
        drawing.marks.push(Mark::Image { frame, columns: 2, pixels: vec![red, blue, blue, red] });
        let (bytes, height, width) = rgb(&drawing, 1.0).expect("small");
        let at = |x: usize, y: usize| Colour(bytes[3 * (y * width + x)], bytes[3 * (y * width + x) + 1], bytes[3 * (y * width + x) + 2]);
        assert_eq!((height, width), (20, 20));
        assert_eq!([at(6, 8), at(12, 8), at(6, 12), at(12, 12), at(1, 1)], [red, blue, blue, red, Colour(255, 255, 255)]);
    }
}
