//! Functions that are interpreted: what runs rarely.

use super::parts::{BackEndError, Parts};
use crate::functions::{elements, start_conditions, steady_len};
use crate::interpret::Tape;
use crate::ir::Program;
use crate::layout::Layout;
use crate::schedule::{Access, Staged};

/// Functions that are interpreted.
#[derive(Clone, Debug, Default)]
pub(super) struct Tapes {
    pub(super) prepare_parameters: Tape,
    pub(super) parameters: Tape,
    pub(super) initial_states: Tape,
    pub(super) initial_discretes: Tape,
    pub(super) steady: Tape,
    pub(super) start_conditions: Tape,
    pub(super) invariants: Tape,
    pub(super) boxes: Tape,
    pub(super) before: Tape,
    pub(super) events: Vec<Tape>,
    pub(super) policies: Vec<Tape>,
}

impl Tapes {
    /// Prepares what is interpreted.
    pub(super) fn new(parts: &Parts, layout: &Layout) -> Result<Tapes, BackEndError> {
        let (model, programs) = (&parts.model, &parts.model.programs);
        let tape = |name: &'static str, staged: &Staged, y: bool, yp: bool, out: usize| {
            Tape::new(staged, &model.exprs, layout, Access { name, y, yp, out })
        };
        let program = |name, program: &Program, y, yp, out| tape(name, &Staged::of_program(program), y, yp, out);
        let actions = elements(&model.interface.quantities.actions);
        let boxed = model.interface.finish.failures.iter().map(|f| f.items.len()).sum();
        let steady = actions + steady_len(model);
        Ok(Tapes {
            prepare_parameters: tape("prepare_parameters", &parts.prepare_parameters, false, false, 0)?,
            parameters: program("parameters", &programs.parameters, false, false, 0)?,
            initial_states: program("initial_states", &programs.initial_states, true, false, 0)?,
            initial_discretes: program("initial_discretes", &programs.initial_discretes, true, false, 0)?,
            steady: program("steady", &programs.steady, true, false, steady)?,
            start_conditions: program("start_conditions", &programs.start_conditions, true, false, start_conditions(model))?,
            invariants: program("invariants", &programs.invariants, true, true, 2 * model.interface.invariants.len())?,
            boxes: program("boxes", &programs.boxes, true, true, boxed)?,
            before: program("before", &programs.before, true, true, model.delayed())?,
            events: programs.events.iter().map(|p| program("event", p, true, false, 0)).collect::<Result<_, _>>()?,
            policies: programs.policies.iter().map(|(_, p)| program("policy", p, true, false, actions)).collect::<Result<_, _>>()?,
        })
    }
}
