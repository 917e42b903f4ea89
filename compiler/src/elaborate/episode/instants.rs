//! Sampling instants and events.

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Binder, Expr, ExprKind, Statement, StatementKind};

use crate::elaborate::episode::common::{each, store};
use crate::elaborate::episode::together::{Assignment, Draft, Kind};
use crate::elaborate::episode::unknown::doubting;
use crate::elaborate::episode::{controllers, regular};
use crate::elaborate::lower::nests::for_each_element;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, boxes, nests};
use crate::elaborate::select::items::{Item, Moment};
use crate::elaborate::symbols::{ScopeId, SymbolKind};
use crate::ir::{Affine, Builtin, Expr as Node, ExprId, FastMap, Flavour, Place as Memory, Program, Rewritten, Role, VarId};
use crate::model::{Root, RootAction};

/// Updates at the instants of a step.
#[derive(Default)]
pub(in crate::elaborate) struct Instants {
    /// At its start.
    pub start: Program,
    /// At its end.
    pub end: Program,
    /// At events.
    pub events: Vec<Program>,
    /// Places of the events.
    pub roots: Vec<Root>,
    /// True if updates at the start set states.
    pub start_resets: bool,
}

impl Instants {
    /// Notes what an event does; its number.
    pub(in crate::elaborate) fn push_event(&mut self, program: Program) -> RootAction {
        self.events.push(program);
        RootAction::Run(self.events.len() as u32 - 1)
    }
}

/// Assignments as they are put together.
#[derive(Default)]
pub(in crate::elaborate) struct Assignments {
    /// They happen only where this holds: in the transition of a phase, at a regular instant.
    pub guard: Option<ExprId>,
    /// Guards exclude one another: several may assign one variable.
    pub exclusive: bool,
    /// Elements that have a `next`, by scope and instant.
    assigned: FastMap<(ScopeId, String), FastMap<(VarId, i64), Span>>,
}

/// The programs of instants as they are put together.
struct Drafts<'a> {
    start: Draft,
    end: Draft,
    /// Controllers at regular instants.
    controllers: Draft,
    /// Blocks at regular instants, after them.
    regular: Draft,
    /// By scope and name, in the order in which they are first mentioned.
    events: Vec<(ScopeId, &'a str, Draft)>,
}

impl<'a> Drafts<'a> {
    /// The program of an instant.
    fn of(&mut self, scope: ScopeId, moment: Moment<'a>) -> &mut Draft {
        match moment.name.text.as_str() {
            _ if moment.every.is_some() => &mut self.regular,
            "start" => &mut self.start,
            "end" => &mut self.end,
            name => {
                let known = self.events.iter().position(|(s, n, _)| *n == name && *s == scope);
                let at = known.unwrap_or_else(|| {
                    self.events.push((scope, name, Draft::default()));
                    self.events.len() - 1
                });
                &mut self.events[at].2
            }
        }
    }
}

/// The programs of `at start`, `at end`, of regular instants and of events; `interval` is the
/// integrated length of a step.
pub(in crate::elaborate) fn instant_programs<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)], interval: f64) -> Instants {
    let mut out = Instants::default();
    let mut assignments = Assignments::default();
    let [start, controllers, regular] = [(); 3].map(|()| Draft::of_start());
    let mut drafts = Drafts { start, end: Draft::default(), controllers, regular, events: Vec::new() };
    // Parts before the whole: what a component updates at the end of a step is seen by the `at end`
    // of what it is used in.
    let mut inner_first: Vec<&(ScopeId, Vec<Item<'a>>)> = blocks.iter().collect();
    inner_first.sort_by_key(|(scope, _)| std::cmp::Reverse(l.symbols.scopes[*scope].prefix.matches('.').count()));
    for (scope, item) in inner_first.into_iter().flat_map(|(scope, items)| items.iter().map(move |i| (*scope, *i))) {
        match item {
            Item::At(moment, statement) => {
                let (instant, block) = (moment.name.text.as_str(), moment.name.span);
                assignments.guard = match moment.every {
                    Some(every) => match regular::due(l, every, &Place::new(scope, Site::Instant)) {
                        None => continue,
                        due => due,
                    },
                    None => None,
                };
                let at_start = instant == "start" || moment.every.is_some();
                out.start_resets |= at_start && matches!(statement.kind, StatementKind::Reset { .. } | StatementKind::Clamp { .. });
                instant_statement(l, scope, statement, (drafts.of(scope, moment), block), &mut assignments, instant);
            }
            Item::Other(Statement { kind: StatementKind::Control(control), span }) => {
                controllers::controller(l, (scope, *span), control, &mut drafts.controllers, &mut assignments);
            }
            _ => {}
        }
    }
    (out.start, out.end) = (drafts.start.program(l), drafts.end.program(l));
    let mut regular = drafts.controllers.program(l);
    regular.nests.extend(drafts.regular.program(l).nests);
    regular::regular_programs(l, regular, interval, &mut out);
    let events: Vec<_> = drafts.events.into_iter().map(|(scope, name, draft)| (scope, name, draft.program(l))).collect();
    watched_events(l, blocks, &events, &mut out);
    out
}

/// Target of a statement of an instant, and the permitted targets.
#[derive(Clone, Copy)]
struct Assigned<'s> {
    target: &'s Expr,
    value: &'s Expr,
    condition: Option<&'s Expr>,
    binders: &'s [Binder],
    roles: &'static [Role],
}

impl<'s> Assigned<'s> {
    /// Of `next`, `reset`, `clamp`; `None` for what else there is.
    fn of(statement: &'s Statement) -> Option<Assigned<'s>> {
        let (target, value, condition, binders, roles): (_, _, _, _, &[Role]) = match &statement.kind {
            StatementKind::Next { target, value, binders } => (target, value, None, binders, &[Role::Discrete]),
            StatementKind::Reset { target, value, binders } => (target, value, None, binders, &[Role::State]),
            StatementKind::Clamp { target, value, condition, binders } => {
                (target, value, Some(condition), binders, &[Role::State, Role::Discrete])
            }
            _ => return None,
        };
        Some(Assigned { target, value, condition, binders, roles })
    }
}

/// `next`, `reset`, `clamp` of a block.
pub(in crate::elaborate) fn instant_statement(
    l: &mut Lowering<'_, '_>,
    scope: ScopeId,
    statement: &Statement,
    (draft, block): (&mut Draft, Span),
    assignments: &mut Assignments,
    instant: &str,
) {
    let place = Place::new(scope, Site::Instant);
    let Some(assigned) = Assigned::of(statement) else {
        let message = "only `next`, `reset` and `clamp` are valid in `at`";
        return l.ledger.report(Diagnostic::error(codes::MISPLACED_BLOCK, message, statement.span));
    };
    let kind = match statement.kind {
        StatementKind::Next { .. } => Kind::Next,
        StatementKind::Reset { .. } => Kind::Reset,
        _ => Kind::Clamp,
    };
    if kind != Kind::Next {
        let parts: Vec<&Expr> = [assigned.target, assigned.value].into_iter().chain(assigned.condition).collect();
        l.loops.counted = l.symbols.counted_cells(assigned.binders, &parts, &place);
    }
    let guard = assignments.guard;
    let pieces = nests::nest(l, assigned.binders, &place, &mut |s, inner| assignment(s, assigned, guard, inner));
    l.loops.counted.clear();
    for piece in pieces {
        let Some((var, at, v, whole)) = piece.value else { continue };
        let mut extents = piece.extents;
        extents.extend(whole);
        if kind == Kind::Next && !assignments.exclusive {
            check_next(l, assignments, (scope, instant), var, (&extents, at), statement.span);
        }
        draft.push(l, block, kind, Assignment { extents, store: store(Memory::Var(var), at, v) });
    }
}

/// Two `next`s of one element at one instant are a fault, one for a statement.
pub(in crate::elaborate::episode) fn check_next(
    l: &mut Lowering<'_, '_>,
    assignments: &mut Assignments,
    (scope, instant): (ScopeId, &str),
    var: VarId,
    (extents, at): (&[u32], Affine),
    span: Span,
) {
    let mut twice = None;
    let assigned = assignments.assigned.entry((scope, instant.to_owned())).or_default();
    for_each_element(extents, at, &mut |i| {
        if let Some(first) = assigned.insert((var, i), span) {
            twice.get_or_insert((i, first));
        }
    });
    if let Some((element, first)) = twice {
        let name = l.quantities.get(&var).map_or_else(String::new, |q| q.element_name(element.max(0) as usize));
        let help = match instant {
            "end" => {
                "a discrete variable has one `next` in all `at end` blocks of a model or component: write one expression, or let another variable hold what is in between"
            }
            "every" => "regular instants with different intervals meet, and assign together: let one of them set another variable",
            _ => "all `next` of an instant assign together, so there can be one only",
        };
        l.ledger.report(
            Diagnostic::error(codes::DUPLICATE_NAME, format!("two `next {name}` at one instant"), span)
                .secondary(first, "the first one")
                .help(help),
        );
    }
}

#[allow(clippy::type_complexity, reason = "variable, element, value, and the extent of a whole array")]
fn assignment(
    l: &mut Lowering<'_, '_>,
    Assigned { target, value, condition, roles, .. }: Assigned<'_>,
    guard: Option<ExprId>,
    place: &Place,
) -> Option<(VarId, Affine, ExprId, Option<u32>)> {
    let (symbol, at) = boxes::target(l, target, place, roles)?;
    let SymbolKind::Variable { var, unit, .. } = l.symbols[symbol].kind.clone() else { return None };
    let declared = l.symbols[symbol].span;
    let what = format!("`{}`", l.symbols[symbol].path);
    let (at, whole) = match at {
        Some(at) => (at, None),
        None => {
            let len = l.symbols.vars[var].len;
            let depth = crate::ir::LoopVar(place.depth);
            if len == 1 { (Affine::default(), None) } else { (Affine::along(0, depth, 1), Some(len)) }
        }
    };
    let taken = &mut |s: &mut Lowering<'_, '_>, v, span| s.values().strictly_or_bare(v, &unit, span, &what, declared);
    let v = l.declared_value(value, place, taken, &unit);
    let mut e = l.values().strictly_or_bare(v, &unit, value.span, &what, declared);
    if let Some(c) = condition {
        let holds = l.condition(c, place);
        let present = l.exprs.load(var, Flavour::Value, at);
        e = l.exprs.select(holds, e, present);
        let unknown = doubting(l).unknown(holds);
        e = l.values().or_nan(e, unknown);
    }
    if let Some(guard) = guard {
        let present = l.exprs.load(var, Flavour::Value, at);
        e = l.exprs.select(guard, e, present);
    }
    Some((var, at, e, whole))
}

/// `event name when condition`, with what happens `at name`.
fn watched_events<'a>(
    l: &mut Lowering<'_, 'a>,
    blocks: &[(ScopeId, Vec<Item<'a>>)],
    programs: &[(ScopeId, &'a str, Program)],
    out: &mut Instants,
) {
    let mut used = vec![false; programs.len()];
    for (scope, item) in each(blocks) {
        let Item::Other(Statement { kind: StatementKind::Event { name, condition, .. }, .. }) = item else { continue };
        if matches!(name.text.as_str(), "start" | "end") {
            let message = format!("an event cannot be called `{}`: that is the {} of every step", name.text, name.text);
            l.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, message, name.span).help("give the event another name"));
            continue;
        }
        let program = programs.iter().position(|(s, n, _)| *n == name.text && *s == scope);
        program.iter().for_each(|&at| used[at] = true);
        let place = Place::new(scope, Site::Instant);
        let Some((value, strict)) = root_of(l, condition, &place) else { continue };
        let action = match program {
            Some(at) => out.push_event(programs[at].2.clone()),
            None => RootAction::Restart,
        };
        let name = l.symbols.path_of(scope, name);
        out.roots.push(Root { name, value, strict, action });
    }
    for ((_, name, _), _) in programs.iter().zip(used).filter(|(_, used)| !used) {
        refuse_event(l, blocks, name);
    }
}

/// Reports `at` a name that is not an event.
fn refuse_event(l: &mut Lowering<'_, '_>, blocks: &[(ScopeId, Vec<Item<'_>>)], name: &str) {
    let known: Vec<&str> = blocks
        .iter()
        .flat_map(|(_, items)| items)
        .filter_map(|i| match i {
            Item::Other(Statement { kind: StatementKind::Event { name, .. }, .. }) => Some(name.text.as_str()),
            _ => None,
        })
        .chain(["start", "end"])
        .collect();
    let span = blocks
        .iter()
        .flat_map(|(_, items)| items)
        .find_map(|i| match i {
            Item::At(moment, _) if moment.every.is_none() && moment.name.text == name => Some(moment.name.span),
            _ => None,
        })
        .unwrap_or_default();
    let failure = each(blocks).find_map(|(_, item)| match item {
        Item::Other(Statement { kind: StatementKind::Fail { name: failure, .. }, span }) if failure.text == name => Some(*span),
        _ => None,
    });
    let Some(failure) = failure else {
        let help = did_you_mean(name, known);
        l.ledger.report(Diagnostic::error(codes::UNKNOWN_NAME, format!("no event is called `{name}`"), span).maybe_help(help));
        return;
    };
    l.ledger.report(
        Diagnostic::error(codes::WRONG_KIND, format!("`{name}` is a failure: the episode ends there, and nothing is set"), span)
            .secondary(failure, "declared here")
            .help(format!("declare `event` with the same condition under another name, and write `at` that name instead of `at {name}`")),
    );
}

/// Root function of a comparison, positive where it holds, and whether it is strict.
pub(in crate::elaborate) fn root_of(l: &mut Lowering<'_, '_>, condition: &Expr, place: &Place) -> Option<(ExprId, bool)> {
    let ExprKind::Binary(op, a, b) = &condition.kind else {
        let help = match &condition.kind {
            ExprKind::Call { function, .. } | ExprKind::Reduce { function, .. } if matches!(function.text.as_str(), "any" | "all") => {
                "compare the extreme of the elements: `max(T[z] for z) > T_max` instead of `any(T[z] > T_max for z)`"
            }
            _ => "for example `h <= 0 [m]`",
        };
        l.ledger.report(Diagnostic::error(codes::WRONG_KIND, "an event is a comparison of two quantities", condition.span).help(help));
        return None;
    };
    let (rising, strict) = match op {
        BinaryOp::Lt => (false, true),
        BinaryOp::Le => (false, false),
        BinaryOp::Gt => (true, true),
        BinaryOp::Ge => (true, false),
        _ => {
            l.ledger.report(Diagnostic::error(codes::WRONG_KIND, "an event is a comparison with `<`, `<=`, `>` or `>=`", condition.span));
            return None;
        }
    };
    let (x, y) = (l.value(a, place), l.value(b, place));
    let (left, right) = l.values().common(&x, a.span, &y, b.span, condition.span)?;
    let value = if rising { l.exprs.sub(left, right) } else { l.exprs.sub(right, left) };
    Some((moving_clock(l, value), strict))
}

/// The clock of a condition that is watched throughout the step runs; elsewhere it is the instant
/// of the program.
pub(in crate::elaborate) fn moving_clock(l: &mut Lowering<'_, '_>, e: ExprId) -> ExprId {
    let (builtins, at) = (l.hidden.builtins, Affine::constant(Builtin::Clock as i64));
    l.exprs.rewrite(e, &mut Rewritten::default(), &mut |exprs, node| match node {
        Node::Load { var, at: element, .. } if var == builtins && element == at => Some(exprs.time()),
        _ => None,
    })
}
