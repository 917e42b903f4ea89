//! Invariants of the flat model, which each pass keeps and the back end relies on.
//!
//! [`Model::verify`] checks all of them. Compilations with [`Options::verify`] call it after each
//! pass, tests and the fuzzer among them; the reader of JSON always does. A [`Violation`] of a
//! compiled text is a fault of the compiler.
//!
//! Places are named as in the JSON form: `programs.start.nests[2].stores[0]`.
//!
//! [`Options::verify`]: crate::elaborate::Options::verify

mod interface;
mod programs;
mod values;

#[cfg(test)]
mod tests;

use cranelift_entity::EntityRef;
use thiserror::Error;

use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Affine, BUILTIN_COUNT, DELAY_SLOTS, MAX_DEPTH, Role, VarId};
use crate::model::Model;
use crate::structure::is_explicit;
use values::ValueCheck;

/// An invariant that does not hold.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{place}: {message}")]
pub struct Violation {
    /// Part of the model, `programs.start.nests[2].stores[0]`.
    pub place: String,
    /// The contradiction.
    pub message: String,
}

/// Result of a check.
type Checked = Result<(), Violation>;

fn violation(place: impl Into<String>, message: impl Into<String>) -> Checked {
    Err(Violation { place: place.into(), message: message.into() })
}

/// Returns an error unless a condition holds.
fn ensure(holds: bool, place: impl FnOnce() -> String, message: impl FnOnce() -> String) -> Checked {
    if holds { Ok(()) } else { violation(place(), message()) }
}

impl Model {
    /// Checks every invariant.
    ///
    /// # Errors
    /// The first one that does not hold.
    pub fn verify(&self) -> Result<(), Violation> {
        shared(self)?;
        interface::solved(self)?;
        let mut values = ValueCheck::new(self);
        parts(self, &mut values)?;
        rows(self, &mut values)?;
        covered(self)?;
        ensure(self.explicit == is_explicit(self), || "explicit".into(), || "the equations state otherwise".into())
    }
}

/// Checks the invariants of a model whose equations are not assigned to unknowns yet.
///
/// # Errors
/// The first one that does not hold.
pub(crate) fn verify_equations(model: &Model, equations: &[Equation]) -> Result<(), Violation> {
    shared(model)?;
    let mut values = ValueCheck::new(model);
    parts(model, &mut values)?;
    for (i, equation) in equations.iter().enumerate() {
        let place = || format!("equations[{i}]");
        values.number(&place, equation.form.value(), &equation.extents)?;
        match equation.form {
            EquationForm::Rate { var, at, .. } | EquationForm::Definition { var, at, .. } => {
                values.element(&place, var, at, &equation.extents)?;
            }
            EquationForm::Implicit { .. } => {}
        }
    }
    Ok(())
}

/// Invariants of variables, unknowns and the interface.
fn shared(model: &Model) -> Checked {
    runtime_variables(model)?;
    unknowns(model)?;
    interface::check(model)
}

/// Invariants of what is evaluated apart from equations.
fn parts(model: &Model, values: &mut ValueCheck<'_>) -> Checked {
    let finish = &model.interface.finish;
    for (i, root) in model.roots.iter().enumerate() {
        let place = || format!("events[{i}]");
        values.number(&place, root.value, &[])?;
        programs::action(model, finish, &place, root.action)?;
    }
    for (i, &value) in model.quadratures.iter().enumerate() {
        values.number(&|| format!("integrals[{i}]"), value, &[])?;
    }
    programs::check(model, values)
}

/// Variables that the runtime fills have the sizes that it fills, and are one each.
fn runtime_variables(model: &Model) -> Checked {
    let of = |role: Role| model.vars.values().filter(move |v| v.role == role);
    let total = |role: Role| of(role).map(|v| v.len as usize).sum::<usize>();
    let sizes = [
        (Role::Builtin, BUILTIN_COUNT as usize, "the values of the runtime"),
        (Role::Draw, model.interface.draws.len(), "the random numbers (`draws`)"),
        (Role::Quadrature, model.quadratures.len(), "the `integrals`"),
        (Role::Delayed, DELAY_SLOTS as usize * model.delayed(), "the `delays`"),
    ];
    for (role, expected, what) in sizes {
        let found = total(role);
        let fits = found == expected || (role == Role::Builtin && found == 0);
        ensure(fits, || "variables".into(), || format!("variables of role {role:?} have {found} elements in all, {what} {expected}"))?;
        ensure(of(role).count() <= 1, || "variables".into(), || format!("more than one variable of role {role:?}"))?;
    }
    let (given, parameters) = (total(Role::ParamGiven), total(Role::Param));
    ensure(
        given == 0 || given == parameters,
        || "variables".into(),
        || format!("variables of role `given` have {given} elements in all, the parameters {parameters}"),
    )
}

/// Unknowns are the states, then algebraic variables, each once.
fn unknowns(model: &Model) -> Checked {
    let mut seen = vec![false; model.vars.len()];
    let mut solved = false;
    for (i, &var) in model.unknowns.iter().enumerate() {
        let place = || format!("unknowns[{i}]");
        let variable = known(model, &place, var)?;
        let state = model.vars[variable].role == Role::State;
        ensure(!std::mem::replace(&mut seen[var.index()], true), place, || "is in the list already".into())?;
        ensure(state || model.vars[variable].role == Role::Algebraic, place, || {
            format!("`{}` is neither state nor algebraic variable", model.vars[var].name)
        })?;
        ensure(!(state && solved), place, || "a state follows an algebraic variable".into())?;
        solved |= !state;
    }
    let missing = model.vars.iter().find(|(var, v)| v.role == Role::State && !seen[var.index()]);
    missing.map_or(Ok(()), |(_, state)| violation("unknowns", format!("the state `{}` is missing", state.name)))
}

/// A variable that exists.
fn known(model: &Model, place: &dyn Fn() -> String, var: VarId) -> Result<VarId, Violation> {
    let count = model.vars.len();
    ensure(var.index() < count, place, || format!("there is no variable {}, there are {count}", var.index()))?;
    Ok(var)
}

/// Residuals are numbers over the loops of their rows, for elements of unknowns.
fn rows(model: &Model, values: &mut ValueCheck<'_>) -> Checked {
    for (i, row) in model.rows.iter().enumerate() {
        let place = || format!("equations[{i}]");
        values.number(&place, row.residual, &row.extents)?;
        values.element(&place, row.var, row.at, &row.extents)?;
    }
    Ok(())
}

/// Every element of an unknown has one equation.
fn covered(model: &Model) -> Checked {
    let mut covered: Vec<Option<Vec<bool>>> = vec![None; model.vars.len()];
    for &var in &model.unknowns {
        covered[var.index()] = Some(vec![false; model.vars[var].len as usize]);
    }
    for (i, row) in model.rows.iter().enumerate() {
        let (place, name) = (|| format!("equations[{i}]"), &model.vars[row.var].name);
        let Some(slots) = &mut covered[row.var.index()] else {
            return violation(place(), format!("`{name}` is not an unknown"));
        };
        each_element(&row.extents, row.at, slots, |element| match element {
            Ok(element) => violation(place(), format!("element {element} of `{name}` has another equation")),
            Err((passes, len)) => violation(place(), format!("{passes} passes for the {len} elements of `{name}`")),
        })?;
    }
    for &var in &model.unknowns {
        let missing = covered[var.index()].as_ref().and_then(|slots| slots.iter().position(|covered| !covered));
        if let Some(element) = missing {
            return violation("equations", format!("no equation for element {element} of `{}`", model.vars[var].name));
        }
    }
    Ok(())
}

/// Marks the elements that an address reaches; `fault` states an element that is reached twice, or
/// passes and elements where there are more passes.
fn each_element(extents: &[u32], at: Affine, reached: &mut [bool], fault: impl Fn(Result<i64, (u64, usize)>) -> Checked) -> Checked {
    let passes = extents.iter().map(|&e| u64::from(e)).fold(1, u64::saturating_mul);
    if passes > reached.len() as u64 {
        return fault(Err((passes, reached.len())));
    }
    for pass in 0..passes {
        let element = at.at(&counters(pass, extents));
        let slot = usize::try_from(element).ok().and_then(|element| reached.get_mut(element));
        if slot.is_none_or(|slot| std::mem::replace(slot, true)) {
            return fault(Ok(element));
        }
    }
    Ok(())
}

/// The counters of a pass, the last loop fastest.
fn counters(mut pass: u64, extents: &[u32]) -> [i64; MAX_DEPTH] {
    let mut counters = [0; MAX_DEPTH];
    for (counter, &extent) in counters.iter_mut().zip(extents).rev() {
        *counter = (pass % u64::from(extent)) as i64;
        pass /= u64::from(extent);
    }
    counters
}
