//! The flat model: what elaboration and structure analysis produce and the back end compiles.
//!
//! Values are in the units that the model declares; every conversion is a constant factor inside an
//! expression. The *unknowns* are the states and those algebraic variables that are solved for,
//! arrays laid out one after another (internal order); each has exactly one [`Row`]. What a user
//! sees has the order of [`Quantities::states`], node after node.

use serde::{Deserialize, Serialize};
use smpl_dsl::span::Span;

use crate::ir::{Affine, BinaryFn, Expr, ExprId, Exprs, Flavour, MAX_DEPTH, Program, Role, VarId};
use cranelift_entity::PrimaryMap;

mod interface;
pub(crate) mod number;
mod quantity;
mod settings;
mod test;

pub use interface::{
    AlgebraicCounts, Alternatives, BoxItem, Choice, Correction, Demoted, Differentiated, Draw, Failure, Finish, FinishLayout, Guard,
    Instant, Interface, Invariant, Observed, Port, PortMember, Projected, Quantities, Reduction, Reward, StartCondition, Steady, Time,
    Unsteady, Variant, Variate,
};
pub use quantity::{Axis, Grid, OutsideBounds, Quantity};
pub use settings::{Episode, LinearSolver, Method, Solver};
pub use test::{Expectation, Test, TestStep};

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
    /// Integrands of the quadratures over a step, in the order of the variable of role
    /// `Quadrature`.
    pub quadratures: Vec<ExprId>,
    /// Their units, for tables; none in a model that was read from JSON.
    pub quadrature_units: Vec<String>,
    /// Delayed expressions, in the order of the elements of the variable of role `Delayed`.
    pub delays: Vec<Delay>,
    /// Updates at the instants of an episode.
    pub programs: Programs,
    /// Names, units, bounds, settings: all that is seen from outside.
    pub interface: Interface,
}

impl Model {
    /// Returns `true` if what a program stores is a function of the step, the time and the
    /// parameters alone, independent of states and actions.
    #[must_use]
    pub fn is_of_the_step_alone(&self, program: &Program) -> bool {
        let values = program.nests.iter().flat_map(|nest| nest.stores.iter().map(|store| store.value));
        self.exprs.below(values).all(|e| match self.exprs.node(e) {
            Expr::Load { var, .. } => match self.vars[var].role {
                Role::Param | Role::ParamGiven | Role::Builtin => true,
                Role::State | Role::Algebraic | Role::Action | Role::Discrete | Role::Disturbance => false,
                Role::Draw | Role::Quadrature | Role::Delayed | Role::Cache | Role::Scratch => false,
            },
            _ => true,
        })
    }

    /// Number of delayed elements.
    #[must_use]
    pub fn delayed(&self) -> usize {
        self.delays.iter().map(|delay| delay.count as usize).sum()
    }

    /// Returns `true` if what is delayed reads delayed values, algebraic unknowns or rates: then it
    /// jumps where these do.
    #[must_use]
    pub fn delays_follow(&self) -> bool {
        let values = self.programs.delayed.nests.iter().flat_map(|nest| &nest.stores).map(|store| store.value);
        self.exprs.below(values).any(|e| match self.exprs.node(e) {
            Expr::Load { var, flavour, .. } => {
                flavour == Flavour::Derivative || matches!(self.vars[var].role, Role::Delayed | Role::Algebraic)
            }
            _ => false,
        })
    }

    /// True if a node is a delayed value, `v + s*((t - theta) - a)`.
    #[must_use]
    pub(crate) fn is_delayed(&self, e: ExprId) -> bool {
        let Expr::Binary(BinaryFn::Add, a, b) = self.exprs.node(e) else { return false };
        let earlier = |e| matches!(self.exprs.node(e), Expr::Load { var, .. } if self.vars[var].role == Role::Delayed);
        earlier(a) || earlier(b)
    }

    /// Delayed expression and dead time, with the extents of the surrounding loops.
    pub(crate) fn past(&self) -> Vec<(ExprId, [u32; MAX_DEPTH])> {
        let nests = self.programs.delayed.nests.iter().chain(&self.programs.lags.nests);
        let each = nests.flat_map(|nest| {
            let mut extents = [0; MAX_DEPTH];
            nest.loops.iter().for_each(|&(depth, extent)| extents[usize::from(depth)] = extent);
            nest.stores.iter().map(move |store| (store.value, extents))
        });
        each.collect()
    }

    /// The variable of the numbers that every model has, where there is one.
    pub(crate) fn builtins(&self) -> Option<VarId> {
        self.vars.iter().find(|(_, variable)| variable.role == Role::Builtin).map(|(id, _)| id)
    }
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
    /// Kind.
    pub role: Role,
    /// Number of elements.
    pub len: u32,
    /// Place of the declaration.
    pub span: Span,
}

/// Residual rows of a nest: for all counters, `0 = residual`, belonging to the unknown element
/// `var[at]`.
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
    /// Update.
    pub action: RootAction,
}

/// A delayed expression over a nest of loops.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Delay {
    /// Text of the call, for messages.
    pub name: String,
    /// Number of elements.
    pub count: u32,
    /// Declared bounds of a dead time that changes within an episode; infinite for one that does
    /// not, and for residence times.
    pub bounds: (f64, f64),
    /// When the dead time changes.
    pub lag: Lag,
    /// Has a value before the start; without one that is the value at the start.
    pub before: bool,
    /// Place of the call.
    pub span: Span,
}

/// When a dead time changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Lag {
    /// Not within an episode.
    #[serde(rename = "never")]
    Constant,
    /// At sampling instants and events.
    #[serde(rename = "step")]
    Held,
    /// At any time.
    #[serde(rename = "always")]
    Varying,
}

/// Effect of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RootAction {
    /// Ends the episode with the failure of that index in [`Finish::failures`].
    Fail(u32),
    /// Runs the event program of that index in place, then integration goes on.
    Run(u32),
    /// Only restarts the integration (a switch of an equation).
    Restart,
    /// Ends the episode with the success of that index in [`Finish::successes`].
    Succeed(u32),
}

/// Programs of the episode. In-place programs read and write `y` and the discrete variables.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Programs {
    /// Computed and drawn parameters (in place; honours `ParamGiven`).
    pub parameters: Program,
    /// Initial values of states (in place, into `y`).
    pub initial_states: Program,
    /// Initial values of discrete variables and disturbances (in place), after the states are
    /// known.
    pub initial_discretes: Program,
    /// The steady problem: out = one value an action element, then one a state of
    /// [`Steady::fixed`].
    pub steady: Program,
    /// Conditions at the start: out = left less right side of each.
    pub start_conditions: Program,
    /// Next values of the disturbances (in place).
    pub disturb: Program,
    /// `at start`: updates and resets (in place).
    pub start: Program,
    /// `at end`: updates and clamps (in place).
    pub end: Program,
    /// Failures, successes, constraints, rewards, observations: see [`Finish`].
    pub finish: Program,
    /// Algebraic outputs, in the order of [`Quantities::algebraics`] (all elements).
    pub outputs: Program,
    /// Event programs (in place).
    pub events: Vec<Program>,
    /// Named open-loop policies: out = one value an action (action elements in order).
    pub policies: Vec<(String, Program)>,
    /// Invariants: out = value, then rate, for each.
    pub invariants: Program,
    /// Items of each failure that is a box: out = the value of each item, all failures one after
    /// another.
    pub boxes: Program,
    /// Delayed expressions: out = the present value of each element.
    pub delayed: Program,
    /// Dead times: out = that of each element.
    pub lags: Program,
    /// Values before the start: out = that of each element, where one is given.
    pub before: Program,
}

/// The programs with their names, by shared or by unique references; every field is listed.
macro_rules! named_programs {
    ($programs:expr, $iter:ident, $($field:ident)*) => {{
        let Programs { $($field,)* events, policies } = $programs;
        let events = events.$iter().enumerate().map(|(i, program)| (format!("event {i}"), program));
        let policies = policies.$iter().map(|(name, program)| (format!("policy {name}"), program));
        [$((stringify!($field).to_owned(), $field)),*].into_iter().chain(events).chain(policies)
    }};
    ($programs:expr, $iter:ident) => {
        named_programs!(
            $programs, $iter,
            parameters initial_states initial_discretes steady start_conditions disturb start end finish outputs invariants boxes
            delayed lags before
        )
    };
}

impl Programs {
    /// Programs that texts leave out where they do nothing.
    pub(crate) const OPTIONAL: [&str; 4] = ["start_conditions", "delayed", "lags", "before"];

    /// All of them with their names: `event 0`, `policy nominal`, the others as the fields are
    /// called.
    pub(crate) fn named(&self) -> impl Iterator<Item = (String, &Program)> {
        named_programs!(self, iter)
    }

    /// All of them, to be changed.
    pub(crate) fn named_mut(&mut self) -> impl Iterator<Item = (String, &mut Program)> {
        named_programs!(self, iter_mut)
    }
}
