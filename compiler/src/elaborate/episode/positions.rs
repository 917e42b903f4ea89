//! The order of states.

use crate::elaborate::lower::Lowering;
use crate::elaborate::symbols::{Axis, ScopeId, SymbolKind};
use crate::ir::{Role, VarId};
/// For each state variable the positions of its elements in the order of the outside: scopes in the order of the text; inside a scope
/// the arrays over one domain are taken together, cell after cell.
pub(in crate::elaborate) fn state_positions(l: &Lowering<'_, '_>) -> Vec<(VarId, Vec<u32>)> {
    let states = l.variables_of(Role::State);
    let mut positions: Vec<(VarId, Vec<u32>)> = states.iter().map(|&v| (v, vec![0_u32; l.symbols.vars[v].len as usize])).collect();
    let domain = |v: VarId| -> Option<(ScopeId, crate::elaborate::symbols::DomainId, usize, Vec<usize>)> {
        let symbol = *l.symbols.of_var.get(&v)?;
        let SymbolKind::Variable { axes, .. } = &l.symbols[symbol].kind else { return None };
        let at = axes.iter().position(|a| matches!(a, Axis::Domain(_)))?;
        let Axis::Domain(d) = axes[at] else { return None };
        let lens = axes.iter().map(|&a| l.symbols.axis_len(a) as usize).collect();
        Some((l.symbols[symbol].scope, d, at, lens))
    };
    let mut next = 0_u32;
    let mut i = 0;
    let mut done = vec![false; states.len()];
    while i < states.len() {
        if done[i] {
            i += 1;
            continue;
        }
        match domain(states[i]) {
            None => {
                for p in &mut positions[i].1 {
                    *p = next;
                    next += 1;
                }
                done[i] = true;
            }
            Some((scope, d, _, _)) => {
                let group: Vec<(usize, usize, Vec<usize>)> = (i..states.len())
                    .filter_map(|j| {
                        let (s, dj, at, lens) = domain(states[j])?;
                        (s == scope && dj == d && !done[j]).then_some((j, at, lens))
                    })
                    .collect();
                let cells = group.first().map_or(0, |(_, at, lens)| lens[*at]);
                for cell in 0..cells {
                    for (j, at, lens) in &group {
                        let inner: usize = lens[at + 1..].iter().product();
                        let outer: usize = lens[..*at].iter().product();
                        for o in 0..outer {
                            for k in 0..inner {
                                let element = (o * lens[*at] + cell) * inner + k;
                                positions[*j].1[element] = next;
                                next += 1;
                            }
                        }
                    }
                }
                for (j, ..) in &group {
                    done[*j] = true;
                }
            }
        }
        i += 1;
    }
    positions
}
