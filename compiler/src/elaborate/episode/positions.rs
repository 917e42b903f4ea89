//! The order of states.

use crate::elaborate::lower::Lowering;
use crate::elaborate::symbols::{Axis, DomainId, ScopeId, SymbolKind};
use crate::ir::{Role, VarId};

/// A variable over a domain.
struct Field {
    scope: ScopeId,
    domain: DomainId,
    /// Axis of the domain.
    at: usize,
    /// Lengths of its axes.
    lens: Vec<usize>,
}

impl Field {
    fn of(l: &Lowering<'_, '_>, var: VarId) -> Option<Field> {
        let symbol = *l.symbols.of_var.get(&var)?;
        let SymbolKind::Variable { axes, .. } = &l.symbols[symbol].kind else { return None };
        let at = axes.iter().position(|a| matches!(a, Axis::Domain(_)))?;
        let Axis::Domain(domain) = axes[at] else { return None };
        let lens = axes.iter().map(|&a| l.symbols.axis_len(a) as usize).collect();
        Some(Field { scope: l.symbols[symbol].scope, domain, at, lens })
    }

    /// The elements that are in a cell, in their order.
    fn elements_of(&self, cell: usize) -> impl Iterator<Item = usize> {
        let inner: usize = self.lens[self.at + 1..].iter().product();
        let outer: usize = self.lens[..self.at].iter().product();
        let cells = self.lens[self.at];
        (0..outer).flat_map(move |o| (0..inner).map(move |k| (o * cells + cell) * inner + k))
    }
}

/// For each state variable the positions of its elements in the order of declaration. Scopes are in
/// the order of the text; inside a scope the arrays over one domain are taken together, cell after
/// cell.
pub(in crate::elaborate) fn state_positions(l: &Lowering<'_, '_>) -> Vec<(VarId, Vec<u32>)> {
    let states = l.variables_of(Role::State);
    let fields: Vec<Option<Field>> = states.iter().map(|&v| Field::of(l, v)).collect();
    let mut positions: Vec<(VarId, Vec<u32>)> = states.iter().map(|&v| (v, vec![0_u32; l.symbols.vars[v].len as usize])).collect();
    let mut positions_from = 0_u32..;
    let mut done = vec![false; states.len()];
    for i in 0..states.len() {
        if done[i] {
            continue;
        }
        let Some(first) = &fields[i] else {
            positions[i].1.iter_mut().zip(&mut positions_from).for_each(|(p, next)| *p = next);
            continue;
        };
        let beside = |f: &&Field| f.scope == first.scope && f.domain == first.domain;
        let group: Vec<(usize, &Field)> = (i..states.len()).filter_map(|j| Some((j, fields[j].as_ref().filter(beside)?))).collect();
        for cell in 0..first.lens[first.at] {
            for (j, field) in &group {
                field.elements_of(cell).zip(&mut positions_from).for_each(|(element, next)| positions[*j].1[element] = next);
            }
        }
        group.iter().for_each(|(j, _)| done[*j] = true);
    }
    positions
}
