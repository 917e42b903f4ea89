//! Open-loop policies and invariants.

use smpl_dsl::syntax::{Expr, Statement, StatementKind};

use crate::elaborate::episode::common::{Given, each, store};
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, boxes, units};
use crate::elaborate::select::items::{Item, breadth};
use crate::elaborate::symbols::{ScopeId, SymbolKind};
use crate::ir::{Affine, ExprId, Nest, Place as Memory, Program, Role, VarId};
use crate::model::{Invariant, Quantity};

/// Policies by name, the nominal one first: those of components by the paths of their instances,
/// but what a component says of `nominal` is part of the model's nominal policy.
pub(in crate::elaborate) fn policies<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Vec<(String, Program)> {
    let actions: Vec<(VarId, i64)> =
        l.variables_of(Role::Action).into_iter().flat_map(|v| (0..i64::from(l.symbols.vars[v].len)).map(move |i| (v, i))).collect();
    let nominal: Vec<ExprId> = actions
        .iter()
        .map(|(var, i)| {
            let x = l.quantities.get(var).map_or(f64::NAN, |q| Quantity::pick(&q.default, *i as usize));
            l.exprs.constant(x)
        })
        .collect();
    let program = |values: &[ExprId]| Program {
        nests: vec![Nest {
            loops: Vec::new(),
            stores: values.iter().enumerate().map(|(i, &e)| store(Memory::Out, Affine::constant(i as i64), e)).collect(),
        }],
        in_place: false,
    };
    let mut list = vec![("nominal".to_owned(), program(&nominal))];
    let mut said_nominal = nominal.clone();
    for (scope, item) in each(blocks) {
        let Item::Other(Statement { kind: StatementKind::Policy { name, entries, .. }, .. }) = item else { continue };
        let place = Place::new(scope, Site::Instant);
        if name.text == "nominal" {
            policy_values(l, entries, &place, &actions, &mut said_nominal);
            list[0].1 = program(&said_nominal);
        } else {
            let mut values = nominal.clone();
            policy_values(l, entries, &place, &actions, &mut values);
            list.push((l.symbols.path_of(scope, name), program(&values)));
        }
    }
    list
}

/// Puts a policy's actions in the place of their values: the value of an element replaces that of
/// its array.
fn policy_values(l: &mut Lowering<'_, '_>, entries: &[(Expr, Expr)], place: &Place, actions: &[(VarId, i64)], values: &mut [ExprId]) {
    let mut wide_first: Vec<&(Expr, Expr)> = entries.iter().collect();
    wide_first.sort_by_key(|(target, _)| std::cmp::Reverse(breadth(target, &[])));
    let mut set = Given::default();
    for (target, e) in wide_first {
        let Some((symbol, at)) = boxes::target(l, target, place, &[Role::Action]) else { continue };
        let SymbolKind::Variable { var, unit, .. } = l.symbols[symbol].kind.clone() else { continue };
        let value = l.number_in(e, &unit, "the action", target.span, place);
        let elements = at.map_or(0..i64::from(l.symbols.vars[var].len), |at| at.offset..at.offset + 1);
        if !set.note(l, (var, elements.clone()), (0, breadth(target, &[])), target.span, "values in one policy") {
            continue;
        }
        for (slot, (v, i)) in values.iter_mut().zip(actions) {
            if *v == var && elements.contains(i) {
                *slot = value;
            }
        }
    }
}

/// Each invariant and its rate; what is seen of them.
pub(in crate::elaborate) fn invariants<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> (Program, Vec<Invariant>) {
    let mut stores = Vec::new();
    let mut names = Vec::new();
    for (scope, item) in each(blocks) {
        let Item::Other(Statement { kind: StatementKind::Invariant { name, value, rate, text }, .. }) = item else { continue };
        let place = Place::new(scope, Site::Instant);
        let v = l.value(value, &place);
        let unit = v.unit.unit();
        let rate_expr = match rate {
            Some(e) => {
                let wanted = units::rate(&unit, &l.symbols.time_unit);
                let r = l.value(e, &place);
                l.values().strictly_in(r, &wanted, e.span, &format!("the rate of `{}`", name.text), name.span)
            }
            None => l.exprs.constant(0.0),
        };
        for e in [v.expr, rate_expr] {
            stores.push(store(Memory::Out, Affine::constant(stores.len() as i64), e));
        }
        let name = l.symbols.path_of(scope, name);
        names.push(Invariant { name, text: text.clone().unwrap_or_default() });
    }
    (Program { nests: vec![Nest { loops: Vec::new(), stores }], in_place: false }, names)
}
