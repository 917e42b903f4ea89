//! Forward and back substitution with sparse factors.
//!
//! KLU keeps its factors by columns with 64-bit indices and walks through them entry by entry. Here they stand by rows with
//! 32-bit indices: each unknown is one running sum in a register, and what it needs last, it reads last (substitution
//! along a chain of cells is a chain of such sums). A solve takes about half of KLU's time.

/// One triangular factor by rows, its diagonal left out.
#[derive(Default)]
struct Rows {
    starts: Box<[u32]>,
    columns: Box<[u32]>,
    values: Box<[f64]>,
    /// Where each entry of the factor by columns stands in `values`; `DIAGONAL` for those on the diagonal.
    places: Box<[u32]>,
}

const DIAGONAL: u32 = u32::MAX;

impl Rows {
    /// The structure, from that of the factor by columns. Entries of a row come in the order of columns, from the outside
    /// to the diagonal: rising in a lower factor, falling in an upper one.
    fn new(n: usize, starts: &[i64], rows: &[i64], lower: bool) -> Self {
        let mut entries = Vec::with_capacity(rows.len());
        for column in 0..n {
            let range = starts[column] as usize..starts[column + 1] as usize;
            for (entry, &row) in range.clone().zip(&rows[range]) {
                if row as usize != column {
                    entries.push((row as usize, column, entry));
                }
            }
        }
        entries.sort_unstable_by_key(|&(row, column, _)| (row, if lower { column } else { n - column }));
        let mut places = vec![DIAGONAL; rows.len()];
        let mut row_starts = vec![0_u32; n + 1];
        for (place, &(row, _, entry)) in entries.iter().enumerate() {
            places[entry] = place as u32;
            row_starts[row + 1] = place as u32 + 1;
        }
        for row in 0..n {
            row_starts[row + 1] = row_starts[row + 1].max(row_starts[row]);
        }
        Self {
            starts: row_starts.into(),
            columns: entries.iter().map(|&(_, column, _)| column as u32).collect(),
            values: vec![0.0; entries.len()].into(),
            places: places.into(),
        }
    }

    fn set(&mut self, values: &[f64]) {
        for (&place, &value) in self.places.iter().zip(values) {
            if place != DIAGONAL {
                self.values[place as usize] = value;
            }
        }
    }

    /// `start` minus the row times `x`.
    ///
    /// # Safety
    /// `row` is one of the factor's, and `x` has as many entries as the factor has rows.
    #[inline(always)]
    unsafe fn subtract(&self, row: usize, start: f64, x: &[f64]) -> f64 {
        // SAFETY: `new` made ends that rise up to the number of entries, and columns below the number of rows.
        unsafe {
            let range = *self.starts.get_unchecked(row) as usize..*self.starts.get_unchecked(row + 1) as usize;
            let columns = self.columns.get_unchecked(range.clone());
            let values = self.values.get_unchecked(range);
            columns.iter().zip(values).fold(start, |sum, (&column, &value)| (-value).mul_add(*x.get_unchecked(column as usize), sum))
        }
    }
}

/// Both factors of a matrix whose rows were divided by scales and then, as the columns, permuted.
#[derive(Default)]
pub(crate) struct Factors {
    lower: Rows,
    upper: Rows,
    /// Reciprocals of the upper factor's diagonal.
    inverse_diagonal: Box<[f64]>,
    /// Place of each diagonal entry in the upper factor by columns.
    diagonal: Box<[u32]>,
    row_order: Box<[u32]>,
    column_order: Box<[u32]>,
    /// Reciprocals of the rows' scales, in the order of the permuted rows.
    inverse_scales: Box<[f64]>,
    x: Box<[f64]>,
}

/// Factors by columns, as KLU hands them out.
pub(crate) struct ByColumns {
    pub lower_starts: Box<[i64]>,
    pub lower_rows: Box<[i64]>,
    pub lower: Box<[f64]>,
    pub upper_starts: Box<[i64]>,
    pub upper_rows: Box<[i64]>,
    pub upper: Box<[f64]>,
    pub row_order: Box<[i64]>,
    pub column_order: Box<[i64]>,
    /// Scales of the rows in the order of the pivots: KLU permutes them once the factors are made.
    pub scales: Box<[f64]>,
}

impl Factors {
    /// Space for factors of this structure; `None` if the structure is not that of complete factors.
    pub fn new(from: &ByColumns) -> Option<Self> {
        let n = from.row_order.len();
        let diagonal = (0..n)
            .map(|column| {
                (from.upper_starts[column] as usize..from.upper_starts[column + 1] as usize)
                    .find(|&entry| from.upper_rows[entry] as usize == column)
                    .map(|entry| entry as u32)
            })
            .collect::<Option<_>>()?;
        let order = |from: &[i64]| from.iter().map(|&i| i as u32).collect::<Box<[_]>>();
        Some(Self {
            lower: Rows::new(n, &from.lower_starts, &from.lower_rows, true),
            upper: Rows::new(n, &from.upper_starts, &from.upper_rows, false),
            inverse_diagonal: vec![0.0; n].into(),
            diagonal,
            row_order: order(&from.row_order),
            column_order: order(&from.column_order),
            inverse_scales: vec![0.0; n].into(),
            x: vec![0.0; n].into(),
        })
    }

    /// Takes the numbers over; the structure is that of [`new`](Self::new).
    pub fn set(&mut self, from: &ByColumns) {
        self.lower.set(&from.lower);
        self.upper.set(&from.upper);
        for (inverse, &entry) in self.inverse_diagonal.iter_mut().zip(&self.diagonal) {
            *inverse = 1.0 / from.upper[entry as usize];
        }
        for (inverse, scale) in self.inverse_scales.iter_mut().zip(&from.scales) {
            *inverse = 1.0 / scale;
        }
    }

    /// Replaces the right-hand side by the solution.
    pub fn solve(&mut self, b: &mut [f64]) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("fma") {
            // SAFETY: the processor has the feature.
            return unsafe { self.solve_fused(b) };
        }
        self.substitute(b);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "fma")]
    unsafe fn solve_fused(&mut self, b: &mut [f64]) {
        self.substitute(b);
    }

    #[inline(always)]
    fn substitute(&mut self, b: &mut [f64]) {
        let n = self.x.len();
        let x = &mut self.x[..];
        for row in 0..n {
            let start = b[self.row_order[row] as usize] * self.inverse_scales[row];
            // SAFETY: `row` is below `n`, the length of `x`.
            x[row] = unsafe { self.lower.subtract(row, start, x) };
        }
        for row in (0..n).rev() {
            // SAFETY: as above.
            let sum = unsafe { self.upper.subtract(row, x[row], x) };
            x[row] = sum * self.inverse_diagonal[row];
            b[self.column_order[row] as usize] = x[row];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_compilations_solve_a_scaled_permuted_system() {
        // L = [1 0; 0.5 1], U = [2 4; 0 3]; rows scaled by 2 and 5 and exchanged, columns exchanged.
        let from = ByColumns {
            lower_starts: [0, 2, 3].into(),
            lower_rows: [0, 1, 1].into(),
            lower: [1.0, 0.5, 1.0].into(),
            upper_starts: [0, 1, 3].into(),
            upper_rows: [0, 0, 1].into(),
            upper: [2.0, 4.0, 3.0].into(),
            row_order: [1, 0].into(),
            column_order: [1, 0].into(),
            scales: [5.0, 2.0].into(),
        };
        let mut factors = Factors::new(&from).expect("complete");
        factors.set(&from);
        // L U = [2 4; 1 5], so that row 1 of A is 5 (4, 2) and row 0 is 2 (5, 1). With x = (7, 3):
        let right = [2.0 * 38.0, 5.0 * 34.0];
        let (mut fast, mut plain) = (right, right);
        factors.solve(&mut fast);
        factors.substitute(&mut plain);
        assert_eq!(fast, plain);
        assert!((fast[0] - 7.0).abs() < 1e-14 && (fast[1] - 3.0).abs() < 1e-14, "{fast:?}");
    }
}
