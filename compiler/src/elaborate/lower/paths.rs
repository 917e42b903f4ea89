//! Paths: `R1.inlet.c`, `a[i].b[j, k]`, `z.last`.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Expr, ExprKind};

use crate::elaborate::lower::indices::cell_number;
use crate::elaborate::lower::place::{Bound, Place, Target};
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::{Lowering, structural};
use crate::elaborate::symbols::{Axis, DomainId, ScopeId, SetId, SymbolKind, Symbols};

/// `a.b.c`, `a[i].b[j, k]`
pub(in crate::elaborate) fn reference(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Value {
    let (base, index): (&Expr, &[Expr]) = match &e.kind {
        ExprKind::Index(base, index) => (base, index),
        _ => (e, &[]),
    };
    match resolve(l, base, place) {
        Target::Symbol(symbol) => l.symbol_value(symbol, index, e.span, place),
        Target::Value(v) if index.is_empty() => v,
        Target::Value(v) if v.is_poison() => v,
        Target::Value(_) => l.values().fault(
            Diagnostic::error(codes::WRONG_SHAPE, "an index after a value that has none", e.span)
                .help("write `*` to multiply; only a number takes a unit in brackets"),
        ),
        Target::Nothing => l.poison(),
    }
}

/// The symbol at the end of a path.
pub(in crate::elaborate) fn resolve(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Target {
    match &e.kind {
        ExprKind::Name(name) => {
            match place.bound(&name.text).cloned() {
                Some(Bound::Alias(inner, scope, bindings)) => {
                    let mut there = place.clone();
                    there.scope = scope;
                    there.bindings = bindings;
                    return resolve(l, &inner, &there);
                }
                Some(_) => return Target::Value(l.name(name, place)),
                None => {}
            }
            match l.symbols.lookup(place.scope, &name.text) {
                Some(symbol) => Target::Symbol(symbol),
                None => Target::Value(l.name(name, place)),
            }
        }
        ExprKind::Member(base, member) => {
            if let Some(v) = domain_member(l, base, &member.text, place) {
                return Target::Value(v);
            }
            let Some(scope) = scope_of(l, base, place) else { return Target::Nothing };
            match l.symbols.scopes[scope].names.get(&member.text) {
                Some(&symbol) => Target::Symbol(symbol),
                None => {
                    let help = l.ledger.reports.did_you_mean(&member.text, l.symbols.scopes[scope].names.keys().map(String::as_str));
                    let prefix = l.symbols.scopes[scope].prefix.trim_end_matches('.').to_owned();
                    l.ledger.report(
                        Diagnostic::error(codes::UNKNOWN_NAME, format!("`{prefix}` has no `{}`", member.text), member.span)
                            .label("not declared there")
                            .maybe_help(help),
                    );
                    Target::Nothing
                }
            }
        }
        _ => Target::Value(l.value(e, place)),
    }
}

/// The scope that a path names: an instance or a port.
pub(in crate::elaborate) fn scope_of(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Option<ScopeId> {
    let (base, index) = match &e.kind {
        ExprKind::Index(base, index) => (&**base, index.as_slice()),
        _ => (e, &[][..]),
    };
    let symbol = match resolve(l, base, place) {
        Target::Symbol(symbol) => symbol,
        Target::Value(v) if v.is_poison() => return None,
        Target::Value(_) => {
            l.ledger.report(Diagnostic::error(codes::WRONG_KIND, "only components, ports and domains have members", e.span));
            return None;
        }
        Target::Nothing => return None,
    };
    match l.symbols[symbol].kind.clone() {
        SymbolKind::Instance(scope) if index.is_empty() => Some(scope),
        SymbolKind::Instances(row) if index.len() == row.indices => {
            let labels: Option<Vec<String>> = index.iter().map(|e| instance_label(l, e, place)).collect();
            let label = labels?.join(",");
            let found = row.find(&label);
            if found.is_none() {
                let known = crate::elaborate::symbols::listed(row.list.iter().map(|(l, _)| l.as_str()));
                let message = format!("there is no instance `{label}`: {known}");
                let fault = Diagnostic::error(codes::OUT_OF_RANGE, message, index[0].span).label("not among the instances");
                let first = row.list.first().filter(|_| label == "0").map(|(first, _)| format!("instances are counted from `{first}`"));
                l.ledger.report(fault.maybe_help(first));
            }
            found
        }
        SymbolKind::Faulty => None,
        SymbolKind::Instances(row) => {
            let path = l.symbols[symbol].path.clone();
            let first = row.list.first().map_or("1", |(l, _)| l.as_str());
            let count = if row.indices == 1 { "one index".to_owned() } else { format!("{} indices", row.indices) };
            let is_port = |scope| l.symbols.ports.binary_search_by_key(scope, |port| port.scope).is_ok();
            let what = if row.list.first().is_some_and(|(_, scope)| is_port(scope)) { "an array of ports" } else { "a row of instances" };
            l.ledger.report(
                Diagnostic::error(codes::WRONG_SHAPE, format!("`{path}` is {what} and takes {count}"), e.span)
                    .help(format!("write `{path}[{first}]`")),
            );
            None
        }
        _ => {
            let path = l.symbols[symbol].path.clone();
            let declared = l.symbols[symbol].span;
            l.ledger.report(
                Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is neither a component nor a port: it has no members"), e.span)
                    .secondary(declared, "declared here"),
            );
            None
        }
    }
}

fn instance_label(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Option<String> {
    if let ExprKind::Name(name) = &e.kind {
        return Some(match place.bound(&name.text) {
            Some(Bound::Member(set, i)) => l.symbols.sets[*set].labels[*i].clone(),
            Some(Bound::Number(e)) => l.exprs.as_const(*e).map_or_else(String::new, |x| x.to_string()),
            _ => name.text.clone(),
        });
    }
    structural::integer(l, e, place).map(|n| n.to_string())
}

/// `z.first`, `z.last`, `z.cells`, `z.number` as numbers.
fn domain_member(l: &mut Lowering<'_, '_>, base: &Expr, member: &str, place: &Place) -> Option<Value> {
    if !matches!(member, "first" | "last" | "cells" | "number") {
        return None;
    }
    if let (Some(set), "first" | "last") = (l.symbols.set_of(base, place), member) {
        return set_end(l, set, member == "last", base);
    }
    let domain = l.symbols.domain_of(base, place)?;
    if member == "number" {
        return Some(match cell_number(base, place) {
            Some(cell) => l.values().run_value(cell.shifted(1)),
            None => l.fault(
                Diagnostic::error(codes::WRONG_SHAPE, "a cell has a number where the index is bound by `for`", base.span)
                    .label("stands for no cell here"),
            ),
        });
    }
    let number = if member == "first" { 1 } else { l.symbols.domains[domain].cells };
    let expr = l.exprs.constant(number as f64);
    Some(Value::bare(expr))
}

/// The first or last number of a set of numbers.
fn set_end(l: &mut Lowering<'_, '_>, set: SetId, last: bool, base: &Expr) -> Option<Value> {
    let known = &l.symbols.sets[set];
    let number = match known.first {
        Some(first) if last => first + known.labels.len() as i64 - 1,
        Some(first) => first,
        None => {
            let (name, end) = (known.name.clone(), if last { known.labels.last() } else { known.labels.first() });
            let help = end.map(|end| format!("name the member: `{end}`"));
            let fault = Diagnostic::error(codes::WRONG_KIND, format!("`{name}` is a set of names, which have no numbers"), base.span);
            return Some(l.fault(fault.maybe_help(help)));
        }
    };
    let expr = l.exprs.constant(number as f64);
    Some(Value::bare(expr))
}

impl Symbols<'_> {
    /// The set that a name is, or over which it runs, without a report where it is something else.
    fn set_of(&self, e: &Expr, place: &Place) -> Option<SetId> {
        let ExprKind::Name(name) = &e.kind else { return None };
        match place.bound(&name.text) {
            Some(Bound::Member(set, _) | Bound::Axis(Axis::Set(set))) => Some(*set),
            Some(Bound::Run(_)) | None => match self[self.lookup(place.scope, &name.text)?].kind {
                SymbolKind::Set(set) => Some(set),
                _ => None,
            },
            Some(_) => None,
        }
    }

    /// The domain that a path names, without a report where it names something else.
    pub(in crate::elaborate) fn domain_of(&self, e: &Expr, place: &Place) -> Option<DomainId> {
        let symbol = match &e.kind {
            ExprKind::Name(name) => match place.bound(&name.text) {
                Some(Bound::Cell(domain, _) | Bound::Face(domain, _)) => return Some(*domain),
                Some(_) => return None,
                None => self.lookup(place.scope, &name.text)?,
            },
            ExprKind::Member(base, member) => {
                let ExprKind::Name(first) = &base.kind else { return None };
                let outer = self.lookup(place.scope, &first.text)?;
                let SymbolKind::Instance(scope) = self[outer].kind else { return None };
                *self.scopes[scope].names.get(&member.text)?
            }
            _ => return None,
        };
        match self[symbol].kind {
            SymbolKind::Domain(domain) => Some(domain),
            _ => None,
        }
    }
}
