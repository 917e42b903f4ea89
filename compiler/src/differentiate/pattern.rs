//! From entries over loops to compressed columns.

use serde::{Deserialize, Serialize};

use super::Entry;
use crate::ir::MAX_DEPTH;

/// Positions of the non-zeros of a matrix, column after column.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pattern {
    /// Start of each column in `row_indices`, and its length at the end.
    pub column_pointers: Vec<usize>,
    /// Row of each non-zero, ascending in each column.
    pub row_indices: Vec<usize>,
}

impl Pattern {
    /// Number of non-zeros.
    #[must_use]
    pub fn nonzeros(&self) -> usize {
        self.row_indices.len()
    }

    /// Position of an entry among the values.
    #[must_use]
    pub fn position(&self, row: usize, column: usize) -> Option<usize> {
        let (start, end) = (*self.column_pointers.get(column)?, *self.column_pointers.get(column + 1)?);
        self.row_indices[start..end].binary_search(&row).ok().map(|i| start + i)
    }

    /// As [`position`](Self::position), looked for at `guess` first.
    pub(crate) fn position_near(&self, guess: usize, row: usize, column: usize) -> Option<usize> {
        let (start, end) = (*self.column_pointers.get(column)?, *self.column_pointers.get(column + 1)?);
        if (start..end).contains(&guess) && self.row_indices[guess] == row { Some(guess) } else { self.position(row, column) }
    }

    /// The pattern of entries in a matrix of `columns` columns.
    #[must_use]
    pub fn new(entries: &[Entry], columns: usize) -> Pattern {
        let mut counts = vec![0usize; columns + 1];
        for entry in entries {
            each_place(entry, |_, column| counts[column + 1] += 1);
        }
        for c in 0..columns {
            counts[c + 1] += counts[c];
        }
        let mut next = counts.clone();
        let mut rows = vec![0u32; counts[columns]];
        for entry in entries {
            each_place(entry, |row, column| {
                let place = &mut next[column];
                rows[*place] = row as u32;
                *place += 1;
            });
        }
        let mut pattern = Pattern { column_pointers: vec![0], row_indices: Vec::with_capacity(rows.len()) };
        for c in 0..columns {
            let column = &mut rows[counts[c]..counts[c + 1]];
            column.sort_unstable();
            let mut last = None;
            for &row in column.iter().filter(|&&r| last.replace(r) != Some(r)) {
                pattern.row_indices.push(row as usize);
            }
            pattern.column_pointers.push(pattern.row_indices.len());
        }
        pattern
    }
}

/// Calls `visit` with row and column of every pass, the last loop fastest.
pub(crate) fn each_place(entry: &Entry, mut visit: impl FnMut(usize, usize)) {
    let Some((&(inner, extent), outer)) = entry.loops.split_last() else {
        let none = [0; MAX_DEPTH];
        return visit(entry.row.at(&none) as usize, entry.column.at(&none) as usize);
    };
    let (row_stride, column_stride) = (entry.row.strides[inner as usize], entry.column.strides[inner as usize]);
    each(outer, |counters| {
        let (mut row, mut column) = (entry.row.at(counters), entry.column.at(counters));
        for _ in 0..extent {
            visit(row as usize, column as usize);
            row += row_stride;
            column += column_stride;
        }
    });
}

/// Calls `visit` with the counters of every pass, the last loop fastest.
pub(crate) fn each(loops: &[(u8, u32)], mut visit: impl FnMut(&[i64; MAX_DEPTH])) {
    let mut counters = [0i64; MAX_DEPTH];
    if loops.iter().any(|&(_, extent)| extent == 0) {
        return;
    }
    loop {
        visit(&counters);
        let mut d = loops.len();
        loop {
            let Some(&(counter, extent)) = d.checked_sub(1).and_then(|d| loops.get(d)) else {
                return;
            };
            d -= 1;
            let here = &mut counters[counter as usize];
            *here += 1;
            if *here < i64::from(extent) {
                break;
            }
            *here = 0;
        }
    }
}
