//! The control problem: episode, initial values, sampling instants, steady state, conditions and
//! rewards.
//!
//! Each step is a function over [`Lowering`] that gives back what it made; [`elaborate_control`] is
//! their order.

mod amounts;
mod assembly;
mod assignments;
mod boxes;
mod common;
mod controllers;
mod entries;
mod finish;
mod initial;
mod instants;
mod observations;
mod observed;
mod observed_arrays;
mod order;
mod outputs;
mod parameters;
mod phases;
mod policies;
mod positions;
mod ranges;
mod regular;
mod rewards;
mod settings;
mod starts;
mod steady;
mod together;
mod trials;
mod unknown;

pub(in crate::elaborate) use common::each;
pub use entries::{block_entries, is_entry_setting, refused_by_solver, solver_setting};
pub(in crate::elaborate) use observations::check_level;
pub(crate) use order::{DISCRETES, STATES, ordered_initial};

use crate::elaborate::lower::Lowering;
use crate::elaborate::space::grids;
use crate::ir::{Role, VarId};
use crate::model::{Alternatives, Interface, Programs, Quantities, Root};

/// The control problem of a model.
#[derive(Default)]
pub(in crate::elaborate) struct Control {
    /// Updates at the instants of an episode.
    pub programs: Programs,
    /// Root functions of events.
    pub roots: Vec<Root>,
    /// The states.
    pub unknowns: Vec<VarId>,
    /// Public data.
    pub interface: Interface,
}

/// Elaborates the control problem, step by step.
pub(in crate::elaborate) fn elaborate_control(l: &mut Lowering<'_, '_>) -> Control {
    let blocks = &l.instances.blocks;
    let (mut episode, mut solver) = settings::settings(l, blocks);
    let parameters = parameters::parameter_program(l);
    let steady = steady::steady_program(l, blocks);
    let (initial_states, mut initial_discretes) = initial::initial_programs(l, blocks);
    let (conditions, start_conditions) = starts::start_conditions(l, blocks);
    let disturb = parameters::disturbance_program(l);
    let mut instants = instants::instant_programs(l, blocks);
    initial_discretes.nests.extend(regular::initial(l));
    solver.max_events = solver.max_events.saturating_add(regular::most_in_a_step(l, episode.integrate));
    phases::schedule_programs(l, &mut instants);
    regular::regular_programs(l, episode.integrate, &mut instants);
    let policies = policies::policies(l, blocks);
    let ending = finish::ending(l, blocks, &mut episode);
    let (mut outputs, mut algebraics) = outputs::output_program(l);
    let tests = trials::tests(l, blocks, (&mut outputs, &mut algebraics), &policies, &ending.finish);
    let (invariant_program, invariants) = policies::invariants(l, blocks);

    let programs = Programs {
        parameters,
        initial_states,
        initial_discretes,
        steady: steady.program,
        start_conditions: conditions,
        disturb,
        start: instants.start,
        end: instants.end,
        finish: ending.program,
        outputs,
        events: instants.events,
        policies,
        invariants: invariant_program,
        boxes: ending.boxes,
        ..Programs::default()
    };
    let interface = Interface {
        episode,
        solver,
        quantities: Quantities { algebraics, ..outputs::quantities(l) },
        measured: outputs::measured(l),
        ports: outputs::ports(l),
        grids: grids::grids(l),
        phases: phases::schedule_phases(l),
        finish: ending.finish,
        invariants,
        steady: (steady.declared || l.hidden.steady).then_some(steady.problem),
        start_conditions,
        start_resets: instants.start_resets,
        tests,
        alternatives: Alternatives { levels: ending.levels, ..Alternatives::default() },
        ..Interface::default()
    };
    let roots = instants.roots.into_iter().chain(ending.roots).collect();
    Control { programs, roots, unknowns: l.variables_of(Role::State), interface }
}
