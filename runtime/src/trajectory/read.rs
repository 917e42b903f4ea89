//! Reading of actions, initial states and disturbances.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::catalogue::{Catalogue, Family, UnknownName};

/// Named numbers.
pub type Values = BTreeMap<String, f64>;

/// Named sequences, one value a step.
pub(crate) type Sequences = BTreeMap<String, Vec<f64>>;

/// A data file that is missing or at fault. Lines count from 1, the heading included.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// It cannot be opened or read.
    #[error("{}: {}", path.display(), crate::files::plain(source))]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is no table.
    #[error("{}:{line}: {message}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line.
        line: u64,
        /// What is wrong.
        message: String,
    },
    /// A cell is no number.
    #[error("{}:{line}: column `{column}`: {} is no finite number", path.display(), quoted(text))]
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

    /// Refuses two columns of a name that is read; what is not read may stand there as often as it likes.
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

    /// The rows of the steps. A column `step` counts them: where it begins with 0, as in the tables that are written, the first row is the
    /// start, before any step. A first row without any of the values that are read is the start too.
    fn rows_of_steps(&self, columns: &[usize]) -> Result<Range<usize>, DataError> {
        self.once(["step"].into_iter())?;
        let rows = self.rows.len();
        let first = match self.column("step").filter(|count| !columns.contains(count)) {
            Some(count) => self.counted_from(count)?,
            None => usize::from(!columns.is_empty() && self.is_blank(0, columns)),
        };
        if first == rows { Err(DataError::NoSteps { path: self.path.clone() }) } else { Ok(first..rows) }
    }

    /// The first row of a step, where a column counts the steps: 0 at the start, else 1 in the first row, and one more in every further one.
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

    fn is_blank(&self, row: usize, columns: &[usize]) -> bool {
        columns.iter().all(|&c| self.rows[row].1.get(c).is_none_or(str::is_empty))
    }
}

/// The line in which a quoted cell begins that does not end: the reader takes the rest of the file for its text.
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
            _ => "the file is no CSV table".into(),
        },
    };
    DataError::Malformed { path: path.to_owned(), line, message }
}

/// Actions of the steps 1, 2, ...: one row a step with one number an action in their order. The start, step 0, is skipped, and a first row
/// without actions; columns other than `step` are ignored.
///
/// # Errors
/// See [`DataError`].
pub fn read_actions(path: &Path, catalogue: &Catalogue) -> Result<Vec<Vec<f64>>, DataError> {
    let table = RawTable::read(path)?;
    let columns = required(&table, &catalogue.actions)?;
    let steps = table.rows_of_steps(&columns)?;
    if steps.start == 1 && !table.is_blank(0, &columns) {
        let message =
            "an action stands in the row of step 0, the start, before any step: count the steps from 1, or leave the column `step` out";
        return Err(DataError::Malformed { path: table.path.clone(), line: table.rows[0].0, message: message.into() });
    }
    steps.map(|row| columns.iter().map(|&c| table.number(row, c)).collect()).collect()
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

/// Recorded disturbances of the steps 1, 2, ...: the columns named as disturbances, of which there must be one. The start, step 0, is skipped
/// whatever stands there, and a first row without disturbances; columns other than `step` are ignored.
///
/// # Errors
/// See [`DataError`].
pub(crate) fn read_disturbances(path: &Path, catalogue: &Catalogue) -> Result<Sequences, DataError> {
    let table = RawTable::read(path)?;
    if catalogue.disturbances.is_empty() {
        return Err(DataError::NoDisturbances { path: table.path });
    }
    table.once(catalogue.disturbances.names())?;
    let names: Vec<&str> = catalogue.disturbances.names().filter(|name| table.column(name).is_some()).collect();
    let columns: Vec<usize> = names.iter().filter_map(|name| table.column(name)).collect();
    if columns.is_empty() {
        let names = catalogue.disturbances.names().map(str::to_owned).collect();
        return Err(DataError::MissingColumns { path: table.path.clone(), names, present: table.names.clone() });
    }
    let steps = table.rows_of_steps(&columns)?;
    let sequence = |&c: &usize| steps.clone().map(|row| table.number(row, c)).collect::<Result<_, _>>();
    names.iter().zip(&columns).map(|(name, c)| Ok(((*name).to_owned(), sequence(c)?))).collect()
}

/// One row of initial values: states and discrete variables by name. Empty cells are left out.
///
/// # Errors
/// See [`DataError`]; a column that names neither is one.
pub fn read_initial(path: &Path, catalogue: &Catalogue) -> Result<(Values, Values), DataError> {
    let table = RawTable::read(path)?;
    table.once(table.names.iter().map(String::as_str))?;
    if table.rows.len() > 1 {
        let message = format!("one row of initial values expected, found {}", table.rows.len());
        return Err(DataError::Malformed { path: table.path, line: table.rows[1].0, message });
    }
    let (mut states, mut discretes) = (BTreeMap::new(), BTreeMap::new());
    for (column, name) in table.names.iter().enumerate() {
        let into = match (catalogue.states.find(name), catalogue.discretes.find(name)) {
            (Some(_), _) => &mut states,
            (None, Some(_)) => &mut discretes,
            (None, None) => {
                let known = catalogue.states.names().chain(catalogue.discretes.names());
                let error = UnknownName::new("state or discrete variable", name, known);
                return Err(DataError::UnknownColumn { path: table.path.clone(), error });
            }
        };
        if !table.is_blank(0, &[column]) {
            into.insert(name.clone(), table.number(0, column)?);
        }
    }
    Ok((states, discretes))
}

/// A table as numbers.
pub struct Columns {
    /// Names of the columns.
    pub names: Vec<String>,
    /// One list a column: `true` and `false` as 1 and 0, what is no number as NaN.
    pub values: Vec<Vec<f64>>,
    /// For each row what tells its run from others, where the table holds several: the columns before `step`, by name.
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
