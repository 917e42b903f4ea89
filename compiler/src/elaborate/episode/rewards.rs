//! Rewards that pay for going away and coming back.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;

use crate::elaborate::Elaborator;
use crate::elaborate::lower::values::Values;
use crate::ir::{BinaryFn, Expr, ExprId, Flavour, Role, UnaryFn};

impl Elaborator<'_> {
    /// Warns where a reward limits a change over a step on one side only: what an episode loses at once is limited, and what it gains back is
    /// not. The change of a limited value sums up to its end less its start.
    pub(in crate::elaborate) fn check_limits(&mut self, name: &str, reward: ExprId, span: Span) {
        if self.limits_one_side(reward) {
            let message = format!("the reward `{name}` limits a change on one side only");
            let warning = Diagnostic::warning(codes::ONE_SIDED_LIMIT, message, span);
            self.ledger.report(warning.help("an episode that goes far and comes back is paid without end: write `max(low, d) - previous(max(low, d))`, or limit both sides by `clip`"));
        }
    }

    /// Whether a term of a sum is a limited difference, with a sign that pays.
    fn limits_one_side(&mut self, reward: ExprId) -> bool {
        let mut terms = vec![(reward, true)];
        while let Some((e, adds)) = terms.pop() {
            match self.exprs.node(e) {
                Expr::Unary(UnaryFn::Neg, a) => terms.push((a, !adds)),
                Expr::Binary(BinaryFn::Add, a, b) => terms.extend([(a, adds), (b, adds)]),
                Expr::Binary(BinaryFn::Sub, a, b) => terms.extend([(a, adds), (b, !adds)]),
                Expr::Binary(BinaryFn::Mul | BinaryFn::Div, a, b) => {
                    terms.extend(self.values().scaled(a, b).map(|(e, sign)| (e, adds == sign)))
                }
                // A cost of a change in one direction only is a usual one.
                Expr::Binary(BinaryFn::Max, a, b) if adds && self.limits(a, b) => return true,
                Expr::Binary(BinaryFn::Min, a, b) if self.limits(a, b) => return true,
                _ => {}
            }
        }
        false
    }

    /// Whether one of two is a change over a step, and the other one does not change.
    fn limits(&self, a: ExprId, b: ExprId) -> bool {
        let fixed = |e| self.instants(e) == (false, false);
        let change = |e| match self.exprs.node(e) {
            Expr::Binary(BinaryFn::Sub, a, b) => {
                let (a, b) = (self.instants(a), self.instants(b));
                (a == (true, false) && b == (false, true)) || (a == (false, true) && b == (true, false))
            }
            _ => false,
        };
        (fixed(a) && change(b)) || (change(a) && fixed(b))
    }

    /// Whether an expression reads present values of what changes, and values of the step before.
    fn instants(&self, e: ExprId) -> (bool, bool) {
        let (mut todo, mut seen) = (vec![e], std::collections::HashSet::new());
        let mut found = (false, false);
        while let Some(e) = todo.pop() {
            if !seen.insert(e) {
                continue;
            }
            match self.exprs.node(e) {
                Expr::Load { flavour: Flavour::Previous, .. } => found.1 = true,
                Expr::Load { flavour: Flavour::Value | Flavour::Derivative, var, .. } => {
                    found.0 |= self.symbols.vars[var].role != Role::Param
                }
                Expr::Time => found.0 = true,
                _ => {}
            }
            todo.extend(self.exprs.operands(e));
        }
        found
    }
}

impl Values<'_> {
    /// The factor beside a number, and whether the number is positive.
    fn scaled(&self, a: ExprId, b: ExprId) -> Option<(ExprId, bool)> {
        match (self.exprs.node(a), self.exprs.node(b)) {
            (Expr::Const(bits), _) => Some((b, f64::from_bits(bits) > 0.0)),
            (_, Expr::Const(bits)) => Some((a, f64::from_bits(bits) > 0.0)),
            _ => None,
        }
    }
}
