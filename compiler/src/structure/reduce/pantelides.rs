//! Choice of the equations to differentiate: Pantelides (SIAM J. Sci. Stat. Comput. 9 (1988)
//! 213-231), a loop of equations as one.

use super::slopes::{NoSlope, Slopes};
use super::system::{Matching, Node, Pool, Search};
use crate::ir::{FastMap, FastSet, Role, VarId};
use crate::model::Model;

/// Most differentiations of one equation.
const MOST: u32 = 6;

/// A system with its matching.
pub(super) struct System {
    pub(super) nodes: Vec<Node>,
    /// Unknowns of highest order, which no equation but those of highest order may determine.
    pub(super) pool: Pool,
    /// Unknowns of lower order.
    pub(super) lower: Pool,
    pub(super) slopes: Slopes,
    pub(super) matching: Matching,
}

/// Reasons not to reduce a system.
pub(super) enum Refused {
    /// A node has no time derivative.
    NoSlope(usize, NoSlope),
    /// Equations that no number of differentiations determines unknowns from.
    Singular,
}

impl System {
    /// Matches the nodes without a derivative; those that found nothing, with all that their
    /// searches came to.
    fn matched(&mut self, model: &Model) -> (Vec<usize>, FastSet<usize>) {
        let top: Vec<usize> = (0..self.nodes.len()).filter(|&i| self.nodes[i].derivative.is_none()).collect();
        let in_pool = |node: &Node| {
            let mut list = node.candidates(model, Role::Algebraic);
            list.retain(|(var, at)| {
                let mut fits = true;
                crate::elaborate::for_each_element(&node.extents, *at, &mut |i| fits &= self.pool.has(*var, i));
                fits
            });
            list.sort_by_key(|&candidate| node.own != Some(candidate));
            list
        };
        let candidates: FastMap<usize, Vec<_>> = top.iter().map(|&i| (i, in_pool(&self.nodes[i]))).collect();
        let search = Search { nodes: &self.nodes, candidates: &candidates, pool: &self.pool };
        let mut matching = Matching::default();
        let rest: Vec<usize> = top.into_iter().filter(|&i| !matching.take_own(&search, i)).collect();
        let (mut failed, mut reached) = (Vec::new(), FastSet::default());
        for node in rest {
            let mut visited = FastSet::default();
            if !matching.augment(&search, node, &mut visited, 0) {
                failed.push(node);
                reached.extend(visited);
            }
        }
        self.matching = matching;
        (failed, reached)
    }

    /// Unknowns without a node.
    pub(super) fn missing(&self) -> Vec<(VarId, i64)> {
        let mut all = self.pool.elements();
        all.retain(|&(var, i)| self.matching.owner(var, i).is_none());
        all
    }

    /// Differentiates what has to be until every node has its unknowns.
    pub(super) fn reduce(&mut self, model: &mut Model) -> Result<(), Refused> {
        loop {
            let (failed, reached) = self.matched(model);
            if failed.is_empty() {
                return if self.missing().is_empty() { Ok(()) } else { Err(Refused::Singular) };
            }
            let mut reached: Vec<usize> = reached.into_iter().collect();
            reached.sort_unstable();
            if reached.iter().any(|&i| self.nodes[i].order >= MOST) {
                return Err(Refused::Singular);
            }
            for &i in &reached {
                self.raise(model, i);
            }
            for &i in &reached {
                let derivative =
                    self.slopes.differentiated(model, (&mut self.nodes, &mut self.pool), i).map_err(|fault| Refused::NoSlope(i, fault))?;
                self.nodes[i].derivative = Some(self.nodes.len());
                self.nodes.push(derivative);
            }
        }
    }

    /// Puts the rates of the unknowns of a node in their place.
    fn raise(&mut self, model: &mut Model, node: usize) {
        for read in self.nodes[node].reads(model, Role::Algebraic) {
            let mut elements = Vec::new();
            read.each(&mut |i| elements.push(i));
            elements.retain(|&i| self.pool.has(read.var, i));
            self.raise_elements(model, read.var, &elements);
        }
    }

    /// Makes the rates of elements unknowns instead of these.
    pub(super) fn raise_elements(&mut self, model: &mut Model, var: VarId, elements: &[i64]) {
        if elements.is_empty() {
            return;
        }
        let rate = self.slopes.variable(model, var);
        for &i in elements {
            self.pool.set(model, var, i, false);
            self.lower.set(model, var, i, true);
            self.pool.set(model, rate, i, true);
        }
    }
}
