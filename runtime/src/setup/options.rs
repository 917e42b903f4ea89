//! Options of an environment.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroU32;

use serde::Deserialize;
use smpl_compiler::elaborate::{refused_by_solver, solver_setting};
use smpl_compiler::model::{LinearSolver, Method, Solver};

/// Options of a new environment; everything else is in the model.
#[derive(Clone, Debug, Default)]
pub struct EnvironmentOptions {
    /// The reward that `step` returns; the model's default if `None`.
    pub reward: Option<String>,
    /// The reward comes at the end of the episode, as the sum over it.
    pub sparse: bool,
    /// Time limit in steps instead of the model's.
    pub max_steps: Option<u32>,
    /// Parameters in their declared units; they override defaults and draws in every episode.
    pub parameters: BTreeMap<String, f64>,
    /// Initial values of states and discrete variables; they override those of the model in every
    /// episode.
    pub initial: BTreeMap<String, f64>,
    /// States that start as the scenario gives, whatever conditions at the start there are.
    pub given_starts: BTreeSet<String>,
    /// Standard deviation of the noise of observations.
    pub noise: BTreeMap<String, f64>,
    /// Recorded disturbances instead of drawn ones, one value per step; a single one holds
    /// throughout.
    pub disturbances: BTreeMap<String, Vec<f64>>,
    /// Those of them whose last value holds from there on.
    pub held: BTreeSet<String>,
    /// Settings of the solver instead of the model's.
    pub solver: SolverOverrides,
}

/// Settings that replace those of a model: the struct, its application and its lists from one list.
macro_rules! overrides {
    ($($(#[$about:meta])* $name:ident: $type:ty;)*) => {
        /// Settings of the solver that replace those of the model, as in the block `solver` of
        /// scenarios.
        #[derive(Clone, Debug, Default, PartialEq, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct SolverOverrides {
            $($(#[$about])* pub $name: Option<$type>,)*
        }

        impl SolverOverrides {
            /// The settings of a model, replaced by these.
            pub(crate) fn over(&self, declared: &Solver) -> Solver {
                let mut out = declared.clone();
                // An `rtol` given here holds for every method.
                out.one_step_rtol = out.one_step_rtol.filter(|_| self.rtol.is_none());
                $(if let Some(value) = self.$name {
                    out.$name = value.into();
                })*
                out
            }

            /// Given values, by the names of settings.
            pub(crate) fn names(&self) -> impl Iterator<Item = &'static str> {
                let given = [$((stringify!($name), self.$name.is_some())),*];
                given.into_iter().filter(|(_, given)| *given).map(|(name, _)| solver_setting(name))
            }

            /// The first entry that the solver cannot take: its name, what it must be, and its
            /// value.
            pub(crate) fn bad_value(&self) -> Option<(&'static str, &'static str, String)> {
                let given = [$((stringify!($name), self.$name.and_then(AsNumber::number))),*];
                given.into_iter().find_map(|(name, x)| {
                    // An infinite `max_step` bounds nothing.
                    let x = x.filter(|x| name != "max_step" || *x != f64::INFINITY)?;
                    Some((name, refused_by_solver(name, x)?, x.to_string()))
                })
            }
        }
    };
}

/// Numbers among the values of settings.
trait AsNumber {
    /// The number; `None` for what has all of its values accepted.
    fn number(self) -> Option<f64>;
}

macro_rules! as_number {
    ($($type:ty: $value:ident => $number:expr;)*) => {$(
        impl AsNumber for $type {
            fn number(self) -> Option<f64> {
                let $value = self;
                $number
            }
        }
    )*};
}

as_number! {
    f64: x => Some(x);
    u32: n => Some(f64::from(n));
    NonZeroU32: n => Some(f64::from(n.get()));
    bool: _any => None;
    LinearSolver: _any => None;
    Method: _any => None;
}

overrides! {
    /// Relative tolerance.
    rtol: f64;
    /// Relative tolerance of the one-step methods.
    one_step_rtol: f64;
    /// Absolute tolerance over rtol times the scale.
    atol_factor: f64;
    /// Highest order.
    max_order: u32;
    /// Most internal steps within a step.
    max_steps: u32;
    /// Most instants of events within a step.
    max_events: NonZeroU32;
    /// Longest internal step, in the model's unit of time.
    max_step: f64;
    /// True if a control step that the method fails in is repeated with the other implicit method.
    retry: bool;
    /// True if algebraic variables enter the error test.
    algebraic_error_control: bool;
    /// True if the integrals of rewards enter the error test.
    quadrature_error_control: bool;
    /// Linear solver of Newton's method.
    linear_solver: LinearSolver;
    /// Integration method.
    method: Method;
}
