//! Typeset definitions of a file: equations, named expressions, functions, fluxes.

use smpl_dsl::latex;
use smpl_dsl::syntax::{
    Binder, Declaration, Expr, ExprKind, File, Flux, Ident, Local, Parameter, Reaction, ReactionTerm, Role, Statement, StatementKind,
};

/// The equations of a file and of its components in LaTeX, one display a line.
#[must_use]
pub(crate) fn latex(file: &File) -> String {
    let mut lines = Vec::new();
    collect(&file.statements, &mut lines);
    lines.into_iter().map(|line| line + "\n").collect()
}

fn collect(statements: &[Statement], lines: &mut Vec<String>) {
    for statement in statements {
        match &statement.kind {
            StatementKind::Equation { lhs, rhs, binders } => lines.push(latex::equation(lhs, rhs, binders)),
            StatementKind::Declare { role: Role::Let, declarations } => lines.extend(declarations.iter().filter_map(definition)),
            StatementKind::Def { name, parameters, locals, body } => lines.extend(function(name, parameters, locals, body)),
            StatementKind::Flux(flux) => lines.extend(flux_at_faces(flux)),
            StatementKind::Reaction(one) => lines.push(reaction(one)),
            StatementKind::Component { name, body, .. } => group("component", &name.text, body, lines),
            StatementKind::Variant { name, body, .. } => group("variant", &name.text, body, lines),
            StatementKind::When { choice, option, body } => group(&choice.text, &option.text, body, lines),
            _ => {}
        }
    }
}

/// The equations of a block under its name; nothing where it has none.
fn group(kind: &str, name: &str, body: &[Statement], lines: &mut Vec<String>) {
    let mut inner = Vec::new();
    collect(body, &mut inner);
    if !inner.is_empty() {
        let title = format!("{kind} {name}").replace('_', "\\_");
        lines.push(format!("\\textbf{{{title}}}"));
        lines.append(&mut inner);
    }
}

/// `let name[i in set] = value`
pub(super) fn definition(declaration: &Declaration) -> Option<String> {
    let left = element(&declaration.name, &declaration.indices);
    declaration.value.as_ref().map(|value| latex::equation(&left, value, &declaration.indices))
}

/// `def f(a, b) = body`, behind the lines of its local names.
pub(super) fn function(name: &Ident, parameters: &[Parameter], locals: &[Local], body: &Expr) -> Vec<String> {
    let of = |p: &Ident| expression(p, ExprKind::Name(p.clone()));
    let arguments = parameters.iter().map(|p| of(&p.name)).collect();
    let left = expression(name, ExprKind::Call { function: name.clone(), arguments });
    let lines = locals.iter().map(|local| latex::equation(&of(&local.name), &local.value, &[]));
    lines.chain([latex::equation(&left, body, &[])]).collect()
}

/// A reaction with its rate.
pub(super) fn reaction(reaction: &Reaction) -> String {
    let term = |term: &ReactionTerm| {
        let species = latex::name(&term.species.text);
        term.coefficient.as_ref().map_or(species.clone(), |e| format!("{}\\,{species}", latex::expression(e)))
    };
    let side = |consumed: bool| {
        let terms: Vec<String> = reaction.terms.iter().filter(|t| t.consumed == consumed).map(term).collect();
        if terms.is_empty() { "\\varnothing".to_owned() } else { terms.join(" + ") }
    };
    let d = &reaction.declaration;
    let rate = d
        .value
        .as_ref()
        .map(|rate| format!(", \\qquad {} = {}", latex::expression(&element(&d.name, &d.indices)), latex::expression(rate)));
    format!("{} \\rightarrow {}{}", side(true), side(false), rate.unwrap_or_default())
}

/// The flux inside, and at the ends where it is given.
pub(super) fn flux_at_faces(flux: &Flux) -> Vec<String> {
    let left = element(&flux.name, &flux.indices);
    let along = flux.indices.last().map(|binder| latex::expression(&expression(&binder.name, ExprKind::Name(binder.name.clone()))));
    let end = |value: &Option<Expr>, which: &str| {
        let (value, along) = (value.as_ref()?, along.as_ref()?);
        let left = latex::expression(&left);
        Some(format!("\\left. {left} \\right|_{{{along}\\ \\mathrm{{{which}}}}} = {}", latex::expression(value)))
    };
    let ends = [end(&flux.low, "low"), end(&flux.high, "high")];
    let inner = latex::equation(&left, &flux.inner, &flux.indices);
    std::iter::once(inner).chain(ends.into_iter().flatten()).collect()
}

/// A name with its indices.
pub(super) fn element(name: &Ident, indices: &[Binder]) -> Expr {
    let base = expression(name, ExprKind::Name(name.clone()));
    if indices.is_empty() {
        return base;
    }
    let own = indices.iter().map(|binder| expression(&binder.name, ExprKind::Name(binder.name.clone()))).collect();
    expression(name, ExprKind::Index(Box::new(base), own))
}

fn expression(at: &Ident, kind: ExprKind) -> Expr {
    Expr { span: at.span, kind }
}
