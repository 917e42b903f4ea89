//! Panels on a page: a grid that fits a sheet, with a heading, a legend, and room for every label.

use super::axis::Axis;
use super::colour;
use super::drawing::{Anchor, Colour, Drawing, Frame, Mark, Text};
use super::font::{self, Weight};
use super::legend::Legend;
use super::panel::{Body, Panel, Panels};
use super::quantity::bracketed;
use super::run::Run;

/// Width of a page: that of a sheet of A4 across, at 96 pixels an inch.
const WIDTH: f64 = 1123.0;
/// Height of a sheet across, and of one upright of the same width.
const ACROSS: f64 = 794.0;
const UPRIGHT: f64 = 1588.0;
const MARGIN: f64 = 18.0;
/// Height of a cell of the grid.
const LOWEST: f64 = 150.0;
const HIGHEST: f64 = 250.0;
/// Size of tick labels.
pub(super) const LABEL: f64 = 9.0;
const NAME: f64 = 11.0;
/// Room next to the plot of a map for its scale.
pub(super) const SCALE: f64 = 44.0;
/// Width of the bar of that scale.
pub(super) const BAR: f64 = 9.0;
const SERIES: f64 = 13.0;
/// Height of a line of the footer.
const FOOT: f64 = 13.0;

/// Heading of the page.
#[derive(Clone, Debug, Default)]
pub struct Heading {
    /// First line.
    pub title: String,
    /// Second line; may be empty.
    pub note: String,
    /// Names of the phases, by their numbers.
    pub phases: Vec<String>,
}

/// A panel with its place.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    /// Area of the curves.
    pub plot: Frame,
    /// Abscissa.
    pub x: Axis,
    /// Ordinate; that of the colours of a map.
    pub y: Axis,
    /// Space of a map, upwards.
    pub space: Option<Axis>,
    /// Upper edge of the cell.
    pub top: f64,
    /// Its whole width.
    pub cell: (f64, f64),
    /// The name of the abscissa is below.
    pub names_abscissa: bool,
    /// Names of phases are above.
    pub names_phases: bool,
}

impl Placed {
    /// Place of a value of the abscissa.
    pub(super) fn across(&self, x: f64) -> f64 {
        self.plot.x + self.x.share(x) * self.plot.width
    }

    /// Place of a value of the ordinate.
    pub(super) fn up(&self, y: f64) -> f64 {
        self.plot.bottom() - self.y.share(y) * self.plot.height
    }
}

/// A page with the places of its panels.
pub(super) struct Page {
    pub drawing: Drawing,
    pub placed: Vec<Placed>,
}

/// Height of the strip with the names of phases.
pub(super) const STRIP: f64 = 13.0;

/// Lays panels out and draws what is around them.
pub(super) fn page(panels: &Panels, runs: &[Run], heading: &Heading) -> Page {
    let width = if panels.panels.len() == 1 { 760.0 } else { WIDTH };
    let room = width - 2.0 * MARGIN;
    let occurring = phases(runs, heading);
    let legend = Legend::new(panels, runs, &occurring, room);
    let top = MARGIN + 20.0 + if heading.note.is_empty() { 0.0 } else { 15.0 } + legend.height() + 6.0;
    let grid = Grid::new(panels, width, top, !occurring.is_empty());
    let mut footer = wrapped("Constant", &panels.constants, room);
    footer.extend(wrapped("Not shown, name them in --show", &panels.left_out, room));
    let height = grid.bottom() + FOOT * footer.len() as f64 + MARGIN;
    let mut drawing = Drawing::new(width, height, heading.title.clone());
    write_heading(&mut drawing, heading, room);
    legend.draw(&mut drawing, MARGIN, top - legend.height() - 6.0, room);
    let placed: Vec<Placed> = panels.panels.iter().enumerate().map(|(i, panel)| grid.place(i, panel, panels)).collect();
    for (panel, place) in panels.panels.iter().zip(&placed) {
        write_names(&mut drawing, panel, place, panels);
    }
    for (i, letters) in footer.into_iter().enumerate() {
        let y = grid.bottom() + FOOT * (i + 1) as f64;
        let (size, weight) = (font::fitting(&letters, LABEL + 0.5, Weight::Regular, room), Weight::Regular);
        drawing.marks.push(Mark::Text(Text { x: MARGIN, y, size, anchor: Anchor::Start, colour: colour::GREY, weight, letters }));
    }
    Page { drawing, placed }
}

/// Most entries of a note below the panels.
const MOST_NOTED: usize = 30;

/// A note below the panels, in lines no wider than `room`: how many entries there are, and the
/// first of them.
fn wrapped(heading: &str, entries: &[String], room: f64) -> Vec<String> {
    let mut words: Vec<String> = entries.iter().take(MOST_NOTED).map(|entry| format!("{entry};")).collect();
    if entries.len() > MOST_NOTED {
        words.push(format!("and {} more", entries.len() - MOST_NOTED));
    } else if let Some(last) = words.last_mut() {
        last.pop();
    }
    let mut lines: Vec<String> = Vec::new();
    for word in words {
        match lines.last_mut() {
            Some(line) if font::width(&format!("{line} {word}"), LABEL + 0.5, Weight::Regular) <= room => {
                line.push_str(&format!(" {word}"))
            }
            Some(_) => lines.push(word),
            None if entries.len() > 1 => lines.push(format!("{heading} ({}): {word}", entries.len())),
            None => lines.push(format!("{heading}: {word}")),
        }
    }
    lines
}

/// The phases that occur, by number, with their names.
fn phases(runs: &[Run], heading: &Heading) -> Vec<(usize, String)> {
    let [run] = runs else { return Vec::new() };
    let mut numbers: Vec<usize> = run.phases.iter().map(|(_, number)| *number).collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers.into_iter().map(|i| (i, phase_name(heading, i))).collect()
}

/// Name of a phase, as far as it is known.
pub(super) fn phase_name(heading: &Heading, index: usize) -> String {
    heading.phases.get(index).cloned().unwrap_or_else(|| format!("phase {}", index + 1))
}

fn write_heading(drawing: &mut Drawing, heading: &Heading, room: f64) {
    let line = |letters: &str, y: f64, size: f64, colour: Colour, weight: Weight| {
        let size = font::fitting(letters, size, weight, room);
        Mark::Text(Text { x: MARGIN, y, size, anchor: Anchor::Start, colour, weight, letters: letters.to_owned() })
    };
    drawing.marks.push(line(&heading.title, MARGIN + 12.0, 14.0, colour::INK, Weight::Bold));
    if !heading.note.is_empty() {
        drawing.marks.push(line(&heading.note, MARGIN + 30.0, 10.5, colour::GREY, Weight::Regular));
    }
}

/// Grid of a page.
struct Grid {
    columns: usize,
    count: usize,
    width: f64,
    top: f64,
    cell: f64,
    strip: bool,
    /// Left room of each column for labels.
    left: Vec<f64>,
    /// Height of the names of series in each row, and rows that have names of abscissae.
    named: Vec<f64>,
    abscissae: Vec<bool>,
}

impl Grid {
    fn new(panels: &Panels, width: f64, top: f64, strip: bool) -> Self {
        let count = panels.panels.len();
        let columns = match count {
            0 | 1 => 1,
            2..=4 => 2,
            5..=15 => 3,
            _ => 4,
        };
        let rows = count.div_ceil(columns).max(1);
        let page = if top + MARGIN + rows as f64 * LOWEST <= ACROSS { ACROSS } else { UPRIGHT };
        let cell = ((page - top - MARGIN) / rows as f64).clamp(LOWEST, HIGHEST);
        let mut grid = Self { columns, count, width, top, cell, strip, left: vec![0.0; columns], named: vec![], abscissae: vec![] };
        let row = |r: usize| &panels.panels[(r * columns).min(count)..((r + 1) * columns).min(count)];
        let room = grid.cell_width();
        grid.named = (0..rows).map(|r| row(r).iter().map(|p| SERIES * name_lines(p, room) as f64).fold(0.0, f64::max)).collect();
        grid.abscissae = (0..rows).map(|r| (r * columns..((r + 1) * columns).min(count)).any(|i| grid.is_free(i, panels))).collect();
        for (i, panel) in panels.panels.iter().enumerate() {
            let labels = grid.label_room(i, panel);
            grid.left[i % columns] = grid.left[i % columns].max(labels);
        }
        grid
    }

    /// Width that names may have.
    fn cell_width(&self) -> f64 {
        (self.width - 2.0 * MARGIN) / self.columns as f64 - 10.0
    }

    fn bottom(&self) -> f64 {
        self.top + self.cell * self.count.div_ceil(self.columns).max(1) as f64
    }

    /// Returns `true` if the name of the abscissa is below a panel: it is not time, or time of no
    /// panel is below.
    fn is_free(&self, index: usize, panels: &Panels) -> bool {
        let over_space = |i: usize| panels.panels.get(i).is_none_or(|p| p.over_space);
        over_space(index) || over_space(index + self.columns)
    }

    /// Vertical room: above the plot and below it.
    fn above_and_below(&self, row: usize) -> (f64, f64) {
        let above = NAME + 9.0 + self.named[row] + if self.strip && row == 0 { STRIP } else { 0.0 };
        let below = LABEL + 7.0 + if self.abscissae[row] { LABEL + 4.0 } else { 0.0 } + 10.0;
        (above, below)
    }

    fn plot_height(&self, row: usize) -> f64 {
        let (above, below) = self.above_and_below(row);
        self.cell - above - below
    }

    /// Width of the labels of an ordinate.
    fn label_room(&self, index: usize, panel: &Panel) -> f64 {
        let axis = match &panel.body {
            Body::Curves(curves) => ordinate(curves.range, self.plot_height(index / self.columns)),
            Body::Map(map) => map.upwards(self.plot_height(index / self.columns)),
        };
        let labels: Vec<String> = axis.ticks.iter().map(|t| axis.label(*t)).collect();
        widest(&labels) + 8.0
    }

    fn place(&self, index: usize, panel: &Panel, panels: &Panels) -> Placed {
        let (row, column) = (index / self.columns, index % self.columns);
        let cell = (self.width - 2.0 * MARGIN) / self.columns as f64;
        let (x, top) = (MARGIN + cell * column as f64, self.top + self.cell * row as f64);
        let (above, _) = self.above_and_below(row);
        let scale = if matches!(panel.body, Body::Map(_)) { SCALE } else { 0.0 };
        let left = self.left[column];
        let plot = Frame { x: x + left, y: top + above, width: cell - left - scale - 16.0, height: self.plot_height(row) };
        let (low, high) = if panel.over_space { space(panel) } else { panels.time };
        let y = match &panel.body {
            Body::Curves(curves) => ordinate(curves.range, plot.height),
            Body::Map(map) => ordinate(map.range, plot.height),
        };
        let space = match &panel.body {
            Body::Map(map) => Some(map.upwards(plot.height)),
            Body::Curves(_) => None,
        };
        Placed {
            plot,
            space,
            x: abscissa(low, high, plot.width),
            y,
            top,
            cell: (x, cell - 10.0),
            names_abscissa: self.is_free(index, panels),
            names_phases: self.strip && row == 0 && !panel.over_space,
        }
    }
}

fn ordinate((low, high): (f64, f64), height: f64) -> Axis {
    Axis::new(low, high, ((height / 24.0) as usize).clamp(2, 8))
}

/// An axis whose labels do not touch.
fn abscissa(low: f64, high: f64, width: f64) -> Axis {
    let mut most = ((width / 40.0) as usize).clamp(2, 12);
    loop {
        let axis = Axis::new(low, high, most);
        let labels: Vec<String> = axis.ticks.iter().map(|t| axis.label(*t)).collect();
        let spacing = width / (axis.ticks.len().max(2) - 1) as f64;
        if most <= 1 || widest(&labels) + 8.0 <= spacing {
            return axis;
        }
        most -= 1;
    }
}

fn widest(labels: &[String]) -> f64 {
    labels.iter().map(|l| font::width(l, LABEL, Weight::Regular)).fold(0.0, f64::max)
}

/// Range of the cells of a panel over space.
fn space(panel: &Panel) -> (f64, f64) {
    let Body::Curves(curves) = &panel.body else { return (0.0, 1.0) };
    let x = || curves.series.iter().flat_map(|s| s.x.iter().copied());
    let (low, high) = x().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low < high { (low, high) } else { (0.0, 1.0) }
}

/// Name, unit and text of a panel, the names of its series, and the name of its abscissa.
fn write_names(drawing: &mut Drawing, panel: &Panel, place: &Placed, panels: &Panels) {
    let (x, room) = place.cell;
    let y = place.top + NAME;
    let unit = bracketed(&panel.unit, place.y.exponent);
    let title = format!("{}  {unit}", panel.name);
    let shrink = font::fitting(title.trim_end(), NAME, Weight::Bold, room);
    let text = |x: f64, letters: &str, size: f64, weight: Weight, colour: Colour| Text {
        x,
        y,
        size,
        anchor: Anchor::Start,
        colour,
        weight,
        letters: letters.to_owned(),
    };
    let mut end = x;
    for (letters, weight, colour) in [(panel.name.as_str(), Weight::Bold, colour::INK), (&unit, Weight::Regular, colour::INK)] {
        if !letters.is_empty() {
            let mark = text(end, letters, shrink, weight, colour);
            end += mark.width() + 5.0;
            drawing.marks.push(Mark::Text(mark));
        }
    }
    let note = text(end + 3.0, &panel.text, 9.0, Weight::Regular, colour::GREY);
    if !panel.text.is_empty() && note.x + note.width() <= x + room {
        drawing.marks.push(Mark::Text(note));
    }
    write_series(drawing, panel, place);
    if let Some(space) = &place.space {
        let letters = panel.place_name(space.exponent);
        let (x, y, weight) = (place.cell.0, place.plot.y - 8.0, Weight::Regular);
        drawing.marks.push(Mark::Text(Text { x, y, size: LABEL + 0.5, anchor: Anchor::Start, colour: colour::GREY, weight, letters }));
    }
    if place.names_abscissa {
        write_abscissa(drawing, panel, place, panels);
    }
}

/// Names of the series of a panel with their colours, in lines no wider than `room`; none where
/// they need no names.
fn series_lines(panel: &Panel, room: f64) -> Vec<Vec<(&str, Colour)>> {
    let Body::Curves(curves) = &panel.body else { return Vec::new() };
    let mut lines: Vec<Vec<(&str, Colour)>> = Vec::new();
    let mut used = f64::INFINITY;
    let mut known: Vec<(&str, Colour)> = Vec::new();
    for series in curves.series.iter().filter(|s| curves.named && !s.dots) {
        let entry = (series.label.as_str(), series.colour);
        if known.contains(&entry) {
            continue;
        }
        known.push(entry);
        let wide = KEY + font::width(entry.0, LABEL, Weight::Regular) + 9.0;
        match lines.last_mut() {
            Some(line) if used + wide <= room => line.push(entry),
            _ => {
                lines.push(vec![entry]);
                used = 0.0;
            }
        }
        used += wide;
    }
    lines
}

/// Lines that names of series take, or that of the coordinate of a map.
fn name_lines(panel: &Panel, room: f64) -> usize {
    match panel.body {
        Body::Curves(_) => series_lines(panel, room).len(),
        Body::Map(_) => 1,
    }
}

/// Room for the sign of a series before its name.
const KEY: f64 = 13.0;

/// Names of series next to their colours.
fn write_series(drawing: &mut Drawing, panel: &Panel, place: &Placed) {
    let (left, room) = place.cell;
    for (i, line) in series_lines(panel, room).into_iter().enumerate() {
        let (mut x, y) = (left, place.top + NAME + SERIES * (i + 1) as f64);
        for (label, colour) in line {
            let bar = Frame { x, y: y - 4.2, width: KEY - 4.0, height: 2.2 };
            drawing.marks.push(Mark::Rect(bar, colour));
            let size = font::fitting(label, LABEL, Weight::Regular, room - KEY);
            let (letters, weight, colour) = (label.to_owned(), Weight::Regular, darker(colour));
            let text = Text { x: x + KEY, y, size, anchor: Anchor::Start, colour, weight, letters };
            x += KEY + text.width() + 9.0;
            drawing.marks.push(Mark::Text(text));
        }
    }
}

/// A colour dark enough for letters.
fn darker(colour: Colour) -> Colour {
    let light = 0.299 * f64::from(colour.0) + 0.587 * f64::from(colour.1) + 0.114 * f64::from(colour.2);
    let share = (115.0 / light.max(1.0)).min(1.0);
    let dark = |c: u8| (f64::from(c) * share).round() as u8;
    Colour(dark(colour.0), dark(colour.1), dark(colour.2))
}

fn write_abscissa(drawing: &mut Drawing, panel: &Panel, place: &Placed, panels: &Panels) {
    let exponent = place.x.exponent;
    let letters = match panel.over_space {
        true => panel.place_name(exponent),
        false => format!("time {}", bracketed(&panels.time_unit, exponent)),
    };
    drawing.marks.push(Mark::Text(Text {
        x: place.plot.x + place.plot.width / 2.0,
        y: place.plot.bottom() + LABEL + 7.0 + LABEL + 2.0,
        size: LABEL + 0.5,
        anchor: Anchor::Middle,
        colour: colour::GREY,
        weight: Weight::Regular,
        letters: letters.trim_end().to_owned(),
    }));
}
