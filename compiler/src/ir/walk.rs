//! The nodes below some.

use super::{ExprId, Exprs, FastSet};

/// Each node once, from a root down: see [`Exprs::below`].
pub(crate) struct Below<'e> {
    exprs: &'e Exprs,
    seen: FastSet<ExprId>,
    stack: Vec<ExprId>,
}

impl Iterator for Below<'_> {
    type Item = ExprId;

    fn next(&mut self) -> Option<ExprId> {
        loop {
            let e = self.stack.pop()?;
            if self.seen.insert(e) {
                self.stack.extend(self.exprs.operands(e));
                return Some(e);
            }
        }
    }
}

impl Exprs {
    /// The nodes that some are made of, and these themselves, each once.
    pub(crate) fn below(&self, roots: impl IntoIterator<Item = ExprId>) -> Below<'_> {
        Below { exprs: self, seen: FastSet::default(), stack: roots.into_iter().collect() }
    }

    /// The same, operands before their users.
    pub(crate) fn below_in_order(&self, roots: impl IntoIterator<Item = ExprId>) -> Vec<ExprId> {
        let mut nodes: Vec<ExprId> = self.below(roots).collect();
        // Operands are older than what is made of them.
        nodes.sort_unstable();
        nodes
    }
}
