//! Settings of the episode and the solver, in the text and from outside: what [`ENTRIES`] lists.

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind, Ident, StatementKind};
use smpl_dsl::units::Unit;

use crate::elaborate::episode::common::each;
use crate::elaborate::episode::entries::{Block, COUNT_TEXT, ENTRIES, EntryValues, ORDER_TEXT, Takes, is_count, is_order, setting_entry};
use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::structural::whole;
use crate::elaborate::lower::value::Measure;
use crate::elaborate::lower::{Lowering, defaults, units};
use crate::elaborate::options::Setting;
use crate::elaborate::select::items::{Item, block_around};
use crate::elaborate::symbols::ScopeId;
use crate::model::{Episode, Solver};

/// Entries of the blocks `episode` and `solver`.
pub(in crate::elaborate) fn settings(l: &mut Lowering<'_, '_>, blocks: &[(ScopeId, Vec<Item<'_>>)]) -> (Episode, Solver) {
    let mut values = EntryValues::default();
    let mut given = Vec::new();
    for (scope, item) in each(blocks) {
        let Item::Other(statement) = item else { continue };
        let place = Place::new(scope, Site::Dynamics);
        let (block, entries) = match &statement.kind {
            StatementKind::Episode { entries } => (Block::Episode, entries),
            StatementKind::Solver { entries } => (Block::Solver, entries),
            _ => continue,
        };
        for (name, e) in entries {
            // An entry of a variant, or of text added to the file, replaces one outside.
            let here = (block_around(l.input.files, statement.span), statement.span.file);
            match given.iter().find(|(b, n, place, _)| *b == block && *n == name.text && *place == here) {
                Some((.., first)) => {
                    let fault = Diagnostic::error(codes::DUPLICATE_CLAUSE, format!("`{}` is given twice", name.text), name.span);
                    l.ledger.report(fault.label("a second time").secondary(*first, "first here").help("keep one of the two"));
                }
                None => given.push((block, name.text.clone(), here, name.span)),
            }
            entry_of_text(l, block, (name, e), &place, &mut values);
        }
    }
    // An `rtol` from outside holds for every method.
    if l.input.options.settings.contains_key("rtol") {
        values.solver.one_step_rtol = None;
    }
    for (name, value) in &l.input.options.settings {
        entry_of_settings(l, name, value, &mut values);
    }
    if let Some(n) = l.input.options.max_steps {
        values.episode.max_steps = n;
    }
    values.episode.integrate = values.integrate.unwrap_or(values.episode.step);
    l.names.step = values.episode.step;
    let span = given.iter().find(|(block, name, ..)| *block == Block::Episode && name == "cycle").map(|(.., span)| *span);
    check_cycle(l, &values.episode, span);
    (values.episode, values.solver)
}

/// Refuses a period that is not a multiple of the step.
fn check_cycle(l: &mut Lowering<'_, '_>, episode: &Episode, span: Option<Span>) {
    let Some(period) = episode.cycle.filter(|period| whole(period / episode.step).is_none_or(|steps| steps < 1)) else { return };
    let message = format!("`cycle` must be a multiple of the step of {}, it is {period}", episode.step);
    match span {
        Some(span) => l.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, span)),
        None => l.ledger.reports.scenario_fault("cycle", message, None),
    }
}

/// An entry of a block of the text.
fn entry_of_text(l: &mut Lowering<'_, '_>, block: Block, (name, e): (&Ident, &Expr), place: &Place, values: &mut EntryValues) {
    let Some(entry) = ENTRIES.iter().find(|entry| entry.block == block && entry.name == name.text) else {
        return l.ledger.unknown_entry(name, block);
    };
    let time = l.symbols.time_unit.clone();
    match &entry.takes {
        Takes::Duration(to) => put(to(values), positive(l, name, e, &time, place)),
        Takes::Interval(to) => *to(values) = positive(l, name, e, &time, place),
        Takes::Positive(to) => put(to(values), positive(l, name, e, &Unit::one(), place)),
        Takes::Tolerance(to) => {
            if let Some(rtol) = within(l, name, e, place, |x| Solver::RTOL.contains(&x), Solver::RTOL_TEXT) {
                to(values, rtol);
            }
        }
        Takes::Order(to) => put(to(values), whole_number(l, name, e, place, is_order, ORDER_TEXT)),
        Takes::Count(to) => put(to(values), whole_number(l, name, e, place, is_count, COUNT_TEXT)),
        // Rewards carry their own units; a number without a unit is taken in each.
        Takes::Number(to) => {
            let v = l.value(e, place);
            if v.is_poison() {
                return;
            }
            match defaults::constant_value(l, v.expr) {
                Some(x) if x.is_finite() => {
                    *to(values) = x;
                    l.names.error_reward = match v.unit {
                        Measure::Of(unit) if !units::is_plain_number(&unit) => Some((unit, e.span)),
                        _ => None,
                    };
                }
                Some(x) => {
                    let message = format!("`{}` must be finite, it is {x}", name.text);
                    l.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, e.span));
                }
                None => l.ledger.missing_value(&format!("`{}`", name.text), e.span),
            }
        }
        Takes::Truth(to) => *to(values) = holds(l, e, place),
        Takes::Name(names) => {
            if !matches!(&e.kind, ExprKind::Name(n) if (names.put)(values, &n.text)) {
                l.ledger.report(Diagnostic::error(codes::BAD_SETTING, format!("the {} is {}", names.what, names.text), e.span));
            }
        }
    }
}

/// An entry that is set from outside.
fn entry_of_settings(l: &mut Lowering<'_, '_>, name: &str, value: &Setting, values: &mut EntryValues) {
    let Some(entry) = setting_entry(name).filter(|_| !l.symbols.parameters_named(name)) else { return };
    let number = match value {
        Setting::Number(x) => *x,
        _ => f64::NAN,
    };
    let refused = match &entry.takes {
        Takes::Name(names) => (!matches!(value, Setting::Text(text) if (names.put)(values, text))).then_some(names.text),
        takes => takes.refuses(number),
    };
    if let Some(expected) = refused {
        let given = match value {
            Setting::Number(x) => x.to_string(),
            Setting::Text(text) => text.clone(),
            Setting::List(list) => format!("{list:?}"),
        };
        l.ledger.reports.scenario_fault(name, format!("`{name}` must be {expected}, not {given}"), None);
        return;
    }
    match &entry.takes {
        Takes::Interval(to) => *to(values) = Some(number),
        Takes::Number(to) => {
            *to(values) = number;
            l.names.error_reward = None;
        }
        Takes::Tolerance(to) => to(values, number),
        Takes::Duration(to) | Takes::Positive(to) => *to(values) = number,
        Takes::Order(to) | Takes::Count(to) => *to(values) = number as u32,
        Takes::Name(_) | Takes::Truth(_) => {}
    }
}

fn put<T>(to: &mut T, x: Option<T>) {
    if let Some(x) = x {
        *to = x;
    }
}

fn setting_number(l: &mut Lowering<'_, '_>, name: &Ident, e: &Expr, unit: &Unit, place: &Place) -> Option<f64> {
    let reports = l.ledger.reports.diagnostics.len();
    let expr = l.number_in(e, unit, &format!("`{}`", name.text), name.span, place);
    let value = defaults::constant_value(l, expr).filter(|x| !x.is_nan());
    if l.ledger.reports.diagnostics.len() != reports {
        return None;
    }
    if value.is_none() {
        l.ledger.missing_value(&format!("`{}`", name.text), e.span);
    }
    value
}

fn positive(l: &mut Lowering<'_, '_>, name: &Ident, e: &Expr, unit: &Unit, place: &Place) -> Option<f64> {
    let x = setting_number(l, name, e, unit, place)?;
    if x > 0.0 && x.is_finite() {
        return Some(x);
    }
    let what = if x > 0.0 { "finite" } else { "positive" };
    l.ledger.report(Diagnostic::error(codes::BAD_SETTING, format!("`{}` must be {what}, it is {x}", name.text), e.span));
    None
}

/// A number without a unit for which something holds.
fn within(l: &mut Lowering<'_, '_>, name: &Ident, e: &Expr, place: &Place, holds: impl Fn(f64) -> bool, expected: &str) -> Option<f64> {
    let x = setting_number(l, name, e, &Unit::one(), place)?;
    if holds(x) {
        return Some(x);
    }
    let message = format!("`{}` must be {expected}, it is {x}", name.text);
    l.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, e.span));
    None
}

/// A whole number for which something holds, but for rounding.
fn whole_number(
    l: &mut Lowering<'_, '_>,
    name: &Ident,
    e: &Expr,
    place: &Place,
    holds: impl Fn(f64) -> bool,
    expected: &str,
) -> Option<u32> {
    let nearest = |x: f64| whole(x).map_or(x, |n| n as f64);
    within(l, name, e, place, |x| holds(nearest(x)), expected).map(|x| nearest(x) as u32)
}

/// Returns `true` if a condition of a setting is true.
fn holds(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> bool {
    let c = l.condition(e, place);
    matches!(l.exprs.node(c), crate::ir::Expr::Truth(true))
}

impl Ledger {
    fn unknown_entry(&mut self, name: &Ident, block: Block) {
        let known: Vec<&str> = ENTRIES.iter().filter(|e| e.block == block).map(|e| e.name).collect();
        let block = if block == Block::Episode { "episode" } else { "solver" };
        let help = did_you_mean(&name.text, known.iter().copied());
        self.report(
            Diagnostic::error(codes::BAD_SETTING, format!("`{block}` has no entry `{}`", name.text), name.span)
                .maybe_help(help)
                .note(format!("it takes {}", known.join(", "))),
        );
    }
}
