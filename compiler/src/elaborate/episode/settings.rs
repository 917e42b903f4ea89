//! Settings of the episode and the solver.

use crate::elaborate::options::ENTRY_SETTINGS;
use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::syntax::{Expr, ExprKind, Ident, StatementKind};
use smpl_dsl::units::Unit;

use crate::elaborate::episode::common::each;
use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::options::Setting;
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::ScopeId;
use crate::model::{Episode, Solver};

const LINEAR_SOLVERS: &[&str] = &["auto", "dense", "banded", "block", "klu"];
const LINEAR_SOLVERS_TEXT: &str = "auto, dense, banded, block or klu";
const METHODS: &[&str] = &["ida", "rosenbrock", "explicit", "auto"];
const METHODS_TEXT: &str = "ida, rosenbrock, explicit or auto";

pub(in crate::elaborate) fn settings<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> (Episode, Solver) {
    let mut episode = Episode::default();
    let mut solver = Solver::default();
    let mut integrate = None;
    for (scope, item) in each(blocks) {
        let Item::Other(statement) = item else { continue };
        let place = Place::new(scope, Site::Dynamics);
        match &statement.kind {
            StatementKind::Episode { entries } => {
                for (name, e) in entries {
                    episode_entry(l, name, e, &place, &mut episode, &mut integrate);
                }
            }
            StatementKind::Solver { entries } => {
                for (name, e) in entries {
                    solver_entry(l, name, e, &place, &mut solver);
                }
            }
            _ => {}
        }
    }
    for (name, value) in l.input.options.settings.clone() {
        entry_setting(l, &name, &value, &mut episode, &mut solver, &mut integrate);
    }
    if let Some(n) = l.input.options.max_steps {
        episode.max_steps = n;
    }
    episode.integrate = integrate.unwrap_or(episode.step);
    (episode, solver)
}

/// An entry of `episode` or `solver` that is set from outside.
fn entry_setting(
    l: &mut Lowering<'_, '_>,
    name: &str,
    value: &Setting,
    episode: &mut Episode,
    solver: &mut Solver,
    integrate: &mut Option<f64>,
) {
    if l.symbols.parameters_named(name) || !ENTRY_SETTINGS.contains(&name) {
        return;
    }
    let number = match value {
        Setting::Number(x) => *x,
        _ => f64::NAN,
    };
    let positive = number.is_finite() && number > 0.0;
    let count = (1.0..4e9).contains(&number) && number.fract() == 0.0;
    let (holds, expected) = match name {
        "step" | "integrate" | "atol_factor" | "max_step" => (positive, "a positive number"),
        "error_reward" => (number.is_finite(), "a number"),
        "rtol" => (Solver::RTOL.contains(&number), Solver::RTOL_TEXT),
        "max_order" => ((1.0..=5.0).contains(&number) && number.fract() == 0.0, "a whole number from 1 to 5"),
        "max_steps" | "max_internal_steps" | "max_events" => (count, "a whole number of at least 1"),
        _ => (matches!(value, Setting::Text(text) if LINEAR_SOLVERS.contains(&text.as_str())), LINEAR_SOLVERS_TEXT),
    };
    if !holds {
        let given = match value {
            Setting::Number(x) => x.to_string(),
            Setting::Text(text) => text.clone(),
            Setting::List(list) => format!("{list:?}"),
        };
        l.ledger.reports.scenario_fault(format!("`{name}` must be {expected}, not {given}"), None);
        return;
    }
    match (name, value) {
        ("max_steps", _) => episode.max_steps = number as u32,
        ("max_events", _) => solver.max_events = number as u32,
        ("error_reward", _) => episode.error_reward = number,
        ("step", _) => episode.step = number,
        ("integrate", _) => *integrate = Some(number),
        ("rtol", _) => solver.rtol = number,
        ("atol_factor", _) => solver.atol_factor = number,
        ("max_step", _) => solver.max_step = number,
        ("max_order", _) => solver.max_order = number as u32,
        ("max_internal_steps", _) => solver.max_steps = number as u32,
        (_, Setting::Text(text)) => solver.linear_solver.clone_from(text),
        _ => {}
    }
}

fn setting_number(l: &mut Lowering<'_, '_>, name: &Ident, e: &Expr, unit: &Unit, place: &Place) -> Option<f64> {
    let reports = l.ledger.reports.diagnostics.len();
    let expr = l.number_in(e, unit, &format!("`{}`", name.text), name.span, place);
    let value = l.constant_value(expr).filter(|x| !x.is_nan());
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

fn whole_number(l: &mut Lowering<'_, '_>, name: &Ident, e: &Expr, place: &Place) -> Option<u32> {
    let x = setting_number(l, name, e, &Unit::one(), place)?;
    if x >= 1.0 && x.fract() == 0.0 && x < 4e9 {
        return Some(x as u32);
    }
    l.ledger.report(Diagnostic::error(
        codes::BAD_SETTING,
        format!("`{}` must be a whole number of at least 1, it is {x}", name.text),
        e.span,
    ));
    None
}

/// Whether a condition of a setting is true.
fn holds(l: &mut Lowering<'_, '_>, e: &Expr, place: &Place) -> bool {
    let c = l.condition(e, place);
    matches!(l.exprs.node(c), crate::ir::Expr::Truth(true))
}

fn episode_entry(l: &mut Lowering<'_, '_>, name: &Ident, e: &Expr, place: &Place, episode: &mut Episode, integrate: &mut Option<f64>) {
    let time = l.symbols.time_unit.clone();
    match name.text.as_str() {
        "step" => episode.step = positive(l, name, e, &time, place).unwrap_or(episode.step),
        "integrate" => *integrate = positive(l, name, e, &time, place),
        "max_steps" => episode.max_steps = whole_number(l, name, e, place).unwrap_or(episode.max_steps),
        "error_reward" => {
            // Rewards carry their own units; the number is taken in each.
            let v = l.value(e, place);
            episode.error_reward = l.constant_value(v.expr).unwrap_or(episode.error_reward);
        }
        "end_is_success" => episode.end_is_success = holds(l, e, place),
        "failure_pays_alone" => episode.failure_pays_alone = holds(l, e, place),
        "single_precision" => episode.single_precision = holds(l, e, place),
        _ => {
            let known = ["step", "integrate", "max_steps", "error_reward", "end_is_success", "failure_pays_alone", "single_precision"];
            l.ledger.unknown_entry(name, "episode", &known);
        }
    }
}

fn solver_entry(l: &mut Lowering<'_, '_>, name: &Ident, e: &Expr, place: &Place, solver: &mut Solver) {
    match name.text.as_str() {
        "rtol" => solver.rtol = within(l, name, e, place, |x| Solver::RTOL.contains(&x), Solver::RTOL_TEXT).unwrap_or(solver.rtol),
        "atol_factor" => solver.atol_factor = positive(l, name, e, &Unit::one(), place).unwrap_or(solver.atol_factor),
        "safety" => solver.safety = positive(l, name, e, &Unit::one(), place).unwrap_or(solver.safety),
        "max_order" => {
            let order = within(l, name, e, place, |x| (1.0..=5.0).contains(&x) && x.fract() == 0.0, "a whole number from 1 to 5");
            solver.max_order = order.map_or(solver.max_order, |x| x as u32);
        }
        "max_steps" => solver.max_steps = whole_number(l, name, e, place).unwrap_or(solver.max_steps),
        "max_events" => solver.max_events = whole_number(l, name, e, place).unwrap_or(solver.max_events),
        "max_step" => {
            let time = l.symbols.time_unit.clone();
            solver.max_step = positive(l, name, e, &time, place).unwrap_or(solver.max_step);
        }
        "algebraic_error_control" => solver.algebraic_error_control = holds(l, e, place),
        "quadrature_error_control" => solver.quadrature_error_control = holds(l, e, place),
        "linear_solver" => {
            let message = || format!("the linear solver is {LINEAR_SOLVERS_TEXT}");
            l.ledger.one_of(e, LINEAR_SOLVERS, message, &mut solver.linear_solver);
        }
        "method" => l.ledger.one_of(e, METHODS, || format!("the method is {METHODS_TEXT}"), &mut solver.method),
        _ => l.ledger.unknown_entry(
            name,
            "solver",
            &[
                "rtol",
                "atol_factor",
                "safety",
                "max_order",
                "max_steps",
                "max_step",
                "max_events",
                "linear_solver",
                "method",
                "algebraic_error_control",
                "quadrature_error_control",
            ],
        ),
    }
}

impl Ledger {
    /// One of several names.
    fn one_of(&mut self, e: &Expr, known: &[&str], message: impl FnOnce() -> String, to: &mut String) {
        match &e.kind {
            ExprKind::Name(n) if known.contains(&n.text.as_str()) => to.clone_from(&n.text),
            _ => self.report(Diagnostic::error(codes::BAD_SETTING, message(), e.span)),
        }
    }

    fn unknown_entry(&mut self, name: &Ident, block: &str, known: &[&str]) {
        let help = did_you_mean(&name.text, known.iter().copied());
        self.report(
            Diagnostic::error(codes::BAD_SETTING, format!("`{block}` has no entry `{}`", name.text), name.span)
                .maybe_help(help)
                .note(format!("it takes {}", known.join(", "))),
        );
    }
}
