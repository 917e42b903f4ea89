//! Rates of algebraic variables by their definitions: `der(p)` with `eq p = f(x)` is `f'(x) *
//! der(x)`.

use smpl_dsl::diagnostic::Faults;
use smpl_dsl::span::Span;

use super::common::replace_everywhere;
use super::reduce::watch_rates;
use super::whole::{Whole, placed, wholes};
use crate::differentiate;
use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, Flavour, Rewritten, Role, VarId};
use crate::model::Model;

/// Replaces rates of explicitly defined algebraic variables, in equations, programs and elsewhere.
/// Other rates of algebraic variables stay: [`super::reduce`] finds them.
///
/// # Errors
/// Definitions that jump, if an equation reads their rates.
pub(crate) fn expand(model: &mut Model, equations: &mut [Equation]) -> Result<(), Faults> {
    if !has_algebraic_rate(model, equations) {
        return Ok(());
    }
    let spans: FastMap<ExprId, Span> = equations.iter().map(|e| (e.form.value(), e.span)).collect();
    let mut definitions: FastMap<(VarId, i64), ExprId> = FastMap::default();
    for equation in equations.iter().filter(|e| e.extents.is_empty()) {
        if let EquationForm::Definition { var, at, value } = equation.form {
            definitions.entry((var, at.offset)).or_insert(value);
        }
    }
    let wholes = wholes(model, equations);
    let values = wholes.values().flat_map(|whole| &whole.equations).map(|&i| (i, equations[i].form.value())).collect();
    let roles: Vec<Role> = model.vars.values().map(|v| v.role).collect();
    let (done, open, rated) = (FastMap::default(), Vec::new(), Vec::new());
    let mut known = Known { roles, definitions, wholes, values, done, open, rated };
    let mut done = Rewritten::default();
    for equation in equations.iter() {
        let replace = &mut |exprs: &mut Exprs, node: Expr| known.replaced(exprs, node);
        model.exprs.rewrite_where(equation.form.value(), &mut done, &Exprs::has_derivative, replace);
    }
    let rated = std::mem::take(&mut known.rated);
    replace_everywhere(model, equations, &mut done, &Exprs::has_derivative, &mut |exprs, node| known.replaced(exprs, node));
    let rated: Vec<(ExprId, Span)> = rated.into_iter().filter_map(|value| Some((value, *spans.get(&value)?))).collect();
    watch_rates(model, &rated)
}

/// Returns `true` if the rate of an algebraic variable occurs.
pub(super) fn has_algebraic_rate(model: &Model, equations: &[Equation]) -> bool {
    let mut found = false;
    let mut look = |e: ExprId| {
        found |= model.exprs.has_derivative(e) && !model.exprs.derivatives(e, |var| model.vars[var].role == Role::Algebraic).is_empty();
    };
    equations.iter().for_each(|equation| look(equation.form.value()));
    model.roots.iter().for_each(|root| look(root.value));
    model.quadratures.iter().for_each(|&integrand| look(integrand));
    let programs = super::common::programs(&model.programs);
    programs.flat_map(|p| &p.nests).flat_map(|nest| &nest.stores).for_each(|store| look(store.value));
    found
}

struct Known {
    roles: Vec<Role>,
    definitions: FastMap<(VarId, i64), ExprId>,
    wholes: FastMap<VarId, Whole>,
    /// Values of the definitions of whole arrays, by equation.
    values: FastMap<usize, ExprId>,
    done: FastMap<(VarId, Affine), Option<ExprId>>,
    open: Vec<(VarId, Affine)>,
    /// Values of definitions that were differentiated.
    rated: Vec<ExprId>,
}

impl Known {
    fn role(&self, var: VarId) -> Option<Role> {
        self.roles.get(var.as_u32() as usize).copied()
    }

    fn replaced(&mut self, exprs: &mut Exprs, node: Expr) -> Option<ExprId> {
        match node {
            Expr::Load { var, flavour: Flavour::Derivative, at } if self.role(var) == Some(Role::Algebraic) => self.rate(exprs, var, at),
            _ => None,
        }
    }

    /// The rate of an element; `None` where its definition is not explicit or needs itself.
    fn rate(&mut self, exprs: &mut Exprs, var: VarId, at: Affine) -> Option<ExprId> {
        if let Some(known) = self.done.get(&(var, at)) {
            return *known;
        }
        if self.open.iter().any(|open| open.0 == var) {
            return None;
        }
        let value = match self.definitions.get(&(var, at.offset)).filter(|_| at.is_constant()) {
            Some(&value) => {
                self.rated.push(value);
                Some(value)
            }
            None => self.wholes.get(&var).and_then(|whole| {
                let (part, indices) = whole.locate(at)?;
                self.rated.push(self.values[&whole.equations[part]]);
                placed(exprs, self.values[&whole.equations[part]], &indices)
            }),
        };
        self.open.push((var, at));
        let rate = value.and_then(|value| {
            let roles = &self.roles;
            let rate = derived(exprs, usize::from(at.depth()), value, &|var| roles.get(var.as_u32() as usize).copied())?;
            let mut done = Rewritten::default();
            Some(exprs.rewrite_where(rate, &mut done, &Exprs::has_derivative, &mut |exprs, node| self.replaced(exprs, node)))
        });
        self.open.pop();
        self.done.insert((var, at), rate);
        rate
    }
}

/// The time derivative of an expression in `depth` loops, with the rates of states and algebraic
/// variables as they are.
pub(super) fn derived(exprs: &mut Exprs, depth: usize, value: ExprId, role: &dyn Fn(VarId) -> Option<Role>) -> Option<ExprId> {
    if exprs.has_derivative(value) {
        return None;
    }
    differentiate::total(exprs, depth, value, &|exprs, load| match load {
        None => Some(exprs.constant(1.0)),
        Some((var, Flavour::Value, at)) if matches!(role(var), Some(Role::State | Role::Algebraic)) => {
            Some(exprs.load(var, Flavour::Derivative, at))
        }
        Some(_) => None,
    })
    .ok()
}
