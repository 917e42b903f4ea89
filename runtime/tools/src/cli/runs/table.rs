//! Tables of many runs: every row of all of them, one row a run, and a few lines for people.

use super::{Point, RunResult, ends, moments, returns};
use crate::cli::simulate::SimulateArguments;
use crate::picture::Run;
use smpl_runtime::failure::Short;
use smpl_runtime::scenario::Value;
use smpl_runtime::trajectory::{Cell, ColumnType, Table};

/// Columns that distinguish runs.
pub(super) struct Keys<'a> {
    pub arguments: &'a SimulateArguments,
    pub points: &'a [Point],
    pub episodes: usize,
}

impl Keys<'_> {
    /// Columns: the number of the run, the values of the sweeps, the seed. A sweep whose name is
    /// that of another column, as that of the start of a state, is `sweep.NAME`.
    fn columns(&self, others: &[(String, ColumnType)]) -> Vec<(String, ColumnType)> {
        let taken = |name: &str| matches!(name, "run" | "seed") || others.iter().any(|(other, _)| other == name);
        let sweeps = self.arguments.sweep.iter().map(|sweep| {
            let numbers = sweep.values.iter().all(|value| value.number().is_some());
            let name = if taken(&sweep.name) { format!("sweep.{}", sweep.name) } else { sweep.name.clone() };
            (name, if numbers { ColumnType::Number } else { ColumnType::Text })
        });
        let run = std::iter::once(("run".to_owned(), ColumnType::Integer));
        run.chain(sweeps).chain([("seed".to_owned(), self.kind_of_seeds())]).collect()
    }

    /// Seeds that have no place among signed numbers make the column one of unsigned numbers.
    fn kind_of_seeds(&self) -> ColumnType {
        let last = self.arguments.seed.saturating_add(self.episodes as u64 - 1);
        if i64::try_from(last).is_ok() { ColumnType::Integer } else { ColumnType::Natural }
    }

    fn point(&self, index: usize) -> &Point {
        &self.points[index / self.episodes]
    }

    /// Cells of a run.
    fn cells(&self, index: usize, table: &mut Table) -> Vec<Cell> {
        let mut cells = vec![Cell::Integer(index as i64)];
        let kinds: Vec<ColumnType> = self.columns(&[]).iter().map(|(_, kind)| *kind).collect();
        for (value, kind) in self.point(index).values.iter().zip(&kinds[1..]) {
            cells.push(match (value, kind) {
                (Value::Number(x), ColumnType::Number) => Cell::Number(*x),
                (value, _) => table.text(&value.to_string()),
            });
        }
        let seed = self.seed(index);
        cells.push(match (self.kind_of_seeds(), i64::try_from(seed)) {
            (ColumnType::Integer, Ok(seed)) => Cell::Integer(seed),
            _ => Cell::Natural(seed),
        });
        cells
    }

    fn seed(&self, index: usize) -> u64 {
        self.arguments.seed.wrapping_add((index % self.episodes) as u64)
    }

    /// Name of a run in a legend.
    fn label(&self, index: usize) -> String {
        let sweeps = self.arguments.sweep.iter().zip(&self.point(index).values).map(|(s, value)| format!("{} = {}", s.name, shown(value)));
        let seed = (self.episodes > 1).then(|| format!("seed {}", self.seed(index)));
        sweeps.chain(seed).collect::<Vec<_>>().join(", ")
    }
}

fn shown(value: &Value) -> String {
    value.number().map_or_else(|| value.to_string(), |x| Short(x).to_string())
}

/// Every row of every run, one after another, with the columns that tell them apart first. Columns
/// that some runs do not have are empty there.
pub(super) fn rows(keys: &Keys<'_>, outcomes: &[RunResult]) -> Table {
    let mut columns: Vec<(String, ColumnType)> = Vec::new();
    for (name, kind) in outcomes.iter().filter_map(|o| o.table.as_ref()).flat_map(|table| table.columns()) {
        // Runs of one setup have the same columns, so that nearly always the last one is looked at
        // first.
        if !columns.iter().any(|(known, _)| known == name) {
            columns.push((name.clone(), *kind));
        }
    }
    let key_columns = keys.columns(&columns);
    let all = key_columns.iter().cloned().chain(columns.iter().cloned()).collect();
    let mut out = Table::new(all);
    for (index, outcome) in outcomes.iter().enumerate() {
        let Some(table) = &outcome.table else { continue };
        let places: Vec<Option<usize>> = match table.columns() == columns.as_slice() {
            true => (0..columns.len()).map(Some).collect(),
            false => columns.iter().map(|(name, _)| table.columns().iter().position(|(n, _)| n == name)).collect(),
        };
        let key = keys.cells(index, &mut out);
        for row in 0..table.len() {
            let cells = table.row(row);
            out.push(key.iter().copied().chain(places.iter().map(|at| at.map_or(Cell::Empty, |at| cells[at]))));
        }
    }
    out
}

/// One row a run: keys, steps, time, sums of rewards, how it ended, and the parameters that were
/// drawn.
pub(super) fn summary(keys: &Keys<'_>, outcomes: &[RunResult]) -> Table {
    let rewards = &keys.points[0].setup.model().interface().finish.rewards;
    let mut drawn: Vec<String> = Vec::new();
    for (name, _) in outcomes.iter().flat_map(|o| &o.drawn) {
        if !drawn.contains(name) {
            drawn.push(name.clone());
        }
    }
    let mut columns =
        vec![("steps".to_owned(), ColumnType::Integer), ("time".to_owned(), ColumnType::Number), ("return".to_owned(), ColumnType::Number)];
    columns.extend(rewards.iter().map(|r| (format!("sum.{}", r.name), ColumnType::Number)));
    columns.extend(["end", "failure"].map(|name| (name.to_owned(), ColumnType::Text)));
    columns.extend(drawn.iter().map(|name| (format!("param.{name}"), ColumnType::Number)));
    let mut out = Table::new(keys.columns(&columns).into_iter().chain(columns).collect());
    for (index, outcome) in outcomes.iter().enumerate() {
        let mut row = keys.cells(index, &mut out);
        row.extend([Cell::Integer(outcome.steps.into()), Cell::Number(outcome.time)]);
        // Another scenario may declare other rewards.
        let same = outcome.sums.len() == rewards.len() + 1;
        let sum = |i: usize| if same || i == 0 { Cell::Number(outcome.sums[i]) } else { Cell::Empty };
        row.extend((0..=rewards.len()).map(sum));
        row.extend([out.text(outcome.end.word()), out.text(outcome.end.message())]);
        let value = |name: &String| outcome.drawn.iter().find(|(n, _)| n == name).map_or(Cell::Empty, |(_, x)| Cell::Number(*x));
        row.extend(drawn.iter().map(value));
        out.push(row);
    }
    out
}

/// Most runs that are drawn over one another.
pub(super) const MOST_DRAWN: usize = 200;

/// The runs as they are drawn, the first ones of many.
pub(super) fn pictures(keys: &Keys<'_>, outcomes: &[RunResult]) -> Vec<Run> {
    let grids = |point: usize| &keys.points[point].setup.model().interface().grids;
    let run = |(index, outcome): (usize, &RunResult)| {
        let moved = outcome.moved || grids(index / keys.episodes) != grids(0);
        Some(Run::of_table(&keys.label(index), outcome.table.as_ref()?).with_moved(moved))
    };
    outcomes.iter().enumerate().filter_map(run).take(MOST_DRAWN).collect()
}

/// A line for each combination: its values, mean and standard deviation of the return, ends.
pub(super) fn points_as_text(keys: &Keys<'_>, outcomes: &[RunResult]) -> String {
    const MOST: usize = 60;
    let mut lines: Vec<Vec<String>> = vec![keys.arguments.sweep.iter().map(|s| s.name.clone()).collect()];
    lines[0].extend(["mean", "deviation", "ends"].map(str::to_owned));
    for (point, part) in keys.points.iter().zip(outcomes.chunks(keys.episodes)).take(MOST) {
        let returns: Vec<f64> = returns(part).collect();
        let (mean, deviation) = if returns.is_empty() { (f64::NAN, f64::NAN) } else { moments(&returns) };
        let mut line: Vec<String> = point.values.iter().map(shown).collect();
        let number = |x: f64| if x.is_nan() { "-".to_owned() } else { Short(x).to_string() };
        line.extend([number(mean), number(deviation), ends(part)]);
        lines.push(line);
    }
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or_default();
    let widths: Vec<usize> = (0..lines[0].len() - 1).map(width).collect();
    let mut text = String::new();
    for line in &lines {
        for (cell, width) in line.iter().zip(&widths) {
            text.push_str(&format!("  {cell:>width$}"));
        }
        text.push_str(&format!("  {}\n", line[line.len() - 1]));
    }
    if keys.points.len() > MOST {
        text.push_str(&format!("  ... and {} more; `--summary S.csv` has one row a run\n", keys.points.len() - MOST));
    }
    text
}

#[cfg(test)]
mod tests {
    use crate::cli::runs::End;

    #[test]
    fn a_failure_is_counted_under_its_identifier() {
        assert_eq!(End::Failed("state_box: T = 101 above 100".into()).word(), "state_box");
        assert_eq!(End::Failed("empty".into()).word(), "empty");
        assert_eq!(End::TimeLimit.word(), "time limit");
    }
}
