//! The order in which columns are eliminated: the one with the fewest neighbours first, so that the
//! factors stay sparse.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use crate::export::jacobian::Pattern;

/// The columns of a pattern in their order.
pub(super) fn order(pattern: &Pattern) -> Vec<u32> {
    let n = pattern.columns.len() - 1;
    let mut neighbours: Vec<BTreeSet<u32>> = vec![BTreeSet::new(); n];
    for column in 0..n {
        let entries = pattern.columns[column] as usize..pattern.columns[column + 1] as usize;
        for &row in pattern.rows[entries].iter().filter(|&&row| row as usize != column) {
            neighbours[column].insert(row);
            neighbours[row as usize].insert(column as u32);
        }
    }
    let mut waiting: BinaryHeap<_> = (0..n).map(|at| Reverse((neighbours[at].len(), at))).collect();
    let mut done = vec![false; n];
    let mut order = Vec::with_capacity(n);
    while let Some(Reverse((degree, at))) = waiting.pop() {
        if done[at] || degree != neighbours[at].len() {
            continue;
        }
        done[at] = true;
        order.push(at as u32);
        let around: Vec<u32> = std::mem::take(&mut neighbours[at]).into_iter().collect();
        for &one in &around {
            let own = &mut neighbours[one as usize];
            own.remove(&(at as u32));
            own.extend(around.iter().filter(|&&other| other != one));
            waiting.push(Reverse((own.len(), one as usize)));
        }
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_arrow_is_eliminated_from_its_tips() {
        // The first row and column are full: taken first they would fill the matrix.
        let n = 6;
        let mut pattern = Pattern { columns: vec![0], rows: (0..n).collect() };
        pattern.columns.push(n);
        for column in 1..n {
            pattern.rows.extend([0, column]);
            pattern.columns.push(pattern.rows.len() as u32);
        }
        let order = order(&pattern);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..n).collect::<Vec<_>>());
        assert!(order.iter().position(|&c| c == 0) >= Some(4), "{order:?}");
    }
}
