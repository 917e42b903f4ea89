//! Invariants of expressions: existing operands of the right kind, addresses inside of arrays.

use cranelift_entity::EntityRef;

use super::{Checked, ensure, known, violation};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastSet, Flavour, Loops, MAX_DEPTH, Role, VarId, loops_of};
use crate::model::Model;

/// Name of a place, made for a message only.
type PlaceName<'p> = &'p dyn Fn() -> String;

/// Checks of what is evaluated; remembers what it has seen.
pub(super) struct ValueCheck<'m> {
    model: &'m Model,
    seen: FastSet<(ExprId, Loops)>,
}

impl<'m> ValueCheck<'m> {
    pub(super) fn new(model: &'m Model) -> Self {
        ValueCheck { model, seen: FastSet::default() }
    }

    /// An expression that is a number.
    pub(super) fn number(&mut self, place: PlaceName<'_>, value: ExprId, extents: &[u32]) -> Checked {
        self.any(place, value, extents)?;
        ensure(!self.model.exprs.is_truth(value), place, || format!("node {} is a truth value, a number is expected", value.index()))
    }

    /// An expression, evaluated in loops of some extents.
    pub(super) fn any(&mut self, place: PlaceName<'_>, value: ExprId, extents: &[u32]) -> Checked {
        let exprs = &self.model.exprs;
        ensure(value.index() < exprs.len(), place, || format!("there is no node {}, there are {}", value.index(), exprs.len()))?;
        ensure(extents.len() <= MAX_DEPTH, place, || format!("more than {MAX_DEPTH} loops inside one another"))?;
        let mut stack = vec![(value, loops_of(extents))];
        while let Some((id, loops)) = stack.pop() {
            if !self.seen.insert((id, free_only(exprs, id, loops))) {
                continue;
            }
            self.node(place, id, &loops)?;
            match exprs.node(id) {
                Expr::Reduce { depth, extent, body, .. } => {
                    let mut inner = loops;
                    inner[usize::from(depth.0)] = Some(extent);
                    stack.push((body, inner));
                }
                _ => stack.extend(exprs.operands(id).map(|operand| (operand, loops))),
            }
        }
        Ok(())
    }

    fn node(&self, place: PlaceName<'_>, id: ExprId, loops: &Loops) -> Checked {
        let exprs = &self.model.exprs;
        for operand in exprs.operands(id) {
            ensure(operand < id, place, || format!("node {} uses node {} behind it", id.index(), operand.index()))?;
        }
        let node = exprs.node(id);
        let truths = match node {
            Expr::And(..) | Expr::Or(..) | Expr::Not(_) => [true; 3],
            Expr::Select(..) => [true, false, false],
            _ => [false; 3],
        };
        let mut operands = exprs.operands(id).zip(truths);
        if let Some((operand, truth)) = operands.find(|&(operand, truth)| exprs.is_truth(operand) != truth) {
            let (found, expected) = if truth { ("a number", "a truth value") } else { ("a truth value", "a number") };
            return violation(place(), format!("node {} is {found}, node {} expects {expected}", operand.index(), id.index()));
        }
        match node {
            Expr::Counter(counter) => ensure(loops.get(usize::from(counter.0)).is_some_and(Option::is_some), place, || {
                format!("counter {} is used outside of its loop", counter.0)
            }),
            Expr::Load { var, flavour, at } => self.load(place, (var, flavour, at), loops),
            Expr::Reduce { depth, .. } => {
                ensure(usize::from(depth.0) < MAX_DEPTH, place, || format!("there is no loop at depth {}", depth.0))
            }
            Expr::Entry(list, _) => ensure(exprs.lists().has(list), place, || "there is no such list".into()),
            Expr::Passed(list, ..) => {
                let limits = exprs.lists().of(list);
                let fit = exprs.lists().has(list) && limits.iter().all(|x| x.is_finite()) && limits.is_sorted();
                ensure(fit, place, || "limits are not finite numbers in ascending order".into())
            }
            _ => Ok(()),
        }
    }

    fn load(&self, place: PlaceName<'_>, (var, flavour, at): (VarId, Flavour, Affine), loops: &Loops) -> Checked {
        let variable = &self.model.vars[known(self.model, place, var)?];
        let has = match (variable.role, flavour) {
            (_, Flavour::Value) | (Role::State | Role::Algebraic, _) => true,
            (Role::Action | Role::Discrete | Role::Disturbance, flavour) => flavour != Flavour::Derivative,
            _ => false,
        };
        ensure(has, place, || format!("variable {} (`{}`) has no copy {flavour:?}", var.index(), variable.name))?;
        inside(place, &variable.name, at, loops, variable.len)
    }

    /// An element of a variable that loops of some extents reach.
    pub(super) fn element(&self, place: PlaceName<'_>, var: VarId, at: Affine, extents: &[u32]) -> Checked {
        let variable = &self.model.vars[known(self.model, place, var)?];
        inside(place, &variable.name, at, &loops_of(extents), variable.len)
    }
}

/// The loops that a node depends on.
fn free_only(exprs: &Exprs, id: ExprId, mut loops: Loops) -> Loops {
    let free = exprs.free(id);
    loops.iter_mut().enumerate().filter(|(d, _)| free & (1 << d) == 0).for_each(|(_, l)| *l = None);
    loops
}

/// An address stays in an array of some elements, for all values of the counters.
pub(super) fn inside(place: PlaceName<'_>, name: &str, address: Affine, loops: &Loops, len: u32) -> Checked {
    let (mut low, mut high) = (i128::from(address.offset), i128::from(address.offset));
    for (d, &stride) in address.strides.iter().enumerate().filter(|(_, s)| **s != 0) {
        match loops[d] {
            None => return violation(place(), format!("`{name}`: an address follows counter {d} outside of its loop")),
            Some(0) => return Ok(()),
            Some(extent) => {
                let reach = i128::from(stride) * i128::from(extent - 1);
                low += reach.min(0);
                high += reach.max(0);
            }
        }
    }
    ensure(low >= 0 && high < i128::from(len), place, || format!("`{name}`: elements {low} to {high} of {len}"))
}
