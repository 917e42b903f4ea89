//! Orders and strongly connected parts of directed graphs, by searches with explicit stacks: chains
//! may be long.

use std::hash::Hash;

use crate::ir::FastMap;

/// Result of a depth-first search.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Order<K> {
    /// Everything reached, each after what it needs, but for what closes a cycle.
    pub order: Vec<K>,
    /// Pairs (one, what it needs) that close a cycle.
    pub closing: Vec<(K, K)>,
}

#[derive(Clone, Copy)]
enum Visit {
    Open,
    Done,
}

/// Nodes that the starts need, directly or not, in an order in which each follows its needs.
pub(crate) fn after_needs<K: Copy + Eq + Hash>(starts: impl DoubleEndedIterator<Item = K>, mut needs: impl FnMut(K) -> Vec<K>) -> Order<K> {
    let mut out = Order { order: Vec::new(), closing: Vec::new() };
    let mut visits: FastMap<K, Visit> = FastMap::default();
    let mut stack: Vec<K> = starts.rev().collect();
    while let Some(&node) = stack.last() {
        match visits.get(&node) {
            None => {
                visits.insert(node, Visit::Open);
                for next in needs(node) {
                    match visits.get(&next) {
                        None => stack.push(next),
                        Some(Visit::Open) => out.closing.push((node, next)),
                        Some(Visit::Done) => {}
                    }
                }
            }
            Some(Visit::Open) => {
                stack.pop();
                visits.insert(node, Visit::Done);
                out.order.push(node);
            }
            Some(Visit::Done) => {
                stack.pop();
            }
        }
    }
    out
}

/// The strongly connected parts of the graph in which node `i` leads to `next[i]`, each sorted,
/// each after those that it leads to (Tarjan, SIAM J. Comput. 1 (1972) 146-160).
#[must_use]
pub fn connected(next: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut search = Search {
        next,
        number: vec![None; next.len()],
        lowest: vec![0; next.len()],
        path: vec![],
        on_path: vec![false; next.len()],
        count: 0,
    };
    let mut parts = Vec::new();
    for root in 0..next.len() {
        if search.number[root].is_none() {
            search.from(root, &mut parts);
        }
    }
    parts
}

struct Search<'g> {
    next: &'g [Vec<usize>],
    /// Order of discovery.
    number: Vec<Option<usize>>,
    /// Smallest number that a node of the path reaches.
    lowest: Vec<usize>,
    path: Vec<usize>,
    on_path: Vec<bool>,
    count: usize,
}

impl Search<'_> {
    fn from(&mut self, root: usize, parts: &mut Vec<Vec<usize>>) {
        let mut visits: Vec<(usize, usize)> = vec![(root, 0)];
        while let Some((at, edge)) = visits.pop() {
            match edge.checked_sub(1) {
                None => self.enter(at),
                Some(done) => self.lowest[at] = self.lowest[at].min(self.lowest[self.next[at][done]]),
            }
            match self.unseen(at, edge) {
                Some(edge) => {
                    visits.push((at, edge + 1));
                    visits.push((self.next[at][edge], 0));
                }
                None if Some(self.lowest[at]) == self.number[at] => parts.push(self.leave(at)),
                None => {}
            }
        }
    }

    fn enter(&mut self, at: usize) {
        self.number[at] = Some(self.count);
        self.lowest[at] = self.count;
        self.count += 1;
        self.path.push(at);
        self.on_path[at] = true;
    }

    /// The first edge from `edge` on that leads to something new; those before it are taken into
    /// account.
    fn unseen(&mut self, at: usize, edge: usize) -> Option<usize> {
        (edge..self.next[at].len()).find(|&e| {
            let to = self.next[at][e];
            if let Some(number) = self.number[to].filter(|_| self.on_path[to]) {
                self.lowest[at] = self.lowest[at].min(number);
            }
            self.number[to].is_none()
        })
    }

    /// Takes the part whose first node was `at` off the path.
    fn leave(&mut self, at: usize) -> Vec<usize> {
        let first = self.path.iter().rposition(|&node| node == at).unwrap_or_default();
        let mut part = self.path.split_off(first);
        part.iter().for_each(|&node| self.on_path[node] = false);
        part.sort_unstable();
        part
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_follows_what_it_needs() {
        let needs = [vec![1, 2], vec![3], vec![3], vec![], vec![0]];
        let Order { order, closing } = after_needs(0..5, |i: usize| needs[i].clone());
        let place = |i: usize| order.iter().position(|&j| j == i);
        assert!(closing.is_empty());
        assert_eq!(order.len(), 5);
        assert!((0..5).all(|i| needs[i].iter().all(|&j| place(j) < place(i))), "{order:?}");
    }

    #[test]
    fn what_closes_a_cycle_is_told_once() {
        let needs = [vec![1], vec![2], vec![0]];
        assert_eq!(after_needs(0..3, |i: usize| needs[i].clone()).closing, [(2, 0)]);
        assert_eq!(after_needs([7_u8].into_iter(), |i| vec![i]).closing, [(7, 7)]);
    }

    #[test]
    fn a_chain_of_a_million_is_no_depth_of_calls() {
        let next: Vec<Vec<usize>> = (0..1_000_000).map(|i| if i + 1 < 1_000_000 { vec![i + 1] } else { vec![] }).collect();
        assert_eq!(connected(&next).len(), next.len());
        assert_eq!(after_needs(0..next.len(), |i: usize| next[i].clone()).order.first(), Some(&999_999));
    }

    #[test]
    fn parts_are_the_classes_of_mutual_reach() {
        // All graphs with four nodes: two nodes are in one part where each reaches the other
        // (Warshall's closure).
        for bits in 0..1_u32 << 16 {
            let edge = |i: usize, j: usize| bits >> (4 * i + j) & 1 == 1;
            let mut reach: Vec<Vec<bool>> = (0..4).map(|i| (0..4).map(|j| i == j || edge(i, j)).collect()).collect();
            for k in 0..4 {
                for i in 0..4 {
                    for j in 0..4 {
                        reach[i][j] |= reach[i][k] && reach[k][j];
                    }
                }
            }
            let next: Vec<Vec<usize>> = (0..4).map(|i| (0..4).filter(|&j| edge(i, j)).collect()).collect();
            let parts = connected(&next);
            let part_of = |i: usize| parts.iter().position(|p| p.contains(&i)).expect("each node is in a part");
            for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
                assert_eq!(part_of(i) == part_of(j), reach[i][j] && reach[j][i], "{bits:b}");
                assert!(!reach[i][j] || part_of(j) <= part_of(i), "a part stands after those that it leads to: {bits:b}");
            }
        }
    }
}
