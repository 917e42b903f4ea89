//! Phases of a schedule.
//!
//! The phases of a model are a set named `phase`, numbered from 1 in the order of the text; the
//! first is in force at the start. The name `phase` by itself is the one in force: it is compared
//! with a phase (`phase == elute`) and used as an index (`Q[phase]`). `phase_time` is the time
//! since the phase began.
//!
//! A schedule becomes three discrete variables (the phase, the time of its beginning, and the phase
//! being left while a transition runs) and one root function per phase. All transitions share one
//! program: first the statements for the end of the phase, then the next phase. A duration is a
//! root linear in time, so that the integration stops exactly there. A condition is a root for each
//! of its alternatives that moves during a step. One that holds when a step starts (a request) ends
//! the phase before the integration.

use crate::elaborate::episode::assignments::{Assignments, Instants, instant_statement};
use crate::elaborate::episode::common::store;
use crate::elaborate::episode::instants::moving_clock;
use crate::elaborate::episode::together::Draft;
use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::symbols::{Schedule, Symbols};
use crate::ir::{Affine, BinaryFn, Compare, Expr, ExprId, Exprs, Flavour, Nest, Place as Memory, Program, Role};
use crate::model::{Quantity, Root};

/// Discrete variables of the schedule with their initial values.
pub(in crate::elaborate) fn schedule_initial(l: &mut Lowering<'_, '_>) -> Vec<crate::ir::Store> {
    let Some(schedule) = l.symbols.schedule.as_ref() else { return Vec::new() };
    let values = [(schedule.current, 1.0), (schedule.since, 0.0), (schedule.leaving, 0.0)];
    values
        .into_iter()
        .map(|(var, x)| {
            let value = l.exprs.constant(x);
            store(Memory::Var(var), Affine::default(), value)
        })
        .collect()
}

/// Names of the phases in their order.
pub(in crate::elaborate) fn schedule_phases(l: &Lowering<'_, '_>) -> Vec<String> {
    l.symbols.schedule.iter().flat_map(|s| &s.phases).map(|p| p.name.text.clone()).collect()
}

/// Public part of the schedule.
pub(in crate::elaborate) fn schedule_quantities(l: &Lowering<'_, '_>) -> Vec<Quantity> {
    let Some(schedule) = &l.symbols.schedule else { return Vec::new() };
    let quantity = |var, name: &str, unit: String, text: &str, high: f64, default: f64| Quantity {
        var: Some(var),
        name: name.to_owned(),
        axes: Vec::new(),
        pattern: None,
        unit,
        text: text.to_owned(),
        low: vec![default],
        high: vec![high],
        default: vec![default],
        scale: vec![1.0],
        affine_unit: false,
        structural: false,
        nonnegative: false,
    };
    let names: Vec<&str> = schedule.phases.iter().map(|p| p.name.text.as_str()).collect();
    vec![
        quantity(schedule.current, "phase", "1".to_owned(), &names.join(", "), names.len() as f64, 1.0),
        quantity(schedule.since, "phase_start", l.symbols.time_unit.to_string(), "when the phase began", f64::INFINITY, 0.0),
    ]
}

/// Roots, event programs and the part of `at start` that end phases.
pub(in crate::elaborate) fn schedule_programs(l: &mut Lowering<'_, '_>, out: &mut Instants) {
    let Some(schedule) = l.symbols.schedule.as_ref() else { return };
    let place = Place::new(schedule.scope, Site::Instant);
    let transition = transition(l, schedule, &place);
    let mut leaving = l.exprs.constant(0.0);
    for (i, phase) in schedule.phases.iter().enumerate().rev() {
        let number = i as f64 + 1.0;
        let (current, own) = (l.values().discrete(schedule.current), l.exprs.constant(number));
        let here = l.exprs.compare(Compare::Eq, current, own);
        if let Some(duration) = &phase.duration {
            let d = l.value(duration, &place);
            let unit = l.symbols.time_unit.clone();
            let d = l.values().strictly_in(d, &unit, duration.span, "a duration", phase.name.span);
            let (t, since) = (l.exprs.time(), l.values().discrete(schedule.since));
            let elapsed = l.exprs.sub(t, since);
            let value = l.exprs.sub(elapsed, d);
            phase_root(l, schedule, i, here, (value, false), &transition, out);
        }
        let Some(until) = &phase.until else { continue };
        let holds = l.condition(until, &place);
        let now = l.exprs.and(here, holds);
        leaving = l.exprs.select(now, own, leaving);
        // What moves during a step is watched as well; a request made at its start is not.
        let watched = moving_clock(l, holds);
        for way in alternatives(l.exprs, watched) {
            if l.symbols.is_dynamic(l.exprs, way) {
                let root = root(l.exprs, l.symbols, way);
                phase_root(l, schedule, i, here, root, &transition, out);
            }
        }
    }
    if l.exprs.as_const(leaving).is_none() {
        let start = &mut out.start;
        let stores = vec![store(Memory::Var(schedule.leaving), Affine::default(), leaving)];
        start.nests.push(Nest { loops: Vec::new(), stores });
        start.nests.extend(transition.nests.iter().cloned());
        start.in_place = true;
        out.start_resets = true;
    }
}

/// Operands of the `or`s of a condition.
fn alternatives(exprs: &Exprs, condition: ExprId) -> Vec<ExprId> {
    match exprs.node(condition) {
        Expr::Or(a, b) => [a, b].into_iter().flat_map(|side| alternatives(exprs, side)).collect(),
        _ => vec![condition],
    }
}

/// Root function of a condition, positive where it holds, and whether it does not hold at zero.
/// What cannot be compared, or stands still during a step, is a number that jumps.
fn root(exprs: &mut Exprs, symbols: &Symbols<'_>, condition: ExprId) -> (ExprId, bool) {
    match exprs.node(condition) {
        _ if !symbols.is_dynamic(exprs, condition) => (sign_of(exprs, condition), false),
        Expr::Compare(op @ (Compare::Lt | Compare::Le), low, high) => (exprs.sub(high, low), op == Compare::Lt),
        Expr::And(a, b) | Expr::Or(a, b) => {
            let is_and = matches!(exprs.node(condition), Expr::And(..));
            let ((a, first), (b, second)) = (root(exprs, symbols, a), root(exprs, symbols, b));
            let (left, right) = (decided(exprs, a, b, is_and), decided(exprs, b, a, is_and));
            let value = exprs.binary(if is_and { BinaryFn::Min } else { BinaryFn::Max }, left, right);
            (value, if is_and { first || second } else { first && second })
        }
        Expr::Not(a) => {
            let (value, strict) = root(exprs, symbols, a);
            (exprs.neg(value), !strict)
        }
        _ => (sign_of(exprs, condition), false),
    }
}

/// A root function, or if it is not a number the other one of an `and` or `or` if that decides.
fn decided(exprs: &mut Exprs, value: ExprId, other: ExprId, is_and: bool) -> ExprId {
    let zero = exprs.constant(0.0);
    let (below, above) = (exprs.compare(Compare::Lt, value, zero), exprs.compare(Compare::Le, zero, value));
    let decides = if is_and { exprs.compare(Compare::Lt, other, zero) } else { exprs.compare(Compare::Lt, zero, other) };
    let is_number = exprs.or(below, above);
    let not_decided = exprs.not(decides);
    let own = exprs.or(is_number, not_decided);
    exprs.select(own, value, other)
}

/// 1 where a condition holds, else -1.
fn sign_of(exprs: &mut Exprs, condition: ExprId) -> ExprId {
    let (holds, not) = (exprs.constant(1.0), exprs.constant(-1.0));
    exprs.select(condition, holds, not)
}

fn phase_root<'a>(
    l: &mut Lowering<'_, 'a>,
    schedule: &Schedule<'a>,
    i: usize,
    here: ExprId,
    (value, strict): (ExprId, bool),
    transition: &Program,
    out: &mut Instants,
) {
    // Outside its phase the condition does not hold: it becomes true anew each time.
    let away = l.exprs.constant(-1.0);
    let value = l.exprs.select(here, value, away);
    let number = l.exprs.constant(i as f64 + 1.0);
    let stores = vec![store(Memory::Var(schedule.leaving), Affine::default(), number)];
    let mut program = Program { nests: vec![Nest { loops: Vec::new(), stores }], in_place: true };
    program.nests.extend(transition.nests.iter().cloned());
    let action = out.push_event(program);
    let name = schedule.phases[i].name.text.clone();
    out.roots.push(Root { name, value, strict, action });
}

/// Updates at the end of any phase.
fn transition<'a>(l: &mut Lowering<'_, 'a>, schedule: &Schedule<'a>, place: &Place) -> Program {
    let mut draft = Draft::default();
    let (current, since) = (l.values().discrete(schedule.current), l.values().discrete(schedule.since));
    let leaving = l.values().discrete(schedule.leaving);
    let mut assignments = Assignments::default();
    assignments.exclusive = true;
    let (mut next, mut left) = (current, l.exprs.truth(false));
    for (i, phase) in schedule.phases.iter().enumerate() {
        let number = l.exprs.constant(i as f64 + 1.0);
        let is_left = l.exprs.compare(Compare::Eq, leaving, number);
        assignments.guard = Some(is_left);
        for statement in &phase.body {
            instant_statement(l, place.scope, statement, (&mut draft, phase.name.span), &mut assignments, &phase.name.text);
        }
        assignments.guard = None;
        let follower = phase.next.as_ref().and_then(|n| schedule.phases.iter().position(|p| p.name.text == n.text));
        if let Some(to) = follower {
            let to = l.exprs.constant(to as f64 + 1.0);
            next = l.exprs.select(is_left, to, next);
            left = l.exprs.or(left, is_left);
        }
    }
    let mut program = draft.program(l);
    let t = l.exprs.time();
    let since_value = l.exprs.select(left, t, since);
    let zero = l.exprs.constant(0.0);
    let stores = [(schedule.current, next), (schedule.since, since_value), (schedule.leaving, zero)]
        .map(|(var, value)| store(Memory::Var(var), Affine::default(), value));
    program.nests.push(Nest { loops: Vec::new(), stores: stores.to_vec() });
    program
}

impl Symbols<'_> {
    /// Returns `true` if a value changes within a step.
    fn is_dynamic(&self, exprs: &Exprs, e: ExprId) -> bool {
        exprs.below([e]).any(|e| match exprs.node(e) {
            Expr::Time => true,
            Expr::Load { var, flavour: Flavour::Value | Flavour::Derivative, .. } => {
                matches!(self.vars[var].role, Role::State | Role::Algebraic)
            }
            _ => false,
        })
    }
}
