//! Boxes of declared bounds, and the variables that statements name.

use std::ops::Range;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Declaration, Expr, ExprKind};

use crate::elaborate::lower::bounded::Bounded;
use crate::elaborate::lower::loops::{Cell, Piece};
use crate::elaborate::lower::place::{Bound, Place};
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::values::Values;
use crate::elaborate::lower::{Lowering, indices, paths};
use crate::elaborate::symbols::{SymbolId, SymbolKind};
use crate::ir::{Affine, BinaryFn, Compare, ExprId, Exprs, LoopVar, ReduceFn, Role, VarId};
use crate::model::{BoxItem, Quantity};

/// `outside bounds(...)`, `inside bounds(...)` as a condition.
pub(in crate::elaborate) fn box_condition(l: &mut Lowering<'_, '_>, inside: bool, a: &Expr, place: &Place) -> Value {
    let (excess, _) = box_excess(l, a, place);
    let outside = l.values().beyond(excess);
    let expr = if inside { l.exprs.not(outside) } else { outside };
    Value::truth(expr)
}

/// Largest excess over a box, relative to each range, and its members.
pub(in crate::elaborate) fn box_excess(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> (ExprId, Vec<Bounded>) {
    let arguments = match &e.kind {
        ExprKind::Call { function, arguments } if function.text == "bounds" => arguments,
        _ => {
            l.ledger.report(Diagnostic::error(codes::WRONG_ARGUMENTS, "a box is needed here", e.span).help("`outside bounds(x, y)`"));
            return (l.exprs.constant(0.0), Vec::new());
        }
    };
    let mut members = Vec::new();
    for argument in arguments {
        box_members(l, argument, place, &mut members);
    }
    let mut excess = None;
    for member in &members {
        excess = largest_excess(l.exprs, member, place.depth, excess);
    }
    (excess.unwrap_or_else(|| l.exprs.constant(0.0)), members)
}

/// The larger one of what there is and the excesses of a member, whose loops count from a depth on.
fn largest_excess(exprs: &mut Exprs, member: &Bounded, depth: u8, mut excess: Option<ExprId>) -> Option<ExprId> {
    let width = |item: &BoxItem| item.high - item.low;
    let range = |item: &BoxItem| if width(item).is_finite() && width(item) > 0.0 { width(item) } else { 1.0 };
    let ranges: Vec<f64> = member.items.iter().map(range).collect();
    let lows: Vec<f64> = member.items.iter().map(|item| item.low).collect();
    let highs: Vec<f64> = member.items.iter().map(|item| item.high).collect();
    for Piece { extents, value: (at, value) } in &member.pieces {
        let mut own = excess.take_if(|_| extents.is_empty());
        for (bounds, is_low) in [(&lows, true), (&highs, false)] {
            if !bounds.iter().any(|bound| bound.is_finite()) {
                continue;
            }
            let (bound, range) = (exprs.entry_at(bounds, *at), exprs.entry_at(&ranges, *at));
            let beyond = if is_low { exprs.sub(bound, *value) } else { exprs.sub(*value, bound) };
            let beyond = exprs.div(beyond, range);
            own = larger(exprs, own, beyond);
        }
        let Some(mut own) = own else { continue };
        for (inner, &extent) in extents.iter().enumerate().rev() {
            own = exprs.reduce(ReduceFn::Max, LoopVar(depth + inner as u8), extent, own);
        }
        excess = larger(exprs, excess, own);
    }
    excess
}

/// The larger one of what there is and a number.
fn larger(exprs: &mut Exprs, a: Option<ExprId>, b: ExprId) -> Option<ExprId> {
    Some(a.map_or(b, |a| exprs.binary(BinaryFn::Max, a, b)))
}

fn box_members(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place, out: &mut Vec<Bounded>) {
    if let ExprKind::Name(name) = &e.kind
        && name.text == "observations"
        && l.symbols.lookup(place.scope, "observations").is_none()
    {
        return observed_members(l, e.span, place, out);
    }
    if let Some((list, scope)) = l.symbols.tuple(e, place) {
        let there = Place { scope, bindings: None, ..place.clone() };
        return list.iter().for_each(|e| box_members(l, e, &there, out));
    }
    let symbols: Vec<SymbolId> = match &e.kind {
        ExprKind::Name(n) if n.text == "states" && l.symbols.lookup(place.scope, "states").is_none() => {
            l.variables_of(Role::State).iter().filter_map(|v| l.symbols.of_var.get(v).copied()).collect()
        }
        _ => match target(l, e, place, &[Role::State, Role::Algebraic, Role::Discrete, Role::Action, Role::Disturbance]) {
            Some((symbol, Some(at))) => {
                out.extend(bounded_element(l, symbol, at, e.span));
                return;
            }
            Some((symbol, None)) => vec![symbol],
            None => return,
        },
    };
    for symbol in symbols {
        out.extend(bounded_array(l, symbol, e.span, place));
    }
}

/// Observed quantity; its loops are not inside others.
fn observed_members(l: &mut Lowering<'_, '_>, span: Span, place: &Place, out: &mut Vec<Bounded>) {
    if place.depth > 0 && l.names.observed.iter().any(Bounded::has_loops) {
        let fault = Diagnostic::error(codes::WRONG_SHAPE, "the box of observed arrays inside of a loop", span);
        l.ledger.report(fault.help("it does not depend on the index: move the condition outside"));
        return;
    }
    out.extend(l.names.observed.clone());
}

/// An element of a variable, which may depend on loops around; where all have the same bounds,
/// those of one will do.
fn bounded_element(l: &mut Lowering<'_, '_>, symbol: SymbolId, at: Affine, span: Span) -> Option<Bounded> {
    let q = l.quantities.get(&variable(l, symbol)?)?;
    let bounds = q.low.len().max(q.high.len()) as i64;
    let differs = !at.is_constant() && bounds > 1;
    let elements = if differs { 0..bounds } else { at.offset..at.offset + 1 };
    let items = box_items(l, symbol, elements, span)?;
    let value = l.load(symbol, at).expr;
    let at = if differs { at } else { Affine::default() };
    Some(Bounded { items, pieces: vec![Piece { extents: Vec::new(), value: (at, value) }] })
}

/// All elements of a variable, in a loop.
fn bounded_array(l: &mut Lowering<'_, '_>, symbol: SymbolId, span: Span, place: &Place) -> Option<Bounded> {
    let len = i64::from(l.symbols.vars[variable(l, symbol)?].len);
    let items = box_items(l, symbol, 0..len, span)?;
    let cells = l.cells(0, len - 1, span, place, &mut |s, cell, _| (cell.affine(), s.load(symbol, cell.affine()).expr));
    let piece = |(cell, value): (Cell, _)| Piece { extents: cell.along.map(|_| cell.count as u32).into_iter().collect(), value };
    Some(Bounded { items, pieces: cells.into_iter().map(piece).collect() })
}

fn variable(l: &Lowering<'_, '_>, symbol: SymbolId) -> Option<VarId> {
    if let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind { Some(var) } else { None }
}

/// Names and bounds of elements of a variable; one without bounds is reported.
fn box_items(l: &mut Lowering<'_, '_>, symbol: SymbolId, elements: Range<i64>, span: Span) -> Option<Vec<BoxItem>> {
    if !l.ledger.may_name((elements.end - elements.start) as usize, span) {
        return None;
    }
    let q = l.quantities.get(&variable(l, symbol)?)?;
    let item =
        |i| BoxItem { name: q.element_name(i), unit: q.unit.clone(), low: Quantity::pick(&q.low, i), high: Quantity::pick(&q.high, i) };
    let items: Vec<BoxItem> = elements.map(|i| item(i.max(0) as usize)).collect();
    let Some(open) = items.iter().find(|item| !item.low.is_finite() && !item.high.is_finite()) else { return Some(items) };
    let declared = l.symbols[symbol].span;
    l.ledger.report(
        Diagnostic::error(codes::MISSING_CLAUSE, format!("`{}` has no bounds", open.name), span)
            .secondary(declared, "declared here")
            .help("write `in low..high` in its declaration"),
    );
    None
}

/// Reports a variable of a role that a statement does not assign.
fn refuse_target(l: &mut Lowering<'_, '_>, symbol: SymbolId, var: VarId, span: Span, roles: &[Role]) {
    let (path, declared) = (l.symbols[symbol].path.clone(), l.symbols[symbol].span);
    if let SymbolKind::Variable { declaration: Declaration { measured: Some(measured), .. }, .. } = &l.symbols[symbol].kind {
        let message = format!("`{path}` follows `{}`, and cannot be set here", measured.path);
        let help = format!("a scenario names other data: `disturbances: {{{path}: {{from: other.csv}}}}`");
        l.ledger.report(Diagnostic::error(codes::WRONG_KIND, message, span).secondary(declared, "declared here").help(help));
        return;
    }
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
        (Role::State, [Role::Discrete]) => Some(format!("a state is set by `reset {path} = ...`; `next` sets discrete variables")),
        (Role::Discrete, [Role::State]) => Some(format!("a discrete variable is set by `next {path} = ...`; `reset` sets states")),
        (Role::Action, [Role::Discrete]) => Some(format!("actions come from outside; declare `discrete {path}` for what the model sets")),
        (Role::Algebraic, _) => Some(format!("its equation determines it; `var {path} = value` gives the initial guess")),
        _ => None,
    };
    l.ledger.report(
        Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is {what}, which cannot be set here"), span)
            .secondary(declared, "declared here")
            .maybe_help(help),
    );
}

/// The variable that a statement assigns: a symbol, and the element unless it is the whole array.
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
            l.ledger.report(Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is not a variable that can be assigned"), e.span));
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
