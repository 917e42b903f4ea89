//! Panels with their numbers: curves, maps and what is next to them, before they have a place on a
//! page.

use super::axis::{Axis, span};
use super::colour;
use super::drawing::Colour;
use super::items::{Member, Role, Space};
use super::plan::{Line, MOST_LINES, PanelPlan, PlotKind};
use super::quantity::{bracketed, short, unit};
use super::run::Run;

/// A panel.
#[derive(Clone, Debug)]
pub(super) struct Panel {
    /// Name of what it shows.
    pub name: String,
    /// Unit as people write it; empty for a number.
    pub unit: String,
    /// Describing text, shown where there is room.
    pub text: String,
    /// Its abscissa is space, not time.
    pub over_space: bool,
    /// Name and unit of the coordinate in space: `cell` where the places of cells are not known.
    pub coordinate: (String, String),
    /// Content.
    pub body: Body,
}

/// Content of a panel.
#[derive(Clone, Debug)]
pub(super) enum Body {
    /// Curves.
    Curves(Curves),
    /// A field over time and space.
    Map(Map),
}

/// Curves with what they are to be compared with.
#[derive(Clone, Debug)]
pub(super) struct Curves {
    /// The curves.
    pub series: Vec<Series>,
    /// Bounds near the curves.
    pub bounds: Vec<f64>,
    /// Set-points near the curves.
    pub targets: Vec<f64>,
    /// Range of the ordinate.
    pub range: (f64, f64),
    /// The series have their own names within the panel.
    pub named: bool,
}

/// One curve.
#[derive(Clone, Debug)]
pub(super) struct Series {
    /// Name.
    pub label: String,
    /// Colour.
    pub colour: Colour,
    /// Dashes.
    pub dashes: &'static [f64],
    /// Single points.
    pub dots: bool,
    /// Abscissae.
    pub x: Vec<f64>,
    /// Ordinates.
    pub y: Vec<f64>,
}

/// A field: rows over space, the lowest place first, each with one value a column of time.
#[derive(Clone, Debug)]
pub(super) struct Map {
    /// Place of each row, in words.
    pub labels: Vec<String>,
    /// Lower and upper end in space.
    pub ends: (f64, f64),
    /// Number of columns.
    pub columns: usize,
    /// Values, cell after cell.
    pub values: Vec<f64>,
    /// Range of the values.
    pub range: (f64, f64),
}

/// All panels with their common axis of time.
#[derive(Clone, Debug)]
pub(super) struct Panels {
    /// The panels.
    pub panels: Vec<Panel>,
    /// Range of time, in `time_unit`.
    pub time: (f64, f64),
    /// Unit of time; empty where it is not known.
    pub time_unit: String,
    /// Factor of the model's times.
    pub factor: f64,
    /// Text on constant quantities without a panel.
    pub constants: Vec<String>,
    /// Names of what has no panel for lack of room.
    pub left_out: Vec<String>,
}

/// Fields of more runs than these are not shown side by side.
pub(super) const MOST_MAPS: usize = 4;

/// Dashes by the number of the run, where colours tell something else.
const DASHES: [&[f64]; 4] = [&[], &[6.0, 2.5], &[2.0, 2.0], &[7.0, 2.0, 2.0, 2.0]];
/// More runs than colours are drawn pale, all in one.
pub(super) const MOST_RUNS: usize = colour::CURVES.len();

/// Colour of a run among `count`.
pub(super) fn run_colour(index: usize, count: usize) -> Colour {
    if count > MOST_RUNS { colour::paler(colour::BLUE, 0.45) } else { colour::CURVES[index % colour::CURVES.len()] }
}

/// The panels of an entry of a plan with the numbers of runs.
pub(super) fn panels_of(plan: &PanelPlan, runs: &[Run], factor: f64, time_unit: &str) -> Vec<Panel> {
    let few = || runs.iter().take(MOST_MAPS);
    let space = plan.space.as_deref().filter(|_| !runs.iter().any(|run| run.moved));
    let bodies = match &plan.kind {
        PlotKind::Lines(lines) => vec![(String::new(), curves(lines, runs, factor, plan.role))],
        PlotKind::Profile(groups) => vec![(String::new(), profile(groups, space, runs))],
        PlotKind::Map(cells) if runs.iter().all(|run| is_uniform(cells, run)) => {
            vec![(String::new(), curves(&uniform(plan, cells), runs, factor, plan.role))]
        }
        PlotKind::Map(cells) => few().map(|run| (run.label.clone(), Body::Map(map(cells, space, &plan.index, run)))).collect(),
        PlotKind::Course(cells) => few().map(|run| (run.label.clone(), course(cells, space, run, factor, time_unit))).collect(),
    };
    let coordinate = space.map_or_else(|| (plan.index.clone(), String::new()), |space| (space.name.clone(), unit(&space.unit)));
    let over_space = matches!(plan.kind, PlotKind::Profile(_) | PlotKind::Course(_));
    let panel = |(label, body): (String, Body)| {
        let text = if runs.len() > 1 && !label.is_empty() { label } else { text(plan, &body) };
        Panel { name: plan.name.clone(), unit: unit(&plan.unit), text, over_space, coordinate: coordinate.clone(), body }
    };
    bodies.into_iter().map(panel).collect()
}

fn text(plan: &PanelPlan, body: &Body) -> String {
    let all = match &plan.kind {
        PlotKind::Lines(lines) => lines.len(),
        PlotKind::Profile(groups) => groups.len(),
        _ => 0,
    };
    let shown = if let Body::Curves(curves) = body { curves.series.len() } else { 0 };
    let part = (all > MOST_LINES && shown > 0).then(|| format!("the {MOST_LINES} that vary most, of {all}"));
    let end = matches!(plan.kind, PlotKind::Profile(_)).then(|| "at the end".to_owned());
    let same = match (&plan.kind, body) {
        (PlotKind::Map(cells), Body::Curves(_)) => Some(format!("the same in all {}", cells.len())),
        _ => None,
    };
    let texts = [Some(plan.text.clone()).filter(|t| !t.is_empty()), end, part, same];
    texts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

pub(super) fn is_constant(values: &[f64]) -> bool {
    let mut finite = values.iter().filter(|v| v.is_finite());
    let Some(first) = finite.next() else { return true };
    finite.all(|v| (v - first).abs() <= 1e-9 * first.abs().max(v.abs()))
}

/// Returns whether a field has one value everywhere and always; a map of it would magnify rounding
/// errors.
fn is_uniform(cells: &[Member], run: &Run) -> bool {
    let values = || cells.iter().filter_map(|cell| run.column(&cell.column)).flatten().copied();
    let (low, high) = extremes(values());
    low > high || high - low <= 1e-9 * low.abs().max(high.abs())
}

/// The one curve of a field that has one value.
fn uniform(plan: &PanelPlan, cells: &[Member]) -> Vec<Line> {
    let line = |member: &Member| Line { label: String::new(), role: plan.role, member: member.clone(), dots: false };
    cells.first().map(line).into_iter().collect()
}

/// Largest less smallest value.
fn variation(values: &[f64]) -> f64 {
    let (low, high) = extremes(values.iter().copied());
    if low > high { 0.0 } else { high - low }
}

fn extremes(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.filter(|v| v.is_finite()).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)))
}

/// The lines that vary most, in their order.
fn most_varying<T>(all: &[T], vary: impl Fn(&T) -> f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..all.len()).collect();
    if all.len() > MOST_LINES {
        let sizes: Vec<f64> = all.iter().map(vary).collect();
        order.sort_by(|a, b| sizes[*b].total_cmp(&sizes[*a]));
        order.truncate(MOST_LINES);
        order.sort_unstable();
    }
    order
}

fn curves(lines: &[Line], runs: &[Run], factor: f64, role: Role) -> Body {
    let curve = |line: &Line, run: &Run| {
        let role = if line.dots { Role::Observation } else { line.role };
        let (mut x, y) = run.curve(&line.member.column, role);
        x.iter_mut().for_each(|t| *t *= factor);
        (x, y)
    };
    let solid: Vec<&Line> = lines.iter().filter(|line| !line.dots).collect();
    let vary = |line: &&Line| runs.iter().map(|run| variation(&curve(line, run).1)).fold(0.0, f64::max);
    let chosen: Vec<&Line> = most_varying(&solid, vary).into_iter().map(|i| solid[i]).collect();
    let mut series = Vec::new();
    for (index, line) in chosen.iter().enumerate() {
        for (number, run) in runs.iter().enumerate() {
            let (x, y) = curve(line, run);
            let (colour, dashes) = style(index, chosen.len(), number, runs.len(), line.role);
            let label = if chosen.len() > 1 { line.label.clone() } else { run.label.clone() };
            series.push(Series { label, colour, dashes, dots: false, x, y });
        }
    }
    // Of several runs the owner of the readings is not clear.
    for line in lines.iter().filter(|line| line.dots && runs.len() == 1) {
        let readings = runs.iter().filter(|run| chosen.first().is_none_or(|exact| differs(run, exact, line)));
        series.extend(readings.map(|run| {
            let (x, y) = curve(line, run);
            Series { label: line.label.clone(), colour: colour::INK, dashes: &[], dots: true, x, y }
        }));
    }
    let members: Vec<&Member> = chosen.iter().map(|line| &line.member).collect();
    Body::Curves(with_guides(series, &members, chosen.len() > 1, role == Role::Action))
}

/// Colour and dashes of a line among `lines`, of a run among `runs`.
fn style(line: usize, lines: usize, run: usize, runs: usize, role: Role) -> (Colour, &'static [f64]) {
    match (lines, runs) {
        (1, 1) => (role_colour(role), &[]),
        (1, _) => (run_colour(run, runs), &[]),
        _ => (colour::CURVES[line % colour::CURVES.len()], DASHES[run % DASHES.len()]),
    }
}

fn role_colour(role: Role) -> Colour {
    match role {
        Role::Action => colour::VERMILION,
        Role::Reward => colour::GREEN,
        Role::Discrete => colour::PURPLE,
        Role::Disturbance => colour::ORANGE,
        _ => colour::BLUE,
    }
}

/// Returns `true` if readings are anything else than what is read.
fn differs(run: &Run, exact: &Line, reading: &Line) -> bool {
    let (Some(a), Some(b)) = (run.column(&exact.member.column), run.column(&reading.member.column)) else { return false };
    a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-9 * a.abs().max(b.abs()))
}

/// Adds bounds and set-points that leave the curves readable, and the range of the ordinate.
fn with_guides(series: Vec<Series>, members: &[&Member], named: bool, is_action: bool) -> Curves {
    let (low, high) = extremes(series.iter().flat_map(|s| s.y.iter().copied()));
    let width = if low <= high { (high - low).max(2e-3 * low.abs().max(high.abs())).max(1e-300) } else { 1.0 };
    let reach = |room: f64| move |x: &f64| x.is_finite() && *x >= low - room * width && *x <= high + room * width;
    let constant = high - low <= 1e-9 * low.abs().max(high.abs());
    let room = if is_action && constant {
        f64::INFINITY
    } else if is_action {
        10.0
    } else {
        0.4
    };
    let bounds = distinct(members.iter().flat_map(|m| [m.low, m.high]).filter(reach(room)));
    let targets = distinct(members.iter().filter_map(|m| m.target).filter(reach(20.0)));
    let all = [low, high].into_iter().chain(bounds.iter().copied()).chain(targets.iter().copied());
    let range = span(all).unwrap_or((0.0, 1.0));
    Curves { series, bounds, targets, range, named }
}

fn distinct(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut all: Vec<f64> = values.collect();
    all.sort_by(f64::total_cmp);
    all.dedup();
    // Many guides, one for each of many curves, are of no use.
    if all.len() > 2 { Vec::new() } else { all }
}

/// The value of a column in the last row that has one.
fn last(run: &Run, column: &str) -> f64 {
    let finite = |values: &[f64]| values.iter().rev().copied().find(|v| v.is_finite());
    run.column(column).and_then(finite).unwrap_or(f64::NAN)
}

/// Centres of cells; where these are not known, their numbers, as labels say where they are
/// numbers.
fn places(cells: &[Member], space: Option<&Space>) -> Vec<f64> {
    if let Some(space) = space.filter(|space| space.faces.len() == cells.len() + 1) {
        return space.faces.windows(2).map(|face| 0.5 * (face[0] + face[1])).collect();
    }
    let number = |member: &Member| member.label.rsplit(',').next().and_then(|l| l.parse().ok());
    let numbers: Option<Vec<f64>> = cells.iter().map(number).collect();
    numbers.unwrap_or_else(|| (1..=cells.len()).map(|i| i as f64).collect())
}

fn profile(groups: &[(String, Vec<Member>)], space: Option<&Space>, runs: &[Run]) -> Body {
    let values = |cells: &[Member], run: &Run| -> Vec<f64> { cells.iter().map(|m| last(run, &m.column)).collect() };
    let size = |group: &(String, Vec<Member>)| runs.iter().map(|run| variation(&values(&group.1, run))).fold(0.0, f64::max);
    let chosen = most_varying(groups, size);
    let mut series = Vec::new();
    for (index, group) in chosen.into_iter().map(|i| &groups[i]).enumerate() {
        for (number, run) in runs.iter().enumerate() {
            let (colour, dashes) = style(index, 2, number, runs.len(), Role::State);
            let (x, y) = (places(&group.1, space), values(&group.1, run));
            series.push(Series { label: group.0.clone(), colour, dashes, dots: false, x, y });
        }
    }
    Body::Curves(with_guides(series, &[], true, false))
}

/// Curves over space at some times from the first to the last row.
fn course(cells: &[Member], space: Option<&Space>, run: &Run, factor: f64, time_unit: &str) -> Body {
    const TIMES: usize = 6;
    let time = run.time();
    let end = time.len().saturating_sub(1);
    let mut rows: Vec<usize> = (0..TIMES).map(|i| (i * end) / (TIMES - 1)).collect();
    rows.dedup();
    let curve = |(i, &row): (usize, &usize)| {
        let value = |m: &Member| run.column(&m.column).and_then(|c| c.get(row)).copied().unwrap_or(f64::NAN);
        let colour = colour::viridis(0.92 * i as f64 / rows.len().max(2) as f64);
        let label = format!("{} {time_unit}", short_time(time[row] * factor)).trim_end().to_owned();
        Series { label, colour, dashes: &[], dots: false, x: places(cells, space), y: cells.iter().map(value).collect() }
    };
    let series = if time.is_empty() { Vec::new() } else { rows.iter().enumerate().map(curve).collect() };
    Body::Curves(with_guides(series, &[], true, false))
}

fn short_time(t: f64) -> String {
    short((t * 1000.0).round() / 1000.0)
}

/// Most cells of a picture in each direction; more are not seen.
const MOST_CELLS: usize = 400;

fn map(cells: &[Member], space: Option<&Space>, index: &str, run: &Run) -> Map {
    let fine: Option<Vec<(&[f64], &[f64])>> = cells.iter().map(|member| run.within_steps(&member.column)).collect();
    let rows_of_table = run.time();
    let time: &[f64] = fine.as_ref().and_then(|fine| fine.first()).map_or(&rows_of_table, |(times, _)| times);
    let columns = time.len().clamp(1, MOST_CELLS);
    let (first, last) = (time.first().copied().unwrap_or(0.0), time.last().copied().unwrap_or(1.0));
    let moment = |j: usize| first + (last - first) * (j as f64 + 0.5) / columns as f64;
    let nearest = |t: f64| {
        let after = time.partition_point(|x| *x < t).min(time.len().saturating_sub(1));
        let before = after.saturating_sub(1);
        if time.get(before).is_some_and(|x| t - x < time[after] - t) { before } else { after }
    };
    let moments: Vec<usize> = (0..columns).map(|j| nearest(moment(j))).collect();
    let (shown, ends) = rows(cells, space);
    let values_of = |cell: &usize| {
        let column = match &fine {
            Some(fine) => fine[*cell].1,
            None => run.column(&cells[*cell].column).unwrap_or_default(),
        };
        moments.iter().map(|at| column.get(*at).copied().unwrap_or(f64::NAN)).collect::<Vec<f64>>()
    };
    let values: Vec<f64> = shown.iter().flat_map(values_of).collect();
    let (low, high) = extremes(values.iter().copied());
    let range = if low > high { (0.0, 1.0) } else { wide_enough(low, high) };
    let centres = places(cells, space);
    let label = |cell: &usize| match space {
        Some(space) => format!("{} = {} {}", space.name, short(centres[*cell]), unit(&space.unit)).trim_end().to_owned(),
        None => format!("{index} {}", cells[*cell].label.rsplit(',').next().unwrap_or_default()),
    };
    Map { labels: shown.iter().map(label).collect(), ends, columns, values, range }
}

/// Range of the colours of a map: at least a hundredth of the values, so that small changes look
/// small.
fn wide_enough(low: f64, high: f64) -> (f64, f64) {
    let least = 1e-2 * low.abs().max(high.abs()).max(1e-300);
    if high - low >= least { (low, high) } else { (0.5 * (low + high) - 0.5 * least, 0.5 * (low + high) + 0.5 * least) }
}

/// The cell that each row of a map shows, from the lowest place on, and the ends of the map. Rows
/// are equally high, cells need not be.
fn rows(cells: &[Member], space: Option<&Space>) -> (Vec<usize>, (f64, f64)) {
    const FINER: usize = 4;
    let count = cells.len();
    let even = |faces: &[f64]| {
        let width = (faces[count] - faces[0]) / count as f64;
        faces.windows(2).all(|pair| (pair[1] - pair[0] - width).abs() < 1e-3 * width)
    };
    match space.map(|space| space.faces.as_slice()).filter(|faces| faces.len() == count + 1) {
        Some(faces) if !even(faces) => {
            let rows = (FINER * count).min(MOST_CELLS);
            let (low, high) = (faces[0], faces[count]);
            let at = |row: usize| low + (high - low) * (row as f64 + 0.5) / rows as f64;
            let cell = |row: usize| faces[1..].partition_point(|face| *face < at(row)).min(count - 1);
            ((0..rows).map(cell).collect(), (low, high))
        }
        faces => {
            let rows = count.min(MOST_CELLS);
            let numbers = places(cells, None);
            let ends = faces.map_or((numbers[0] - 0.5, numbers[count - 1] + 0.5), |faces| (faces[0], faces[count]));
            ((0..rows).map(|row| ((row as f64 + 0.5) / rows as f64 * count as f64) as usize).collect(), ends)
        }
    }
}

impl Map {
    /// The axis of space, for a map of some height.
    pub(super) fn upwards(&self, height: f64) -> Axis {
        Axis::new(self.ends.0, self.ends.1, ((height / 26.0) as usize).clamp(2, 8))
    }
}

impl Panel {
    /// Name and unit of the coordinate, `z [cm]`, where labels are in units of ten to `exponent`.
    pub(super) fn place_name(&self, exponent: i32) -> String {
        format!("{} {}", self.coordinate.0, bracketed(&self.coordinate.1, exponent)).trim_end().to_owned()
    }
}
