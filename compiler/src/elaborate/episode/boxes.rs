//! Conditions that end or cost something, and boxes.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind};

use crate::elaborate::declare::symbols::{SymbolId, SymbolKind};
use crate::elaborate::episode::Condition;
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::values::Values;
use crate::elaborate::{Elaborator, Place};
use crate::ir::{Affine, BinaryFn, Compare, ExprId, Role};
use crate::model::{BoxItem, Quantity};

impl<'a> Elaborator<'a> {
    /// A failing condition with its violation.
    pub(in crate::elaborate) fn failing(&mut self, e: &Expr, place: &Place) -> Condition {
        let zero = self.exprs.constant(0.0);
        if let ExprKind::Call { function, arguments } = &e.kind
            && function.text == "outside"
            && let [inner] = arguments.as_slice()
        {
            let (excess, items) = self.box_excess(inner, place);
            let holds = self.values().beyond(excess);
            let excess = self.exprs.select(holds, excess, zero);
            // A member that is no number is outside.
            let unknown = self.exprs.truth(false);
            return Condition { holds, unknown, excess, items };
        }
        let holds = self.condition(e, place);
        let amount = self.amount(e, place);
        let excess = match amount {
            Some(amount) => self.exprs.binary(BinaryFn::Max, amount, zero),
            None => self.exprs.constant(1.0),
        };
        let excess = self.exprs.select(holds, excess, zero);
        let unknown = self.doubting().unknown(holds);
        Condition { holds, unknown, excess, items: Vec::new() }
    }

    /// By how much a comparison holds, relative to the range of its left side.
    fn amount(&mut self, e: &Expr, place: &Place) -> Option<ExprId> {
        let ExprKind::Binary(op, a, b) = &e.kind else { return None };
        match op {
            BinaryOp::And | BinaryOp::Or => {
                let (x, y) = (self.amount(a, place)?, self.amount(b, place)?);
                let f = if *op == BinaryOp::And { BinaryFn::Min } else { BinaryFn::Max };
                Some(self.exprs.binary(f, x, y))
            }
            BinaryOp::Lt | BinaryOp::Le | BinaryOp::Gt | BinaryOp::Ge => {
                let (x, y) = (self.value(a, place), self.value(b, place));
                let (l, r) = self.values().common(&x, a.span, &y, b.span, e.span)?;
                let range = self.range_of(l).or_else(|| self.constant_value(r).map(f64::abs)).filter(|r| *r > 0.0 && r.is_finite());
                let range = self.exprs.constant(range.unwrap_or(1.0));
                let difference = if matches!(op, BinaryOp::Lt | BinaryOp::Le) { self.exprs.sub(r, l) } else { self.exprs.sub(l, r) };
                Some(self.exprs.div(difference, range))
            }
            _ => None,
        }
    }

    fn range_of(&self, e: ExprId) -> Option<f64> {
        let crate::ir::Expr::Load { var, at, .. } = self.exprs.node(e) else { return None };
        let q = self.symbols.quantities.get(&var)?;
        let i = at.offset.max(0) as usize;
        let range = Quantity::pick(&q.high, i) - Quantity::pick(&q.low, i);
        (range.is_finite() && range > 0.0).then_some(range)
    }

    /// `outside bounds(...)`, `inside bounds(...)` as a condition.
    pub(in crate::elaborate) fn box_condition(&mut self, inside: bool, a: &Expr, place: &Place) -> Value {
        let (excess, _) = self.box_excess(a, place);
        let outside = self.values().beyond(excess);
        let expr = if inside { self.exprs.not(outside) } else { outside };
        Value::truth(expr)
    }

    /// Largest excess over a box, relative to each range, and its members.
    fn box_excess(&mut self, e: &Expr, place: &Place) -> (ExprId, Vec<(BoxItem, ExprId)>) {
        let zero = self.exprs.constant(0.0);
        let arguments = match &e.kind {
            ExprKind::Call { function, arguments } if function.text == "bounds" => arguments,
            _ => {
                self.ledger
                    .report(Diagnostic::error(codes::WRONG_ARGUMENTS, "a box is needed here", e.span).help("`outside bounds(x, y)`"));
                return (zero, Vec::new());
            }
        };
        let mut members = Vec::new();
        for argument in arguments {
            self.box_members(argument, place, &mut members);
        }
        let mut excess: Option<ExprId> = None;
        for (item, value) in &members {
            let range = item.high - item.low;
            let range = self.exprs.constant(if range.is_finite() && range > 0.0 { range } else { 1.0 });
            for (bound, sign) in [(item.low, 1), (item.high, -1)] {
                if !bound.is_finite() {
                    continue;
                }
                let bound = self.exprs.constant(bound);
                let d = if sign > 0 { self.exprs.sub(bound, *value) } else { self.exprs.sub(*value, bound) };
                let d = self.exprs.div(d, range);
                excess = Some(match excess {
                    Some(e) => self.exprs.binary(BinaryFn::Max, e, d),
                    None => d,
                });
            }
        }
        (excess.unwrap_or(zero), members)
    }

    fn box_members(&mut self, e: &Expr, place: &Place, out: &mut Vec<(BoxItem, ExprId)>) {
        if let ExprKind::Name(name) = &e.kind
            && name.text == "observations"
            && self.symbols.lookup(place.scope, "observations").is_none()
        {
            out.extend(self.episode.observed_members.clone());
            return;
        }
        let symbols: Vec<SymbolId> = match &e.kind {
            ExprKind::Name(n) if n.text == "states" && self.symbols.lookup(place.scope, "states").is_none() => {
                self.state_variables().iter().filter_map(|v| self.symbols.of_var.get(v).copied()).collect()
            }
            _ => match self.target(e, place, &[Role::State, Role::Algebraic, Role::Discrete, Role::Action, Role::Disturbance]) {
                Some((symbol, Some(at))) => {
                    self.box_element(symbol, at, e.span, out);
                    return;
                }
                Some((symbol, None)) => vec![symbol],
                None => return,
            },
        };
        for symbol in symbols {
            let SymbolKind::Variable { var, .. } = self.symbols[symbol].kind else { continue };
            for i in 0..i64::from(self.symbols.vars[var].len) {
                self.box_element(symbol, Affine::constant(i), e.span, out);
            }
        }
    }

    fn box_element(&mut self, symbol: SymbolId, at: Affine, span: Span, out: &mut Vec<(BoxItem, ExprId)>) {
        let SymbolKind::Variable { var, .. } = self.symbols[symbol].kind else { return };
        let Some(q) = self.symbols.quantities.get(&var) else { return };
        let i = at.offset.max(0) as usize;
        let item =
            BoxItem { name: q.element_name(i), unit: q.unit.clone(), low: Quantity::pick(&q.low, i), high: Quantity::pick(&q.high, i) };
        if !item.low.is_finite() && !item.high.is_finite() {
            let (name, declared) = (item.name.clone(), self.symbols[symbol].span);
            self.ledger.report(
                Diagnostic::error(codes::MISSING_CLAUSE, format!("`{name}` has no bounds"), span)
                    .secondary(declared, "declared here")
                    .help("write `in low..high` in its declaration"),
            );
            return;
        }
        let value = self.load(symbol, at);
        out.push((item, value.expr));
    }
}

impl Values<'_> {
    /// Beyond the slack, or not a number.
    fn beyond(&mut self, excess: ExprId) -> ExprId {
        let slack = self.exprs.constant(1e-6);
        let inside = self.exprs.compare(Compare::Le, excess, slack);
        self.exprs.not(inside)
    }
}
