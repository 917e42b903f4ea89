//! Options of an environment.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroU32;

use serde::Deserialize;
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

/// Settings of the solver that are not as the model has them: the block `solver` of a scenario.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolverOverrides {
    /// Relative tolerance.
    pub rtol: Option<f64>,
    /// Relative tolerance of the one-step methods.
    pub one_step_rtol: Option<f64>,
    /// Absolute tolerance over rtol times the scale.
    pub atol_factor: Option<f64>,
    /// Highest order.
    pub max_order: Option<u32>,
    /// Most internal steps within a step.
    pub max_steps: Option<u32>,
    /// Most instants of events within a step.
    pub max_events: Option<NonZeroU32>,
    /// Longest internal step, in the model's unit of time.
    pub max_step: Option<f64>,
    /// True if a control step that the method fails in is repeated with the other implicit method.
    pub retry: Option<bool>,
    /// True if algebraic variables enter the error test.
    pub algebraic_error_control: Option<bool>,
    /// True if the integrals of rewards enter the error test.
    pub quadrature_error_control: Option<bool>,
    /// Linear solver of Newton's method.
    pub linear_solver: Option<LinearSolver>,
    /// Integration method.
    pub method: Option<Method>,
}

impl SolverOverrides {
    /// The settings of a model, replaced by these.
    pub(crate) fn over(&self, declared: &Solver) -> Solver {
        Solver {
            rtol: self.rtol.unwrap_or(declared.rtol),
            // An `rtol` given here holds for every method.
            one_step_rtol: self.one_step_rtol.or(declared.one_step_rtol.filter(|_| self.rtol.is_none())),
            atol_factor: self.atol_factor.unwrap_or(declared.atol_factor),
            safety: declared.safety,
            max_order: self.max_order.unwrap_or(declared.max_order),
            max_steps: self.max_steps.unwrap_or(declared.max_steps),
            max_events: self.max_events.map_or(declared.max_events, NonZeroU32::get),
            max_step: self.max_step.unwrap_or(declared.max_step),
            pade: declared.pade,
            retry: self.retry.unwrap_or(declared.retry),
            algebraic_error_control: self.algebraic_error_control.unwrap_or(declared.algebraic_error_control),
            quadrature_error_control: self.quadrature_error_control.unwrap_or(declared.quadrature_error_control),
            linear_solver: self.linear_solver.unwrap_or(declared.linear_solver),
            method: self.method.unwrap_or(declared.method),
        }
    }

    /// Given values, by the names of settings.
    pub(crate) fn names(&self) -> impl Iterator<Item = &'static str> {
        let given = [
            ("rtol", self.rtol.is_some()),
            ("one_step_rtol", self.one_step_rtol.is_some()),
            ("atol_factor", self.atol_factor.is_some()),
            ("max_order", self.max_order.is_some()),
            ("max_internal_steps", self.max_steps.is_some()),
            ("max_events", self.max_events.is_some()),
            ("max_step", self.max_step.is_some()),
            ("retry", self.retry.is_some()),
            ("algebraic_error_control", self.algebraic_error_control.is_some()),
            ("quadrature_error_control", self.quadrature_error_control.is_some()),
            ("linear_solver", self.linear_solver.is_some()),
            ("method", self.method.is_some()),
        ];
        given.into_iter().filter(|(_, given)| *given).map(|(name, _)| name)
    }

    /// The first entry that the solver cannot take: its name, what it must be, and what it is.
    pub(crate) fn bad_value(&self) -> Option<(&'static str, &'static str, String)> {
        let positive = |x: &f64| x.is_finite() && *x > 0.0;
        let number = |name, expected, given: Option<f64>, holds: &dyn Fn(&f64) -> bool| {
            given.filter(|x| !holds(x)).map(|x| (name, expected, x.to_string()))
        };
        let tolerance = |name, given| number(name, Solver::RTOL_TEXT, given, &|x| Solver::RTOL.contains(x));
        tolerance("rtol", self.rtol)
            .or_else(|| tolerance("one_step_rtol", self.one_step_rtol))
            .or_else(|| number("atol_factor", "a positive number", self.atol_factor, &positive))
            .or_else(|| number("max_order", "from 1 to 5", self.max_order.map(f64::from), &|x| (1.0..=5.0).contains(x)))
            .or_else(|| number("max_steps", "at least 1", self.max_steps.map(f64::from), &|x| *x >= 1.0))
            .or_else(|| number("max_step", "a positive number", self.max_step, &|x| *x > 0.0))
    }
}
