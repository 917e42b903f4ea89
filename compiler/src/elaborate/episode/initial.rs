//! The steady problem and the start of an episode.

use std::ops::Range;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{self, Clip, Expr, ExprKind, Ident, Statement, StatementKind};

use crate::elaborate::episode::assembly::Assembly;
use crate::elaborate::episode::common::{Given, each, shown, store, stream_name, two_values};
use crate::elaborate::episode::order::{STATES, ordered_initial};
use crate::elaborate::episode::parameters::clipped;
use crate::elaborate::episode::phases::schedule_initial;
use crate::elaborate::lower::loops::Piece;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, boxes, defaults, nests};
use crate::elaborate::outside::initial_elements;
use crate::elaborate::select::items::{Item, WHOLE, block_around, breadth};
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
    /// Destination of the start of a variable of a role.
    fn of(&mut self, role: Role) -> &mut Assembly {
        if role == Role::State { &mut self.states } else { &mut self.discretes }
    }

    /// Adds the starts of one statement; returns the elements that it sets.
    fn add(&mut self, l: &Lowering<'_, '_>, piece: Piece<Option<Started>>) -> Vec<(Vec<u32>, Affine)> {
        let Some((var, list)) = piece.value else { return Vec::new() };
        let starts = self.of(l.symbols.vars[var].role);
        let each = list.into_iter().map(|Piece { extents, value: (at, value) }| {
            let extents = [piece.extents.as_slice(), &extents].concat();
            starts.nests.push(Nest::over(extents.clone(), vec![store(Memory::Var(var), at, value)]));
            (extents, at)
        });
        each.collect()
    }
}

/// A variable with the values of its elements at the start.
type Started = (VarId, Vec<Piece<(Affine, ExprId)>>);

/// The steady problem as it is stated.
pub(in crate::elaborate) struct SteadyProgram {
    /// The given actions, states and conditions.
    pub program: Program,
    /// Given values.
    pub problem: Steady,
    /// A statement mentions it.
    pub said: bool,
}

/// Entries of `steady` blocks.
pub(in crate::elaborate) fn steady_program<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> SteadyProgram {
    let SteadyText { said, given, conditions, free } = steady_text(l, blocks);
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
    SteadyProgram { program, problem, said }
}

/// The entries of `steady` blocks.
#[derive(Default)]
struct SteadyText {
    /// There is a block.
    said: bool,
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
    let said = each(blocks).any(|(_, item)| matches!(item, Item::Other(Statement { kind: StatementKind::Steady { .. }, .. })));
    let mut out = SteadyText { said, free: free_actions(l, blocks), ..SteadyText::default() };
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

/// The start values of states, and those of discrete variables and disturbances.
pub(in crate::elaborate) fn initial_programs<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> (Program, Program) {
    let mut starts = Starts::default();
    declared_starts(l, &mut starts);
    starts.discretes.single.extend(schedule_initial(l));
    let mut starts = Starts {
        states: Assembly { nests: starts.states.gathered(), single: Vec::new() },
        discretes: Assembly { nests: starts.discretes.gathered(), single: Vec::new() },
    };
    drawn_starts(l, blocks, &mut starts);
    stated_starts(l, blocks, &mut starts);
    asked_starts(l, &mut starts);
    let (nests, cycles) = ordered_initial(starts.states.nests, l.exprs, &l.symbols.vars, STATES);
    cycles.into_iter().for_each(|d| l.ledger.report(d));
    (Program { nests, in_place: true }, Program { nests: starts.discretes.nests, in_place: true })
}

/// Starts of the declarations, or requested ones that replace them.
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

/// Starts that declarations draw, `state x = 1 ~ normal(1, 0.1)`; each `initial` overrides them.
fn drawn_starts<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)], starts: &mut Starts) {
    for (scope, item) in each(blocks) {
        let Item::Declare(syntax::Role::State | syntax::Role::Discrete, d) = item else { continue };
        let Some(value) = &d.sample else { continue };
        let named = |name: &Ident| Expr { span: name.span, kind: ExprKind::Name(name.clone()) };
        let indices: Vec<Expr> = d.indices.iter().map(|binder| named(&binder.name)).collect();
        let target = match indices.is_empty() {
            true => named(&d.name),
            false => Expr { span: d.name.span, kind: ExprKind::Index(Box::new(named(&d.name)), indices) },
        };
        let start = StartText { target: &target, random: true, value, clip: d.clip.as_ref(), asked: false };
        for piece in nests::nest(l, &d.indices, &Place::new(scope, Site::Reset), &mut |s, inner| initial(s, start, inner)) {
            starts.add(l, piece);
        }
    }
}

/// Starts that `initial` states. Those that a scenario asks for come last: they hold against all of
/// the text.
fn stated_starts<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)], starts: &mut Starts) {
    let mut set = Vec::new();
    let overlay = &l.input.options.overlay;
    let is_asked = |item: &Item<'_>| matches!(item, Item::Other(statement) if overlay.iter().any(|one| std::ptr::eq(one, *statement)));
    let (asked, own): (Vec<_>, Vec<_>) = each(blocks).partition(|(_, item)| is_asked(item));
    for (scope, item) in own.into_iter().chain(asked) {
        let Item::Other(statement) = item else { continue };
        let StatementKind::Initial { target, random, value, clip, binders } = &statement.kind else { continue };
        let place = Place::new(scope, Site::Reset);
        let asked = is_asked(&item);
        let start = StartText { target, random: *random, value, clip: clip.as_ref(), asked };
        for piece in nests::nest(l, binders, &place, &mut |s, inner| initial(s, start, inner)) {
            let Some(var) = piece.value.as_ref().map(|(var, _)| *var) else { continue };
            for (extents, at) in starts.add(l, piece).into_iter().filter(|_| !asked) {
                set.push(SetElements { of: (scope, var, breadth(target, binders)), extents, at, span: target.span });
            }
        }
    }
    check_single(l, &set);
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

/// Reports a start value that reads what it sets, or elements that the same loop sets in its later
/// passes: the declared values would be read, which are replaced.
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
            .help(format!("write the value out, or name it: `param {name}_0 : unit = ...`, then `{name}_0` instead of `{name}`")),
    );
}

/// Elements that an `initial` sets, by scope, variable and breadth.
struct SetElements {
    of: (ScopeId, VarId, usize),
    extents: Vec<u32>,
    at: Affine,
    span: Span,
}

impl SetElements {
    /// Calls `f` with each element; a whole array is one, called -1.
    fn each(&self, f: &mut dyn FnMut(i64)) {
        if self.of.2 >= WHOLE && !self.extents.is_empty() { f(-1) } else { nests::for_each_element(&self.extents, self.at, f) }
    }
}

/// Reports a second `initial` of the same breadth of one variable or element in one block, one for
/// a statement: the order of statements has no meaning.
fn check_single(l: &mut Lowering<'_, '_>, set: &[SetElements]) {
    let mut statements: FastMap<(ScopeId, VarId, usize), (Span, bool)> = FastMap::default();
    for one in set {
        let (first, several) = statements.entry(one.of).or_insert((one.span, false));
        *several |= *first != one.span;
    }
    let mut given: FastMap<((ScopeId, VarId, usize), i64), Span> = FastMap::default();
    let mut told = None;
    for one in set.iter().filter(|one| statements.get(&one.of).is_some_and(|(_, several)| *several)) {
        let mut twice = None;
        one.each(&mut |i| {
            if let Some(first) = given.insert((one.of, i), one.span).filter(|first| *first != one.span) {
                twice.get_or_insert((i, first));
            }
        });
        let Some((i, first)) = twice.filter(|_| told != Some(one.span)) else { continue };
        if block_around(l.input.files, first) == block_around(l.input.files, one.span) {
            told = Some(one.span);
            let name = shown(l, one.of.1, Some(i).filter(|i| *i >= 0));
            l.ledger.report(two_values(&name, "initial values", one.span, first));
        }
    }
}

/// Content of an `initial` statement.
#[derive(Clone, Copy)]
struct StartText<'s> {
    target: &'s Expr,
    random: bool,
    value: &'s Expr,
    clip: Option<&'s Clip>,
    /// It is requested in addition to the text.
    asked: bool,
}

/// One `initial` statement at one place: a scalar, an element, or a whole array. `None` if a
/// requested number replaces it, which is set with the declarations.
fn initial(l: &mut Lowering<'_, '_>, start: StartText<'_>, place: &Place) -> Option<Started> {
    let StartText { target, random, value, clip, asked } = start;
    let (symbol, at) = boxes::target(l, target, place, &[Role::State, Role::Discrete, Role::Disturbance])?;
    let SymbolKind::Variable { var, unit, .. } = l.symbols[symbol].kind.clone() else { return None };
    let path = l.symbols[symbol].path.clone();
    if !asked && l.input.options.initial.contains_key(&path) {
        return None;
    }
    let len = l.symbols.vars[var].len;
    let mut place = place.clone();
    if l.symbols.vars[var].role != Role::State {
        place.site = Site::Instant;
    }
    let make = |s: &mut Lowering<'_, '_>, at: Affine, inner: &Place| {
        let outer = random.then(|| s.hidden.draws.site.replace((stream_name(&path, at, len), Instant::Reset)));
        let v = s.number_in(value, &unit, &format!("`{path}`"), target.span, inner);
        // A discrete variable may begin at infinity, as a time that has not come.
        let no_start = |x: &f64| x.is_nan() || x.is_infinite() && s.symbols.vars[var].role == Role::State;
        if let Some(x) = s.exprs.as_const(v).filter(no_start).filter(|_| !s.ledger.reports.has_errors()) {
            let message = format!("`{path}` cannot start at {x}");
            s.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, value.span));
        }
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
    /// Returns whether an expression reads a state or an algebraic variable.
    pub(super) fn reads_unknown(&self, exprs: &Exprs, e: ExprId) -> bool {
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

/// Returns `true` if the element `read` is the element `set`, or one that a later pass of the loops
/// around sets.
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

/// Returns `true` if an expression names a variable or an element of one.
fn is_place(e: &Expr) -> bool {
    match &e.kind {
        ExprKind::Name(_) => true,
        ExprKind::Member(base, _) | ExprKind::Index(base, _) => is_place(base),
        _ => false,
    }
}
