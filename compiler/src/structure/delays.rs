//! Delayed expressions that nothing reads: what attempts to keep a loop, and loops that were cut,
//! have left behind.

use super::common::{programs, replace_everywhere};
use crate::elaborate::Equation;
use crate::ir::{Affine, DELAY_SLOTS, Expr, ExprId, FastSet, Flavour, Program, Rewritten, Role, VarId};
use crate::model::Model;

/// Removes the delayed expressions that neither an equation nor a program reads, nor one that is
/// read.
pub(crate) fn drop_unused(model: &mut Model, equations: &mut [Equation]) {
    let Some(var) = model.vars.iter().find(|(_, v)| v.role == Role::Delayed).map(|(var, _)| var) else { return };
    if model.delays.is_empty() {
        return;
    }
    let used = used(model, equations, var);
    if !used.contains(&false) {
        return;
    }
    let mut shifts = Vec::new();
    let (mut first, mut removed) = (0, 0);
    for (delay, &used) in model.delays.iter().zip(&used) {
        let count = i64::from(delay.count * DELAY_SLOTS);
        shifts.push((first..first + count, removed));
        first += count;
        removed += if used { 0 } else { count };
    }
    keep(model, &used);
    model.vars[var].len -= removed as u32;
    replace_everywhere(model, equations, &mut Rewritten::default(), &|_, _| true, &mut |exprs, node| match node {
        Expr::Load { var: read, flavour, at } if read == var => {
            let (_, before) = shifts.iter().find(|(range, _)| range.contains(&at.offset))?;
            Some(exprs.load(var, flavour, at.plus(Affine::constant(-before))))
        }
        _ => None,
    });
}

/// Keeps some of the delayed expressions.
fn keep(model: &mut Model, used: &[bool]) {
    let mut first = 0;
    let mut parts = Vec::new();
    let mut removed = 0;
    for (delay, &used) in model.delays.iter().zip(used) {
        let count = i64::from(delay.count);
        parts.push((first..first + count, removed, used));
        first += count;
        removed += if used { 0 } else { count };
    }
    let kept = |program: &mut Program| {
        program.nests.retain_mut(|nest| {
            let at = nest.stores[0].target.at.offset;
            let Some((_, removed, used)) = parts.iter().find(|(range, ..)| range.contains(&at)) else { return false };
            nest.stores.iter_mut().for_each(|store| store.target.at.offset -= removed);
            *used
        });
    };
    [&mut model.programs.delayed, &mut model.programs.lags, &mut model.programs.before].into_iter().for_each(kept);
    let mut each = used.iter();
    model.delays.retain(|_| each.next() == Some(&true));
}

/// Delayed expressions that are read, from the equations on.
fn used(model: &Model, equations: &[Equation], var: VarId) -> Vec<bool> {
    let own = [&model.programs.delayed, &model.programs.lags, &model.programs.before];
    let is_own = |program: &Program| own.iter().any(|own| std::ptr::eq(*own, program));
    let values = |program: &Program| program.nests.iter().flat_map(|nest| &nest.stores).map(|s| s.value).collect::<Vec<_>>();
    let mut open: Vec<ExprId> = equations.iter().map(|equation| equation.form.value()).collect();
    open.extend(model.roots.iter().map(|root| root.value).chain(model.quadratures.iter().copied()));
    open.extend(programs(&model.programs).filter(|program| !is_own(program)).flat_map(values));
    let mut ends = Vec::new();
    for delay in &model.delays {
        ends.push(ends.last().copied().unwrap_or(0) + i64::from(delay.count));
    }
    let number = |element: i64| ends.partition_point(|&end| end <= element);
    let mut used = vec![false; model.delays.len()];
    let mut seen: FastSet<ExprId> = FastSet::default();
    while let Some(value) = open.pop() {
        if !seen.insert(value) {
            continue;
        }
        for (_, _, at) in model.exprs.loads(value, |read, flavour| read == var && flavour == Flavour::Value) {
            let read = number(at.offset / i64::from(DELAY_SLOTS));
            if read < used.len() && !std::mem::replace(&mut used[read], true) {
                let stores = own.iter().flat_map(|program| program.nests.iter().flat_map(|nest| &nest.stores));
                let of_it = stores.filter(|store| number(store.target.at.offset) == read);
                open.extend(of_it.map(|store| store.value));
            }
        }
    }
    used
}
