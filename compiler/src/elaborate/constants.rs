//! Numbers that are known while the model is compiled: defaults of parameters, and what sizes and
//! indices were made of.

use cranelift_entity::PrimaryMap;

use super::hidden::Draws;
use crate::interpret::eval_constant;
use crate::ir::{Expr, ExprId, Exprs, FastMap, FastSet, Flavour, Rewritten, Role, VarId};
use crate::model::{Variable, Variate};

/// Known values of parameters.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Constants {
    /// Numeric defaults, by element.
    numbers: FastMap<(VarId, i64), f64>,
    /// Parameters whose default is being worked out, or was.
    begun: FastSet<VarId>,
    /// Parameters that the default of a parameter needs.
    needs: FastMap<VarId, Vec<VarId>>,
    /// Parameters whose numbers gave sizes and indices.
    structural: FastSet<VarId>,
    /// Settings that something took.
    pub taken: FastSet<String>,
}

impl Constants {
    /// Returns `true` if the default of a parameter is to be worked out now: it was not begun
    /// before.
    pub(in crate::elaborate) fn begin(&mut self, var: VarId) -> bool {
        !self.numbers.contains_key(&(var, 0)) && self.begun.insert(var)
    }

    /// Returns `true` if the default of a parameter is being worked out, or was.
    pub(in crate::elaborate) fn is_begun(&self, var: VarId) -> bool {
        self.begun.contains(&var)
    }

    /// Notes that the default of a parameter needs another one.
    pub(in crate::elaborate) fn note_need(&mut self, var: VarId, needed: VarId) {
        self.needs.entry(var).or_default().push(needed);
    }

    /// Notes the number of an element.
    pub(in crate::elaborate) fn set(&mut self, var: VarId, element: i64, x: f64) {
        self.numbers.insert((var, element), x);
    }

    /// Notes that sizes or indices were computed from parameters: they, and those that they need,
    /// keep their numbers.
    pub(in crate::elaborate) fn mark_structural(&mut self, parameters: impl IntoIterator<Item = VarId>) {
        let mut stack: Vec<VarId> = parameters.into_iter().collect();
        while let Some(var) = stack.pop() {
            if self.structural.insert(var) {
                stack.extend(self.needs.get(&var).into_iter().flatten());
            }
        }
    }

    /// Returns `true` if sizes or indices were computed from a parameter.
    pub(in crate::elaborate) fn is_structural(&self, var: VarId) -> bool {
        self.structural.contains(&var)
    }

    /// The number of an expression with what is known of the parameters, and means of random
    /// numbers.
    pub(in crate::elaborate) fn fold(
        &self,
        exprs: &mut Exprs,
        vars: &PrimaryMap<VarId, Variable>,
        draws: &Draws,
        e: ExprId,
    ) -> Option<f64> {
        let number = |var: VarId, at: i64| self.numbers.get(&(var, at)).copied().filter(|_| vars[var].role == Role::Param);
        let folded = exprs.rewrite(e, &mut Rewritten::default(), &mut |exprs, node| match node {
            Expr::Load { var, at, .. } if at.is_constant() => {
                let x = if var == draws.var { Some(draws.mean(at.offset)) } else { number(var, at.offset) };
                x.map(|x| exprs.constant(x))
            }
            _ => None,
        });
        if let Some(x) = exprs.as_const(folded) {
            return Some(x);
        }
        let known_at = |var, flavour, at| if flavour == Flavour::Value { self.numbers.get(&(var, at)).copied() } else { None };
        if exprs.free(folded) == 0 { eval_constant(exprs, folded, &known_at) } else { None }
    }
}

impl Draws {
    /// Mean of a variate.
    fn mean(&self, at: i64) -> f64 {
        match usize::try_from(at).ok().and_then(|at| self.list.get(at)).map(|d| d.kind) {
            Some(Variate::Uniform) => 0.5,
            _ => 0.0,
        }
    }
}
