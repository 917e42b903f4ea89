//! Banded LU with partial pivoting, by SUNDIALS.

use std::collections::VecDeque;

use sundials_sys::{SUNDlsMat_bandGBTRF, SUNDlsMat_bandGBTRS};

use super::super::Pattern;
use super::Singular;

/// A matrix in bands around its diagonal, rows and columns renumbered so that the bands are narrow.
pub(crate) struct Banded {
    n: usize,
    /// Bands above and below the diagonal, and those above that pivoting may fill.
    upper: usize,
    lower: usize,
    stored: usize,
    /// Column by column, `stored + lower + 1` numbers each, the diagonal at `stored`.
    bands: Box<[f64]>,
    /// Beginnings of the columns in `bands`, as SUNDIALS takes them.
    columns: Box<[*mut f64]>,
    pivots: Box<[i64]>,
    /// Where each entry of the pattern stands in `bands`.
    places: Box<[usize]>,
    /// The unknown at each place of the order.
    order: Box<[usize]>,
    right: Box<[f64]>,
}

// SAFETY: the pointers are into `bands`, which is owned, and are made anew before each use.
unsafe impl Send for Banded {}

impl Banded {
    pub fn new(pattern: &Pattern) -> Self {
        let n = pattern.dimension();
        let order = narrow_order(pattern);
        let mut places_of = vec![0; n];
        order.iter().enumerate().for_each(|(place, &unknown)| places_of[unknown] = place);
        let entries = || (0..n).flat_map(|column| pattern.column(column).map(move |entry| (entry, column)));
        let position = |(entry, column): (usize, usize)| (places_of[pattern.rows()[entry]], places_of[column]);
        let (mut upper, mut lower) = (0, 0);
        for (row, column) in entries().map(position) {
            upper = upper.max(column.saturating_sub(row));
            lower = lower.max(row.saturating_sub(column));
        }
        let stored = (upper + lower).min(n.saturating_sub(1));
        let height = stored + lower + 1;
        let bands = vec![0.0; n * height].into_boxed_slice();
        let columns = vec![std::ptr::null_mut(); n].into();
        let places = entries().map(position).map(|(row, column)| column * height + stored + row - column).collect();
        Self { n, upper, lower, stored, bands, columns, pivots: vec![0; n].into(), places, order: order.into(), right: vec![0.0; n].into() }
    }

    /// Numbers in a column of the bands that pivoting may touch: what a factorisation costs a column, in products.
    #[cfg(test)]
    pub fn height(&self) -> usize {
        self.stored + self.lower + 1
    }

    /// The beginnings of the columns, made anew after the bands were used by themselves.
    fn point_to_columns(&mut self) {
        let height = self.stored + self.lower + 1;
        for (pointer, column) in self.columns.iter_mut().zip(self.bands.chunks_exact_mut(height)) {
            *pointer = column.as_mut_ptr();
        }
    }

    pub(crate) fn factorise(&mut self, values: &[f64]) -> Result<(), Singular> {
        self.bands.fill(0.0);
        for (&place, &value) in self.places.iter().zip(values) {
            self.bands[place] = value;
        }
        let [n, upper, lower, stored] = [self.n, self.upper, self.lower, self.stored].map(|x| x as i64);
        self.point_to_columns();
        // SAFETY: `n` columns of `stored + lower + 1` numbers, to which the pointers were just made, and as many pivots.
        let failed = unsafe { SUNDlsMat_bandGBTRF(self.columns.as_mut_ptr(), n, upper, lower, stored, self.pivots.as_mut_ptr()) };
        // The number of the column whose pivot is zero, from one; zero if there is none.
        match usize::try_from(failed) {
            Ok(0) if self.bands.iter().map(|x| x * 0.0).sum::<f64>() == 0.0 => Ok(()),
            Ok(0) | Err(_) => Err(Singular { column: None }),
            Ok(column) => Err(Singular { column: self.order.get(column - 1).copied() }),
        }
    }

    pub fn solve(&mut self, b: &mut [f64]) {
        for (right, &unknown) in self.right.iter_mut().zip(&self.order) {
            *right = b[unknown];
        }
        let [n, lower, stored] = [self.n, self.lower, self.stored].map(|x| x as i64);
        self.point_to_columns();
        // SAFETY: as in `factorise`; the right-hand side has `n` numbers.
        unsafe {
            SUNDlsMat_bandGBTRS(self.columns.as_mut_ptr(), n, stored, lower, self.pivots.as_mut_ptr(), self.right.as_mut_ptr());
        }
        for (right, &unknown) in self.right.iter().zip(&self.order) {
            b[unknown] = *right;
        }
    }
}

/// An order of the unknowns in which those that depend on each other are near: by Cuthill and McKee from an end of each
/// connected part, reversed (George & Liu, *Computer Solution of Large Sparse Positive Definite Systems*, 1981, chapter 4).
fn narrow_order(pattern: &Pattern) -> Vec<usize> {
    let n = pattern.dimension();
    let mut neighbours = vec![Vec::new(); n];
    for column in 0..n {
        for &row in &pattern.rows()[pattern.column(column)] {
            if row != column {
                neighbours[row].push(column);
                neighbours[column].push(row);
            }
        }
    }
    let mut degrees = vec![0; n];
    for (list, degree) in neighbours.iter_mut().zip(&mut degrees) {
        list.sort_unstable();
        list.dedup();
        *degree = list.len();
    }
    for list in &mut neighbours {
        list.sort_by_key(|&unknown| degrees[unknown]);
    }
    let mut by_degree: Vec<usize> = (0..n).collect();
    by_degree.sort_by_key(|&unknown| degrees[unknown]);
    let mut order = Vec::with_capacity(n);
    let mut visited = vec![false; n];
    for start in by_degree {
        if visited[start] {
            continue;
        }
        // The last of a breadth-first search is far from its start, and an end when searching from there leads no further.
        let mut part = breadth_first(start, &neighbours, &mut visited);
        for _ in 0..2 {
            let Some(&end) = part.last() else { break };
            part.iter().for_each(|&unknown| visited[unknown] = false);
            part = breadth_first(end, &neighbours, &mut visited);
        }
        order.extend(part);
    }
    order.reverse();
    order
}

/// The unknowns that are reached from one, the nearest first.
fn breadth_first(start: usize, neighbours: &[Vec<usize>], visited: &mut [bool]) -> Vec<usize> {
    let mut queue = VecDeque::from([start]);
    let mut order = Vec::new();
    visited[start] = true;
    while let Some(unknown) = queue.pop_front() {
        order.push(unknown);
        for &next in &neighbours[unknown] {
            if !std::mem::replace(&mut visited[next], true) {
                queue.push_back(next);
            }
        }
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells in a ring of diffusion, numbered at random.
    fn shuffled_chain(n: usize) -> (Pattern, Vec<f64>) {
        // A generator of the multiplicative group of a prime above n mixes the numbers.
        let cell = |k: usize| (k * 37) % n;
        let (mut starts, mut rows, mut values) = (vec![0], vec![], vec![]);
        for column in 0..n {
            for row in 0..n {
                let distance = cell(row).abs_diff(cell(column));
                if distance <= 1 {
                    rows.push(row);
                    values.push(if distance == 0 { 2.0 + column as f64 / 10.0 } else { -1.0 });
                }
            }
            starts.push(rows.len());
        }
        (Pattern::new(starts, rows).expect("a pattern"), values)
    }

    #[test]
    fn a_shuffled_chain_becomes_tridiagonal() {
        let (pattern, values) = shuffled_chain(101);
        let mut banded = Banded::new(&pattern);
        assert_eq!((banded.upper, banded.lower, banded.height()), (1, 1, 4));
        banded.factorise(&values).expect("not singular");
        let x: Vec<f64> = (0..101).map(|i| f64::from(i).sin()).collect();
        let mut b = vec![0.0; 101];
        for (column, x) in x.iter().enumerate() {
            for entry in pattern.column(column) {
                b[pattern.rows()[entry]] += values[entry] * x;
            }
        }
        banded.solve(&mut b);
        assert!(b.iter().zip(&x).all(|(got, x)| (got - x).abs() < 1e-12));
    }

    #[test]
    fn separate_parts_are_ordered_one_after_the_other() {
        let pattern = Pattern::new(vec![0, 2, 3, 5], vec![0, 2, 1, 0, 2]).expect("a pattern");
        let banded = Banded::new(&pattern);
        assert_eq!((banded.upper, banded.lower), (1, 1));
    }

    #[test]
    fn a_column_without_a_pivot_is_named() {
        let (pattern, mut values) = shuffled_chain(7);
        let range = pattern.column(3);
        values[range].fill(0.0);
        let found = Banded::new(&pattern).factorise(&values);
        assert_eq!(found, Err(Singular { column: Some(3) }));
    }
}
