//! Undefined conditions: neither true nor false, because a compared value is not a number.
//!
//! Logic of three values: `false and unknown` is false, `true or unknown` is true, a choice by an
//! unknown condition is unknown. So a guard keeps its meaning: `x > 0 and ln(x) > 3` is false at x
//! = -1.

use crate::elaborate::lower::Lowering;
use crate::elaborate::symbols::Symbols;
use crate::ir::{BinaryFn, Compare, Expr as Node, ExprId, Exprs, FastMap, Flavour, ReduceFn, Role, UnaryFn};

/// Properties of a node.
#[derive(Clone, Copy)]
struct Doubt {
    /// It may be NaN: of states, actions and times the runtime knows that they are not.
    nan: bool,
    /// Dependence on an unknown condition.
    unknown: ExprId,
}

type Doubts = FastMap<ExprId, Doubt>;

/// Data for the search.
pub(in crate::elaborate) struct Doubting<'d, 'a> {
    exprs: &'d mut Exprs,
    symbols: &'d Symbols<'a>,
}

/// Data for the search of unknown conditions.
pub(in crate::elaborate) fn doubting<'d, 'a>(l: &'d mut Lowering<'_, 'a>) -> Doubting<'d, 'a> {
    Doubting { exprs: l.exprs, symbols: l.symbols }
}

impl Doubting<'_, '_> {
    /// Condition under which a condition is unknown; the constant `false` for almost all.
    pub(in crate::elaborate) fn unknown(&mut self, condition: ExprId) -> ExprId {
        let nodes = self.exprs.below_in_order([condition]);
        let mut doubts = Doubts::default();
        for e in nodes {
            let doubt = self.doubt(e, &doubts);
            doubts.insert(e, doubt);
        }
        doubts[&condition].unknown
    }

    /// Condition under which a value is a number; `None` if it always is.
    pub(in crate::elaborate) fn number(&mut self, value: ExprId) -> Option<ExprId> {
        let mut doubts = Doubts::default();
        for e in self.exprs.below_in_order([value]) {
            let doubt = self.doubt(e, &doubts);
            doubts.insert(e, doubt);
        }
        doubts[&value].nan.then(|| self.exprs.compare(Compare::Eq, value, value))
    }

    fn doubt(&mut self, e: ExprId, doubts: &Doubts) -> Doubt {
        let nan = self.may_be_nan(e, doubts);
        let of = |e: ExprId| doubts[&e].unknown;
        let unknown = match self.exprs.node(e) {
            Node::And(a, b) => self.unknown_pair((a, of(a)), (b, of(b)), true),
            Node::Or(a, b) => self.unknown_pair((a, of(a)), (b, of(b)), false),
            Node::Compare(op, a, b) => self.unknown_comparison(e, (op, a, b), doubts),
            Node::Select(c, a, b) => {
                let chosen = self.exprs.select(c, of(a), of(b));
                self.exprs.or(of(c), chosen)
            }
            Node::Reduce { depth, extent, body, .. } => {
                let number = self.exprs.number(of(body));
                self.exists(ReduceFn::Max, depth, extent, number)
            }
            _ => {
                let operands: Vec<ExprId> = self.exprs.operands(e).collect();
                let none = self.exprs.truth(false);
                operands.into_iter().fold(none, |sum, o| self.exprs.or(sum, of(o)))
            }
        };
        Doubt { nan, unknown }
    }

    fn may_be_nan(&self, e: ExprId, doubts: &Doubts) -> bool {
        let of = |e: ExprId| doubts[&e].nan;
        match self.exprs.node(e) {
            Node::Const(bits) => f64::from_bits(bits).is_nan(),
            Node::Load { var, flavour, .. } => match self.symbols.vars[var].role {
                Role::State => flavour == Flavour::Derivative,
                Role::Param | Role::Action | Role::Discrete | Role::Draw | Role::Builtin => false,
                _ => true,
            },
            Node::Unary(UnaryFn::Sqrt | UnaryFn::Ln | UnaryFn::Log10 | UnaryFn::Asin | UnaryFn::Acos, _) => true,
            Node::Binary(BinaryFn::Pow, ..) => true,
            Node::Binary(BinaryFn::Div, a, b) => of(a) || self.exprs.as_const(b).is_none_or(|b| b == 0.0),
            Node::PowInt(a, n) => of(a) || n < 0,
            _ => self.exprs.operands(e).any(of),
        }
    }

    /// Returns `true` if one of the passes of a loop gives more than 0.
    fn exists(&mut self, op: ReduceFn, depth: crate::ir::LoopVar, extent: u32, number: ExprId) -> ExprId {
        if self.exprs.as_const(number) == Some(0.0) {
            return self.exprs.truth(false);
        }
        let (zero, most) = (self.exprs.constant(0.0), self.exprs.reduce(op, depth, extent, number));
        self.exprs.compare(Compare::Lt, zero, most)
    }

    /// Conjunction or disjunction: unknown if one side is, and the other does not decide.
    fn unknown_pair(&mut self, (a, of_a): (ExprId, ExprId), (b, of_b): (ExprId, ExprId), conjunction: bool) -> ExprId {
        let mut unknown = self.exprs.or(of_a, of_b);
        for (holds, own) in [(a, of_a), (b, of_b)] {
            let undecided = if conjunction { holds } else { self.exprs.not(holds) };
            let open = self.exprs.or(undecided, own);
            unknown = self.exprs.and(unknown, open);
        }
        unknown
    }

    /// A comparison: unknown if one side is not a number, or depends on something unknown. `any`
    /// and `all` over cells are comparisons, too.
    fn unknown_comparison(&mut self, e: ExprId, (op, a, b): (Compare, ExprId, ExprId), doubts: &Doubts) -> ExprId {
        let mut unknown = self.exprs.or(doubts[&a].unknown, doubts[&b].unknown);
        for side in [a, b].into_iter().filter(|side| doubts[side].nan) {
            let number = self.exprs.compare(Compare::Eq, side, side);
            let none = self.exprs.not(number);
            unknown = self.exprs.or(unknown, none);
        }
        let (Compare::Lt, Some(0.0), Node::Reduce { op, depth, extent, body }) = (op, self.exprs.as_const(a), self.exprs.node(b)) else {
            return unknown;
        };
        let decided = match (op, self.exprs.node(body)) {
            (ReduceFn::Max, Node::Select(..)) => e,
            (ReduceFn::Min, Node::Select(c, ..)) => {
                let known = self.exprs.not(doubts[&c].unknown);
                let fails = self.exprs.not(c);
                let fails = self.exprs.and(fails, known);
                let number = self.exprs.number(fails);
                self.exists(ReduceFn::Max, depth, extent, number)
            }
            _ => return unknown,
        };
        let open = self.exprs.not(decided);
        self.exprs.and(unknown, open)
    }
}
