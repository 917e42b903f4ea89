//! Blocks of square systems: a matching of rows and unknowns, and strongly connected components in
//! their order.

use smpl_compiler::graph::connected;

/// Rows and unknowns that belong together, by number.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Block {
    pub rows: Vec<usize>,
    pub unknowns: Vec<usize>,
}

/// A set of rows in which fewer unknowns occur than there are rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Unmatched {
    pub rows: Vec<usize>,
}

/// Blocks in the order in which they are solved; `incidence` has the unknowns that occur in each
/// row.
pub(super) fn of(incidence: &[Vec<usize>], unknowns: usize) -> Result<Vec<Block>, Unmatched> {
    let mut matching = Matching::new(unknowns);
    (0..incidence.len()).try_for_each(|row| matching.add(incidence, row).map(drop))?;
    let row_of: Vec<usize> = matching.row_of.iter().map(|row| row.unwrap_or(usize::MAX)).collect();
    let mut unknown_of = vec![usize::MAX; incidence.len()];
    row_of.iter().enumerate().filter(|(_, row)| **row != usize::MAX).for_each(|(unknown, &row)| unknown_of[row] = unknown);
    let next: Vec<Vec<usize>> = incidence.iter().map(|row| row.iter().map(|&unknown| row_of[unknown]).collect()).collect();
    let parts = connected(&next);
    Ok(parts.into_iter().map(|rows| Block { unknowns: rows.iter().map(|&row| unknown_of[row]).collect(), rows }).collect())
}

/// An assignment of rows to unknowns that grows by augmenting paths.
pub(super) struct Matching {
    /// The row of each unknown.
    pub row_of: Vec<Option<usize>>,
    /// Unknowns that are not taken.
    pub closed: Vec<bool>,
    /// Number of the search during which an unknown was last seen.
    seen: Vec<usize>,
    searches: usize,
}

impl Matching {
    pub(super) fn new(unknowns: usize) -> Self {
        Self { row_of: vec![None; unknowns], closed: vec![false; unknowns], seen: vec![0; unknowns], searches: 0 }
    }

    /// Gives a row an unknown, others another one where that is needed; the unknown that had none
    /// before. Unknowns that occur first in a row are taken first.
    pub(super) fn add(&mut self, incidence: &[Vec<usize>], row: usize) -> Result<usize, Unmatched> {
        // The path: rows, and the next of their unknowns to be looked at.
        let mut path: Vec<(usize, usize)> = vec![(row, 0)];
        let mut rows = vec![row];
        self.searches += 1;
        while let Some(&(at, next)) = path.last() {
            // What is free is taken before a longer path is sought.
            let free = incidence[at].iter().copied().find(|&u| self.row_of[u].is_none() && !self.closed[u]);
            if let Some(free) = free {
                self.take(incidence, &path, free);
                return Ok(free);
            }
            let Some(&unknown) = incidence[at].get(next) else {
                path.pop();
                continue;
            };
            if let Some(last) = path.last_mut() {
                last.1 += 1;
            }
            let Some(other) = self.row_of[unknown].filter(|_| self.seen[unknown] != self.searches) else { continue };
            self.seen[unknown] = self.searches;
            rows.push(other);
            path.push((other, 0));
        }
        Err(Unmatched { rows })
    }

    /// Gives the last row of a path the unknown `free`, and each row before it the unknown that led
    /// to the next one.
    fn take(&mut self, incidence: &[Vec<usize>], path: &[(usize, usize)], free: usize) {
        let Some((&(last, _), before)) = path.split_last() else { return };
        self.row_of[free] = Some(last);
        for &(row, next) in before {
            self.row_of[incidence[row][next - 1]] = Some(row);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangular_rows_are_blocks_of_one_in_the_order_of_their_solution() {
        let blocks = of(&[vec![0, 1], vec![1], vec![2, 0]], 3).expect("square");
        let order: Vec<usize> = blocks.iter().map(|b| b.unknowns[0]).collect();
        assert_eq!((blocks.len(), order), (3, vec![1, 0, 2]));
    }

    #[test]
    fn rows_that_need_each_other_are_one_block() {
        let blocks = of(&[vec![0, 1], vec![0, 1], vec![0, 2]], 3).expect("square");
        assert_eq!(blocks.iter().map(|b| b.rows.len()).collect::<Vec<_>>(), [2, 1]);
    }

    #[test]
    fn an_augmenting_path_moves_earlier_rows() {
        let blocks = of(&[vec![0, 1], vec![0, 2], vec![0]], 3).expect("square");
        let mut pairs: Vec<(usize, usize)> = blocks.iter().map(|b| (b.rows[0], b.unknowns[0])).collect();
        pairs.sort_unstable();
        assert_eq!(pairs, [(0, 1), (1, 2), (2, 0)]);
    }

    #[test]
    fn rows_with_too_few_unknowns_are_named() {
        let mut rows = of(&[vec![0], vec![1], vec![0, 1]], 3).expect_err("three rows of two unknowns").rows;
        rows.sort_unstable();
        assert_eq!(rows, [0, 1, 2]);
    }
}
