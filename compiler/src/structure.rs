//! Structure analysis: which equation determines which unknown.
//!
//! 0. Ranges of numbers over which algebraic variables are defined element by element are written out.
//! 1. Equations that are linear in one derivative are solved for it; derivatives on right sides are replaced by their rates.
//! 2. Explicit algebraic variables are substituted, unless keeping one as an unknown makes the Jacobian sparser, or it closes a loop.
//! 3. What is left is matched: implicit equations to unknowns without an equation. What cannot be matched is reported by name:
//!    unknowns that nothing determines, equations too many, and equations that bind states only (index above 1).
//! 4. Loops of equations that are singular whatever the numbers are refused.
//!
//! Equations over cells are treated as wholes; the work grows with the text, not with the grid.

mod algebraic;
mod initial;
mod matching;
mod rates;
mod runs;
mod singular;
mod whole;

use smpl_dsl::diagnostic::Faults;

use crate::elaborate::{Elaborated, Equation, EquationForm};
use crate::ir::{Affine, Expr, ExprId, Exprs, Flavour, Role, VarId};
use crate::model::{Model, Row};

/// Analyses the equations and completes the model.
///
/// # Errors
/// Under- and over-determined parts and equations of high index, by name.
pub fn analyse(elaborated: Elaborated) -> Result<(Model, Faults), Faults> {
    let Elaborated { mut model, mut equations, runs, warnings } = elaborated;
    if runs {
        runs::write_out(&mut model, &mut equations);
    }
    rates::solve_for_derivatives(&mut model.exprs, &model.vars, &mut equations);
    let rates = rates::cover_states(&model, &equations)?;
    rates::substitute_derivatives(&mut model, &mut equations);
    let plan = algebraic::plan(&mut model, &mut equations);
    algebraic::substitute(&mut model, &mut equations, &plan);
    let rows = matching::rows(&mut model, equations, &plan, &rates)?;
    let faults = singular::singular_loops(&model, &rows);
    if !faults.is_empty() {
        return Err(faults.into());
    }
    model.explicit = is_explicit(&model.exprs, &model, &rows);
    model.rows = rows;
    initial::order(&mut model)?;
    Ok((model, warnings))
}

/// Whether every rate is `f(t, y) - y'` and nothing else mentions a derivative.
fn is_explicit(exprs: &Exprs, model: &Model, rows: &[Row]) -> bool {
    rows.iter().all(|row| {
        if model.vars[row.var].role != Role::State {
            return !exprs.has_derivative(row.residual);
        }
        match exprs.node(row.residual) {
            Expr::Binary(crate::ir::BinaryFn::Sub, value, own) => {
                let own_is =
                    matches!(exprs.node(own), Expr::Load { var, flavour: Flavour::Derivative, at } if var == row.var && at == row.at);
                own_is && !exprs.has_derivative(value)
            }
            // 0 - y'
            Expr::Unary(crate::ir::UnaryFn::Neg, own) => {
                matches!(exprs.node(own), Expr::Load { var, flavour: Flavour::Derivative, at } if var == row.var && at == row.at)
            }
            _ => false,
        }
    })
}

/// Distinct loads below a node that a filter accepts.
fn loads(exprs: &Exprs, e: ExprId, accept: impl Fn(VarId, Flavour) -> bool) -> Vec<(VarId, Flavour, Affine)> {
    loads_where(exprs, e, |_| true, accept)
}

/// Distinct derivatives below a node of variables that a filter accepts.
pub(crate) fn derivatives(exprs: &Exprs, e: ExprId, accept: impl Fn(VarId) -> bool) -> Vec<(VarId, Flavour, Affine)> {
    loads_where(exprs, e, |e| exprs.has_derivative(e), |var, flavour| flavour == Flavour::Derivative && accept(var))
}

fn loads_where(
    exprs: &Exprs,
    e: ExprId,
    concerned: impl Fn(ExprId) -> bool,
    accept: impl Fn(VarId, Flavour) -> bool,
) -> Vec<(VarId, Flavour, Affine)> {
    // One bit a node: operands stand before their users.
    let mut seen = vec![0u64; e.as_u32() as usize / 64 + 1];
    let mut stack = vec![e];
    let mut out = Vec::new();
    while let Some(e) = stack.pop() {
        let (word, bit) = (e.as_u32() as usize / 64, 1 << (e.as_u32() % 64));
        if !concerned(e) || seen.get(word).is_none_or(|seen| seen & bit != 0) {
            continue;
        }
        seen[word] |= bit;
        if let Expr::Load { var, flavour, at } = exprs.node(e)
            && accept(var, flavour)
        {
            out.push((var, flavour, at));
        }
        stack.extend(exprs.operands(e));
    }
    out.sort_unstable();
    out.dedup();
    out
}

/// Number of passes of a nest.
fn passes(extents: &[u32]) -> i64 {
    extents.iter().map(|&n| i64::from(n)).product()
}

/// Name of an element, as the outside knows it.
fn element_name(model: &Model, var: VarId, element: i64) -> String {
    let i = &model.interface;
    let lists = [&i.states, &i.algebraics, &i.solved];
    match lists.into_iter().flatten().find(|q| q.var == Some(var)) {
        Some(q) => q.element_name(element.max(0) as usize),
        None if model.vars[var].len == 1 => model.vars[var].name.clone(),
        None => format!("{}[{}]", model.vars[var].name, element + 1),
    }
}

/// Replaces nodes everywhere: equations, programs, roots, quadratures; only `concerned` nodes are looked at.
fn replace_everywhere(
    model: &mut Model,
    equations: &mut [Equation],
    done: &mut crate::ir::Rewritten,
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
    let p = &mut model.programs;
    let programs = [
        &mut p.parameters,
        &mut p.initial_states,
        &mut p.initial_discretes,
        &mut p.steady,
        &mut p.disturb,
        &mut p.start,
        &mut p.end,
        &mut p.finish,
        &mut p.outputs,
        &mut p.invariants,
        &mut p.boxes,
    ];
    for program in programs.into_iter().chain(&mut p.events).chain(p.policies.iter_mut().map(|(_, p)| p)) {
        for store in program.nests.iter_mut().flat_map(|n| &mut n.stores) {
            store.value = rewritten(store.value);
        }
    }
}
