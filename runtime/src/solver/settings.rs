//! Settings.

use super::SolveError;

pub use smpl_compiler::model::{LinearSolver, Method};

/// Settings of an integrator. Begin with [`Settings::new`] and change fields.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Relative tolerance of the local error.
    pub rtol: f64,
    /// Absolute tolerance of the local error of each unknown, in its unit, positive.
    pub atol: Vec<f64>,
    /// Tolerances of the one-step methods, as a multiple of those here. Default 1.
    pub one_step_factor: f64,
    /// Maximum order of the BDF, 1 to 5. Default 5.
    pub max_order: u32,
    /// First step after a restart. Default [`FirstStep::Estimated`].
    pub first_step: FirstStep,
    /// Most steps within one advance. Default 10 000.
    pub max_steps: u32,
    /// Smallest step. Default 0, which leaves the roundoff of time as the bound.
    pub min_step: f64,
    /// Largest step. Default infinite.
    pub max_step: f64,
    /// True if the error of algebraic unknowns is part of the error test. Default false: they are
    /// solved for at every step, and as right as the differential ones that they follow from.
    pub algebraic_error_control: bool,
    /// True if an integral or an event looks at algebraic unknowns within steps. They are part of
    /// the error test of multistep methods then; one-step methods bring them to their equations at
    /// the end of each step.
    pub algebraic_are_watched: bool,
    /// Integration method. Default [`Method::Ida`].
    pub method: Method,
    /// Linear solver. Default [`LinearSolver::Auto`].
    pub linear_solver: LinearSolver,
    /// Tolerances of the quadratures. Default [`Quadratures::Unchecked`].
    pub quadratures: Quadratures,
    /// Tolerances of derivatives along [`directions`](super::System::directions), as a multiple of
    /// those of the unknowns. Default 1.
    pub looseness: f64,
}

/// Choice of the first step after a restart. It never exceeds the interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FirstStep {
    /// From y'' by the exact Jacobian: the step whose estimated local error at order one is
    /// `safety` of the tolerance, shortened where the rates change inside of it. Depends on nothing
    /// but the present state. Systems that are not explicit in their derivatives use IDA's rule.
    Estimated {
        /// Fraction of the tolerance. Default 0.25.
        safety: f64,
    },
    /// `factor` times the last step before the restart; IDA's rule where there was none.
    Scaled {
        /// Usually 0.03 to 0.1.
        factor: f64,
    },
    /// This step, in units of time.
    Fixed(f64),
    /// IDA's rule: a thousandth of the interval, or less where that would change y by half its
    /// tolerance.
    Ida,
}

impl Default for FirstStep {
    fn default() -> Self {
        Self::Estimated { safety: 0.25 }
    }
}

/// True if the error of quadratures is controlled.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Quadratures {
    /// Integrated with the steps that the unknowns need: no better than these allow (a solution
    /// that is a straight line is stepped over at once).
    #[default]
    Unchecked,
    /// Part of the error test.
    Checked {
        /// Relative tolerance.
        rtol: f64,
        /// Absolute tolerance of every quadrature, positive; to it comes `rtol` of what the
        /// integrand at the beginning would amount to.
        atol: f64,
    },
}

impl Settings {
    /// Returns `true` if algebraic unknowns are part of a multistep method's error test.
    pub(crate) fn tests_algebraic(&self) -> bool {
        self.algebraic_error_control || self.algebraic_are_watched
    }

    /// The defaults with these tolerances (`atol` has one entry an unknown).
    pub fn new(rtol: f64, atol: Vec<f64>) -> Self {
        Self {
            rtol,
            atol,
            one_step_factor: 1.0,
            max_order: 5,
            first_step: FirstStep::default(),
            max_steps: 10_000,
            min_step: 0.0,
            max_step: f64::INFINITY,
            algebraic_error_control: false,
            algebraic_are_watched: false,
            method: Method::default(),
            linear_solver: LinearSolver::default(),
            quadratures: Quadratures::default(),
            looseness: 1.0,
        }
    }

    /// The settings with the tolerances of the one-step methods. Those of derivatives stay where
    /// they are not the smaller ones.
    pub(crate) fn of_one_step_methods(mut self) -> Self {
        let factor = std::mem::replace(&mut self.one_step_factor, 1.0);
        self.rtol *= factor;
        self.atol.iter_mut().for_each(|atol| *atol *= factor);
        if let Quadratures::Checked { rtol, atol } = &mut self.quadratures {
            *rtol *= factor;
            *atol *= factor;
        }
        self.looseness = (self.looseness / factor).max(1.0);
        self
    }

    /// Checks the settings for a system of this dimension.
    pub(crate) fn validate(&self, dimension: usize) -> Result<(), SolveError> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let not_negative = |x: f64| x.is_finite() && x >= 0.0;
        let first_step = match self.first_step {
            FirstStep::Estimated { safety: x } | FirstStep::Scaled { factor: x } => positive(x),
            FirstStep::Fixed(step) => positive(step),
            FirstStep::Ida => true,
        };
        let quadratures = match self.quadratures {
            Quadratures::Unchecked => true,
            Quadratures::Checked { rtol, atol } => not_negative(rtol) && positive(atol),
        };
        let checks = [
            (not_negative(self.rtol), "rtol must be finite and not negative"),
            (self.atol.len() == dimension, "atol must have one entry an unknown"),
            (self.atol.iter().all(|&x| positive(x)), "atol must be finite and positive"),
            ((1..=5).contains(&self.max_order), "max_order must be 1 to 5"),
            (first_step, "first_step must be finite and positive"),
            (self.max_steps > 0, "max_steps must be positive"),
            (not_negative(self.min_step), "min_step must be finite and not negative"),
            (self.max_step > self.min_step, "max_step must exceed min_step"),
            (quadratures, "tolerances of the quadratures must be finite and positive"),
            (positive(self.one_step_factor), "one_step_factor must be finite and positive"),
            (positive(self.looseness), "looseness must be finite and positive"),
        ];
        match checks.into_iter().find(|(holds, _)| !holds) {
            Some((_, message)) => Err(SolveError::Settings { message }),
            None => Ok(()),
        }
    }
}
