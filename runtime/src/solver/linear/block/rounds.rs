//! Minimum degree in rounds: an order of elimination in which many rows do not wait for each other.
//!
//! Minimum degree takes a chain of cells from its ends, so that each cell waits for the one before,
//! in the factorisation and in every substitution. Here the nodes of a round are not neighbours of
//! each other (Liu, Modification of the minimum-degree algorithm by multiple elimination, *ACM
//! Trans. Math. Softw.* 11 (1985) 141–153). If few nodes have the least degree, a round takes those
//! of the next degree too. A chain is eliminated by cyclic reduction: every other cell, then every
//! other one of the rest. 150 cells of ten shells each wait for each other 31 times instead of 329,
//! with as many products.

/// Nodes of a round below which those of the next degree are taken too.
const FEW: usize = 8;

/// Steps of the elimination for each neighbour at the beginning, at most.
const EFFORT: usize = 200;

/// A graph by the neighbours of each node, and what is being eliminated from it.
struct Elimination {
    neighbours: Vec<Vec<u32>>,
    /// The last round that a node was taken in, or a neighbour of it.
    round: Vec<u32>,
    /// Remaining effort.
    effort: usize,
    merged: Vec<u32>,
}

/// The order of elimination, and the number of entries of the factor L without its diagonal;
/// nothing if that takes too long.
pub(super) fn order(neighbours: Vec<Vec<u32>>) -> Option<(Vec<u32>, usize)> {
    let (mut order, mut fill) = (Vec::with_capacity(neighbours.len()), 0);
    let mut left: Vec<u32> = (0..neighbours.len() as u32).collect();
    let mut graph = Elimination::new(neighbours);
    for number in 1.. {
        let Some(least) = left.iter().map(|&node| graph.degree(node)).min() else { break };
        if least + 1 == left.len() {
            // All that are left are neighbours of each other.
            fill += left.len() * least / 2;
            order.extend(left);
            break;
        }
        let mut chosen = graph.choose(&left, number, least);
        if chosen.len() < FEW {
            chosen.extend(graph.choose(&left, number, least + 1));
        }
        for &node in &chosen {
            fill += graph.degree(node);
            graph.eliminate(node)?;
        }
        left.retain(|&node| graph.round[node as usize] != u32::MAX);
        order.extend(chosen);
    }
    Some((order, fill))
}

impl Elimination {
    fn new(mut neighbours: Vec<Vec<u32>>) -> Self {
        for list in &mut neighbours {
            list.sort_unstable();
            list.dedup();
        }
        let effort = EFFORT * neighbours.iter().map(|list| 1 + list.len()).sum::<usize>();
        Self { round: vec![0; neighbours.len()], neighbours, effort, merged: Vec::new() }
    }

    fn degree(&self, node: u32) -> usize {
        self.neighbours[node as usize].len()
    }

    /// Nodes of a degree that are not neighbours of each other, nor of those chosen before in this
    /// round.
    fn choose(&mut self, left: &[u32], round: u32, degree: usize) -> Vec<u32> {
        let mut chosen = Vec::new();
        for &node in left {
            if self.degree(node) == degree && self.round[node as usize] != round {
                chosen.push(node);
                self.round[node as usize] = round;
                self.neighbours[node as usize].iter().for_each(|&other| self.round[other as usize] = round);
            }
        }
        chosen
    }

    /// Makes the neighbours of a node neighbours of each other; nothing if that takes too long.
    fn eliminate(&mut self, node: u32) -> Option<()> {
        let clique = std::mem::take(&mut self.neighbours[node as usize]);
        for &other in &clique {
            let theirs = &mut self.neighbours[other as usize];
            self.effort = self.effort.checked_sub(clique.len() + theirs.len())?;
            self.merged.clear();
            unite(&clique, theirs, &mut self.merged);
            self.merged.retain(|&x| x != node && x != other);
            std::mem::swap(theirs, &mut self.merged);
        }
        self.round[node as usize] = u32::MAX;
        Some(())
    }
}

/// All of two rising lists, once each.
fn unite(a: &[u32], b: &[u32], out: &mut Vec<u32>) {
    let (mut a, mut b) = (a.iter().peekable(), b.iter().peekable());
    while let Some(&least) = match (a.peek(), b.peek()) {
        (Some(x), Some(y)) => Some((*x).min(*y)),
        (x, y) => x.or(y).copied(),
    } {
        out.push(least);
        a.next_if(|&&x| x == least);
        b.next_if(|&&x| x == least);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How often a node of a chain waits for another one, in this order.
    fn depth(order: &[u32], mut neighbours: Vec<Vec<u32>>) -> usize {
        let mut level = vec![0; order.len()];
        for &node in order {
            let clique = std::mem::take(&mut neighbours[node as usize]);
            for &other in &clique {
                level[other as usize] = level[other as usize].max(level[node as usize] + 1);
                neighbours[other as usize].retain(|&x| x != node);
                let rest = clique.iter().filter(|&&x| x != other);
                neighbours[other as usize].extend(rest);
            }
        }
        level.into_iter().max().unwrap_or(0)
    }

    fn chain(length: u32) -> Vec<Vec<u32>> {
        (0..length).map(|i| [i.checked_sub(1), Some(i + 1).filter(|&next| next < length)].into_iter().flatten().collect()).collect()
    }

    #[test]
    fn a_chain_is_halved_again_and_again() {
        let (order, fill) = order(chain(256)).expect("an order");
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..256));
        // Cyclic reduction has a fill of one a node; from one end, a chain has none, and waits 255
        // times.
        assert!(fill <= 2 * 256, "{fill}");
        assert!(depth(&order, chain(256)) <= 12, "{}", depth(&order, chain(256)));
        assert_eq!(depth(&(0..256).collect::<Vec<_>>(), chain(256)), 255);
    }

    #[test]
    fn a_star_begins_with_its_rays() {
        let star = (0..40).map(|node| if node == 7 { (0..40).filter(|&other| other != 7).collect() } else { vec![7] }).collect();
        let (order, fill) = order(star).expect("an order");
        assert_eq!((fill, order.iter().rev().take(2).any(|&node| node == 7)), (39, true));
    }

    #[test]
    fn what_is_full_is_left_as_it_is() {
        let full = (0..20).map(|node| (0..20).filter(|&other| other != node).collect()).collect();
        assert_eq!(order(full), Some(((0..20).collect(), 190)));
    }
}
