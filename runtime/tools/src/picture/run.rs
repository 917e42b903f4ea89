//! One run as it is drawn: its columns, and what is known of it between sampling instants.

use std::collections::HashMap;
use std::path::Path;

use super::items::Role;
use super::plan::{PanelPlan, PlotKind};
use smpl_runtime::environment::{Environment, Followed, StepError, Trace};
use smpl_runtime::setup::{Setup, SetupError};
use smpl_runtime::trajectory::{Columns, DataError, Table};

/// A run.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// Label that distinguishes it from other runs.
    pub label: String,
    names: Vec<String>,
    columns: HashMap<String, Vec<f64>>,
    /// Values at points within steps.
    dense: Option<Dense>,
    /// When the model's events went on, with their names.
    pub events: Vec<(f64, String)>,
    /// When which phase began, by its number from 0.
    pub phases: Vec<(f64, usize)>,
    /// Cells may lie elsewhere than the compiled model says: parameters that place them had other
    /// values.
    pub moved: bool,
}

/// Curves between sampling instants.
#[derive(Clone, Debug, Default)]
pub(super) struct Dense {
    times: Vec<f64>,
    curves: HashMap<String, Vec<f64>>,
}

impl Run {
    /// The run of a table.
    #[must_use]
    pub fn of_table(label: &str, table: &Table) -> Self {
        let names: Vec<String> = table.columns().iter().map(|(name, _)| name.clone()).collect();
        let columns = names.iter().filter_map(|name| Some((name.clone(), table.numbers(name)?))).collect();
        Self::of_columns(label, names, columns)
    }

    /// The runs of a file that `smpl simulate --out` wrote, one after another.
    ///
    /// # Errors
    /// See [`DataError`].
    pub fn read(path: &Path) -> Result<Vec<Self>, DataError> {
        let Columns { names, values, keys } = smpl_runtime::trajectory::read_columns(path)?;
        let stem = path.file_stem().map_or_else(|| path.display().to_string(), |stem| stem.to_string_lossy().into_owned());
        let mut runs = Vec::new();
        let mut begin = 0;
        for part in keys.chunk_by(|a, b| a == b) {
            let rows = begin..begin + part.len();
            let columns = names.iter().zip(&values).map(|(name, column)| (name.clone(), column[rows.clone()].to_vec())).collect();
            let label = if part[0].is_empty() { stem.clone() } else { part[0].clone() };
            runs.push(Self::of_columns(&label, names.clone(), columns));
            begin = rows.end;
        }
        Ok(runs)
    }

    fn of_columns(label: &str, names: Vec<String>, columns: HashMap<String, Vec<f64>>) -> Self {
        let mut run = Self { label: label.to_owned(), names, columns, ..Self::default() };
        run.phases = run.phases_of_steps();
        run
    }

    /// The same run, whose cells may lie elsewhere than the compiled model says, or do not.
    #[must_use]
    pub fn with_moved(self, moved: bool) -> Self {
        Self { moved, ..self }
    }

    /// Adds what was followed within steps.
    pub fn refine(&mut self, dense: Followings) {
        self.events = dense.events;
        if !dense.phases.is_empty() {
            self.phases = dense.phases;
        }
        self.dense = Some(dense.curves);
    }

    /// Names of the columns, in their order.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The values of a column, one a row.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.get(name).map(Vec::as_slice)
    }

    /// Times of the rows; their numbers where no column says.
    #[must_use]
    pub fn time(&self) -> Vec<f64> {
        let rows = self.columns.values().map(Vec::len).max().unwrap_or_default();
        self.column("time").map_or_else(|| (0..rows).map(|i| i as f64).collect(), <[f64]>::to_vec)
    }

    /// Returns `true` if a column is empty in the first row and has numbers after it, as those of
    /// actions are.
    #[must_use]
    pub(crate) fn is_action(&self, name: &str) -> bool {
        let empty_first = |column: &[f64]| column.len() > 1 && column[0].is_nan() && column[1..].iter().any(|x| x.is_finite());
        self.column(name).is_some_and(empty_first)
    }

    /// A curve: points within steps where they are known, else those of the rows.
    #[must_use]
    pub fn curve(&self, column: &str, role: Role) -> (Vec<f64>, Vec<f64>) {
        if let Some((times, values)) = self.dense.as_ref().and_then(|d| Some((&d.times, d.curves.get(column)?))) {
            return (times.clone(), values.clone());
        }
        let values = self.column(column).unwrap_or_default();
        if role.is_held() || role == Role::Discrete { staircase(&self.time(), values) } else { (self.time(), values.to_vec()) }
    }

    /// Times and values of a column within steps, where they are known.
    #[must_use]
    pub(super) fn within_steps(&self, column: &str) -> Option<(&[f64], &[f64])> {
        let dense = self.dense.as_ref()?;
        Some((&dense.times, dense.curves.get(column)?))
    }

    /// Beginnings of phases as rows tell them.
    fn phases_of_steps(&self) -> Vec<(f64, usize)> {
        let (Some(phase), time) = (self.column("phase"), self.time()) else { return Vec::new() };
        let starts = self.column("phase_start").unwrap_or(&time);
        let mut phases: Vec<(f64, usize)> = Vec::new();
        for ((number, start), now) in phase.iter().zip(starts).zip(&time).filter(|((n, _), _)| **n >= 1.0) {
            let number = *number as usize - 1;
            if phases.last().is_none_or(|(_, last)| *last != number) {
                phases.push((if start <= now { *start } else { *now }, number));
            }
        }
        phases
    }
}

/// Staircase of values that hold over the step which ends at their row.
fn staircase(time: &[f64], values: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut times, mut stairs) = (Vec::with_capacity(2 * time.len()), Vec::with_capacity(2 * time.len()));
    let mut before: Option<f64> = None;
    for (&t, &x) in time.iter().zip(values) {
        if let Some(last) = before {
            times.push(last);
            stairs.push(x);
        }
        times.push(t);
        stairs.push(x);
        before = Some(t);
    }
    (times, stairs)
}

/// Values recorded by a [`Follower`].
#[derive(Clone, Debug, Default)]
pub struct Followings {
    curves: Dense,
    events: Vec<(f64, String)>,
    phases: Vec<(f64, usize)>,
}

/// Quantities to follow within steps, and the number of points.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tracing {
    /// Columns of the curves.
    pub(crate) columns: Vec<String>,
    sources: Vec<Followed>,
    points: u32,
    /// The number of the phase is followed too, last.
    has_phase: bool,
}

/// Points that a curve should have at least.
const POINTS: u32 = 600;
/// Most points of a step.
const MOST_POINTS: u32 = 40;
/// Fields of more cells are drawn as they are at the ends of steps.
const MOST_FOLLOWED: usize = 2000;

impl Tracing {
    /// For a run of `steps` steps; `None` where steps are short enough and nothing happens within.
    pub(crate) fn new(setup: &Setup, wanted: impl Iterator<Item = (String, Followed)>, steps: u32) -> Option<Self> {
        let points = (POINTS / steps.max(1)).clamp(1, MOST_POINTS);
        if points == 1 && setup.model().roots_info().is_empty() {
            return None;
        }
        let mut known = std::collections::HashSet::new();
        let (columns, mut sources): (Vec<String>, Vec<Followed>) = wanted.filter(|(column, _)| known.insert(column.clone())).unzip();
        sources.extend(setup.phase.map(Followed::Discrete));
        Some(Self { columns, sources, points, has_phase: setup.phase.is_some() })
    }

    /// Makes an environment note these numbers.
    pub(crate) fn begin(&self, environment: &mut Environment) {
        environment.trace(self.sources.clone(), self.points);
    }

    /// The curve of a column, and the numbers of the phase after all columns.
    pub(crate) fn curve(&self, trace: &Trace, at: usize) -> Vec<f64> {
        trace.values.iter().skip(at).step_by(self.sources.len().max(1)).copied().collect()
    }

    /// Recorded values.
    pub(crate) fn followings(&self, setup: &Setup, trace: &Trace) -> Followings {
        let (interface, roots) = (setup.model().interface(), setup.model().roots_info());
        let named = trace.events.iter().filter_map(|(t, root)| Some((*t, roots.get(*root)?.name.clone())));
        let events = named.filter(|(_, name)| !interface.phases.contains(name)).collect();
        let phases = if self.has_phase { phases_of(&trace.times, &self.curve(trace, self.columns.len())) } else { Vec::new() };
        let curves = self.columns.iter().enumerate().map(|(i, name)| (name.clone(), self.curve(trace, i))).collect();
        Followings { curves: Dense { curves, times: trace.times.clone() }, events, phases }
    }
}

/// Goes along with an environment, step by step, and looks at what happens within steps. The
/// environment's own results are not touched: steps are taken twice.
pub struct Follower {
    shadow: Environment,
    tracing: Tracing,
}

impl Follower {
    /// For an environment of `setup` and a run of `steps` steps; `None` where steps are short
    /// enough and nothing happens within.
    ///
    /// # Errors
    /// If the solver refuses the system, which it has accepted before.
    pub fn new(setup: &std::sync::Arc<Setup>, panels: &[PanelPlan], steps: u32) -> Result<Option<Self>, SetupError> {
        let Some(tracing) = Tracing::new(setup, followed(panels), steps) else { return Ok(None) };
        let mut shadow = Environment::new(std::sync::Arc::clone(setup))?;
        shadow.set_keep_going(true);
        tracing.begin(&mut shadow);
        Ok(Some(Self { shadow, tracing }))
    }

    /// To be called before the environment takes a step with `action`.
    ///
    /// # Errors
    /// That the environment itself has for the step.
    pub fn follow(&mut self, environment: &Environment, action: &[f64]) -> Result<(), StepError> {
        if self.shadow.restore(&environment.snapshot()).is_ok() {
            self.shadow.step(action)?;
        }
        Ok(())
    }

    /// Recorded values.
    #[must_use]
    pub fn finish(mut self) -> Followings {
        let trace = self.shadow.take_trace().unwrap_or_default();
        self.tracing.followings(self.shadow.setup(), &trace)
    }
}

/// The columns of panels that have values within steps.
pub(crate) fn followed(panels: &[PanelPlan]) -> impl Iterator<Item = (String, Followed)> + '_ {
    let lines = panels.iter().flat_map(|panel| match &panel.kind {
        PlotKind::Lines(lines) => lines.as_slice(),
        _ => &[],
    });
    let fields = panels.iter().filter_map(|panel| match &panel.kind {
        PlotKind::Map(cells) if cells.len() <= MOST_FOLLOWED => Some(cells),
        _ => None,
    });
    let members = lines.map(|line| &line.member).chain(fields.flatten());
    members.filter_map(|member| Some((member.column.clone(), member.source?)))
}

/// Beginnings of phases, by their numbers at times.
fn phases_of(times: &[f64], numbers: &[f64]) -> Vec<(f64, usize)> {
    let mut phases: Vec<(f64, usize)> = Vec::new();
    for (t, number) in times.iter().zip(numbers).filter(|(_, number)| **number >= 1.0) {
        let number = *number as usize - 1;
        if phases.last().is_none_or(|(_, last)| *last != number) {
            phases.push((*t, number));
        }
    }
    phases
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(columns: &[(&str, &[f64])]) -> Run {
        let names = columns.iter().map(|(name, _)| (*name).to_owned()).collect();
        Run::of_columns("a", names, columns.iter().map(|(name, values)| ((*name).to_owned(), values.to_vec())).collect())
    }

    #[test]
    fn an_action_is_a_staircase_over_the_steps_that_end_in_its_rows() {
        let run = run(&[("time", &[0.0, 1.0, 2.0]), ("u", &[f64::NAN, 3.0, 4.0])]);
        assert!(run.is_action("u") && !run.is_action("time"));
        let (times, values) = run.curve("u", Role::Action);
        assert_eq!(times, [0.0, 0.0, 1.0, 1.0, 2.0]);
        assert!(values[0].is_nan());
        assert_eq!(values[1..], [3.0, 3.0, 4.0, 4.0]);
    }

    #[test]
    fn a_phase_begins_where_its_column_says() {
        let time: &[f64] = &[0.0, 1.0, 2.0, 3.0];
        let run = run(&[("time", time), ("phase", &[1.0, 1.0, 2.0, 1.0]), ("phase_start", &[0.0, 0.0, 1.5, 3.0])]);
        assert_eq!(run.phases, [(0.0, 0), (1.5, 1), (3.0, 0)]);
    }
}
