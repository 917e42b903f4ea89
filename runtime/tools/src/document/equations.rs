//! What defines the quantities of a file, typeset: equations, named expressions, functions, fluxes.

use smpl_dsl::latex;
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Declaration, Expr, ExprKind, File, Flux, Ident, Role, Statement, StatementKind};

/// A display: an equation, a definition, or the name of the block that those after it belong to.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Typeset {
    /// Mathematics in LaTeX.
    pub latex: String,
    /// `equation`, `let`, `def`, `flux` or `heading`.
    pub kind: &'static str,
    /// Name of what is defined, or of the block; empty for an equation.
    pub name: String,
    /// Its place.
    pub span: Span,
}

/// The equations of a file and of its components in LaTeX, one display a line.
#[must_use]
pub(crate) fn latex(file: &File) -> String {
    typeset(file).into_iter().map(|entry| entry.latex + "\n").collect()
}

/// The equations of a file and of its components, with their places.
#[must_use]
pub(crate) fn typeset(file: &File) -> Vec<Typeset> {
    let mut entries = Vec::new();
    collect(&file.statements, &mut entries);
    entries
}

fn collect(statements: &[Statement], entries: &mut Vec<Typeset>) {
    for statement in statements {
        let entry = |latex, kind, name: &str| Typeset { latex, kind, name: name.to_owned(), span: statement.span };
        match &statement.kind {
            StatementKind::Equation { lhs, rhs, binders } => entries.push(entry(latex::equation(lhs, rhs, binders), "equation", "")),
            StatementKind::Declare { role: Role::Let, declarations } => {
                let lets = declarations.iter().filter_map(|d| Some(Typeset { span: d.span, ..entry(definition(d)?, "let", &d.name.text) }));
                entries.extend(lets);
            }
            StatementKind::Def { name, parameters, body } => {
                entries.push(entry(function(name, parameters, body), "def", &name.text));
            }
            StatementKind::Flux(flux) => {
                entries.extend(flux_at_faces(flux).into_iter().map(|latex| entry(latex, "flux", &flux.name.text)));
            }
            StatementKind::Component { name, body, .. } => group(statement.span, "component", &name.text, body, entries),
            StatementKind::Variant { name, body, .. } => group(statement.span, "variant", &name.text, body, entries),
            StatementKind::When { choice, option, body } => group(statement.span, &choice.text, &option.text, body, entries),
            _ => {}
        }
    }
}

/// The equations of a block under its name; nothing where it has none.
fn group(span: Span, kind: &str, name: &str, body: &[Statement], entries: &mut Vec<Typeset>) {
    let mut inner = Vec::new();
    collect(body, &mut inner);
    if !inner.is_empty() {
        let title = format!("{kind} {name}");
        let latex = format!("\\textbf{{{}}}", title.replace('_', "\\_"));
        entries.push(Typeset { latex, kind: "heading", name: title, span });
        entries.append(&mut inner);
    }
}

/// `let name[i in set] = value`
pub(super) fn definition(declaration: &Declaration) -> Option<String> {
    let left = element(&declaration.name, &declaration.indices);
    declaration.value.as_ref().map(|value| latex::equation(&left, value, &declaration.indices))
}

/// `def f(a, b) = body`
pub(super) fn function(name: &Ident, parameters: &[Ident], body: &Expr) -> String {
    let arguments = parameters.iter().map(|p| expression(p, ExprKind::Name(p.clone()))).collect();
    let left = expression(name, ExprKind::Call { function: name.clone(), arguments });
    latex::equation(&left, body, &[])
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
