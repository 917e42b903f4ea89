//! Padé approximations instead of delays, on request.
//!
//! The value d of v a dead time θ ago has the transfer function exp(-θs). Its approximation of
//! order n is N(θs)/D(θs) with polynomials D(σ) = Σ cₖ σᵏ and N(σ) = D(-σ). States zᵢ of the size
//! of v and aₖ = cₖ/cₙ realise it: d = zₙ + (-1)ⁿ v and θ zᵢ' = aᵢ₋₁/aᵢ (zᵢ₋₁ - d + (-1)ⁱ⁻¹ v),
//! where z₀ = 0. At rest zᵢ is 0 or 2 v.

use smpl_dsl::diagnostic::{Diagnostic, Faults, codes};

use super::common::replace_everywhere;
use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Affine, DELAY_SLOTS, DelaySlot, Expr, ExprId, Flavour, Nest, Place, Rewritten, Role, Store, Target, VarId};
use crate::model::{Axis, Delay, Model, Quantity, Variable};

/// A delayed expression, with the variables that replace it.
struct Section {
    about: Delay,
    loops: Vec<(u8, u32)>,
    at: Affine,
    value: ExprId,
    lag: ExprId,
    before: Option<ExprId>,
    /// The delayed value, an algebraic variable, and the states of the approximation.
    delayed: VarId,
    states: VarId,
}

/// Replaces all delays by approximations of the order that the `solver` block states; none if that
/// is 0.
///
/// # Errors
/// If the value of a delay before the start cannot be computed ahead of the algebraic variables.
pub(crate) fn approximate(model: &mut Model, equations: &mut Vec<Equation>) -> Result<(), Faults> {
    let order = model.interface.solver.pade;
    let Some(var) = model.vars.iter().find(|(_, v)| v.role == Role::Delayed).map(|(var, _)| var) else { return Ok(()) };
    if order == 0 || model.delays.is_empty() {
        return Ok(());
    }
    let sections = sections(model, order);
    let mut firsts = Vec::new();
    let mut first = 0;
    for section in &sections {
        let count = i64::from(section.about.count);
        firsts.push((first..first + count, section.delayed));
        first += count;
    }
    for section in &sections {
        declare(model, section, order);
        add_equations(model, equations, section, order);
    }
    let slots = i64::from(DELAY_SLOTS);
    replace_everywhere(model, equations, &mut Rewritten::default(), &|_, _| true, &mut |exprs, node| match node {
        Expr::Load { var: read, flavour, at } if read == var => {
            if at.offset.rem_euclid(slots) != DelaySlot::Value as i64 {
                return Some(exprs.constant(0.0));
            }
            let element = Affine { offset: at.offset / slots, strides: at.strides.map(|stride| stride / slots) };
            let (range, delayed) = firsts.iter().find(|(range, _)| range.contains(&element.offset))?;
            Some(exprs.load(*delayed, flavour, element.plus(Affine::constant(-range.start))))
        }
        _ => None,
    });
    let programs = &mut model.programs;
    [&mut programs.delayed, &mut programs.lags, &mut programs.before].into_iter().for_each(|program| program.nests.clear());
    model.delays.clear();
    model.vars[var].len = 0;
    refuse_unknown_starts(model, &sections)
}

/// The delayed expressions in their order, with new variables.
fn sections(model: &mut Model, order: u32) -> Vec<Section> {
    let mut first = 0;
    let mut sections = Vec::new();
    for (number, about) in model.delays.clone().into_iter().enumerate() {
        let range = first..first + i64::from(about.count);
        let find = |nests: &[Nest]| {
            let stores = nests.iter().flat_map(|nest| nest.stores.iter().map(move |store| (nest, store)));
            let mut own = stores.filter(|(_, store)| range.contains(&store.target.at.offset));
            own.next().map(|(nest, store)| (nest.loops.clone(), store.target.at, store.value))
        };
        let programs = &model.programs;
        let (value, lag) = (find(&programs.delayed.nests), find(&programs.lags.nests));
        let before = find(&programs.before.nests).map(|(_, _, value)| value);
        first = range.end;
        let (Some((loops, at, value)), Some((_, _, lag))) = (value, lag) else { continue };
        let at = at.plus(Affine::constant(-range.start));
        let name = free_name(model, &format!("delayed_{}", number + 1));
        let mut new = |name: String, role, len| model.vars.push(Variable { name, role, len, span: about.span });
        let delayed = new(name.clone(), Role::Algebraic, about.count);
        let states = new(format!("{name}_pade"), Role::State, about.count * order);
        sections.push(Section { about, loops, at, value, lag, before, delayed, states });
    }
    sections
}

/// A name that the model does not have.
fn free_name(model: &Model, name: &str) -> String {
    let taken = |name: &str| model.vars.values().any(|variable| variable.name == name);
    std::iter::successors(Some(name.to_owned()), |name| Some(format!("{name}_"))).find(|name| !taken(name)).unwrap_or_default()
}

/// Declares the variables of a delay: what they are called and where they start.
fn declare(model: &mut Model, section: &Section, order: u32) {
    let scale = scale(model, section.value);
    let quantity = |var: VarId, count: u32, text: String| Quantity {
        var: Some(var),
        name: model.vars[var].name.clone(),
        axes: if count == 1 { Vec::new() } else { vec![Axis::Numbers { first: 1, count, set: String::new() }] },
        pattern: None,
        unit: "1".to_owned(),
        text,
        low: vec![f64::NEG_INFINITY],
        high: vec![f64::INFINITY],
        default: vec![0.0],
        scale: vec![scale],
        affine_unit: false,
        structural: false,
        nonnegative: false,
    };
    let name = &section.about.name;
    let delayed = quantity(section.delayed, section.about.count, format!("{name}, by a Padé approximation of order {order}"));
    let states = quantity(section.states, section.about.count * order, format!("states of the Padé approximation of {name}"));
    let quantities = &mut model.interface.quantities;
    let first: usize = quantities.algebraics.iter().map(Quantity::len).sum();
    quantities.algebraics.push(delayed);
    quantities.push_state(states);
    let last = model.unknowns.iter().rposition(|var| model.vars[*var].role == Role::State).map_or(0, |at| at + 1);
    model.unknowns.insert(last, section.states);
    let target = Target::out(section.at.plus(Affine::constant(first as i64)));
    let value = model.exprs.load(section.delayed, Flavour::Value, section.at);
    model.programs.outputs.nests.push(Nest { loops: section.loops.clone(), stores: vec![Store { target, value }] });
    let start = section.before.unwrap_or(section.value);
    let stores = (1..=order).map(|i| {
        let factor = model.exprs.constant(if i.is_multiple_of(2) { 0.0 } else { 2.0 });
        let target = Target { place: Place::Var(section.states), at: state(section, order, i) };
        Store { target, value: model.exprs.mul(factor, start) }
    });
    let stores = stores.collect();
    model.programs.initial_states.nests.push(Nest { loops: section.loops.clone(), stores });
}

/// Place of a state of the approximation, from 1 on.
fn state(section: &Section, order: u32, i: u32) -> Affine {
    section.at.times(i64::from(order)).plus(Affine::constant(i64::from(i) - 1))
}

/// Magnitude of a delayed expression: the largest of what it reads.
fn scale(model: &Model, value: ExprId) -> f64 {
    let quantities = &model.interface.quantities;
    let families = [&quantities.states, &quantities.algebraics, &quantities.actions, &quantities.discretes, &quantities.disturbances];
    let of = |var: VarId| families.into_iter().flatten().find(|q| q.var == Some(var)).and_then(|q| q.scale.first().copied());
    let read = model.exprs.loads(value, |_, flavour| flavour == Flavour::Value);
    let largest = read.into_iter().filter_map(|(var, ..)| of(var)).filter(|scale| scale.is_finite()).fold(0.0, f64::max);
    if largest > 0.0 { largest } else { 1.0 }
}

/// The equations of a delay.
fn add_equations(model: &mut Model, equations: &mut Vec<Equation>, section: &Section, order: u32) {
    let depth = section.loops.iter().map(|(depth, _)| usize::from(*depth) + 1).max().unwrap_or(0);
    let mut extents = vec![1; depth];
    section.loops.iter().for_each(|&(depth, extent)| extents[usize::from(depth)] = extent);
    let mut push = |form| equations.push(Equation { extents: extents.clone(), runs: 0, repeats: None, form, span: section.about.span });
    let exprs = &mut model.exprs;
    let signed = |exprs: &mut crate::ir::Exprs, i: u32| if i.is_multiple_of(2) { section.value } else { exprs.neg(section.value) };
    let last = exprs.load(section.states, Flavour::Value, state(section, order, order));
    let direct = signed(exprs, order);
    let value = exprs.add(last, direct);
    push(EquationForm::Definition { var: section.delayed, at: section.at, value });
    let delayed = exprs.load(section.delayed, Flavour::Value, section.at);
    for i in 1..=order {
        let before = if i == 1 { exprs.constant(0.0) } else { exprs.load(section.states, Flavour::Value, state(section, order, i - 1)) };
        let own = signed(exprs, i - 1);
        let sum = exprs.add(before, own);
        let sum = exprs.sub(sum, delayed);
        let factor = exprs.constant(coefficient(order, i - 1) / coefficient(order, i));
        let scaled = exprs.mul(factor, sum);
        let value = exprs.div(scaled, section.lag);
        push(EquationForm::Rate { var: section.states, at: state(section, order, i), value });
    }
}

/// cₖ of the approximation of order n, n! (2n - k)! / ((2n)! k! (n - k)!).
fn coefficient(n: u32, k: u32) -> f64 {
    (0..k).map(|i| f64::from(n - i) / (f64::from(2 * n - i) * f64::from(i + 1))).product()
}

/// Refuses delays of what reads algebraic variables and has no value before the start.
fn refuse_unknown_starts(model: &Model, sections: &[Section]) -> Result<(), Faults> {
    let mut faults = Faults::default();
    for section in sections {
        let start = section.before.unwrap_or(section.value);
        let unknown = |var: VarId, flavour: Flavour| {
            flavour == Flavour::Derivative || matches!(model.vars[var].role, Role::Algebraic | Role::Delayed)
        };
        let Some((var, ..)) = model.exprs.loads(start, unknown).into_iter().next() else { continue };
        let message =
            format!("the approximation of `{}` starts from `{}`, which is not known ahead", section.about.name, model.vars[var].name);
        let fault = Diagnostic::error(codes::WRONG_ARGUMENTS, message, section.about.span);
        faults.push(fault.help("state the value before the start, `delay(e, theta, before = e0)`, or delay a state"));
    }
    if faults.is_empty() { Ok(()) } else { Err(faults) }
}

#[cfg(test)]
mod tests {
    use super::coefficient;

    #[test]
    fn coefficients_are_those_of_the_published_approximations() {
        // 1, 1/2, 1/12 of order 2; 1, 1/2, 1/10, 1/120 of order 3.
        assert_eq!([0, 1, 2].map(|k| coefficient(2, k)), [1.0, 0.5, 1.0 / 12.0]);
        let third = [0, 1, 2, 3].map(|k| coefficient(3, k));
        third.into_iter().zip([1.0, 0.5, 0.1, 1.0 / 120.0]).for_each(|(found, right)| assert!((found - right).abs() < 1e-16));
    }
}
