//! Constructors of nodes, which simplify while they build, and copies with parts replaced.

use rustc_hash::FxHashMap as FastMap;

use super::affine::{Affine, LoopVar};
use super::elementary::{Arithmetic, UnaryFn};
use super::expr::{Expr, ExprId, Exprs, Flavour};
use super::function::{BinaryFn, Compare, ReduceFn};
use super::numbers::{List, Side};
use super::var::VarId;
use crate::kernels;

/// Previous results of [`Exprs::rewrite`].
pub(crate) type Rewritten = FastMap<ExprId, ExprId>;

/// Two operands as numbers, where they are.
type Known = (Option<f64>, Option<f64>);

impl Exprs {
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
        match (f, self.node(a)) {
            (UnaryFn::Neg, Expr::Unary(UnaryFn::Neg, inner)) => inner,
            (UnaryFn::Neg, Expr::Binary(BinaryFn::Sub, x, y)) => self.binary(BinaryFn::Sub, y, x),
            _ => self.intern(Expr::Unary(f, a)),
        }
    }

    /// A function of two numbers. Only rewrites that keep every bit (or drop an exact 0 or 1) are
    /// made.
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

    /// Operand of a negation.
    fn negated(&self, e: ExprId) -> Option<ExprId> {
        if let Expr::Unary(UnaryFn::Neg, n) = self.node(e) { Some(n) } else { None }
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

    /// Number of limits of a list below a number.
    pub fn passed(&mut self, limits: List, side: Side, a: ExprId) -> ExprId {
        match self.as_const(a) {
            Some(x) => self.constant(kernels::passed(self.lists().of(limits), side == Side::UpTo, x)),
            None => self.intern(Expr::Passed(limits, side, a)),
        }
    }

    /// The number of a list at an index.
    pub fn entry(&mut self, list: List, index: ExprId) -> ExprId {
        match self.as_const(index) {
            Some(i) => self.constant(kernels::entry(self.lists().of(list), i)),
            None => self.intern(Expr::Entry(list, index)),
        }
    }

    /// The number of a list at an address; a list of one number has it everywhere.
    pub fn entry_at(&mut self, values: &[f64], at: Affine) -> ExprId {
        match values.first() {
            Some(&first) if values.iter().all(|x| x.to_bits() == first.to_bits()) => self.constant(first),
            _ => {
                let index = self.address(at);
                let list = self.lists_mut().add(values);
                self.entry(list, index)
            }
        }
    }

    /// An address as a number.
    fn address(&mut self, at: Affine) -> ExprId {
        let mut index = self.constant(at.offset as f64);
        for (d, &stride) in at.strides.iter().enumerate().filter(|(_, stride)| **stride != 0) {
            let (counter, stride) = (self.counter(LoopVar(d as u8)), self.constant(stride as f64));
            let along = self.mul(stride, counter);
            index = self.add(index, along);
        }
        index
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
        match (self.node(a), self.node(b)) {
            (Expr::Truth(false), _) | (_, Expr::Truth(true)) => a,
            (Expr::Truth(true), _) | (_, Expr::Truth(false)) => b,
            _ if a == b => a,
            _ => self.intern(Expr::And(a, b)),
        }
    }

    /// Disjunction.
    pub fn or(&mut self, a: ExprId, b: ExprId) -> ExprId {
        match (self.node(a), self.node(b)) {
            (Expr::Truth(true), _) | (_, Expr::Truth(false)) => a,
            (Expr::Truth(false), _) | (_, Expr::Truth(true)) => b,
            _ if a == b => a,
            _ => self.intern(Expr::Or(a, b)),
        }
    }

    /// Negation.
    pub fn not(&mut self, a: ExprId) -> ExprId {
        match self.node(a) {
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
        if let Expr::Truth(v) = self.node(c) {
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

    /// Returns `true` if a node has a reduction below it (or is one) that `repeats` says so of, by
    /// its free counters.
    pub fn has_reduction(&self, e: ExprId, repeats: impl Fn(u8) -> bool) -> bool {
        let mut found = false;
        self.each_reduction(e, &mut |depth, body| found |= repeats(self.free(body) & !(1 << depth.0)));
        found
    }

    /// Visits the counter and the body of each reduction below a node, and of itself.
    pub(crate) fn each_reduction(&self, e: ExprId, visit: &mut dyn FnMut(LoopVar, ExprId)) {
        for e in self.below([e]) {
            if let Expr::Reduce { depth, body, .. } = self.node(e) {
                visit(depth, body);
            }
        }
    }

    /// Copies `e` with leaves replaced: `replace` is asked for every node, outermost first; `None`
    /// means go on inside. `done` holds what was already rewritten and may be kept for several
    /// calls with the same replacement.
    pub(crate) fn rewrite(
        &mut self,
        e: ExprId,
        done: &mut Rewritten,
        replace: &mut dyn FnMut(&mut Exprs, Expr) -> Option<ExprId>,
    ) -> ExprId {
        self.rewrite_where(e, done, &|_, _| true, replace)
    }

    /// As [`Exprs::rewrite`], but only nodes that are `concerned` are looked at; all others stay as
    /// they are.
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
            let node = self.node(id);
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

impl Arithmetic for Exprs {
    type Number = ExprId;

    fn constant(&mut self, x: f64) -> ExprId {
        self.constant(x)
    }

    fn unary(&mut self, f: UnaryFn, a: ExprId) -> ExprId {
        self.unary(f, a)
    }

    fn binary(&mut self, f: BinaryFn, a: ExprId, b: ExprId) -> ExprId {
        self.binary(f, a, b)
    }

    fn powi(&mut self, a: ExprId, n: i32) -> ExprId {
        self.powi(a, n)
    }

    fn where_equal(&mut self, (a, b): (ExprId, ExprId), then: ExprId, otherwise: ExprId) -> ExprId {
        let equal = self.compare(Compare::Eq, a, b);
        self.select(equal, then, otherwise)
    }
}
