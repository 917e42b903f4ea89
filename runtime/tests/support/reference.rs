//! Published trajectories, where they are installed: `SMPL_REFERENCE`, or `shared/reference` next to the repository.

use std::path::PathBuf;

/// A table of numbers; empty cells and words are NaN.
pub struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

/// Path of a file, or `None` if the references are not installed: tests that need them are ignored then.
pub fn path(name: &str) -> Option<PathBuf> {
    let folder =
        std::env::var_os("SMPL_REFERENCE").map(PathBuf::from).or_else(|| option_env!("SMPL_REFERENCE_FOLDER").map(PathBuf::from))?;
    let path = folder.join(name);
    assert!(path.exists() || !folder.is_dir(), "{} is not among the reference trajectories", path.display());
    path.exists().then_some(path)
}

/// The table of a file, or `None` where the references are not installed.
pub fn table(name: &str) -> Option<Table> {
    let path = path(name)?;
    let mut reader = csv::Reader::from_path(path).expect("the reference can be read");
    let names = reader.headers().expect("a heading").iter().map(str::to_owned).collect();
    let number = |text: &str| text.parse().unwrap_or(f64::NAN);
    let rows = reader.records().map(|r| r.expect("a row").iter().map(number).collect()).collect();
    Some(Table { names, rows })
}

impl Table {
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    pub fn get(&self, row: usize, column: &str) -> f64 {
        let at = self.names.iter().position(|n| n == column).unwrap_or_else(|| panic!("no column {column}"));
        self.rows[row][at]
    }

    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str)
    }

    /// A column from row `first` on.
    pub fn column(&self, column: &str, first: usize) -> Vec<f64> {
        (first..self.len()).map(|row| self.get(row, column)).collect()
    }

    pub fn row(&self, row: usize, columns: &[&str]) -> Vec<f64> {
        columns.iter().map(|c| self.get(row, c)).collect()
    }
}
