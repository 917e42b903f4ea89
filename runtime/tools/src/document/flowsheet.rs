//! The flowsheet of a model as a picture: units as boxes, what flows between them as arrows.
//!
//! An arrow is a `connect`, or an equation that gives a port of one unit what another one sends
//! (dashed: it depends on more than that). What comes from the rest of the model arrives from
//! above, what goes there leaves below.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use smpl_compiler::model::Interface;
use smpl_dsl::syntax::{Expr, ExprKind, Role, Statement, StatementKind};

use super::Source;
use super::statements::declared;
use crate::picture::Weight;
use crate::picture::drawing::{Anchor, Colour, Drawing, Frame, Mark, Stroke, Text};

const BOX: (f64, f64) = (104.0, 46.0);
const GAP: (f64, f64) = (42.0, 96.0);
const MARGIN: (f64, f64) = (18.0, 62.0);
const INK: Colour = Colour(30, 30, 30);
const EDGE: Colour = Colour(0, 114, 178);
const FILL: Colour = Colour(232, 241, 248);
/// Most names next to an arrow.
const NAMES: usize = 3;

/// The flowsheet; `None` where the model has no units.
#[must_use]
pub(crate) fn flowsheet(source: &Source, interface: &Interface) -> Option<Drawing> {
    let mut plant = Plant::default();
    let mut statements = Vec::new();
    in_force(source, interface, 0, &mut vec![false; source.files.len()], &mut statements);
    statements.iter().for_each(|s| plant.declare(s));
    statements.iter().for_each(|s| plant.flow(s));
    (!plant.units.is_empty()).then(|| plant.draw(&format!("Flowsheet of {}", interface.name)))
}

/// The statements of a file with its imports and the options and variants that are in force.
fn in_force<'s>(source: &'s Source, interface: &Interface, file: usize, seen: &mut Vec<bool>, out: &mut Vec<&'s Statement>) {
    if !std::mem::replace(&mut seen[file], true) {
        collect(source, interface, &source.files[file].statements, seen, out);
    }
}

fn collect<'s>(source: &'s Source, interface: &Interface, list: &'s [Statement], seen: &mut Vec<bool>, out: &mut Vec<&'s Statement>) {
    for statement in list {
        match &statement.kind {
            StatementKind::Import { path, .. } => {
                if let Some(&file) = source.imports.get(path) {
                    in_force(source, interface, file, seen, out);
                }
            }
            StatementKind::When { choice, option, body } if interface.alternatives.has_chosen(&choice.text, &option.text) => {
                collect(source, interface, body, seen, out);
            }
            StatementKind::Variant { name, body, .. } if interface.alternatives.has_chosen(&name.text, "true") => {
                collect(source, interface, body, seen, out);
            }
            StatementKind::When { .. } | StatementKind::Variant { .. } => {}
            _ => out.push(statement),
        }
    }
}

/// Units and what flows.
#[derive(Default)]
struct Plant<'s> {
    /// Name as declared, and component, in the order of the text.
    units: Vec<(String, &'s str)>,
    index: HashMap<&'s str, usize>,
    /// Named expressions.
    lets: HashMap<&'s str, &'s Expr>,
    /// Names that are worth an arrow from above.
    quantities: BTreeSet<&'s str>,
    /// Arrows between units, full where they are connections.
    edges: BTreeMap<(usize, usize), bool>,
    /// Arrows from and to the rest of the model.
    feeds: BTreeMap<usize, Vec<&'s str>>,
    products: BTreeMap<usize, Vec<&'s str>>,
}

impl<'s> Plant<'s> {
    fn declare(&mut self, statement: &'s Statement) {
        match &statement.kind {
            StatementKind::Instance { component, name, indices, .. } => {
                self.index.insert(&name.text, self.units.len());
                self.units.push((declared(name, indices), &component.text));
            }
            StatementKind::Declare { role, declarations } => {
                for d in declarations {
                    if let (Role::Let, Some(value)) = (role, &d.value) {
                        self.lets.insert(&d.name.text, value);
                    }
                    if matches!(role, Role::Let | Role::Action | Role::State | Role::Var) {
                        self.quantities.insert(&d.name.text);
                    }
                }
            }
            _ => {}
        }
    }

    fn flow(&mut self, statement: &'s Statement) {
        match &statement.kind {
            StatementKind::Connect { chain, .. } => {
                let units: Vec<usize> = chain.iter().filter_map(|end| self.unit_of(end)).collect();
                for pair in units.windows(2) {
                    self.edges.insert((pair[0], pair[1]), true);
                }
            }
            StatementKind::Equation { lhs, rhs, .. } => match self.unit_of(lhs) {
                Some(unit) => self.feed(unit, rhs),
                None => self.produce(lhs, rhs),
            },
            _ => {}
        }
    }

    /// An equation that gives a unit something.
    fn feed(&mut self, unit: usize, rhs: &'s Expr) {
        let (units, names) = self.mentioned(rhs);
        for &from in units.iter().filter(|&&from| from != unit) {
            self.edges.entry((from, unit)).or_insert(false);
        }
        let feeds = self.feeds.entry(unit).or_default();
        for name in names {
            if units.is_empty() && !feeds.contains(&name) {
                feeds.push(name);
            }
        }
    }

    /// The rate of a state of the model that takes what a unit sends.
    fn produce(&mut self, lhs: &'s Expr, rhs: &'s Expr) {
        let mut state = None;
        if let ExprKind::Derivative(inner) = &lhs.kind {
            inner.walk(&mut |e| {
                if let (ExprKind::Name(name), None) = (&e.kind, state) {
                    state = Some(name.text.as_str());
                }
            });
        }
        let Some(state) = state else { return };
        for unit in self.mentioned(rhs).0 {
            let products = self.products.entry(unit).or_default();
            if !products.contains(&state) {
                products.push(state);
            }
        }
    }

    /// The unit that a reference begins with: `col[k].inlet.Q`.
    fn unit_of(&self, e: &Expr) -> Option<usize> {
        match &e.kind {
            ExprKind::Name(name) => self.index.get(name.text.as_str()).copied(),
            ExprKind::Member(base, _) | ExprKind::Index(base, _) => self.unit_of(base),
            _ => None,
        }
    }

    /// Units and quantities of the model that an expression depends on, named expressions looked
    /// through where they mention a unit.
    fn mentioned(&self, e: &'s Expr) -> (BTreeSet<usize>, Vec<&'s str>) {
        let (mut units, mut names, mut open) = (BTreeSet::new(), Vec::new(), vec![e]);
        let mut seen = BTreeSet::new();
        while let Some(next) = open.pop() {
            next.walk(&mut |e| {
                let ExprKind::Name(name) = &e.kind else { return };
                let name = name.text.as_str();
                if let Some(&unit) = self.index.get(name) {
                    units.insert(unit);
                } else if seen.insert(name) && self.quantities.contains(name) {
                    let value = self.lets.get(name).copied().filter(|value| self.mentions_unit(value));
                    match value {
                        Some(value) => open.push(value),
                        None => names.push(name),
                    }
                }
            });
        }
        (units, names)
    }

    fn mentions_unit(&self, e: &Expr) -> bool {
        let mut found = false;
        e.walk(&mut |e| found |= matches!(&e.kind, ExprKind::Name(name) if self.index.contains_key(name.text.as_str())));
        found
    }

    // ---- drawing

    /// Column of each unit: behind all that send to it; what closes a circle does not count.
    fn columns(&self) -> Vec<usize> {
        let mut forward = Vec::new();
        let mut state = vec![Visit::Not; self.units.len()];
        for unit in 0..self.units.len() {
            self.visit(unit, &mut state, &mut forward);
        }
        let mut columns = vec![0; self.units.len()];
        for _ in 0..self.units.len() {
            for &(from, to) in &forward {
                columns[to] = columns[to].max(columns[from] + 1);
            }
        }
        columns
    }

    /// Arrows that lead on, in the order of a walk along them.
    fn visit(&self, unit: usize, state: &mut [Visit], forward: &mut Vec<(usize, usize)>) {
        if state[unit] != Visit::Not {
            return;
        }
        state[unit] = Visit::Open;
        for &(from, to) in self.edges.range((unit, 0)..(unit + 1, 0)).map(|(edge, _)| edge) {
            if state[to] != Visit::Open {
                forward.push((from, to));
                self.visit(to, state, forward);
            }
        }
        state[unit] = Visit::Done;
    }

    fn frames(&self) -> Vec<Frame> {
        let mut filled: HashMap<usize, usize> = HashMap::new();
        let place = |column: usize| {
            let row = filled.entry(column).or_default();
            *row += 1;
            let x = MARGIN.0 + column as f64 * (BOX.0 + GAP.0);
            Frame { x, y: MARGIN.1 + (*row - 1) as f64 * (BOX.1 + GAP.1), width: BOX.0, height: BOX.1 }
        };
        self.columns().into_iter().map(place).collect()
    }

    fn draw(&self, title: &str) -> Drawing {
        let frames = self.frames();
        let right = frames.iter().map(Frame::right).fold(0.0, f64::max);
        let bottom = frames.iter().map(Frame::bottom).fold(0.0, f64::max);
        let mut drawing = Drawing::new(right + MARGIN.0, bottom + MARGIN.1, title);
        for (&(from, to), &full) in &self.edges {
            connect(&mut drawing, &frames[from], &frames[to], full);
        }
        for (i, ((name, component), frame)) in self.units.iter().zip(&frames).enumerate() {
            drawing.marks.push(Mark::Rect(*frame, FILL));
            drawing.outline(*frame, Stroke::full(EDGE, 1.2));
            let middle = frame.x + frame.width / 2.0;
            words(&mut drawing, (middle, frame.y + 20.0), name, 12.0, Weight::Bold, frame.width - 8.0);
            words(&mut drawing, (middle, frame.y + 36.0), component, 9.5, Weight::Regular, frame.width - 8.0);
            let room = BOX.0 + GAP.0 - 6.0;
            if let Some(names) = self.feeds.get(&i).filter(|names| !names.is_empty()) {
                arrow(&mut drawing, &[(middle, frame.y - 26.0), (middle, frame.y)], true);
                words(&mut drawing, (middle, frame.y - 32.0), &listed(names), 9.5, Weight::Regular, room);
            }
            if let Some(names) = self.products.get(&i) {
                arrow(&mut drawing, &[(middle, frame.bottom()), (middle, frame.bottom() + 26.0)], true);
                words(&mut drawing, (middle, frame.bottom() + 40.0), &listed(names), 9.5, Weight::Regular, room);
            }
        }
        drawing
    }
}

/// Progress of a walk along the arrows at a unit.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Visit {
    Not,
    Open,
    Done,
}

fn listed(names: &[&str]) -> String {
    let shown = names.iter().take(NAMES).copied().collect::<Vec<_>>().join(", ");
    if names.len() > NAMES { format!("{shown}, …") } else { shown }
}

/// Text in the middle of a place, smaller where it has no room.
fn words(drawing: &mut Drawing, (x, y): (f64, f64), letters: &str, size: f64, weight: Weight, room: f64) {
    let mut text = Text { x, y, size, anchor: Anchor::Middle, colour: INK, weight, letters: letters.to_owned() };
    let width = text.width();
    if width > room {
        text.size *= room / width;
    }
    drawing.marks.push(Mark::Text(text));
}

/// An arrow between two units: straight to the next column, else around.
fn connect(drawing: &mut Drawing, from: &Frame, to: &Frame, full: bool) {
    let (start, end) = ((from.right(), from.y + from.height / 2.0), (to.x, to.y + to.height / 2.0));
    let next = to.x > from.x && to.x - from.right() < 1.5 * GAP.0;
    let reach = if next { GAP.0 / 2.0 } else { GAP.0 };
    let sag = if next { 0.0 } else { 0.8 * GAP.1 };
    let points: Vec<(f64, f64)> = (0..=24)
        .map(|i| {
            let s = f64::from(i) / 24.0;
            let (a, b, c, d) = ((1.0 - s).powi(3), 3.0 * s * (1.0 - s).powi(2), 3.0 * s * s * (1.0 - s), s.powi(3));
            (
                a * start.0 + b * (start.0 + reach) + c * (end.0 - reach) + d * end.0,
                a * start.1 + b * (start.1 + sag) + c * (end.1 + sag) + d * end.1,
            )
        })
        .collect();
    arrow(drawing, &points, full);
}

/// A line with a head at its end.
fn arrow(drawing: &mut Drawing, points: &[(f64, f64)], full: bool) {
    let dashes: &'static [f64] = if full { &[] } else { &[5.0, 3.0] };
    drawing.marks.push(Mark::Lines(vec![points.to_vec()], Stroke { colour: INK, width: 1.3, dashes }));
    let [.., before, end] = points else { return };
    let (dx, dy) = (end.0 - before.0, end.1 - before.1);
    let length = dx.hypot(dy).max(1e-9);
    let (ux, uy) = (dx / length, dy / length);
    let back = |side: f64| (end.0 - 8.0 * ux - side * 3.5 * uy, end.1 - 8.0 * uy + side * 3.5 * ux);
    drawing.marks.push(Mark::Polygon(vec![*end, back(1.0), back(-1.0)], INK));
}
