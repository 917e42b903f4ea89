//! Members of sets in expressions: `i in solids`, and values by member, `{ A: 1, B: 2 }`.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind, Ident};

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::place::{Bound, Place};
use crate::elaborate::lower::value::Value;
use crate::elaborate::symbols::{SetId, SymbolKind};

/// Name of the call that `i in solids` is.
pub(in crate::elaborate) const IN: &str = "in";

/// The truth of `i in solids`, `i in {A, B}`; known when the index is.
pub(in crate::elaborate) fn membership(l: &mut Lowering<'_, '_>, arguments: &[Expr], place: &Place) -> Value {
    let Some((index, among)) = arguments.split_first() else { return l.poison() };
    let Some(label) = label_of(l, index, place) else { return l.poison() };
    let mut holds = false;
    for e in among {
        let ExprKind::Name(name) = &e.kind else {
            match l.symbols.labels_of(place.scope, e) {
                Some(members) => holds |= members.contains(&label),
                None => return unknown_set(l, l.symbols.not_a_set(place.scope, e).unwrap_or(e)),
            }
            continue;
        };
        let symbol = l.symbols.lookup(place.scope, &name.text);
        match symbol.map(|symbol| &l.symbols[symbol].kind) {
            Some(SymbolKind::Set(set) | SymbolKind::Phase(set)) => holds |= l.symbols.sets[*set].position(&label).is_some(),
            Some(SymbolKind::Faulty) => return l.poison(),
            _ if l.symbols.sets.values().any(|set| set.position(&name.text).is_some()) => holds |= label == name.text,
            _ => return unknown_set(l, e),
        }
    }
    Value::truth(l.exprs.truth(holds))
}

/// Reports a part of a set that is neither a set nor a member of one.
pub(in crate::elaborate) fn unknown_set(l: &mut Lowering<'_, '_>, e: &Expr) -> Value {
    let ExprKind::Name(name) = &e.kind else {
        return l.fault(Diagnostic::error(codes::BAD_BINDER, "an index is among the members of a set or a list of names", e.span));
    };
    let help = l.ledger.reports.did_you_mean(&name.text, l.symbols.names_of_sets());
    l.fault(Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown set `{}`", name.text), name.span).maybe_help(help))
}

/// The label of an index; a range that stays a loop is written out.
fn label_of(l: &mut Lowering<'_, '_>, index: &Expr, place: &Place) -> Option<String> {
    if let ExprKind::Name(name) = &index.kind {
        match place.bound(&name.text) {
            Some(Bound::Member(set, i)) => return Some(l.symbols.sets[*set].labels[*i].clone()),
            Some(Bound::Number(e)) => return l.exprs.as_const(*e).map(|x| x.to_string()),
            Some(Bound::Run(_)) => {
                l.ledger.speculation.refuse();
                return None;
            }
            Some(Bound::Alias(inner, scope, bindings)) => {
                let mut there = place.clone();
                (there.scope, there.bindings) = (*scope, bindings.clone());
                let inner = inner.clone();
                return label_of(l, &inner, &there);
            }
            None if l.symbols.sets.values().any(|set| set.position(&name.text).is_some()) => return Some(name.text.clone()),
            _ => {}
        }
    }
    let fault = Diagnostic::error(codes::WRONG_KIND, "only an index over a set is among the members of a set", index.span);
    l.fault(fault.help("bind it by `for i in species`, or compare a number with `<` and `>`"));
    None
}

/// The value of an array at the member of its index, from values by member; `None` after a report.
pub(in crate::elaborate) fn by_member<'e>(l: &mut Lowering<'_, '_>, arguments: &'e [Expr], place: &Place) -> Option<&'e Expr> {
    let (indices, pairs) = arguments.split_first()?;
    let ExprKind::Tuple(indices) = &indices.kind else { return None };
    let pairs: Vec<(&Ident, &Expr)> = pairs.chunks_exact(2).filter_map(|pair| Some((name_of(&pair[0])?, &pair[1]))).collect();
    l.ledger.check_members("values", pairs.iter().map(|(label, _)| *label));
    let members: Vec<(SetId, usize)> = indices
        .iter()
        .filter_map(|index| match place.bound(&name_of(index)?.text) {
            Some(Bound::Member(set, i)) => Some((*set, *i)),
            _ => None,
        })
        .collect();
    let labels = || pairs.iter().map(|(label, _)| *label).filter(|label| label.text != "default");
    let unknown = |l: &Lowering<'_, '_>, set: SetId| labels().find(|label| l.symbols.sets[set].position(&label.text).is_none());
    let Some(&(set, i)) = members.iter().find(|(set, _)| unknown(l, *set).is_none()) else {
        let span = arguments.first().map_or_else(Span::default, |first| first.span);
        let fault = match members.first().and_then(|(set, _)| Some((*set, unknown(l, *set)?))) {
            Some((set, label)) => {
                let set = &l.symbols.sets[set];
                let help = l.ledger.reports.did_you_mean(&label.text, set.labels.iter().map(String::as_str));
                let message = format!("`{}` is not a member of `{}`", label.text, set.name);
                Diagnostic::error(codes::OUT_OF_RANGE, message, label.span).maybe_help(help)
            }
            None => Diagnostic::error(codes::WRONG_SHAPE, "values by member belong to an array over a set", span)
                .help("declare an index, `state x[species] = { A: 1, B: 2 }`"),
        };
        l.fault(fault);
        return None;
    };
    let label = &l.symbols.sets[set].labels[i];
    let value = |wanted: &str| pairs.iter().find(|(label, _)| label.text == wanted).map(|(_, value)| *value);
    let found = value(label).or_else(|| value("default"));
    if found.is_none() {
        let message = format!("the member `{label}` has no value");
        let fault = Diagnostic::error(codes::MISSING_DEFAULT, message, arguments[0].span);
        l.fault(fault.help("give every member a value, or the others `default: 0`"));
    }
    found
}

fn name_of(e: &Expr) -> Option<&Ident> {
    if let ExprKind::Name(name) = &e.kind { Some(name) } else { None }
}
