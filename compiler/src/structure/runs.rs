//! Ranges of numbers that are unrolled after all.
//!
//! An algebraic variable that is defined as a whole by one loop is substituted as a whole. Elements
//! are substituted one by one if they are defined one by one, need each other, or are sums that a
//! loop would compute again in every pass. Every equation and sum that reads them must then name
//! them one by one.

use super::common::replace_everywhere;
use super::cuts::cut_at_parts;
use super::reads::looped_reads;
use super::whole::{Whole, wholes};
use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Expr, ExprId, Exprs, FastMap, FastSet, LoopVar, Rewritten, VarId};
use crate::model::Model;

/// Writes out the ranges over which elements of algebraic variables are defined or read one by one.
pub(crate) fn write_out(model: &mut Model, equations: &mut Vec<Equation>) {
    loop {
        cut_at_parts(model, equations);
        let scattered = scattered(model, equations);
        if scattered.is_empty() {
            return;
        }
        write_out_sums(model, equations, &scattered);
        let mut changed = false;
        for equation in std::mem::take(equations) {
            if equation.runs != 0 && touches(model, &equation, &scattered) {
                changed = true;
                passes_of(&mut model.exprs, equation, equations);
            } else {
                equations.push(equation);
            }
        }
        if !changed {
            return;
        }
    }
}

/// Algebraic variables whose elements are defined or read one by one, and not over the cells of a
/// domain.
fn scattered(model: &Model, equations: &[Equation]) -> FastSet<VarId> {
    let mut scattered: FastSet<VarId> = FastSet::default();
    let mut over_cells: FastSet<VarId> = FastSet::default();
    for equation in equations {
        if let EquationForm::Definition { var, .. } = equation.form {
            scattered.insert(var);
            if equation.extents.len() > equation.runs.count_ones() as usize {
                over_cells.insert(var);
            }
        }
    }
    let wholes = wholes(model, equations);
    let mut across: FastSet<VarId> = looped_reads(model, equations)
        .into_iter()
        .filter(|read| wholes.get(&read.var).is_some_and(|whole| !whole.holds(read.at, &read.loops)))
        .map(|read| read.var)
        .collect();
    across.extend(repeated(model, equations, &wholes));
    // Of the parts of arrays, those on a ring of definitions.
    let mut needs: FastMap<(VarId, usize), Vec<(VarId, usize)>> = FastMap::default();
    for (&var, whole) in &wholes {
        for (part, &i) in whole.equations.iter().enumerate() {
            let needed = model.exprs.loads(equations[i].form.value(), |v, _| wholes.contains_key(&v));
            let parts = needed.into_iter().filter_map(|(v, _, at)| Some((v, wholes[&v].locate(at)?.0)));
            needs.insert((var, part), parts.collect());
        }
    }
    loop {
        let used: FastSet<(VarId, usize)> = needs.values().flatten().copied().collect();
        let known: FastSet<(VarId, usize)> = needs.keys().copied().collect();
        needs.retain(|part, list| used.contains(part) && list.iter().any(|p| known.contains(p)));
        if needs.len() == known.len() {
            break;
        }
    }
    let ring: FastSet<VarId> = needs.keys().map(|(var, _)| *var).collect();
    let loops = |var: &VarId| wholes.contains_key(var) && !across.contains(var) && !ring.contains(var);
    scattered.retain(|var| model.vars[*var].len > 1 && !over_cells.contains(var) && !loops(var));
    scattered
}

/// Arrays defined with separate sums for each element that a loop would compute again in each pass
/// of a loop around it.
fn repeated(model: &Model, equations: &[Equation], wholes: &FastMap<VarId, Whole>) -> FastSet<VarId> {
    let exprs = &model.exprs;
    let mut with_sums: FastSet<VarId> = FastSet::default();
    loop {
        let before = with_sums.len();
        for (&var, whole) in wholes {
            let has = |e: ExprId| {
                let own = exprs.has_reduction(e, |free| free != 0);
                own || exprs.loads(e, |v, _| with_sums.contains(&v)).iter().any(|(_, _, at)| !at.is_constant())
            };
            if !with_sums.contains(&var) && whole.equations.iter().any(|&i| has(equations[i].form.value())) {
                with_sums.insert(var);
            }
        }
        if with_sums.len() == before {
            break;
        }
    }
    let mut out = FastSet::default();
    if with_sums.is_empty() {
        return out;
    }
    for e in (0..exprs.len() as u32).map(ExprId::from_u32) {
        if let Expr::Reduce { depth, body, .. } = exprs.node(e) {
            let read = exprs.loads(body, |v, _| with_sums.contains(&v));
            let inside = read.into_iter().filter(|(_, _, at)| at.strides[usize::from(depth.0)] != 0);
            out.extend(inside.filter(|(_, _, at)| exprs.free(e) & !at.counters() != 0).map(|l| l.0));
        }
    }
    for equation in equations.iter().filter(|e| e.extents.len() > 1) {
        let read = exprs.loads(equation.form.value(), |v, _| with_sums.contains(&v));
        let repeats = |bits: u8| (0..equation.extents.len()).any(|d| bits & (1 << d) != 0 && !bits & ((1 << d) - 1) != 0);
        out.extend(read.into_iter().filter(|(_, _, at)| repeats(at.counters())).map(|l| l.0));
    }
    out
}

/// Returns `true` if an equation defines an element of one of the variables, or reads one at an
/// address that its loops change.
fn touches(model: &Model, equation: &Equation, scattered: &FastSet<VarId>) -> bool {
    let defines = matches!(equation.form, EquationForm::Definition { var, .. } if scattered.contains(&var));
    defines || reads(&model.exprs, equation.form.value(), scattered)
}

/// Returns `true` if an expression reads an element of one of the variables at an address that
/// loops change.
fn reads(exprs: &Exprs, value: ExprId, scattered: &FastSet<VarId>) -> bool {
    exprs.loads(value, |v, _| scattered.contains(&v)).iter().any(|(_, _, at)| !at.is_constant())
}

/// One equation for each pass of the loops over numbers.
fn passes_of(exprs: &mut Exprs, equation: Equation, out: &mut Vec<Equation>) {
    let Some(d) = (0..equation.extents.len()).rev().find(|d| equation.runs & (1 << d) != 0) else {
        out.push(equation);
        return;
    };
    // Loops over cells keep their counters: a single pass takes the place of the loop, unless no
    // loop is left.
    let mut extents = equation.extents.clone();
    extents[d] = 1;
    if extents.iter().all(|&n| n == 1) {
        extents.clear();
    }
    for pass in 0..i64::from(equation.extents[d]) {
        let value = exprs.shift(equation.form.value(), LoopVar(d as u8), pass);
        let form = match equation.form {
            EquationForm::Rate { var, at, .. } => EquationForm::Rate { var, at: at.at_pass(d, pass), value },
            EquationForm::Definition { var, at, .. } => EquationForm::Definition { var, at: at.at_pass(d, pass), value },
            EquationForm::Implicit { .. } => EquationForm::Implicit { residual: value },
        };
        let one = Equation { extents: extents.clone(), runs: equation.runs & !(1 << d), repeats: None, form, span: equation.span };
        passes_of(exprs, one, out);
    }
}

/// Writes out all sums whose counter goes through elements of the variables.
fn write_out_sums(model: &mut Model, equations: &mut [Equation], scattered: &FastSet<VarId>) {
    let mut within: Vec<bool> = Vec::with_capacity(model.exprs.len());
    for e in (0..model.exprs.len() as u32).map(ExprId::from_u32) {
        let own = matches!(model.exprs.node(e), Expr::Load { var, at, .. } if scattered.contains(&var) && !at.is_constant());
        within.push(own || model.exprs.operands(e).any(|o| within[o.as_u32() as usize]));
    }
    let concerned = |_: &Exprs, e: ExprId| within.get(e.as_u32() as usize).copied().unwrap_or(true);
    replace_everywhere(model, equations, &mut Rewritten::default(), &concerned, &mut |exprs, node| written_out(exprs, node, scattered));
}

/// The terms of a reduction over elements of the variables.
fn written_out(exprs: &mut Exprs, node: Expr, scattered: &FastSet<VarId>) -> Option<ExprId> {
    let Expr::Reduce { op, depth, extent, body } = node else { return None };
    let through = exprs.loads(body, |v, _| scattered.contains(&v)).iter().any(|(_, _, at)| at.strides[usize::from(depth.0)] != 0);
    if !through {
        return None;
    }
    let mut total = None;
    for pass in 0..i64::from(extent) {
        let term = exprs.shift(body, depth, pass);
        let term = exprs.rewrite(term, &mut Rewritten::default(), &mut |exprs, node| written_out(exprs, node, scattered));
        total = Some(total.map_or(term, |t| exprs.binary(op.binary(), t, term)));
    }
    Some(total.unwrap_or_else(|| exprs.constant(op.identity())))
}
