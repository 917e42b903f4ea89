//! Public data of a model: names, units, bounds, reported quantities.

use std::ops::Range;

use serde::{Deserialize, Serialize};
use smpl_dsl::span::Span;

use super::{Episode, Grid, Quantity, Solver, Test, number};
use crate::ir::VarId;

/// All that is seen from outside.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Interface {
    /// Name of the model.
    pub name: String,
    /// Its describing text.
    pub text: String,
    /// The independent variable.
    pub time: Time,
    /// Everything that has a name, a unit and bounds.
    pub quantities: Quantities,
    /// Names of the algebraic outputs that are disturbances which follow data over time.
    pub measured: Vec<String>,
    /// Ports of components.
    pub ports: Vec<Port>,
    /// Domains in space.
    pub grids: Vec<Grid>,
    /// Names of the phases in their order, whose number (from 1) the discrete variable `phase`
    /// holds; empty without a schedule.
    pub phases: Vec<String>,
    /// Random numbers: element i of the variable of role `Draw`.
    pub draws: Vec<Draw>,
    /// End of a step.
    pub finish: Finish,
    /// Invariants.
    pub invariants: Vec<Invariant>,
    /// The steady problem, where a `steady` block exists or `steady()` is used.
    pub steady: Option<Steady>,
    /// Conditions at the start of an episode, in the order of the program `start_conditions`.
    pub start_conditions: Vec<StartCondition>,
    /// Some `at start` program resets states.
    pub start_resets: bool,
    /// Episode settings.
    pub episode: Episode,
    /// Solver settings.
    pub solver: Solver,
    /// Its choices.
    pub alternatives: Alternatives,
    /// Tests, where the model was compiled with them.
    #[serde(skip)]
    pub tests: Vec<Test>,
    /// Record of index reduction.
    pub reduction: Reduction,
}

/// Record of index reduction, for a system whose equations bind states.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Reduction {
    /// Equations of which time derivatives were added.
    pub differentiated: Vec<Differentiated>,
    /// States that became algebraic variables.
    pub demoted: Vec<Demoted>,
    /// Constraints that states are projected to at the end of each step.
    pub projected: Vec<Projected>,
    /// Number of conditions on states that these are.
    #[serde(default)]
    pub conditions: u32,
    /// Unknowns by which states move to constraints.
    #[serde(default)]
    pub corrections: Vec<Correction>,
    /// Names of states that should stay states.
    pub preferred: Vec<String>,
    /// Constraints that could stop to determine what follows from them.
    pub guards: Vec<Guard>,
    /// Expressions that were differentiated and may jump.
    #[serde(default)]
    pub unsteady: Vec<Unsteady>,
}

impl Reduction {
    /// Returns `true` if the index was reduced.
    #[must_use]
    pub fn has_reduced(&self) -> bool {
        !(self.differentiated.is_empty() && self.demoted.is_empty() && self.projected.is_empty())
    }

    /// Returns `true` if there is anything in the record.
    pub(crate) fn is_recorded(&self) -> bool {
        self.has_reduced() || !self.guards.is_empty() || !self.unsteady.is_empty()
    }
}

/// An equation of which time derivatives were added.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Differentiated {
    /// The equation.
    pub span: Span,
    /// File and line of the equation.
    pub place: String,
    /// Text of the equation.
    pub text: String,
    /// Order of its highest derivative.
    pub times: u32,
}

/// Constraints that could stop to determine what follows from them; the episode ends there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Guard {
    /// Number of its failure.
    pub failure: u32,
    /// Names of the variables that follow.
    pub names: Vec<String>,
    /// The equations.
    pub spans: Vec<Span>,
}

/// An expression that was differentiated and may jump; the episode ends there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Unsteady {
    /// Number of its failure.
    pub failure: u32,
    /// The expression, or its equation.
    pub span: Span,
    /// The element that moves the switch, or time.
    pub of: String,
}

/// A constraint that states are projected to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Projected {
    /// The equation.
    pub span: Span,
    /// It is the time derivative of this order of the equation.
    pub order: u32,
    /// Names of the states.
    pub states: Vec<String>,
    /// Number of the first invariant that is the distance from it, one for each pass of its loops.
    pub invariant: u32,
    /// Number of these.
    pub count: u32,
    /// The text of the model sets some of the states at the end of a step too.
    pub set: bool,
    /// States move to it by unknown corrections.
    #[serde(default)]
    pub corrected: bool,
}

/// A state with the unknown by which it moves to its constraints, element by element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Correction {
    /// The state.
    pub state: VarId,
    /// The correction.
    pub by: VarId,
}

/// A declared state of which elements follow from equations.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Demoted {
    /// Its name.
    pub name: String,
    /// Names of these elements.
    pub elements: Vec<String>,
    /// All elements of the state follow.
    pub whole: bool,
}

/// The quantities of a model by their kind, each kind in declaration order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quantities {
    /// Differential states.
    pub states: Vec<Quantity>,
    /// Positions in `y` of the state elements in declaration order; `None` where it is the
    /// identity.
    pub state_order: Option<Vec<u32>>,
    /// Algebraic outputs: declared algebraic variables and `let`s with a unit, then the members of
    /// ports.
    pub algebraics: Vec<Quantity>,
    /// Solved algebraic unknowns (the part of `y` after the states).
    pub solved: Vec<Quantity>,
    /// Treatment of the algebraic variables.
    pub algebraic_counts: AlgebraicCounts,
    /// Discrete variables.
    pub discretes: Vec<Quantity>,
    /// Actions.
    pub actions: Vec<Quantity>,
    /// Disturbances.
    pub disturbances: Vec<Quantity>,
    /// Parameters.
    pub parameters: Vec<Quantity>,
}

impl Quantities {
    /// Appends a state, to the declaration order as well.
    pub fn push_state(&mut self, state: Quantity) {
        let first: usize = self.states.iter().map(Quantity::len).sum();
        if let Some(order) = &mut self.state_order {
            order.extend((first as u32..).take(state.len()));
        }
        self.states.push(state);
    }

    /// The families of quantities with their names.
    #[must_use]
    pub fn families(&self) -> [(&'static str, &[Quantity]); 7] {
        [
            ("states", &self.states),
            ("solved", &self.solved),
            ("outputs", &self.algebraics),
            ("discretes", &self.discretes),
            ("actions", &self.actions),
            ("disturbances", &self.disturbances),
            ("parameters", &self.parameters),
        ]
    }
}

/// Numbers of elements of algebraic variables.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AlgebraicCounts {
    /// Declared: those of [`Quantities::algebraics`].
    pub declared: u32,
    /// Solved for.
    pub solved: u32,
    /// Of the declared ones, substituted.
    pub substituted: u32,
}

/// A port of a component: what can be connected.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Port {
    /// Name with its path, `R1.inlet`.
    pub name: String,
    /// Name of its connector.
    pub connector: String,
    /// Members of the connector.
    pub members: Vec<PortMember>,
}

/// A member of a port.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PortMember {
    /// Its name in the connector.
    pub name: String,
    /// Name of the output that is its value, among [`Quantities::algebraics`].
    pub output: String,
    /// Name of the state, action, disturbance, parameter or discrete variable that it always is,
    /// number by number; `None` where it is computed.
    #[serde(deserialize_with = "number::present")]
    pub equals: Option<String>,
    /// It flows into the component, and sums to zero over connected ports.
    #[serde(default)]
    pub flow: bool,
}

/// End of a step, in the order of the output of [`super::Programs::finish`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Finish {
    /// Failures that the model declares.
    pub failures: Vec<Failure>,
    /// Names of the success conditions.
    pub successes: Vec<String>,
    /// Names of the constraints that end nothing.
    pub constraints: Vec<String>,
    /// Rewards.
    pub rewards: Vec<Reward>,
    /// Index of the default reward.
    pub default_reward: u32,
    /// Observations of the chosen level.
    pub observations: Vec<Observed>,
}

impl Finish {
    /// Place of each part in the output of the program.
    #[must_use]
    pub fn layout(&self) -> FinishLayout {
        let mut end = 0;
        let mut behind = |count: usize| {
            let start = end;
            end += count;
            start..end
        };
        FinishLayout {
            failures: behind(2 * self.failures.len()),
            successes: behind(self.successes.len()),
            constraints: behind(self.constraints.len()),
            rewards: behind(self.rewards.len()),
            observations: behind(self.observations.len()),
        }
    }
}

/// Layout of the output of [`super::Programs::finish`]: the parts one after another.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FinishLayout {
    /// For each failure two numbers: 1 if it holds, NaN if that is unknown, and the violation
    /// (largest excess over the range, 0 when kept).
    pub failures: Range<usize>,
    /// For each success condition one number, 1 if it holds, NaN if that is unknown.
    pub successes: Range<usize>,
    /// For each constraint one number, the violation, NaN if it is unknown.
    pub constraints: Range<usize>,
    /// One number a reward, before the error reward of failures.
    pub rewards: Range<usize>,
    /// One number an observation, physical units, unclipped.
    pub observations: Range<usize>,
}

impl FinishLayout {
    /// Number of numbers.
    #[must_use]
    pub fn total(&self) -> usize {
        self.observations.end
    }
}

/// A quantity that the equations keep, or whose rate is known.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Invariant {
    /// Name.
    pub name: String,
    /// Describing text.
    pub text: String,
}

/// The steady problem.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Steady {
    /// State elements (positions in `y`) whose values the problem fixes; the program `steady` gives
    /// them.
    pub fixed: Vec<u32>,
    /// Number of conditions on the steady state, `A + B = 1`; the program `steady` gives their
    /// differences, left less right, last.
    pub conditions: u32,
    /// The steady state is given in full, nothing is solved.
    pub given: bool,
    /// Actions that are found with the state, by position: as many as states and conditions.
    pub free: Vec<u32>,
}

/// Conditions at the start, `initial eq p = 2 [bar] for z`: as many states as there are conditions
/// become unknowns of the start.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StartCondition {
    /// Source of the statement.
    pub span: Span,
    /// Number of conditions: elements of its loops.
    pub count: u32,
    /// Elements of states that become unknowns first, by name: those of `free`, or those whose rate
    /// is given.
    pub free: Vec<String>,
    /// No other state may become an unknown.
    pub only: bool,
}

/// Choices of a model, and the chosen options.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Alternatives {
    /// Names of the observation levels (`default` first, `full` last).
    pub levels: Vec<String>,
    /// Variants.
    pub variants: Vec<Variant>,
    /// Choices.
    pub choices: Vec<Choice>,
}

/// A switch.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Variant {
    /// Name.
    pub name: String,
    /// True if it is on.
    pub on: bool,
}

/// A choice between options.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Choice {
    /// Name.
    pub name: String,
    /// Names of the options.
    pub options: Vec<String>,
    /// Index of the chosen one.
    pub at: u32,
}

impl Choice {
    /// The chosen option.
    #[must_use]
    pub fn chosen(&self) -> Option<&str> {
        self.options.get(self.at as usize).map(String::as_str)
    }
}

impl Alternatives {
    /// Returns `true` if a choice has an option, or a variant is on (`true`) or off (`false`).
    #[must_use]
    pub fn has_chosen(&self, name: &str, option: &str) -> bool {
        match self.choices.iter().find(|choice| choice.name == name).and_then(Choice::chosen) {
            Some(chosen) => chosen == option,
            None => self.variants.iter().any(|variant| variant.name == name && option.parse() == Ok(variant.on)),
        }
    }

    /// Returns `true` if a variant or a choice has the name.
    #[must_use]
    pub fn names(&self, name: &str) -> bool {
        self.choices.iter().any(|choice| choice.name == name) || self.variants.iter().any(|variant| variant.name == name)
    }
}

/// One random number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Draw {
    /// Name of its stream: what it is drawn for; the same name and element give the same number in
    /// every run.
    pub stream: String,
    /// Standard variate.
    pub kind: Variate,
    /// When it is drawn.
    #[serde(rename = "at")]
    pub instant: Instant,
}

/// Kinds of standard variate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Variate {
    /// Uniform on (0, 1); mean 1/2.
    Uniform,
    /// Standard normal; mean 0.
    Normal,
}

/// When a random number is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Instant {
    /// At reset.
    Reset,
    /// At every step.
    Step,
}

/// One observed number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Observed {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Lower bound of its box.
    #[serde(with = "number::any")]
    pub low: f64,
    /// Upper bound.
    #[serde(with = "number::any")]
    pub high: f64,
    /// Sampled every so many steps and held (1: every step).
    pub every: u32,
    /// Reported so many steps late.
    pub delay: u32,
    /// Standard deviation of the Gaussian noise (0: none).
    #[serde(with = "number::any")]
    pub noise: f64,
}

impl Observed {
    /// Its name, unit and bounds.
    #[must_use]
    pub(crate) fn item(&self) -> BoxItem {
        BoxItem { name: self.name.clone(), unit: self.unit.clone(), low: self.low, high: self.high }
    }
}

/// One reward.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reward {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Describing text.
    pub text: String,
}

/// One failure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Failure {
    /// Identifier that starts the message.
    pub name: String,
    /// Describing text.
    pub text: String,
    /// It is found by a root function inside the step.
    pub event: bool,
    /// Content of the box, for messages; empty for other conditions.
    #[serde(rename = "box")]
    pub items: Vec<BoxItem>,
    /// Depends on the reward.
    pub on_reward: bool,
}

/// One member of a box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxItem {
    /// Flattened name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Bounds.
    #[serde(with = "number::any")]
    pub low: f64,
    /// Bounds.
    #[serde(with = "number::any")]
    pub high: f64,
}

/// The independent variable.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Time {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
}
