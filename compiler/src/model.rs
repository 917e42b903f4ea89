//! The flat model: what elaboration and structure analysis produce and the back end compiles.
//!
//! Values are in the units that the model declares; every conversion is a constant factor inside an expression. The *unknowns* are
//! the states and those algebraic variables that are solved for, arrays laid out one after another (internal order); each
//! has exactly one [`Row`]. What a user sees has the order of [`Interface::states`], node after node.

use serde::{Deserialize, Serialize};
use smpl_dsl::span::Span;

use crate::ir::{Affine, ExprId, Exprs, Program, Role, VarId};
use cranelift_entity::PrimaryMap;

/// A flat model with its expressions.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Model {
    /// All expressions.
    pub exprs: Exprs,
    /// All variables.
    #[serde(with = "vars_as_list")]
    pub vars: PrimaryMap<VarId, Variable>,
    /// Unknowns in internal order: states, then solved algebraic variables.
    pub unknowns: Vec<VarId>,
    /// One row for each unknown element.
    pub rows: Vec<Row>,
    /// Every row of a state is `f(t, y) - y'`, and no algebraic row mentions a derivative.
    pub explicit: bool,
    /// Functions whose zeros stop the integration.
    pub roots: Vec<Root>,
    /// Integrands of the quadratures over a step, in the order of the variable of role `Quadrature`.
    pub quadratures: Vec<ExprId>,
    /// What runs at the instants of an episode.
    pub programs: Programs,
    /// Position tables of `Place::OutSlots` stores.
    pub slots: Vec<Vec<u32>>,
    /// Names, units, bounds, settings: all that is seen from outside.
    pub interface: Interface,
}

/// Writes the map of variables as a list.
mod vars_as_list {
    use super::{PrimaryMap, VarId, Variable};
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(vars: &PrimaryMap<VarId, Variable>, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(vars.values())
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<PrimaryMap<VarId, Variable>, D::Error> {
        Ok(Vec::<Variable>::deserialize(deserializer)?.into_iter().collect())
    }
}

/// A variable of the flat model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Variable {
    /// Name with the path of its instance (`R1.c`), without indices.
    pub name: String,
    /// What it is.
    pub role: Role,
    /// Number of elements.
    pub len: u32,
    /// Where it was declared.
    pub span: Span,
}

/// Residual rows of a nest: for all counters, `0 = residual`, belonging to the unknown element `var[at]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Extents of the loops.
    pub extents: Vec<u32>,
    /// The unknown whose row this is.
    pub var: VarId,
    /// Its element.
    pub at: Affine,
    /// `f - y'` for an explicit rate, `left - right` otherwise.
    pub residual: ExprId,
    /// The equation.
    pub span: Span,
}

/// The condition of an event as a root function.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Root {
    /// Name of the event, failure or phase.
    pub name: String,
    /// Positive where the condition holds, negative where it does not.
    pub value: ExprId,
    /// The condition does not hold at the threshold itself (`<`, `>`).
    pub strict: bool,
    /// What happens.
    pub action: RootAction,
}

/// What an event does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RootAction {
    /// Ends the episode with the failure of that index in [`Interface::failures`].
    Fail(u32),
    /// Runs the event program of that index in place, then integration goes on.
    Run(u32),
    /// Only restarts the integration (a switch of an equation).
    Restart,
}

/// Programs of the episode. In-place programs read and write `y` and the discrete variables.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Programs {
    /// Computed and drawn parameters (in place; honours `ParamGiven`).
    pub parameters: Program,
    /// Initial values of states (in place, into `y`).
    pub initial_states: Program,
    /// Initial values of discrete variables and disturbances (in place), after the states are known.
    pub initial_discretes: Program,
    /// The steady problem: out = one value an action element, then one a state of [`Interface::steady_fixed`].
    pub steady: Program,
    /// Next values of the disturbances (in place).
    pub disturb: Program,
    /// `at start`: updates and resets (in place).
    pub start: Program,
    /// `at end`: updates and clamps (in place).
    pub end: Program,
    /// Failures, successes, constraints, rewards, observations: see [`Finish`].
    pub finish: Program,
    /// Algebraic outputs, in the order of [`Interface::algebraics`] (all elements).
    pub outputs: Program,
    /// Event programs (in place).
    pub events: Vec<Program>,
    /// Named open-loop policies: out = one value an action (action elements in order).
    pub policies: Vec<(String, Program)>,
    /// Invariants: out = value, then rate, for each.
    pub invariants: Program,
    /// Items of each failure that is a box: out = the value of each item, all failures one after another.
    pub boxes: Program,
}

/// Layout of the output of [`Programs::finish`]: the parts one after another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finish {
    /// For each failure two numbers: 1 if it holds, NaN if that is unknown, and the violation (largest excess over the range, 0 when kept).
    pub failures: u32,
    /// For each success condition one number, 1 if it holds, NaN if that is unknown.
    pub successes: u32,
    /// For each constraint one number, the violation, NaN if it is unknown.
    pub constraints: u32,
    /// One number a reward, before the error reward of failures.
    pub rewards: u32,
    /// One number an observation, physical units, unclipped.
    pub observations: u32,
}

/// All that is seen from outside.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Interface {
    /// Name of the model.
    pub name: String,
    /// Its describing text.
    pub text: String,
    /// Name and unit of time.
    pub time: (String, String),
    /// Differential states.
    pub states: Vec<Quantity>,
    /// Positions in `y` of the state elements in the order of the outside; `None` where it is the identity.
    pub state_order: Option<Vec<u32>>,
    /// Algebraic outputs: declared algebraic variables and `let`s with a unit.
    pub algebraics: Vec<Quantity>,
    /// Solved algebraic unknowns (the part of `y` after the states).
    pub solved: Vec<Quantity>,
    /// Elements of algebraic variables: declared (those of [`Interface::algebraics`]), solved for (members of ports too), and of the
    /// declared ones substituted.
    pub algebraic_counts: [u32; 3],
    /// Discrete variables.
    pub discretes: Vec<Quantity>,
    /// Domains in space.
    pub grids: Vec<Grid>,
    /// Names of the phases in their order, whose number (from 1) the discrete variable `phase` holds; empty without a schedule.
    pub phases: Vec<String>,
    /// Actions.
    pub actions: Vec<Quantity>,
    /// Disturbances.
    pub disturbances: Vec<Quantity>,
    /// Parameters.
    pub parameters: Vec<Quantity>,
    /// Random numbers: element i of the variable of role `Draw`.
    pub draws: Vec<Draw>,
    /// Observations of the chosen level.
    pub observations: Vec<Observed>,
    /// Names of the observation levels (`default` first, `full` last).
    pub levels: Vec<String>,
    /// Rewards.
    pub rewards: Vec<Reward>,
    /// Index of the default reward.
    pub default_reward: u32,
    /// Failures that the model declares.
    pub failures: Vec<Failure>,
    /// Names of the success conditions.
    pub successes: Vec<String>,
    /// Names of the constraints that end nothing.
    pub constraints: Vec<String>,
    /// Layout of the `finish` program.
    pub finish: Finish,
    /// Invariants: name and text.
    pub invariants: Vec<(String, String)>,
    /// State elements (positions in `y`) whose values the steady problem fixes; the program `steady` gives them.
    pub steady_fixed: Vec<u32>,
    /// Number of conditions on the steady state, `A + B = 1`; the program `steady` gives their differences, left less right, last.
    pub steady_conditions: u32,
    /// The steady state is given in full, nothing is solved.
    pub steady_given: bool,
    /// A `steady` block exists, or `steady()` is used.
    pub has_steady: bool,
    /// Episode settings.
    pub episode: Episode,
    /// Solver settings.
    pub solver: Solver,
    /// Names of variants (switches) with whether they are on.
    pub variants: Vec<(String, bool)>,
    /// Choices: name, options, index of the chosen one.
    pub choices: Vec<(String, Vec<String>, u32)>,
    /// Some `at start` program resets states.
    pub start_resets: bool,
}

/// A variable as seen from outside: scalar or array.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quantity {
    /// The variable; `None` for outputs that are no variable of their own.
    pub var: Option<VarId>,
    /// Name without indices, `R1.c`.
    pub name: String,
    /// Index sets, outermost first; empty for a scalar.
    pub axes: Vec<Axis>,
    /// Flattened-name pattern `n{}` in place of `n[..]`.
    pub pattern: Option<String>,
    /// Unit as declared; `1` when dimensionless.
    pub unit: String,
    /// Describing text.
    pub text: String,
    /// Lower bound of each element, or one for all; -inf where none.
    pub low: Vec<f64>,
    /// Upper bound likewise; +inf where none.
    pub high: Vec<f64>,
    /// Default, nominal or initial value likewise.
    pub default: Vec<f64>,
    /// Magnitude for absolute tolerances likewise: declared, else the range, else 1.
    pub scale: Vec<f64>,
    /// The unit is a point on a scale (degC).
    pub affine_unit: bool,
    /// Sizes or indices were computed from it (a parameter) when the model was compiled: it has that value.
    pub structural: bool,
}

/// One index of an array.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Axis {
    /// Members of a set.
    Names(Vec<String>),
    /// Integers from the first on.
    Numbers {
        /// The first number.
        first: i64,
        /// How many there are.
        count: u32,
    },
    /// Cells of a domain, numbered from 1.
    Cells {
        /// Which of [`Interface::grids`].
        grid: u32,
        /// How many there are.
        count: u32,
    },
}

/// Where the cells of a domain lie.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// Name of the domain.
    pub name: String,
    /// Unit of its coordinate.
    pub unit: String,
    /// Faces of the cells, one more than there are cells, for parameters as they were when the model was compiled; empty where that does not tell.
    pub faces: Vec<f64>,
    /// The elements of parameters that the faces depend on, with the values that they had.
    pub parameters: Vec<(VarId, u32, f64)>,
}

/// One random number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Draw {
    /// Name of its stream: what it is drawn for; the same name and element give the same number in every run.
    pub stream: String,
    /// Standard variate.
    pub kind: Variate,
    /// When it is drawn.
    pub instant: Instant,
}

/// Kinds of standard variate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Variate {
    /// Uniform on (0, 1); mean 1/2.
    Uniform,
    /// Standard normal; mean 0.
    Normal,
}

/// When a random number is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Instant {
    /// At reset.
    Reset,
    /// At every step.
    Step,
}

/// One observed number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Observed {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Lower bound of its box.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
    /// Sampled every so many steps and held (1: every step).
    pub every: u32,
    /// Reported so many steps late.
    pub delay: u32,
    /// Standard deviation of the Gaussian noise (0: none).
    pub noise: f64,
}

/// One reward.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
pub struct Failure {
    /// Identifier that starts the message.
    pub name: String,
    /// Describing text.
    pub text: String,
    /// It is found by a root function inside the step.
    pub event: bool,
    /// What the box holds, for messages; empty for other conditions.
    pub items: Vec<BoxItem>,
    /// Depends on the reward.
    pub on_reward: bool,
}

/// One member of a box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoxItem {
    /// Flattened name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Bounds.
    pub low: f64,
    /// Bounds.
    pub high: f64,
}

/// Settings of the episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Sampling interval.
    pub step: f64,
    /// Length integrated in each step; differs from `step` only in reproductions of old programs.
    pub integrate: f64,
    /// Time limit in steps.
    pub max_steps: u32,
    /// Reward of a failing step.
    pub error_reward: f64,
    /// The end at `max_steps` is a success (a batch of fixed length), not a truncation.
    pub end_is_success: bool,
    /// With sparse rewards a failure pays the error reward and nothing else; otherwise the sum over the episode, like any end.
    pub failure_pays_alone: bool,
    /// Actions, over their scale, are rounded to single precision before they are applied.
    pub single_precision: bool,
}

/// Settings of the solver.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Solver {
    /// Relative tolerance.
    pub rtol: f64,
    /// Absolute tolerance of an unknown = this · rtol · scale.
    pub atol_factor: f64,
    /// What the solver is given of the tolerances: below 1 where errors grow much beyond those of a step.
    pub safety: f64,
    /// Highest order.
    pub max_order: u32,
    /// Most internal steps between two output times.
    pub max_steps: u32,
    /// Most instants of events within a step.
    pub max_events: u32,
    /// Longest internal step, in units of time; infinite where nothing bounds it.
    pub max_step: f64,
    /// Algebraic variables enter the error test.
    pub algebraic_error_control: bool,
    /// Quadratures enter the error test.
    pub quadrature_error_control: bool,
    /// What solves the linear systems of Newton's method.
    pub linear_solver: LinearSolver,
    /// What takes the steps.
    pub method: Method,
}

/// What takes the steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// SUNDIALS' variable-order BDF code IDA: any system of index 1, of any size.
    #[default]
    Ida,
    /// The Rosenbrock method Rodas5P of order 5: systems that are explicit in their derivatives, stiff or not, with algebraic unknowns or without.
    Rosenbrock,
    /// The explicit Runge–Kutta method DOP853 of order 8: ordinary differential equations that are not stiff.
    Explicit,
    /// One of the two, by a test of stiffness at run time; IDA for systems that they do not take or that are large.
    Auto,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Ida, Self::Rosenbrock, Self::Explicit, Self::Auto];

    /// Their names, for messages.
    pub const TEXT: &str = "ida, rosenbrock, explicit or auto";

    /// As it is written in models, scenarios and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ida => "ida",
            Self::Rosenbrock => "rosenbrock",
            Self::Explicit => "explicit",
            Self::Auto => "auto",
        }
    }

    /// The one of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|method| method.name() == name)
    }
}

impl std::fmt::Display for Method {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Which linear solver the Newton iteration uses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LinearSolver {
    /// By dimension and density.
    #[default]
    Auto,
    /// LU with partial pivoting of the full matrix.
    Dense,
    /// LU with partial pivoting of the bands around the diagonal, unknowns renumbered so that they are narrow.
    Banded,
    /// Sparse LU of the diagonal blocks of the block triangular form, pivots on the diagonal; KLU where these do not serve.
    Block,
    /// SuiteSparse's KLU.
    Klu,
}

impl LinearSolver {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Auto, Self::Dense, Self::Banded, Self::Block, Self::Klu];

    /// Their names, for messages.
    pub const TEXT: &str = "auto, dense, banded, block or klu";

    /// As it is written in models and scenarios.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Dense => "dense",
            Self::Banded => "banded",
            Self::Block => "block",
            Self::Klu => "klu",
        }
    }

    /// The one of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|solver| solver.name() == name)
    }
}

impl Default for Episode {
    fn default() -> Self {
        Episode {
            step: 1.0,
            integrate: 1.0,
            max_steps: 100,
            error_reward: -1000.0,
            end_is_success: false,
            failure_pays_alone: false,
            single_precision: false,
        }
    }
}

impl Interface {
    /// Whether a choice has an option, or a variant is on (`true`) or off (`false`).
    #[must_use]
    pub fn has_chosen(&self, name: &str, option: &str) -> bool {
        let choice = self.choices.iter().find(|(choice, ..)| choice == name);
        match choice.and_then(|(_, options, at)| options.get(*at as usize)) {
            Some(chosen) => chosen == option,
            None => self.variants.iter().any(|(variant, on)| variant == name && option.parse() == Ok(*on)),
        }
    }
}

impl Solver {
    /// Relative tolerances that double precision can keep and that mean something.
    pub const RTOL: std::ops::Range<f64> = 1e-15..1.0;
    /// [`Self::RTOL`] in words.
    pub const RTOL_TEXT: &str = "between 1e-15 and 1";
}

impl Default for Solver {
    fn default() -> Self {
        Solver {
            rtol: 1e-8,
            atol_factor: 0.01,
            safety: 1.0,
            max_order: 5,
            max_steps: 20_000,
            max_events: 1000,
            max_step: f64::INFINITY,
            algebraic_error_control: false,
            quadrature_error_control: true,
            linear_solver: LinearSolver::default(),
            method: Method::default(),
        }
    }
}

impl Quantity {
    /// Number of elements.
    #[must_use]
    pub fn len(&self) -> usize {
        self.axes.iter().map(Axis::len).product()
    }

    /// Whether there is no element.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Flattened name of an element, `R1.c[tropine,3]`.
    #[must_use]
    pub fn element_name(&self, element: usize) -> String {
        let mut labels = Vec::with_capacity(self.axes.len());
        let mut rest = element;
        for axis in self.axes.iter().rev() {
            labels.push(axis.label(rest % axis.len().max(1)));
            rest /= axis.len().max(1);
        }
        labels.reverse();
        let joined = labels.join(",");
        match &self.pattern {
            Some(pattern) => pattern.replace("{}", &joined),
            None if labels.is_empty() => self.name.clone(),
            None => format!("{}[{joined}]", self.name),
        }
    }

    /// Whether a number is within bounds, but for rounding.
    #[must_use]
    pub fn admits(low: f64, high: f64, x: f64) -> bool {
        let size = |bound: f64| if bound.is_finite() { bound.abs() } else { 0.0 };
        let slack = 1e-12 * size(low).max(size(high));
        x >= low - slack && x <= high + slack
    }

    /// One of `low`, `high`, `default`, `scale` at an element.
    #[must_use]
    pub fn pick(values: &[f64], element: usize) -> f64 {
        match values {
            [] => f64::NAN,
            [one] => *one,
            many => many.get(element).copied().unwrap_or(f64::NAN),
        }
    }
}

impl Axis {
    /// Number of members.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Axis::Names(names) => names.len(),
            Axis::Numbers { count, .. } | Axis::Cells { count, .. } => *count as usize,
        }
    }

    /// Whether it has no member.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Label of a member.
    #[must_use]
    pub fn label(&self, i: usize) -> String {
        match self {
            Axis::Names(names) => names.get(i).cloned().unwrap_or_default(),
            Axis::Numbers { first, .. } => (first + i as i64).to_string(),
            Axis::Cells { .. } => (i + 1).to_string(),
        }
    }
}
