//! Equations.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Declaration, Expr, ExprKind, StatementKind};

use crate::elaborate::connections::{Nodes, connections};
use crate::elaborate::equation::{Equation, EquationForm};
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::value::Measure;
use crate::elaborate::lower::{Lowering, nests, units};
use crate::elaborate::select::items::Item;
use crate::elaborate::space::flux;
use crate::elaborate::symbols::{ScopeId, SymbolKind};
use crate::ir::{Expr as Node, ExprId, Flavour, Role};

/// All equations and connections.
pub(in crate::elaborate) fn elaborate_equations(l: &mut Lowering<'_, '_>) -> Vec<Equation> {
    let mut out = Vec::new();
    let mut nodes = Nodes::default();
    for (scope, items) in &l.instances.blocks {
        for item in items {
            if let Item::Declare(_, Declaration { name, measured: Some(measured), span, .. }) = item
                && l.symbols.lookup(*scope, &name.text).is_some_and(|symbol| matches!(l.symbols[symbol].kind, SymbolKind::Variable { .. }))
            {
                let own = Expr { span: name.span, kind: ExprKind::Name(name.clone()) };
                equation(l, *scope, (&own, &measured.read, &[]), *span, &mut out);
            }
            let Item::Other(statement) = item else { continue };
            match &statement.kind {
                StatementKind::Equation { lhs, rhs, binders } => equation(l, *scope, (lhs, rhs, binders), statement.span, &mut out),
                StatementKind::Connect { chain, binders } => {
                    connections(l, *scope, (chain, binders), statement.span, (&mut out, &mut nodes));
                }
                _ => {}
            }
        }
    }
    nodes.close(l, &mut out);
    out
}

fn equation(l: &mut Lowering<'_, '_>, scope: ScopeId, (lhs, rhs, binders): (&Expr, &Expr, &[Binder]), span: Span, out: &mut Vec<Equation>) {
    let place = Place::new(scope, Site::Dynamics);
    l.ledger.reports.statement = span;
    let before = l.ledger.reports.diagnostics.len();
    let pieces = nests::looped_nest(l, binders, &place, &mut |s, inner| {
        let (left, right) = sides(s, (lhs, rhs), inner, span)?;
        let form = form(s, left, right);
        let runs = inner.runs();
        if runs != 0 && !(may_loop(s, form) && shares_sums(s, form, runs, inner.depth)) {
            s.ledger.speculation.refuse();
        }
        Some((form, runs))
    });
    l.ledger.reports.statement = Span::default();
    flux::blame_lengths(l, before, &[lhs, rhs]);
    for piece in pieces {
        if let Some((form, runs)) = piece.value {
            out.push(Equation { extents: piece.extents, runs, repeats: None, form, span });
        }
    }
}

/// The sides of an equation in one unit; `None` where they have none in common.
pub(in crate::elaborate) fn sides(
    l: &mut Lowering<'_, '_>,
    (lhs, rhs): (&Expr, &Expr),
    place: &Place,
    span: Span,
) -> Option<(ExprId, ExprId)> {
    let left = l.value(lhs, place);
    let right = l.value(rhs, place);
    if left.is_poison() || right.is_poison() {
        l.ledger.speculation.refuse();
        return None;
    }
    match (&left.unit, &right.unit) {
        (Measure::Truth, _) | (_, Measure::Truth) => {
            l.ledger.report(
                Diagnostic::error(codes::WRONG_KIND, "an equation has a number on each side, this is a condition", span)
                    .help("write `if condition then 1 else 0`"),
            );
            None
        }
        (m, n) if m.is_zero() || n.is_zero() => Some((left.expr, right.expr)),
        (m, n) => {
            let (ul, ur) = (m.unit(), n.unit());
            l.values().warn_of_scale((&left, lhs.span), (&right, rhs.span));
            match l.values().convert(right.expr, &ur, &ul) {
                Some(converted) => Some((left.expr, converted)),
                None => {
                    l.ledger.report(units::sides(&ul, lhs.span, &ur, rhs.span));
                    None
                }
            }
        }
    }
}

fn form(l: &mut Lowering<'_, '_>, left: ExprId, right: ExprId) -> EquationForm {
    for (own, value) in [(left, right), (right, left)] {
        match l.exprs.node(own) {
            Node::Load { var, flavour: Flavour::Derivative, at } if l.symbols.vars[var].role == Role::State => {
                return EquationForm::Rate { var, at, value };
            }
            // An equation that determines a rate is not a definition: `M * d/dt x = v`.
            Node::Load { var, flavour: Flavour::Value, at }
                if l.symbols.vars[var].role == Role::Algebraic && !l.exprs.has_derivative(value) =>
            {
                return EquationForm::Definition { var, at, value };
            }
            _ => {}
        }
    }
    EquationForm::Implicit { residual: l.exprs.sub(left, right) }
}

/// Returns `true` if an equation over a range of numbers may be a loop: not where it couples
/// derivatives, which are eliminated one by one.
fn may_loop(l: &Lowering<'_, '_>, form: EquationForm) -> bool {
    match form {
        EquationForm::Rate { value, .. } | EquationForm::Definition { value, .. } => !l.exprs.has_derivative(value),
        EquationForm::Implicit { residual } => l.exprs.derivatives(residual, |_| true).len() <= 1,
    }
}

/// Returns `true` if no sum depends on a range and not on a loop around it, which would repeat it
/// in each pass.
fn shares_sums(l: &Lowering<'_, '_>, form: EquationForm, runs: u8, depth: u8) -> bool {
    let repeats = |free: u8| (0..depth).any(|d| runs & free & (1 << d) != 0 && !free & ((1 << d) - 1) != 0);
    !l.exprs.has_reduction(form.value(), repeats)
}
