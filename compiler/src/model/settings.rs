//! Settings of the episode and of the solver.

use serde::{Deserialize, Serialize};

use super::number;

/// Settings of the episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Episode {
    /// Sampling interval.
    pub step: f64,
    /// Length integrated in each step; differs from `step` only in reproductions of old programs.
    pub integrate: f64,
    /// Time limit in steps.
    pub max_steps: u32,
    /// Period of a cyclic start, a multiple of `step`.
    pub cycle: Option<f64>,
    /// Reward of a failing step.
    pub error_reward: f64,
    /// The end at `max_steps` is a success (a batch of fixed length), not a truncation.
    pub end_is_success: bool,
    /// With sparse rewards a failure pays the error reward and nothing else; otherwise the sum over
    /// the episode, like any end.
    pub failure_pays_alone: bool,
    /// Actions, over their scale, are rounded to single precision before they are applied.
    pub single_precision: bool,
}

/// Settings of the solver.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Solver {
    /// Relative tolerance.
    pub rtol: f64,
    /// Relative tolerance of the one-step methods; `rtol` if `None`.
    pub one_step_rtol: Option<f64>,
    /// Absolute tolerance of an unknown = this · rtol · scale.
    pub atol_factor: f64,
    /// Factor on the tolerances for the solver: below 1 if errors grow much beyond those of a step.
    pub safety: f64,
    /// Highest order.
    pub max_order: u32,
    /// Most internal steps between two output times.
    pub max_steps: u32,
    /// Most instants of events within a step.
    pub max_events: u32,
    /// Longest internal step, in units of time; infinite where nothing bounds it.
    #[serde(with = "number::or_infinite")]
    pub max_step: f64,
    /// Order of Padé approximations that replace dead times; 0 where these are exact.
    #[serde(default)]
    pub pade: u32,
    /// A control step that the method fails in is repeated once with the other implicit method.
    #[serde(default = "retries")]
    pub retry: bool,
    /// Algebraic variables enter the error test, whether integrals and events look at them or not.
    pub algebraic_error_control: bool,
    /// Quadratures enter the error test.
    pub quadrature_error_control: bool,
    /// Linear solver of Newton's method.
    pub linear_solver: LinearSolver,
    /// Integration method.
    pub method: Method,
}

/// Texts written before `retry` existed leave it out.
fn retries() -> bool {
    true
}

/// Integration method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// SUNDIALS' variable-order BDF code IDA: any system of index 1, of any size.
    #[default]
    Ida,
    /// The Rosenbrock method Rodas5P of order 5: systems that are explicit in their derivatives,
    /// stiff or not, with algebraic unknowns or without.
    Rosenbrock,
    /// The explicit Runge–Kutta method DOP853 of order 8: ordinary differential equations that are
    /// not stiff.
    Explicit,
    /// One of the two, by a test of stiffness at run time; IDA for systems that they do not take or
    /// that are large.
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

/// Linear solver of the Newton iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LinearSolver {
    /// By dimension and density.
    #[default]
    Auto,
    /// LU with partial pivoting of the full matrix.
    Dense,
    /// Sparse LU of the diagonal blocks of the block triangular form, pivots on the diagonal; KLU
    /// where these do not serve.
    Block,
    /// SuiteSparse's KLU.
    Klu,
}

impl LinearSolver {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Auto, Self::Dense, Self::Block, Self::Klu];

    /// Their names, for messages.
    pub const TEXT: &str = "auto, dense, block or klu";

    /// As it is written in models and scenarios.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Dense => "dense",
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
            cycle: None,
            error_reward: -1000.0,
            end_is_success: false,
            failure_pays_alone: false,
            single_precision: false,
        }
    }
}

impl Solver {
    /// Relative tolerances that double precision can keep and that mean something.
    pub const RTOL: std::ops::Range<f64> = 1e-15..1.0;
    /// [`Self::RTOL`] in words.
    pub const RTOL_TEXT: &str = "between 1e-15 and 1";

    /// Tolerances of the one-step methods, as a multiple of those of `ida`.
    #[must_use]
    pub fn one_step_factor(&self) -> f64 {
        self.one_step_rtol.map_or(1.0, |rtol| rtol / self.rtol)
    }
}

impl Default for Solver {
    fn default() -> Self {
        Solver {
            rtol: 1e-8,
            one_step_rtol: None,
            atol_factor: 0.01,
            safety: 1.0,
            max_order: 5,
            max_steps: 20_000,
            max_events: 1000,
            max_step: f64::INFINITY,
            pade: 0,
            retry: true,
            algebraic_error_control: false,
            quadrature_error_control: true,
            linear_solver: LinearSolver::default(),
            method: Method::default(),
        }
    }
}
