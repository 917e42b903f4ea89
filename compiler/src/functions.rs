//! The functions that a model is compiled to: what each computes, may touch and may know
//! beforehand.

use crate::differentiate::Rows;
use crate::explicit_time::ExplicitTime;
use crate::generate::Effort;
use crate::hoist::Stage;
use crate::model::{Model, Quantity};
use crate::schedule::{Access, Staged};
use crate::switches::Watched;

/// Functions that are compiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Function {
    PrepareStep,
    Residual,
    Jacobian,
    Roots,
    Bounds,
    Quadratures,
    Start,
    End,
    Finish,
    Outputs,
    Disturb,
    NextBreak,
    Forcings,
    ByTime,
    Delayed,
    Lags,
}

impl Function {
    pub(crate) const ALL: [Function; 16] = [
        Function::PrepareStep,
        Function::Residual,
        Function::Jacobian,
        Function::Roots,
        Function::Bounds,
        Function::Quadratures,
        Function::Start,
        Function::End,
        Function::Finish,
        Function::Outputs,
        Function::Disturb,
        Function::NextBreak,
        Function::Forcings,
        Function::ByTime,
        Function::Delayed,
        Function::Lags,
    ];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Function::PrepareStep => "prepare_step",
            Function::Residual => "residual",
            Function::Jacobian => "jacobian",
            Function::Roots => "roots",
            Function::Bounds => "bounds",
            Function::Quadratures => "quadratures",
            Function::Start => "start",
            Function::End => "end",
            Function::Finish => "finish",
            Function::Outputs => "outputs",
            Function::Disturb => "disturb",
            Function::NextBreak => "next_break",
            Function::Forcings => "forcings",
            Function::ByTime => "by_time",
            Function::Delayed => "delayed",
            Function::Lags => "lags",
        }
    }

    /// Caches that it may use: discrete variables may have changed since the step was prepared.
    pub(crate) fn limit(self) -> Stage {
        match self {
            Function::Residual | Function::Jacobian | Function::Roots | Function::Bounds | Function::Quadratures => Stage::Step,
            Function::NextBreak | Function::Forcings | Function::ByTime | Function::Delayed | Function::Lags => Stage::Step,
            _ => Stage::Parameter,
        }
    }

    /// Returns `true` if it comes from a program, which is often written element by element;
    /// equations are loops already.
    pub(crate) fn is_program(self) -> bool {
        matches!(
            self,
            Function::Start | Function::End | Function::Finish | Function::Outputs | Function::Disturb | Function::Delayed | Function::Lags
        )
    }

    /// Effort of code generation, by how often the solver calls it.
    pub(crate) fn effort(self) -> Effort {
        match self {
            Function::Residual | Function::Jacobian | Function::Quadratures => Effort::Hot,
            Function::Roots | Function::Bounds => Effort::Warm,
            _ => Effort::Lukewarm,
        }
    }

    /// Its place among the plans of code generation: the longest first.
    pub(crate) fn rank(self) -> u8 {
        match self {
            Function::Jacobian => 0,
            Function::Residual => 1,
            _ => 2,
        }
    }

    /// Memory that it may access, with the given lengths of some outputs.
    pub(crate) fn access(self, model: &Model, Lengths { nonzeros, forcings, watched }: Lengths) -> Access {
        let (y, yp, out) = match self {
            Function::PrepareStep | Function::Disturb => (false, false, 0),
            Function::NextBreak => (false, false, 1),
            Function::Forcings => (true, true, forcings),
            Function::Residual | Function::ByTime => (true, true, model.unknowns.iter().map(|v| model.vars[*v].len as usize).sum()),
            Function::Jacobian => (true, true, nonzeros),
            Function::Roots => (true, true, watched),
            Function::Bounds => (true, true, 2 * watched),
            Function::Quadratures => (true, true, model.quadratures.len()),
            Function::Start | Function::End => (true, false, 0),
            Function::Finish => (true, true, finish_len(model)),
            Function::Outputs => (true, true, elements(&model.interface.quantities.algebraics)),
            Function::Delayed | Function::Lags => (true, true, model.delayed()),
        };
        Access { name: self.name(), y, yp, out }
    }
}

/// Lengths of outputs that follow from the equations.
#[derive(Clone, Copy)]
pub(crate) struct Lengths {
    /// Entries of the Jacobian.
    pub nonzeros: usize,
    /// Values of the forcings.
    pub forcings: usize,
    /// Root functions: those of events, and switches of the equations.
    pub watched: usize,
}

/// Computations of the functions, except the one that fills caches, in the order of
/// [`Function::ALL`].
pub(crate) fn staged(
    model: &Model,
    rows: &[Rows],
    (jacobian, by_time): (Staged, Staged),
    time: &ExplicitTime,
    watched: &Watched,
) -> Vec<(Function, Staged)> {
    let programs = &model.programs;
    let program = Staged::of_program;
    vec![
        (Function::Residual, Staged::of_rows(rows)),
        (Function::Jacobian, jacobian),
        (Function::Roots, Staged::of_lists(watched.roots(model))),
        (Function::Bounds, Staged::of_lists(watched.bounds.iter().cloned())),
        (Function::Quadratures, Staged::of_numbers(model.quadratures.iter().copied())),
        (Function::Start, program(&programs.start)),
        (Function::End, program(&programs.end)),
        (Function::Finish, program(&programs.finish)),
        (Function::Outputs, program(&programs.outputs)),
        (Function::Disturb, program(&programs.disturb)),
        (Function::NextBreak, time.next_break.map_or_else(Staged::default, |value| Staged::of_numbers([value]))),
        (Function::Forcings, Staged::of_lists(time.forcings.iter().cloned())),
        (Function::ByTime, by_time),
        (Function::Delayed, program(&programs.delayed)),
        (Function::Lags, program(&programs.lags)),
    ]
}

/// Elements of several quantities.
pub(crate) fn elements(quantities: &[Quantity]) -> usize {
    quantities.iter().map(Quantity::len).sum()
}

/// Length of the output of `steady` after the actions.
pub(crate) fn steady_len(model: &Model) -> usize {
    model.interface.steady.as_ref().map_or(0, |steady| steady.fixed.len() + steady.conditions as usize)
}

/// Number of conditions at the start.
pub(crate) fn start_conditions(model: &Model) -> usize {
    model.interface.start_conditions.iter().map(|condition| condition.count as usize).sum()
}

/// Length of the output of `finish`.
pub(crate) fn finish_len(model: &Model) -> usize {
    model.interface.finish.layout().total()
}
