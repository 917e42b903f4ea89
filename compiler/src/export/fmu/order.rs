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

/// The most entries that the factors L and U can have, whichever rows are exchanged: rows that
/// compete for a pivot take the union of their patterns (A. George and E. Ng, SIAM J. Sci. Stat.
/// Comput. 8 (1987) 877).
pub(super) fn most_entries(pattern: &Pattern, order: &[u32]) -> [usize; 2] {
    let n = order.len();
    let mut rows: Vec<BTreeSet<usize>> = vec![BTreeSet::new(); n];
    for (at, &column) in order.iter().enumerate() {
        let entries = pattern.columns[column as usize] as usize..pattern.columns[column as usize + 1] as usize;
        for &row in &pattern.rows[entries] {
            rows[row as usize].insert(at);
        }
    }
    // Groups of rows of equal pattern with their number, by the first column of the pattern.
    let mut groups: Vec<Vec<(BTreeSet<usize>, usize)>> = vec![vec![]; n];
    let file = |groups: &mut Vec<Vec<(BTreeSet<usize>, usize)>>, pattern: BTreeSet<usize>, count: usize| {
        if let Some(&first) = pattern.first().filter(|_| count > 0) {
            groups[first].push((pattern, count));
        }
    };
    rows.into_iter().for_each(|pattern| file(&mut groups, pattern, 1));
    let [mut lower, mut upper] = [0, 0];
    for column in 0..n {
        let mut competing = std::mem::take(&mut groups[column]);
        competing.sort_unstable_by_key(|(pattern, _)| Reverse(pattern.len()));
        let count: usize = competing.iter().map(|(_, count)| count).sum();
        let mut patterns = competing.into_iter().map(|(pattern, _)| pattern);
        let mut union = patterns.next().unwrap_or_default();
        patterns.for_each(|pattern| union.extend(pattern));
        lower += count.max(1);
        upper += union.len().max(1);
        union.remove(&column);
        file(&mut groups, union, count.saturating_sub(1));
    }
    [lower, upper]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_of_a_tridiagonal_matrix_have_two_and_three_entries_in_a_column() {
        let n: u32 = 8;
        let mut pattern = Pattern { columns: vec![0], rows: vec![] };
        for column in 0..n {
            pattern.rows.extend((column.saturating_sub(1)..=(column + 1).min(n - 1)).collect::<Vec<_>>());
            pattern.columns.push(pattern.rows.len() as u32);
        }
        // With rows exchanged U has a second superdiagonal (Golub and Van Loan, section 4.3).
        let n = n as usize;
        assert_eq!(most_entries(&pattern, &(0..8).collect::<Vec<_>>()), [2 * n - 1, 3 * n - 3]);
    }

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
