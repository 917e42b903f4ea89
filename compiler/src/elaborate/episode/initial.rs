//! The start of an episode: declared, drawn, stated and requested values.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{self, Clip, Expr, ExprKind, Ident, StatementKind};

use crate::elaborate::episode::assembly::Assembly;
use crate::elaborate::episode::common::{each, shown, store, stream_name, two_values};
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
use crate::model::Instant;

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
