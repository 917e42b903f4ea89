//! Ranges of binders.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Binder, BinderSet, Expr, ExprKind, Ident};

use crate::elaborate::lower::membership::unknown_set;
use crate::elaborate::lower::place::{BinderValue, Bound, Place};
use crate::elaborate::lower::{Lowering, structural};
use crate::elaborate::naming::Naming;
use crate::elaborate::symbols::{Axis, DomainId, SetId, SymbolKind, Symbols};
use crate::ir::Role;

/// Range of a binder.
pub(in crate::elaborate) fn bindings_of(l: &mut Lowering<'_, '_>, binder: &Binder, place: &Place) -> Vec<BinderValue> {
    match &binder.over {
        BinderSet::Itself => l.naming().bindings_of_name(&binder.name, place),
        BinderSet::Set(name)
            if matches!(name.text.as_str(), "states" | "actions") && l.symbols.lookup(place.scope, &name.text).is_none() =>
        {
            let role = if name.text == "states" { Role::State } else { Role::Action };
            l.symbols.arrays_of(role)
        }
        BinderSet::Set(name) => {
            let e = Expr { span: name.span, kind: ExprKind::Name(name.clone()) };
            match l.symbols.lookup(place.scope, &name.text).map(|symbol| &l.symbols[symbol].kind) {
                Some(SymbolKind::Tuple(_)) => members_of(l, &e, place).unwrap_or_default(),
                _ => l.naming().bindings_of_name(name, place),
            }
        }
        BinderSet::Range(low, high) => bindings_of_range(l, binder, low, high, place),
        BinderSet::Tuple(list) => {
            let scope = place.scope;
            let mut out = Vec::new();
            for e in list {
                if let Some(members) = members_of(l, e, place) {
                    out.extend(members);
                    continue;
                }
                if matches!(e.kind, ExprKind::Binary(..)) && l.symbols.has_set(scope, e) {
                    unknown_set(l, l.symbols.not_a_set(scope, e).unwrap_or(e));
                    continue;
                }
                // An element that is itself bound here must be taken now.
                let bound = match &e.kind {
                    ExprKind::Name(n) if place.bound(&n.text).is_some() => place.bound(&n.text).cloned(),
                    _ => None,
                };
                out.push(BinderValue::One(bound.unwrap_or_else(|| Bound::Alias(e.clone(), scope, place.bindings.clone()))));
            }
            out
        }
    }
}

/// Members of one element of a list: of a set, or of sums and differences of sets; or the variables
/// of a tuple. `None` for an element that is itself a member.
fn members_of(l: &Lowering<'_, '_>, e: &Expr, place: &Place) -> Option<Vec<BinderValue>> {
    if let ExprKind::Name(name) = &e.kind {
        let symbol = if place.bound(&name.text).is_none() { l.symbols.lookup(place.scope, &name.text)? } else { return None };
        match l.symbols[symbol].kind {
            SymbolKind::Set(_) => {}
            SymbolKind::Tuple(list) => {
                let scope = l.symbols[symbol].scope;
                return Some(list.iter().map(|e| BinderValue::One(Bound::Alias(e.clone(), scope, None))).collect());
            }
            _ => return None,
        }
    }
    let labels = l.symbols.labels_of(place.scope, e)?;
    let member = |label: &String| l.symbols.set_with(place.scope, e, label).map(|(set, i)| BinderValue::One(Bound::Member(set, i)));
    labels.iter().map(member).collect()
}

fn bindings_of_range(l: &mut Lowering<'_, '_>, binder: &Binder, low: &Expr, high: &Expr, place: &Place) -> Vec<BinderValue> {
    let symbol = l.symbols.lookup(place.scope, &binder.name.text);
    let (Some(a), Some(b)) = (structural::integer(l, low, place), structural::integer(l, high, place)) else { return Vec::new() };
    if b - a >= 10_000_000 {
        l.ledger.report(Diagnostic::error(codes::TOO_LARGE, "a range of more than ten million numbers", binder.span));
        return Vec::new();
    }
    if let Some(&(_, domain)) = l.loops.counted.iter().find(|(name, _)| *name == binder.name.text)
        && a >= 1
        && a <= b
        && b <= l.symbols.domains[domain].cells
    {
        return vec![BinderValue::Cells(domain, a - 1, b - 1)];
    }
    match symbol.map(|s| &l.symbols[s].kind) {
        Some(&SymbolKind::Domain(domain)) => cells_from(l, domain, (a, b), binder),
        Some(&SymbolKind::Set(set)) if l.symbols.sets[set].first.is_some() => l.symbols.members_between(set, a, b),
        _ => {
            let name = format!("{a}..{b}");
            match l.symbols.sets.iter().find(|(_, s)| s.name == name) {
                Some((set, _)) => l.symbols.members_between(set, a, b),
                None => numbers_between(l, a, b, binder),
            }
        }
    }
}

/// The cells `a` to `b` of a domain, counted from one.
fn cells_from(l: &mut Lowering<'_, '_>, domain: DomainId, (a, b): (i64, i64), binder: &Binder) -> Vec<BinderValue> {
    let n = l.symbols.domains[domain].cells;
    if a > b {
        return Vec::new();
    }
    if a < 1 || b > n {
        let message = format!("`{}` has the cells 1 to {n}, the range is {a} to {b}", binder.name.text);
        l.ledger.report(Diagnostic::error(codes::OUT_OF_RANGE, message, binder.span));
        return Vec::new();
    }
    vec![BinderValue::Cells(domain, a - 1, b - 1)]
}

/// Numbers that no set has.
fn numbers_between(l: &mut Lowering<'_, '_>, a: i64, b: i64, binder: &Binder) -> Vec<BinderValue> {
    if b - a >= 10_000 {
        l.ledger.report(
            Diagnostic::error(codes::TOO_LARGE, "a range of more than ten thousand numbers is written out", binder.span)
                .help("use a `domain`: its cells stay a loop"),
        );
        return Vec::new();
    }
    (a..=b).map(|i| BinderValue::One(Bound::Number(l.exprs.constant(i as f64)))).collect()
}

/// Range of an index of a declaration (`i in species`, `z`, `k in 1..4`).
pub(in crate::elaborate) fn index_over(l: &mut Lowering<'_, '_>, binder: &Binder, place: &Place) -> Option<IndexOver> {
    let set = match &binder.over {
        BinderSet::Set(name) => name,
        BinderSet::Itself => &binder.name,
        BinderSet::Range(low, high) => return index_over_range(l, binder, low, high, place),
        BinderSet::Tuple(_) => {
            let message = "an index of a declaration runs over a set or a domain";
            let fault = Diagnostic::error(codes::BAD_BINDER, message, binder.span);
            l.ledger.report(fault.help("name the members: `set fluids = species - solids`, and declare over `fluids`"));
            return None;
        }
    };
    match l.symbols.lookup(place.scope, &set.text).map(|s| &l.symbols[s].kind) {
        Some(SymbolKind::Set(set) | SymbolKind::Phase(set)) => Some(IndexOver::Axis(Axis::Set(*set))),
        Some(SymbolKind::Domain(domain)) => Some(IndexOver::Axis(Axis::Domain(*domain))),
        _ => {
            l.naming().bindings_of_name(set, place);
            None
        }
    }
}

/// The integers behind `k in 1..4` in a declaration; equal ranges are one set.
fn index_over_range(l: &mut Lowering<'_, '_>, binder: &Binder, low: &Expr, high: &Expr, place: &Place) -> Option<IndexOver> {
    let (a, b) = (structural::integer(l, low, place)?, structural::integer(l, high, place)?);
    if a > b || b - a >= 100_000 {
        let d = Diagnostic::error(codes::EMPTY_SET, format!("an index from {a} to {b}"), binder.span);
        l.ledger.report(d.label("must have between one and a hundred thousand members"));
        return None;
    }
    let name = format!("{a}..{b}");
    if let Some((known, _)) = l.symbols.sets.iter().find(|(_, s)| s.name == name) {
        return Some(IndexOver::Axis(Axis::Set(known)));
    }
    if !l.ledger.budget.may_hold(b - a) {
        l.ledger.report(Diagnostic::error(codes::TOO_LARGE, "sets of more than two million members together", binder.span));
        return None;
    }
    Some(IndexOver::New { name, low: a, high: b })
}

/// Range of an index of a declaration.
pub(in crate::elaborate) enum IndexOver {
    /// A set or a domain that is declared.
    Axis(Axis),
    /// Integers that are not a set yet.
    New { name: String, low: i64, high: i64 },
}

impl<'a> Naming<'_, 'a> {
    fn bindings_of_name(&mut self, name: &Ident, place: &Place) -> Vec<BinderValue> {
        match place.bound(&name.text) {
            Some(&Bound::Axis(Axis::Set(set))) => {
                return (0..self.symbols.sets[set].labels.len()).map(|i| BinderValue::One(Bound::Member(set, i))).collect();
            }
            Some(&Bound::Axis(Axis::Domain(domain))) => {
                return vec![BinderValue::Cells(domain, 0, self.symbols.domains[domain].cells - 1)];
            }
            // The set of an array that is not known in a function that nothing calls.
            Some(Bound::Value(v)) if v.is_poison() => return Vec::new(),
            _ => {}
        }
        let Some(symbol) = self.symbols.lookup(place.scope, &name.text) else {
            if let Some(set) = self.symbols.sets.values().find(|s| s.position(&name.text).is_some()) {
                let set = set.name.clone();
                let message = format!("`{}` is a member of `{set}`; an array is declared over its whole set", name.text);
                let help = format!(
                    "declare it once, `[{set}]`: a `var` with one equation for each member (`eq x[{}] = ...`), or a `let` with `if i == {} then ... else ...` for `i in {set}`",
                    name.text, name.text
                );
                self.ledger.report(Diagnostic::error(codes::WRONG_KIND, message, name.span).help(help));
                return Vec::new();
            }
            let known: Vec<String> = self
                .symbols
                .list
                .values()
                .filter(|s| matches!(s.kind, SymbolKind::Set(_) | SymbolKind::Domain(_)))
                .map(|s| s.path.clone())
                .collect();
            let help = self.ledger.reports.did_you_mean(&name.text, known.iter().map(String::as_str));
            self.ledger.report(
                Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown set or domain `{}`", name.text), name.span).maybe_help(help),
            );
            return Vec::new();
        };
        match self.symbols[symbol].kind {
            SymbolKind::Set(set) | SymbolKind::Phase(set) => {
                (0..self.symbols.sets[set].labels.len()).map(|i| BinderValue::One(Bound::Member(set, i))).collect()
            }
            SymbolKind::Domain(domain) => vec![BinderValue::Cells(domain, 0, self.symbols.domains[domain].cells - 1)],
            SymbolKind::Faulty => Vec::new(),
            _ => {
                let at = self.symbols[symbol].span;
                self.ledger.report(
                    Diagnostic::error(codes::WRONG_KIND, format!("`{}` is neither a set nor a domain", name.text), name.span)
                        .secondary(at, "declared here"),
                );
                Vec::new()
            }
        }
    }
}

impl<'a> Symbols<'a> {
    /// The members of a set of numbers that are between two, both included.
    fn members_between(&self, set: SetId, a: i64, b: i64) -> Vec<BinderValue> {
        let first = self.sets[set].first.unwrap_or(0);
        let last = first + self.sets[set].labels.len() as i64 - 1;
        (a.max(first)..=b.min(last)).map(|i| BinderValue::One(Bound::Member(set, (i - first) as usize))).collect()
    }

    /// All variables of a role, each as the row of its elements.
    fn arrays_of(&self, role: Role) -> Vec<BinderValue> {
        let of_role = |kind: &SymbolKind| match kind {
            SymbolKind::Variable { var, .. } if self.vars[*var].role == role => Some(i64::from(self.vars[*var].len)),
            _ => None,
        };
        self.list.iter().filter_map(|(id, s)| of_role(&s.kind).map(|len| BinderValue::Elements(id, len))).collect()
    }
}
