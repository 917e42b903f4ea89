//! Reason why an episode fails, in words.

use serde::{Deserialize, Serialize};
use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::ir::{Affine, MAX_DEPTH};
use smpl_compiler::model::{BoxItem, Interface, Row};
use smpl_dsl::diagnostic::SourceMap;

use crate::catalogue::Catalogue;

/// Identifier of the failure of an action outside its box.
pub(crate) const ACTION_BOX: &str = "action_box";
/// Identifier of the failure of the integrator.
pub(crate) const SOLVER: &str = "solver";
/// Identifier of the failure of events that follow one another without end.
pub(crate) const EVENTS: &str = "events";
/// Identifier of the failure of a number that is not finite although nothing else failed.
pub(crate) const NOT_FINITE: &str = "not_finite";

/// Identifier of the failure of a trajectory that has no start, see [`crate::rollout`].
pub const START: &str = "start";

/// A failure of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Failure {
    /// An action outside its box.
    ActionBox,
    /// The integrator gave up.
    Solver,
    /// A failure that the model declares, by its index.
    Declared(u32),
    /// Something is not finite.
    NotFinite,
    /// Events followed one another without end.
    Events,
}

impl Failure {
    /// Its identifier.
    #[must_use]
    pub fn name(self, interface: &Interface) -> &str {
        match self {
            Failure::ActionBox => ACTION_BOX,
            Failure::Solver => SOLVER,
            Failure::NotFinite => NOT_FINITE,
            Failure::Events => EVENTS,
            Failure::Declared(index) => interface.finish.failures.get(index as usize).map_or("", |f| &f.name),
        }
    }
}

/// Kinds of failures, as data for callers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum FailureKind {
    /// No failure.
    #[default]
    None,
    /// No consistent start: the trajectory has no steps.
    Start,
    /// The integrator gave up: the step was undone.
    Solver,
    /// Events followed one another without end: the step was cut.
    Events,
    /// A declared failure found by an event: the step was cut.
    Event,
    /// A value is not finite.
    NotFinite,
    /// An action outside its box; the step was completed if the action is finite.
    ActionBox,
    /// A declared box, after a complete step.
    Box,
    /// Another declared condition, after a complete step.
    Condition,
}

impl FailureKind {
    /// Its identifier; empty without a failure.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Start => START,
            Self::Solver => SOLVER,
            Self::Events => EVENTS,
            Self::Event => "event",
            Self::NotFinite => NOT_FINITE,
            Self::ActionBox => ACTION_BOX,
            Self::Box => "box",
            Self::Condition => "condition",
        }
    }
}

/// Cause of the integrator's failure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SolverFailure {
    /// Time at which it happened, in the model's unit.
    pub time: f64,
    /// Description.
    pub cause: Cause,
    /// The unknown (place in `y`) whose equation is to blame, where one is known.
    pub unknown: Option<usize>,
    /// The root function at whose threshold the integration stopped, if any.
    pub event: Option<usize>,
    /// Unknowns at the thresholds of switches that follow each other without end, with their
    /// values.
    #[serde(default)]
    pub switches: [Option<(usize, f64)>; 2],
}

/// Causes of a solver failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cause {
    /// An equation gave NaN or infinity.
    NotFinite,
    /// The error test or Newton's iteration failed at the smallest step.
    NoConvergence,
    /// More internal steps than allowed.
    TooManySteps,
    /// Switches of the equations that follow each other without end.
    Switching,
    /// The iteration matrix is singular.
    Singular,
    /// No consistent algebraic variables at the start of the interval.
    Inconsistent,
    /// A function of the model panicked (a fault of the compiler).
    Panicked,
    /// At a restart within the episode, no solution inside of the declared bounds.
    Outside,
    /// A nonnegative state would become negative.
    Negative,
    /// Anything else; the solver's return code.
    Other(i32),
    /// Somebody wanted the integration to stop.
    Interrupted,
}

/// Events without end within a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Chatter {
    /// Time of the last one.
    pub time: f64,
    /// The last one, by its root function.
    pub event: usize,
    /// Another one at the same instant.
    pub partner: Option<usize>,
    /// The last one came sooner and sooner.
    pub accumulates: bool,
}

impl Chatter {
    /// Description: `events, the last `hit` at t = 4.06 s, follow one another ever faster`.
    #[must_use]
    pub fn describe(&self, model: &CompiledModel, limit: u32) -> String {
        let name = |index: usize| model.roots_info().get(index).map_or("", |root| &root.name);
        let at = format!("at t = {} {}", Short(self.time), model.interface().time.unit);
        let event = name(self.event);
        match (self.accumulates, self.partner) {
            (true, _) => format!("`{event}` follows itself ever faster {at}"),
            (false, Some(other)) => {
                format!("`{}` and `{event}` follow each other without end {at} (more than {limit} in the step)", name(other))
            }
            (false, None) => {
                format!("more than {limit} in the step, the last one `{event}` {at} (`solver {{ max_events }}` sets the limit)")
            }
        }
    }
}

/// A number that is not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum NotFinite {
    /// An unknown, by its place in `y`.
    Unknown(usize),
    /// A discrete variable, by its place in the region.
    Discrete(usize),
    /// The condition of a failure, by its index.
    Failure(usize),
    /// The condition of a success.
    Success(usize),
    /// A constraint.
    Constraint(usize),
    /// The condition of an event, by its root function.
    Event(usize),
    /// A reward.
    Reward(usize),
    /// An observation.
    Observation(usize),
}

impl NotFinite {
    /// Error.
    #[must_use]
    pub fn describe(self, model: &CompiledModel, catalogue: &Catalogue) -> String {
        format!("{} is not finite", self.quantity(model, catalogue))
    }

    /// Kind and name.
    #[must_use]
    pub fn quantity(self, model: &CompiledModel, catalogue: &Catalogue) -> String {
        let interface = model.interface();
        let element = |family: &crate::catalogue::Family, at: usize| {
            family.elements().iter().find(|e| e.at == at).map_or_else(String::new, |e| e.name.clone())
        };
        let (what, name) = match self {
            Self::Unknown(at) if at < model.states() => ("the state", element(&catalogue.states, at)),
            Self::Unknown(at) => ("the variable", element(&catalogue.solved, at)),
            Self::Discrete(at) => ("the discrete variable", element(&catalogue.discretes, at)),
            Self::Failure(i) => {
                ("the condition of the failure", interface.finish.failures.get(i).map(|f| f.name.clone()).unwrap_or_default())
            }
            Self::Success(i) => ("the condition of the success", interface.finish.successes.get(i).cloned().unwrap_or_default()),
            Self::Constraint(i) => ("the constraint", interface.finish.constraints.get(i).cloned().unwrap_or_default()),
            Self::Event(i) => ("the condition of the event", model.roots_info().get(i).map(|r| r.name.clone()).unwrap_or_default()),
            Self::Reward(i) => ("the reward", interface.finish.rewards.get(i).map(|r| r.name.clone()).unwrap_or_default()),
            Self::Observation(i) => ("the observation", interface.finish.observations.get(i).map(|o| o.name.clone()).unwrap_or_default()),
        };
        format!("{what} `{name}`")
    }
}

/// The message of a solver failure: `equation at reactor.eq:41, d/dt T, became NaN at t = 3.2 min`.
#[must_use]
pub(crate) fn describe_solver(
    failure: &SolverFailure,
    model: &CompiledModel,
    catalogue: &Catalogue,
    sources: Option<&SourceMap>,
) -> String {
    let when = format!("at t = {}{}", Short(failure.time), unit_suffix(&model.interface().time.unit));
    let equation = failure.unknown.map(|unknown| describe_equation(unknown, model, catalogue, sources));
    let subject = |verb: &str| match &equation {
        Some(equation) => format!("{equation}, {verb} {when}"),
        None => format!("the integration {verb} {when}"),
    };
    let guard = failure.event.and_then(|event| model.guard(event));
    if let (Some(guard), true) =
        (guard, matches!(failure.cause, Cause::NotFinite | Cause::NoConvergence | Cause::TooManySteps | Cause::Singular))
    {
        return format!("{}: {}", subject("could not be integrated"), guard.text);
    }
    match failure.cause {
        Cause::NotFinite => subject("became NaN"),
        Cause::NoConvergence => subject("could not be integrated (no convergence at the smallest step)"),
        Cause::TooManySteps => {
            let text = subject("took more internal steps than `solver { max_steps }` (the setting `max_internal_steps`) allows");
            match failure.event.and_then(|event| model.roots_info().get(event)) {
                Some(event) => format!("{text}, at the threshold of `{}`: the equations may turn round there, from both sides", event.name),
                None => text,
            }
        }
        Cause::Switching => switching(failure, catalogue, &when),
        Cause::Singular => subject("met a singular iteration matrix"),
        Cause::Outside => subject("has no solution inside of the declared bounds that the search finds"),
        Cause::Negative => subject("would become negative, and is declared `nonnegative`"),
        Cause::Inconsistent => subject("could not be solved (no consistent algebraic variables)"),
        Cause::Panicked => subject("was ended by a panic inside a model function"),
        Cause::Interrupted => subject("was interrupted"),
        Cause::Other(code) => subject(&format!("failed (IDA code {code})")),
    }
}

/// The message of switches without end.
fn switching(failure: &SolverFailure, catalogue: &Catalogue, when: &str) -> String {
    let elements = || catalogue.states.elements().iter().chain(catalogue.solved.elements());
    let threshold = |&(at, value): &(usize, f64)| {
        let element = elements().find(|e| e.at == at)?;
        Some(format!("`{}` = {}{}", element.name, Short(value), unit_suffix(&element.unit)))
    };
    let mut thresholds: Vec<String> = failure.switches.iter().flatten().filter_map(threshold).collect();
    thresholds.sort();
    let places = if thresholds.is_empty() { String::new() } else { format!(" near {}", thresholds.join(" and ")) };
    format!(
        "switches of the equations{places} follow each other without end {when}: the equations lead back to the thresholds from both sides"
    )
}

/// `equation at reactor.eq:41, d/dt T`.
#[must_use]
pub fn describe_equation(unknown: usize, model: &CompiledModel, catalogue: &Catalogue, sources: Option<&SourceMap>) -> String {
    let state = catalogue.states.elements().iter().find(|e| e.at == unknown);
    let name = match state {
        Some(state) => format!("d/dt {}", state.name),
        None => catalogue.solved.elements().iter().find(|e| e.at == unknown).map(|e| e.name.clone()).unwrap_or_default(),
    };
    match (row_of(unknown, model), sources) {
        (Some(row), Some(sources)) => {
            format!("equation at {}:{}, {name}", sources.name(row.span.file), sources.locate(row.span).line)
        }
        _ => format!("equation of {name}"),
    }
}

/// The nest of rows that holds the row of an unknown.
pub(crate) fn row_of(unknown: usize, model: &CompiledModel) -> Option<&Row> {
    model.model().rows.iter().find(|row| {
        let first = model.offset(row.var).map(|first| first as i64);
        first.is_some_and(|first| covers(&row.extents, &row.at, unknown as i64 - first))
    })
}

/// Returns `true` if some counters of the nest address the element.
fn covers(extents: &[u32], at: &Affine, element: i64) -> bool {
    let mut counters = [0; MAX_DEPTH];
    loop {
        if at.at(&counters) == element {
            return true;
        }
        let Some(depth) = (0..extents.len()).rev().find(|&d| counters[d] + 1 < i64::from(extents[d])) else {
            return false;
        };
        counters[depth] += 1;
        counters[depth + 1..].fill(0);
    }
}

/// Violation of a member of a box; `None` inside, with a slack of 1e-6 of the range.
#[must_use]
pub(crate) fn describe_item(item: &BoxItem, value: f64) -> Option<String> {
    let slack = BOX_SLACK * (item.high - item.low).abs();
    let slack = if slack.is_finite() { slack } else { 0.0 };
    let unit = unit_suffix(&item.unit);
    if !value.is_finite() {
        Some(format!("{} is not finite", item.name))
    } else if value > item.high + slack {
        Some(format!("{} = {}{unit} is above {}{unit}", item.name, Short(value), Short(item.high)))
    } else if value < item.low - slack {
        Some(format!("{} = {}{unit} is below {}{unit}", item.name, Short(value), Short(item.low)))
    } else {
        None
    }
}

/// A unit behind a number; nothing for a number without one.
#[must_use]
pub fn unit_suffix(unit: &str) -> String {
    if unit == "1" || unit.is_empty() { String::new() } else { format!(" {unit}") }
}

/// Slack of a box: a value may exceed a bound by this part of the range.
pub(crate) const BOX_SLACK: f64 = 1e-6;

/// A number as a message shows it: up to seven significant digits.
#[derive(Clone, Copy, Debug)]
pub struct Short(pub f64);

impl std::fmt::Display for Short {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let x = self.0;
        if x == 0.0 || !x.is_finite() {
            return write!(f, "{x}");
        }
        let exponent = x.abs().log10().floor() as i32;
        if !(-4..9).contains(&exponent) {
            let text = format!("{x:.6e}");
            let (mantissa, power) = text.split_once('e').unwrap_or((&text, "0"));
            return write!(f, "{}e{power}", trim(mantissa));
        }
        let decimals = (6 - exponent).max(0) as usize;
        f.write_str(trim(&format!("{x:.decimals$}")))
    }
}

/// Without zeros at the end of the decimals.
fn trim(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_numbers_keep_seven_digits_and_no_idle_zeros() {
        let texts: Vec<String> = [3.2, 0.1 + 0.2, 1e-8, 123_456_789.0, 2.5e12, -0.05].map(|x| Short(x).to_string()).into();
        assert_eq!(texts, ["3.2", "0.3", "1e-8", "123456789", "2.5e12", "-0.05"]);
    }

    #[test]
    fn a_value_beyond_a_bound_by_a_millionth_of_the_range_is_inside() {
        let item = BoxItem { name: "q".into(), unit: "m^3/min".into(), low: 0.05, high: 0.2 };
        assert_eq!(describe_item(&item, f64::from(0.2_f32)), None);
        assert_eq!(describe_item(&item, 0.21).as_deref(), Some("q = 0.21 m^3/min is above 0.2 m^3/min"));
        assert!(describe_item(&item, f64::NAN).is_some());
    }

    #[test]
    fn a_nest_covers_the_elements_that_its_counters_reach() {
        let at = Affine::along(3, smpl_compiler::ir::LoopVar(0), 2);
        assert!(covers(&[4], &at, 9) && !covers(&[4], &at, 4) && !covers(&[4], &at, 11));
        assert!(covers(&[], &Affine::constant(5), 5) && !covers(&[], &Affine::constant(5), 4));
    }
}
