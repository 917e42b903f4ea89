//! Variables that an expression reads.

use super::FastMap;
use super::affine::Affine;
use super::expr::{Expr, ExprId, Exprs, Flavour};
use super::var::VarId;

/// A load of an element.
type Load = (VarId, Flavour, Affine);

impl Exprs {
    /// Distinct loads below a node that a filter accepts, in the order of variables, copies and
    /// addresses.
    pub(crate) fn loads(&self, e: ExprId, accept: impl Fn(VarId, Flavour) -> bool) -> Vec<Load> {
        self.loads_where(e, |_| true, accept)
    }

    /// Distinct derivatives below a node of variables that a filter accepts.
    pub fn derivatives(&self, e: ExprId, accept: impl Fn(VarId) -> bool) -> Vec<Load> {
        self.loads_where(e, |e| self.has_derivative(e), |var, flavour| flavour == Flavour::Derivative && accept(var))
    }

    fn loads_where(&self, e: ExprId, concerned: impl Fn(ExprId) -> bool, accept: impl Fn(VarId, Flavour) -> bool) -> Vec<Load> {
        let mut seen = Seen::below(e);
        let mut stack = vec![e];
        let mut out = Vec::new();
        while let Some(e) = stack.pop() {
            if !concerned(e) || !seen.insert(e) {
                continue;
            }
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

/// Nodes with numbers up to this are kept as a bit each; behind it an array of bits costs more than
/// most walks.
const FEW: u32 = 1 << 16;

/// The nodes that a walk has met; operands precede their users.
enum Seen {
    /// One bit a node.
    Bits(Vec<u64>),
    /// Those of the words of bits that are not zero.
    Words(FastMap<u32, u64>),
}

impl Seen {
    /// For the node and what it is made of.
    fn below(e: ExprId) -> Self {
        if e.as_u32() < FEW { Self::Bits(vec![0; e.as_u32() as usize / 64 + 1]) } else { Self::Words(FastMap::default()) }
    }

    /// Returns `true` if the node is new.
    fn insert(&mut self, e: ExprId) -> bool {
        let (word, bit) = (e.as_u32() / 64, 1 << (e.as_u32() % 64));
        let seen = match self {
            Self::Bits(words) => words.get_mut(word as usize),
            Self::Words(words) => Some(words.entry(word).or_default()),
        };
        let Some(seen) = seen else { return false };
        let new = *seen & bit == 0;
        *seen |= bit;
        new
    }
}
