//! Values that the equations and programs of a model read.

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::ir::{Affine, Expr, ExprId, Exprs, Flavour, MAX_DEPTH, Nest, Place, Program, Role, VarId};
use smpl_compiler::model::Model;

/// Returns `true` if `finish` or the algebraic outputs read a time derivative.
pub(super) fn finish_reads_derivatives(model: &CompiledModel) -> bool {
    let programs = &model.model().programs;
    reads_in(model.model(), values(&[&programs.finish, &programs.outputs]), Flavour::Derivative)
}

/// Returns `true` if an equation that determines an algebraic unknown reads a rate: the unknown is
/// as right as the rate then, not as the states are.
pub(super) fn algebraics_read_rates(model: &CompiledModel) -> bool {
    let model = model.model();
    let solved: HashSet<VarId> = model.interface.quantities.solved.iter().filter_map(|quantity| quantity.var).collect();
    let rows = model.rows.iter().filter(|row| solved.contains(&row.var));
    reads_in(model, rows.map(|row| row.residual).collect(), Flavour::Derivative)
}

/// Returns `true` if a step, or what it is judged by, reads the steady state.
pub(super) fn step_reads_steady(model: &CompiledModel) -> bool {
    let model = model.model();
    let p = &model.programs;
    let mut programs = vec![&p.initial_discretes, &p.disturb, &p.start, &p.end, &p.finish, &p.outputs];
    programs.extend(&p.events);
    let mut todo = values(&programs);
    todo.extend(model.rows.iter().map(|row| row.residual));
    todo.extend(model.roots.iter().map(|root| root.value));
    todo.extend(&model.quadratures);
    reads_in(model, todo, Flavour::Steady)
}

/// Returns `true` if anything reads values of a kind.
pub(super) fn reads(model: &CompiledModel, flavour: Flavour) -> bool {
    let model = model.model();
    let p = &model.programs;
    let mut programs = vec![
        &p.parameters,
        &p.initial_states,
        &p.initial_discretes,
        &p.disturb,
        &p.start,
        &p.end,
        &p.finish,
        &p.outputs,
        &p.invariants,
        &p.boxes,
    ];
    programs.extend(p.events.iter().chain(p.policies.iter().map(|(_, program)| program)));
    let mut todo = values(&programs);
    todo.extend(model.rows.iter().map(|row| row.residual));
    todo.extend(model.roots.iter().map(|root| root.value));
    todo.extend(&model.quadratures);
    reads_in(model, todo, flavour)
}

fn values(programs: &[&Program]) -> Vec<ExprId> {
    programs.iter().flat_map(|p| &p.nests).flat_map(|n| &n.stores).map(|s| s.value).collect()
}

/// Returns `true` if a value of a kind is read in some of these expressions.
fn reads_in(model: &Model, todo: Vec<ExprId>, wanted: Flavour) -> bool {
    any_expression(&model.exprs, todo, |expr| matches!(expr, Expr::Load { flavour, .. } if *flavour == wanted))
}

/// Returns `true` if something holds of some expression, or of one inside.
pub(super) fn any_expression(exprs: &Exprs, mut todo: Vec<ExprId>, mut holds: impl FnMut(&Expr) -> bool) -> bool {
    let mut seen = HashSet::new();
    while let Some(e) = todo.pop() {
        if !seen.insert(e) {
            continue;
        }
        if holds(&exprs.node(e)) {
            return true;
        }
        todo.extend(exprs.operands(e));
    }
    false
}

/// Returns `true` if the initial value of a discrete variable reads unknowns.
pub(super) fn discretes_read_unknowns(model: &CompiledModel) -> bool {
    let model = model.model();
    any_expression(&model.exprs, values(&[&model.programs.initial_discretes]), |expr| match expr {
        Expr::Load { flavour: Flavour::Value, var, .. } => matches!(model.vars[*var].role, Role::State | Role::Algebraic | Role::Delayed),
        Expr::Load { flavour, .. } => matches!(flavour, Flavour::Initial | Flavour::Previous),
        _ => false,
    })
}

/// States whose initial values read states: places of the former and of the latter in `y`.
pub(super) fn initial_reads(model: &CompiledModel) -> Vec<(Range<usize>, Range<usize>)> {
    let model = model.model();
    let mut next = 0;
    let mut first = HashMap::new();
    for &var in &model.unknowns {
        first.insert(var, next);
        next += i64::from(model.vars[var].len);
    }
    let is_state = |var: VarId| model.vars[var].role == Role::State;
    let mut found = Vec::new();
    for nest in &model.programs.initial_states.nests {
        let mut around = [None; MAX_DEPTH];
        nest.loops.iter().for_each(|&(d, extent)| around[usize::from(d)] = Some(extent));
        let places = |var: VarId, at: Affine| {
            let (low, high) = at.reach(&around);
            let last = i64::from(model.vars[var].len) - 1;
            (first[&var] + low.clamp(0, last)) as usize..(first[&var] + high.clamp(0, last) + 1) as usize
        };
        for store in &nest.stores {
            let Place::Var(of) = store.target.place else { continue };
            if is_state(of) {
                any_expression(&model.exprs, vec![store.value], |expr| {
                    if let Expr::Load { var, flavour: Flavour::Value, at } = *expr
                        && is_state(var)
                    {
                        found.push((places(of, store.target.at), places(var, at)));
                    }
                    false
                });
            }
        }
    }
    found
}

/// Number of elements whose initial value reads an algebraic unknown or a value at the start, and
/// one pass that finds them settled.
pub(super) fn start_passes(model: &CompiledModel) -> usize {
    let model = model.model();
    let programs = [&model.programs.initial_states, &model.programs.initial_discretes];
    // States that follow from constraints have their own initial values.
    let stores = model.programs.initial_states.nests.iter().flat_map(|nest| &nest.stores);
    let set: HashSet<VarId> = stores.filter_map(|store| if let Place::Var(var) = store.target.place { Some(var) } else { None }).collect();
    passes(model, &programs, |expr| match expr {
        Expr::Load { flavour: Flavour::Initial, .. } => true,
        Expr::Load { flavour: Flavour::Value, var, .. } => model.vars[*var].role == Role::Algebraic && !set.contains(var),
        _ => false,
    })
}

/// Number of states whose initial value reads a discrete variable or a disturbance, and one pass
/// that finds them settled.
pub(super) fn discrete_passes(model: &CompiledModel) -> usize {
    let model = model.model();
    passes(model, &[&model.programs.initial_states], |expr| match expr {
        Expr::Load { flavour: Flavour::Value, var, .. } => matches!(model.vars[*var].role, Role::Discrete | Role::Disturbance),
        _ => false,
    })
}

/// Number of elements whose value reads what has to settle, within reason, and one pass that finds
/// them settled; 0 where none does.
fn passes(model: &Model, programs: &[&Program], settles: impl Fn(&Expr) -> bool + Copy) -> usize {
    const MOST: usize = 50;
    let of_nest = |nest: &Nest| {
        let passes: usize = nest.extents().iter().map(|&n| n as usize).product();
        passes.saturating_mul(nest.stores.iter().filter(|s| any_expression(&model.exprs, vec![s.value], settles)).count())
    };
    match programs.iter().flat_map(|p| &p.nests).map(of_nest).fold(0, usize::saturating_add) {
        0 => 0,
        many => many.min(MOST) + 1,
    }
}
