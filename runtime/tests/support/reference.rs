//! Published trajectories, where they are installed: `SMPL_REFERENCE`, or `shared/reference` beside the repository.

use std::path::PathBuf;

/// A table of numbers; empty cells are NaN.
pub struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

/// The table of a file, or `None` (with a message) where the references are not installed.
pub fn table(name: &str) -> Option<Table> {
    let folder = std::env::var_os("SMPL_REFERENCE")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/reference"), PathBuf::from);
    let folders = [folder, PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/reference")];
    let Some(path) = folders.iter().map(|f| f.join(name)).find(|p| p.exists()) else {
        eprintln!("skipped: reference file {name} is not installed (set SMPL_REFERENCE)");
        return None;
    };
    let mut reader = csv::Reader::from_path(path).expect("the reference can be read");
    let names = reader.headers().expect("a heading").iter().map(str::to_owned).collect();
    let number = |text: &str| {
        if text.is_empty() { f64::NAN } else { text.parse().expect("a number") }
    };
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

    pub fn row(&self, row: usize, columns: &[&str]) -> Vec<f64> {
        columns.iter().map(|c| self.get(row, c)).collect()
    }
}
