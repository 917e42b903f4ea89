//! The steady problem: values, free actions and conditions of `steady` blocks.

use std::ops::Range;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind, Statement, StatementKind};

use crate::elaborate::episode::common::{Given, each, store};
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, boxes, defaults};
use crate::elaborate::select::items::{Item, WHOLE, block_around, breadth};
use crate::elaborate::symbols::{ScopeId, SymbolKind};
use crate::ir::{Affine, ExprId, FastMap, Nest, Place as Memory, Program, Role, VarId};
use crate::model::{Quantity, Steady};

/// The steady problem as it is stated.
pub(in crate::elaborate) struct SteadyProgram {
    /// The given actions, states and conditions.
    pub program: Program,
    /// Given values.
    pub problem: Steady,
    /// A statement mentions it.
    pub declared: bool,
}

/// Entries of `steady` blocks.
pub(in crate::elaborate) fn steady_program<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> SteadyProgram {
    let SteadyText { declared, given, conditions, free } = steady_text(l, blocks);
    let mut values = steady_actions(l, &given);
    let mut base = 0_u32;
    let mut fixed = Vec::new();
    for var in l.variables_of(Role::State) {
        let len = l.symbols.vars[var].len;
        let here = (0..len).filter_map(|i| Some((base + i, *given.get(&(var, i64::from(i)))?)));
        for (position, value) in here {
            fixed.push(position);
            values.push(value);
        }
        base += len;
    }
    let count = conditions.len() as u32;
    values.extend(conditions);
    let stores = values.into_iter().enumerate().map(|(i, value)| store(Memory::Out, Affine::constant(i as i64), value)).collect();
    let program = Program { nests: vec![Nest { loops: Vec::new(), stores }], in_place: false };
    let problem = Steady { given: base > 0 && fixed.len() == base as usize && free.is_empty(), fixed, conditions: count, free };
    check_free(l, &problem, blocks);
    SteadyProgram { program, problem, declared }
}

/// The entries of `steady` blocks.
#[derive(Default)]
struct SteadyText {
    /// There is a block.
    declared: bool,
    /// Values of elements.
    given: FastMap<(VarId, i64), ExprId>,
    /// Expressions that must be zero.
    conditions: Vec<ExprId>,
    /// Actions that are found, by position.
    free: Vec<u32>,
}

/// An entry of a `steady` block.
struct SteadyEntry<'a> {
    scope: ScopeId,
    /// Number of the selection of statements that contains it: the text outside of variants and
    /// choices, or one of their blocks.
    block: usize,
    /// Of how much it is.
    breadth: usize,
    target: &'a Expr,
    value: &'a Expr,
}

/// The entries of all `steady` blocks, those of variants after those outside, and among them those
/// of fewer elements last.
fn steady_entries<'a>(l: &Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Vec<SteadyEntry<'a>> {
    let mut known: Vec<(ScopeId, Option<Span>)> = Vec::new();
    let mut out = Vec::new();
    for (scope, item) in each(blocks) {
        let Item::Other(Statement { kind: StatementKind::Steady { entries, .. }, span }) = item else { continue };
        let here = (scope, block_around(l.input.files, *span));
        let own = known.iter().rposition(|(s, _)| *s != scope).map_or(0, |before| before + 1);
        let block = own + known[own..].iter().position(|one| *one == here).unwrap_or(known.len() - own);
        if block == known.len() {
            known.push(here);
        }
        let place = Place::new(scope, Site::Instant);
        let each_target = entries.iter().flat_map(|(target, value)| match l.symbols.tuple(target, &place) {
            Some((list, scope)) => list.iter().map(|target| (scope, target, value)).collect(),
            None => vec![(scope, target, value)],
        });
        out.extend(each_target.map(|(scope, target, value)| {
            let instance = if instances_named(l, target, scope).is_some() { WHOLE } else { 0 };
            SteadyEntry { scope, block, breadth: instance + breadth(target, &[]), target, value }
        }));
    }
    out.sort_by_key(|entry| (entry.block, std::cmp::Reverse(entry.breadth)));
    out
}

fn steady_text<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> SteadyText {
    let declared = each(blocks).any(|(_, item)| matches!(item, Item::Other(Statement { kind: StatementKind::Steady { .. }, .. })));
    let mut out = SteadyText { declared, free: free_actions(l, blocks), ..SteadyText::default() };
    let mut set = Given::default();
    for SteadyEntry { scope, block, breadth, target, value } in steady_entries(l, blocks) {
        let place = Place::new(scope, Site::Instant);
        if !is_place(target) || names_variable(l, target, scope) {
            out.conditions.push(steady_condition(l, target, value, &place));
            continue;
        }
        let parts = match instances_named(l, target, scope) {
            Some(path) => states_of_instances(l, &path).into_iter().map(|var| (var, 0..i64::from(l.symbols.vars[var].len))).collect(),
            None => steady_variable(l, target, &place).into_iter().collect::<Vec<_>>(),
        };
        for (var, elements) in parts {
            let Some(SymbolKind::Variable { unit, .. }) = l.symbols.of_var.get(&var).map(|&s| l.symbols[s].kind.clone()) else {
                continue;
            };
            let expr = l.number_in(value, &unit, "the steady value", target.span, &place);
            check_steady_value(l, var, elements.clone(), expr, value.span);
            if set.note(l, (var, elements.clone()), (block, breadth), target.span, "steady values") {
                out.given.extend(elements.map(|i| ((var, i), expr)));
            }
        }
    }
    out
}

/// Actions after `free`, by position.
fn free_actions<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Vec<u32> {
    let mut out = Vec::new();
    for (scope, item) in each(blocks) {
        let Item::Other(Statement { kind: StatementKind::Steady { free, .. }, .. }) = item else { continue };
        for target in free {
            let place = Place::new(scope, Site::Instant);
            let Some((symbol, at)) = boxes::target(l, target, &place, &[Role::Action]) else { continue };
            let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind else { continue };
            let before = l.variables_of(Role::Action).into_iter().take_while(|other| *other != var);
            let first: u32 = before.map(|other| l.symbols.vars[other].len).sum();
            match at {
                Some(at) => out.push(first + at.offset.max(0) as u32),
                None => out.extend(first..first + l.symbols.vars[var].len),
            }
        }
    }
    out.sort_unstable();
    out.dedup();
    out
}

/// Refuses free actions that are not as many as states and conditions given.
fn check_free<'a>(l: &mut Lowering<'_, 'a>, problem: &Steady, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
    let (free, given) = (problem.free.len(), problem.fixed.len() + problem.conditions as usize);
    if free == 0 || free == given || l.ledger.reports.has_errors() {
        return;
    }
    let named = each(blocks).find_map(|(_, item)| match item {
        Item::Other(Statement { kind: StatementKind::Steady { free, .. }, .. }) => free.first().map(|target| target.span),
        _ => None,
    });
    let text = format!("{free} actions are free, {given} states and conditions are given");
    let help = "give as many values of states and variables as actions are free";
    l.ledger.report(Diagnostic::error(codes::WRONG_KIND, text, named.unwrap_or_default()).help(help));
}

/// Returns whether an entry names an algebraic variable or a `let`, which a condition determines.
fn names_variable(l: &Lowering<'_, '_>, target: &Expr, scope: ScopeId) -> bool {
    let name = match &target.kind {
        ExprKind::Name(name) => name,
        ExprKind::Index(base, _) => match &base.kind {
            ExprKind::Name(name) => name,
            _ => return false,
        },
        _ => return false,
    };
    match l.symbols.lookup(scope, &name.text).map(|symbol| &l.symbols[symbol].kind) {
        Some(SymbolKind::Variable { var, .. }) => l.symbols.vars[*var].role == Role::Algebraic,
        _ => false,
    }
}

/// Refuses a steady value that is not a number, or an action's outside its bounds, as far as it
/// is known.
fn check_steady_value(l: &mut Lowering<'_, '_>, var: VarId, elements: Range<i64>, value: ExprId, span: Span) {
    let Some(x) = defaults::constant_value(l, value) else { return };
    let is_action = l.symbols.vars[var].role == Role::Action;
    let Some(q) = l.quantities.get(&var) else { return };
    let outside = |i: i64| x < Quantity::pick(&q.low, i as usize) || x > Quantity::pick(&q.high, i as usize);
    let message = if !x.is_finite() {
        format!("a steady value is finite, this is {x}")
    } else if let Some(i) = elements.into_iter().find(|&i| is_action && outside(i)) {
        let (low, high) = (Quantity::pick(&q.low, i as usize), Quantity::pick(&q.high, i as usize));
        format!("`{}` cannot rest at {x}, outside its bounds {low}..{high}", q.element_name(i as usize))
    } else {
        return;
    };
    l.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, span));
}

/// The variable, and those of its elements, that an entry gives a value.
fn steady_variable(l: &mut Lowering<'_, '_>, target: &Expr, place: &Place) -> Option<(VarId, Range<i64>)> {
    let (symbol, at) = boxes::target(l, target, place, &[Role::Action, Role::State])?;
    let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind else { return None };
    Some((var, at.map_or(0..i64::from(l.symbols.vars[var].len), |at| at.offset..at.offset + 1)))
}

/// The actions of the steady problem: as given, else their defaults.
fn steady_actions(l: &mut Lowering<'_, '_>, given: &FastMap<(VarId, i64), ExprId>) -> Vec<ExprId> {
    let mut values = Vec::new();
    for var in l.variables_of(Role::Action) {
        for i in 0..i64::from(l.symbols.vars[var].len) {
            values.push(given.get(&(var, i)).copied().unwrap_or_else(|| {
                let x = l.quantities.get(&var).map_or(f64::NAN, |q| Quantity::pick(&q.default, i as usize));
                l.exprs.constant(x)
            }));
        }
    }
    values
}

/// `A + B = 1`: left less right.
fn steady_condition(l: &mut Lowering<'_, '_>, left: &Expr, right: &Expr, place: &Place) -> ExprId {
    let reports = l.ledger.reports.diagnostics.len();
    let value = l.value(left, place);
    let unit = value.unit.unit();
    let value = l.values().in_unit(value, &unit, left.span, "this value", left.span);
    let right = l.number_in(right, &unit, "the steady value", left.span, place);
    let difference = l.exprs.sub(value, right);
    if l.ledger.reports.diagnostics.len() == reports && !l.symbols.reads_unknown(l.exprs, difference) {
        let message = "this condition on the steady state contains no state";
        l.ledger
            .report(Diagnostic::error(codes::WRONG_KIND, message, left.span).help("give a state, or an expression of states, its value"));
    }
    difference
}

/// Path of the instance, or of the array of instances, that an entry names: `col = 0` is of every
/// state of it.
pub(super) fn instances_named(l: &Lowering<'_, '_>, target: &Expr, scope: ScopeId) -> Option<String> {
    let ExprKind::Name(name) = &target.kind else { return None };
    let symbol = l.symbols.lookup(scope, &name.text)?;
    matches!(l.symbols[symbol].kind, SymbolKind::Instance(_) | SymbolKind::Instances(_)).then(|| l.symbols[symbol].path.clone())
}

/// The states of an instance, or of the instances of an array.
pub(super) fn states_of_instances(l: &Lowering<'_, '_>, path: &str) -> Vec<VarId> {
    let within = |var: &VarId| l.symbols.vars[*var].name.strip_prefix(path).is_some_and(|rest| rest.starts_with(['.', '[']));
    l.variables_of(Role::State).into_iter().filter(within).collect()
}

/// Returns `true` if an expression names a variable or an element of one.
fn is_place(e: &Expr) -> bool {
    match &e.kind {
        ExprKind::Name(_) => true,
        ExprKind::Member(base, _) | ExprKind::Index(base, _) => is_place(base),
        _ => false,
    }
}
