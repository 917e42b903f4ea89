//! What an expression reads.

use super::affine::Affine;
use super::expr::{Expr, ExprId, Exprs, Flavour};
use super::var::VarId;

/// A load of an element.
type Load = (VarId, Flavour, Affine);

impl Exprs {
    /// Distinct loads below a node that a filter accepts, in the order of variables, copies and addresses.
    pub fn loads(&self, e: ExprId, accept: impl Fn(VarId, Flavour) -> bool) -> Vec<Load> {
        self.loads_where(e, |_| true, accept)
    }

    /// Distinct derivatives below a node of variables that a filter accepts.
    pub fn derivatives(&self, e: ExprId, accept: impl Fn(VarId) -> bool) -> Vec<Load> {
        self.loads_where(e, |e| self.has_derivative(e), |var, flavour| flavour == Flavour::Derivative && accept(var))
    }

    fn loads_where(&self, e: ExprId, concerned: impl Fn(ExprId) -> bool, accept: impl Fn(VarId, Flavour) -> bool) -> Vec<Load> {
        // One bit a node: operands stand before their users.
        let mut seen = vec![0u64; e.as_u32() as usize / 64 + 1];
        let mut stack = vec![e];
        let mut out = Vec::new();
        while let Some(e) = stack.pop() {
            let (word, bit) = (e.as_u32() as usize / 64, 1 << (e.as_u32() % 64));
            if !concerned(e) || seen.get(word).is_none_or(|seen| seen & bit != 0) {
                continue;
            }
            seen[word] |= bit;
            if let Expr::Load { var, flavour, at } = self.node(e)
                && accept(var, flavour)
            {
                out.push((var, flavour, at));
            }
            stack.extend(self.operands(e));
        }
        out.sort_unstable();
        out.dedup();
        out
    }
}
