//! Observation levels.

use std::rc::Rc;

use rustc_hash::FxHashMap;
use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, BinderSet, Expr, ExprKind, Ident, Observation, Statement, StatementKind};
use smpl_dsl::units::Unit;

use crate::elaborate::episode::common::each;
use crate::elaborate::episode::observed::{Attributes, Observations, attributes, warn_of_missing_bounds};
use crate::elaborate::episode::observed_arrays::{observe_array, observe_states, whole_array};
use crate::elaborate::lower::bounded::Bounded;
use crate::elaborate::lower::loops::Piece;
use crate::elaborate::lower::place::{Bound, Place, Site};
use crate::elaborate::lower::{Lowering, indices, nests, paths, units};
use crate::elaborate::select::items::{Item, items, overlay};
use crate::elaborate::symbols::{ScopeId, SymbolId, SymbolKind};
use crate::ir::{Affine, ExprId};
use crate::model::{Observed, Quantity};

pub(in crate::elaborate) fn observations<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Observations {
    let mut levels = vec!["default".to_owned()];
    let mut chosen: Vec<(ScopeId, &'a Observation)> = Vec::new();
    let wanted = l.input.options.observation.clone().unwrap_or_else(|| "default".to_owned());
    let is_full =
        |item: &Item<'_>| matches!(item, Item::Other(Statement { kind: StatementKind::Level { name, .. }, .. }) if name.text == "full");
    // A level `full` of the text is that and nothing else.
    let is_own = wanted == "full" && each(blocks).any(|(_, item)| is_full(&item));
    let bases = level_bases(l, blocks);
    let chain = level_chain(if wanted == "full" && !is_own { "default" } else { &wanted }, &bases);
    for (scope, items_of) in blocks {
        levels.extend(items_of.iter().filter_map(level).map(|(name, _)| name.text.clone()));
        let mut own = Vec::new();
        for name in chain.iter().rev() {
            overlay(&mut own, observed_at(l, items_of, name));
        }
        chosen.extend(own.iter().filter_map(|item| if let Item::Observe(o) = item { Some((*scope, *o)) } else { None }));
    }
    if !levels.iter().any(|l| l == "full") {
        levels.push("full".to_owned());
    }
    if !levels.contains(&wanted) {
        let hint = did_you_mean(&wanted, levels.iter().map(String::as_str)).unwrap_or_default();
        l.ledger.reports.scenario_fault(
            &wanted,
            format!("unknown observation level `{wanted}`; the model has {} {hint}", levels.join(", ")),
            None,
        );
    }
    let mut out = Observations::default();
    let mut known: FxHashMap<String, Span> = FxHashMap::default();
    for (scope, o) in chosen {
        let place = Place::new(scope, Site::Instant);
        let before = out.names.len();
        observation(l, o, &place, &mut out);
        refuse_twice(l, &out.names[before..], o.span, &mut known);
    }
    l.names.observed = std::mem::take(&mut out.bounded);
    if wanted == "full" && !is_own {
        observe_states(l, None, &mut out);
    }
    if levels.contains(&wanted) {
        out.levels = levels;
    }
    out
}

/// Name and body of a level.
fn level<'a>(item: &Item<'a>) -> Option<(&'a Ident, &'a [Statement])> {
    match item {
        Item::Other(Statement { kind: StatementKind::Level { name, body, .. }, .. }) => Some((name, body)),
        _ => None,
    }
}

/// The levels that extend another one, with its name; reports bases that do not exist or extend
/// each other.
fn level_bases<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> FxHashMap<&'a str, &'a Ident> {
    let mut bases: FxHashMap<&'a str, &'a Ident> = FxHashMap::default();
    for (_, item) in each(blocks) {
        if let Item::Other(Statement { kind: StatementKind::Level { name, extends: Some(base), .. }, .. }) = item {
            bases.insert(&name.text, base);
        }
    }
    let known: Vec<&str> =
        each(blocks).filter_map(|(_, item)| level(&item)).map(|(name, _)| name.text.as_str()).chain(["default"]).collect();
    let mut faults: Vec<Diagnostic> = Vec::new();
    for (name, base) in &bases {
        if !known.contains(&base.text.as_str()) {
            let message = format!("unknown level `{}`", base.text);
            let near = did_you_mean(&base.text, known.iter().copied());
            let help = near.unwrap_or_else(|| format!("a level extends one of {}", known.join(", ")));
            faults.push(Diagnostic::error(codes::UNKNOWN_NAME, message, base.span).help(help));
        } else if level_chain(&base.text, &bases).contains(name) {
            let message = format!("the level `{name}` extends itself");
            faults.push(Diagnostic::error(codes::CYCLIC_DEFINITION, message, base.span));
        }
    }
    faults.into_iter().for_each(|fault| l.ledger.report(fault));
    bases
}

/// A level and those that it extends, the nearest first.
fn level_chain<'n>(name: &'n str, bases: &FxHashMap<&'n str, &'n Ident>) -> Vec<&'n str> {
    let mut chain = vec![name];
    while let Some(base) = bases.get(chain[chain.len() - 1]).filter(|base| !chain.contains(&base.text.as_str())) {
        chain.push(&base.text);
    }
    chain
}

/// Observations of the items of a block at a level.
fn observed_at<'a>(l: &Lowering<'_, 'a>, items_of: &[Item<'a>], wanted: &str) -> Vec<Item<'a>> {
    if wanted == "default" {
        return items_of.iter().copied().filter(|item| matches!(item, Item::Observe(_))).collect();
    }
    let bodies = items_of.iter().filter_map(level).filter(|(name, _)| name.text == wanted);
    bodies.flat_map(|(_, body)| items(body, &l.input.selection)).filter(|item| matches!(item, Item::Observe(_))).collect()
}

/// Refuses observations of one name, whatever their texts are: tables and data sets tell them by
/// it.
fn refuse_twice(l: &mut Lowering<'_, '_>, made: &[Observed], span: Span, known: &mut FxHashMap<String, Span>) {
    for observed in made {
        if let Some(first) = known.insert(observed.name.clone(), span).filter(|_| !l.ledger.reports.has_errors()) {
            l.ledger.report(
                Diagnostic::error(codes::DUPLICATE_NAME, format!("two observations are called `{}`", observed.name), span)
                    .secondary(first, "the first one")
                    .help("give one another name: `observe seen = x in low..high`"),
            );
        }
    }
}

/// Works out the observations of a level that is not chosen.
pub(in crate::elaborate) fn check_level<'a>(l: &mut Lowering<'_, 'a>, scope: ScopeId, level: Vec<Item<'a>>) {
    let place = Place::new(scope, Site::Instant);
    let mut out = Observations::default();
    let mut known: FxHashMap<String, Span> = FxHashMap::default();
    for item in level {
        if let Item::Observe(o) = item {
            let before = out.names.len();
            observation(l, o, &place, &mut out);
            refuse_twice(l, &out.names[before..], o.span, &mut known);
        }
    }
}

fn observation(l: &mut Lowering<'_, '_>, o: &Observation, place: &Place, out: &mut Observations) {
    if are_all_states(o) && l.symbols.lookup(place.scope, "states").is_none() {
        return observe_states(l, Some(o.span), out);
    }
    if let Some((list, scope)) = l.symbols.tuple(&o.value, place).filter(|_| o.name.is_none()) {
        let there = Place { scope, ..place.clone() };
        return list.iter().for_each(|e| observation(l, &Observation { value: e.clone(), ..o.clone() }, &there, out));
    }
    if o.binders.is_empty()
        && let Some(symbol) = whole_array(l, &o.value, place)
    {
        return observe_array(l, o, symbol, place, out);
    }
    let pieces = nests::nest(l, &o.binders, place, &mut |s, inner| observed_element(s, o, inner));
    for Piece { extents, value } in pieces {
        let Some((name, unit, expr, attributes)) = value else { continue };
        if !extents.is_empty() {
            l.ledger.report(
                Diagnostic::error(codes::WRONG_SHAPE, "an observation over the cells of a domain", o.span)
                    .help("observe the whole array, `observe c`, or single cells"),
            );
            continue;
        }
        push_observation(l, name, &unit.to_string(), expr, &attributes, o, out);
    }
}

/// `observe states`, `observe x for x in states`
fn are_all_states(o: &Observation) -> bool {
    let ExprKind::Name(name) = &o.value.kind else { return false };
    let over_states =
        |b: &Binder| b.name.text == name.text && b.condition.is_none() && matches!(&b.over, BinderSet::Set(set) if set.text == "states");
    name.text == "states" || matches!(o.binders.as_slice(), [binder] if over_states(binder))
}

/// Name, unit, value and attributes of one observed number; `None` where it has no value.
fn observed_element(l: &mut Lowering<'_, '_>, o: &Observation, place: &Place) -> Option<(String, Unit, ExprId, Attributes)> {
    let (what, declared) = ("the observation", o.span);
    let (v, unit) = match &o.unit {
        Some(written) => {
            let unit = units::unit(l, written, place).unwrap_or_else(Unit::one);
            let taken = &mut |s: &mut Lowering<'_, '_>, v, span| s.values().strictly_or_bare(v, &unit, span, what, declared);
            (l.declared_value(&o.value, place, taken, &unit), unit)
        }
        None => {
            let v = l.value(&o.value, place);
            let unit = units::shown(&v.unit);
            (v, unit)
        }
    };
    // Its other properties have no meaning yet.
    if v.is_poison() {
        return None;
    }
    let expr = l.values().strictly_or_bare(v, &unit, o.value.span, what, declared);
    let name = observation_name(l, o, place);
    let mut attributes = attributes(l, o, &unit, place);
    if attributes.bounds.is_none() {
        attributes.bounds = bounds_of_element(l, expr);
    }
    Some((name, unit, expr, attributes))
}

fn push_observation(
    l: &mut Lowering<'_, '_>,
    name: String,
    unit: &str,
    expr: ExprId,
    a: &Attributes,
    o: &Observation,
    out: &mut Observations,
) {
    let observed = a.observed(name, unit.to_owned(), (f64::NEG_INFINITY, f64::INFINITY));
    if a.bounds.is_none() {
        warn_of_missing_bounds(l, &observed.name, o);
    }
    out.store(Vec::new(), Affine::constant(out.names.len() as i64), expr);
    out.bounded.push(Bounded::one(observed.item(), expr));
    out.names.push(observed);
}

fn bounds_of_element(l: &Lowering<'_, '_>, e: ExprId) -> Option<(f64, f64)> {
    let crate::ir::Expr::Load { var, at, .. } = l.exprs.node(e) else { return None };
    if let Some(schedule) = l.symbols.schedule.as_ref().filter(|schedule| schedule.current == var) {
        return Some((1.0, schedule.phases.len() as f64));
    }
    let q = l.quantities.get(&var)?;
    let i = at.offset.max(0) as usize;
    let (low, high) = (Quantity::pick(&q.low, i), Quantity::pick(&q.high, i));
    (low.is_finite() || high.is_finite()).then_some((low, high))
}

/// Own name, else that of the variable with its indices.
fn observation_name(l: &mut Lowering<'_, '_>, o: &Observation, place: &Place) -> String {
    let base = match &o.name {
        Some(name) => format!("{}{}", l.symbols.scopes[place.scope].prefix, name.text),
        None => match &o.value.kind {
            ExprKind::Name(name) => match l.symbols.lookup(place.scope, &name.text).filter(|_| place.bound(&name.text).is_none()) {
                Some(symbol) => l.symbols[symbol].path.clone(),
                None => bound_name(l, name, place),
            },
            ExprKind::Index(base, index) => {
                if let crate::elaborate::lower::place::Target::Symbol(symbol) = paths::resolve(l, base, place)
                    && let Some(name) = element_name(l, symbol, index, place)
                {
                    return name;
                }
                crate::elaborate::select::items::reference(&o.value)
            }
            ExprKind::Member(..) => match paths::resolve(l, &o.value, place) {
                crate::elaborate::lower::place::Target::Symbol(symbol) => l.symbols[symbol].path.clone(),
                _ => crate::elaborate::select::items::reference(&o.value),
            },
            _ => {
                l.ledger.report(
                    Diagnostic::error(codes::MISSING_CLAUSE, "an observed expression needs a name", o.span)
                        .help("write `observe name = expression in low..high`"),
                );
                "observation".to_owned()
            }
        },
    };
    // An own name has every index; one by its path (`col[k].outlet.c`) has those within it already,
    // and `x` in a tuple is an element itself.
    let is_element = |b: &Binder| matches!((&o.value.kind, place.bound(&b.name.text)), (ExprKind::Name(n), Some(Bound::Alias(..))) if n.text == b.name.text);
    let open: Vec<&Binder> = o.binders.iter().filter(|b| o.name.is_some() || !(indexes(&o.value, &b.name.text) || is_element(b))).collect();
    if open.is_empty() {
        return base;
    }
    let labels: Vec<String> = open.into_iter().map(|b| bound_label(l, b, place)).collect();
    format!("{base}[{}]", labels.join(","))
}

/// The name of what a bound name stands for.
fn bound_name(l: &mut Lowering<'_, '_>, name: &Ident, place: &Place) -> String {
    let reference = Expr { span: name.span, kind: ExprKind::Name(name.clone()) };
    match (place.bound(&name.text).cloned(), paths::resolve(l, &reference, place)) {
        (_, crate::elaborate::lower::place::Target::Symbol(symbol)) => l.symbols[symbol].path.clone(),
        (Some(Bound::Alias(element, ..)), _) => crate::elaborate::select::items::reference(&element),
        _ => name.text.clone(),
    }
}

/// Returns `true` if a name is among the indices of a reference.
fn indexes(e: &Expr, name: &str) -> bool {
    match &e.kind {
        ExprKind::Member(base, _) => indexes(base, name),
        ExprKind::Index(base, index) => indexes(base, name) || index.iter().any(|i| matches!(&i.kind, ExprKind::Name(n) if n.text == name)),
        _ => false,
    }
}

fn element_name(l: &mut Lowering<'_, '_>, symbol: SymbolId, index: &[Expr], place: &Place) -> Option<String> {
    let (axes, pattern) = match &l.symbols[symbol].kind {
        SymbolKind::Variable { axes, declaration, .. } | SymbolKind::Let { axes, declaration, .. } => {
            (axes.clone(), declaration.pattern.clone())
        }
        SymbolKind::Table { axes, .. } => (Rc::clone(axes), None),
        _ => return None,
    };
    let path = l.symbols[symbol].path.clone();
    let (_, bounds) = indices::address(l, symbol, &axes, index, index.first()?.span, place)?;
    let labels: Vec<String> = bounds
        .iter()
        .map(|b| match b {
            Bound::Member(set, i) => l.symbols.sets[*set].labels[*i].clone(),
            Bound::Cell(_, c) => (c.first + 1).to_string(),
            _ => String::new(),
        })
        .collect();
    let joined = labels.join(",");
    Some(match pattern {
        Some(pattern) => pattern.replace("{}", &joined),
        None => format!("{path}[{joined}]"),
    })
}

/// Value of a binder in a name.
fn bound_label(l: &mut Lowering<'_, '_>, binder: &Binder, place: &Place) -> String {
    match place.bound(&binder.name.text) {
        Some(Bound::Member(set, i)) => l.symbols.sets[*set].labels[*i].clone(),
        Some(Bound::Cell(_, c)) => (c.first + 1).to_string(),
        Some(Bound::Number(e)) => l.exprs.as_const(*e).map_or_else(String::new, |x| x.to_string()),
        Some(Bound::Element(symbol, at)) => match &l.symbols[*symbol].kind {
            SymbolKind::Variable { var, .. } => {
                l.quantities.get(var).map_or_else(String::new, |quantity| quantity.element_name(at.offset.max(0) as usize))
            }
            _ => l.symbols[*symbol].path.clone(),
        },
        _ => bound_name(l, &binder.name, place),
    }
}
