//! Common functions of several passes.

use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Expr, ExprId, Exprs, Program, Rewritten, VarId};
use crate::model::{Model, Programs};

/// All programs of a model.
pub(super) fn programs(programs: &Programs) -> impl Iterator<Item = &Program> {
    programs.named().map(|(_, program)| program)
}

/// All programs of a model, to be changed.
pub(super) fn programs_mut(programs: &mut Programs) -> impl Iterator<Item = &mut Program> {
    programs.named_mut().map(|(_, program)| program)
}

/// Number of passes of a nest.
pub(super) fn passes(extents: &[u32]) -> i64 {
    extents.iter().map(|&n| i64::from(n)).product()
}

/// Name of an element, as the outside knows it.
pub(super) fn element_name(model: &Model, var: VarId, element: i64) -> String {
    let i = &model.interface;
    let lists = [&i.quantities.states, &i.quantities.algebraics, &i.quantities.solved];
    match lists.into_iter().flatten().find(|q| q.var == Some(var)) {
        Some(q) => q.element_name(element.max(0) as usize),
        None if model.vars[var].len == 1 => model.vars[var].name.clone(),
        None => format!("{}[{}]", model.vars[var].name, element + 1),
    }
}

/// Replaces nodes everywhere: equations, programs, roots, quadratures; only `concerned` nodes are
/// looked at.
pub(super) fn replace_everywhere(
    model: &mut Model,
    equations: &mut [Equation],
    done: &mut Rewritten,
    concerned: &dyn Fn(&Exprs, ExprId) -> bool,
    replace: &mut dyn FnMut(&mut Exprs, Expr) -> Option<ExprId>,
) {
    let exprs = &mut model.exprs;
    let mut rewritten = |e: ExprId| exprs.rewrite_where(e, done, concerned, replace);
    for equation in equations.iter_mut() {
        match &mut equation.form {
            EquationForm::Rate { value, .. } | EquationForm::Definition { value, .. } => *value = rewritten(*value),
            EquationForm::Implicit { residual } => *residual = rewritten(*residual),
        }
    }
    for root in &mut model.roots {
        root.value = rewritten(root.value);
    }
    for quadrature in &mut model.quadratures {
        *quadrature = rewritten(*quadrature);
    }
    for program in programs_mut(&mut model.programs) {
        for store in program.nests.iter_mut().flat_map(|n| &mut n.stores) {
            store.value = rewritten(store.value);
        }
    }
}
