//! Index reduction: systems in which equations bind states.
//!
//! 1. Rates of states are explicit, `x' = f(t, x, z)`; any other rate becomes an unknown.
//! 2. [`pantelides`] differentiates equations until those of highest order determine the unknowns
//!    of highest order.
//! 3. [`demote`] lets one unknown of lower order, or one state, follow from each equation that was
//!    differentiated. Constraints stay equations of the reduced system, so that nothing drifts.
//!    Where what a constraint determines could change, all states stay on it: [`project`] in closed
//!    form, [`correct`] with unknown multipliers. Where neither can, [`guard`] ends the episode
//!    before a constraint stops to determine what follows.
//! 4. [`finish`] writes the model: states that follow from constraints are algebraic variables.
//!
//! A loop of equations is one node all along: it is differentiated and matched as a whole. Where
//! the loops do not fit each other, a second attempt unrolls them.

mod bounds;
mod correct;
mod demote;
mod finish;
mod guard;
mod jumps;
mod pantelides;
mod project;
mod rated;
mod slopes;
mod start;
mod system;

use smpl_dsl::diagnostic::{Diagnostic, codes};

use super::algebraic::Plan;
use super::common::programs;
use super::totals::has_algebraic_rate;
use crate::elaborate::Equation;
use crate::ir::{FastMap, FastSet, Flavour, Role, VarId};
use crate::model::{Differentiated, Model, Quantity, Row};
use correct::Corrected;
use demote::{SettledConstraints, settle};
use jumps::Jump;
use pantelides::{Refused, System};
pub(crate) use rated::watch_rates;
use rated::{jump_fault, variable_fault};
use slopes::{NoSlope, Slopes, replace_rates};
use system::{Matching, Node, Pool, Settled, Wishes};

/// Most equations that loops are unrolled to.
const UNROLLED: i64 = 20_000;

/// Label of an equation that cannot be differentiated.
const BINDS: &str = "binds states: what jumps in it would make them jump";

/// Nodes of a reduced system; beyond, the model is refused.
const LARGEST: usize = 100_000;

/// A reduced model.
pub(super) struct Reduced {
    pub model: Model,
    pub rows: Vec<Row>,
    /// The quantities of unknowns that no declaration names.
    pub helpers: Vec<Quantity>,
}

/// Returns `true` if some equation has no unknown, or the rate of an algebraic variable is read.
pub(super) fn is_needed(model: &Model, equations: &[Equation], unknown: &dyn Fn(VarId) -> bool) -> bool {
    let binds_states = |equation: &Equation| {
        let read = model.exprs.loads(equation.form.value(), |var, flavour| match flavour {
            Flavour::Value => model.vars[var].role == Role::Algebraic && unknown(var),
            Flavour::Derivative => model.vars[var].role == Role::State,
            _ => false,
        });
        read.is_empty() && matches!(equation.form, crate::elaborate::EquationForm::Implicit { .. })
    };
    has_algebraic_rate(model, equations) || equations.iter().any(binds_states)
}

/// The reduced model.
///
/// # Errors
/// The equation that cannot be differentiated, where that is why; nothing where no number of
/// differentiations determines the unknowns.
pub(super) fn reduce(model: &Model, equations: &[Equation], plan: &Plan) -> Result<Reduced, Option<Diagnostic>> {
    let loops = attempt(model, equations, plan, Attempt { unroll: false, correct: true });
    if loops.is_ok() || equations.iter().all(|e| e.extents.is_empty()) {
        return loops;
    }
    attempt(model, equations, plan, Attempt { unroll: true, correct: true }).or(loops)
}

/// Means of a reduction.
#[derive(Clone, Copy)]
struct Attempt {
    /// Loops are written out.
    unroll: bool,
    /// States may be projected by corrections.
    correct: bool,
}

fn attempt(origin: &Model, equations: &[Equation], plan: &Plan, by: Attempt) -> Result<Reduced, Option<Diagnostic>> {
    let (mut model, mut equations_here) = (origin.clone(), equations.to_vec());
    let mut system = system(&mut model, &mut equations_here, plan, by.unroll).ok_or(None)?;
    if let Err(refused) = system.reduce(&mut model) {
        return Err(explained(&model, &system, refused));
    }
    let wishes = wishes(&model, &equations_here);
    let SettledConstraints { settled, groups, corrected } = settle(&mut model, &system, &wishes, by.correct).ok_or(None)?;
    if let Some(fault) = set_although_determined(&model, &settled) {
        return Err(Some(fault));
    }
    model.interface.reduction.differentiated = differentiated(&system);
    let System { nodes, matching: Matching { of, .. }, mut slopes, .. } = system;
    let mut top: Vec<(usize, _)> = of.into_iter().collect();
    top.sort_unstable_by_key(|(node, _)| *node);
    let top = top.into_iter().map(|(node, elements)| finish::settled(&nodes, node, elements)).collect();
    groups.iter().for_each(|group| project::project(&mut model, &mut slopes, group));
    let mut moved = Corrected::default();
    for constraints in &corrected {
        if correct::correct(&mut model, &mut slopes, constraints, &mut moved).is_none() {
            return attempt(origin, equations, plan, Attempt { correct: false, ..by });
        }
    }
    guard::watch(&mut model, &settled);
    let (mut rows, mut helpers) = finish::finish(&mut model, top, settled, &slopes);
    rows.extend(moved.rows);
    helpers.extend(moved.helpers);
    Ok(Reduced { model, rows, helpers })
}

/// The nodes and unknowns of a model whose rates are explicit or unknowns.
fn system(model: &mut Model, equations: &mut [Equation], plan: &Plan, unroll: bool) -> Option<System> {
    let mut slopes = Slopes::new(equations);
    let implicit = implicit_states(model, equations, &slopes);
    let raised = rates_of_unknowns(model, equations);
    for &var in implicit.iter().chain(&raised) {
        slopes.variable(model, var);
    }
    replace_rates(model, equations, &slopes);
    let (of, base) = (std::mem::take(&mut slopes.of), std::mem::take(&mut slopes.base));
    slopes = Slopes { of: raised.iter().filter_map(|var| Some((*var, *of.get(var)?))).collect(), base, ..Slopes::new(equations) };
    let mut nodes = Vec::new();
    for equation in equations.iter() {
        nodes.extend(Node::of(&mut model.exprs, equation));
    }
    let mut pool = Pool::default();
    for (var, v) in model.vars.iter().filter(|(var, v)| v.role == Role::Algebraic && !slopes.base.contains_key(var)) {
        if !plan.arrays.contains_key(&var) {
            (0..i64::from(v.len)).filter(|&i| !plan.substituted.contains_key(&(var, i))).for_each(|i| pool.set(model, var, i, true));
        }
    }
    for &state in &implicit {
        slopes.known_as(model, (&mut nodes, &mut pool), state, of[&state]);
    }
    if unroll {
        let count: i64 = nodes.iter().map(Node::count).sum();
        if count > UNROLLED {
            return None;
        }
        nodes = nodes.into_iter().flat_map(|node| node.unrolled(&mut model.exprs)).collect();
    }
    let mut system = System { nodes, pool, lower: Pool::default(), slopes, matching: Matching::default() };
    for &var in &raised {
        let elements: Vec<i64> = (0..i64::from(model.vars[var].len)).filter(|&i| system.pool.has(var, i)).collect();
        if elements.is_empty() {
            return None;
        }
        system.raise_elements(model, var, &elements);
    }
    (system.nodes.len() <= LARGEST).then_some(system)
}

/// States whose rates are not explicit, or are read where they are not.
fn implicit_states(model: &Model, equations: &[Equation], slopes: &Slopes) -> Vec<VarId> {
    let mut out = read_rates(model, equations, Role::State);
    for (var, v) in model.vars.iter().filter(|(_, v)| v.role == Role::State) {
        let mut covered = vec![false; v.len as usize];
        for piece in slopes.pieces.get(&var).into_iter().flatten() {
            crate::elaborate::for_each_element(&piece.extents, piece.at, &mut |i| covered[i as usize] = true);
        }
        if covered.iter().any(|covered| !covered) {
            out.insert(var);
        }
    }
    let mut out: Vec<VarId> = out.into_iter().collect();
    out.sort_unstable();
    out
}

fn rates_of_unknowns(model: &Model, equations: &[Equation]) -> Vec<VarId> {
    let mut out: Vec<VarId> = read_rates(model, equations, Role::Algebraic).into_iter().collect();
    out.sort_unstable();
    out
}

/// Variables of a role whose rates are read anywhere.
fn read_rates(model: &Model, equations: &[Equation], role: Role) -> FastSet<VarId> {
    let values =
        equations.iter().map(|e| e.form.value()).chain(model.roots.iter().map(|r| r.value)).chain(model.quadratures.iter().copied());
    let stores = programs(&model.programs).flat_map(|p| &p.nests).flat_map(|nest| &nest.stores).map(|store| store.value);
    let all: Vec<_> = values.chain(stores).filter(|&e| model.exprs.has_derivative(e)).collect();
    let rates = all.into_iter().flat_map(|e| model.exprs.derivatives(e, |var| model.vars[var].role == role));
    rates.map(|(var, ..)| var).collect()
}

/// Ranks of the states.
fn wishes(model: &Model, equations: &[Equation]) -> Wishes {
    let mut keep: FastMap<VarId, u8> = FastMap::default();
    let mut base = 0_u32;
    let fixed: FastSet<u32> = model.interface.steady.iter().flat_map(|steady| steady.fixed.iter().copied()).collect();
    let set = finish::set_at_instants(model);
    let rated: FastSet<VarId> = equations
        .iter()
        .filter_map(|e| if let crate::elaborate::EquationForm::Rate { var, .. } = e.form { Some(var) } else { None })
        .collect();
    for &var in model.unknowns.iter().filter(|var| model.vars[**var].role == Role::State) {
        let v = &model.vars[var];
        let is_fixed = (base..base + v.len).any(|at| fixed.contains(&at));
        base += v.len;
        let wish = match () {
            () if model.interface.reduction.preferred.contains(&v.name) => 4,
            () if set.contains(&var) => 3,
            () if is_fixed => 2,
            () if rated.contains(&var) => 1,
            // A state without an equation of its rate follows best.
            () => 0,
        };
        keep.insert(var, wish);
    }
    Wishes { keep }
}

/// The equations that were differentiated, and how often.
fn differentiated(system: &System) -> Vec<Differentiated> {
    let mut out: Vec<Differentiated> = Vec::new();
    for node in system.nodes.iter().filter(|node| node.order > 0) {
        match out.iter_mut().find(|d| d.span == node.span) {
            Some(known) => known.times = known.times.max(node.order),
            None => out.push(Differentiated { span: node.span, place: String::new(), text: String::new(), times: node.order }),
        }
    }
    out.sort_by_key(|d| (d.span.file, d.span.start));
    out
}

/// The fault of a system that was not reduced.
fn explained(model: &Model, system: &System, refused: Refused) -> Option<Diagnostic> {
    let Refused::NoSlope(node, why) = refused else { return None };
    // Without an unknown that lacks an equation, one equation is too many.
    if system.missing().is_empty() {
        return None;
    }
    let node = &system.nodes[node];
    let often = if node.order == 0 { "this equation" } else { "the time derivative of this equation" };
    match why {
        NoSlope::Jumps(var) => Some(variable_jumps(model, node, often, var)),
        NoSlope::Breaks(jump) => Some(value_jumps(model, node, often, jump)),
        NoSlope::Form => None,
    }
}

/// The fault of an equation that reads a variable which jumps.
fn variable_jumps(model: &Model, node: &Node, often: &str, var: VarId) -> Diagnostic {
    let name = &model.vars[var].name;
    let help = format!(
        "make a state of `{name}` that follows it, as in `eq d/dt {name}_s = ({name} - {name}_s)/tau`, or free a state of the equation"
    );
    variable_fault(model, often, var, node.span).label(BINDS).help(help)
}

/// The fault of an equation whose value jumps at a time, or where an unknown passes a threshold.
fn value_jumps(model: &Model, node: &Node, often: &str, jump: Jump) -> Diagnostic {
    let fault = jump_fault(model, often, jump, node.span).label(BINDS);
    fault.help("make a state that follows what jumps, as in `eq d/dt h_s = (h(t) - h_s)/tau`, use a `linear` table, or free a state of the equation")
}

/// The fault of a state that is set at an instant although it follows from a constraint.
fn set_although_determined(model: &Model, settled: &[Settled]) -> Option<Diagnostic> {
    let set = finish::set_at_instants(model);
    let s = settled.iter().find(|s| model.vars[s.var].role == Role::State && set.contains(&s.var))?;
    let name = &model.vars[s.var].name;
    let message = format!("`{name}` is set at an instant, but this equation determines it");
    let fault = Diagnostic::error(codes::HIGH_INDEX, message, s.node.span).secondary(model.vars[s.var].span, "declared here");
    Some(fault.help("reset another state of the equation, from which this one follows"))
}

/// The fault of a rate of an algebraic variable that nothing determines.
pub(super) fn left_rates(model: &Model, equations: &[Equation]) -> Option<Diagnostic> {
    let var = rates_of_unknowns(model, equations).first().copied()?;
    let v = &model.vars[var];
    let message = format!("the time derivative of the algebraic variable `{}` is read, but the equations do not determine both", v.name);
    let fault = Diagnostic::error(codes::HIGH_INDEX, message, v.span);
    Some(fault.help(format!("declare it with `state`, or write `{}` as an explicit function of states and time", v.name)))
}
