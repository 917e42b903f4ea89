//! `delay(e, theta)`: what an expression was a dead time ago.
//!
//! A call becomes elements of the variable of role `Delayed`, one for each pass of the loops that
//! change it: inputs that the runtime fills from the past. It reads the earlier value v, its rate s
//! there and the earlier time a that the runtime has looked up, `v + s*((t - theta) - a)`. The
//! second term is zero; by it time, dead times and what these depend on have their derivatives.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::Expr;

use crate::elaborate::hidden::{Delayed, element};
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, units};
use crate::elaborate::select::items::reference;
use crate::ir::{Affine, BinaryFn, DELAY_SLOTS, DelaySlot, Expr as Node, ExprId, Flavour, MAX_DEPTH, Role, UnaryFn};
use crate::model::{Delay, Lag};

/// Most elements of all calls together: the past of each is kept.
const MOST: u64 = 1 << 20;

/// `delay(e, theta)`, `delay(e, theta, before = e0)`
pub(in crate::elaborate) fn delay(l: &mut Lowering<'_, '_>, span: Span, arguments: &[Expr], place: &Place) -> Value {
    let (argument, lag, start) = match arguments {
        [argument, lag] => (argument, lag, None),
        [argument, lag, start] => (argument, lag, Some(start)),
        _ => {
            let message = format!("`delay` takes an expression and a dead time, not {} arguments", arguments.len());
            let fault = Diagnostic::error(codes::WRONG_ARGUMENTS, message, span);
            return l.fault(fault.help("write `delay(e, theta)` or `delay(e, theta, before = e0)`"));
        }
    };
    delayed(l, span, (argument, lag, start), Bounds::Declared, place)
}

/// `transport(c, v, L)` with its residence time: the value of c that time ago.
pub(in crate::elaborate) fn transport(l: &mut Lowering<'_, '_>, span: Span, arguments: &[Expr], place: &Place) -> Value {
    let fault = match arguments {
        [value, _, _, lag] => return delayed(l, span, (value, lag, None), Bounds::Known, place),
        [_, _, _] => Diagnostic::error(codes::MISPLACED_FUNCTION, "`transport` outside of an equation or a `let`", span)
            .help("name its value, `let c_out = transport(c, v, L)`"),
        _ => Diagnostic::error(codes::WRONG_ARGUMENTS, format!("`transport` takes 3 arguments, not {}", arguments.len()), span)
            .help("write `transport(c, v, L)`: a value, the velocity, and the length"),
    };
    l.fault(fault)
}

/// The time minus that a residence time ago: this is the residence time, or zero at rest.
pub(in crate::elaborate) fn elapsed(l: &mut Lowering<'_, '_>, span: Span, arguments: &[Expr], place: &Place) -> Value {
    let [lag] = arguments else { return l.poison() };
    let Some((theta, about)) = dead_time(l, (lag, lag), span, Bounds::Known, place) else { return l.poison() };
    let time = l.exprs.time();
    match signal(l, (time, theta, Some(time)), Delay { before: true, ..about }, place) {
        Some(earlier) => Value::of(l.exprs.sub(time, earlier), l.symbols.time_unit.clone()),
        None => l.poison(),
    }
}

/// Source of the bounds of a dead time.
#[derive(Clone, Copy, PartialEq)]
enum Bounds {
    /// The declarations.
    Declared,
    /// It is a residence time: above zero, and increasing more slowly than time.
    Known,
}

/// The value of an expression a dead time ago.
fn delayed(
    l: &mut Lowering<'_, '_>,
    span: Span,
    (argument, lag, start): (&Expr, &Expr, Option<&Expr>),
    bounds: Bounds,
    place: &Place,
) -> Value {
    if !matches!(place.site, Site::Dynamics | Site::Instant) || l.hidden.draws.site.is_some() {
        let fault = Diagnostic::error(codes::MISPLACED_FUNCTION, "`delay` in a value that is drawn or set at the start", span);
        return l.fault(fault.help("delay values in equations, updates, conditions, rewards and observations"));
    }
    let mut value = l.value(argument, place);
    let before = start.map(|start| (l.value(start, place), start.span));
    let Some((theta, about)) = dead_time(l, (argument, lag), span, bounds, place) else { return l.poison() };
    if value.is_poison() || before.as_ref().is_some_and(|(before, _)| before.is_poison()) {
        return l.poison();
    }
    if let Some(fault) = refused(l, &value, argument.span) {
        return l.fault(fault);
    }
    let mut before_start = None;
    if let Some((before, at)) = before {
        if let (Measure::Of(own), Measure::Of(other)) = (&value.unit, &before.unit)
            && l.values().convert(before.expr, other, own).is_none()
        {
            return l.fault(units::mismatch(other, own, at, "the value `before` of `delay`", argument.span));
        }
        let Some((now, earlier)) = l.values().common(&value, argument.span, &before, at, span) else { return l.poison() };
        let unit = value.unit.beside(&before.unit);
        (value, before_start) = (Value { expr: now, unit }, Some(earlier));
    }
    let always = !changes(l, value.expr);
    if l.exprs.as_const(theta) == Some(0.0) || (always && before_start.is_none()) {
        return value;
    }
    let Value { expr, unit } = value;
    let about = Delay { before: before_start.is_some(), ..about };
    match signal(l, (expr, theta, before_start), about, place) {
        Some(expr) => Value { expr, unit },
        None => l.fault(Diagnostic::error(codes::TOO_LARGE, format!("more than {MOST} delayed values"), span)),
    }
}

/// The dead time in the model's unit of time, and what is known of it.
fn dead_time(
    l: &mut Lowering<'_, '_>,
    (argument, lag): (&Expr, &Expr),
    span: Span,
    known: Bounds,
    place: &Place,
) -> Option<(ExprId, Delay)> {
    let given = l.value(lag, place);
    if given.is_poison() {
        return None;
    }
    let unit = l.symbols.time_unit.clone();
    let theta = l.values().strictly_or_bare(given, &unit, lag.span, "the dead time of `delay`", span);
    let name = format!("delay({}, {})", reference(argument), reference(lag));
    if let Some(number) = l.exprs.as_const(theta)
        && !(number >= 0.0 && number.is_finite())
    {
        let fault = Diagnostic::error(codes::WRONG_ARGUMENTS, format!("the dead time of `{name}` is {number}"), lag.span);
        l.ledger.report(fault.label("must be zero or above, and finite").help("give a time in the past"));
        return None;
    }
    if reads(l, theta, |role, _| role == Role::Draw) {
        l.ledger.report(random(&format!("the dead time of `{name}`"), lag.span));
        return None;
    }
    let lag_changes = when(l, theta);
    let mut bounds = (f64::INFINITY, f64::INFINITY);
    if lag_changes != Lag::Constant && known == Bounds::Declared {
        let (low, high) = range(l, theta);
        if !(low > 0.0 && high.is_finite() && low <= high) {
            let message = format!("the dead time of `{name}` changes within an episode and has no bounds above zero");
            let fault = Diagnostic::error(codes::WRONG_ARGUMENTS, message, lag.span);
            l.ledger.report(fault.help(format!("declare it with bounds: `var theta : {unit} in 0.5 .. 20`")));
            return None;
        }
        bounds = (low, high);
    }
    Some((theta, Delay { name, count: 1, bounds, lag: lag_changes, before: false, span }))
}

/// Reason why a value has no past.
fn refused(l: &Lowering<'_, '_>, value: &Value, span: Span) -> Option<Diagnostic> {
    if matches!(value.unit, Measure::Truth) {
        let fault = Diagnostic::error(codes::WRONG_KIND, "`delay` of a condition", span);
        return Some(fault.help("write `delay(if condition then 1 else 0, theta)`"));
    }
    if reads(l, value.expr, |role, _| role == Role::Draw) {
        return Some(random("`delay` of an expression", span));
    }
    let over_step = reads(l, value.expr, |role, _| role == Role::Quadrature);
    over_step.then(|| {
        let fault = Diagnostic::error(codes::MISPLACED_FUNCTION, "`delay` of an integral over the step", span);
        fault.help("declare a state with `d/dt m = ...` and delay that")
    })
}

fn random(what: &str, span: Span) -> Diagnostic {
    let fault = Diagnostic::error(codes::MISPLACED_FUNCTION, format!("{what} that reads a random number"), span);
    fault.help("name the random number as a `disturbance` or a `param`, and delay that")
}

/// Returns `true` if an expression reads a variable of some role and flavour.
fn reads(l: &Lowering<'_, '_>, e: ExprId, accept: impl Fn(Role, Flavour) -> bool) -> bool {
    !l.exprs.loads(e, |var, flavour| accept(l.symbols.vars[var].role, flavour)).is_empty()
}

/// Returns `true` if an expression changes within an episode.
fn changes(l: &Lowering<'_, '_>, e: ExprId) -> bool {
    when(l, e) != Lag::Constant
}

/// When an expression changes.
fn when(l: &Lowering<'_, '_>, e: ExprId) -> Lag {
    let moving = |role: Role, flavour: Flavour| {
        flavour == Flavour::Derivative
            || (flavour == Flavour::Value && matches!(role, Role::State | Role::Algebraic | Role::Quadrature | Role::Delayed))
    };
    let timed = l.exprs.below([e]).any(|e| l.exprs.node(e) == Node::Time);
    if timed || reads(l, e, moving) {
        return Lag::Varying;
    }
    let held = |role: Role, flavour: Flavour| flavour != Flavour::Value || !matches!(role, Role::Param | Role::ParamGiven);
    if reads(l, e, held) { Lag::Held } else { Lag::Constant }
}

/// The numbers between which an expression lies by the declared bounds of what it reads.
fn range(l: &Lowering<'_, '_>, e: ExprId) -> (f64, f64) {
    let all = (f64::NEG_INFINITY, f64::INFINITY);
    let hull = |ends: [f64; 4]| match ends.iter().any(|end| end.is_nan()) {
        true => all,
        false => (ends.into_iter().fold(f64::INFINITY, f64::min), ends.into_iter().fold(f64::NEG_INFINITY, f64::max)),
    };
    match l.exprs.node(e) {
        Node::Const(bits) => (f64::from_bits(bits), f64::from_bits(bits)),
        Node::Load { var, flavour: Flavour::Value, .. } => l.quantities.get(&var).map_or(all, |q| {
            (q.low.iter().copied().fold(f64::INFINITY, f64::min), q.high.iter().copied().fold(f64::NEG_INFINITY, f64::max))
        }),
        Node::Select(_, a, b) => {
            let ((a, b), (c, d)) = (range(l, a), range(l, b));
            (a.min(c), b.max(d))
        }
        Node::Unary(UnaryFn::Neg, a) => {
            let (low, high) = range(l, a);
            (-high, -low)
        }
        Node::Binary(f, a, b) => {
            let ((a, b), (c, d)) = (range(l, a), range(l, b));
            match f {
                BinaryFn::Add => (a + c, b + d),
                BinaryFn::Sub => (a - d, b - c),
                BinaryFn::Mul => hull([a * c, a * d, b * c, b * d]),
                BinaryFn::Div if c > 0.0 || d < 0.0 => hull([a / c, a / d, b / c, b / d]),
                BinaryFn::Min => (a.min(c), b.min(d)),
                BinaryFn::Max => (a.max(c), b.max(d)),
                _ => all,
            }
        }
        _ => all,
    }
}

/// The delayed value as a node; `None` where there are too many.
fn signal(l: &mut Lowering<'_, '_>, values: (ExprId, ExprId, Option<ExprId>), about: Delay, place: &Place) -> Option<ExprId> {
    let (value, theta, before) = values;
    let free = [Some(value), Some(theta), before].into_iter().flatten().fold(0, |free, e| free | l.exprs.free(e));
    let depth = (0..MAX_DEPTH.min(usize::from(place.depth))).rev().find(|d| free & (1 << d) != 0).map_or(0, |d| d + 1);
    let passes = |d: usize| l.loops.frames.get(d).map_or(1, |frame| frame.passes);
    let extents: Vec<u32> = (0..depth).map(|d| if free & (1 << d) == 0 { 1 } else { passes(d) as u32 }).collect();
    let count = extents.iter().fold(1_u64, |n, &extent| n.saturating_mul(u64::from(extent)));
    if count > MOST {
        return None;
    }
    let var = l.hidden.delays.var;
    let first = l.hidden.delays.first(Delayed { values, extents: extents.clone(), about: Delay { count: count as u32, ..about } });
    let at = element(&extents).plus(Affine::constant(first)).times(i64::from(DELAY_SLOTS));
    let mut slot = |slot: DelaySlot| l.exprs.load(var, Flavour::Value, at.plus(Affine::constant(slot as i64)));
    let (earlier, slope, looked_up) = (slot(DelaySlot::Value), slot(DelaySlot::Slope), slot(DelaySlot::At));
    let time = l.exprs.time();
    let asked = l.exprs.sub(time, theta);
    let off = l.exprs.sub(asked, looked_up);
    let correction = l.exprs.mul(slope, off);
    Some(l.exprs.add(earlier, correction))
}
