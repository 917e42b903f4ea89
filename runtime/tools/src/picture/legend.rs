//! Legend of a picture, in lines below its heading.

use super::colour;
use super::drawing::{Anchor, Colour, Drawing, Frame, Mark, Stroke, Text};
use super::font::{self, Weight};
use super::panel::{Body, MOST_RUNS, Panels, run_colour};
use super::run::Run;

/// Dashes of bounds and set-points.
pub(super) const BOUND: &[f64] = &[5.0, 3.0];
/// Dashes of set-points.
pub(super) const TARGET: &[f64] = &[1.5, 2.5];

const SIZE: f64 = 9.5;
const SYMBOL: f64 = 18.0;
const GAP: f64 = 16.0;
/// Height of a line.
pub(super) const LINE: f64 = 15.0;

/// A sign and its meaning.
#[derive(Clone, Debug)]
struct Entry {
    sign: Sign,
    meaning: String,
}

#[derive(Clone, Debug)]
enum Sign {
    Line(Stroke),
    Dot(Colour),
    Box(Colour),
    Event(Colour),
}

/// Lines of entries.
#[derive(Clone, Debug)]
pub(super) struct Legend {
    lines: Vec<Vec<Entry>>,
}

/// Names of the events of all runs, each once.
pub(super) fn event_names(runs: &[Run]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for (_, name) in runs.iter().flat_map(|run| &run.events) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    names
}

/// Colour of the event of that number.
pub(super) fn event_colour(index: usize) -> Colour {
    const COLOURS: [Colour; 5] = [Colour(0, 0, 0), colour::VERMILION, colour::PURPLE, colour::GREEN, colour::BLUE];
    COLOURS[index % COLOURS.len()]
}

impl Legend {
    /// The legend of panels and runs in lines no wider than `room`. `phases` are the names of those
    /// that occur, with their numbers.
    pub(super) fn new(panels: &Panels, runs: &[Run], phases: &[(usize, String)], room: f64) -> Self {
        let mut entries = run_entries(runs);
        entries.extend(guides(panels));
        let event = |(i, name): (usize, &str)| Entry { sign: Sign::Event(event_colour(i)), meaning: name.to_owned() };
        entries.extend(event_names(runs).into_iter().enumerate().map(event));
        let phase = |(i, name): &(usize, String)| Entry { sign: Sign::Box(colour::band(*i)), meaning: name.clone() };
        entries.extend(phases.iter().map(phase));
        let mut lines: Vec<Vec<Entry>> = Vec::new();
        let mut used = f64::INFINITY;
        for entry in entries {
            let wide = SYMBOL + 4.0 + font::width(&entry.meaning, SIZE, Weight::Regular) + GAP;
            match lines.last_mut() {
                Some(line) if used + wide <= room => line.push(entry),
                _ => {
                    lines.push(vec![entry]);
                    used = 0.0;
                }
            }
            used += wide;
        }
        Self { lines }
    }

    /// Its height.
    pub(super) fn height(&self) -> f64 {
        LINE * self.lines.len() as f64
    }

    /// Draws it.
    pub(super) fn draw(&self, drawing: &mut Drawing, left: f64, top: f64, room: f64) {
        for (i, line) in self.lines.iter().enumerate() {
            let base = top + LINE * i as f64 + 11.0;
            let mut x = left;
            for entry in line {
                entry.sign.draw(drawing, x, base - 3.5);
                let space = room - (x - left) - SYMBOL - 4.0;
                let size = font::fitting(&entry.meaning, SIZE, Weight::Regular, space);
                let (letters, colour) = (entry.meaning.clone(), colour::INK);
                let text = Text { x: x + SYMBOL + 4.0, y: base, size, anchor: Anchor::Start, colour, weight: Weight::Regular, letters };
                x += SYMBOL + 4.0 + text.width() + GAP;
                drawing.marks.push(Mark::Text(text));
            }
        }
    }
}

fn run_entries(runs: &[Run]) -> Vec<Entry> {
    let entry =
        |(i, run): (usize, &Run)| Entry { sign: Sign::Line(Stroke::full(run_colour(i, runs.len()), 2.0)), meaning: run.label.clone() };
    match runs.len() {
        0 | 1 => Vec::new(),
        n if n > MOST_RUNS => vec![Entry { sign: Sign::Line(Stroke::full(run_colour(0, n), 2.0)), meaning: format!("{n} runs") }],
        _ => runs.iter().enumerate().map(entry).collect(),
    }
}

fn guides(panels: &Panels) -> Vec<Entry> {
    let curves = || panels.panels.iter().filter_map(|p| if let Body::Curves(c) = &p.body { Some(c) } else { None });
    let entry = |shown: bool, sign: Sign, meaning: &str| shown.then(|| Entry { sign, meaning: meaning.to_owned() });
    let bound = entry(curves().any(|c| !c.bounds.is_empty()), Sign::Line(bound()), "bound");
    let target = entry(curves().any(|c| !c.targets.is_empty()), Sign::Line(target()), "set-point");
    let dots = entry(curves().flat_map(|c| &c.series).any(|s| s.dots), Sign::Dot(colour::INK), "observed");
    [bound, target, dots].into_iter().flatten().collect()
}

/// Style of bounds.
pub(super) fn bound() -> Stroke {
    Stroke { colour: Colour(90, 90, 90), width: 1.0, dashes: BOUND }
}

/// Style of set-points.
pub(super) fn target() -> Stroke {
    Stroke { colour: Colour(0, 0, 0), width: 1.6, dashes: TARGET }
}

impl Sign {
    fn draw(&self, drawing: &mut Drawing, x: f64, y: f64) {
        match self {
            Sign::Line(stroke) => drawing.line((x, y), (x + SYMBOL, y), stroke.clone()),
            Sign::Dot(colour) => drawing.marks.push(Mark::Dots(vec![(x + SYMBOL / 2.0, y)], 1.6, *colour)),
            Sign::Box(colour) => {
                let frame = Frame { x, y: y - 5.0, width: SYMBOL, height: 10.0 };
                drawing.marks.push(Mark::Rect(frame, *colour));
            }
            Sign::Event(colour) => {
                drawing.line((x + SYMBOL / 2.0, y - 5.0), (x + SYMBOL / 2.0, y + 5.0), Stroke::full(*colour, 1.0));
                triangle(drawing, x + SYMBOL / 2.0, y - 5.0, *colour);
            }
        }
    }
}

/// A small triangle that points down from `y`.
pub(super) fn triangle(drawing: &mut Drawing, x: f64, y: f64, colour: Colour) {
    drawing.marks.push(Mark::Polygon(vec![(x - 3.0, y), (x + 3.0, y), (x, y + 5.0)], colour));
}
