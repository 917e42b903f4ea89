//! States that move to constraints by unknown corrections.

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::ir::{Place, Program, VarId};
use smpl_compiler::model::RootAction;

use crate::catalogue::Catalogue;

/// A state and its correction in `y`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    /// Place of the state.
    pub state: usize,
    /// Place of the correction.
    pub by: usize,
    /// Magnitude of both.
    pub scale: f64,
}

/// Corrections of a model.
#[derive(Clone, Debug, Default)]
pub(crate) struct Corrections {
    /// States with their corrections; empty if no state has one.
    pub pairs: Vec<Pair>,
    /// Updates at the start of a step set some of these states.
    pub set_at_start: bool,
    /// For each root function, `true` if its event sets some of these states.
    pub set_by: Vec<bool>,
}

impl Corrections {
    pub(super) fn of(model: &CompiledModel, catalogue: &Catalogue) -> Self {
        let (layout, corrections) = (model.layout(), &model.interface().reduction.corrections);
        let mut pairs = Vec::new();
        for one in corrections {
            let (Some(state), Some(by)) = (layout.offset(one.state), layout.offset(one.by)) else { continue };
            pairs.extend((0..layout.elements(one.state) as usize).map(|i| Pair { state: state + i, by: by + i, scale: 1.0 }));
        }
        pairs.sort_unstable_by_key(|pair| pair.state);
        for state in catalogue.states.elements() {
            if let Ok(place) = pairs.binary_search_by_key(&state.at, |pair| pair.state) {
                pairs[place].scale = state.scale.abs();
            }
        }
        let is_moved = |var: VarId| corrections.iter().any(|one| one.state == var);
        let sets = |program: &Program| {
            let mut places = program.nests.iter().flat_map(|nest| &nest.stores).map(|store| store.target.place);
            places.any(|place| matches!(place, Place::Var(var) if is_moved(var)))
        };
        let programs = &model.model().programs;
        let by_event = |action: RootAction| match action {
            RootAction::Run(program) => programs.events.get(program as usize).is_some_and(sets),
            _ => false,
        };
        let set_by = model.roots_info().iter().map(|root| by_event(root.action)).collect();
        Self { pairs, set_at_start: sets(&programs.start), set_by }
    }
}
