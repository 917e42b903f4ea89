//! Observations of whole arrays, whose loops stay loops.

use rustc_hash::FxHashSet;
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind, Observation};
use smpl_dsl::units::Unit;

use crate::elaborate::episode::observed::{Attributes, Observations, attributes, warn_of_missing_bounds};
use crate::elaborate::episode::outputs::{let_pieces, let_quantity};
use crate::elaborate::episode::positions::state_positions;
use crate::elaborate::lower::bounded::Bounded;
use crate::elaborate::lower::loops::Piece;
use crate::elaborate::lower::place::{Place, Target};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, paths, units};
use crate::elaborate::symbols::{SymbolId, SymbolKind};
use crate::ir::{Affine, ExprId, Flavour, LoopVar, VarId};
use crate::model::{BoxItem, Observed, Quantity};

/// An array as it is observed: what its elements are called, and their values.
struct Array {
    quantity: Quantity,
    pieces: Vec<Piece<(Affine, Value)>>,
    len: usize,
}

/// The array that a bare name means.
pub(super) fn whole_array(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Option<SymbolId> {
    if !matches!(e.kind, ExprKind::Name(_) | ExprKind::Member(..)) {
        return None;
    }
    if let ExprKind::Name(n) = &e.kind
        && (place.bound(&n.text).is_some() || l.symbols.lookup(place.scope, &n.text).is_none())
    {
        return None;
    }
    let Target::Symbol(symbol) = paths::resolve(l, e, place) else { return None };
    match &l.symbols[symbol].kind {
        SymbolKind::Variable { axes, .. } | SymbolKind::Let { axes, .. } if !axes.is_empty() => Some(symbol),
        _ => None,
    }
}

/// All elements of an array in the order of storage.
pub(super) fn observe_array(l: &mut Lowering<'_, '_>, o: &Observation, symbol: SymbolId, place: &Place, out: &mut Observations) {
    let Some(Array { quantity, pieces, len }) = array(l, o, symbol, place) else { return };
    if !l.ledger.may_name(len, o.span) {
        return;
    }
    let Some(unit) = unit_of(l, o, &pieces, place) else { return };
    let a = attributes(l, o, &unit, place);
    let mut converted = false;
    let pieces: Vec<Piece<(Affine, ExprId)>> = pieces
        .into_iter()
        .map(|Piece { extents, value: (at, v) }| {
            let expr = v.expr;
            let value = if matches!(v.unit, Measure::Bare) {
                expr
            } else {
                l.values().strictly_in(v, &unit, o.value.span, "the observation", o.span)
            };
            converted |= value != expr;
            Piece { extents, value: (at, value) }
        })
        .collect();
    let open = [f64::NEG_INFINITY];
    let (low, high) = if converted { (&open[..], &[f64::INFINITY][..]) } else { (&quantity.low[..], &quantity.high[..]) };
    let own = |i| (Quantity::pick(low, i), Quantity::pick(high, i));
    let names: Vec<Observed> = (0..len).map(|i| a.observed(quantity.element_name(i), unit.to_string(), own(i))).collect();
    if names.iter().any(|observed| !observed.low.is_finite() && !observed.high.is_finite()) {
        warn_of_missing_bounds(l, &quantity.name, o);
    }
    store_array(names, pieces, out);
}

/// An array that is observed under its own name or another one.
fn array(l: &mut Lowering<'_, '_>, o: &Observation, symbol: SymbolId, place: &Place) -> Option<Array> {
    let (mut quantity, pieces, len) = match l.symbols[symbol].kind.clone() {
        SymbolKind::Variable { var, unit, .. } => {
            let Piece { extents, value: (at, expr) } = whole(l, var);
            (l.quantities.get(&var)?.clone(), vec![Piece { extents, value: (at, Value::of(expr, unit)) }], l.symbols.vars[var].len as usize)
        }
        SymbolKind::Let { axes, unit, declaration, .. } => {
            let pieces = let_pieces(l, symbol, &axes, declaration);
            let len = axes.iter().map(|&axis| l.symbols.axis_len(axis)).product::<i64>();
            (let_quantity(l, symbol, &axes, &unit.unwrap_or_else(Unit::one), declaration), pieces, len as usize)
        }
        _ => return None,
    };
    if let Some(name) = &o.name {
        quantity.name = format!("{}{}", l.symbols.scopes[place.scope].prefix, name.text);
        quantity.pattern = None;
    }
    // Its other properties have no meaning yet.
    let poisoned = pieces.is_empty() || pieces.iter().any(|piece| piece.value.1.is_poison());
    (!poisoned).then_some(Array { quantity, pieces, len })
}

/// The unit that is asked for, else that of the elements.
fn unit_of(l: &mut Lowering<'_, '_>, o: &Observation, pieces: &[Piece<(Affine, Value)>], place: &Place) -> Option<Unit> {
    match &o.unit {
        Some(unit) => units::unit(l, unit, place),
        None => pieces.first().map(|piece| units::shown(&piece.value.1.unit)),
    }
}

/// The values of a variable.
fn whole(l: &mut Lowering<'_, '_>, var: VarId) -> Piece<(Affine, ExprId)> {
    let len = l.symbols.vars[var].len;
    let (extents, at) = if len == 1 { (Vec::new(), Affine::default()) } else { (vec![len], Affine::along(0, LoopVar(0), 1)) };
    let value = l.exprs.load(var, Flavour::Value, at);
    Piece { extents, value: (at, value) }
}

fn store_array(names: Vec<Observed>, pieces: Vec<Piece<(Affine, ExprId)>>, out: &mut Observations) {
    let base = Affine::constant(out.names.len() as i64);
    for Piece { extents, value: (at, value) } in &pieces {
        out.store(extents.clone(), base.plus(*at), *value);
    }
    out.bounded.extend(bounded(names.iter().map(Observed::item).collect(), pieces));
    out.names.extend(names);
}

/// A member of the box of the observations, if it has bounds.
fn bounded(items: Vec<BoxItem>, pieces: Vec<Piece<(Affine, ExprId)>>) -> Option<Bounded> {
    items.iter().any(|item| item.low.is_finite() || item.high.is_finite()).then_some(Bounded { items, pieces })
}

/// Every state, in declaration order; by a statement, or by the level `full`.
pub(super) fn observe_states(l: &mut Lowering<'_, '_>, span: Option<Span>, out: &mut Observations) {
    let base = out.names.len();
    let order = state_positions(l);
    let total: usize = order.iter().map(|(_, list)| list.len()).sum();
    if !l.ledger.may_name(total, span.unwrap_or_default()) {
        return;
    }
    let mut names: Vec<Option<Observed>> = vec![None; total];
    // A state that is observed already, perhaps with noise or a delay, is distinct from that
    // observation.
    let taken: FxHashSet<String> = out.names.iter().map(|o| o.name.clone()).collect();
    let named = |name: String| if taken.contains(&name) { format!("state.{name}") } else { name };
    for (var, positions) in order {
        let Some(q) = l.quantities.get(&var).cloned() else { continue };
        let own = |i| (Quantity::pick(&q.low, i), Quantity::pick(&q.high, i));
        let observed = |i| Attributes::NONE.observed(named(q.element_name(i)), q.unit.clone(), own(i));
        let states: Vec<Observed> = (0..positions.len()).map(observed).collect();
        store_states(l, var, base, &positions, out);
        let elements = whole(l, var);
        out.bounded.extend(bounded(states.iter().map(Observed::item).collect(), vec![elements]));
        states.into_iter().zip(positions).for_each(|(state, p)| names[p as usize] = Some(state));
    }
    out.names.extend(names.into_iter().flatten());
}

/// Stores the elements of a variable to their places among the states.
fn store_states(l: &mut Lowering<'_, '_>, var: VarId, base: usize, positions: &[u32], out: &mut Observations) {
    let slots: Vec<i64> = positions.iter().map(|&p| base as i64 + i64::from(p)).collect();
    let step = slots.get(1).map_or(0, |s| s - slots[0]);
    if slots.windows(2).all(|w| w[1] - w[0] == step) {
        let Piece { extents, value: (_, value) } = whole(l, var);
        let at = if extents.is_empty() { Affine::constant(slots[0]) } else { Affine::along(slots[0], LoopVar(0), step) };
        return out.store(extents, at, value);
    }
    // Two sets inside one cell: element by element the positions are affine.
    for (i, &slot) in (0..).zip(&slots) {
        let value = l.exprs.load(var, Flavour::Value, Affine::constant(i));
        out.store(Vec::new(), Affine::constant(slot), value);
    }
}
