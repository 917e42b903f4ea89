//! The steady problem and the start of an episode.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Clip, Expr, ExprKind, Statement, StatementKind};

use crate::elaborate::episode::assembly::Assembly;
use crate::elaborate::episode::common::{each, store, stream_name};
use crate::elaborate::episode::order::ordered_initial;
use crate::elaborate::episode::parameters::clipped;
use crate::elaborate::episode::phases::schedule_initial;
use crate::elaborate::lower::loops::Piece;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, boxes, defaults, nests};
use crate::elaborate::outside::initial_elements;
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{ScopeId, SymbolKind, Symbols};
use crate::ir::{Affine, Expr as Node, ExprId, Exprs, FastMap, Flavour, Nest, Place as Memory, Program, Role, VarId};
use crate::model::{Instant, Quantity, Steady};

/// The start values of an episode.
#[derive(Default)]
struct Starts {
    states: Assembly,
    /// Of discrete variables and disturbances.
    discretes: Assembly,
}

impl Starts {
    /// Where the start of a variable of a role goes.
    fn of(&mut self, role: Role) -> &mut Assembly {
        if role == Role::State { &mut self.states } else { &mut self.discretes }
    }
}

/// The steady problem as it is stated.
pub(in crate::elaborate) struct SteadyProgram {
    /// The given actions, states and conditions.
    pub program: Program,
    /// What is given.
    pub problem: Steady,
    /// Something is said of it.
    pub said: bool,
}

/// What `steady` blocks say.
pub(in crate::elaborate) fn steady_program<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> SteadyProgram {
    let SteadyText { said, given, conditions } = steady_text(l, blocks);
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
    let problem = Steady { given: base > 0 && fixed.len() == base as usize, fixed, conditions: count };
    SteadyProgram { program, problem, said }
}

/// The entries of `steady` blocks.
#[derive(Default)]
struct SteadyText {
    /// There is a block.
    said: bool,
    /// Values of elements.
    given: FastMap<(VarId, i64), ExprId>,
    /// What must be zero.
    conditions: Vec<ExprId>,
}

fn steady_text<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> SteadyText {
    let mut out = SteadyText::default();
    for (scope, item) in each(blocks) {
        let Item::Other(Statement { kind: StatementKind::Steady { entries }, .. }) = item else { continue };
        out.said = true;
        let place = Place::new(scope, Site::Instant);
        for (target, value) in entries {
            if !is_place(target) {
                out.conditions.push(steady_condition(l, target, value, &place));
                continue;
            }
            if steady_instance(l, target, value, &place, &mut out.given) {
                continue;
            }
            let Some((symbol, at)) = boxes::target(l, target, &place, &[Role::Action, Role::State]) else { continue };
            let SymbolKind::Variable { var, unit, .. } = l.symbols[symbol].kind.clone() else { continue };
            let expr = l.number_in(value, &unit, "the steady value", target.span, &place);
            let elements = match at {
                Some(at) => at.offset..at.offset + 1,
                None => 0..i64::from(l.symbols.vars[var].len),
            };
            out.given.extend(elements.map(|i| ((var, i), expr)));
        }
    }
    out
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
        let message = "no state stands in this condition on the steady state";
        l.ledger
            .report(Diagnostic::error(codes::WRONG_KIND, message, left.span).help("give a state, or an expression of states, its value"));
    }
    difference
}

/// `col = 0`: every state of an instance, or of the instances of an array.
fn steady_instance(
    l: &mut Lowering<'_, '_>,
    target: &Expr,
    value: &Expr,
    place: &Place,
    given: &mut FastMap<(VarId, i64), ExprId>,
) -> bool {
    let ExprKind::Name(name) = &target.kind else { return false };
    let Some(symbol) = l.symbols.lookup(place.scope, &name.text) else { return false };
    if !matches!(l.symbols[symbol].kind, SymbolKind::Instance(_) | SymbolKind::Instances(_)) {
        return false;
    }
    let path = l.symbols[symbol].path.clone();
    for var in l.variables_of(Role::State) {
        let rest = l.symbols.vars[var].name.strip_prefix(&path);
        if !rest.is_some_and(|r| r.starts_with(['.', '['])) {
            continue;
        }
        let Some(SymbolKind::Variable { unit, .. }) = l.symbols.of_var.get(&var).map(|&s| l.symbols[s].kind.clone()) else {
            continue;
        };
        let expr = l.number_in(value, &unit, "the steady value", target.span, place);
        given.extend((0..i64::from(l.symbols.vars[var].len)).map(|i| ((var, i), expr)));
    }
    true
}

/// The start values of states, and those of discrete variables and disturbances.
pub(in crate::elaborate) fn initial_programs<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> (Program, Program) {
    let mut starts = Starts::default();
    declared_starts(l, &mut starts);
    starts.discretes.single.extend(schedule_initial(l));
    let mut starts = Starts {
        states: Assembly { nests: starts.states.gathered(), single: Vec::new() },
        discretes: Assembly { nests: starts.discretes.gathered(), single: Vec::new() },
    };
    stated_starts(l, blocks, &mut starts);
    asked_starts(l, &mut starts);
    let (nests, cycles) = ordered_initial(starts.states.nests, l.exprs, &l.symbols.vars);
    cycles.into_iter().for_each(|d| l.ledger.report(d));
    (Program { nests, in_place: true }, Program { nests: starts.discretes.nests, in_place: true })
}

/// Starts that stand with the declarations, or that were asked for in their place.
fn declared_starts(l: &mut Lowering<'_, '_>, starts: &mut Starts) {
    for symbol in l.in_text_order() {
        let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind else { continue };
        let role = l.symbols.vars[var].role;
        let site = match role {
            Role::State => Site::Reset,
            Role::Discrete | Role::Disturbance => Site::Instant,
            _ => continue,
        };
        let pieces = match l.input.options.initial.get(&l.symbols[symbol].path) {
            Some(&x) => {
                let value = l.exprs.constant(x);
                vec![l.symbols.whole(var, value)]
            }
            None => defaults::default_pieces(l, symbol, site),
        };
        let span = l.symbols[symbol].span;
        for piece in pieces {
            let (at, value) = piece.value;
            check_start(l, value, var, at, span);
            starts.of(role).push(piece.extents, store(Memory::Var(var), at, value));
        }
    }
}

/// Starts that `initial` states.
fn stated_starts<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)], starts: &mut Starts) {
    let mut given: FastMap<(ScopeId, VarId, Option<i64>), Span> = FastMap::default();
    for (scope, item) in each(blocks) {
        let Item::Other(Statement { kind: StatementKind::Initial { target, random, value, clip, binders }, .. }) = item else {
            continue;
        };
        let place = Place::new(scope, Site::Reset);
        if binders.is_empty() {
            check_single(l, &mut given, scope, target, &place);
        }
        let pieces = nests::nest(l, binders, &place, &mut |s, inner| initial(s, target, *random, value, clip.as_ref(), inner));
        for piece in pieces {
            let Some((var, list)) = piece.value else { continue };
            for p in list {
                let (at, value) = p.value;
                let mut extents = piece.extents.clone();
                extents.extend(p.extents);
                let stores = vec![store(Memory::Var(var), at, value)];
                starts.of(l.symbols.vars[var].role).nests.push(Nest::over(extents, stores));
            }
        }
    }
}

/// Single elements that were asked for; they come last.
fn asked_starts(l: &mut Lowering<'_, '_>, starts: &mut Starts) {
    for symbol in l.symbols.list.keys().collect::<Vec<_>>() {
        let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind else { continue };
        let role = l.symbols.vars[var].role;
        if !matches!(role, Role::State | Role::Discrete) {
            continue;
        }
        for (at, x) in initial_elements(l, symbol) {
            let value = l.exprs.constant(x);
            let stores = vec![store(Memory::Var(var), Affine::constant(at), value)];
            starts.of(role).nests.push(Nest { loops: Vec::new(), stores });
        }
    }
}

/// Reports a start value that reads what it sets, or elements that the same loop sets in its later passes: the declared values would be
/// read, which are replaced.
fn check_start(l: &mut Lowering<'_, '_>, value: ExprId, var: VarId, at: Affine, span: Span) {
    let passes: Vec<i64> = l.loops.frames.iter().map(|l| l.passes).collect();
    if !reads(l.exprs, value, var).iter().any(|&read| is_set_later(read, at, &passes)) {
        return;
    }
    let name = l.symbols.vars[var].name.clone();
    let itself = if at.is_constant() { "itself" } else { "elements that are set with it or after it" };
    l.ledger.report(
        Diagnostic::error(codes::CYCLIC_DEFINITION, format!("the initial value of `{name}` reads {itself}"), span)
            .label(format!("`{name}` has no value yet"))
            .help(format!("write the value out, or name it: `param {name}_0 : unit = ...`, then `{name}_0` in place of `{name}`")),
    );
}

/// Reports a second `initial` of one variable or element in one block: the order of statements has no meaning.
fn check_single(
    l: &mut Lowering<'_, '_>,
    given: &mut FastMap<(ScopeId, VarId, Option<i64>), Span>,
    scope: ScopeId,
    target: &Expr,
    place: &Place,
) {
    let Some((symbol, at)) = boxes::target(l, target, place, &[Role::State, Role::Discrete, Role::Disturbance]) else { return };
    let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind else { return };
    if let Some(first) = given.insert((scope, var, at.map(|at| at.offset)), target.span) {
        let path = l.symbols[symbol].path.clone();
        l.ledger.report(
            Diagnostic::error(codes::DUPLICATE_NAME, format!("`{path}` has two initial values"), target.span)
                .secondary(first, "the first one")
                .help("keep one of them"),
        );
    }
}

/// One `initial` statement at one place: a scalar, an element, or a whole array.
#[allow(clippy::type_complexity, reason = "a variable and pieces of it")]
fn initial(
    l: &mut Lowering<'_, '_>,
    target: &Expr,
    random: bool,
    value: &Expr,
    clip: Option<&Clip>,
    place: &Place,
) -> Option<(VarId, Vec<Piece<(Affine, ExprId)>>)> {
    let (symbol, at) = boxes::target(l, target, place, &[Role::State, Role::Discrete, Role::Disturbance])?;
    let SymbolKind::Variable { var, unit, .. } = l.symbols[symbol].kind.clone() else { return None };
    let path = l.symbols[symbol].path.clone();
    if let Some(&x) = l.input.options.initial.get(&path) {
        let value = l.exprs.constant(x);
        return Some((var, vec![l.symbols.whole(var, value)]));
    }
    let len = l.symbols.vars[var].len;
    let mut place = place.clone();
    if l.symbols.vars[var].role != Role::State {
        place.site = Site::Instant;
    }
    let make = |s: &mut Lowering<'_, '_>, at: Affine, inner: &Place| {
        let outer = random.then(|| s.hidden.draws.site.replace((stream_name(&path, at, len), Instant::Reset)));
        let v = s.number_in(value, &unit, &format!("`{path}`"), target.span, inner);
        if let Some(outer) = outer {
            s.hidden.draws.site = outer;
        }
        check_start(s, v, var, at, value.span);
        clipped(s, v, var, at, clip, &unit, inner)
    };
    match at {
        Some(at) => {
            let v = make(l, at, &place);
            Some((var, vec![Piece { extents: Vec::new(), value: (at, v) }]))
        }
        None => {
            // The whole array: one loop over its elements.
            let pieces = l.cells(0, i64::from(len) - 1, target.span, &place, &mut |s, cell, inner| {
                let at = cell.affine();
                (at, make(s, at, inner))
            });
            let list = pieces
                .into_iter()
                .map(|(cell, value)| Piece { extents: cell.along.map(|_| cell.count as u32).into_iter().collect(), value })
                .collect();
            Some((var, list))
        }
    }
}

impl Symbols<'_> {
    fn reads_unknown(&self, exprs: &Exprs, e: ExprId) -> bool {
        exprs.below([e]).any(|e| match exprs.node(e) {
            Node::Load { var, flavour: Flavour::Value, .. } => matches!(self.vars[var].role, Role::State | Role::Algebraic),
            _ => false,
        })
    }
}

/// Elements of a variable whose values an expression reads.
fn reads(exprs: &Exprs, e: ExprId, var: VarId) -> Vec<Affine> {
    let read = |e: ExprId| match exprs.node(e) {
        Node::Load { var: v, flavour: Flavour::Value, at } if v == var => Some(at),
        _ => None,
    };
    exprs.below([e]).filter_map(read).collect()
}

/// Whether the element `read` is the element `set`, or one that a later pass of the loops around sets.
fn is_set_later(read: Affine, set: Affine, passes: &[i64]) -> bool {
    let ahead = read.offset - set.offset;
    if read.strides != set.strides {
        return false;
    }
    match set.strides.iter().filter(|s| **s != 0).collect::<Vec<_>>()[..] {
        [&stride] => {
            let along = set.strides.iter().position(|s| *s == stride).unwrap_or(0);
            ahead % stride == 0 && (0..passes.get(along).copied().unwrap_or(1)).contains(&(ahead / stride))
        }
        _ => ahead == 0,
    }
}

/// Whether an expression names a variable or an element of one.
fn is_place(e: &Expr) -> bool {
    match &e.kind {
        ExprKind::Name(_) => true,
        ExprKind::Member(base, _) | ExprKind::Index(base, _) => is_place(base),
        _ => false,
    }
}
