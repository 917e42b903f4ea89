//! Meaning of the names of the episode: `success`, `failure`, `timeout`, `reward`, `observations`.

use smpl_dsl::span::Span;
use smpl_dsl::syntax::Ident;
use smpl_dsl::units::Unit;

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::bounded::Bounded;
use crate::elaborate::lower::value::{Measure, Value};
use crate::ir::ExprId;

/// Meaning of the names `success`, `failure`, `timeout` and `reward`.
#[derive(Clone, Copy, Debug)]
pub(in crate::elaborate) struct Outcome {
    /// `success`
    pub success: ExprId,
    /// `failure`
    pub failure: ExprId,
    /// `timeout`
    pub timeout: ExprId,
    /// `reward`, once it is known.
    pub reward: Option<ExprId>,
}

/// Names that stand for something once that is known.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct EpisodeNames {
    /// Of the outcome.
    pub outcome: Option<Outcome>,
    /// Observations with their bounds, for failures on the box of the observations.
    pub observed: Vec<Bounded>,
    /// The sampling interval in the unit of the time.
    pub step: f64,
    /// Unit and place of an `error_reward` that has a dimension or a scale.
    pub error_reward: Option<(Unit, Span)>,
    /// The reward of a failing step, where rewards and failures are evaluated.
    pub failing: Option<Value>,
}

/// `success`, `failure`, `timeout`, `reward` in an expression.
pub(in crate::elaborate) fn outcome_name(l: &mut Lowering<'_, '_>, name: &Ident) -> Option<Value> {
    if name.text == "error_reward" {
        return l.names.failing.clone();
    }
    let outcome = l.names.outcome?;
    Some(match name.text.as_str() {
        "success" => Value::truth(outcome.success),
        "failure" => Value::truth(outcome.failure),
        "timeout" => Value::truth(outcome.timeout),
        _ => Value { expr: outcome.reward?, unit: Measure::Bare },
    })
}
