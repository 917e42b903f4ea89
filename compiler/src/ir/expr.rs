//! Nodes and their arena.

use std::fmt;
use std::hash::BuildHasher;

use cranelift_entity::{EntityRef, entity_impl};
use hashbrown::HashTable;
use rustc_hash::FxBuildHasher;
use serde::{Deserialize, Serialize};

use super::affine::{Affine, LoopVar, MAX_DEPTH};
use super::elementary::UnaryFn;
use super::function::{BinaryFn, Compare, ReduceFn};
use super::numbers::{List, Lists, Side};
use super::var::VarId;

/// A node of the graph.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ExprId(u32);
entity_impl!(ExprId, "e");

/// Copy of a variable that a load reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Flavour {
    /// The present value.
    Value,
    /// The time derivative of a state.
    Derivative,
    /// The value at the start of the episode.
    Initial,
    /// The value at the end of the step before.
    Previous,
    /// The value at the steady state.
    Steady,
}

/// A node. Those marked *truth* have a truth value, all others a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Expr {
    /// A number, by its bits (so that equal means identical).
    Const(u64),
    /// *truth*: a constant.
    Truth(bool),
    /// The independent variable.
    Time,
    /// A loop counter as a number.
    Counter(LoopVar),
    /// An element of a variable.
    Load {
        /// The variable.
        var: VarId,
        /// Copy.
        flavour: Flavour,
        /// Element.
        at: Affine,
    },
    /// A function of one number.
    Unary(UnaryFn, ExprId),
    /// A function of two numbers.
    Binary(BinaryFn, ExprId, ExprId),
    /// A whole power.
    PowInt(ExprId, i32),
    /// *truth*: a comparison.
    Compare(Compare, ExprId, ExprId),
    /// *truth*: conjunction.
    And(ExprId, ExprId),
    /// *truth*: disjunction.
    Or(ExprId, ExprId),
    /// *truth*: negation.
    Not(ExprId),
    /// The second where the first (a truth value) holds, else the third. Both are evaluated.
    Select(ExprId, ExprId, ExprId),
    /// Number of ascending limits ([`Lists::add_limits`]) below a number; NaN for NaN.
    Passed(List, Side, ExprId),
    /// The number of a list at an index from 0, a whole number; the first or the last beyond its
    /// ends.
    Entry(List, ExprId),
    /// Reduction of `body` over the loop at `depth`, of `extent` passes; `body` may use that
    /// counter, nothing outside may.
    Reduce {
        /// Combination of terms.
        op: ReduceFn,
        /// The loop.
        depth: LoopVar,
        /// Number of its passes.
        extent: u32,
        /// The term.
        body: ExprId,
    },
}

impl Expr {
    /// The node with other operands.
    #[must_use]
    pub(crate) fn with_operands(self, operand: impl Fn(ExprId) -> ExprId) -> Expr {
        match self {
            Expr::Const(_) | Expr::Truth(_) | Expr::Time | Expr::Counter(_) | Expr::Load { .. } => self,
            Expr::Unary(f, a) => Expr::Unary(f, operand(a)),
            Expr::Binary(f, a, b) => Expr::Binary(f, operand(a), operand(b)),
            Expr::PowInt(a, n) => Expr::PowInt(operand(a), n),
            Expr::Compare(f, a, b) => Expr::Compare(f, operand(a), operand(b)),
            Expr::And(a, b) => Expr::And(operand(a), operand(b)),
            Expr::Or(a, b) => Expr::Or(operand(a), operand(b)),
            Expr::Not(a) => Expr::Not(operand(a)),
            Expr::Select(c, a, b) => Expr::Select(operand(c), operand(a), operand(b)),
            Expr::Passed(limits, side, a) => Expr::Passed(limits, side, operand(a)),
            Expr::Entry(list, a) => Expr::Entry(list, operand(a)),
            Expr::Reduce { op, depth, extent, body } => Expr::Reduce { op, depth, extent, body: operand(body) },
        }
    }
}

/// Bit of a node that contains the time derivative of something, above those of the loop counters.
const DERIVATIVE: u8 = 1 << MAX_DEPTH;

/// The arena of nodes; equal nodes are one. It has many methods: one constructor for each kind of
/// node (`build.rs`).
#[derive(Clone, Default)]
pub struct Exprs {
    nodes: Vec<Expr>,
    /// Free loop counters of each node, one bit a depth, and [`DERIVATIVE`].
    free: Vec<u8>,
    /// Position of each node; the nodes themselves, millions at most, are stored once.
    index: HashTable<ExprId>,
    lists: Lists,
}

fn hash(node: &Expr) -> u64 {
    FxBuildHasher.hash_one(node)
}

/// Only lists and nodes are written; what follows from them is computed again when they are read.
impl Serialize for Exprs {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        (self.lists.all(), &self.nodes).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Exprs {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let (numbers, nodes) = <(Vec<f64>, Vec<Expr>)>::deserialize(deserializer)?;
        let mut exprs = Exprs { lists: Lists::from_all(numbers), ..Exprs::default() };
        for node in nodes {
            let next = ExprId(exprs.nodes.len() as u32);
            if Exprs::operands_of(node).any(|o| o >= next) || exprs.intern(node) != next {
                return Err(serde::de::Error::custom("expressions out of order"));
            }
            if let Expr::Passed(list, ..) | Expr::Entry(list, _) = node
                && !exprs.lists.has(list)
            {
                return Err(serde::de::Error::custom("a list that is not there"));
            }
        }
        Ok(exprs)
    }
}

impl fmt::Debug for Exprs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_map().entries(self.nodes.iter().enumerate().map(|(i, node)| (ExprId::new(i), node))).finish()
    }
}

impl Exprs {
    /// The node of an id.
    #[must_use]
    pub fn node(&self, id: ExprId) -> Expr {
        self.nodes[id.index()]
    }

    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Returns `true` if there is no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// All nodes, operands before what uses them.
    pub fn ids(&self) -> impl Iterator<Item = ExprId> + use<> {
        (0..self.nodes.len()).map(ExprId::new)
    }

    /// Forgets the nodes from the `len`-th on: nothing may hold one of them.
    pub fn truncate(&mut self, len: usize) {
        for (node, id) in self.nodes.drain(len.min(self.nodes.len())..).zip(len..) {
            if let Ok(entry) = self.index.find_entry(hash(&node), |at| at.index() == id) {
                entry.remove();
            }
        }
        self.free.truncate(len);
    }

    /// One more than the deepest *free* loop counter; 0 where the value is one number for a whole
    /// nest.
    #[must_use]
    pub fn depth(&self, id: ExprId) -> u8 {
        (u8::BITS - self.free(id).leading_zeros()) as u8
    }

    /// The *free* loop counters, bit `d` for the counter at depth `d`.
    #[must_use]
    pub fn free(&self, id: ExprId) -> u8 {
        self.free[id.index()] & !DERIVATIVE
    }

    /// Returns `true` if the node or something in it is the time derivative of a variable.
    #[must_use]
    pub fn has_derivative(&self, id: ExprId) -> bool {
        self.free[id.index()] & DERIVATIVE != 0
    }

    /// The number of a constant.
    #[must_use]
    pub(crate) fn as_const(&self, id: ExprId) -> Option<f64> {
        match self.nodes[id.index()] {
            Expr::Const(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    /// Returns `true` if the node has a truth value.
    #[must_use]
    pub(crate) fn is_truth(&self, id: ExprId) -> bool {
        matches!(self.nodes[id.index()], Expr::Truth(_) | Expr::Compare(..) | Expr::And(..) | Expr::Or(..) | Expr::Not(_))
    }

    /// The nodes that a node uses directly.
    pub fn operands(&self, id: ExprId) -> impl Iterator<Item = ExprId> + use<> {
        Self::operands_of(self.nodes[id.index()])
    }

    pub(crate) fn operands_of(node: Expr) -> impl Iterator<Item = ExprId> {
        let (n, ops) = match node {
            Expr::Const(_) | Expr::Truth(_) | Expr::Time | Expr::Counter(_) | Expr::Load { .. } => (0, [ExprId(0); 3]),
            Expr::Unary(_, a) | Expr::PowInt(a, _) | Expr::Not(a) | Expr::Passed(_, _, a) | Expr::Entry(_, a) => (1, [a; 3]),
            Expr::Binary(_, a, b) | Expr::Compare(_, a, b) | Expr::And(a, b) | Expr::Or(a, b) => (2, [a, b, b]),
            Expr::Select(c, a, b) => (3, [c, a, b]),
            Expr::Reduce { body, .. } => (1, [body; 3]),
        };
        ops.into_iter().take(n)
    }

    /// The id of a node, new or known.
    pub(super) fn intern(&mut self, node: Expr) -> ExprId {
        let (hashed, nodes) = (hash(&node), &self.nodes);
        if let Some(&id) = self.index.find(hashed, |at| nodes[at.index()] == node) {
            return id;
        }
        let free = match node {
            Expr::Counter(v) => 1 << v.0,
            Expr::Load { at, flavour, .. } => {
                let derivative = if flavour == Flavour::Derivative { DERIVATIVE } else { 0 };
                (0..MAX_DEPTH).filter(|&d| at.strides[d] != 0).map(|d| 1 << d).sum::<u8>() | derivative
            }
            Expr::Reduce { depth, body, .. } => self.free[body.index()] & !(1 << depth.0),
            _ => Self::operands_of(node).fold(0, |mask, o| mask | self.free[o.index()]),
        };
        let id = ExprId::new(self.nodes.len());
        self.nodes.push(node);
        self.free.push(free);
        let nodes = &self.nodes;
        self.index.insert_unique(hashed, id, |at| hash(&nodes[at.index()]));
        id
    }

    /// The lists that nodes look up.
    #[must_use]
    pub fn lists(&self) -> &Lists {
        &self.lists
    }

    /// The lists that nodes look up, to be added to.
    pub(crate) fn lists_mut(&mut self) -> &mut Lists {
        &mut self.lists
    }
}
