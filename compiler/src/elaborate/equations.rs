//! Equations and connections.

use std::collections::BTreeMap;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Declaration, Expr, ExprKind, StatementKind};

use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::ranges::SHORTEST;
use crate::elaborate::lower::value::Measure;
use crate::elaborate::lower::{Lowering, indices, nests, paths, units};
use crate::elaborate::select::items::Item;
use crate::elaborate::space::flux;
use crate::elaborate::symbols::{Axis, ScopeId, SymbolId, SymbolKind};
use crate::ir::{Affine, Expr as Node, ExprId, Flavour, LoopVar, Role, VarId};

/// An equation over a nest of loops.
#[derive(Clone, Debug)]
pub struct Equation {
    /// Extents of its loops.
    pub extents: Vec<u32>,
    /// Loops over numbers, by bit, which may be unrolled.
    pub runs: u8,
    /// The element of an algebraic variable that another equation defines as well.
    pub repeats: Option<(VarId, i64)>,
    /// Content.
    pub form: EquationForm,
    /// Place in the text.
    pub span: Span,
}

/// Forms of equation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EquationForm {
    /// `d/dt var[at] = value`
    Rate {
        /// The state.
        var: VarId,
        /// Its element.
        at: Affine,
        /// The right side.
        value: ExprId,
    },
    /// `var[at] = value`, `var` algebraic
    Definition {
        /// The variable.
        var: VarId,
        /// Its element.
        at: Affine,
        /// The right side.
        value: ExprId,
    },
    /// `0 = residual`
    Implicit {
        /// Left side minus right side.
        residual: ExprId,
    },
}

impl EquationForm {
    /// The right side, or the residual.
    pub fn value(self) -> ExprId {
        match self {
            EquationForm::Rate { value, .. } | EquationForm::Definition { value, .. } => value,
            EquationForm::Implicit { residual } => residual,
        }
    }
}

/// All equations and connections.
pub(in crate::elaborate) fn elaborate_equations(l: &mut Lowering<'_, '_>) -> Vec<Equation> {
    let mut out = Vec::new();
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
                StatementKind::Connect { chain, binders } => connections(l, *scope, (chain, binders), statement.span, &mut out),
                _ => {}
            }
        }
    }
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
            // What determines a rate is no definition: `M * d/dt x = v`.
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

/// `connect a[k] -> b[k] for k in 1..3`: one connection for each value of the indices.
fn connections(l: &mut Lowering<'_, '_>, scope: ScopeId, (chain, binders): (&[Expr], &[Binder]), span: Span, out: &mut Vec<Equation>) {
    let pieces = nests::nest(l, binders, &Place::new(scope, Site::Dynamics), &mut |s, inner| {
        let mut found = Vec::new();
        if inner.depth == 0 {
            connect(s, inner, chain, span, &mut found);
        } else {
            let message = "connections go over sets and ranges of numbers, not over the cells of a domain";
            s.ledger.report(Diagnostic::error(codes::WRONG_KIND, message, span));
        }
        found
    });
    out.extend(pieces.into_iter().flat_map(|piece| piece.value));
}

/// `connect a -> b`: every member of `b` equals that of `a`.
fn connect(l: &mut Lowering<'_, '_>, place: &Place, chain: &[Expr], span: Span, out: &mut Vec<Equation>) {
    for pair in chain.windows(2) {
        let (Some(from), Some(to)) = (paths::scope_of(l, &pair[0], place), paths::scope_of(l, &pair[1], place)) else { continue };
        let members = |s: &Lowering<'_, '_>, scope: ScopeId| -> BTreeMap<String, SymbolId> {
            s.symbols.scopes[scope].names.iter().map(|(n, &id)| (n.clone(), id)).collect()
        };
        let (sources, targets) = (members(l, from), members(l, to));
        if sources.keys().ne(targets.keys()) {
            let fault = different_connectors(l, [from, to], span);
            l.ledger.report(fault);
            continue;
        }
        for (name, source) in sources {
            if let Some(&target) = targets.get(&name) {
                join(l, [source, target], [from, to], span, out);
            }
        }
    }
}

/// The fault of a connection of two ports that do not fit, with the connectors of both.
fn different_connectors(l: &Lowering<'_, '_>, ports: [ScopeId; 2], span: Span) -> Diagnostic {
    let known = ports.map(|scope| {
        let path = l.symbols.scopes[scope].prefix.trim_end_matches('.').to_owned();
        let port = l.symbols.ports.iter().find(|port| port.path == path);
        (path, port.map(|port| port.connector.as_str()))
    });
    let [(a, Some(first)), (b, Some(second))] = &known else {
        return Diagnostic::error(codes::WRONG_SHAPE, "two ports of different connectors are connected", span);
    };
    let message = format!("ports of different connectors are connected: `{a}` is a `{first}`, `{b}` a `{second}`");
    let mut fault = Diagnostic::error(codes::WRONG_SHAPE, message, span);
    for connector in [first, second] {
        if let Some(declared) = l.instances.connectors.get(connector) {
            fault = fault.secondary(declared.span, format!("`{connector}`"));
        }
    }
    fault.help("give both ports the same connector")
}

fn join(
    l: &mut Lowering<'_, '_>,
    [source, target]: [SymbolId; 2],
    [from_port, to_port]: [ScopeId; 2],
    span: Span,
    out: &mut Vec<Equation>,
) {
    let (SymbolKind::Variable { var: from, axes: source_axes, unit, .. }, SymbolKind::Variable { var: to, axes, unit: wanted, .. }) =
        (l.symbols[source].kind.clone(), l.symbols[target].kind.clone())
    else {
        l.ledger.report(Diagnostic::error(codes::WRONG_KIND, "only ports are connected", span));
        return;
    };
    if l.symbols.vars[from].len != l.symbols.vars[to].len || source_axes.len() != axes.len() {
        let fault = different_connectors(l, [from_port, to_port], span);
        let (a, b) = (&l.symbols[source].path, &l.symbols[target].path);
        let (m, n) = (l.symbols.vars[from].len, l.symbols.vars[to].len);
        l.ledger.report(fault.note(format!("`{a}` and `{b}` have different sizes: {m} and {n}")));
        return;
    }
    let elsewhere = source_axes.iter().zip(axes.iter()).any(|pair| match pair {
        (Axis::Domain(a), Axis::Domain(b)) => !indices::same_cells(l, *a, *b),
        (a, b) => matches!(a, Axis::Domain(_)) || matches!(b, Axis::Domain(_)),
    });
    if elsewhere {
        let (a, b) = (&l.symbols[source].path, &l.symbols[target].path);
        let message = format!("the cells of `{a}` and `{b}` lie elsewhere");
        let help =
            "declare both domains with as many cells between the same ends, written with the same numbers and parameters of the file";
        l.ledger.report(Diagnostic::error(codes::WRONG_SHAPE, message, span).help(help));
        return;
    }
    let len = i64::from(l.symbols.vars[to].len);
    let sets = axes.iter().all(|a| matches!(a, Axis::Set(_)));
    let addresses: Vec<(Vec<u32>, Affine)> = if sets && len < SHORTEST {
        (0..len).map(|i| (Vec::new(), Affine::constant(i))).collect()
    } else {
        vec![(vec![len as u32], Affine::along(0, LoopVar(0), 1))]
    };
    for (extents, at) in addresses {
        let runs = u8::from(sets && !extents.is_empty());
        let load = l.exprs.load(from, Flavour::Value, at);
        let Some(value) = l.values().convert(load, &unit, &wanted) else { continue };
        let form = EquationForm::Definition { var: to, at, value };
        out.push(Equation { extents, runs, repeats: None, form, span });
    }
}
