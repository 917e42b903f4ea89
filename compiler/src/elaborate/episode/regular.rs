//! Regular instants: `at every 3 [s]`.
//!
//! They happen at whole multiples of their interval, at 0 too. Those at the start of a step follow
//! `at start`; those inside of it are events whose root function is linear in time. One at the end
//! of a step belongs to the next step, which knows its action. A hidden discrete variable counts
//! the instants of each interval, so that times do not drift. All intervals form one program, in
//! which each statement has the condition that its own instant is due. Controllers come first and
//! see the values before the instant; blocks follow and see the controllers' outputs.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::Expr;

use crate::elaborate::episode::assignments::Instants;
use crate::elaborate::episode::common::{builtin, store};
use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::{Lowering, defaults};
use crate::ir::{Affine, Builtin, Compare, ExprId, Flavour, LoopVar, Nest, Place as Memory, Program, Store, UnaryFn, VarId};
use crate::model::Root;

/// Distance at which two instants are one, in parts of the shorter of interval and step. An instant
/// that was done is not found again in a later step.
const TOGETHER: f64 = 1e-6;

/// Most instants of one interval in a step.
const MOST: f64 = 1e6;

/// The number of an interval among those of the model; reports one that is not a time above zero.
pub(super) fn interval(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> Option<usize> {
    let value = l.value(e, place);
    if value.is_poison() {
        return None;
    }
    let before = l.ledger.reports.diagnostics.len();
    let unit = l.symbols.time_unit.clone();
    let expr = l.values().strictly_in(value, &unit, e.span, "the interval after `every`", Span::default());
    if l.ledger.reports.diagnostics.len() > before {
        return None;
    }
    let Some(x) = defaults::constant_value(l, expr) else {
        let fault = Diagnostic::error(codes::WRONG_KIND, "the interval after `every` must be a constant time", e.span);
        l.ledger.report(fault.label("changes while the model runs").help("use numbers and parameters that are computed from numbers"));
        return None;
    };
    defaults::mark_structural(l, expr);
    if !(x > 0.0 && x.is_finite()) {
        let fault = Diagnostic::error(codes::BAD_SETTING, format!("the interval after `every` must be above zero, not {x}"), e.span);
        l.ledger.report(fault.help("give the time between two instants, for example `every 3 [s]`"));
        return None;
    }
    if l.names.step / x > MOST {
        let message = format!("more than {MOST} regular instants in a step of {} [{unit}]", l.names.step);
        l.ledger.report(Diagnostic::error(codes::TOO_LARGE, message, e.span).help("give a longer interval or a shorter step"));
        return None;
    }
    let regular = l.hidden.regular.as_mut()?;
    let known = regular.intervals.iter().position(|&other| other.to_bits() == x.to_bits());
    Some(known.unwrap_or_else(|| {
        regular.intervals.push(x);
        regular.intervals.len() - 1
    }))
}

/// Condition that an instant of an interval is due.
pub(super) fn due(l: &mut Lowering<'_, '_>, every: &Expr, place: &Place) -> Option<ExprId> {
    let number = interval(l, every, place)?;
    let (ticks, x) = l.hidden.regular.as_ref().map(|regular| (regular.ticks, regular.intervals[number]))?;
    Some(is_due(l, (ticks, number), x))
}

fn is_due(l: &mut Lowering<'_, '_>, at: (VarId, usize), interval: f64) -> ExprId {
    let next = next_time(l, at, interval);
    let (time, near) = (l.exprs.time(), l.exprs.constant(TOGETHER * interval.min(l.names.step)));
    let until = l.exprs.add(time, near);
    l.exprs.compare(Compare::Le, next, until)
}

/// Time of the next instant of an interval.
fn next_time(l: &mut Lowering<'_, '_>, at: (VarId, usize), interval: f64) -> ExprId {
    let (number, interval) = (number_of(l, at), l.exprs.constant(interval));
    l.exprs.mul(number, interval)
}

fn number_of(l: &mut Lowering<'_, '_>, (ticks, number): (VarId, usize)) -> ExprId {
    l.exprs.load(ticks, Flavour::Value, Affine::constant(number as i64))
}

/// Appends the regular instants at the start of a step to its program, and makes events of those
/// inside of it; `interval` is the integrated length of a step. They are the last of the events: an
/// event or the end of a phase at the same time precedes them, as one at the end of a step does.
pub(in crate::elaborate) fn regular_programs(l: &mut Lowering<'_, '_>, interval: f64, out: &mut Instants) {
    let Some((ticks, intervals)) = l.hidden.regular.as_ref().map(|regular| (regular.ticks, regular.intervals.clone())) else { return };
    if intervals.is_empty() {
        return;
    }
    let (first, advance): (Vec<Store>, Vec<Store>) =
        intervals.iter().enumerate().map(|(number, &x)| (first_number(l, (ticks, number), x), following(l, (ticks, number), x))).unzip();
    let nest = |stores| Nest { loops: Vec::new(), stores };
    let mut program = Program { in_place: true, ..std::mem::take(&mut out.regular) };
    program.nests.push(nest(advance));
    out.start.nests.push(nest(first));
    out.start.nests.extend(program.nests.iter().cloned());
    out.start.in_place = true;
    let action = out.push_event(program);
    let unit = l.symbols.time_unit.to_string();
    for (number, &x) in intervals.iter().enumerate() {
        let value = root(l, (ticks, number), x, interval);
        out.roots.push(Root { name: format!("every {x} {unit}"), value, strict: false, action });
    }
}

/// The number of the first instant that is not before the present time.
fn first_number(l: &mut Lowering<'_, '_>, (ticks, number): (VarId, usize), interval: f64) -> Store {
    let near = TOGETHER * (l.names.step / interval).min(1.0);
    let (time, interval, near) = (l.exprs.time(), l.exprs.constant(interval), l.exprs.constant(near));
    let ratio = l.exprs.div(time, interval);
    let ratio = l.exprs.sub(ratio, near);
    let first = l.exprs.unary(UnaryFn::Ceil, ratio);
    store(Memory::Var(ticks), Affine::constant(number as i64), first)
}

/// The number of the instant after one that is due.
fn following(l: &mut Lowering<'_, '_>, at: (VarId, usize), interval: f64) -> Store {
    let (due, number, one) = (is_due(l, at, interval), number_of(l, at), l.exprs.constant(1.0));
    let after = l.exprs.add(number, one);
    let value = l.exprs.select(due, after, number);
    store(Memory::Var(at.0), Affine::constant(at.1 as i64), value)
}

/// Root function of the next instant of an interval inside of the step; -1 where it is at its end
/// or later.
fn root(l: &mut Lowering<'_, '_>, at: (VarId, usize), interval: f64, length: f64) -> ExprId {
    let next = next_time(l, at, interval);
    let (begin, length) = (builtin(l, Builtin::Begin), l.exprs.constant(length - TOGETHER * interval.min(l.names.step)));
    let end = l.exprs.add(begin, length);
    let inside = l.exprs.compare(Compare::Lt, next, end);
    let (time, away) = (l.exprs.time(), l.exprs.constant(-1.0));
    let passed = l.exprs.sub(time, next);
    l.exprs.select(inside, passed, away)
}

/// Initial values of the memory: the errors of controllers are infinite until their first instant.
pub(super) fn initial(l: &mut Lowering<'_, '_>) -> Vec<Nest> {
    let Some(regular) = l.hidden.regular.as_ref() else { return Vec::new() };
    let parts = [(regular.ticks, regular.intervals.len() as u32, 0.0), (regular.errors.var, regular.errors.len, f64::INFINITY)];
    let parts = parts.into_iter().filter(|(_, len, _)| *len > 0);
    parts
        .map(|(var, len, value)| {
            let value = l.exprs.constant(value);
            Nest::over([len], vec![store(Memory::Var(var), Affine::along(0, LoopVar(0), 1), value)])
        })
        .collect()
}

/// Largest number of regular instants inside of a step; the limit on events allows as many more.
pub(super) fn most_in_a_step(l: &Lowering<'_, '_>, length: f64) -> u32 {
    let intervals = l.hidden.regular.iter().flat_map(|regular| &regular.intervals);
    intervals.map(|x| (length / x).ceil() as u32).fold(0, u32::saturating_add)
}
