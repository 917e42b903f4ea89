//! Drawings as PDF files of one page, with the letters that they use embedded, so that text can be
//! searched and copied.

use std::collections::BTreeMap;

use miniz_oxide::deflate::compress_to_vec_zlib;
use pdf_writer::types::{CidFontType, FontFlags, SystemInfo, UnicodeCmap};
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str, TextStr};
use subsetter::GlyphRemapper;
use ttf_parser::Face;

use super::drawing::{Colour, Drawing, Mark, Stroke, Text};
use super::font::{self, Weight};

/// Points of a pixel: 72 over 96.
const POINT: f64 = 0.75;

const LEVEL: u8 = 6;

/// Letters of one weight, numbered as they are first used.
struct Letters {
    weight: Weight,
    face: &'static Face<'static>,
    used: GlyphRemapper,
    characters: BTreeMap<u16, char>,
}

impl Letters {
    fn new(weight: Weight) -> Option<Self> {
        Some(Self { weight, face: font::face(weight)?, used: GlyphRemapper::new(), characters: BTreeMap::new() })
    }

    /// Two bytes a letter.
    fn encode(&mut self, letters: &str) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(2 * letters.len());
        for character in letters.chars() {
            let number = self.used.remap(font::glyph(self.face, character).0);
            self.characters.entry(number).or_insert(character);
            bytes.extend(number.to_be_bytes());
        }
        bytes
    }

    fn name(&self) -> &'static [u8] {
        if self.weight == Weight::Bold { b"FB" } else { b"FR" }
    }

    fn full_name(&self) -> &'static [u8] {
        if self.weight == Weight::Bold { b"SMPLPL+DejaVuSansCondensed-Bold" } else { b"SMPLPL+DejaVuSansCondensed" }
    }
}

/// A page as it is written.
struct Page {
    content: Content,
    height: f64,
    fonts: Vec<Letters>,
    images: Vec<(usize, Vec<u8>)>,
}

/// A PDF file.
///
/// # Errors
/// In words, where letters cannot be embedded.
pub(super) fn file(drawing: &Drawing) -> Result<Vec<u8>, String> {
    let fonts = [Weight::Regular, Weight::Bold].into_iter().filter_map(Letters::new).collect();
    let mut page = Page { content: Content::new(), height: drawing.height, fonts, images: Vec::new() };
    let point = POINT as f32;
    page.content.transform([point, 0.0, 0.0, point, 0.0, 0.0]);
    for mark in &drawing.marks {
        page.write(mark);
    }
    page.finish(drawing)
}

impl Page {
    fn at(&self, (x, y): (f64, f64)) -> (f32, f32) {
        (x as f32, (self.height - y) as f32)
    }

    fn write(&mut self, mark: &Mark) {
        match mark {
            Mark::Rect(frame, colour) => {
                self.fill(*colour);
                let (x, y) = self.at((frame.x, frame.bottom()));
                self.content.rect(x, y, frame.width as f32, frame.height as f32).fill_nonzero();
            }
            Mark::Polygon(points, colour) => {
                self.fill(*colour);
                self.trace(points);
                self.content.close_path().fill_nonzero();
            }
            Mark::Lines(pieces, stroke) => self.lines(pieces, stroke),
            Mark::Dots(points, radius, colour) => self.dots(points, *radius, *colour),
            Mark::Image { frame, columns, pixels } => {
                let (x, y) = self.at((frame.x, frame.bottom()));
                let name = format!("I{}", self.images.len());
                self.images.push((*columns, pixels.iter().flat_map(|c| [c.0, c.1, c.2]).collect()));
                self.content.save_state().transform([frame.width as f32, 0.0, 0.0, frame.height as f32, x, y]);
                self.content.x_object(Name(name.as_bytes())).restore_state();
            }
            Mark::Text(text) => self.text(text),
            Mark::Open(..) | Mark::Close => {}
        }
    }

    fn fill(&mut self, colour: Colour) {
        let [r, g, b] = [colour.0, colour.1, colour.2].map(|c| f32::from(c) / 255.0);
        self.content.set_fill_rgb(r, g, b);
    }

    fn pen(&mut self, colour: Colour, width: f64) {
        let [r, g, b] = [colour.0, colour.1, colour.2].map(|c| f32::from(c) / 255.0);
        self.content.set_stroke_rgb(r, g, b).set_line_width(width as f32);
    }

    fn trace(&mut self, points: &[(f64, f64)]) {
        for (i, point) in points.iter().enumerate() {
            let (x, y) = self.at(*point);
            match i {
                0 => self.content.move_to(x, y),
                _ => self.content.line_to(x, y),
            };
        }
    }

    fn lines(&mut self, pieces: &[Vec<(f64, f64)>], stroke: &Stroke) {
        self.pen(stroke.colour, stroke.width);
        self.content.set_line_join(pdf_writer::types::LineJoinStyle::RoundJoin);
        self.content.set_line_cap(pdf_writer::types::LineCapStyle::ButtCap);
        self.content.set_dash_pattern(stroke.dashes.iter().map(|d| *d as f32), 0.0);
        for piece in pieces {
            self.trace(piece);
        }
        self.content.stroke();
    }

    /// A dot is a line of no length with round ends.
    fn dots(&mut self, points: &[(f64, f64)], radius: f64, colour: Colour) {
        self.pen(colour, 2.0 * radius);
        self.content.set_line_cap(pdf_writer::types::LineCapStyle::RoundCap).set_dash_pattern([], 0.0);
        for point in points {
            self.trace(&[*point, *point]);
        }
        self.content.stroke();
    }

    fn text(&mut self, text: &Text) {
        let (x, y) = self.at((text.left(), text.y));
        self.fill(text.colour);
        let Some(font) = self.fonts.iter_mut().find(|font| font.weight == text.weight) else { return };
        let bytes = font.encode(&text.letters);
        self.content.begin_text().set_font(Name(font.name()), text.size as f32);
        self.content.next_line(x, y).show(Str(&bytes)).end_text();
    }

    fn finish(self, drawing: &Drawing) -> Result<Vec<u8>, String> {
        let mut next = Ref::new(1);
        let [catalog, pages, page, content, info] = std::array::from_fn(|_| next.bump());
        let mut pdf = Pdf::new();
        pdf.catalog(catalog).pages(pages);
        pdf.pages(pages).kids([page]).count(1);
        pdf.document_info(info).title(TextStr(&drawing.title)).producer(TextStr("smpl"));
        let fonts: Vec<(&Letters, Ref)> = self.fonts.iter().filter(|f| !f.characters.is_empty()).map(|f| (f, next.bump())).collect();
        let images: Vec<Ref> = self.images.iter().map(|_| next.bump()).collect();
        let mut sheet = pdf.page(page);
        let (width, height) = ((drawing.width * POINT) as f32, (drawing.height * POINT) as f32);
        sheet.media_box(Rect::new(0.0, 0.0, width, height)).parent(pages).contents(content);
        let mut resources = sheet.resources();
        resources.fonts().pairs(fonts.iter().map(|(font, at)| (Name(font.name()), *at)));
        let names: Vec<String> = (0..images.len()).map(|i| format!("I{i}")).collect();
        resources.x_objects().pairs(names.iter().zip(&images).map(|(name, at)| (Name(name.as_bytes()), *at)));
        resources.finish();
        sheet.finish();
        let stream = compress_to_vec_zlib(&self.content.finish(), LEVEL);
        pdf.stream(content, &stream).filter(Filter::FlateDecode);
        for ((columns, bytes), at) in self.images.iter().zip(images) {
            write_image(&mut pdf, at, *columns, bytes);
        }
        for (font, at) in fonts {
            write_font(&mut pdf, &mut next, font, at)?;
        }
        Ok(pdf.finish())
    }
}

fn write_image(pdf: &mut Pdf, at: Ref, columns: usize, bytes: &[u8]) {
    let rows = bytes.len() / (3 * columns.max(1));
    let data = compress_to_vec_zlib(bytes, LEVEL);
    let mut image = pdf.image_xobject(at, &data);
    image.filter(Filter::FlateDecode);
    image.width(columns as i32).height(rows as i32);
    image.color_space().device_rgb();
    image.bits_per_component(8).interpolate(false);
}

/// The letters that are used, as a composite font (ISO 32000-1, 9.7).
fn write_font(pdf: &mut Pdf, next: &mut Ref, font: &Letters, at: Ref) -> Result<(), String> {
    const SYSTEM: SystemInfo<'_> = SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"Identity"), supplement: 0 };
    let [cid, descriptor, file, map] = std::array::from_fn(|_| next.bump());
    let name = Name(font.full_name());
    let face = font.face;
    let thousandth = |x: i16| f32::from(x) * 1000.0 / f32::from(face.units_per_em());
    pdf.type0_font(at).base_font(name).encoding_predefined(Name(b"Identity-H")).descendant_font(cid).to_unicode(map);
    let mut cid_font = pdf.cid_font(cid);
    cid_font.subtype(CidFontType::Type2).base_font(name).system_info(SYSTEM).font_descriptor(descriptor);
    cid_font.cid_to_gid_map_predefined(Name(b"Identity")).default_width(0.0);
    let width = |glyph: u16| 1000.0 * font::advance(face, ttf_parser::GlyphId(glyph)) as f32;
    cid_font.widths().consecutive(0, font.used.remapped_gids().map(width));
    cid_font.finish();
    let bounds = face.global_bounding_box();
    let frame = Rect::new(thousandth(bounds.x_min), thousandth(bounds.y_min), thousandth(bounds.x_max), thousandth(bounds.y_max));
    pdf.font_descriptor(descriptor)
        .name(name)
        .flags(FontFlags::SYMBOLIC)
        .bbox(frame)
        .italic_angle(0.0)
        .ascent(thousandth(face.ascender()))
        .descent(thousandth(face.descender()))
        .cap_height(thousandth(face.capital_height().unwrap_or(face.ascender())))
        .stem_v(80.0)
        .font_file2(file);
    let subset = subsetter::subset(font.weight.file(), 0, &font.used).map_err(|error| error.to_string())?;
    pdf.stream(file, &compress_to_vec_zlib(&subset, LEVEL)).filter(Filter::FlateDecode);
    let mut unicode = UnicodeCmap::new(Name(b"Custom"), SYSTEM);
    font.characters.iter().for_each(|(number, character)| unicode.pair(*number, *character));
    pdf.cmap(map, &unicode.finish()).finish();
    Ok(())
}
