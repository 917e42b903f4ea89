//! Ranges of numbers that only count the cells of a domain: they stay loops.

use smpl_dsl::syntax::{Binder, BinderSet, Expr, ExprKind};

use crate::elaborate::lower::place::Place;
use crate::elaborate::symbols::{Axis, DomainId, SymbolKind, Symbols};

impl<'a> Symbols<'a> {
    /// For each binder over a range `low..high` whose index occurs in `parts` for cells of a domain
    /// and nowhere else, its name and the domain.
    pub(in crate::elaborate) fn counted_cells(&self, binders: &[Binder], parts: &[&Expr], place: &Place) -> Vec<(String, DomainId)> {
        let ranges = binders.iter().filter(|b| matches!(b.over, BinderSet::Range(..)));
        let counted = ranges.filter_map(|b| {
            let name = &b.name.text;
            let known = self.lookup(place.scope, name).is_some() || place.bound(name).is_some();
            let mut domain = None;
            let only = !known && parts.iter().all(|e| self.only_cells(e, name, place, &mut domain));
            domain.filter(|_| only).map(|d| (name.clone(), d))
        });
        counted.collect()
    }

    /// Returns `true` if every occurrence of a name is an index, on its own, along domains of
    /// equally many cells.
    fn only_cells(&self, e: &Expr, name: &str, place: &Place, domain: &mut Option<DomainId>) -> bool {
        match &e.kind {
            ExprKind::Name(n) => n.text != name,
            ExprKind::Index(base, index) => {
                let axes = self.axes_of(base, place);
                self.only_cells(base, name, place, domain)
                    && index.iter().enumerate().all(|(k, i)| match &i.kind {
                        ExprKind::Name(n) if n.text == name => match axes.and_then(|a| a.get(k)) {
                            Some(&Axis::Domain(here)) => {
                                let first = *domain.get_or_insert(here);
                                self.domains[first].cells == self.domains[here].cells
                            }
                            _ => false,
                        },
                        _ => self.only_cells(i, name, place, domain),
                    })
            }
            // These bind their own names or read neighbours: unrolled.
            ExprKind::Call { .. } | ExprKind::Reduce { .. } | ExprKind::Derivative(_) | ExprKind::Tuple(_) => false,
            _ => e.children().into_iter().all(|e| self.only_cells(e, name, place, domain)),
        }
    }

    /// Axes of the variable that `x` or `unit.x` names, without a report where it names something
    /// else.
    fn axes_of(&self, e: &Expr, place: &Place) -> Option<&[Axis]> {
        let symbol = match &e.kind {
            ExprKind::Name(n) if place.bound(&n.text).is_none() => self.lookup(place.scope, &n.text)?,
            ExprKind::Member(base, member) => {
                let ExprKind::Name(first) = &base.kind else { return None };
                let outer = self.lookup(place.scope, &first.text).filter(|_| place.bound(&first.text).is_none())?;
                let SymbolKind::Instance(scope) = self[outer].kind else { return None };
                *self.scopes[scope].names.get(&member.text)?
            }
            _ => return None,
        };
        match &self[symbol].kind {
            SymbolKind::Variable { axes, .. } => Some(axes),
            _ => None,
        }
    }
}
