//! Bounds of expressions over a box of unknowns and a span of time: the natural interval extension,
//! as expressions.
//!
//! An expression that depends on unknowns or time becomes a pair of expressions, its lower and its
//! upper bound. In them an unknown's value stands for its lower bound and its derivative for its
//! upper bound. Time is the beginning of the span, and the scalar argument of a function its end.
//! So the bounds are compiled, hoisted and kept in loops like any other function. Truth values
//! become the pair *certainly* and *possibly*.
//!
//! A bound is not a number where the box exceeds the domain of a function (`sqrt(x)` with negative
//! x). Bounds are those of exact arithmetic, up to rounding. They are as tight as each operation
//! allows, and loose where an unknown occurs several times; a smaller box makes them tighter (R. E.
//! Moore, *Interval Analysis*, Prentice-Hall 1966, chapter 4).

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::ir::{Affine, BinaryFn, Builtin, Compare, DelaySlot, Expr, ExprId, Exprs, FastMap, Flavour, ReduceFn, Role, UnaryFn, VarId};
use crate::model::Model;

/// Lower and upper bound, or *certainly* and *possibly*.
type Pair = (ExprId, ExprId);

/// The pass: bounds of expressions of one model.
pub(crate) struct Encloser<'a> {
    model: &'a mut Model,
    /// The variable of the numbers that every model has.
    builtins: VarId,
    /// Bounds that are made; `None` for what does not move within a step.
    done: FastMap<ExprId, Option<Pair>>,
}

impl<'a> Encloser<'a> {
    /// A pass over a model, whose variable of numbers that every model has is given.
    pub(crate) fn new(model: &'a mut Model, builtins: VarId) -> Self {
        Self { model, builtins, done: FastMap::default() }
    }

    /// Lower and upper bound of a number; `None` where it reads rates, of which no bounds are
    /// known.
    pub(crate) fn bounds(&mut self, e: ExprId) -> Option<Pair> {
        if self.model.exprs.has_derivative(e) {
            return None;
        }
        for node in self.model.exprs.below_in_order([e]) {
            if !self.done.contains_key(&node) {
                let pair = self.enclose(node);
                self.done.insert(node, pair);
            }
        }
        Some(self.pair(e))
    }

    fn x(&mut self) -> &mut Exprs {
        &mut self.model.exprs
    }

    fn pair(&self, e: ExprId) -> Pair {
        self.done.get(&e).copied().flatten().unwrap_or((e, e))
    }

    fn moves(&self, e: ExprId) -> bool {
        self.done.get(&e).is_some_and(Option::is_some)
    }

    /// Bounds of a node whose operands have theirs.
    fn enclose(&mut self, e: ExprId) -> Option<Pair> {
        let node = self.model.exprs.node(e);
        match node {
            Expr::Time => {
                let end = Affine::constant(Builtin::DerivativeFactor as i64);
                let end = self.model.exprs.load(self.builtins, Flavour::Value, end);
                return Some((e, end));
            }
            Expr::Load { var, flavour: Flavour::Value, at } => {
                let moves = matches!(self.model.vars[var].role, Role::State | Role::Algebraic);
                return moves.then(|| (e, self.model.exprs.load(var, Flavour::Derivative, at)));
            }
            Expr::Binary(BinaryFn::Add, a, b) => {
                if let Some(pair) = self.delayed(a).or_else(|| self.delayed(b)) {
                    return Some(pair);
                }
                if !self.moves(a) && !self.moves(b) {
                    return None;
                }
            }
            _ if !self.model.exprs.operands(e).any(|o| self.moves(o)) => return None,
            _ => {}
        }
        Some(match node {
            Expr::Unary(f, a) => self.unary(f, a),
            Expr::Binary(f, a, b) => self.binary(f, a, b),
            Expr::PowInt(a, n) => self.power(a, n),
            Expr::Compare(op, a, b) => self.compare(op, a, b),
            Expr::And(a, b) => self.both(a, b, Exprs::and),
            Expr::Or(a, b) => self.both(a, b, Exprs::or),
            Expr::Not(a) => {
                let (certain, possible) = self.pair(a);
                (self.x().not(possible), self.x().not(certain))
            }
            Expr::Select(c, a, b) => self.select(c, a, b),
            Expr::Passed(limits, side, a) => {
                let (low, high) = self.pair(a);
                (self.x().passed(limits, side, low), self.x().passed(limits, side, high))
            }
            Expr::Entry(list, index) => {
                let (low, high) = self.pair(index);
                let same = self.x().compare(Compare::Eq, low, high);
                let known = self.x().entry(list, low);
                let numbers = self.x().lists().of(list);
                let least = numbers.iter().copied().fold(f64::INFINITY, f64::min);
                let most = numbers.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let (least, most) = (self.x().constant(least), self.x().constant(most));
                (self.x().select(same, known, least), self.x().select(same, known, most))
            }
            Expr::Reduce { op: ReduceFn::Product, .. } => self.all(),
            Expr::Reduce { op, depth, extent, body } => {
                let (low, high) = self.pair(body);
                (self.x().reduce(op, depth, extent, low), self.x().reduce(op, depth, extent, high))
            }
            _ => self.all(),
        })
    }

    /// Bounds of a delayed value over the span of time, where a node is the first term of one. The
    /// second term of the sum is zero.
    fn delayed(&mut self, e: ExprId) -> Option<Pair> {
        let Expr::Load { var, flavour: Flavour::Value, at } = self.model.exprs.node(e) else { return None };
        if self.model.vars[var].role != Role::Delayed {
            return None;
        }
        let mut slot = |slot: DelaySlot| self.model.exprs.load(var, Flavour::Value, at.plus(Affine::constant(slot as i64)));
        Some((slot(DelaySlot::Low), slot(DelaySlot::High)))
    }

    /// Any number.
    fn all(&mut self) -> Pair {
        (self.x().constant(f64::NEG_INFINITY), self.x().constant(f64::INFINITY))
    }

    fn both(&mut self, a: ExprId, b: ExprId, f: fn(&mut Exprs, ExprId, ExprId) -> ExprId) -> Pair {
        let ((certain_a, possible_a), (certain_b, possible_b)) = (self.pair(a), self.pair(b));
        (f(self.x(), certain_a, certain_b), f(self.x(), possible_a, possible_b))
    }

    /// The least and the largest of some numbers.
    fn hull(&mut self, numbers: &[ExprId]) -> Pair {
        let fold = |x: &mut Exprs, f: BinaryFn| numbers.iter().copied().reduce(|a, b| x.binary(f, a, b));
        let (low, high) = (fold(self.x(), BinaryFn::Min), fold(self.x(), BinaryFn::Max));
        match (low, high) {
            (Some(low), Some(high)) => (low, high),
            _ => self.all(),
        }
    }

    /// Bounds where a condition holds, others where it does not.
    fn either(&mut self, c: ExprId, (low_a, high_a): Pair, (low_b, high_b): Pair) -> Pair {
        (self.x().select(c, low_a, low_b), self.x().select(c, high_a, high_b))
    }

    fn select(&mut self, c: ExprId, a: ExprId, b: ExprId) -> Pair {
        let (first, second) = (self.pair(a), self.pair(b));
        if !self.moves(c) {
            return self.either(c, first, second);
        }
        let (certain, possible) = self.pair(c);
        let x = self.x();
        let mixed = (x.binary(BinaryFn::Min, first.0, second.0), x.binary(BinaryFn::Max, first.1, second.1));
        let otherwise = self.either(possible, mixed, second);
        self.either(certain, first, otherwise)
    }

    fn compare(&mut self, op: Compare, a: ExprId, b: ExprId) -> Pair {
        let ((low_a, high_a), (low_b, high_b)) = (self.pair(a), self.pair(b));
        let x = self.x();
        // NaN makes everything possible, therefore the negations.
        match op {
            Compare::Lt => {
                let never = x.compare(Compare::Le, high_b, low_a);
                (x.compare(Compare::Lt, high_a, low_b), x.not(never))
            }
            Compare::Le => {
                let never = x.compare(Compare::Lt, high_b, low_a);
                (x.compare(Compare::Le, high_a, low_b), x.not(never))
            }
            Compare::Eq | Compare::Ne => {
                let (above, below) = (x.compare(Compare::Lt, high_b, low_a), x.compare(Compare::Lt, high_a, low_b));
                let apart = x.or(above, below);
                if op == Compare::Eq { (x.truth(false), x.not(apart)) } else { (apart, x.truth(true)) }
            }
        }
    }

    fn unary(&mut self, f: UnaryFn, a: ExprId) -> Pair {
        let (low, high) = self.pair(a);
        let x = &mut self.model.exprs;
        match f {
            UnaryFn::Smooth => (low, high),
            UnaryFn::Neg => (x.neg(high), x.neg(low)),
            UnaryFn::Acos => (x.unary(f, high), x.unary(f, low)),
            UnaryFn::Abs | UnaryFn::Cosh => {
                let least = x.constant(f.apply(0.0));
                let (at_low, at_high) = (x.unary(f, low), x.unary(f, high));
                let (zero, hull) = (x.constant(0.0), self.hull(&[at_low, at_high]));
                let x = self.x();
                let (below, above) = (x.compare(Compare::Le, low, zero), x.compare(Compare::Le, zero, high));
                let through = x.and(below, above);
                (x.select(through, least, hull.0), hull.1)
            }
            UnaryFn::Sin => self.wave(f, (low, high), -FRAC_PI_2, FRAC_PI_2),
            UnaryFn::Cos => self.wave(f, (low, high), -PI, 0.0),
            UnaryFn::Tan => {
                let bounds = (x.unary(f, low), x.unary(f, high));
                let pole = self.meets((low, high), FRAC_PI_2, PI);
                let all = self.all();
                self.either(pole, all, bounds)
            }
            // All others rise.
            _ => (x.unary(f, low), x.unary(f, high)),
        }
    }

    /// Returns whether an interval meets `at + k * period` for a whole number k.
    fn meets(&mut self, (low, high): Pair, at: f64, period: f64) -> ExprId {
        let x = self.x();
        let (shift, per) = (x.constant(at), x.constant(1.0 / period));
        let [low, high] = [low, high].map(|e| {
            let from = x.sub(e, shift);
            x.mul(from, per)
        });
        let (first, last) = (x.unary(UnaryFn::Ceil, low), x.unary(UnaryFn::Floor, high));
        x.compare(Compare::Le, first, last)
    }

    /// A wave between -1 at `trough` and 1 at `crest`.
    fn wave(&mut self, f: UnaryFn, (low, high): Pair, trough: f64, crest: f64) -> Pair {
        let ends = [self.x().unary(f, low), self.x().unary(f, high)];
        let (least, most) = self.hull(&ends);
        let (down, up) = (self.meets((low, high), trough, TAU), self.meets((low, high), crest, TAU));
        let (minus, one) = (self.x().constant(-1.0), self.x().constant(1.0));
        (self.x().select(down, minus, least), self.x().select(up, one, most))
    }

    fn binary(&mut self, f: BinaryFn, a: ExprId, b: ExprId) -> Pair {
        let ((low_a, high_a), (low_b, high_b)) = (self.pair(a), self.pair(b));
        let x = self.x();
        match f {
            BinaryFn::Add | BinaryFn::Min | BinaryFn::Max => (x.binary(f, low_a, low_b), x.binary(f, high_a, high_b)),
            BinaryFn::Sub => (x.sub(low_a, high_b), x.sub(high_a, low_b)),
            BinaryFn::Mul if a == b => self.power(a, 2),
            BinaryFn::Mul => self.product((low_a, high_a), (low_b, high_b)),
            BinaryFn::Div => self.quotient((low_a, high_a), b),
            BinaryFn::Pow => {
                // In each operand they rise or fall.
                let all = [low_a, high_a].map(|base| [low_b, high_b].map(|exponent| x.binary(f, base, exponent)));
                self.hull(all.as_flattened())
            }
            BinaryFn::Atan2 => (x.constant(-PI), x.constant(PI)),
        }
    }

    fn product(&mut self, (low_a, high_a): Pair, (low_b, high_b): Pair) -> Pair {
        let x = self.x();
        let products = match (low_a == high_a, low_b == high_b) {
            (true, _) => vec![x.mul(low_a, low_b), x.mul(low_a, high_b)],
            (_, true) => vec![x.mul(low_a, low_b), x.mul(high_a, low_b)],
            _ => [low_a, high_a].iter().flat_map(|&a| [low_b, high_b].map(|b| x.mul(a, b))).collect(),
        };
        self.hull(&products)
    }

    fn quotient(&mut self, a: Pair, b: ExprId) -> Pair {
        let (low, high) = self.pair(b);
        let x = self.x();
        if low == high {
            let ends = [x.div(a.0, low), x.div(a.1, low)];
            return self.hull(&ends);
        }
        let (zero, one) = (x.constant(0.0), x.constant(1.0));
        let (below, above) = (x.compare(Compare::Le, low, zero), x.compare(Compare::Le, zero, high));
        let through = x.and(below, above);
        let inverse = (x.div(one, high), x.div(one, low));
        let quotient = self.product(a, inverse);
        let all = self.all();
        self.either(through, all, quotient)
    }

    fn power(&mut self, a: ExprId, n: i32) -> Pair {
        let (low, high) = self.pair(a);
        let x = self.x();
        let ends = [x.powi(low, n), x.powi(high, n)];
        if n > 0 && n % 2 != 0 {
            return (ends[0], ends[1]);
        }
        let zero = x.constant(0.0);
        let (below, above) = (x.compare(Compare::Le, low, zero), x.compare(Compare::Le, zero, high));
        let through = x.and(below, above);
        let (least, most) = self.hull(&ends);
        if n > 0 {
            return (self.x().select(through, zero, least), most);
        }
        let all = self.all();
        self.either(through, all, (least, most))
    }
}
