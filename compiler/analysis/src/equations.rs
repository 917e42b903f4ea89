//! Typeset equations, each with the place of its text.

use smpl_dsl::latex;
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Role, Statement, StatementKind};

use crate::hover::definition;
use crate::program::Program;

/// An equation in LaTeX.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Typeset {
    /// Its text.
    pub span: Span,
    /// The equation, for math mode.
    pub latex: String,
    /// Names of the components and alternatives around it, the outermost first.
    pub within: Vec<String>,
    /// It is a definition (`let`), not an equation.
    pub definition: bool,
}

/// All equations and definitions of a program, file by file in the order of the text.
#[must_use]
pub fn equations(program: &Program) -> Vec<Typeset> {
    let mut out = Vec::new();
    for file in &program.files {
        collect(&file.tree.statements, &mut Vec::new(), &mut out);
    }
    out
}

fn collect(statements: &[Statement], within: &mut Vec<String>, out: &mut Vec<Typeset>) {
    for statement in statements {
        let mut push = |span: Span, latex: String, definition: bool| out.push(Typeset { span, latex, within: within.clone(), definition });
        match &statement.kind {
            StatementKind::Equation { lhs, rhs, binders } => push(statement.span, latex::equation(lhs, rhs, binders), false),
            StatementKind::Declare { role: Role::Let, declarations } => {
                declarations.iter().for_each(|d| {
                    if let Some(latex) = definition(d) {
                        push(d.span, latex, true);
                    }
                });
            }
            StatementKind::Flux(flux) => {
                let latex = format!("{} = {}", latex::name(&flux.name.text), latex::expression(&flux.inner));
                push(statement.span, latex, true);
            }
            _ => {
                let name = match &statement.kind {
                    StatementKind::Component { name, .. } | StatementKind::Variant { name, .. } => name.text.clone(),
                    StatementKind::When { choice, option, .. } => format!("{} = {}", choice.text, option.text),
                    _ => continue,
                };
                within.push(name);
                collect(statement.kind.block(), within, out);
                within.pop();
            }
        }
    }
}
