//! Reading of actions, initial states and disturbances.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::resample::{Between, Clock, Holds, SAME, on_steps};
use crate::catalogue::{Catalogue, Family, UnknownName};

/// Named numbers.
pub type Values = BTreeMap<String, f64>;

/// Named sequences, one value a step.
pub(crate) type Sequences = BTreeMap<String, Vec<f64>>;

/// Recorded inputs: a sequence for each column, one value a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Inputs {
    /// Number of steps.
    pub steps: usize,
    /// The sequences, in the order of the columns.
    pub sequences: Vec<Vec<f64>>,
    /// Name and step, from 1, of the first input that changes within a step, of which its mean is
    /// taken.
    pub split: Option<(String, usize)>,
}

/// A missing or invalid data file. Lines count from 1, the heading included.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// It cannot be opened or read.
    #[error("{}: {}", path.display(), crate::files::plain(source))]
    Read {
        /// The file.
        path: PathBuf,
        /// Reason.
        source: std::io::Error,
    },
    /// It is not a table.
    #[error("{}:{line}: {message}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line.
        line: u64,
        /// Message.
        message: String,
    },
    /// A cell is not a number.
    #[error("{}:{line}: column `{column}`: {} is not a finite number", path.display(), quoted(text))]
    NotANumber {
        /// The file.
        path: PathBuf,
        /// Line.
        line: u64,
        /// Column.
        column: String,
        /// The cell.
        text: String,
    },
    /// Columns are missing.
    #[error("{}:1: missing column{} {}; the file has: {}", path.display(), if names.len() == 1 { "" } else { "s" }, listed(names), listed(present))]
    MissingColumns {
        /// The file.
        path: PathBuf,
        /// The missing names.
        names: Vec<String>,
        /// The names there are.
        present: Vec<String>,
    },
    /// A column that the model does not have.
    #[error("{}:1: {error}", path.display())]
    UnknownColumn {
        /// The file.
        path: PathBuf,
        /// The name, and the right ones.
        error: UnknownName,
    },
    /// Disturbances for a model that has none.
    #[error("{}: the model declares no disturbances to replay", path.display())]
    NoDisturbances {
        /// The file.
        path: PathBuf,
    },
    /// Values for each step of a disturbance that follows data over time.
    #[error("{}: `{name}` follows data over time; a scenario names another file, `disturbances: {{{name}: {{from: other.csv}}}}`", path.display())]
    Measured {
        /// The file.
        path: PathBuf,
        /// The disturbance.
        name: String,
    },
    /// A table without rows.
    #[error("{}: no rows", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A table of a start alone.
    #[error("{}: the only row is that of the start; rows of steps are expected behind it", path.display())]
    NoSteps {
        /// The file.
        path: PathBuf,
    },
}

/// Names, the first few of many.
fn listed(names: &[String]) -> String {
    const SHOWN: usize = 50;
    match names.get(..SHOWN) {
        Some(first) if names.len() > SHOWN => format!("{} and {} more", first.join(", "), names.len() - SHOWN),
        _ => names.join(", "),
    }
}

/// A cell in a message; a long one is cut.
fn quoted(text: &str) -> String {
    const LONGEST: usize = 60;
    match text.len() {
        0 => "an empty cell".into(),
        n if n > LONGEST => format!("`{}...`", &text[..text.floor_char_boundary(LONGEST)]),
        _ => format!("`{text}`"),
    }
}

/// A table of text with the line of each row.
struct RawTable {
    path: PathBuf,
    names: Vec<String>,
    rows: Vec<(u64, csv::StringRecord)>,
}

impl RawTable {
    /// Parquet where the name ends in `.parquet`, CSV otherwise.
    fn read(path: &Path) -> Result<Self, DataError> {
        let file = crate::files::open(path).map_err(|source| DataError::Read { path: path.to_owned(), source })?;
        let table = if super::is_parquet(path) { Self::read_parquet(path, file) } else { Self::read_csv(path, file) }?;
        if table.rows.is_empty() { Err(DataError::Empty { path: path.to_owned() }) } else { Ok(table) }
    }

    /// Rows count as lines behind a heading, as if they stood in a table of text.
    fn read_parquet(path: &Path, file: std::fs::File) -> Result<Self, DataError> {
        let malformed = |message| DataError::Malformed { path: path.to_owned(), line: 1, message };
        let (names, cells) = super::parquet::read(file).map_err(malformed)?;
        let rows = (2..).zip(cells).map(|(line, row)| (line, csv::StringRecord::from(row))).collect();
        Ok(Self { path: path.to_owned(), names, rows })
    }

    fn read_csv(path: &Path, file: std::fs::File) -> Result<Self, DataError> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file);
        let fault = |error: csv::Error| fault(path, error);
        let names: Vec<String> =
            reader.headers().map_err(fault)?.iter().map(|name| name.trim_start_matches('\u{feff}').trim_matches('"').to_owned()).collect();
        if let [one] = names.as_slice()
            && let Some(separator) = one.chars().find(|c| matches!(c, ';' | '\t'))
        {
            let name = if separator == ';' { "semicolons" } else { "tabs" };
            let message = format!("the columns are separated by {name}; a table has commas between them and points in its numbers");
            return Err(DataError::Malformed { path: path.to_owned(), line: 1, message });
        }
        if let Some(line) = open_quote(path) {
            let message = "a quote is opened and never closed".into();
            return Err(DataError::Malformed { path: path.to_owned(), line, message });
        }
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(fault)?;
            rows.push((record.position().map_or(0, csv::Position::line), record));
        }
        Ok(Self { path: path.to_owned(), names, rows })
    }

    fn column(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    /// Refuses two columns with a name that is read; unread columns may repeat names.
    fn once<'n>(&self, names: impl Iterator<Item = &'n str>) -> Result<(), DataError> {
        let mut seen = HashMap::new();
        self.names.iter().for_each(|name| *seen.entry(name.as_str()).or_insert(0) += 1);
        match names.into_iter().find(|name| seen.get(name).is_some_and(|&count| count > 1)) {
            Some(twice) => {
                let message = format!("two columns are named `{twice}`");
                Err(DataError::Malformed { path: self.path.clone(), line: 1, message })
            }
            None => Ok(()),
        }
    }

    fn number(&self, row: usize, column: usize) -> Result<f64, DataError> {
        let (line, record) = &self.rows[row];
        let text = record.get(column).unwrap_or_default();
        match text.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(x),
            _ => Err(DataError::NotANumber {
                path: self.path.clone(),
                line: *line,
                column: self.names.get(column).cloned().unwrap_or_default(),
                text: text.into(),
            }),
        }
    }

    /// The rows of the steps. A column `step` counts them: where it begins with 0, as in the tables
    /// that are written, the first row is the start, before any step. A first row without any of
    /// the values that are read is the start too.
    fn rows_of_steps(&self, columns: &[usize]) -> Result<Range<usize>, DataError> {
        self.once(["step"].into_iter())?;
        let rows = self.rows.len();
        let first = match self.column("step").filter(|count| !columns.contains(count)) {
            Some(count) => self.counted_from(count)?,
            None => usize::from(!columns.is_empty() && self.is_blank(0, columns)),
        };
        if first == rows { Err(DataError::NoSteps { path: self.path.clone() }) } else { Ok(first..rows) }
    }

    /// The first row of a step, where a column counts the steps: 0 at the start, else 1 in the
    /// first row, and one more in every further one.
    fn counted_from(&self, count: usize) -> Result<usize, DataError> {
        let first = self.number(0, count)?;
        let mut expected = if first == 0.0 { 0.0 } else { 1.0 };
        for (row, (line, _)) in self.rows.iter().enumerate() {
            let found = self.number(row, count)?;
            if found != expected {
                let expected = if row == 0 { "0, the start, or 1".into() } else { expected.to_string() };
                let message = format!(
                    "the column `step` says {found} where {expected} is expected: rows are the steps of one run, one after another; leave \
                     the column out where it counts something else"
                );
                return Err(DataError::Malformed { path: self.path.clone(), line: *line, message });
            }
            expected += 1.0;
        }
        Ok(usize::from(first == 0.0))
    }

    /// The column `time`, where it is not one of those that are read for themselves.
    fn times(&self, columns: &[usize]) -> Result<Option<usize>, DataError> {
        self.once(["time"].into_iter())?;
        Ok(self.column("time").filter(|time| !columns.contains(time)))
    }

    /// Inputs by the column `time`, or row by row without one or with a column `step`.
    fn inputs(&self, columns: &[usize], clock: Clock) -> Result<Inputs, DataError> {
        let time = self.times(columns)?;
        let counted = self.column("step").filter(|count| !columns.contains(count));
        match time {
            Some(time) if counted.is_none() => return self.inputs_by_time(time, columns, clock),
            None if clock.between == Between::Linear => {
                return Err(self.malformed(1, "linear resampling needs a column `time`".into()));
            }
            _ => {}
        }
        let steps = self.rows_of_steps(columns)?;
        if let (Some(time), Some(count)) = (time, counted) {
            self.check_times(time, count, clock)?;
        }
        let sequence = |&c: &usize| steps.clone().map(|row| self.number(row, c)).collect::<Result<_, _>>();
        Ok(Inputs { steps: steps.len(), sequences: columns.iter().map(sequence).collect::<Result<_, _>>()?, split: None })
    }

    /// Returns `true` if a column `step` says that the first row is the start.
    fn begins_with_start(&self, columns: &[usize]) -> Result<bool, DataError> {
        let count = self.column("step").filter(|count| !columns.contains(count));
        count.map_or(Ok(false), |count| Ok(self.number(0, count)? == 0.0))
    }

    /// Refuses a time that is not within the step that the row counts: a step may end at an event,
    /// or where it began.
    fn check_times(&self, time: usize, count: usize, clock: Clock) -> Result<(), DataError> {
        for (row, (line, _)) in self.rows.iter().enumerate() {
            let (found, step) = (self.number(row, time)?, self.number(row, count)?);
            let end = step * clock.step;
            if found > end + SAME * clock.step || found < end - (1.0 + SAME) * clock.step {
                let message = format!(
                    "the column `time` has {found} at step {step}, which ends at {end}; leave the column `step` out to take the rows by \
                     their times, or the column `time` to take them one after another"
                );
                return Err(self.malformed(*line, message));
            }
        }
        Ok(())
    }

    fn inputs_by_time(&self, time: usize, columns: &[usize], clock: Clock) -> Result<Inputs, DataError> {
        let times = self.increasing_times(time)?;
        let end = match times.as_slice() {
            [.., a, b] => b + (b - a),
            all => all[0] + clock.step,
        };
        // As in the tables that are written, a value belongs to the interval that ends at its time
        // unless the first row has one at the start.
        let begins = times[0] <= SAME * clock.step && !self.is_blank(0, columns);
        let holds = if begins { Holds::After(end) } else { Holds::Before };
        let (mut sequences, mut split) = (Vec::new(), None);
        for &column in columns {
            let filled: Vec<usize> = (0..self.rows.len()).filter(|&row| !self.is_blank(row, &[column])).collect();
            let at: Vec<f64> = filled.iter().map(|&row| times[row]).collect();
            let values = filled.iter().map(|&row| self.number(row, column)).collect::<Result<Vec<f64>, _>>()?;
            let line = filled.first().map_or(self.rows[0].0, |&row| self.rows[row].0);
            let fault = |error| self.malformed(line, format!("column `{}`: {error}", self.names[column]));
            let mut found = on_steps(&at, &values, clock, holds).map_err(fault)?;
            if found.whole == 0 {
                let message = format!("column `{}`: the record ends before the end of the first step, {}", self.names[column], clock.step);
                return Err(self.malformed(line, message));
            }
            found.values.truncate(found.whole);
            split = split.or(found.split.map(|step| (self.names[column].clone(), step + 1)));
            sequences.push(found.values);
        }
        let steps = sequences.iter().map(Vec::len).min().unwrap_or_default();
        sequences.iter_mut().for_each(|sequence| sequence.truncate(steps));
        Ok(Inputs { steps, sequences, split })
    }

    /// Times of the rows, which increase from the start of the run, 0, or later.
    fn increasing_times(&self, time: usize) -> Result<Vec<f64>, DataError> {
        let mut times: Vec<f64> = Vec::with_capacity(self.rows.len());
        for (row, (line, _)) in self.rows.iter().enumerate() {
            let found = self.number(row, time)?;
            if found < 0.0 {
                return Err(self.malformed(*line, format!("the column `time` has {found}; a run begins at 0")));
            }
            if let Some(before) = times.last().filter(|&&before| found <= before) {
                return Err(self.malformed(*line, format!("the column `time` has {found} after {before}; times must increase")));
            }
            times.push(found);
        }
        Ok(times)
    }

    fn malformed(&self, line: u64, message: String) -> DataError {
        DataError::Malformed { path: self.path.clone(), line, message }
    }

    fn is_blank(&self, row: usize, columns: &[usize]) -> bool {
        columns.iter().all(|&c| self.rows[row].1.get(c).is_none_or(str::is_empty))
    }
}

/// The line in which a quoted cell begins that does not end: the reader takes the rest of the file
/// for its text.
fn open_quote(path: &Path) -> Option<u64> {
    let bytes = std::fs::read(path).ok()?;
    let (mut open, mut line) = (None, 1);
    for byte in bytes {
        match byte {
            b'"' => open = if open.is_some() { None } else { Some(line) },
            b'\n' => line += 1,
            _ => {}
        }
    }
    open
}

fn fault(path: &Path, error: csv::Error) -> DataError {
    let line = error.position().map_or(1, csv::Position::line);
    let message = match error.kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("the row has {len} cells, the heading has {expected_len}")
        }
        csv::ErrorKind::Utf8 { .. } => "the text is not UTF-8".into(),
        _ => match error.into_kind() {
            csv::ErrorKind::Io(source) => {
                return DataError::Read { path: path.to_owned(), source };
            }
            _ => "the file is not a CSV table".into(),
        },
    };
    DataError::Malformed { path: path.to_owned(), line, message }
}

/// Actions of the steps 1, 2, ...: a sequence for each action in their order. With a column `time`
/// and none that counts the steps, rows are taken by their times. Otherwise they follow one
/// another; the start, step 0, and a first row without actions left out. Other columns are ignored.
///
/// # Errors
/// See [`DataError`].
pub fn read_actions(path: &Path, catalogue: &Catalogue, clock: Clock) -> Result<Inputs, DataError> {
    let table = RawTable::read(path)?;
    let columns = required(&table, &catalogue.actions)?;
    let inputs = table.inputs(&columns, clock)?;
    if table.begins_with_start(&columns)? && !table.is_blank(0, &columns) {
        let message =
            "an action is in the row of step 0, the start, before any step: count the steps from 1, or leave the column `step` out";
        return Err(table.malformed(table.rows[0].0, message.into()));
    }
    Ok(inputs)
}

fn required(table: &RawTable, family: &Family) -> Result<Vec<usize>, DataError> {
    table.once(family.names())?;
    let found: Vec<Option<usize>> = family.names().map(|name| table.column(name)).collect();
    let missing: Vec<String> = family.names().zip(&found).filter(|(_, f)| f.is_none()).map(|(name, _)| name.to_owned()).collect();
    if missing.is_empty() {
        Ok(found.into_iter().flatten().collect())
    } else {
        Err(DataError::MissingColumns { path: table.path.clone(), names: missing, present: table.names.clone() })
    }
}

/// Recorded disturbances of the steps 1, 2, ...: the columns named as disturbances, of which there
/// must be one, taken as [`read_actions`] does. Returns also the first one that changes within a
/// step. The start, step 0, is skipped whatever it contains.
///
/// # Errors
/// See [`DataError`].
pub fn read_disturbances(path: &Path, catalogue: &Catalogue, clock: Clock) -> Result<(Sequences, Option<(String, usize)>), DataError> {
    let table = RawTable::read(path)?;
    if catalogue.disturbances.is_empty() {
        return Err(match catalogue.measured.iter().find(|name| table.column(name).is_some()) {
            Some(name) => DataError::Measured { name: name.clone(), path: table.path },
            None => DataError::NoDisturbances { path: table.path },
        });
    }
    table.once(catalogue.disturbances.names())?;
    let names: Vec<&str> = catalogue.disturbances.names().filter(|name| table.column(name).is_some()).collect();
    let columns: Vec<usize> = names.iter().filter_map(|name| table.column(name)).collect();
    if columns.is_empty() {
        let names = catalogue.disturbances.names().map(str::to_owned).collect();
        return Err(DataError::MissingColumns { path: table.path.clone(), names, present: table.names.clone() });
    }
    let inputs = table.inputs(&columns, clock)?;
    Ok((names.iter().map(|name| (*name).to_owned()).zip(inputs.sequences).collect(), inputs.split))
}

/// Values with which an episode begins.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Initial {
    /// States and guesses of algebraic variables that are solved for.
    pub unknowns: Values,
    /// Discrete variables.
    pub discretes: Values,
}

/// Initial values by name: one row with a column for each, where empty cells are left out, or the
/// table that `smpl steady --out` writes, with the columns `name` and `value`. Explicit algebraic
/// variables follow from the others and are ignored.
///
/// # Errors
/// See [`DataError`]; a name that the model does not have is one.
pub fn read_initial(path: &Path, catalogue: &Catalogue) -> Result<Initial, DataError> {
    let table = RawTable::read(path)?;
    table.once(table.names.iter().map(String::as_str))?;
    let mut out = Initial::default();
    if let (Some(name), Some(value)) = (table.column("name"), table.column("value")) {
        for row in 0..table.rows.len() {
            let given = table.rows[row].1.get(name).unwrap_or_default().to_owned();
            if let Some(into) = out.part(&table, catalogue, &given)? {
                into.insert(given, table.number(row, value)?);
            }
        }
        return Ok(out);
    }
    if table.rows.len() > 1 {
        let message = format!("one row of initial values expected, or columns `name` and `value`, found {} rows", table.rows.len());
        return Err(DataError::Malformed { path: table.path, line: table.rows[1].0, message });
    }
    for (column, name) in table.names.iter().enumerate() {
        if let Some(into) = out.part(&table, catalogue, name)?
            && !table.is_blank(0, &[column])
        {
            into.insert(name.clone(), table.number(0, column)?);
        }
    }
    Ok(out)
}

impl Initial {
    /// The part that a name belongs to; `None` for a variable that follows from others.
    fn part(&mut self, table: &RawTable, catalogue: &Catalogue, name: &str) -> Result<Option<&mut Values>, DataError> {
        if catalogue.states.find(name).is_some() || catalogue.solved.find(name).is_some() {
            return Ok(Some(&mut self.unknowns));
        }
        if catalogue.discretes.find(name).is_some() {
            return Ok(Some(&mut self.discretes));
        }
        if catalogue.algebraics.find(name).is_some() {
            return Ok(None);
        }
        let known = catalogue.states.names().chain(catalogue.solved.names()).chain(catalogue.discretes.names());
        let error = UnknownName::new("state, algebraic or discrete variable", name, known);
        Err(DataError::UnknownColumn { path: table.path.clone(), error })
    }
}

/// A table as numbers.
pub struct Columns {
    /// Names of the columns.
    pub names: Vec<String>,
    /// One list per column: `true` and `false` as 1 and 0, other texts as NaN.
    pub values: Vec<Vec<f64>>,
    /// For each row the key of its run, if the table has several: the columns before `step`, by
    /// name.
    pub keys: Vec<String>,
}

/// All columns of a table.
///
/// # Errors
/// See [`DataError`].
pub fn read_columns(path: &Path) -> Result<Columns, DataError> {
    let table = RawTable::read(path)?;
    table.once(table.names.iter().map(String::as_str))?;
    let number = |text: &str| match text {
        "true" => 1.0,
        "false" => 0.0,
        text => text.parse().unwrap_or(f64::NAN),
    };
    let column = |at: usize| table.rows.iter().map(|(_, record)| number(record.get(at).unwrap_or_default())).collect();
    let values = (0..table.names.len()).map(column).collect();
    let keys = table.column("step").unwrap_or_default();
    let key = |record: &csv::StringRecord| -> String {
        let parts = table.names.iter().zip(record).take(keys).filter(|(_, value)| !value.is_empty());
        parts.map(|(name, value)| format!("{name} {value}")).collect::<Vec<_>>().join(", ")
    };
    let keys = table.rows.iter().map(|(_, record)| key(record)).collect();
    Ok(Columns { names: table.names, values, keys })
}
