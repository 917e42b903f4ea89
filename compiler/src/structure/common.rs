//! Common functions of several passes.

use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Affine, Expr, ExprId, Exprs, Nest, Place, Program, Rewritten, Store, Target, VarId};
use crate::model::{Failure, Model, Programs};

/// All programs of a model.
pub(super) fn programs(programs: &Programs) -> impl Iterator<Item = &Program> {
    programs.named().map(|(_, program)| program)
}

/// All programs of a model, to be changed.
pub(super) fn programs_mut(programs: &mut Programs) -> impl Iterator<Item = &mut Program> {
    programs.named_mut().map(|(_, program)| program)
}

/// Returns `true` if a program sets one of some variables.
pub(super) fn sets(program: &Program, one: impl Fn(VarId) -> bool) -> bool {
    let mut places = program.nests.iter().flat_map(|nest| &nest.stores).map(|store| store.target.place);
    places.any(|place| matches!(place, Place::Var(var) if one(var)))
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

/// Adds a failure that only its event finds, after those that the model declares.
pub(super) fn add_failure(model: &mut Model, name: String) -> u32 {
    let count = model.interface.finish.failures.len();
    let end = 2 * count as i64;
    for store in model.programs.finish.nests.iter_mut().flat_map(|nest| &mut nest.stores) {
        if store.target.place == Place::Out && store.target.at.offset >= end {
            store.target.at.offset += 2;
        }
    }
    let zero = model.exprs.constant(0.0);
    let store = |k: i64| Store { target: Target::out(Affine::constant(end + k)), value: zero };
    model.programs.finish.nests.push(Nest { loops: Vec::new(), stores: vec![store(0), store(1)] });
    let is_taken = |name: &str| model.interface.finish.failures.iter().any(|failure| failure.name == name);
    let name = (1..).map(|k| if k == 1 { name.clone() } else { format!("{name}_{k}") }).find(|name| !is_taken(name)).unwrap_or(name);
    model.interface.finish.failures.push(Failure { name, text: String::new(), event: true, items: Vec::new(), on_reward: false });
    count as u32
}
