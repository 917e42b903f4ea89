//! The order of elimination.

use std::ops::Range;
use std::os::raw::c_long;

use sundials_sys::{klu_l_analyze, klu_l_common, klu_l_defaults, klu_l_free_symbolic};

use super::rounds;
use crate::solver::{IdaFlag, Pattern, SolveError};

/// KLU's number for the ordering by approximate minimum degree of A + Aᵀ.
const AMD: c_long = 0;

/// Rows from which on a block is ordered in rounds, and how many times as many entries its factor
/// may have for that.
const LONG: usize = 32;
const MOST_FILL: f64 = 1.25;

/// Rows and columns in the order of elimination: diagonal blocks one after the other, each after
/// those that it depends on, with a full diagonal.
pub(super) struct Order {
    /// Original row of each place.
    pub rows: Vec<u32>,
    /// Original column of each place.
    pub columns: Vec<u32>,
    /// End of each block.
    pub ends: Vec<u32>,
    /// Entries of the factor L of each block, without its diagonal.
    fill: Vec<f64>,
}

impl Order {
    /// By KLU's analysis: maximum matching, strongly connected components, approximate minimum
    /// degree.
    pub(super) fn new(pattern: &Pattern) -> Result<Self, SolveError> {
        let n = pattern.dimension();
        let mut starts: Vec<c_long> = pattern.column_starts().iter().map(|&i| i as c_long).collect();
        let mut rows: Vec<c_long> = pattern.rows().iter().map(|&i| i as c_long).collect();
        for column in 0..n {
            // The matching takes the first free row of a column: the diagonal, where there is one.
            let range = pattern.column(column);
            if let Some(at) = pattern.rows()[range.clone()].iter().position(|&row| row == column) {
                rows[range].swap(0, at);
            }
        }
        let mut order = Self { rows: Vec::with_capacity(n), columns: Vec::with_capacity(n), ends: Vec::new(), fill: Vec::new() };
        // SAFETY: `klu_l_defaults` sets every field of `common`; the arrays are those of a pattern,
        // and the analysis that is read has `n` rows and columns and `nblocks` blocks.
        unsafe {
            let mut common: klu_l_common = std::mem::zeroed();
            klu_l_defaults(&mut common);
            common.ordering = AMD;
            common.btf = 1;
            let mut symbolic = klu_l_analyze(n as c_long, starts.as_mut_ptr(), rows.as_mut_ptr(), &mut common);
            if symbolic.is_null() || (*symbolic).structural_rank < n as c_long {
                let message = "structurally singular, or out of memory".to_owned();
                let flag = IdaFlag { value: common.status as i32, message };
                klu_l_free_symbolic(&mut symbolic, &mut common);
                return Err(SolveError::Setup { function: "klu_l_analyze", flag });
            }
            // KLU's form is upper triangular: its last block depends on no other.
            for block in (0..(*symbolic).nblocks as isize).rev() {
                let (from, to) = (*(*symbolic).R.offset(block) as isize, *(*symbolic).R.offset(block + 1) as isize);
                for place in from..to {
                    order.rows.push(*(*symbolic).P.offset(place) as u32);
                    order.columns.push(*(*symbolic).Q.offset(place) as u32);
                }
                order.ends.push(order.rows.len() as u32);
                order.fill.push(*(*symbolic).Lnz.offset(block) - (to - from) as f64);
            }
            klu_l_free_symbolic(&mut symbolic, &mut common);
        }
        Ok(order)
    }

    /// Orders large blocks anew, so that fewer of their rows wait for each other.
    pub(super) fn spread(&mut self, pattern: &Pattern) {
        let row_places = places(&self.rows);
        for (block, fill) in self.blocks().zip(self.fill.clone()).collect::<Vec<_>>() {
            if block.len() < LONG {
                continue;
            }
            let graph = self.graph(pattern, &row_places, &block);
            if let Some((order, _)) = rounds::order(graph).filter(|&(_, entries)| entries as f64 <= MOST_FILL * fill) {
                let from = block.start as usize..block.end as usize;
                for places in [&mut self.rows[from.clone()], &mut self.columns[from]] {
                    let before = places.to_vec();
                    places.iter_mut().zip(&order).for_each(|(to, &place)| *to = before[place as usize]);
                }
            }
        }
    }

    /// Neighbours of each row of a block in A + Aᵀ.
    fn graph(&self, pattern: &Pattern, row_places: &[u32], block: &Range<u32>) -> Vec<Vec<u32>> {
        let mut graph = vec![Vec::new(); block.len()];
        for place in block.clone() {
            let rows = pattern.column(self.columns[place as usize] as usize).map(|entry| row_places[pattern.rows()[entry]]);
            for other in rows.filter(|other| *other != place && block.contains(other)) {
                graph[(place - block.start) as usize].push(other - block.start);
                graph[(other - block.start) as usize].push(place - block.start);
            }
        }
        graph
    }

    /// The blocks, as ranges of places.
    pub(super) fn blocks(&self) -> impl Iterator<Item = Range<u32>> + '_ {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| start..end)
    }
}

/// The place of each original row or column.
pub(super) fn places(order: &[u32]) -> Vec<u32> {
    let mut places = vec![0; order.len()];
    order.iter().zip(0..).for_each(|(&original, place)| places[original as usize] = place);
    places
}
