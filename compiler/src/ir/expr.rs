//! Nodes, their arena, and the constructors that simplify while they build.

use std::fmt;
use std::hash::BuildHasher;

use cranelift_entity::{EntityRef, entity_impl};
use hashbrown::HashTable;
use rustc_hash::{FxBuildHasher, FxHashMap as FastMap, FxHashSet as FastSet};
use serde::{Deserialize, Serialize};

use super::affine::{Affine, LoopVar, MAX_DEPTH};
use super::function::{BinaryFn, Compare, ReduceFn, UnaryFn};
use super::numbers::{List, Lists, Side};
use super::var::VarId;
use crate::kernels;

/// A node of the graph.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ExprId(u32);
entity_impl!(ExprId, "e");

/// Which copy of a variable a load reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
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
        /// Which copy of it.
        flavour: Flavour,
        /// Which element.
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
    /// How many of ascending limits ([`Lists::add_limits`]) a number has left behind; NaN for what is not a number.
    Passed(List, Side, ExprId),
    /// The number of a list at an index from 0, a whole number; the first or the last beyond its ends.
    Entry(List, ExprId),
    /// Reduction of `body` over the loop at `depth`, of `extent` passes; `body` may use that counter, nothing outside may.
    Reduce {
        /// How terms are combined.
        op: ReduceFn,
        /// The loop.
        depth: LoopVar,
        /// Number of its passes.
        extent: u32,
        /// The term.
        body: ExprId,
    },
}

/// Bit of a node that contains the time derivative of something, above those of the loop counters.
const DERIVATIVE: u8 = 1 << MAX_DEPTH;

/// What [`Exprs::rewrite`] has made of nodes already.
pub(crate) type Rewritten = FastMap<ExprId, ExprId>;

/// The arena of nodes; equal nodes are one.
#[derive(Clone, Default)]
pub struct Exprs {
    nodes: Vec<Expr>,
    /// Free loop counters of each node, one bit a depth, and [`DERIVATIVE`].
    free: Vec<u8>,
    /// Where each node stands; the nodes themselves, millions at most, are held once.
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

/// Two operands as numbers, where they are.
type Known = (Option<f64>, Option<f64>);

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

    /// Whether there is no node.
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

    /// One more than the deepest *free* loop counter; 0 where the value is one number for a whole nest.
    #[must_use]
    pub fn depth(&self, id: ExprId) -> u8 {
        (u8::BITS - self.free(id).leading_zeros()) as u8
    }

    /// The *free* loop counters, bit `d` for the counter at depth `d`.
    #[must_use]
    pub fn free(&self, id: ExprId) -> u8 {
        self.free[id.index()] & !DERIVATIVE
    }

    /// Whether the node or something in it is the time derivative of a variable.
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

    /// Whether the node has a truth value.
    #[must_use]
    pub(crate) fn is_truth(&self, id: ExprId) -> bool {
        matches!(self.nodes[id.index()], Expr::Truth(_) | Expr::Compare(..) | Expr::And(..) | Expr::Or(..) | Expr::Not(_))
    }

    /// The nodes that a node uses directly.
    pub fn operands(&self, id: ExprId) -> impl Iterator<Item = ExprId> + use<> {
        Self::operands_of(self.nodes[id.index()])
    }

    fn operands_of(node: Expr) -> impl Iterator<Item = ExprId> {
        let (n, ops) = match node {
            Expr::Const(_) | Expr::Truth(_) | Expr::Time | Expr::Counter(_) | Expr::Load { .. } => (0, [ExprId(0); 3]),
            Expr::Unary(_, a) | Expr::PowInt(a, _) | Expr::Not(a) | Expr::Passed(_, _, a) | Expr::Entry(_, a) => (1, [a; 3]),
            Expr::Binary(_, a, b) | Expr::Compare(_, a, b) | Expr::And(a, b) | Expr::Or(a, b) => (2, [a, b, b]),
            Expr::Select(c, a, b) => (3, [c, a, b]),
            Expr::Reduce { body, .. } => (1, [body; 3]),
        };
        ops.into_iter().take(n)
    }

    fn intern(&mut self, node: Expr) -> ExprId {
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

    /// Builds any node without simplifying (for passes that copy).
    pub fn raw(&mut self, node: Expr) -> ExprId {
        self.intern(node)
    }

    /// A number.
    pub fn constant(&mut self, value: f64) -> ExprId {
        // One zero only: -0.0 would make two nodes of one number.
        let value = if value == 0.0 { 0.0 } else { value };
        self.intern(Expr::Const(value.to_bits()))
    }

    /// A truth value.
    pub fn truth(&mut self, value: bool) -> ExprId {
        self.intern(Expr::Truth(value))
    }

    /// The independent variable.
    pub fn time(&mut self) -> ExprId {
        self.intern(Expr::Time)
    }

    /// A loop counter as a number.
    pub fn counter(&mut self, v: LoopVar) -> ExprId {
        self.intern(Expr::Counter(v))
    }

    /// An element of a variable.
    pub fn load(&mut self, var: VarId, flavour: Flavour, at: Affine) -> ExprId {
        self.intern(Expr::Load { var, flavour, at })
    }

    /// A function of one number.
    pub fn unary(&mut self, f: UnaryFn, a: ExprId) -> ExprId {
        if let Some(x) = self.as_const(a) {
            return self.constant(f.apply(x));
        }
        match (f, self.nodes[a.index()]) {
            (UnaryFn::Neg, Expr::Unary(UnaryFn::Neg, inner)) => inner,
            (UnaryFn::Neg, Expr::Binary(BinaryFn::Sub, x, y)) => self.binary(BinaryFn::Sub, y, x),
            _ => self.intern(Expr::Unary(f, a)),
        }
    }

    /// A function of two numbers. Only rewrites that keep every bit (or drop an exact 0 or 1) are made.
    pub fn binary(&mut self, f: BinaryFn, a: ExprId, b: ExprId) -> ExprId {
        let known = (self.as_const(a), self.as_const(b));
        if let (Some(x), Some(y)) = known {
            return self.constant(f.apply(x, y));
        }
        let simpler = match f {
            BinaryFn::Add => self.simpler_sum(a, b, known),
            BinaryFn::Sub => self.simpler_difference(a, b, known),
            BinaryFn::Mul => self.simpler_product(a, b, known),
            BinaryFn::Div => self.simpler_quotient(a, known),
            BinaryFn::Pow => self.simpler_power(a, known.1),
            BinaryFn::Min | BinaryFn::Max => (a == b).then_some(a),
            BinaryFn::Atan2 => None,
        };
        simpler.unwrap_or_else(|| {
            // Commutative operations have one order, so that a*b and b*a are one node.
            let (a, b) = match f {
                BinaryFn::Add | BinaryFn::Mul if b < a => (b, a),
                _ => (a, b),
            };
            self.intern(Expr::Binary(f, a, b))
        })
    }

    /// What is negated, where a node is a negation.
    fn negated(&self, e: ExprId) -> Option<ExprId> {
        if let Expr::Unary(UnaryFn::Neg, n) = self.nodes[e.index()] { Some(n) } else { None }
    }

    fn simpler_sum(&mut self, a: ExprId, b: ExprId, known: Known) -> Option<ExprId> {
        match known {
            (Some(0.0), _) => Some(b),
            (_, Some(0.0)) => Some(a),
            _ => match (self.negated(a), self.negated(b)) {
                (_, Some(n)) => Some(self.binary(BinaryFn::Sub, a, n)),
                (Some(n), _) => Some(self.binary(BinaryFn::Sub, b, n)),
                _ => None,
            },
        }
    }

    fn simpler_difference(&mut self, a: ExprId, b: ExprId, known: Known) -> Option<ExprId> {
        match known {
            (_, Some(0.0)) => Some(a),
            (Some(0.0), _) => Some(self.unary(UnaryFn::Neg, b)),
            _ if a == b => Some(self.constant(0.0)),
            _ => self.negated(b).map(|n| self.binary(BinaryFn::Add, a, n)),
        }
    }

    fn simpler_product(&mut self, a: ExprId, b: ExprId, known: Known) -> Option<ExprId> {
        match known {
            (Some(0.0), _) | (_, Some(0.0)) => Some(self.constant(0.0)),
            (Some(1.0), _) => Some(b),
            (_, Some(1.0)) => Some(a),
            (Some(-1.0), _) => Some(self.unary(UnaryFn::Neg, b)),
            (_, Some(-1.0)) => Some(self.unary(UnaryFn::Neg, a)),
            _ => None,
        }
    }

    fn simpler_quotient(&mut self, a: ExprId, known: Known) -> Option<ExprId> {
        match known {
            (Some(0.0), _) | (_, Some(1.0)) => Some(a),
            (_, Some(-1.0)) => Some(self.unary(UnaryFn::Neg, a)),
            _ => None,
        }
    }

    fn simpler_power(&mut self, a: ExprId, exponent: Option<f64>) -> Option<ExprId> {
        match exponent? {
            0.5 => Some(self.unary(UnaryFn::Sqrt, a)),
            n if n.fract() == 0.0 && n.abs() <= 32.0 => Some(self.powi(a, n as i32)),
            _ => None,
        }
    }

    /// `a + b`
    pub fn add(&mut self, a: ExprId, b: ExprId) -> ExprId {
        self.binary(BinaryFn::Add, a, b)
    }

    /// `a - b`
    pub fn sub(&mut self, a: ExprId, b: ExprId) -> ExprId {
        self.binary(BinaryFn::Sub, a, b)
    }

    /// `a · b`
    pub fn mul(&mut self, a: ExprId, b: ExprId) -> ExprId {
        self.binary(BinaryFn::Mul, a, b)
    }

    /// `a / b`
    pub fn div(&mut self, a: ExprId, b: ExprId) -> ExprId {
        self.binary(BinaryFn::Div, a, b)
    }

    /// `-a`
    pub fn neg(&mut self, a: ExprId) -> ExprId {
        self.unary(UnaryFn::Neg, a)
    }

    /// `a^n`
    pub fn powi(&mut self, a: ExprId, n: i32) -> ExprId {
        match n {
            0 => self.constant(1.0),
            1 => a,
            _ => match self.as_const(a) {
                Some(x) => self.constant(kernels::powi(x, n)),
                None => self.intern(Expr::PowInt(a, n)),
            },
        }
    }

    /// The lists that nodes look up.
    #[must_use]
    pub fn lists(&self) -> &Lists {
        &self.lists
    }

    /// The lists that nodes look up, to be added to.
    pub fn lists_mut(&mut self) -> &mut Lists {
        &mut self.lists
    }

    /// How many of a list of limits a number has left behind.
    pub fn passed(&mut self, limits: List, side: Side, a: ExprId) -> ExprId {
        match self.as_const(a) {
            Some(x) => self.constant(kernels::passed(self.lists.of(limits), side == Side::UpTo, x)),
            None => self.intern(Expr::Passed(limits, side, a)),
        }
    }

    /// The number of a list at an index.
    pub fn entry(&mut self, list: List, index: ExprId) -> ExprId {
        match self.as_const(index) {
            Some(i) => self.constant(kernels::entry(self.lists.of(list), i)),
            None => self.intern(Expr::Entry(list, index)),
        }
    }

    /// A comparison.
    pub fn compare(&mut self, op: Compare, a: ExprId, b: ExprId) -> ExprId {
        match (self.as_const(a), self.as_const(b)) {
            (Some(x), Some(y)) => self.truth(op.apply(x, y)),
            _ => self.intern(Expr::Compare(op, a, b)),
        }
    }

    /// Conjunction.
    pub fn and(&mut self, a: ExprId, b: ExprId) -> ExprId {
        match (self.nodes[a.index()], self.nodes[b.index()]) {
            (Expr::Truth(false), _) | (_, Expr::Truth(true)) => a,
            (Expr::Truth(true), _) | (_, Expr::Truth(false)) => b,
            _ if a == b => a,
            _ => self.intern(Expr::And(a, b)),
        }
    }

    /// Disjunction.
    pub fn or(&mut self, a: ExprId, b: ExprId) -> ExprId {
        match (self.nodes[a.index()], self.nodes[b.index()]) {
            (Expr::Truth(true), _) | (_, Expr::Truth(false)) => a,
            (Expr::Truth(false), _) | (_, Expr::Truth(true)) => b,
            _ if a == b => a,
            _ => self.intern(Expr::Or(a, b)),
        }
    }

    /// Negation.
    pub fn not(&mut self, a: ExprId) -> ExprId {
        match self.nodes[a.index()] {
            Expr::Truth(v) => self.truth(!v),
            Expr::Not(inner) => inner,
            _ => self.intern(Expr::Not(a)),
        }
    }

    /// `if c then a else b`, for numbers and for truth values.
    pub fn select(&mut self, c: ExprId, a: ExprId, b: ExprId) -> ExprId {
        if a == b {
            return a;
        }
        if let Expr::Truth(v) = self.nodes[c.index()] {
            return if v { a } else { b };
        }
        if self.is_truth(a) || self.is_truth(b) {
            let not_c = self.not(c);
            let (x, y) = (self.and(c, a), self.and(not_c, b));
            return self.or(x, y);
        }
        self.intern(Expr::Select(c, a, b))
    }

    /// A truth value as 1 or 0.
    pub fn number(&mut self, truth: ExprId) -> ExprId {
        if !self.is_truth(truth) {
            return truth;
        }
        let (one, zero) = (self.constant(1.0), self.constant(0.0));
        self.select(truth, one, zero)
    }

    /// A reduction over a loop.
    pub fn reduce(&mut self, op: ReduceFn, depth: LoopVar, extent: u32, body: ExprId) -> ExprId {
        if extent == 1 {
            return self.shift(body, depth, 0);
        }
        if let (ReduceFn::Sum, Some(x)) = (op, self.as_const(body)) {
            return self.constant(x * f64::from(extent));
        }
        self.intern(Expr::Reduce { op, depth, extent, body })
    }

    /// The body of a loop at one value of its counter: `l_depth := value`.
    pub fn shift(&mut self, e: ExprId, depth: LoopVar, value: i64) -> ExprId {
        let d = depth.0 as usize;
        self.rewrite(e, &mut Rewritten::default(), &mut |exprs, node| match node {
            // A reduction may bind the same counter again: inside, it is another one.
            Expr::Reduce { body, depth: bound, .. } if bound == depth || exprs.free(body) & (1 << d) == 0 => Some(exprs.raw(node)),
            Expr::Counter(v) if v == depth => Some(exprs.constant(value as f64)),
            Expr::Load { var, flavour, mut at } if at.strides[d] != 0 => {
                at.offset += at.strides[d] * value;
                at.strides[d] = 0;
                Some(exprs.load(var, flavour, at))
            }
            _ => None,
        })
    }

    /// Whether a node has a reduction below it (or is one) that `repeats` says so of, by its free counters.
    pub fn has_reduction(&self, e: ExprId, repeats: impl Fn(u8) -> bool) -> bool {
        let mut found = false;
        self.each_reduction(e, &mut |depth, body| found |= repeats(self.free(body) & !(1 << depth.0)));
        found
    }

    /// Visits the counter and the body of each reduction below a node, and of itself.
    pub(crate) fn each_reduction(&self, e: ExprId, visit: &mut dyn FnMut(LoopVar, ExprId)) {
        let mut seen = FastSet::default();
        let mut stack = vec![e];
        while let Some(e) = stack.pop() {
            if !seen.insert(e) {
                continue;
            }
            if let Expr::Reduce { depth, body, .. } = self.node(e) {
                visit(depth, body);
            }
            stack.extend(self.operands(e));
        }
    }

    /// Copies `e` with leaves replaced: `replace` is asked for every node, outermost first; `None` means go on inside.
    /// `done` holds what was already rewritten and may be kept for several calls with the same replacement.
    pub(crate) fn rewrite(
        &mut self,
        e: ExprId,
        done: &mut Rewritten,
        replace: &mut dyn FnMut(&mut Exprs, Expr) -> Option<ExprId>,
    ) -> ExprId {
        self.rewrite_where(e, done, &|_, _| true, replace)
    }

    /// As [`Exprs::rewrite`], but only nodes that are `concerned` are looked at; all others stay as they are.
    pub(crate) fn rewrite_where(
        &mut self,
        e: ExprId,
        done: &mut Rewritten,
        concerned: &dyn Fn(&Exprs, ExprId) -> bool,
        replace: &mut dyn FnMut(&mut Exprs, Expr) -> Option<ExprId>,
    ) -> ExprId {
        // An explicit stack: expressions may be thousands of nodes deep.
        let mut stack = vec![(e, false)];
        while let Some((id, entered)) = stack.pop() {
            if done.contains_key(&id) || !concerned(self, id) {
                continue;
            }
            let node = self.nodes[id.index()];
            if entered {
                let copy = self.rebuild(node, |o| done.get(&o).copied().unwrap_or(o));
                done.insert(id, copy);
            } else if let Some(replaced) = replace(self, node) {
                done.insert(id, replaced);
            } else {
                stack.push((id, true));
                stack.extend(Self::operands_of(node).filter(|o| !done.contains_key(o)).map(|o| (o, false)));
            }
        }
        done.get(&e).copied().unwrap_or(e)
    }

    /// The node with other operands, simplified; leaves as they are.
    pub(crate) fn rebuild(&mut self, node: Expr, operand: impl Fn(ExprId) -> ExprId) -> ExprId {
        match node {
            Expr::Const(_) | Expr::Truth(_) | Expr::Time | Expr::Counter(_) | Expr::Load { .. } => self.intern(node),
            Expr::Unary(f, a) => self.unary(f, operand(a)),
            Expr::PowInt(a, n) => self.powi(operand(a), n),
            Expr::Not(a) => self.not(operand(a)),
            Expr::Passed(limits, side, a) => self.passed(limits, side, operand(a)),
            Expr::Entry(list, index) => self.entry(list, operand(index)),
            Expr::Binary(f, a, b) => self.binary(f, operand(a), operand(b)),
            Expr::Compare(f, a, b) => self.compare(f, operand(a), operand(b)),
            Expr::And(a, b) => self.and(operand(a), operand(b)),
            Expr::Or(a, b) => self.or(operand(a), operand(b)),
            Expr::Select(c, a, b) => self.select(operand(c), operand(a), operand(b)),
            Expr::Reduce { op, depth, extent, body } => self.reduce(op, depth, extent, operand(body)),
        }
    }
}
