//! Reason why an integration failed.

use std::fmt;

use thiserror::Error;

use super::{Method, PatternError};

/// A return value of IDA, with the message that came with it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IdaFlag {
    /// The constant `IDA_...`, negative.
    pub value: i32,
    /// Message of IDA; may be empty.
    pub message: String,
}

impl fmt::Display for IdaFlag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "IDA {}", self.value)?;
        if !self.message.is_empty() {
            write!(f, ": {}", self.message)?;
        }
        Ok(())
    }
}

/// Reason why an integration failed. Times are in the model's unit; rows and unknowns count from 0.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SolveError {
    /// The step limit was reached.
    #[error("{steps} steps were not enough: stopped at t = {time}")]
    TooManySteps {
        /// Last time reached.
        time: f64,
        /// The limit.
        steps: u32,
        /// The unknown that was to blame most, where known.
        unknown: Option<usize>,
        /// The root function at whose threshold the integration stopped, where there is one.
        event: Option<usize>,
    },
    /// The equations lead back to thresholds of switches without end.
    #[error("{steps} steps between switches moved time by too little: stopped at t = {time}")]
    Switching {
        /// Last time reached.
        time: f64,
        /// The limit.
        steps: u32,
        /// Unknowns at the thresholds of the last two switches, with their values.
        at: [Option<(usize, f64)>; 2],
    },
    /// The step shrank to nothing: the solution is singular there, or the tolerances are too tight.
    #[error("the step shrank to {step} at t = {time}")]
    StepTooSmall {
        /// Last time reached.
        time: f64,
        /// The last step.
        step: f64,
        /// The unknown that was to blame most, where known.
        unknown: Option<usize>,
    },
    /// The error test failed repeatedly, or at the smallest step.
    #[error("the error test failed repeatedly at t = {time} ({flag})")]
    ErrorTestFailures {
        /// Last time reached.
        time: f64,
        /// Return value of IDA.
        flag: IdaFlag,
        /// The unknown that was to blame most, where known.
        unknown: Option<usize>,
    },
    /// The Newton iteration failed repeatedly, or at the smallest step.
    #[error("the Newton iteration did not converge at t = {time} ({flag})")]
    ConvergenceFailures {
        /// Last time reached.
        time: f64,
        /// Return value of IDA.
        flag: IdaFlag,
        /// The unknown that was to blame most, where known.
        unknown: Option<usize>,
    },
    /// An equation is not finite where the solution leads.
    #[error("equation {row} is not finite at t = {time}")]
    NotFinite {
        /// Time of the evaluation.
        time: f64,
        /// First row that is not finite.
        row: usize,
    },
    /// The Jacobian has an entry that is not finite.
    #[error("the Jacobian has an entry that is not finite at t = {time}, row {row}, column {column}")]
    JacobianNotFinite {
        /// Time of the evaluation.
        time: f64,
        /// Row of the first such entry.
        row: usize,
        /// Its column.
        column: usize,
    },
    /// The Newton matrix is singular.
    #[error("the Jacobian is singular at t = {time}{}", column.map_or(String::new(), |c| format!(", unknown {c}")))]
    SingularJacobian {
        /// Time of the evaluation.
        time: f64,
        /// The unknown without a pivot, where known.
        column: Option<usize>,
    },
    /// No consistent initial condition was found.
    #[error("no consistent initial condition at t = {time}: {iterations} Newton iterations leave a correction of {correction} tolerances")]
    InitialConditions {
        /// Time of the restart.
        time: f64,
        /// Iterations made.
        iterations: u32,
        /// Norm of the last correction, in tolerances (weighted root mean square).
        correction: f64,
        /// The unknown that was to blame most, where known.
        unknown: Option<usize>,
    },
    /// IDA found no consistent initial condition of an implicit system.
    #[error("no consistent initial condition at t = {time} ({flag})")]
    ImplicitInitialConditions {
        /// Time of the restart.
        time: f64,
        /// Return value of IDA.
        flag: IdaFlag,
        /// The unknown that was to blame most, where known.
        unknown: Option<usize>,
    },
    /// At a restart the solution jumps out of the declared bounds, and none was found inside.
    #[error("no algebraic solution inside of the declared bounds at t = {time}")]
    Outside {
        /// Time of the restart.
        time: f64,
        /// The unknown that is furthest outside.
        unknown: Option<usize>,
    },
    /// A nonnegative state is negative, or the equations lead it below zero.
    #[error("unknown {unknown} would become negative at t = {time}")]
    Negative {
        /// Last time reached.
        time: f64,
        /// The state.
        unknown: usize,
    },
    /// A function of the system panicked.
    #[error("a model function panicked at t = {time}")]
    Panicked {
        /// Last time reached.
        time: f64,
    },
    /// Somebody wanted the integration to stop, see [`crate::interrupt`].
    #[error("interrupted at t = {time}")]
    Interrupted {
        /// Last time reached.
        time: f64,
    },
    /// Any other return of IDA.
    #[error("integration failed at t = {time} ({flag})")]
    Other {
        /// Last time reached.
        time: f64,
        /// Return value of IDA.
        flag: IdaFlag,
    },
    /// An array has the wrong length.
    #[error("{name} has {given} entries instead of {expected}")]
    Length {
        /// Name of the array.
        name: &'static str,
        /// Its length.
        given: usize,
        /// The length it should have.
        expected: usize,
    },
    /// A state or a time given to the integrator is not finite, or the end is not after the
    /// beginning.
    #[error("cannot advance from t = {from} to t = {to}")]
    Interval {
        /// Present time.
        from: f64,
        /// Time asked for.
        to: f64,
    },
    /// `advance` was called before `restart`, or after a failure.
    #[error("the integrator needs a restart first")]
    NotStarted,
    /// A method that takes systems only that are explicit in their derivatives.
    #[error("method `{method}` takes models only that are explicit in their derivatives: use `ida`")]
    Implicit {
        /// Name.
        method: Method,
    },
    /// The explicit method takes no algebraic unknowns.
    #[error(
        "method `explicit` takes ordinary differential equations only, and unknown {unknown} is algebraic: use `rosenbrock`, `auto` or `ida`"
    )]
    Algebraic {
        /// The first algebraic unknown.
        unknown: usize,
    },
    /// A setting is out of its range.
    #[error("solver setting: {message}")]
    Settings {
        /// Violated requirement.
        message: &'static str,
    },
    /// The pattern of a Jacobian is not what it should be.
    #[error("pattern of the Jacobian: {0}")]
    Pattern(#[from] PatternError),
    /// An explicit system's pattern lacks the diagonal entry of a differential row, or the
    /// dimension is wrong.
    #[error("pattern of the Jacobian: row {row} lacks its diagonal entry")]
    Diagonal {
        /// The first such row.
        row: usize,
    },
    /// SUNDIALS or KLU could not allocate or refused its input.
    #[error("{function} failed ({flag})")]
    Setup {
        /// The function that failed.
        function: &'static str,
        /// Return value.
        flag: IdaFlag,
    },
}
