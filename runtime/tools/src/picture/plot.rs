//! Content of a panel: axes, bands, marks, curves, maps.

use super::colour;
use super::drawing::{Anchor, Colour, Drawing, Frame, Group, Mark, Stroke, Text};
use super::font::{self, Weight};
use super::layout::{BAR, Heading, LABEL, Placed, STRIP, phase_name};
use super::legend::{bound, event_colour, event_names, target, triangle};
use super::panel::{Body, Curves, Map, Panel, Panels, Series};
use super::run::Run;

/// Draws all panels.
pub(super) fn draw(drawing: &mut Drawing, panels: &Panels, placed: &[Placed], runs: &[Run], heading: &Heading) {
    for (index, (panel, place)) in panels.panels.iter().zip(placed).enumerate() {
        let mut pen = Pen { drawing, place, index };
        match &panel.body {
            Body::Curves(curves) => pen.curves(panel, curves, panels, runs, heading),
            Body::Map(map) => pen.map(map),
        }
        pen.abscissa();
    }
}

/// Draws one panel.
struct Pen<'d> {
    drawing: &'d mut Drawing,
    place: &'d Placed,
    index: usize,
}

impl Pen<'_> {
    fn curves(&mut self, panel: &Panel, curves: &Curves, panels: &Panels, runs: &[Run], heading: &Heading) {
        let plot = self.place.plot;
        self.drawing.marks.push(Mark::Open(Group::Curves(self.index), seen(plot, self.place)));
        if let ([run], false) = (runs, panel.over_space) {
            self.bands(run, panels, heading);
        }
        self.grid();
        if !panel.over_space {
            self.events(runs, panels);
        }
        let level = |drawing: &mut Drawing, y: f64, stroke: Stroke| drawing.line((plot.x, y), (plot.right(), y), stroke);
        curves.bounds.iter().for_each(|b| level(self.drawing, self.place.up(*b), bound()));
        curves.series.iter().for_each(|series| self.series(series));
        curves.targets.iter().for_each(|t| level(self.drawing, self.place.up(*t), target()));
        self.drawing.marks.push(Mark::Close);
        self.drawing.outline(plot, Stroke::full(colour::AXIS, 0.8));
        self.ordinate();
        self.guide_labels(curves);
    }

    /// Numbers of bounds and set-points that no tick marks, each where it covers the fewest points
    /// of curves.
    fn guide_labels(&mut self, curves: &Curves) {
        const SIZE: f64 = LABEL - 0.5;
        let (place, plot) = (self.place, self.place.plot);
        let points = || curves.series.iter().flat_map(|s| s.x.iter().zip(&s.y)).map(|(x, y)| (place.across(*x), place.up(*y)));
        let mut taken: Vec<Frame> = Vec::new();
        for value in curves.bounds.iter().chain(&curves.targets) {
            let Some(letters) = place.y.label_between(*value) else { continue };
            let level = place.up(*value);
            let text = |(anchor, below): (Anchor, bool)| {
                let x = if anchor == Anchor::End { plot.right() - 4.0 } else { plot.x + 4.0 };
                let y = if below { level + SIZE + 0.5 } else { level - 3.0 };
                Text { x, y, size: SIZE, anchor, colour: colour::INK, weight: Weight::Regular, letters: letters.clone() }
            };
            let places = [(Anchor::End, false), (Anchor::End, true), (Anchor::Start, false), (Anchor::Start, true)];
            let covered = |frame: &Frame| {
                points().filter(|(x, y)| *x >= frame.x && *x <= frame.right() && *y >= frame.y && *y <= frame.bottom()).count()
            };
            let fits = |text: &Text| {
                let frame = text.frame();
                frame.y >= plot.y && frame.bottom() <= plot.bottom() && !taken.iter().any(|other| other.overlaps(&frame))
            };
            let best = places.into_iter().map(text).filter(fits).min_by_key(|text| covered(&text.frame()));
            if let Some(text) = best {
                taken.push(text.frame());
                self.drawing.marks.push(Mark::Text(text));
            }
        }
    }

    /// Phases as bands, with their names above where there is room.
    fn bands(&mut self, run: &Run, panels: &Panels, heading: &Heading) {
        let plot = self.place.plot;
        let end = panels.time.1;
        for (i, (start, number)) in run.phases.iter().enumerate() {
            let start = (start * panels.factor).max(panels.time.0);
            let stop = run.phases.get(i + 1).map_or(end, |(next, _)| next * panels.factor).min(end);
            let (left, right) = (self.place.across(start), self.place.across(stop));
            if right <= left {
                continue;
            }
            let band = Frame { x: left, y: plot.y, width: right - left, height: plot.height };
            self.drawing.marks.push(Mark::Rect(band, colour::band(*number)));
            if self.place.names_phases {
                self.band_name(left, right, &phase_name(heading, *number), *number);
            }
        }
    }

    fn band_name(&mut self, left: f64, right: f64, name: &str, number: usize) {
        let plot = self.place.plot;
        let strip = Frame { x: left, y: plot.y - STRIP, width: right - left, height: STRIP };
        let Colour(r, g, b) = colour::band(number);
        let deeper = |c: u8| (f64::from(c) * 0.93).round() as u8;
        self.drawing.marks.push(Mark::Rect(strip, Colour(deeper(r), deeper(g), deeper(b))));
        let size = 8.5;
        if font::width(name, size, Weight::Regular) + 4.0 <= right - left {
            self.text((left + right) / 2.0, plot.y - 3.5, size, Anchor::Middle, colour::INK, name);
        }
    }

    fn grid(&mut self) {
        let plot = self.place.plot;
        let pen = || Stroke::full(colour::GRID, 0.7);
        let levels: Vec<f64> = self.place.y.ticks.iter().map(|t| self.place.up(*t)).collect();
        levels.into_iter().for_each(|y| self.drawing.line((plot.x, y), (plot.right(), y), pen()));
    }

    fn events(&mut self, runs: &[Run], panels: &Panels) {
        let names = event_names(runs);
        let plot = self.place.plot;
        for (time, name) in runs.iter().flat_map(|run| &run.events) {
            let index = names.iter().position(|n| n == name).unwrap_or_default();
            let (x, colour) = (self.place.across(time * panels.factor), event_colour(index));
            self.drawing.line(
                (x, plot.y),
                (x, plot.bottom()),
                Stroke { colour: colour::paler(colour, 0.6), width: 0.8, dashes: &[2.0, 2.0] },
            );
            triangle(self.drawing, x, plot.y, colour);
        }
    }

    fn series(&mut self, series: &Series) {
        let at = |(x, y): (&f64, &f64)| (self.place.across(*x), self.place.up(*y));
        let finite = series.x.iter().zip(&series.y).map(|(x, y)| (x.is_finite() && y.is_finite()).then(|| at((x, y))));
        let mut pieces: Vec<Vec<(f64, f64)>> = vec![Vec::new()];
        for point in finite {
            match (point, pieces.last_mut()) {
                (Some(point), Some(piece)) => piece.push(point),
                (None, Some(piece)) if !piece.is_empty() => pieces.push(Vec::new()),
                _ => {}
            }
        }
        pieces.retain(|piece| !piece.is_empty());
        let all = || pieces.iter().flatten().copied();
        if series.dots {
            self.drawing.marks.push(Mark::Dots(thinned(&all().collect::<Vec<_>>(), self.place.plot.width), 1.2, series.colour));
            return;
        }
        let lone: Vec<(f64, f64)> = pieces.iter().filter(|piece| piece.len() == 1).flatten().copied().collect();
        if !lone.is_empty() {
            self.drawing.marks.push(Mark::Dots(lone, 1.8, series.colour));
        }
        let stroke = Stroke { colour: series.colour, width: 1.5, dashes: series.dashes };
        let lines: Vec<Vec<(f64, f64)>> = pieces.iter().filter(|p| p.len() > 1).map(|p| thinned(p, self.place.plot.width)).collect();
        if !lines.is_empty() {
            self.drawing.marks.push(Mark::Lines(lines, stroke));
        }
    }

    fn map(&mut self, map: &Map) {
        let plot = self.place.plot;
        let rows = map.labels.len();
        let share = |value: f64| (value - map.range.0) / (map.range.1 - map.range.0);
        let row = |r: usize| map.values[r * map.columns..(r + 1) * map.columns].iter();
        let pixels = (0..rows).rev().flat_map(row).map(|v| colour::viridis(share(*v))).collect();
        self.drawing.marks.push(Mark::Open(Group::Curves(self.index), plot));
        self.drawing.marks.push(Mark::Image { frame: plot, columns: map.columns, pixels });
        self.drawing.marks.push(Mark::Close);
        self.drawing.outline(plot, Stroke::full(colour::AXIS, 0.8));
        for tick in self.place.space.iter().flat_map(|axis| &axis.ticks) {
            let axis = self.place.space.as_ref();
            let y = plot.bottom() - axis.map_or(0.0, |axis| axis.share(*tick)) * plot.height;
            self.tick((plot.x - 3.0, y), (plot.x, y));
            let letters = axis.map(|axis| axis.label(*tick)).unwrap_or_default();
            self.text(plot.x - 5.0, y + 0.36 * LABEL, LABEL, Anchor::End, colour::GREY, &letters);
        }
        self.scale(map);
    }

    /// Colour scale of a map.
    fn scale(&mut self, map: &Map) {
        const SHADES: usize = 64;
        let plot = self.place.plot;
        let bar = Frame { x: plot.right() + 6.0, y: plot.y, width: BAR, height: plot.height };
        // Each shade goes a little beneath the one above it, lest the page shines through between
        // them.
        for i in 0..SHADES {
            let height = plot.height / SHADES as f64;
            let top = plot.bottom() - height * (i + 1) as f64;
            let shade = Frame { y: top, height: if i == 0 { height } else { height + 0.4 }, ..bar };
            self.drawing.marks.push(Mark::Rect(shade, colour::viridis((i as f64 + 0.5) / SHADES as f64)));
        }
        let place = self.place;
        for tick in place.y.ticks.iter().filter(|t| **t >= map.range.0 && **t <= map.range.1) {
            let y = place.up(*tick);
            self.tick((bar.right(), y), (bar.right() + 2.0, y));
            self.text(bar.right() + 4.0, y + 0.36 * LABEL, LABEL, Anchor::Start, colour::GREY, &place.y.label(*tick));
        }
    }

    fn ordinate(&mut self) {
        let place = self.place;
        for tick in &place.y.ticks {
            let y = place.up(*tick);
            self.tick((place.plot.x - 3.0, y), (place.plot.x, y));
            self.text(place.plot.x - 5.0, y + 0.36 * LABEL, LABEL, Anchor::End, colour::GREY, &place.y.label(*tick));
        }
    }

    fn abscissa(&mut self) {
        let (place, bottom) = (self.place, self.place.plot.bottom());
        self.drawing.marks.push(Mark::Open(Group::Ticks(self.index), place.plot));
        for tick in &place.x.ticks {
            let x = place.across(*tick);
            self.tick((x, bottom), (x, bottom + 3.0));
            self.text(x, bottom + LABEL + 5.0, LABEL, Anchor::Middle, colour::GREY, &place.x.label(*tick));
        }
        self.drawing.marks.push(Mark::Close);
    }

    fn tick(&mut self, from: (f64, f64), to: (f64, f64)) {
        self.drawing.line(from, to, Stroke::full(colour::AXIS, 0.8));
    }

    fn text(&mut self, x: f64, y: f64, size: f64, anchor: Anchor, colour: Colour, letters: &str) {
        let text = Text { x, y, size, anchor, colour, weight: Weight::Regular, letters: letters.to_owned() };
        self.drawing.marks.push(Mark::Text(text));
    }
}

/// The plot and the strip of names above it.
fn seen(plot: Frame, place: &Placed) -> Frame {
    let strip = if place.names_phases { STRIP } else { 0.0 };
    Frame { y: plot.y - strip - 1.0, height: plot.height + strip + 2.0, ..plot }
}

/// No more points than can be seen: of those within a half of a pixel the first, the lowest, the
/// highest and the last.
fn thinned(points: &[(f64, f64)], width: f64) -> Vec<(f64, f64)> {
    if points.len() < (6.0 * width) as usize {
        return points.to_vec();
    }
    let mut kept = Vec::new();
    for part in points.chunk_by(|a, b| (2.0 * a.0).floor() == (2.0 * b.0).floor()) {
        let order = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let (low, high) = (part.iter().min_by(order), part.iter().max_by(order));
        kept.extend([part.first(), low, high, part.last()].into_iter().flatten());
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_points_the_extremes_stay() {
        let mut points: Vec<(f64, f64)> = (0..10_000).map(|i| (f64::from(i) / 100.0, 1.0)).collect();
        points[5005].1 = 9.0;
        points[7003].1 = -9.0;
        let thin = thinned(&points, 100.0);
        assert!(thin.len() < 1000);
        assert!(thin.contains(&(50.05, 9.0)) && thin.contains(&(70.03, -9.0)));
        assert_eq!((thin.first(), thin.last()), (points.first(), points.last()));
    }
}
