//! Dense LU with partial pivoting for small systems.

use super::super::Pattern;
use super::{Singular, subtract};

/// A full matrix by columns and its factors.
///
/// Products are rounded before they are summed (no fused multiply-add), so that every processor
/// gives the same bits without a second compilation.
pub(crate) struct Dense {
    n: usize,
    /// The matrix, then its factors: L below the diagonal (its diagonal of ones left out), U above,
    /// the diagonal inverted.
    columns: Box<[f64]>,
    /// Row exchanged with row k in step k.
    pivots: Box<[u32]>,
    /// Place of each entry of the pattern in `columns`.
    places: Box<[u32]>,
    /// True if the pattern is full and in the same order, so that entries are copied at once.
    full: bool,
}

impl Dense {
    pub(crate) fn new(pattern: &Pattern) -> Self {
        let n = pattern.dimension();
        let places =
            (0..n).flat_map(|column| pattern.rows()[pattern.column(column)].iter().map(move |row| (column * n + row) as u32)).collect();
        Self {
            n,
            columns: vec![0.0; n * n].into_boxed_slice(),
            pivots: vec![0; n].into_boxed_slice(),
            places,
            full: pattern.entries() == n * n,
        }
    }

    pub(crate) fn factorise(&mut self, values: &[f64]) -> Result<(), Singular> {
        if self.full {
            self.columns.copy_from_slice(values);
        } else {
            self.columns.fill(0.0);
            for (&place, &value) in self.places.iter().zip(values) {
                self.columns[place as usize] = value;
            }
        }
        (0..self.n).try_for_each(|k| self.eliminate(k))
    }

    /// Step k of the elimination: pivot, column k of L, and its products taken from the columns to
    /// the right.
    fn eliminate(&mut self, k: usize) -> Result<(), Singular> {
        let n = self.n;
        let (left, right) = self.columns.split_at_mut((k + 1) * n);
        let column = &mut left[k * n..];
        let mut pivot = k;
        for row in k + 1..n {
            if column[row].abs() > column[pivot].abs() {
                pivot = row;
            }
        }
        let inverse = 1.0 / column[pivot];
        if !inverse.is_finite() {
            return Err(Singular { column: Some(k) });
        }
        self.pivots[k] = pivot as u32;
        column.swap(k, pivot);
        column[k] = inverse;
        let lower = &mut column[k + 1..];
        lower.iter_mut().for_each(|l| *l *= inverse);
        for other in right.chunks_exact_mut(n) {
            other.swap(k, pivot);
            let factor = other[k];
            if factor != 0.0 {
                for (entry, l) in other[k + 1..].iter_mut().zip(&*lower) {
                    *entry -= factor * l;
                }
            }
        }
        Ok(())
    }

    /// The same for a matrix of `width` right-hand sides, row after row.
    pub(crate) fn solve_many(&self, width: usize, b: &mut [f64]) {
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2")]
            unsafe fn wide(dense: &Dense, width: usize, b: &mut [f64]) {
                dense.solve_many_portable(width, b);
            }
            if is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has the feature.
                return unsafe { wide(self, width, b) };
            }
        }
        self.solve_many_portable(width, b);
    }

    #[inline(always)]
    fn solve_many_portable(&self, width: usize, b: &mut [f64]) {
        let n = self.n;
        for (k, column) in self.columns.chunks_exact(n).enumerate() {
            let pivot = self.pivots[k] as usize;
            if pivot != k {
                let (upper, lower) = b.split_at_mut(pivot * width);
                upper[k * width..(k + 1) * width].swap_with_slice(&mut lower[..width]);
            }
            let (upper, lower) = b.split_at_mut((k + 1) * width);
            let this = &upper[k * width..];
            for (row, &l) in lower.chunks_exact_mut(width).zip(&column[k + 1..]) {
                if l != 0.0 {
                    subtract(row, l, this);
                }
            }
        }
        for (k, column) in self.columns.chunks_exact(n).enumerate().rev() {
            let (upper, lower) = b.split_at_mut(k * width);
            let this = &mut lower[..width];
            this.iter_mut().for_each(|x| *x *= column[k]);
            for (row, &u) in upper.chunks_exact_mut(width).zip(column) {
                if u != 0.0 {
                    subtract(row, u, this);
                }
            }
        }
    }

    pub(crate) fn solve(&self, b: &mut [f64]) {
        let n = self.n;
        let b = &mut b[..n];
        // Rows were exchanged only to the right of each column, so exchanges and elimination go
        // step by step.
        for (k, column) in self.columns.chunks_exact(n).enumerate() {
            b.swap(k, self.pivots[k] as usize);
            let factor = b[k];
            for (entry, l) in b[k + 1..].iter_mut().zip(&column[k + 1..]) {
                *entry -= factor * l;
            }
        }
        for (k, column) in self.columns.chunks_exact(n).enumerate().rev() {
            let factor = b[k] * column[k];
            b[k] = factor;
            for (entry, u) in b[..k].iter_mut().zip(column) {
                *entry -= factor * u;
            }
        }
    }
}
