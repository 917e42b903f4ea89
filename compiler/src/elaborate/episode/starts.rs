//! Conditions at the start of an episode: `initial eq p = 2 [bar]`, `initial d/dt T = 0`, `initial
//! steady for (T, c)`.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Expr, Statement, StatementKind};

use crate::elaborate::episode::common::{each, store};
use crate::elaborate::episode::steady::{instances_named, states_of_instances};
use crate::elaborate::equations::sides;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, boxes, nests};
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{ScopeId, SymbolKind};
use crate::ir::{Affine, Expr as Node, ExprId, Flavour, LoopVar, Nest, Place as Memory, Program, Role, VarId};
use crate::model::StartCondition;

/// Conditions as they are collected.
#[derive(Default)]
struct Conditions {
    nests: Vec<Nest>,
    list: Vec<StartCondition>,
    count: i64,
}

/// The program that gives left less right side of each condition, and what is known of each: one
/// nest for each.
pub(in crate::elaborate) fn start_conditions<'a>(
    l: &mut Lowering<'_, 'a>,
    blocks: &[(ScopeId, Vec<Item<'a>>)],
) -> (Program, Vec<StartCondition>) {
    let mut out = Conditions::default();
    for (scope, item) in each(blocks) {
        let Item::Other(Statement { kind, span }) = item else { continue };
        match kind {
            StatementKind::StartEquation { lhs, rhs, free, binders } => equation(l, scope, (lhs, rhs), (free, binders), *span, &mut out),
            StatementKind::StartSteady { targets } => targets.iter().for_each(|target| steady(l, scope, target, &mut out)),
            _ => {}
        }
    }
    (Program { nests: out.nests, in_place: false }, out.list)
}

fn equation(
    l: &mut Lowering<'_, '_>,
    scope: ScopeId,
    (lhs, rhs): (&Expr, &Expr),
    (free, binders): (&[Expr], &[Binder]),
    span: Span,
    out: &mut Conditions,
) {
    let place = Place::new(scope, Site::Dynamics);
    let free: Vec<String> = free.iter().flat_map(|target| free_states(l, target, &place)).collect();
    l.ledger.reports.statement = span;
    let pieces = nests::nest(l, binders, &place, &mut |s, inner| sides(s, (lhs, rhs), inner, span));
    l.ledger.reports.statement = Span::default();
    let before = out.count;
    for piece in pieces {
        let Some((left, right)) = piece.value else { continue };
        let residual = l.exprs.sub(left, right);
        if !l.symbols.reads_unknown(l.exprs, residual) && !l.exprs.has_derivative(residual) {
            let text = "neither a state nor a variable occurs in this condition at the start";
            let help = "relate a variable, a state or a rate to its value: `initial eq p = 2 [bar]`";
            l.ledger.report(Diagnostic::error(codes::WRONG_KIND, text, lhs.span).help(help));
            continue;
        }
        let own = match free.as_slice() {
            [] => rate_given(l, (left, right), &piece.extents),
            given => given.to_vec(),
        };
        out.add(piece.extents, residual, span, (own, !free.is_empty()));
    }
    let conditions = out.count - before;
    if !free.is_empty() && (free.len() as i64) < conditions {
        let text = format!("{conditions} conditions need as many free states, {} are named", free.len());
        l.ledger.report(Diagnostic::error(codes::WRONG_KIND, text, span).help("name more states behind `free`, or none"));
    }
}

/// All rates of a variable, or of an instance, are zero.
fn steady(l: &mut Lowering<'_, '_>, scope: ScopeId, target: &Expr, out: &mut Conditions) {
    let place = Place::new(scope, Site::Dynamics);
    for (var, element) in states_of(l, target, &place) {
        let len = l.symbols.vars[var].len;
        let (extents, at) = match element {
            Some(at) => (Vec::new(), Affine::constant(at)),
            None if len == 1 => (Vec::new(), Affine::constant(0)),
            None => (vec![len], Affine::along(0, LoopVar(0), 1)),
        };
        let rate = l.exprs.load(var, Flavour::Derivative, at);
        let free = names(l, var, element);
        out.add(extents, rate, target.span, (free, false));
    }
}

impl Conditions {
    /// Adds a nest of conditions.
    fn add(&mut self, extents: Vec<u32>, residual: ExprId, span: Span, (free, only): (Vec<String>, bool)) {
        let mut at = Affine::constant(self.count);
        let mut count = 1;
        for (depth, &extent) in extents.iter().enumerate().rev() {
            at = at.plus(Affine::along(0, LoopVar(depth as u8), count));
            count *= i64::from(extent);
        }
        self.nests.push(Nest::over(extents, vec![store(Memory::Out, at, residual)]));
        self.list.push(StartCondition { span, count: count as u32, free, only });
        self.count += count;
    }
}

/// The states whose rates one side gives: `d/dt T = 0` determines `T` first.
fn rate_given(l: &mut Lowering<'_, '_>, (left, right): (ExprId, ExprId), extents: &[u32]) -> Vec<String> {
    let Node::Load { var, flavour: Flavour::Derivative, at } = l.exprs.node(left) else { return Vec::new() };
    if l.exprs.has_derivative(right) {
        return Vec::new();
    }
    let mut elements = Vec::new();
    nests::for_each_element(extents, at, &mut |i| elements.push(i));
    elements.into_iter().flat_map(|i| names(l, var, Some(i))).collect()
}

/// Names of the states that an entry of `free` frees.
fn free_states(l: &mut Lowering<'_, '_>, target: &Expr, place: &Place) -> Vec<String> {
    states_of(l, target, place).into_iter().flat_map(|(var, element)| names(l, var, element)).collect()
}

/// A state, an element of one, or all states of an instance.
fn states_of(l: &mut Lowering<'_, '_>, target: &Expr, place: &Place) -> Vec<(VarId, Option<i64>)> {
    if let Some((list, scope)) = l.symbols.tuple(target, place) {
        let there = Place::new(scope, place.site);
        return list.iter().flat_map(|e| states_of(l, e, &there)).collect();
    }
    if let Some(path) = instances_named(l, target, place.scope) {
        return states_of_instances(l, &path).into_iter().map(|var| (var, None)).collect();
    }
    let Some((symbol, at)) = boxes::target(l, target, place, &[Role::State]) else { return Vec::new() };
    let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind else { return Vec::new() };
    vec![(var, at.map(|at| at.offset))]
}

/// Name of an element, or names of all of them.
fn names(l: &Lowering<'_, '_>, var: VarId, element: Option<i64>) -> Vec<String> {
    let Some(quantity) = l.quantities.get(&var) else { return Vec::new() };
    match element {
        Some(at) => vec![quantity.element_name(at.max(0) as usize)],
        None => (0..quantity.len()).map(|i| quantity.element_name(i)).collect(),
    }
}
