//! The one drawing behind every format: a list of marks on a page, in the order in which they are
//! painted.
//!
//! Lengths are in pixels of 1/96 inch, the origin is the upper left corner. All colours are opaque,
//! so that every format shows the same.

use super::font::{self, Weight};

/// A colour: red, green, blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour(pub u8, pub u8, pub u8);

/// A rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Left edge.
    pub x: f64,
    /// Upper edge.
    pub y: f64,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

impl Frame {
    /// Right edge.
    #[must_use]
    pub fn right(&self) -> f64 {
        self.x + self.width
    }

    /// Lower edge.
    #[must_use]
    pub fn bottom(&self) -> f64 {
        self.y + self.height
    }

    /// Returns `true` if two rectangles share more than an edge.
    #[must_use]
    pub fn overlaps(&self, other: &Self) -> bool {
        self.x < other.right() && other.x < self.right() && self.y < other.bottom() && other.y < self.bottom()
    }
}

/// Style of a line.
#[derive(Clone, Debug, PartialEq)]
pub struct Stroke {
    /// Colour.
    pub colour: Colour,
    /// Width.
    pub width: f64,
    /// Lengths of dashes and gaps; empty for a full line.
    pub dashes: &'static [f64],
}

impl Stroke {
    /// A full line.
    #[must_use]
    pub fn full(colour: Colour, width: f64) -> Self {
        Self { colour, width, dashes: &[] }
    }
}

/// Anchor of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Its beginning.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

/// One line of text.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// Place of the anchor.
    pub x: f64,
    /// Base line.
    pub y: f64,
    /// Size of the letters.
    pub size: f64,
    /// Anchor.
    pub anchor: Anchor,
    /// Colour.
    pub colour: Colour,
    /// Weight.
    pub weight: Weight,
    /// The letters.
    pub letters: String,
}

/// Height of letters above the base line, and depth below it, over their size.
const ASCENT: f64 = 0.76;
const DEPTH: f64 = 0.24;

impl Text {
    /// Its width.
    #[must_use]
    pub fn width(&self) -> f64 {
        font::width(&self.letters, self.size, self.weight)
    }

    /// Start of its letters.
    #[must_use]
    pub fn left(&self) -> f64 {
        match self.anchor {
            Anchor::Start => self.x,
            Anchor::Middle => self.x - self.width() / 2.0,
            Anchor::End => self.x - self.width(),
        }
    }

    /// The rectangle that its letters fill.
    #[must_use]
    pub fn frame(&self) -> Frame {
        let height = (ASCENT + DEPTH) * self.size;
        Frame { x: self.left(), y: self.y - ASCENT * self.size, width: self.width(), height }
    }
}

/// Owner of the marks between [`Mark::Open`] and [`Mark::Close`], for interactive pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// Marks that follow the abscissa of a panel: curves, bands, marks.
    Curves(usize),
    /// Ticks of its abscissa with their labels.
    Ticks(usize),
}

/// One mark.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// A filled rectangle.
    Rect(Frame, Colour),
    /// A filled polygon.
    Polygon(Vec<(f64, f64)>, Colour),
    /// Lines through points; each piece on its own.
    Lines(Vec<Vec<(f64, f64)>>, Stroke),
    /// Dots of a radius.
    Dots(Vec<(f64, f64)>, f64, Colour),
    /// Cells of equal size, row by row from the upper left.
    Image {
        /// Place.
        frame: Frame,
        /// Cells of a row.
        columns: usize,
        /// Their colours.
        pixels: Vec<Colour>,
    },
    /// Text.
    Text(Text),
    /// Begins a group; groups are not nested. The rectangle is what may be seen of it.
    Open(Group, Frame),
    /// Ends it.
    Close,
}

/// A page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
    /// Alternative text of the picture.
    pub title: String,
    /// Marks, painted in order.
    pub marks: Vec<Mark>,
}

impl Drawing {
    /// An empty white page.
    #[must_use]
    pub fn new(width: f64, height: f64, title: impl Into<String>) -> Self {
        let page = Frame { x: 0.0, y: 0.0, width, height };
        Self { width, height, title: title.into(), marks: vec![Mark::Rect(page, Colour(255, 255, 255))] }
    }

    /// The texts, in order.
    pub fn texts(&self) -> impl Iterator<Item = &Text> {
        self.marks.iter().filter_map(|mark| match mark {
            Mark::Text(text) => Some(text),
            _ => None,
        })
    }

    /// A straight line.
    pub fn line(&mut self, from: (f64, f64), to: (f64, f64), stroke: Stroke) {
        self.marks.push(Mark::Lines(vec![vec![from, to]], stroke));
    }

    /// A rectangle's edge.
    pub(crate) fn outline(&mut self, frame: Frame, stroke: Stroke) {
        let (l, t, r, b) = (frame.x, frame.y, frame.right(), frame.bottom());
        self.marks.push(Mark::Lines(vec![vec![(l, t), (r, t), (r, b), (l, b), (l, t)]], stroke));
    }
}
