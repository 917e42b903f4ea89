//! What can be chosen of an environment.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroU32;

/// What can be chosen when an environment is made; all else stands in the model. (Flat, since each field is an option of the command and a keyword in
/// Python under the same name.)
#[derive(Clone, Debug, Default)]
pub struct EnvironmentOptions {
    /// The reward that `step` returns; the model's default if `None`.
    pub reward: Option<String>,
    /// The reward comes at the end of the episode, as the sum over it.
    pub sparse: bool,
    /// Time limit in steps in place of the model's.
    pub max_steps: Option<u32>,
    /// Parameters in their declared units; they override defaults and draws in every episode.
    pub parameters: BTreeMap<String, f64>,
    /// Initial values of states and discrete variables; they override those of the model in every episode.
    pub initial: BTreeMap<String, f64>,
    /// Standard deviation of the noise of observations.
    pub noise: BTreeMap<String, f64>,
    /// Recorded disturbances in place of drawn ones, one value a step; a single one holds throughout.
    pub disturbances: BTreeMap<String, Vec<f64>>,
    /// Those of them whose last value holds from there on.
    pub held: BTreeSet<String>,
    /// Relative tolerance.
    pub rtol: Option<f64>,
    /// Absolute tolerance of an unknown over rtol times its scale.
    pub atol_factor: Option<f64>,
    /// Highest order of the integration.
    pub max_order: Option<u32>,
    /// Most internal steps within a step.
    pub solver_steps: Option<u32>,
    /// Most instants of events within a step.
    pub max_events: Option<NonZeroU32>,
    /// Longest internal step, in the model's unit of time.
    pub max_step: Option<f64>,
    /// Whether algebraic variables enter the error test.
    pub algebraic_error_control: Option<bool>,
    /// Whether the integrals of rewards enter the error test.
    pub quadrature_error_control: Option<bool>,
    /// `auto`, `dense` or `klu`.
    pub linear_solver: Option<String>,
    /// `ida`, `rosenbrock`, `explicit` or `auto`.
    pub method: Option<String>,
}
