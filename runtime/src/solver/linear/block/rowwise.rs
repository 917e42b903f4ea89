//! The factorisation of a large block row by row, for factors with so much fill that a list of all
//! products would be long.

use super::elimination::{Move, Rows};
use super::reciprocal;

/// Rows of a triangular factor without its diagonal, and where their numbers go.
struct Triangle {
    starts: Box<[u32]>,
    columns: Box<[u32]>,
    places: Box<[u32]>,
}

impl Triangle {
    fn new(columns: &[Vec<u32>], places: &[Vec<u32>]) -> Self {
        let flat = |lists: &[Vec<u32>]| lists.iter().flatten().copied().collect();
        Self { starts: starts(columns), columns: flat(columns), places: flat(places) }
    }

    /// # Safety
    /// There is such a row.
    #[inline(always)]
    unsafe fn range(&self, row: usize) -> std::ops::Range<usize> {
        // SAFETY: by the contract.
        unsafe { range(&self.starts, row) }
    }
}

/// Starts of consecutive lists, and the end of the last one.
fn starts<T>(lists: &[Vec<T>]) -> Box<[u32]> {
    let ends = lists.iter().scan(0, |end, list| {
        *end += list.len() as u32;
        Some(*end)
    });
    std::iter::once(0).chain(ends).collect()
}

/// # Safety
/// There is such a list.
#[inline(always)]
unsafe fn range(starts: &[u32], list: usize) -> std::ops::Range<usize> {
    // SAFETY: lists have a beginning, and the next one's where they end.
    unsafe { *starts.get_unchecked(list) as usize..*starts.get_unchecked(list + 1) as usize }
}

/// L U = D with a diagonal of ones in L, by rows.
pub(super) struct RowWise {
    lower: Triangle,
    upper: Triangle,
    /// Numbers of U; those of L are only needed at their places.
    upper_values: Box<[f64]>,
    inverse_diagonal: Box<[f64]>,
    inverse_places: Box<[u32]>,
    /// Entries of the matrix, to columns, row by row.
    entries: Box<[Move]>,
    entry_starts: Box<[u32]>,
    /// A row under elimination; zero in between.
    work: Box<[f64]>,
}

impl RowWise {
    pub(crate) fn new(rows: &Rows) -> Self {
        let (n, upper) = (rows.lower.len(), Triangle::new(rows.upper, &rows.upper_places));
        Self {
            lower: Triangle::new(rows.lower, &rows.lower_places),
            upper_values: vec![0.0; upper.columns.len()].into(),
            upper,
            inverse_diagonal: vec![0.0; n].into(),
            inverse_places: rows.inverse_places.as_slice().into(),
            entries: rows.entries.iter().flatten().copied().collect(),
            entry_starts: starts(&rows.entries),
            work: vec![0.0; n].into(),
        }
    }

    /// Factorises the block and sets its factors; false where a pivot does not serve.
    ///
    /// # Safety
    /// `values` and `factors` have the lengths for which the structure was made.
    #[inline(always)]
    pub(crate) unsafe fn run(&mut self, values: &[f64], factors: &mut [f64]) -> bool {
        let Self { lower, upper, upper_values, inverse_diagonal, work, .. } = self;
        // SAFETY: rows, columns and places are those of the structure, whose lengths `values` and
        // `factors` have by the contract.
        unsafe {
            for row in 0..inverse_diagonal.len() {
                for item in self.entries.get_unchecked(range(&self.entry_starts, row)) {
                    *work.get_unchecked_mut(item.to as usize) = *values.get_unchecked(item.entry as usize);
                }
                let diagonal = *work.get_unchecked(row);
                for entry in lower.range(row) {
                    let column = *lower.columns.get_unchecked(entry) as usize;
                    let factor = -*work.get_unchecked(column) * *inverse_diagonal.get_unchecked(column);
                    *work.get_unchecked_mut(column) = 0.0;
                    *factors.get_unchecked_mut(*lower.places.get_unchecked(entry) as usize) = factor;
                    let range = upper.range(column);
                    let columns = upper.columns.get_unchecked(range.clone());
                    for (&column, &value) in columns.iter().zip(upper_values.get_unchecked(range)) {
                        let entry = work.get_unchecked_mut(column as usize);
                        *entry = factor.mul_add(value, *entry);
                    }
                }
                let Some(inverse) = reciprocal(*work.get_unchecked(row), diagonal) else {
                    work.fill(0.0);
                    return false;
                };
                *work.get_unchecked_mut(row) = 0.0;
                *inverse_diagonal.get_unchecked_mut(row) = inverse;
                *factors.get_unchecked_mut(*self.inverse_places.get_unchecked(row) as usize) = inverse;
                for entry in upper.range(row) {
                    let value = std::mem::take(work.get_unchecked_mut(*upper.columns.get_unchecked(entry) as usize));
                    *upper_values.get_unchecked_mut(entry) = value;
                    *factors.get_unchecked_mut(*upper.places.get_unchecked(entry) as usize) = -inverse * value;
                }
            }
        }
        true
    }
}
