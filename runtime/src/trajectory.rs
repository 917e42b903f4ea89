//! Tables: the trajectory that a simulation writes, and the actions, initial states and
//! disturbances that it reads.

mod format;
mod parquet;
mod read;
mod record;
mod resample;

pub use format::seventeen_digits;
pub use read::read_disturbances;
pub use read::{Columns, DataError, Inputs, Values, read_actions, read_columns, read_initial};
pub use record::Recorder;
pub use resample::{Between, Clock, Holds, OnSteps, ResampleError, on_steps};

use std::io::{self, Write};
use std::path::Path;

pub use crate::files::WriteError;
pub use crate::files::write_whole;

/// Returns `true` if the name of a file says that it is Parquet.
fn is_parquet(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("parquet"))
}

/// Kind of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnType {
    /// Whole numbers.
    Integer,
    /// Whole numbers up to 2^64 - 1.
    Natural,
    /// Numbers.
    Number,
    /// `true` or `false`.
    Flag,
    /// Text.
    Text,
}

/// One cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cell {
    /// Nothing.
    Empty,
    /// A whole number.
    Integer(i64),
    /// A whole number that is not negative.
    Natural(u64),
    /// A number.
    Number(f64),
    /// A flag.
    Flag(bool),
    /// A text that the table keeps, see [`Table::text`].
    Text(u32),
}

/// A table in memory, row after row.
#[derive(Clone, Debug, Default)]
pub struct Table {
    columns: Vec<(String, ColumnType)>,
    cells: Vec<Cell>,
    texts: Vec<String>,
}

impl Table {
    /// An empty table with these columns.
    #[must_use]
    pub fn new(columns: Vec<(String, ColumnType)>) -> Self {
        Self { columns, cells: Vec::new(), texts: Vec::new() }
    }

    /// Tables of runs one after another, with a first column that has the label of the run. Columns
    /// are those of the first table; a table that lacks one has empty cells there.
    #[must_use]
    pub fn together(column: &str, tables: &[(&str, &Table)]) -> Self {
        let columns: Vec<(String, ColumnType)> = tables.first().map_or_else(Vec::new, |(_, table)| table.columns.clone());
        let mut out = Self::new([(column.to_owned(), ColumnType::Text)].into_iter().chain(columns.iter().cloned()).collect());
        for (label, table) in tables {
            let label = out.text(label);
            let places: Vec<Option<usize>> = columns.iter().map(|(name, _)| table.columns.iter().position(|(n, _)| n == name)).collect();
            for row in 0..table.len() {
                let cells = table.row(row);
                let kept: Vec<Cell> = places
                    .iter()
                    .map(|at| match at.map(|at| cells[at]) {
                        Some(Cell::Text(_)) | None => Cell::Empty,
                        Some(cell) => cell,
                    })
                    .collect();
                out.push(std::iter::once(label).chain(kept));
            }
        }
        out
    }

    /// Names and kinds of the columns.
    #[must_use]
    pub fn columns(&self) -> &[(String, ColumnType)] {
        &self.columns
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cells.len() / self.columns.len().max(1)
    }

    /// Returns `true` if there is no row.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Adds a row; cells beyond the columns are dropped, missing ones are empty.
    pub fn push(&mut self, row: impl IntoIterator<Item = Cell>) {
        let end = self.cells.len() + self.columns.len();
        self.cells.extend(row);
        self.cells.resize(end, Cell::Empty);
    }

    /// Leaves the first rows alone.
    pub fn truncate(&mut self, rows: usize) {
        self.cells.truncate(rows * self.columns.len());
    }

    /// A cell of a text; equal texts are kept once.
    pub fn text(&mut self, text: &str) -> Cell {
        let known = self.texts.iter().position(|t| t == text);
        let at = known.unwrap_or_else(|| {
            self.texts.push(text.to_owned());
            self.texts.len() - 1
        });
        Cell::Text(at as u32)
    }

    /// The text of a cell; empty for any other cell.
    #[must_use]
    pub fn text_of(&self, cell: Cell) -> &str {
        match cell {
            Cell::Text(at) => self.texts.get(at as usize).map_or("", String::as_str),
            _ => "",
        }
    }

    /// The cells of a row.
    #[must_use]
    pub fn row(&self, index: usize) -> &[Cell] {
        let width = self.columns.len();
        self.cells.get(index * width..(index + 1) * width).unwrap_or(&[])
    }

    /// The numbers of a column, empty cells as NaN; `None` if there is no such column.
    #[must_use]
    pub fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        let column = self.columns.iter().position(|(n, _)| n == name)?;
        let number = |cell: &Cell| match cell {
            Cell::Empty | Cell::Text(_) => f64::NAN,
            Cell::Integer(i) => *i as f64,
            Cell::Natural(n) => *n as f64,
            Cell::Number(x) => *x,
            Cell::Flag(b) => f64::from(u8::from(*b)),
        };
        Some((0..self.len()).map(|row| number(&self.row(row)[column])).collect())
    }

    /// Writes the table: Parquet where the name ends in `.parquet`, CSV otherwise.
    ///
    /// # Errors
    /// [`WriteError`] with the path.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        write_whole(path, |out| if is_parquet(path) { parquet::write(self, out) } else { self.write_csv(out) })
    }

    fn write_csv(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut writer = csv::WriterBuilder::new().terminator(csv::Terminator::Any(b'\n')).from_writer(out);
        writer.write_record(self.columns.iter().map(|(name, _)| name))?;
        let mut text = String::new();
        for row in 0..self.len() {
            for cell in self.row(row) {
                text.clear();
                format::cell(*cell, &mut text);
                writer.write_field(if let Cell::Text(_) = cell { self.text_of(*cell) } else { &text })?;
            }
            writer.write_record(None::<&[u8]>)?;
        }
        writer.flush()
    }
}
