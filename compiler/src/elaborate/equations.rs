//! Equations and connections.

use std::collections::BTreeMap;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Expr, StatementKind};

use super::items::Item;
use super::names::{Axis, ScopeId, SymbolId, SymbolKind};
use super::quantity::Measure;
use super::runs::SHORTEST;
use super::{Elaborator, Site, units};
use crate::ir::{Affine, Expr as Node, ExprId, Flavour, LoopVar, Role, VarId};

/// An equation over a nest of loops.
#[derive(Clone, Debug)]
pub struct Equation {
    /// Extents of its loops.
    pub extents: Vec<u32>,
    /// Which of its loops count numbers, by bit: they may be written out.
    pub runs: u8,
    /// The element of an algebraic variable that another equation defines as well.
    pub repeats: Option<(VarId, i64)>,
    /// What it says.
    pub form: EquationForm,
    /// Where it stands.
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

impl<'a> Elaborator<'a> {
    pub(super) fn elaborate_equations(&mut self) {
        let blocks = std::mem::take(&mut self.blocks);
        for (scope, items) in &blocks {
            for item in items {
                let Item::Other(statement) = item else { continue };
                match &statement.kind {
                    StatementKind::Equation { lhs, rhs, binders } => self.equation(*scope, lhs, rhs, binders, statement.span),
                    StatementKind::Connect { chain } => self.connect(*scope, chain, statement.span),
                    _ => {}
                }
            }
        }
        self.blocks = blocks;
    }

    fn equation(&mut self, scope: ScopeId, lhs: &Expr, rhs: &Expr, binders: &[Binder], span: Span) {
        let place = self.place(scope, Site::Dynamics);
        self.statement = span;
        let before = self.diagnostics.len();
        let pieces = self.looped_nest(binders, &place, &mut |s, inner| {
            let left = s.value(lhs, inner);
            let right = s.value(rhs, inner);
            if left.is_poison() || right.is_poison() {
                s.refuse();
                return None;
            }
            let (left, right) = match (&left.unit, &right.unit) {
                (Measure::Truth, _) | (_, Measure::Truth) => {
                    s.report(
                        Diagnostic::error(codes::WRONG_KIND, "an equation has a number on each side, this is a condition", span)
                            .help("write `if condition then 1 else 0`"),
                    );
                    return None;
                }
                (Measure::Zero, _) | (_, Measure::Zero) => (left.expr, right.expr),
                (m, n) => {
                    let (ul, ur) = (m.unit(), n.unit());
                    s.warn_of_scale((&left, lhs.span), (&right, rhs.span));
                    match s.convert(right.expr, &ur, &ul) {
                        Some(converted) => (left.expr, converted),
                        None => {
                            s.report(units::sides(&ul, lhs.span, &ur, rhs.span));
                            return None;
                        }
                    }
                }
            };
            let form = s.form(left, right);
            let runs = inner.runs();
            if runs != 0 && !(s.may_loop(form) && s.shares_sums(form, runs, inner.depth)) {
                s.refuse();
            }
            Some((form, runs))
        });
        self.statement = Span::default();
        self.blame_lengths(before, &[lhs, rhs]);
        for piece in pieces {
            if let Some((form, runs)) = piece.value {
                self.equations.push(Equation { extents: piece.extents, runs, repeats: None, form, span });
            }
        }
    }

    fn form(&mut self, left: ExprId, right: ExprId) -> EquationForm {
        for (own, value) in [(left, right), (right, left)] {
            match self.exprs.node(own) {
                Node::Load { var, flavour: Flavour::Derivative, at } => return EquationForm::Rate { var, at, value },
                // What determines a rate is no definition: `M * d/dt x = v`.
                Node::Load { var, flavour: Flavour::Value, at }
                    if self.vars[var].role == Role::Algebraic && !self.exprs.has_derivative(value) =>
                {
                    return EquationForm::Definition { var, at, value };
                }
                _ => {}
            }
        }
        EquationForm::Implicit { residual: self.exprs.sub(left, right) }
    }

    /// Whether an equation over a range of numbers may be a loop: not where it couples derivatives, which are eliminated one by one.
    fn may_loop(&self, form: EquationForm) -> bool {
        match form {
            EquationForm::Rate { value, .. } | EquationForm::Definition { value, .. } => !self.exprs.has_derivative(value),
            EquationForm::Implicit { residual } => crate::structure::derivatives(&self.exprs, residual, |_| true).len() == 1,
        }
    }

    /// Whether no sum depends on a range and not on a loop around it, which would repeat it in each pass.
    fn shares_sums(&self, form: EquationForm, runs: u8, depth: u8) -> bool {
        let repeats = |free: u8| (0..depth).any(|d| runs & free & (1 << d) != 0 && !free & ((1 << d) - 1) != 0);
        !self.exprs.has_reduction(form.value(), repeats)
    }

    /// `connect a -> b`: every member of `b` equals that of `a`.
    fn connect(&mut self, scope: ScopeId, chain: &[Expr], span: Span) {
        let place = self.place(scope, Site::Dynamics);
        for pair in chain.windows(2) {
            let (Some(from), Some(to)) = (self.scope_of(&pair[0], &place), self.scope_of(&pair[1], &place)) else { continue };
            let members = |s: &Self, scope: ScopeId| -> BTreeMap<String, SymbolId> {
                s.names.scopes[scope].names.iter().map(|(n, &id)| (n.clone(), id)).collect()
            };
            let (sources, targets) = (members(self, from), members(self, to));
            if sources.keys().ne(targets.keys()) {
                self.report(
                    Diagnostic::error(codes::WRONG_SHAPE, "two ports of different connectors are connected", span)
                        .secondary(pair[0].span, "this one")
                        .secondary(pair[1].span, "and this one"),
                );
                continue;
            }
            for (name, source) in sources {
                if let Some(&target) = targets.get(&name) {
                    self.join(source, target, span);
                }
            }
        }
    }

    fn join(&mut self, source: SymbolId, target: SymbolId, span: Span) {
        let (SymbolKind::Variable { var: from, axes: source_axes, unit, .. }, SymbolKind::Variable { var: to, axes, unit: wanted, .. }) =
            (self.names.symbols[source].kind.clone(), self.names.symbols[target].kind.clone())
        else {
            self.report(Diagnostic::error(codes::WRONG_KIND, "only ports are connected", span));
            return;
        };
        if self.vars[from].len != self.vars[to].len || source_axes.len() != axes.len() {
            self.report(Diagnostic::error(codes::WRONG_SHAPE, "two ports of different sizes are connected", span));
            return;
        }
        let len = i64::from(self.vars[to].len);
        let sets = axes.iter().all(|a| matches!(a, Axis::Set(_)));
        let addresses: Vec<(Vec<u32>, Affine)> = if sets && len < SHORTEST {
            (0..len).map(|i| (Vec::new(), Affine::constant(i))).collect()
        } else {
            vec![(vec![len as u32], Affine::along(0, LoopVar(0), 1))]
        };
        for (extents, at) in addresses {
            let runs = u8::from(sets && !extents.is_empty());
            let load = self.exprs.load(from, Flavour::Value, at);
            let Some(value) = self.convert(load, &unit, &wanted) else { continue };
            let form = EquationForm::Definition { var: to, at, value };
            self.equations.push(Equation { extents, runs, repeats: None, form, span });
        }
    }
}
