//! Further definitions of arrays that one loop defines as a whole.
//!
//! `eq p[i] = n[i]*R*T/V[i] for i in k` defines `p`; `eq p[i] = p[i+1] for i in 1..19` is an
//! equation for something else, although `p[i]` is alone on its left side.

use super::common::passes;
use super::whole::Whole;
use crate::elaborate::{Equation, EquationForm};
use crate::ir::{FastMap, Flavour, VarId};
use crate::model::Model;

/// Makes equations of definitions of what a loop defines as a whole.
pub(crate) fn settle(model: &mut Model, equations: &mut [Equation]) {
    let mut pieces: FastMap<VarId, Vec<usize>> = FastMap::default();
    for (i, equation) in equations.iter().enumerate() {
        if let EquationForm::Definition { var, .. } = equation.form {
            pieces.entry(var).or_default().push(i);
        }
    }
    for (var, list) in pieces {
        let len = i64::from(model.vars[var].len);
        let total: i64 = list.iter().map(|&i| passes(&equations[i].extents)).sum();
        if len == 1 || total <= len {
            continue;
        }
        let is_whole = |i: &&usize| Whole::of(len, std::slice::from_ref(*i), equations).is_some();
        let Some(&main) = list.iter().find(is_whole) else { continue };
        for i in list.into_iter().filter(|&i| i != main) {
            let EquationForm::Definition { at, value, .. } = equations[i].form else { continue };
            let own = model.exprs.load(var, Flavour::Value, at);
            equations[i].form = EquationForm::Implicit { residual: model.exprs.sub(value, own) };
            equations[i].repeats = Some((var, -1));
        }
    }
}
