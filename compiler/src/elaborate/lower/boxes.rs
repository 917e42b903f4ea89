//! Boxes of declared bounds, and the variables that statements name.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind};

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::place::{Bound, Place};
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::values::Values;
use crate::elaborate::symbols::{SymbolId, SymbolKind};
use crate::ir::{Affine, BinaryFn, Compare, ExprId, Role, VarId};
use crate::model::{BoxItem, Quantity};

impl Lowering<'_, '_> {
    /// `outside bounds(...)`, `inside bounds(...)` as a condition.
    pub(in crate::elaborate) fn box_condition(&mut self, inside: bool, a: &Expr, place: &Place) -> Value {
        let (excess, _) = self.box_excess(a, place);
        let outside = self.values().beyond(excess);
        let expr = if inside { self.exprs.not(outside) } else { outside };
        Value::truth(expr)
    }

    /// Largest excess over a box, relative to each range, and its members.
    pub(in crate::elaborate) fn box_excess(&mut self, e: &Expr, place: &Place) -> (ExprId, Vec<(BoxItem, ExprId)>) {
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
            out.extend(self.names.observed.clone());
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
        let Some(q) = self.quantities.get(&var) else { return };
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

    /// Reports a variable of a role that a statement does not assign.
    fn refuse_target(&mut self, symbol: SymbolId, var: VarId, span: Span, roles: &[Role]) {
        let (path, declared) = (self.symbols[symbol].path.clone(), self.symbols[symbol].span);
        let what = match self.symbols.vars[var].role {
            Role::Param => "a parameter",
            Role::Action => "an action",
            Role::Algebraic => "an algebraic variable",
            Role::State => "a state",
            Role::Discrete => "a discrete variable",
            Role::Disturbance => "a disturbance",
            _ => "a variable of another kind",
        };
        let help = match (self.symbols.vars[var].role, roles) {
            (Role::State, [Role::Discrete]) => Some("states are set by `reset`".to_owned()),
            (Role::Discrete, [Role::State]) => Some("discrete variables are set by `next`".to_owned()),
            _ => None,
        };
        self.ledger.report(
            Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is {what}, which cannot be set here"), span)
                .secondary(declared, "declared here")
                .maybe_help(help),
        );
    }

    /// The variable that a statement assigns: a symbol, and the element unless the whole array is meant.
    pub(in crate::elaborate) fn target(&mut self, e: &Expr, place: &Place, roles: &[Role]) -> Option<(SymbolId, Option<Affine>)> {
        if let ExprKind::Name(name) = &e.kind
            && let Some(Bound::Element(symbol, at)) = place.bound(&name.text)
        {
            return Some((*symbol, Some(*at)));
        }
        let (base, index): (&Expr, &[Expr]) = match &e.kind {
            ExprKind::Index(base, index) => (base, index),
            _ => (e, &[]),
        };
        let symbol = match self.resolve(base, place) {
            crate::elaborate::lower::place::Target::Symbol(symbol) => symbol,
            crate::elaborate::lower::place::Target::Value(v) => {
                if !v.is_poison() {
                    self.ledger.report(Diagnostic::error(codes::WRONG_KIND, "a variable is needed here", e.span));
                }
                return None;
            }
            crate::elaborate::lower::place::Target::Nothing => return None,
        };
        let SymbolKind::Variable { var, axes, .. } = self.symbols[symbol].kind.clone() else {
            if !matches!(self.symbols[symbol].kind, SymbolKind::Faulty) {
                let path = self.symbols[symbol].path.clone();
                self.ledger.report(Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is no variable that can be assigned"), e.span));
            }
            return None;
        };
        if !roles.contains(&self.symbols.vars[var].role) {
            self.refuse_target(symbol, var, e.span, roles);
            return None;
        }
        if index.is_empty() && !axes.is_empty() {
            return Some((symbol, None));
        }
        let (at, _) = self.address(symbol, &axes, index, e.span, place)?;
        Some((symbol, Some(at)))
    }
}

impl Values<'_> {
    /// Beyond the slack, or not a number.
    pub(in crate::elaborate) fn beyond(&mut self, excess: ExprId) -> ExprId {
        let slack = self.exprs.constant(1e-6);
        let inside = self.exprs.compare(Compare::Le, excess, slack);
        self.exprs.not(inside)
    }
}
