//! Expressions at other instants: at the start of the episode, at the end of the step before, at
//! the steady state.

use super::affine::Affine;
use super::build::Rewritten;
use super::expr::{Expr, ExprId, Exprs, Flavour};
use super::function::BinaryFn;
use super::var::{Builtin, Role, VarId};

/// Quantities without a value at another instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unframed {
    /// A derivative, an integral over the step, or a delayed value.
    OverTime,
    /// Quantities that are read at another instant themselves.
    Frame,
    /// End of the step.
    Outcome,
}

impl Exprs {
    /// An expression at another instant: what changes is read from there. The episode starts at the
    /// time 0, where the steady state is sought too.
    pub(crate) fn in_frame(
        &mut self,
        e: ExprId,
        frame: Flavour,
        role: &dyn Fn(VarId) -> Role,
        builtins: VarId,
        done: &mut Rewritten,
    ) -> Result<ExprId, Unframed> {
        let mut fault = None;
        let at_frame = self.rewrite(e, done, &mut |exprs, node| match node {
            Expr::Time => Some(exprs.time_of(frame, builtins)),
            Expr::Load { var, flavour: Flavour::Value, at } => match role(var) {
                Role::State | Role::Algebraic | Role::Action | Role::Discrete | Role::Disturbance => Some(exprs.load(var, frame, at)),
                Role::Quadrature | Role::Delayed => {
                    fault = Some(Unframed::OverTime);
                    None
                }
                Role::Builtin => exprs.builtin_of(at, frame, builtins).map_err(|unframed| fault = Some(unframed)).ok().flatten(),
                _ => None,
            },
            Expr::Load { flavour: Flavour::Derivative, .. } => {
                fault = Some(Unframed::OverTime);
                None
            }
            Expr::Load { flavour: Flavour::Previous, .. } => {
                fault = Some(Unframed::Frame);
                None
            }
            _ => None,
        });
        fault.map_or(Ok(at_frame), Err)
    }

    /// The time of a frame.
    fn time_of(&mut self, frame: Flavour, builtins: VarId) -> ExprId {
        if frame == Flavour::Previous { self.builtin(Builtin::Begin, builtins) } else { self.constant(0.0) }
    }

    /// A built-in number at another instant; `None` where it is the same there.
    fn builtin_of(&mut self, at: Affine, frame: Flavour, builtins: VarId) -> Result<Option<ExprId>, Unframed> {
        let is = |builtin: Builtin| at == Affine::constant(builtin as i64);
        if is(Builtin::Begin) {
            return Err(Unframed::Frame);
        }
        if is(Builtin::LastStep) || is(Builtin::Failed) || is(Builtin::ActionExcess) {
            return Err(Unframed::Outcome);
        }
        if !is(Builtin::Steps) && !is(Builtin::Clock) {
            return Ok(None);
        }
        let zero = self.constant(0.0);
        if frame != Flavour::Previous {
            return Ok(Some(zero));
        }
        // The first step has none before it.
        let (steps, one) = (self.builtin(Builtin::Steps, builtins), self.constant(1.0));
        let before = self.sub(steps, one);
        let before = self.binary(BinaryFn::Max, before, zero);
        if is(Builtin::Steps) {
            return Ok(Some(before));
        }
        let step = self.builtin(Builtin::StepLength, builtins);
        Ok(Some(self.mul(before, step)))
    }

    fn builtin(&mut self, builtin: Builtin, builtins: VarId) -> ExprId {
        self.load(builtins, Flavour::Value, Affine::constant(builtin as i64))
    }
}
