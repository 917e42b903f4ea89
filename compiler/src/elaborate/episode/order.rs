//! Values that need each other, in an order in which they can be computed.

use std::collections::BTreeSet;

use cranelift_entity::PrimaryMap;
use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;

use crate::graph::{Order, after_needs};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, Flavour, Nest, Place, Role, Store, VarId};
use crate::model::Variable;

/// An element of a variable, or all of those that a loop passes.
type Element = (VarId, Affine);

/// The nests that write a variable, by their numbers, which grow.
#[derive(Default)]
struct WritersOfOne {
    /// In loops: each of them may write any element.
    loops: Vec<usize>,
    /// One element.
    elements: FastMap<Affine, Vec<usize>>,
    /// Any one element.
    single: Vec<usize>,
}

/// Nests by the elements that they write. Of two that write the same element the later one holds,
/// so that it has to follow; what follows the last of them follows all.
struct Writers {
    /// Elements that each nest writes.
    written: Vec<Vec<Element>>,
    of: FastMap<VarId, WritersOfOne>,
}

/// The last of growing numbers that is below a bound.
fn last_below(numbers: &[usize], bound: usize) -> Option<usize> {
    numbers[..numbers.partition_point(|&j| j < bound)].last().copied()
}

impl Writers {
    fn of(nests: &[Nest]) -> Self {
        let target = |s: &Store| match s.target.place {
            Place::Var(var) => Some((var, s.target.at)),
            _ => None,
        };
        let written: Vec<Vec<Element>> = nests.iter().map(|n| n.stores.iter().filter_map(target).collect()).collect();
        let mut of: FastMap<VarId, WritersOfOne> = FastMap::default();
        for (i, (var, at)) in written.iter().enumerate().flat_map(|(i, all)| all.iter().map(move |&w| (i, w))) {
            let of = of.entry(var).or_default();
            if at.is_constant() {
                of.elements.entry(at).or_default().push(i);
                of.single.push(i);
            } else {
                of.loops.push(i);
            }
        }
        Self { written, of }
    }

    /// Nests that must precede one that reads some elements.
    fn needs(&self, i: usize, reads: &[Element]) -> Vec<usize> {
        let own = self.written[i].iter().flat_map(|&w| self.before(i, w));
        let read = reads.iter().flat_map(|&r| self.of_read(i, r));
        let needs: BTreeSet<usize> = own.chain(read).collect();
        needs.into_iter().collect()
    }

    /// The last nests before one that write an element that it writes too.
    fn before(&self, i: usize, (var, at): Element) -> Vec<usize> {
        let Some(of) = self.of.get(&var) else { return Vec::new() };
        let within = last_below(&of.loops, i);
        if at.is_constant() {
            let alone = of.elements.get(&at).and_then(|list| last_below(list, i));
            return within.max(alone).into_iter().collect();
        }
        let from = of.single.partition_point(|&j| Some(j) < within);
        let until = of.single.partition_point(|&j| j < i);
        of.single[from.min(until)..until].iter().copied().chain(within).collect()
    }

    /// The last nests that write an element that one reads, of those that share no written element
    /// with it, which fixes their order.
    fn of_read(&self, i: usize, (var, at): Element) -> Vec<usize> {
        let Some(of) = self.of.get(&var) else { return Vec::new() };
        let own = || self.written[i].iter().filter(|w| w.0 == var);
        if own().any(|w| !w.1.is_constant()) {
            return Vec::new();
        }
        let last = |list: &[usize]| list.iter().rev().copied().find(|&j| !self.meet(i, j));
        let within = if own().next().is_none() { last(&of.loops) } else { None };
        let alone = |(at, list): (&Affine, &Vec<usize>)| if own().any(|w| w.1 == *at) { None } else { last(list) };
        if at.is_constant() {
            let alone = of.elements.get_key_value(&at).and_then(alone);
            return within.max(alone).into_iter().collect();
        }
        of.elements.iter().filter_map(alone).filter(|&j| Some(j) > within).chain(within).collect()
    }

    /// Returns `true` if two nests write an element both.
    fn meet(&self, i: usize, j: usize) -> bool {
        let meets = |a: &Element, b: &Element| a.0 == b.0 && (a.1 == b.1 || !a.1.is_constant() || !b.1.is_constant());
        self.written[i].iter().any(|v| self.written[j].iter().any(|w| meets(v, w)))
    }
}

/// States, and algebraic variables, which are written if they were declared as states.
pub(crate) const STATES: &[Role] = &[Role::State, Role::Algebraic];
/// Roles of the values that begin together with discrete variables.
pub(crate) const DISCRETES: &[Role] = &[Role::Discrete, Role::Disturbance];

/// Nests of initial values of some roles so that each follows those whose results it reads; scalars
/// that read nothing stay together, first. And those that need each other.
pub(crate) fn ordered_initial(
    nests: Vec<Nest>,
    exprs: &Exprs,
    vars: &PrimaryMap<VarId, Variable>,
    roles: &[Role],
) -> (Vec<Nest>, Vec<Diagnostic>) {
    let read_in = |e: ExprId| elements_read(exprs, vars, roles, e);
    let mut list = Vec::with_capacity(nests.len());
    for mut nest in nests {
        if nest.loops.is_empty() && nest.stores.len() > 1 {
            let (dependent, free): (Vec<Store>, Vec<Store>) =
                std::mem::take(&mut nest.stores).into_iter().partition(|s| !read_in(s.value).is_empty());
            nest.stores = free;
            list.push(nest);
            list.extend(dependent.into_iter().map(|s| Nest { loops: Vec::new(), stores: vec![s] }));
        } else {
            list.push(nest);
        }
    }
    let reads: Vec<Vec<Element>> = list.iter().map(|n| n.stores.iter().flat_map(|s| read_in(s.value)).collect()).collect();
    if reads.iter().all(Vec::is_empty) {
        return (list, Vec::new());
    }
    let writers = Writers::of(&list);
    let Order { order, closing } = after_needs(0..list.len(), |i| writers.needs(i, &reads[i]));
    let fault = |(i, j): (usize, usize)| {
        let names: Vec<String> =
            [i, j].iter().filter_map(|&k| writers.written[k].first()).map(|w| format!("`{}`", vars[w.0].name)).collect();
        let span = writers.written[i].first().map_or_else(Span::default, |w| vars[w.0].span);
        let message = format!("the initial values of {} need each other", names.join(" and "));
        Diagnostic::error(codes::CYCLIC_DEFINITION, message, span)
    };
    let faults = closing.into_iter().map(fault).collect();
    let mut slots: Vec<Option<Nest>> = list.into_iter().map(Some).collect();
    (order.into_iter().filter_map(|i| slots[i].take()).collect(), faults)
}

/// Elements of variables of some roles that an initial value reads.
fn elements_read(exprs: &Exprs, vars: &PrimaryMap<VarId, Variable>, roles: &[Role], e: ExprId) -> Vec<Element> {
    let read = |e: ExprId| match exprs.node(e) {
        Expr::Load { var, flavour: Flavour::Value, at } if roles.contains(&vars[var].role) => Some((var, at)),
        _ => None,
    };
    exprs.below([e]).filter_map(read).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::ir::Target;

    /// One of two variables: one of three elements, or all of them.
    fn element() -> impl Strategy<Value = Element> {
        (0..2u32, prop::option::of(0..3i64)).prop_map(|(var, at)| {
            let mut all = Affine::constant(0);
            all.strides[0] = 1;
            (VarId::from_u32(var), at.map_or(all, Affine::constant))
        })
    }

    fn nest(written: &[Element]) -> Nest {
        let value = ExprId::from_u32(0);
        let store = |&(var, at): &Element| Store { target: Target { place: Place::Var(var), at }, value };
        Nest { loops: Vec::new(), stores: written.iter().map(store).collect() }
    }

    proptest! {
        /// The few needs that are kept order the nests as all of them would.
        #[test]
        fn what_follows_the_last_writer_follows_all(
            list in prop::collection::vec((prop::collection::vec(element(), 1..3), prop::collection::vec(element(), 0..3)), 1..12),
        ) {
            let nests: Vec<Nest> = list.iter().map(|(written, _)| nest(written)).collect();
            let writers = Writers::of(&nests);
            let meets = |a: &Element, b: &Element| a.0 == b.0 && (a.1 == b.1 || !a.1.is_constant() || !b.1.is_constant());
            let all = |i: usize| -> Vec<usize> {
                let own = |j: usize| list[j].0.iter().any(|w| list[i].0.iter().any(|v| meets(v, w)));
                let read = |j: usize| list[i].1.iter().any(|r| list[j].0.iter().any(|w| meets(r, w)));
                (0..list.len()).filter(|&j| j != i && if own(j) { j < i } else { read(j) }).collect()
            };
            let everything = after_needs(0..list.len(), all);
            let found = after_needs(0..list.len(), |i| writers.needs(i, &list[i].1));
            prop_assert_eq!(everything.closing.is_empty(), found.closing.is_empty());
            if found.closing.is_empty() {
                let place = |i: usize| found.order.iter().position(|&j| j == i);
                for i in 0..list.len() {
                    prop_assert!(all(i).iter().all(|&j| place(j) < place(i)), "{i} in {:?}", found.order);
                }
            }
        }
    }

    /// Of all that write an element before it, a nest needs the last one only: thousands of starts
    /// of the same states are no work.
    #[test]
    fn needs_do_not_grow_with_the_square_of_the_nests() {
        let at = |k: usize| (VarId::from_u32(0), Affine::constant(k as i64 % 40));
        let nests: Vec<Nest> = (0..4000).map(|k| nest(&[at(k)])).collect();
        let writers = Writers::of(&nests);
        let needs: usize = (0..nests.len()).map(|i| writers.needs(i, &[at(i + 39)]).len()).sum();
        assert!(needs <= 2 * nests.len(), "{needs}");
    }
}
