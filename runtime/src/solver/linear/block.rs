//! Sparse LU of the diagonal blocks of the block triangular form, with pivots that are chosen
//! beforehand.
//!
//! The unknowns of a flowsheet follow each other: cells down a reactor, units down a plant.
//! Strongly connected components, taken in the order of the flow, make the Newton matrix block
//! triangular. Only the blocks on its diagonal are factorised, and what is before them is used as
//! it is (Duff, Erisman, Reid, *Direct Methods for Sparse Matrices*, 2nd ed., chapter 6). Small
//! blocks are inverted, large ones factorised; then a
//! [`Substitution`](super::substitution::Substitution) solves.
//!
//! Pivots are the diagonal entries, in an order of minimum degree: Newton matrices of stiff
//! systems, c − ∂f/∂y, nearly always allow that. If an entry turns out to be unfit as a pivot,
//! [`Klu`] takes over until [`Block::forget`]. Structure is found once; a factorisation is then a
//! pass over numbers whose places are known.

mod elimination;
mod order;
mod rounds;
mod rowwise;
mod structure;

use super::super::{Pattern, SolveError};
use super::{Klu, Singular};
use structure::{BlockStep, Cursor, Structure};

/// A pivot may differ from its diagonal entry by this factor, up or down: beyond it, half of the
/// digits are roundoff.
const GROWTH: f64 = 1e8;

/// Dimension up to which a block is inverted.
const SMALL: usize = 6;

/// Blocks inverted side by side.
const LANES: usize = 4;

/// A sparse matrix whose structure was analysed once, and its factors.
pub(crate) struct Block {
    pattern: Pattern,
    structure: Structure,
    /// Partial pivoting, made when it is first needed.
    pivoting: Option<Box<Klu>>,
    /// True if `pivoting` holds the factors.
    pivoted: bool,
}

impl Block {
    pub(crate) fn new(pattern: &Pattern) -> Result<Self, SolveError> {
        Ok(Self { pattern: pattern.clone(), structure: structure::analyse(pattern)?, pivoting: None, pivoted: false })
    }

    /// Dimension of the largest diagonal block of the block triangular form.
    pub(crate) fn largest(pattern: &Pattern) -> Result<usize, SolveError> {
        Ok(order::Order::new(pattern)?.blocks().map(|block| block.len()).max().unwrap_or(0))
    }

    /// Products of the factorisation of large blocks, and those of a substitution.
    pub(crate) fn products(&self) -> (usize, usize) {
        let large = |step: &BlockStep| if let BlockStep::Large(large) = step { large.products() } else { 0 };
        (self.structure.steps.iter().map(large).sum(), self.structure.substitution.terms())
    }

    pub(crate) fn factorise(&mut self, values: &[f64]) -> Result<(), Singular> {
        if !self.pivoted && values.len() == self.pattern.entries() && self.eliminate(values) {
            return Ok(());
        }
        let pivoting = match &mut self.pivoting {
            Some(klu) => klu,
            // Structure was found sound before.
            none => none.insert(Box::new(Klu::new(&self.pattern).map_err(|_| Singular { column: None })?)),
        };
        if !self.pivoted {
            pivoting.forget();
            self.pivoted = true;
        }
        pivoting.factorise(values)
    }

    pub(crate) fn forget(&mut self) {
        self.pivoted = false;
    }

    pub(crate) fn solve(&mut self, b: &mut [f64]) {
        match &mut self.pivoting {
            Some(klu) if self.pivoted => klu.solve(b),
            _ => {
                self.structure.substitution.load(1.0, b);
                self.structure.substitution.run(b);
            }
        }
    }

    /// Writes the solution for `factor` times `b` to `x`; does nothing and returns false where
    /// partial pivoting is in force.
    pub(crate) fn solve_scaled(&mut self, factor: f64, b: &[f64], x: &mut [f64]) -> bool {
        if !self.pivoted {
            self.structure.substitution.load(factor, b);
            self.structure.substitution.run(x);
        }
        !self.pivoted
    }

    /// Solves for a matrix of `width` right-hand sides, row after row; does nothing and returns
    /// false where partial pivoting is in force.
    pub(crate) fn solve_many(&mut self, width: usize, b: &mut [f64], space: &mut Vec<f64>) -> bool {
        if !self.pivoted {
            self.structure.substitution.run_many(width, b, space);
        }
        !self.pivoted
    }

    /// With fused products in hardware where the processor has them: same results as without.
    fn eliminate(&mut self, values: &[f64]) -> bool {
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2,fma")]
            unsafe fn fused(block: &mut Block, values: &[f64]) -> bool {
                block.eliminate_portable(values)
            }
            if is_x86_feature_detected!("fma") && is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has the features.
                return unsafe { fused(self, values) };
            }
        }
        self.eliminate_portable(values)
    }

    /// Sets the factors of the substitution; false where a pivot does not serve.
    #[inline(always)]
    fn eliminate_portable(&mut self, values: &[f64]) -> bool {
        assert_eq!(values.len(), self.pattern.entries());
        let Structure { steps, small, substitution } = &mut self.structure;
        let factors = substitution.factors_mut();
        let mut small = small.cursor();
        for step in &mut *steps {
            // SAFETY: entries and places come from a pattern with `values.len()` entries (just
            // compared) and from the substitution made with it.
            let serves = unsafe {
                match *step {
                    BlockStep::Small { size, single: true } => invert::<1>(&mut small, size, values, factors),
                    BlockStep::Small { size, single: false } => invert::<LANES>(&mut small, size, values, factors),
                    BlockStep::Large(ref mut large) => large.eliminate(values, factors),
                }
            };
            if !serves {
                return false;
            }
        }
        true
    }
}

/// Inverts the next blocks.
///
/// # Safety
/// That of [`Cursor::invert`].
#[inline(always)]
unsafe fn invert<const L: usize>(small: &mut Cursor<'_>, size: u8, values: &[f64], factors: &mut [f64]) -> bool {
    // SAFETY: by the contract.
    unsafe {
        match size {
            1 => small.invert::<1, L>(values, factors),
            2 => small.invert::<2, L>(values, factors),
            3 => small.invert::<3, L>(values, factors),
            4 => small.invert::<4, L>(values, factors),
            5 => small.invert::<5, L>(values, factors),
            _ => small.invert::<SMALL, L>(values, factors),
        }
    }
}

/// The reciprocal of a pivot, if it serves.
#[inline(always)]
fn reciprocal(pivot: f64, diagonal: f64) -> Option<f64> {
    let inverse = 1.0 / pivot;
    serves(pivot, inverse, diagonal).then_some(inverse)
}

/// Returns `true` if a pivot serves. A diagonal entry that is zero says nothing about it.
#[inline(always)]
fn serves(pivot: f64, inverse: f64, diagonal: f64) -> bool {
    let grown = (pivot / diagonal).abs();
    inverse.is_finite() & ((diagonal == 0.0) | (1.0 / GROWTH..=GROWTH).contains(&grown))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From a full matrix by rows; zeros are not in the pattern.
    fn sparse(rows: &[Vec<f64>]) -> (Pattern, Vec<f64>) {
        let (mut starts, mut places, mut values) = (vec![0], vec![], vec![]);
        for column in 0..rows.len() {
            for (row, entries) in rows.iter().enumerate() {
                if entries[column] != 0.0 {
                    places.push(row);
                    values.push(entries[column]);
                }
            }
            starts.push(places.len());
        }
        (Pattern::new(starts, places).expect("a pattern"), values)
    }

    fn solved(rows: &[Vec<f64>], x: &[f64]) -> (Block, Vec<f64>) {
        let (pattern, values) = sparse(rows);
        let mut block = Block::new(&pattern).expect("analysed");
        block.factorise(&values).expect("not singular");
        let mut b: Vec<f64> = rows.iter().map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum()).collect();
        block.solve(&mut b);
        (block, b)
    }

    fn assert_close(got: &[f64], expected: &[f64]) {
        assert!(got.iter().zip(expected).all(|(g, e)| (g - e).abs() < 1e-11), "{got:?} {expected:?}");
    }

    /// Cells in a chain, each of `size` unknowns that all depend on each other and on the cell
    /// before.
    fn chain(cells: usize, size: usize) -> Vec<Vec<f64>> {
        let n = cells * size;
        let entry = |row: usize, column: usize| match row / size - (column / size).min(row / size) {
            _ if column / size > row / size => 0.0,
            0 if row == column => 4.0 + row as f64 / n as f64,
            0 => (row + 2 * column) as f64 / (2 * n) as f64 - 0.7,
            1 if row % size == column % size => 3.0,
            _ => 0.0,
        };
        (0..n).map(|row| (0..n).map(|column| entry(row, column)).collect()).collect()
    }

    /// The same with cells that depend on the next one too: a single block, ordered in rounds.
    fn bed(cells: usize, size: usize) -> Vec<Vec<f64>> {
        let mut rows = chain(cells, size);
        for row in 0..rows.len() - size {
            rows[row][row + size] = -0.5 - row as f64 / 1e3;
        }
        rows
    }

    #[test]
    fn cells_that_depend_on_both_neighbours_are_solved() {
        // The last with so much fill that its products are not listed.
        for (cells, size) in [(60, 1), (60, 3), (2, 60)] {
            let rows = bed(cells, size);
            let x = counting(cells * size);
            let (block, got) = solved(&rows, &x);
            assert!(!block.pivoted);
            assert_eq!((block.structure.steps.len(), block.products().0 > 0), (1, true));
            assert_close(&got, &x);
        }
    }

    fn counting(n: usize) -> Vec<f64> {
        (1..=n).map(|i| i as f64 - 7.5).collect()
    }

    #[test]
    fn chains_of_cells_of_all_sizes_are_solved() {
        for size in 1..=SMALL + 3 {
            let rows = chain(5, size);
            let x = counting(5 * size);
            let (block, got) = solved(&rows, &x);
            assert!(!block.pivoted);
            assert_close(&got, &x);
        }
    }

    #[test]
    fn cells_are_inverted_side_by_side_and_every_pivot_is_looked_at() {
        // The first cell has none before it.
        let cells = 2 * LANES + 3;
        for size in [1, 3, SMALL] {
            let mut rows = chain(cells, size);
            let x = counting(cells * size);
            let (block, got) = solved(&rows, &x);
            let several = block.structure.steps.iter().filter(|step| matches!(step, BlockStep::Small { single: false, .. })).count();
            assert_eq!((several, block.structure.steps.len()), (2, 2 + 3));
            assert_close(&got, &x);
            for cell in 0..cells {
                let at = cell * size;
                let kept = std::mem::replace(&mut rows[at][at], 1e-20);
                let (pattern, values) = sparse(&rows);
                let served = Block::new(&pattern).expect("analysed").eliminate(&values);
                // Alone, a small number is as good a pivot as any.
                assert_eq!(served, size == 1, "{size}, cell {cell}");
                rows[at][at] = kept;
            }
        }
    }

    #[test]
    fn a_chain_without_feedback_is_inverted_cell_by_cell() {
        let (block, _) = solved(&chain(40, 1), &counting(40));
        assert!(block.structure.steps.iter().all(|step| matches!(step, BlockStep::Small { size: 1, .. })));
        // One term for the cell, one for the cell before.
        assert_eq!(block.structure.substitution.terms(), 2 * 40 - 1);
    }

    #[test]
    fn a_diagonal_with_gaps_is_matched_first() {
        let rows = [vec![0.0, 2.0, 0.0], vec![3.0, 0.0, 1.0], vec![1.0, 0.0, 4.0]];
        let x = [1.0, 2.0, 3.0];
        assert_close(&solved(&rows, &x).1, &x);
    }

    #[test]
    fn a_vanishing_pivot_is_left_to_partial_pivoting_until_forgotten() {
        for size in [2, SMALL + 2] {
            let mut rows = chain(1, size);
            rows[0][0] = 1e-20;
            let x = counting(size);
            let (mut block, got) = solved(&rows, &x);
            assert!(block.pivoted);
            assert_close(&got, &x);
            block.forget();
            rows[0][0] = 2.5;
            block.factorise(&sparse(&rows).1).expect("not singular");
            assert!(!block.pivoted);
            let mut b: Vec<f64> = rows.iter().map(|row| row.iter().zip(&x).map(|(a, x)| a * x).sum()).collect();
            block.solve(&mut b);
            assert_close(&b, &x);
        }
    }

    #[test]
    fn singular_matrices_are_reported() {
        let (pattern, values) = sparse(&[vec![1.0, 2.0], vec![2.0, 4.0]]);
        assert!(Block::new(&pattern).expect("analysed").factorise(&values).is_err());
        let pattern = Pattern::new(vec![0, 1, 2], vec![0, 0]).expect("a pattern");
        assert!(Block::new(&pattern).is_err());
    }

    #[test]
    fn fused_and_plain_compilations_give_the_same_bits() {
        for rows in [chain(4, 3), chain(4, SMALL + 4), bed(20, 2), bed(2, 60)] {
            let (pattern, values) = sparse(&rows);
            let (mut fast, mut plain) = (Block::new(&pattern).expect("analysed"), Block::new(&pattern).expect("analysed"));
            assert!(fast.eliminate(&values) && plain.eliminate_portable(&values));
            let (mut b, mut c) = (counting(rows.len()), counting(rows.len()));
            fast.structure.substitution.load(1.0, &b);
            fast.structure.substitution.run(&mut b);
            plain.structure.substitution.load(1.0, &c);
            plain.structure.substitution.run_portable(&mut c);
            assert_eq!(b, c);
        }
    }
}
