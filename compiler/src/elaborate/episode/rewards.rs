//! Rewards, and those that pay for going away and coming back.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Ident, Statement, StatementKind};
use smpl_dsl::units::Unit;

use crate::elaborate::episode::common::each;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::values::Values;
use crate::elaborate::lower::{Lowering, units};
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::ScopeId;
use crate::ir::{BinaryFn, Expr, ExprId, Flavour, Role, UnaryFn};
use crate::model::Reward;

/// The rewards of a model.
pub(in crate::elaborate) struct Rewards {
    /// Their values.
    pub values: Vec<ExprId>,
    /// Public part.
    pub list: Vec<Reward>,
    /// The one that is returned.
    pub default: u32,
}

/// The declared rewards; `error_reward` is the number of a failing step, which becomes one in their
/// unit.
pub(in crate::elaborate) fn rewards<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)], error_reward: &mut f64) -> Rewards {
    let mut units = Vec::new();
    let mut values = Vec::new();
    let mut list = Vec::new();
    let mut chosen = None;
    for (scope, item) in each(blocks) {
        let Item::Other(Statement { kind: StatementKind::Reward { name, unit: unit_written, default, value, text }, .. }) = item else {
            continue;
        };
        let place = Place::new(scope, Site::Instant);
        if *default {
            chosen = Some(values.len());
        }
        let what = format!("the reward `{}`", name.text);
        let (v, unit) = match unit_written {
            Some(written) => {
                let unit = units::unit(l, written, &place).unwrap_or_else(Unit::one);
                let taken = &mut |s: &mut Lowering<'_, 'a>, v, span| s.values().strictly_or_bare(v, &unit, span, &what, name.span);
                (l.declared_value(value, &place, taken, &unit), unit)
            }
            None => (l.value(value, &place), Unit::one()),
        };
        if unit_written.is_none() && refuse_missing_unit(l, name, &v, value.span) {
            continue;
        }
        let reward = l.values().strictly_or_bare(v, &unit, value.span, &what, name.span);
        check_limits(l, &name.text, reward, value.span);
        values.push(reward);
        let name = l.symbols.path_of(scope, name);
        units.push((name.clone(), unit.clone()));
        list.push(Reward { name, unit: unit.to_string(), text: text.clone().unwrap_or_default() });
    }
    if let Some(wanted) = &l.input.options.reward {
        let names: Vec<&str> = list.iter().map(|r: &Reward| r.name.as_str()).collect();
        match names.iter().position(|n| n == wanted) {
            Some(at) => chosen = Some(at),
            None => l.ledger.reports.scenario_fault(wanted, format!("unknown reward `{wanted}`; the model has {}", names.join(", ")), None),
        }
    }
    if let Some(in_unit) = error_reward_in(l, *error_reward, &units) {
        *error_reward = in_unit;
    }
    Rewards { values, list, default: chosen.unwrap_or(0) as u32 }
}

/// Reports a reward with a dimension that is declared without a unit.
fn refuse_missing_unit(l: &mut Lowering<'_, '_>, name: &Ident, v: &Value, span: Span) -> bool {
    let Measure::Of(unit) = &v.unit else { return false };
    if units::is_dimensionless(unit) {
        return false;
    }
    let (unit, what) = (unit.difference().simplest(), units::describe(unit));
    let fault = Diagnostic::error(codes::UNIT_MISMATCH, format!("the reward `{}` has no unit, and this is {what}", name.text), span);
    let help = format!("declare its unit, `reward {} : {unit} = ...`, or divide by a reference, `... / 1 [{unit}]`", name.text);
    l.ledger.report(fault.label(what).secondary(name.span, "declared without a unit").help(help));
    true
}

/// An `error_reward` with a unit as the number that every reward has on a failing step.
fn error_reward_in(l: &mut Lowering<'_, '_>, x: f64, rewards: &[(String, Unit)]) -> Option<f64> {
    let (given, span) = l.names.error_reward.take()?;
    let mut first: Option<(&String, &Unit, f64)> = None;
    for (name, unit) in rewards {
        let Some((factor, offset)) = units::conversion(&given, unit) else {
            let what = format!("the reward `{name}`");
            l.ledger.report(units::mismatch(&given, unit, span, &what, Span::default()));
            return None;
        };
        let number = factor * x + offset;
        match first {
            Some((other, scale, before)) if (before - number).abs() > 1e-12 * number.abs() => {
                let message = format!("`error_reward` is {before} of `{other}` [{scale}], but {number} of `{name}` [{unit}]");
                let fault = Diagnostic::error(codes::UNIT_MISMATCH, message, span);
                l.ledger.report(fault.help("give a number without a unit, which is taken in the unit of each reward"));
                return None;
            }
            Some(_) => {}
            None => first = Some((name, unit, number)),
        }
    }
    first.map(|(.., number)| number)
}

/// Warns where a reward limits a change over a step on one side only: what an episode loses at once
/// is limited, and what it gains back is not. The change of a limited value sums up to its end less
/// its start.
fn check_limits(l: &mut Lowering<'_, '_>, name: &str, reward: ExprId, span: Span) {
    if limits_one_side(l, reward) {
        let message = format!("the reward `{name}` limits a change on one side only");
        let warning = Diagnostic::warning(codes::ONE_SIDED_LIMIT, message, span);
        l.ledger.report(warning.help("an episode that goes far and comes back is paid without end: write `max(low, d) - previous(max(low, d))`, or limit both sides by `clip`"));
    }
}

/// Returns `true` if a term of a sum is a limited difference, with a sign that pays.
fn limits_one_side(l: &mut Lowering<'_, '_>, reward: ExprId) -> bool {
    let mut terms = vec![(reward, true)];
    while let Some((e, adds)) = terms.pop() {
        match l.exprs.node(e) {
            Expr::Unary(UnaryFn::Neg, a) => terms.push((a, !adds)),
            Expr::Binary(BinaryFn::Add, a, b) => terms.extend([(a, adds), (b, adds)]),
            Expr::Binary(BinaryFn::Sub, a, b) => terms.extend([(a, adds), (b, !adds)]),
            Expr::Binary(BinaryFn::Mul | BinaryFn::Div, a, b) => terms.extend(l.values().scaled(a, b).map(|(e, sign)| (e, adds == sign))),
            // A cost of a change in one direction only is a usual one.
            Expr::Binary(BinaryFn::Max, a, b) if adds && limits(l, a, b) => return true,
            Expr::Binary(BinaryFn::Min, a, b) if limits(l, a, b) => return true,
            _ => {}
        }
    }
    false
}

/// Returns `true` if one of two is a change over a step, and the other one does not change.
fn limits(l: &Lowering<'_, '_>, a: ExprId, b: ExprId) -> bool {
    let fixed = |e| instants(l, e) == (false, false);
    let change = |e| match l.exprs.node(e) {
        Expr::Binary(BinaryFn::Sub, a, b) => {
            let (a, b) = (instants(l, a), instants(l, b));
            (a == (true, false) && b == (false, true)) || (a == (false, true) && b == (true, false))
        }
        _ => false,
    };
    (fixed(a) && change(b)) || (change(a) && fixed(b))
}

/// Returns `true` if an expression reads present values of what changes, and values of the step
/// before.
fn instants(l: &Lowering<'_, '_>, e: ExprId) -> (bool, bool) {
    let mut found = (false, false);
    for e in l.exprs.below([e]) {
        match l.exprs.node(e) {
            Expr::Load { flavour: Flavour::Previous, .. } => found.1 = true,
            Expr::Load { flavour: Flavour::Value | Flavour::Derivative, var, .. } => found.0 |= l.symbols.vars[var].role != Role::Param,
            Expr::Time => found.0 = true,
            _ => {}
        }
    }
    found
}

impl Values<'_> {
    /// The factor of a number, and whether the number is positive.
    fn scaled(&self, a: ExprId, b: ExprId) -> Option<(ExprId, bool)> {
        match (self.exprs.node(a), self.exprs.node(b)) {
            (Expr::Const(bits), _) => Some((b, f64::from_bits(bits) > 0.0)),
            (_, Expr::Const(bits)) => Some((a, f64::from_bits(bits) > 0.0)),
            _ => None,
        }
    }
}
