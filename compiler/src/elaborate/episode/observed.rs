//! Observations as they are put together, and their properties.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Expr, ExprKind, Observation};
use smpl_dsl::units::Unit;

use crate::elaborate::episode::common::store;
use crate::elaborate::lower::bounded::Bounded;
use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::value::Measure;
use crate::elaborate::lower::{Lowering, defaults, structural, units};
use crate::ir::{Affine, ExprId, Nest, Place as Memory};
use crate::model::Observed;

/// The observations of a level with the nests that compute them.
#[derive(Default)]
pub(in crate::elaborate) struct Observations {
    /// One entry a number.
    pub names: Vec<Observed>,
    /// Stores into the output vector, counted from the first observation.
    pub nests: Vec<Nest>,
    /// The same with their bounds, for boxes.
    pub bounded: Vec<Bounded>,
    /// The levels, where the wanted one is among them.
    pub levels: Vec<String>,
}

impl Observations {
    /// Stores numbers, in loops if there are any.
    pub(super) fn store(&mut self, extents: Vec<u32>, at: Affine, value: ExprId) {
        let store = store(Memory::Out, at, value);
        match self.nests.first_mut().filter(|n| n.loops.is_empty()) {
            _ if !extents.is_empty() => self.nests.push(Nest::over(extents, vec![store])),
            Some(first) => first.stores.push(store),
            None => self.nests.insert(0, Nest { loops: Vec::new(), stores: vec![store] }),
        }
    }
}

/// Clauses of an observation in addition to its value.
pub(super) struct Attributes {
    pub bounds: Option<(f64, f64)>,
    pub every: u32,
    pub delay: u32,
    pub noise: f64,
}

impl Attributes {
    /// Of an observation that says nothing else.
    pub(super) const NONE: Attributes = Attributes { bounds: None, every: 1, delay: 0, noise: 0.0 };

    /// An observed number, with its own bounds if the observation has none.
    pub(super) fn observed(&self, name: String, unit: String, own: (f64, f64)) -> Observed {
        let (low, high) = self.bounds.unwrap_or(own);
        Observed { name, unit, low, high, every: self.every, delay: self.delay, noise: self.noise }
    }
}

/// Most steps of a sample interval or a delay.
const MOST_STEPS: i64 = 999_999;

/// Bounds, sampling, delay and noise of an observation in a unit.
pub(super) fn attributes(l: &mut Lowering<'_, '_>, o: &Observation, unit: &Unit, place: &Place) -> Attributes {
    let bounds = o.bounds.as_ref().map(|(a, b)| {
        let mut number = |e: &Expr| {
            let expr = l.number_in(e, unit, "the bound", e.span, place);
            match defaults::constant_value(l, expr) {
                Some(x) => x,
                None => {
                    l.ledger.missing_value("a bound", e.span);
                    f64::NAN
                }
            }
        };
        (number(a), number(b))
    });
    if let (Some((low, high)), Some((a, b))) = (bounds, &o.bounds)
        && low >= high
    {
        let message = match low == high {
            true => format!("the bounds of the observation leave it no range: {low}..{high}"),
            false => format!("the bounds of the observation are the wrong way round: {low}..{high}"),
        };
        l.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, a.span.to(b.span)));
    }
    let count = |s: &mut Lowering<'_, '_>, e: &Option<Expr>, what: &str, least: i64| match e {
        Some(e) => match structural::steps(s, e, what, place) {
            Some(n) if n >= least && n <= MOST_STEPS => n as u32,
            Some(n) => {
                s.ledger.report(Diagnostic::error(
                    codes::BAD_SETTING,
                    format!("a number of steps from {least} to {MOST_STEPS} is needed, not {n}"),
                    e.span,
                ));
                least as u32
            }
            None => least as u32,
        },
        None => least as u32,
    };
    let (every, delay) = (count(l, &o.every, "every", 1), count(l, &o.delay, "delay", 0));
    let noise = o.noise.as_ref().map_or(0.0, |e| noise(l, e, unit, place));
    Attributes { bounds, every, delay, noise }
}

/// Standard deviation of `normal(0, sd)`: a difference, of a temperature in degC one in K.
fn noise(l: &mut Lowering<'_, '_>, e: &Expr, unit: &Unit, place: &Place) -> f64 {
    let ExprKind::Call { function, arguments } = &e.kind else { return refuse_noise(l, e) };
    let ("normal", [mean, sd]) = (function.text.as_str(), arguments.as_slice()) else { return refuse_noise(l, e) };
    let unit = units::difference(unit);
    check_mean(l, mean, &unit, place);
    if let Measure::Of(scale) = &l.value(sd, place).unit
        && units::is_point(scale)
    {
        let text = format!("a temperature in {scale} is a point on a scale, and noise a difference");
        l.ledger.report(Diagnostic::error(codes::AFFINE_UNIT, text, sd.span).help("write `normal(0, 0.5 [K])`"));
        return 0.0;
    }
    let Some((expr, value)) = noise_number(l, sd, &unit, place) else { return 0.0 };
    match value {
        Some(x) if x >= 0.0 && x.is_finite() => return x,
        Some(x) if x > 0.0 => {
            l.ledger.report(Diagnostic::error(codes::WRONG_ARGUMENTS, "a standard deviation is finite", sd.span));
        }
        Some(x) => {
            let text = format!("a standard deviation is not negative, this is {x}");
            l.ledger.report(Diagnostic::error(codes::WRONG_ARGUMENTS, text, sd.span));
        }
        None => {
            let text = "the standard deviation of noise must be a constant: numbers and parameters";
            let found = l.symbols.varying(l.exprs, expr).map(|what| format!("it depends on {what}"));
            let fault = Diagnostic::error(codes::WRONG_ARGUMENTS, text, sd.span);
            l.ledger.report(found.into_iter().fold(fault, Diagnostic::label).help(DRAWN));
        }
    }
    0.0
}

/// Text of noise that is not constant.
const DRAWN: &str =
    "noise is added to what is observed, with mean zero; what is drawn otherwise can be a `disturbance` in the observed expression";

fn refuse_noise(l: &mut Lowering<'_, '_>, e: &Expr) -> f64 {
    let fault = Diagnostic::error(codes::WRONG_ARGUMENTS, "noise is given as `normal(0, standard deviation)`", e.span);
    l.ledger.report(fault.help(DRAWN));
    0.0
}

/// A number of noise, and its value if that is known; `None` after a reported fault.
fn noise_number(l: &mut Lowering<'_, '_>, e: &Expr, unit: &Unit, place: &Place) -> Option<(ExprId, Option<f64>)> {
    let reports = l.ledger.reports.diagnostics.len();
    let expr = l.number_in(e, unit, "the noise", e.span, place);
    let value = defaults::constant_value(l, expr);
    (l.ledger.reports.diagnostics.len() == reports).then_some((expr, value))
}

/// Noise has mean zero: a constant offset is not noise.
fn check_mean(l: &mut Lowering<'_, '_>, mean: &Expr, unit: &Unit, place: &Place) {
    let Some((_, value)) = noise_number(l, mean, unit, place) else { return };
    if value != Some(0.0) {
        l.ledger.report(
            Diagnostic::error(codes::WRONG_ARGUMENTS, "the mean of noise is 0", mean.span)
                .help("write `normal(0, standard deviation)`; a bias is added to what is observed: `observe measured = x + bias`"),
        );
    }
}

/// Warns of an observation that any number may be.
pub(super) fn warn_of_missing_bounds(l: &mut Lowering<'_, '_>, name: &str, o: &Observation) {
    l.ledger.report(
        Diagnostic::warning(codes::NO_BOX, format!("the observation `{name}` has no bounds"), o.span)
            .help("write `in low..high`: learners need a finite box"),
    );
}
