//! Faults of a system whose equations and unknowns do not match: one for each cause.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use smpl_dsl::diagnostic::{Diagnostic, Faults, codes};
use smpl_dsl::span::Span;

use super::algebraic::Element;
use super::common::element_name;
use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Expr, ExprId, FastMap, FastSet, Flavour, Role, VarId};
use crate::model::Model;

/// Most equations that one fault shows.
const SHOWN: usize = 8;

/// Most statements whose fault is explained: of more, each is looked for in all equations, and not
/// shown.
const EXPLAINED: usize = 50;

const NO_UNKNOWN: &str = "this equation has no unknown that is not determined already";

/// An equation without an unknown.
pub(super) struct LeftOver {
    /// The statement.
    pub span: Span,
    /// Left side less right side.
    pub residual: ExprId,
    /// Unknown for which it is written, and the equation that determines that unknown.
    pub written_for: Option<(Element, Span)>,
    /// The unknowns that it and the equations of those could determine.
    pub reach: Rc<[Element]>,
}

/// Result of matching.
pub(super) struct Findings<'f> {
    /// The equations of the text before any substitution.
    pub equations: &'f [Equation],
    /// Equations without an unknown.
    pub left: Vec<LeftOver>,
    /// Unknowns without an equation, in the order of their variables.
    pub missing: Vec<Element>,
    /// The other unknowns that might be without an equation instead of one that is.
    pub instead: FastMap<Element, Vec<Element>>,
    /// The statement that determines each unknown.
    pub owners: FastMap<Element, Span>,
}

/// The faults.
pub(super) fn faults(model: &Model, found: &Findings<'_>) -> Faults {
    let mut faults = Faults::default();
    // Elements of one statement are one fault.
    let mut by_statement: BTreeMap<Span, Vec<&LeftOver>> = BTreeMap::new();
    for left in found.left.iter().filter(|left| left.reach.is_empty() || left.written_for.is_some()) {
        by_statement.entry(left.span).or_default().push(left);
    }
    for (at, alike) in by_statement.into_values().enumerate() {
        if at < EXPLAINED {
            let fault = without_unknown(model, found, &alike);
            faults.push(fault);
        } else {
            faults.push_with(|| Diagnostic::error(codes::OVERDETERMINED, NO_UNKNOWN, alike[0].span));
        }
    }
    for group in competing(&found.left) {
        faults.push(too_many(model, found, &group));
    }
    faults.append(undetermined(model, found));
    faults
}

/// An equation whose unknowns, if any, are determined by others; the elements of one statement.
fn without_unknown(model: &Model, found: &Findings<'_>, alike: &[&LeftOver]) -> Diagnostic {
    let LeftOver { span, residual, written_for, .. } = alike[0];
    let more = if alike.len() > 1 { format!(" (and {} more of its elements)", alike.len() - 1) } else { String::new() };
    if let Some(((var, element), first)) = written_for {
        let name = element_name(model, *var, (*element).max(0));
        return Diagnostic::error(codes::OVERDETERMINED, format!("two equations determine `{name}`{more}"), *span)
            .label("the second one")
            .secondary(*first, "the first one")
            .help("remove one of them, or declare what the second should determine as a `var`");
    }
    if let Some(fault) = given(model, *residual, *span) {
        return fault;
    }
    let states = states_of(model, *residual);
    if states.is_empty() {
        return Diagnostic::error(codes::OVERDETERMINED, NO_UNKNOWN, *span)
            .secondaries(definitions(model, found, *span))
            .help("remove it, or declare what it should determine as a `var` without another equation");
    }
    // Without an unknown that lacks an equation, one equation is too many.
    let definitions = definitions(model, found, *span);
    if found.missing.is_empty() && !definitions.is_empty() {
        let mut names: Vec<String> = definitions.iter().map(|(name, _)| format!("`{name}`")).collect();
        names.dedup();
        let message =
            format!("more equations than unknowns: with those of {} this one fixes the state {}", names.join(", "), listed(model, &states));
        return Diagnostic::error(codes::OVERDETERMINED, message, *span)
            .label("one of these equations is too many")
            .secondaries(definitions.into_iter().map(|(name, span)| (format!("determines `{name}`"), span)))
            .help("remove one of them, or declare a parameter or variable in them as a `var`");
    }
    let message = format!("this equation binds states only ({}){more}: the system has an index above 1", listed(model, &states));
    Diagnostic::error(codes::HIGH_INDEX, message, *span)
        .label("constrains states, determines nothing")
        .help("remove it, or an equation of a rate: no time derivative of it contains an unknown without an equation")
}

fn states_of(model: &Model, residual: ExprId) -> Vec<Element> {
    let loads = model.exprs.loads(residual, |v, f| f == Flavour::Value && model.vars[v].role == Role::State);
    loads.into_iter().map(|(v, _, at)| (v, at.offset)).collect()
}

/// The algebraic variables that a statement reads, with the equations that determine them.
fn definitions(model: &Model, found: &Findings<'_>, span: Span) -> Vec<(String, Span)> {
    let mut read: BTreeSet<VarId> = BTreeSet::new();
    for equation in found.equations.iter().filter(|equation| equation.span == span) {
        let loads = model.exprs.loads(equation.form.value(), |v, f| f == Flavour::Value && model.vars[v].role == Role::Algebraic);
        read.extend(loads.into_iter().map(|(var, ..)| var));
    }
    let defines = |equation: &Equation| match equation.form {
        EquationForm::Definition { var, .. } if read.contains(&var) && equation.span != span => Some((var, equation.span)),
        _ => None,
    };
    let mut seen: FastSet<Span> = FastSet::default();
    let all = found.equations.iter().filter_map(defines).filter(|(_, span)| seen.insert(*span));
    all.take(SHOWN).map(|(var, span)| (model.vars[var].name.clone(), span)).collect()
}

/// Equations that compete for the same unknowns.
fn competing(left: &[LeftOver]) -> Vec<Vec<&LeftOver>> {
    let mut groups: Vec<(BTreeSet<Element>, Vec<&LeftOver>)> = Vec::new();
    for equation in left.iter().filter(|left| !left.reach.is_empty() && left.written_for.is_none()) {
        match groups.iter_mut().find(|(reach, _)| equation.reach.iter().any(|e| reach.contains(e))) {
            Some((reach, group)) => {
                reach.extend(equation.reach.iter().copied());
                group.push(equation);
            }
            None => groups.push((equation.reach.iter().copied().collect(), vec![equation])),
        }
    }
    groups.into_iter().map(|(_, group)| group).collect()
}

/// More equations than unknowns, with all that compete.
fn too_many(model: &Model, found: &Findings<'_>, group: &[&LeftOver]) -> Diagnostic {
    let reach: BTreeSet<Element> = group.iter().flat_map(|left| left.reach.iter().copied()).collect();
    let reach: Vec<Element> = reach.into_iter().collect();
    let span = group[0].span;
    let count = reach.len() + group.len();
    let unknowns = if reach.len() == 1 { "1 unknown".to_owned() } else { format!("{} unknowns", reach.len()) };
    let message = format!("{count} equations for {unknowns}: {}", listed(model, &reach));
    let mut others: BTreeSet<Span> = reach.iter().filter_map(|element| found.owners.get(element)).copied().collect();
    others.extend(group.iter().map(|left| left.span));
    others.remove(&span);
    let more = others.len().saturating_sub(SHOWN);
    let fault = Diagnostic::error(codes::OVERDETERMINED, message, span)
        .label("one of these equations is too many")
        .secondaries(others.into_iter().take(SHOWN).map(|span| ("competes with it".to_owned(), span)))
        .help("remove one of the equations, or declare another unknown as a `var`");
    if more > 0 { fault.note(format!("{more} more statements compete with it")) } else { fault }
}

/// `q = ...` for something that is given from outside.
fn given(model: &Model, residual: ExprId, span: Span) -> Option<Diagnostic> {
    let Expr::Binary(crate::ir::BinaryFn::Sub, own, _) = model.exprs.node(residual) else { return None };
    let Expr::Load { var, .. } = model.exprs.node(own) else { return None };
    let v = &model.vars[var];
    let (what, help) = match v.role {
        Role::Action => ("an action: it is set from outside", "make it a `var`"),
        Role::Param => ("a parameter: its value is in its declaration", "write the value there, or make it a `let`"),
        Role::Discrete => {
            ("a discrete variable: it changes at sampling instants", "write `next` in `at start` or `at end`, or make it a `var`")
        }
        Role::Disturbance => ("a disturbance: its rule is in its declaration", "write `~ rule` there, or make it a `var`"),
        _ => return None,
    };
    let d = Diagnostic::error(codes::OVERDETERMINED, format!("no equation can determine `{}`, {what}", v.name), span);
    Some(d.secondary(v.span, "declared here").help(help))
}

/// One report for each variable, however many of its elements are undetermined, and one for all
/// ports that lack a connection.
fn undetermined(model: &Model, found: &Findings<'_>) -> Faults {
    let mut out = Faults::default();
    let mut ports: Vec<(String, Vec<String>, Span)> = Vec::new();
    for elements in found.missing.chunk_by(|a, b| a.0 == b.0) {
        let var = elements[0].0;
        match port_of(model, var) {
            Some((port, member)) => match ports.iter_mut().find(|(name, ..)| *name == port) {
                Some((_, members, _)) => members.push(member),
                None => ports.push((port, vec![member], model.vars[var].span)),
            },
            None => out.push_with(|| without_equation(model, found, elements)),
        }
    }
    if let Some((first, members, span)) = ports.first() {
        let more = if ports.len() > 1 { format!(" (and {} more)", ports.len() - 1) } else { String::new() };
        let message = format!("the port `{first}`{more} is not connected");
        let list = members.iter().map(|member| format!("`{first}.{member}`")).collect::<Vec<_>>().join(", ");
        let example = format!("write `connect ... -> {first}`, or an equation for each of {list}");
        let mut fault = Diagnostic::error(codes::UNDERDETERMINED, message, *span).label("its members have no equation").help(example);
        if ports.len() > 1 {
            let names: Vec<String> = ports.iter().take(SHOWN).map(|(name, ..)| format!("`{name}`")).collect();
            let rest = if ports.len() > SHOWN { format!(" and {} more", ports.len() - SHOWN) } else { String::new() };
            fault = fault.note(format!("without a connection: {}{rest}", names.join(", ")));
        }
        out.push(fault);
    }
    out
}

/// The port and member that a variable is.
fn port_of(model: &Model, var: VarId) -> Option<(String, String)> {
    let name = &model.vars[var].name;
    let member = |port: &crate::model::Port| port.members.iter().find(|m| m.output == *name).map(|m| (port.name.clone(), m.name.clone()));
    model.interface.ports.iter().find_map(member)
}

fn without_equation(model: &Model, found: &Findings<'_>, elements: &[Element]) -> Diagnostic {
    let ((var, i), count) = (elements[0], elements.len());
    let v = &model.vars[var];
    let name = element_name(model, var, i);
    let is_state = v.role == Role::State;
    let what = if is_state { format!("`d/dt {name}`") } else { format!("`{name}`") };
    let more = if count > 1 { format!(" (and {} more of its elements)", count - 1) } else { String::new() };
    let whole = count > 1 && count == v.len as usize;
    let own = match model.interface.quantities.states.iter().chain(&model.interface.quantities.algebraics).find(|q| q.var == Some(var)) {
        Some(q) if whole && !q.axes.is_empty() => format!("{}[{}]", q.name, vec!["..."; q.axes.len()].join(", ")),
        _ => name.clone(),
    };
    let help =
        if is_state { format!("add `eq d/dt {own} = ...`") } else { format!("add `eq {own} = ...`, or make it a `let` or a `param`") };
    let fault = Diagnostic::error(codes::UNDERDETERMINED, format!("no equation determines {what}{more}"), v.span)
        .label("has no equation")
        .help(help);
    match found.instead.get(&elements[0]).filter(|others| !others.is_empty()) {
        Some(others) if count == 1 => {
            let one = if others.len() > 1 { "one of " } else { "" };
            fault.note(format!("an equation for {one}{} would do as well", listed(model, others)))
        }
        _ => fault,
    }
}

/// Names of elements, the first few of many.
fn listed(model: &Model, elements: &[Element]) -> String {
    const NAMED: usize = 6;
    let mut text = elements.iter().take(NAMED).map(|&(v, i)| format!("`{}`", element_name(model, v, i))).collect::<Vec<_>>().join(", ");
    if elements.len() > NAMED {
        text.push_str(&format!(" and {} more", elements.len() - NAMED));
    }
    text
}
