//! Initial values that depend on algebraic variables.

use smpl_dsl::diagnostic::{Diagnostic, codes};

use crate::elaborate::{DISCRETES, STATES, ordered_initial};
use crate::ir::{FastMap, FastSet, Flavour, Place, Role, VarId};
use crate::model::Model;

/// Puts initial values into order again, now that explicit algebraic variables are known by what
/// they consist of.
///
/// # Errors
/// Initial values that need each other, through algebraic variables that are solved for too.
pub(crate) fn order(model: &mut Model) -> Result<(), Vec<Diagnostic>> {
    let mut faults = Vec::new();
    for (program, roles) in [(&mut model.programs.initial_states, STATES), (&mut model.programs.initial_discretes, DISCRETES)] {
        let (nests, cycles) = ordered_initial(std::mem::take(&mut program.nests), &model.exprs, &model.vars, roles);
        program.nests = nests;
        faults.extend(cycles);
    }
    faults.extend(circular(model));
    faults.extend(coupled_rates(model));
    if faults.is_empty() { Ok(()) } else { Err(faults) }
}

/// Conditions at the start that read a rate which equations give together with other rates only.
fn coupled_rates(model: &Model) -> Vec<Diagnostic> {
    let conditions = model.programs.start_conditions.nests.iter().zip(&model.interface.start_conditions);
    let coupled = conditions.filter(|(nest, _)| nest.stores.iter().any(|store| model.exprs.has_derivative(store.value)));
    coupled
        .map(|(_, condition)| {
            let text = "this condition at the start reads a rate that the equations give only together with other rates";
            Diagnostic::error(codes::WRONG_KIND, text, condition.span)
                .help("solve the equations for the rate, or state the condition without it")
        })
        .collect()
}

/// Scalars whose initial value needs an algebraic unknown that is solved for with it.
fn circular(model: &Model) -> Vec<Diagnostic> {
    let all = |e| model.exprs.loads(e, |_, flavour| matches!(flavour, Flavour::Value | Flavour::Initial));
    let vars_in = |e| all(e).into_iter().map(|(var, ..)| var).collect::<Vec<_>>();
    let is_held = |var: VarId| matches!(model.vars[var].role, Role::State | Role::Discrete);
    // What a variable needs: of an algebraic one what its equation reads, of others what their
    // initial values read.
    let mut needs: FastMap<VarId, Vec<VarId>> = FastMap::default();
    for row in model.rows.iter().filter(|r| model.vars[r.var].role == Role::Algebraic) {
        let read = vars_in(row.residual).into_iter().filter(|v| *v != row.var);
        needs.entry(row.var).or_default().extend(read);
    }
    if needs.is_empty() {
        return Vec::new();
    }
    let programs = [&model.programs.initial_states, &model.programs.initial_discretes];
    for store in programs.into_iter().flat_map(|p| &p.nests).flat_map(|n| &n.stores) {
        if let Place::Var(var) = store.target.place {
            // The last one holds.
            needs.insert(var, vars_in(store.value));
        }
    }
    let reaches = |from: VarId| {
        let mut seen = FastSet::default();
        let mut stack = needs.get(&from).cloned().unwrap_or_default();
        while let Some(var) = stack.pop() {
            if var == from {
                return true;
            }
            if seen.insert(var) {
                stack.extend(needs.get(&var).into_iter().flatten());
            }
        }
        false
    };
    let own = model.vars.iter().filter(|&(id, v)| v.len == 1 && is_held(id));
    let circular = own.filter(|&(id, _)| reaches(id));
    circular
        .map(|(_, v)| {
            let message = format!("the initial value of `{}` needs an algebraic variable that depends on it", v.name);
            Diagnostic::error(codes::CYCLIC_DEFINITION, message, v.span)
                .help("write the initial value out, or make the algebraic variable's equation hold at the start by another state")
        })
        .collect()
}
