//! Boxes of declared bounds, and the variables that statements name.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind};

use crate::elaborate::lower::place::{Bound, Place};
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::values::Values;
use crate::elaborate::lower::{Lowering, indices, paths};
use crate::elaborate::symbols::{SymbolId, SymbolKind};
use crate::ir::{Affine, BinaryFn, Compare, ExprId, Role, VarId};
use crate::model::{BoxItem, Quantity};

/// `outside bounds(...)`, `inside bounds(...)` as a condition.
pub(in crate::elaborate) fn box_condition(l: &mut Lowering<'_, '_>, inside: bool, a: &Expr, place: &Place) -> Value {
    let (excess, _) = box_excess(l, a, place);
    let outside = l.values().beyond(excess);
    let expr = if inside { l.exprs.not(outside) } else { outside };
    Value::truth(expr)
}

/// Largest excess over a box, relative to each range, and its members.
pub(in crate::elaborate) fn box_excess(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> (ExprId, Vec<(BoxItem, ExprId)>) {
    let zero = l.exprs.constant(0.0);
    let arguments = match &e.kind {
        ExprKind::Call { function, arguments } if function.text == "bounds" => arguments,
        _ => {
            l.ledger.report(Diagnostic::error(codes::WRONG_ARGUMENTS, "a box is needed here", e.span).help("`outside bounds(x, y)`"));
            return (zero, Vec::new());
        }
    };
    let mut members = Vec::new();
    for argument in arguments {
        box_members(l, argument, place, &mut members);
    }
    let mut excess: Option<ExprId> = None;
    for (item, value) in &members {
        let range = item.high - item.low;
        let range = l.exprs.constant(if range.is_finite() && range > 0.0 { range } else { 1.0 });
        for (bound, sign) in [(item.low, 1), (item.high, -1)] {
            if !bound.is_finite() {
                continue;
            }
            let bound = l.exprs.constant(bound);
            let d = if sign > 0 { l.exprs.sub(bound, *value) } else { l.exprs.sub(*value, bound) };
            let d = l.exprs.div(d, range);
            excess = Some(match excess {
                Some(e) => l.exprs.binary(BinaryFn::Max, e, d),
                None => d,
            });
        }
    }
    (excess.unwrap_or(zero), members)
}

fn box_members(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place, out: &mut Vec<(BoxItem, ExprId)>) {
    if let ExprKind::Name(name) = &e.kind
        && name.text == "observations"
        && l.symbols.lookup(place.scope, "observations").is_none()
    {
        out.extend(l.names.observed.clone());
        return;
    }
    let symbols: Vec<SymbolId> = match &e.kind {
        ExprKind::Name(n) if n.text == "states" && l.symbols.lookup(place.scope, "states").is_none() => {
            l.state_variables().iter().filter_map(|v| l.symbols.of_var.get(v).copied()).collect()
        }
        _ => match target(l, e, place, &[Role::State, Role::Algebraic, Role::Discrete, Role::Action, Role::Disturbance]) {
            Some((symbol, Some(at))) => {
                box_element(l, symbol, at, e.span, out);
                return;
            }
            Some((symbol, None)) => vec![symbol],
            None => return,
        },
    };
    for symbol in symbols {
        let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind else { continue };
        for i in 0..i64::from(l.symbols.vars[var].len) {
            box_element(l, symbol, Affine::constant(i), e.span, out);
        }
    }
}

fn box_element(l: &mut Lowering<'_, '_>, symbol: SymbolId, at: Affine, span: Span, out: &mut Vec<(BoxItem, ExprId)>) {
    let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind else { return };
    let Some(q) = l.quantities.get(&var) else { return };
    let i = at.offset.max(0) as usize;
    let item = BoxItem { name: q.element_name(i), unit: q.unit.clone(), low: Quantity::pick(&q.low, i), high: Quantity::pick(&q.high, i) };
    if !item.low.is_finite() && !item.high.is_finite() {
        let (name, declared) = (item.name.clone(), l.symbols[symbol].span);
        l.ledger.report(
            Diagnostic::error(codes::MISSING_CLAUSE, format!("`{name}` has no bounds"), span)
                .secondary(declared, "declared here")
                .help("write `in low..high` in its declaration"),
        );
        return;
    }
    let value = l.load(symbol, at);
    out.push((item, value.expr));
}

/// Reports a variable of a role that a statement does not assign.
fn refuse_target(l: &mut Lowering<'_, '_>, symbol: SymbolId, var: VarId, span: Span, roles: &[Role]) {
    let (path, declared) = (l.symbols[symbol].path.clone(), l.symbols[symbol].span);
    let what = match l.symbols.vars[var].role {
        Role::Param => "a parameter",
        Role::Action => "an action",
        Role::Algebraic => "an algebraic variable",
        Role::State => "a state",
        Role::Discrete => "a discrete variable",
        Role::Disturbance => "a disturbance",
        _ => "a variable of another kind",
    };
    let help = match (l.symbols.vars[var].role, roles) {
        (Role::State, [Role::Discrete]) => Some("states are set by `reset`".to_owned()),
        (Role::Discrete, [Role::State]) => Some("discrete variables are set by `next`".to_owned()),
        _ => None,
    };
    l.ledger.report(
        Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is {what}, which cannot be set here"), span)
            .secondary(declared, "declared here")
            .maybe_help(help),
    );
}

/// The variable that a statement assigns: a symbol, and the element unless the whole array is meant.
pub(in crate::elaborate) fn target(
    l: &mut Lowering<'_, '_>,
    e: &Expr,
    place: &Place,
    roles: &[Role],
) -> Option<(SymbolId, Option<Affine>)> {
    if let ExprKind::Name(name) = &e.kind
        && let Some(Bound::Element(symbol, at)) = place.bound(&name.text)
    {
        return Some((*symbol, Some(*at)));
    }
    let (base, index): (&Expr, &[Expr]) = match &e.kind {
        ExprKind::Index(base, index) => (base, index),
        _ => (e, &[]),
    };
    let symbol = match paths::resolve(l, base, place) {
        crate::elaborate::lower::place::Target::Symbol(symbol) => symbol,
        crate::elaborate::lower::place::Target::Value(v) => {
            if !v.is_poison() {
                l.ledger.report(Diagnostic::error(codes::WRONG_KIND, "a variable is needed here", e.span));
            }
            return None;
        }
        crate::elaborate::lower::place::Target::Nothing => return None,
    };
    let SymbolKind::Variable { var, axes, .. } = l.symbols[symbol].kind.clone() else {
        if !matches!(l.symbols[symbol].kind, SymbolKind::Faulty) {
            let path = l.symbols[symbol].path.clone();
            l.ledger.report(Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is no variable that can be assigned"), e.span));
        }
        return None;
    };
    if !roles.contains(&l.symbols.vars[var].role) {
        refuse_target(l, symbol, var, e.span, roles);
        return None;
    }
    if index.is_empty() && !axes.is_empty() {
        return Some((symbol, None));
    }
    let (at, _) = indices::address(l, symbol, &axes, index, e.span, place)?;
    Some((symbol, Some(at)))
}

impl Values<'_> {
    /// Beyond the slack, or not a number.
    pub(in crate::elaborate) fn beyond(&mut self, excess: ExprId) -> ExprId {
        let slack = self.exprs.constant(1e-6);
        let inside = self.exprs.compare(Compare::Le, excess, slack);
        self.exprs.not(inside)
    }
}
