//! Index expressions: members, cells, whole numbers, and the addresses they make.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{self, BinaryOp, Expr, ExprKind, Form, Ident};

use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::loops::Cell;
use crate::elaborate::lower::place::{Bound, Place};
use crate::elaborate::lower::structural::integer;
use crate::elaborate::naming::Naming;
use crate::elaborate::select::items::reference;
use crate::elaborate::space::{field, grid};
use crate::elaborate::symbols::{Axis, DomainId, SetId, SymbolId, SymbolKind, Symbols};
use crate::ir::Affine;

/// The name of an index that stands for a face.
fn at_face<'e>(e: &'e Expr, place: &Place) -> Option<&'e str> {
    let ExprKind::Name(name) = &e.kind else { return None };
    matches!(place.bound(&name.text), Some(Bound::Face(..))).then_some(name.text.as_str())
}

/// Reports another number of indices than an array has.
fn wrong_indices(l: &mut Lowering<'_, '_>, symbol: SymbolId, axes: &[Axis], index: &[Expr], span: Span) {
    let path = l.symbols[symbol].path.clone();
    let declared = l.symbols[symbol].span;
    let wanted: Vec<&str> = axes.iter().map(|&a| l.symbols.axis_name(a)).collect();
    let message = match (axes.len(), index.len()) {
        (0, _) => format!("`{path}` is a scalar, it takes no index"),
        (n, 0) => format!("`{path}` is an array and needs {n} ind{}", if n == 1 { "ex" } else { "ices" }),
        (n, m) => format!("`{path}` takes {n} ind{}, not {m}", if n == 1 { "ex" } else { "ices" }),
    };
    let mut d = Diagnostic::error(codes::WRONG_SHAPE, message, span).secondary(declared, "declared here");
    if !wanted.is_empty() {
        d = d.help(format!("write `{path}[{}]`", wanted.join(", ")));
    }
    if index.is_empty() {
        d = crate::elaborate::built_ins::note(d, &path);
    }
    l.ledger.report(d);
}

/// Address of an element of an array, and what its indices are bound to.
pub(in crate::elaborate) fn address(
    l: &mut Lowering<'_, '_>,
    symbol: SymbolId,
    axes: &[Axis],
    index: &[Expr],
    span: Span,
    place: &Place,
) -> Option<(Affine, Vec<Bound>)> {
    if axes.len() != index.len() {
        wrong_indices(l, symbol, axes, index, span);
        return None;
    }
    if let Some(fault) = wrong_order(l, symbol, axes, index, span, place) {
        l.ledger.report(fault);
        return None;
    }
    let mut at = Affine::default();
    let mut bounds = Vec::with_capacity(axes.len());
    for (&axis, e) in axes.iter().zip(index) {
        let len = l.symbols.axis_len(axis);
        let (part, bound) = match axis {
            Axis::Set(set) => match l.run_index(e, place) {
                Some(numbers) => (l.naming().run_members(set, numbers)?.affine(), Bound::Run(numbers)),
                None => {
                    let i = member(l, set, e, place)?;
                    (Affine::constant(i as i64), Bound::Member(set, i))
                }
            },
            Axis::Domain(domain) => {
                let bound = cell(l, domain, e, place)?;
                let Bound::Cell(_, c) = bound else {
                    bounds.push(bound);
                    continue;
                };
                if c.first < 0 || c.last() >= len {
                    l.naming().out_of_domain(domain, c, e);
                    return None;
                }
                (c.affine(), bound)
            }
        };
        at = at.times(len).plus(part);
        bounds.push(bound);
    }
    Some((at, bounds))
}

/// Binding of an index along an axis.
pub(in crate::elaborate) fn bound_index(l: &mut Lowering<'_, '_>, axis: Axis, e: &Expr, place: &Place) -> Option<Bound> {
    match axis {
        Axis::Set(set) => match l.run_index(e, place) {
            Some(numbers) => Some(Bound::Run(numbers)),
            None => member(l, set, e, place).map(|i| Bound::Member(set, i)),
        },
        Axis::Domain(domain) => {
            let bound = cell(l, domain, e, place)?;
            if let Bound::Cell(_, c) = bound
                && (c.first < 0 || c.last() >= l.symbols.axis_len(axis))
            {
                l.naming().out_of_domain(domain, c, e);
                return None;
            }
            Some(bound)
        }
    }
}

/// The fault of indices that are those of an array in another order: some do not fit their axis,
/// and in another order all do.
fn wrong_order(l: &Lowering<'_, '_>, symbol: SymbolId, axes: &[Axis], index: &[Expr], span: Span, place: &Place) -> Option<Diagnostic> {
    if !(2..=4).contains(&axes.len()) {
        return None;
    }
    let fits = |axis: Axis, e: &Expr| match (&e.kind, axis) {
        (ExprKind::Name(name), Axis::Set(set)) => match place.bound(&name.text) {
            Some(Bound::Member(own, i)) => *own == set || l.symbols.sets[set].position(&l.symbols.sets[*own].labels[*i]).is_some(),
            Some(Bound::Run(_) | Bound::Number(_)) => l.symbols.sets[set].first.is_some(),
            Some(_) => false,
            None => l.symbols.sets[set].first.is_some() || l.symbols.sets[set].position(&name.text).is_some(),
        },
        (ExprKind::Name(name), Axis::Domain(_)) => match place.bound(&name.text) {
            Some(Bound::Member(own, _)) => l.symbols.sets[*own].first.is_some(),
            Some(_) => true,
            None => !l.symbols.sets.values().any(|set| set.position(&name.text).is_some()),
        },
        (ExprKind::Number { .. }, Axis::Set(set)) => l.symbols.sets[set].first.is_some(),
        _ => true,
    };
    if axes.iter().zip(index).all(|(&axis, e)| fits(axis, e)) {
        return None;
    }
    let order = permutations(axes.len()).into_iter().find(|order| axes.iter().zip(order).all(|(&axis, &at)| fits(axis, &index[at])))?;
    let names: Vec<&str> = axes.iter().map(|&axis| l.symbols.axis_name(axis)).collect();
    let path = &l.symbols[symbol].path;
    let written: Vec<String> = order.iter().map(|&at| reference(&index[at])).collect();
    let message = format!("the indices of `{path}` are in the wrong order: it is declared as `{path}[{}]`", names.join(", "));
    let fault = Diagnostic::error(codes::OUT_OF_RANGE, message, span).secondary(l.symbols[symbol].span, "declared here");
    let known = written.iter().all(|index| !index.contains("..."));
    Some(if known { fault.help(format!("write `{path}[{}]`", written.join(", "))) } else { fault })
}

/// All orders of the first `n` numbers.
fn permutations(n: usize) -> Vec<Vec<usize>> {
    let longer = |order: &Vec<usize>| -> Vec<Vec<usize>> {
        (0..n).filter(|i| !order.contains(i)).map(|i| [order.as_slice(), &[i]].concat()).collect()
    };
    (0..n).fold(vec![Vec::new()], |orders, _| orders.iter().flat_map(longer).collect())
}

/// Reports a name in an index position that nothing binds or declares, where the axis is one of
/// numbers; `false` where it has another meaning.
fn unbound_number(l: &mut Lowering<'_, '_>, axis: &str, e: &Expr, place: &Place) -> bool {
    let ExprKind::Name(name) = &e.kind else { return false };
    if place.bound(&name.text).is_some() || l.symbols.lookup(place.scope, &name.text).is_some() {
        return false;
    }
    if l.ledger.is_first_unbound(&name.text) {
        let built_in = matches!(name.text.as_str(), "n" | "steps" | "step" | "clock" | "e" | "pi");
        let fault = Diagnostic::error(codes::UNKNOWN_NAME, format!("`{}` is not bound here", name.text), name.span)
            .label("not an index of this statement")
            .help(format!("add it to the `for` of the statement: `for {} in {axis}`", name.text));
        let note = format!("`{}` alone is the built-in name", name.text);
        l.ledger.report(if built_in { fault.note(note) } else { fault });
    }
    true
}

/// Position of a member in its set.
pub(in crate::elaborate) fn member(l: &mut Lowering<'_, '_>, set: SetId, e: &Expr, place: &Place) -> Option<usize> {
    if let ExprKind::Name(name) = &e.kind {
        match place.bound(&name.text) {
            Some(Bound::Member(other, i)) if *other == set => return Some(*i),
            Some(Bound::Member(other, i)) => {
                let label = l.symbols.sets[*other].labels[*i].clone();
                return l.naming().labelled(set, &label, e.span);
            }
            // An element of a list, `for i in {D, E}`.
            Some(Bound::Alias(inner, scope, bindings)) => {
                let mut there = place.clone();
                (there.scope, there.bindings) = (*scope, bindings.clone());
                let inner = inner.clone();
                return member(l, set, &inner, &there);
            }
            Some(_) => {}
            None => {
                if let Some(i) = l.symbols.sets[set].position(&name.text) {
                    return Some(i);
                }
                if l.symbols.sets[set].first.is_none() {
                    let labels = &l.symbols.sets[set].labels;
                    let is_member = l.ledger.reports.did_you_mean(&name.text, labels.iter().map(String::as_str)).is_some();
                    if !is_member {
                        let over = l.symbols.sets[set].name.clone();
                        l.naming().not_bound(&name.text, &over, e.span);
                        return None;
                    }
                    return l.naming().labelled(set, &name.text, e.span);
                }
            }
        }
    }
    let name = l.symbols.sets[set].name.clone();
    if unbound_number(l, &name, e, place) {
        return None;
    }
    let n = integer(l, e, place)?;
    if let Some(first) = l.symbols.sets[set].first
        && let Some(i) = n.checked_sub(first).filter(|i| (0..l.symbols.sets[set].labels.len() as i64).contains(i))
    {
        return Some(i as usize);
    }
    l.naming().labelled(set, &n.to_string(), e.span)
}

/// A cell (or the face at which a flux is taken) of a domain.
fn cell(l: &mut Lowering<'_, '_>, domain: DomainId, e: &Expr, place: &Place) -> Option<Bound> {
    if let Some(numbers) = l.run_index(e, place) {
        if numbers.step < 0 {
            // Expressions in a cell read neighbours as if numbers rose.
            l.ledger.speculation.refuse();
            return None;
        }
        return Some(Bound::Cell(domain, numbers.shifted(-1)));
    }
    let known = match &e.kind {
        ExprKind::Member(base, member) if member.text == "number" => cell_number(base, place).map(|c| Some(Bound::Cell(domain, c))),
        ExprKind::Name(name) => bound_cell(l, domain, name, place),
        ExprKind::Binary(op @ (BinaryOp::Add | BinaryOp::Sub), a, b) => neighbour(l, domain, *op, (a, b), e.span, place),
        _ => None,
    };
    match known {
        Some(found) => found,
        None => Some(Bound::Cell(domain, Cell::single(integer(l, e, place)? - 1))),
    }
}

/// Meaning of the name of an index: `None` if it is not a cell, `Some(None)` if that was reported.
fn bound_cell(l: &mut Lowering<'_, '_>, domain: DomainId, name: &Ident, place: &Place) -> Option<Option<Bound>> {
    let (z, span) = (&name.text, name.span);
    match place.bound(z) {
        Some(Bound::Cell(other, c)) => {
            if same_cells(l, *other, domain) {
                return Some(Some(Bound::Cell(domain, *c)));
            }
            l.ledger.report(l.symbols.other_domain(*other, domain, span));
            Some(None)
        }
        Some(Bound::Face(other, c)) if *other == domain => Some(Some(Bound::Face(domain, *c))),
        None if l.symbols.domains[domain].name == *z => {
            if l.ledger.is_first_unbound(z) {
                l.ledger.report(
                    Diagnostic::error(codes::WRONG_SHAPE, format!("`{z}` is not bound here"), span)
                        .help(format!("add `for {z}` to the statement, or name a cell: `{z}.last`")),
                );
            }
            Some(None)
        }
        _ => None,
    }
}

/// `z + 1`, `z - 1`, `1 + z`: `None` where no cell is among the operands, `Some(None)` where a
/// fault was reported.
fn neighbour(
    l: &mut Lowering<'_, '_>,
    domain: DomainId,
    op: BinaryOp,
    (a, b): (&Expr, &Expr),
    span: Span,
    place: &Place,
) -> Option<Option<Bound>> {
    if let Some(z) = [a, b].into_iter().find_map(|side| at_face(side, place)) {
        l.ledger.report(
            Diagnostic::error(codes::WRONG_KIND, format!("inside of a flux `{z}` is a face, which has no neighbours by number"), span)
                .label("next to a face")
                .help(format!("`x[{z}]` is the value at the face by the domain's `scheme`, `grad(x[{z}])` the difference of the cells next to it over their distance")),
        );
        return Some(None);
    }
    let (from, by) = match op {
        _ if is_cell(a, place) => (a, b),
        BinaryOp::Add if is_cell(b, place) => (b, a),
        _ => return None,
    };
    let Some(Bound::Cell(_, c)) = cell(l, domain, from, place) else { return Some(None) };
    let by = integer(l, by, place).map(|by| if op == BinaryOp::Add { by } else { -by });
    Some(by.map(|by| Bound::Cell(domain, field::neighbours(l, domain, c.shifted(by)))))
}

/// Returns `true` if the cells of two domains are at the same places: equally many between the same
/// ends, whatever the parameters are.
pub(in crate::elaborate) fn same_cells<'a>(l: &mut Lowering<'_, 'a>, a: DomainId, b: DomainId) -> bool {
    if a == b || l.symbols.domains[a].cells != l.symbols.domains[b].cells {
        return a == b;
    }
    let ((unit, low, high), (other, first, last)) = (grid::ends(l, a), grid::ends(l, b));
    if l.values().convert(first, &other, &unit) != Some(low) || l.values().convert(last, &other, &unit) != Some(high) {
        return false;
    }
    let (a, b) = (&l.symbols.domains[a], &l.symbols.domains[b]);
    let grid = |d: &syntax::Domain| [&d.stretch, &d.faces].map(Option::is_some);
    let form = |e: &'a Option<Expr>| e.as_ref().map(Form::of);
    let (p, q) = (a.declaration, b.declaration);
    let written_alike = a.scope == b.scope && form(&p.stretch) == form(&q.stretch) && form(&p.faces) == form(&q.faces);
    written_alike || [grid(p), grid(q)] == [[false; 2]; 2]
}

fn is_cell(e: &Expr, place: &Place) -> bool {
    match &e.kind {
        ExprKind::Name(name) => matches!(place.bound(&name.text), Some(Bound::Cell(..))),
        ExprKind::Member(base, member) => member.text == "number" && cell_number(base, place).is_some(),
        ExprKind::Binary(BinaryOp::Add | BinaryOp::Sub, a, b) => is_cell(a, place) || is_cell(b, place),
        _ => false,
    }
}

impl<'a> Naming<'_, 'a> {
    fn out_of_domain(&mut self, domain: DomainId, c: Cell, index: &Expr) {
        let (name, cells) = (self.symbols.domains[domain].name.clone(), self.symbols.domains[domain].cells);
        let number = if c.first < 0 { c.first + 1 } else { c.last() + 1 };
        let rest = match (&index.kind, number < 1) {
            (ExprKind::Binary(..), true) => Some(format!("{}..{name}.last", 1 + (1 - number).min(cells))),
            (ExprKind::Binary(..), false) => Some(format!("1..{name}.last-{}", number - cells)),
            _ => None,
        };
        let message = format!("cell {number} of `{name}` does not exist: its cells are 1 to {cells}");
        self.ledger.report(
            Diagnostic::error(codes::OUT_OF_RANGE, message, index.span).label("reaches beyond the domain").maybe_help(
                rest.map(|range| format!("restrict the equation, `for {name} in {range}`, and write the other cells separately")),
            ),
        );
    }

    /// An index name that is neither bound nor a member: one report for a statement.
    fn not_bound(&mut self, name: &str, set: &str, span: Span) {
        if !self.ledger.is_first_unbound(name) {
            return;
        }
        let first = self.symbols.sets.values().find(|s| s.name == set).and_then(|s| s.labels.first().cloned());
        let advice = match first {
            // The set's own name: a member, or all of them.
            Some(member) if name == set => {
                format!(
                    "name a member, `[{member}]`; for every member add `for {name}` to the statement, or sum with `sum(... for {name})`"
                )
            }
            _ => format!("add `for {name} in {set}` to the statement"),
        };
        self.ledger.report(
            Diagnostic::error(codes::UNKNOWN_NAME, format!("`{name}` is neither bound by `for` nor a member of `{set}`"), span)
                .label("not bound here")
                .help(advice),
        );
    }

    fn labelled(&mut self, set: SetId, label: &str, span: Span) -> Option<usize> {
        let found = self.symbols.sets[set].position(label);
        if found.is_none() {
            let name = self.symbols.sets[set].name.clone();
            let help = self
                .ledger
                .reports
                .did_you_mean(label, self.symbols.sets[set].labels.iter().map(String::as_str))
                .filter(|_| self.symbols.sets[set].first.is_none());
            let members = &self.symbols.sets[set].labels;
            let members = match self.symbols.sets[set].first {
                Some(first) => format!("{first} to {}", first + members.len() as i64 - 1),
                None => crate::elaborate::symbols::listed(members.iter().map(String::as_str)),
            };
            self.ledger.report(
                Diagnostic::error(codes::OUT_OF_RANGE, format!("`{label}` is not a member of `{name}`: {members}"), span)
                    .label("not in the set")
                    .maybe_help(help),
            );
        }
        found
    }

    /// `i == water`, `scheme == upwind`: comparison of names. Outer `None`: not one; inner `None`:
    /// reported.
    pub(in crate::elaborate) fn name_comparison(&mut self, a: &Expr, b: &Expr, place: &Place) -> Option<Option<bool>> {
        let (left, right) = (self.symbols.label(a, place), self.symbols.label(b, place));
        let label = |e: &Expr| match &e.kind {
            ExprKind::Name(n) => Some(n.text.clone()),
            ExprKind::Bool(b) => Some(b.to_string()),
            _ => None,
        };
        match (left, right) {
            (Some((x, _)), Some((y, _))) => Some(Some(x == y)),
            (Some((x, options)), None) | (None, Some((x, options))) => {
                let other = if self.symbols.label(a, place).is_some() { b } else { a };
                let name = label(other)?;
                if options.contains(&name) {
                    return Some(Some(x == name));
                }
                let help = self.ledger.reports.did_you_mean(&name, options.iter().map(String::as_str));
                self.ledger.report(
                    Diagnostic::error(codes::UNKNOWN_NAME, format!("`{name}` is not one of {}", options.join(", ")), other.span)
                        .maybe_help(help),
                );
                Some(None)
            }
            _ => None,
        }
    }
}

impl<'a> Symbols<'a> {
    fn other_domain(&self, given: DomainId, wanted: DomainId, span: Span) -> Diagnostic {
        let (given, wanted) = (&self.domains[given], &self.domains[wanted]);
        let (a, b) = (&given.name, &wanted.name);
        let d = Diagnostic::error(codes::WRONG_SHAPE, format!("a cell of `{a}` where one of `{b}` is needed"), span);
        if given.cells != wanted.cells {
            return d.label(format!("`{a}` has {} cells, `{b}` {}", given.cells, wanted.cells));
        }
        d.label("cells of one number lie at different places")
            .secondary(given.declaration.name.span, "the index goes over this domain")
            .secondary(wanted.declaration.name.span, "the array over this one, which has other ends or another grid")
            .help(format!("write `{a}.number` for the cell of the same number"))
    }

    fn label(&self, e: &Expr, place: &Place) -> Option<(String, Vec<String>)> {
        let ExprKind::Name(name) = &e.kind else { return None };
        if let Some(bound) = place.bound(&name.text) {
            let Bound::Member(set, i) = bound else { return None };
            let set = &self.sets[*set];
            return set.first.is_none().then(|| (set.labels[*i].clone(), set.labels.clone()));
        }
        let symbol = self.lookup(place.scope, &name.text)?;
        match &self[symbol].kind {
            SymbolKind::Choice { options, chosen } => {
                let options: Vec<String> = options.iter().map(|o| o.text.clone()).collect();
                Some((options.get(*chosen)?.clone(), options))
            }
            _ => None,
        }
    }
}

impl Ledger {
    /// Returns `true` if an index name that is not bound is met for the first time in the present
    /// statement.
    fn is_first_unbound(&mut self, name: &str) -> bool {
        self.reports.is_first_unbound(name, self.speculation.is_active())
    }
}

/// The cell to which an index is bound.
pub(in crate::elaborate) fn cell_number(e: &Expr, place: &Place) -> Option<Cell> {
    let ExprKind::Name(name) = &e.kind else { return None };
    match place.bound(&name.text) {
        Some(Bound::Cell(_, cell)) => Some(*cell),
        _ => None,
    }
}
