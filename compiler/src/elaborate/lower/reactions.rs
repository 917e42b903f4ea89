//! Source terms and stoichiometric coefficients of reactions.

use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, BinderSet, Expr, ExprKind};
use smpl_dsl::units::Unit;

use crate::elaborate::lower::place::{Bound, Place};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, indices, operators};
use crate::elaborate::symbols::{Axis, OneReaction, Reactions, SymbolId, SymbolKind};

/// `source[i, z]`: the sum of the rates of all reactions, each times its coefficient.
pub(in crate::elaborate) fn source(l: &mut Lowering<'_, '_>, symbol: SymbolId, index: &[Expr], span: Span, place: &Place) -> Value {
    let SymbolKind::Source(set) = l.symbols[symbol].kind.clone() else { return l.poison() };
    let axes: Vec<Axis> = std::iter::once(Axis::Set(set.species)).chain(set.domains.iter().map(|d| Axis::Domain(*d))).collect();
    let Some((_, bounds)) = indices::address(l, symbol, &axes, index, span, place) else { return l.poison() };
    let Some((Bound::Member(_, at), cells)) = bounds.split_first() else { return unrolled(l) };
    let mut total = Value { expr: l.exprs.constant(0.0), unit: Measure::Nothing };
    for one in &set.list {
        let mut inner = own_place(l, symbol, one, place);
        for (axis, cell) in set.domains.iter().zip(cells) {
            let binder = one.reaction.declaration.indices.iter().find(|binder| match &binder.over {
                BinderSet::Itself => l.symbols.domains[*axis].name == binder.name.text,
                BinderSet::Set(name) => l.symbols.domains[*axis].name == name.text,
                BinderSet::Range(..) | BinderSet::Tuple(_) => false,
            });
            if let Some(binder) = binder {
                inner = inner.bind(&binder.name.text, cell.clone());
            }
        }
        let Some(coefficient) = coefficient(l, &set, one, *at, &inner) else { continue };
        let rate = rate(l, one, span, &inner);
        let (op, part) = match l.exprs.as_const(coefficient.expr).filter(|_| coefficient.unit.is_plain()) {
            Some(0.0) => continue,
            Some(1.0) => (BinaryOp::Add, rate),
            Some(-1.0) => (BinaryOp::Sub, rate),
            _ => (BinaryOp::Add, operators::arithmetic(l, BinaryOp::Mul, (coefficient, span), (rate, span), span)),
        };
        total = operators::arithmetic(l, op, (total, span), (part, one.reaction.declaration.name.span), span);
    }
    total
}

/// `stoichiometry[j, i]`
pub(in crate::elaborate) fn stoichiometry(l: &mut Lowering<'_, '_>, symbol: SymbolId, index: &[Expr], span: Span, place: &Place) -> Value {
    let SymbolKind::Stoichiometry(set) = l.symbols[symbol].kind.clone() else { return l.poison() };
    let axes = [Axis::Set(set.names), Axis::Set(set.species)];
    let Some((_, bounds)) = indices::address(l, symbol, &axes, index, span, place) else { return l.poison() };
    let [Bound::Member(_, reaction), Bound::Member(_, species)] = bounds.as_slice() else { return unrolled(l) };
    let one = &set.list[*reaction];
    let inner = own_place(l, symbol, one, place);
    let value = coefficient(l, &set, one, *species, &inner);
    let value = value.unwrap_or_else(|| Value::bare(l.exprs.constant(0.0)));
    if value.unit.is_plain() && !value.is_poison() { Value::of(value.expr, Unit::one()) } else { value }
}

/// Members of sets of species are written out, never looped over.
fn unrolled(l: &mut Lowering<'_, '_>) -> Value {
    l.ledger.speculation.refuse();
    l.poison()
}

/// The place of a reaction, with its indices over sets bound.
fn own_place(l: &Lowering<'_, '_>, symbol: SymbolId, one: &OneReaction<'_>, place: &Place) -> Place {
    bound(Place { scope: l.symbols[symbol].scope, bindings: None, ..place.clone() }, one)
}

/// A place with the indices of a reaction over sets bound.
pub(in crate::elaborate) fn bound(place: Place, one: &OneReaction<'_>) -> Place {
    one.bound.iter().fold(place, |place, (name, set, i)| place.bind(name, Bound::Member(*set, *i)))
}

/// The stoichiometric coefficient of a species, positive if it is produced; `None` if it does not
/// take part.
pub(in crate::elaborate) fn coefficient(
    l: &mut Lowering<'_, '_>,
    set: &Reactions<'_>,
    one: &OneReaction<'_>,
    species: usize,
    place: &Place,
) -> Option<Value> {
    let label = l.symbols.sets[set.species].labels[species].clone();
    let mut total = None;
    for term in &one.reaction.terms {
        let bound = one.bound.iter().find(|(name, ..)| *name == term.species.text);
        let own = bound.map_or(term.species.text.as_str(), |(_, set, i)| l.symbols.sets[*set].labels[*i].as_str());
        if own != label {
            continue;
        }
        let span = term.species.span;
        let value = match &term.coefficient {
            Some(e) => l.value(e, place),
            None => Value::bare(l.exprs.constant(1.0)),
        };
        let op = if term.consumed { BinaryOp::Sub } else { BinaryOp::Add };
        let before = total.unwrap_or_else(|| Value { expr: l.exprs.constant(0.0), unit: Measure::Zero });
        total = Some(operators::arithmetic(l, op, (before, span), (value, span), span));
    }
    total
}

/// The rate of a reaction at its own indices.
fn rate(l: &mut Lowering<'_, '_>, one: &OneReaction<'_>, span: Span, place: &Place) -> Value {
    let index = one.reaction.declaration.indices.iter().map(|binder| Expr { span, kind: ExprKind::Name(binder.name.clone()) });
    let index: Vec<Expr> = index.collect();
    l.symbol_value(one.rate, &index, span, place)
}
