//! Assignments at instants: `next`, `reset`, `clamp`.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Expr, Statement, StatementKind};

use crate::elaborate::episode::common::store;
use crate::elaborate::episode::together::{Assignment, AssignmentKind, Draft};
use crate::elaborate::episode::unknown::doubting;
use crate::elaborate::lower::nests::for_each_element;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, boxes, nests};
use crate::elaborate::symbols::{ScopeId, SymbolKind};
use crate::ir::{Affine, ExprId, FastMap, Flavour, Place as Memory, Program, Role, VarId};
use crate::model::{Root, RootAction};

/// Updates at the instants of a step.
#[derive(Default)]
pub(in crate::elaborate) struct Instants {
    /// At its start.
    pub start: Program,
    /// At its end.
    pub end: Program,
    /// At regular instants.
    pub regular: Program,
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
    assigned: FastMap<(ScopeId, String), Setters>,
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
        StatementKind::Next { .. } => AssignmentKind::Next,
        StatementKind::Reset { .. } => AssignmentKind::Reset,
        _ => AssignmentKind::Clamp,
    };
    if kind != AssignmentKind::Next {
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
        if kind == AssignmentKind::Next && !assignments.exclusive {
            check_next(l, assignments, (scope, instant), var, (&extents, at), (statement.span, Setter::Next));
        }
        draft.push(l, block, kind, Assignment { extents, store: store(Memory::Var(var), at, v) });
    }
}

/// Elements that are set at one instant, with the statement of each.
type Setters = FastMap<(VarId, i64), (Span, Setter)>;

/// Kind of a statement that gives a discrete variable its value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::elaborate::episode) enum Setter {
    Next,
    Control,
}

/// Two `next`s or controllers of one element at one instant are a fault, one for a statement.
pub(in crate::elaborate::episode) fn check_next(
    l: &mut Lowering<'_, '_>,
    assignments: &mut Assignments,
    (scope, instant): (ScopeId, &str),
    var: VarId,
    (extents, at): (&[u32], Affine),
    (span, setter): (Span, Setter),
) {
    let mut twice = None;
    let assigned = assignments.assigned.entry((scope, instant.to_owned())).or_default();
    for_each_element(extents, at, &mut |i| {
        if let Some(first) = assigned.insert((var, i), (span, setter)) {
            twice.get_or_insert((i, first));
        }
    });
    if let Some((element, (first, before))) = twice {
        let name = l.quantities.get(&var).map_or_else(String::new, |q| q.element_name(element.max(0) as usize));
        let message = match (setter, before) {
            (Setter::Next, Setter::Next) => format!("two `next {name}` at one instant"),
            (Setter::Control, Setter::Control) => format!("`{name}` has two controllers"),
            _ => format!("`{name}` is set by a controller and by `next`"),
        };
        let help = match instant {
            _ if setter == Setter::Control && before == Setter::Control => {
                "remove one of them; for a cascade, let one set the set-point of the other: `control y_set from x setpoint r ...`"
            }
            _ if setter != before => "a controller keeps the last value, or another one, by `manual v when condition`: write no `next`",
            "end" => {
                "a discrete variable has one `next` in all `at end` blocks of a model or component: write one expression, or let another variable hold what is in between"
            }
            "every" => "regular instants with different intervals meet, and assign together: let one of them set another variable",
            _ => "all `next` of an instant assign together, so there can be one only",
        };
        l.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, message, span).secondary(first, "the first one").help(help));
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
