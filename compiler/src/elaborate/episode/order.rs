//! Values that need each other, in an order in which they can be computed.

use cranelift_entity::PrimaryMap;
use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;

use crate::graph::{Order, after_needs};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastSet, Flavour, Nest, Place, Role, Store, VarId};
use crate::model::Variable;

/// Nests of initial values so that each follows those whose results it reads; scalars that read nothing stay together, first. And
/// those that need each other.
pub fn ordered_initial(nests: Vec<Nest>, exprs: &Exprs, vars: &PrimaryMap<VarId, Variable>) -> (Vec<Nest>, Vec<Diagnostic>) {
    let states_read = |e: ExprId| states_read(exprs, vars, e);
    let mut list = Vec::with_capacity(nests.len());
    for mut nest in nests {
        if nest.extents.is_empty() && nest.stores.len() > 1 {
            let (dependent, free): (Vec<Store>, Vec<Store>) =
                std::mem::take(&mut nest.stores).into_iter().partition(|s| !states_read(s.value).is_empty());
            nest.stores = free;
            list.push(nest);
            list.extend(dependent.into_iter().map(|s| Nest { extents: Vec::new(), stores: vec![s] }));
        } else {
            list.push(nest);
        }
    }
    let reads: Vec<Vec<(VarId, Affine)>> = list.iter().map(|n| n.stores.iter().flat_map(|s| states_read(s.value)).collect()).collect();
    if reads.iter().all(Vec::is_empty) {
        return (list, Vec::new());
    }
    let writes: Vec<Vec<(VarId, Affine)>> = list
        .iter()
        .map(|n| {
            let target = |s: &Store| match s.target.place {
                Place::Var(var) => Some((var, s.target.at)),
                _ => None,
            };
            n.stores.iter().filter_map(target).collect()
        })
        .collect();
    let meets = |a: &(VarId, Affine), b: &(VarId, Affine)| a.0 == b.0 && (a.1 == b.1 || !a.1.is_constant() || !b.1.is_constant());
    let needs = |i: usize| {
        let own = |j: usize| writes[j].iter().any(|w| writes[i].iter().any(|v| meets(v, w)));
        let read = |j: usize| reads[i].iter().any(|r| writes[j].iter().any(|w| meets(r, w)));
        // Of two that write the same element the later one holds.
        (0..list.len()).filter(|&j| j != i && if own(j) { j < i } else { read(j) }).collect()
    };
    let Order { order, closing } = after_needs(0..list.len(), needs);
    let fault = |(i, j): (usize, usize)| {
        let names: Vec<String> = [i, j].iter().filter_map(|&k| writes[k].first()).map(|w| format!("`{}`", vars[w.0].name)).collect();
        let span = writes[i].first().map_or_else(Span::default, |w| vars[w.0].span);
        let message = format!("the initial values of {} need each other", names.join(" and "));
        Diagnostic::error(codes::CYCLIC_DEFINITION, message, span)
    };
    let faults = closing.into_iter().map(fault).collect();
    let mut slots: Vec<Option<Nest>> = list.into_iter().map(Some).collect();
    (order.into_iter().filter_map(|i| slots[i].take()).collect(), faults)
}

/// States that an initial value reads.
fn states_read(exprs: &Exprs, vars: &PrimaryMap<VarId, Variable>, e: ExprId) -> Vec<(VarId, Affine)> {
    let mut seen = FastSet::default();
    let mut stack = vec![e];
    let mut out = Vec::new();
    while let Some(e) = stack.pop() {
        if !seen.insert(e) {
            continue;
        }
        if let Expr::Load { var, flavour: Flavour::Value, at } = exprs.node(e)
            && vars[var].role == Role::State
        {
            out.push((var, at));
        }
        stack.extend(exprs.operands(e));
    }
    out
}
