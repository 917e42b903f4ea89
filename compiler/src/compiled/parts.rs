//! Results of the passes for a model, before it is mapped.

use std::io;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::differentiate::DifferentiateError;
use crate::differentiate::pattern::Pattern;
use crate::generate::{Code, GenerateError};
use crate::model::Model;
use crate::schedule::{ScheduleError, Staged};
use crate::switches::Watched;

/// Choices of the back end.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct BackEndSettings {
    /// Compile quickly instead of well.
    pub quick: bool,
    /// Keep intermediate text and assembly for [`crate::emit`].
    pub texts: bool,
}

/// Times and sizes of a compilation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CompileStatistics {
    /// Time of differentiation and of the pattern.
    pub differentiate: Duration,
    /// Time of hoisting and layout.
    pub hoist: Duration,
    /// Time of code generation.
    pub generate: Duration,
    /// Bytes of machine code.
    pub code_bytes: usize,
    /// Non-zeros of the Jacobian.
    pub nonzeros: usize,
    /// Nodes of all expressions.
    pub expressions: usize,
    /// Numbers in caches.
    pub cached: usize,
    /// Time of code generation and bytes of each compiled function.
    pub functions: Vec<(String, Duration, usize)>,
}

/// Failures of the back end.
#[derive(Debug, Error)]
pub enum BackEndError {
    /// An equation cannot be differentiated.
    #[error(transparent)]
    Differentiate(#[from] DifferentiateError),
    /// A program addresses what it cannot have: a fault of elaboration.
    #[error(transparent)]
    Schedule(#[from] ScheduleError),
    /// No machine code.
    #[error(transparent)]
    Generate(#[from] GenerateError),
    /// No executable memory.
    #[error("no executable memory: {0}")]
    Executable(#[from] io::Error),
    /// The unknowns and the rows do not match.
    #[error("{unknowns} unknowns but {rows} equations")]
    NotSquare {
        /// Elements of unknowns.
        unknowns: usize,
        /// Rows.
        rows: usize,
    },
}

/// Content of an artefact: all results of the passes, from which the rest follows.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Parts {
    pub(crate) model: Model,
    pub(crate) pattern: Pattern,
    /// Position tables of all compiled functions.
    pub(crate) tables: Vec<u32>,
    /// Pieces of the code of each function of [`Function::ALL`](crate::functions::Function::ALL),
    /// to be called one after another.
    pub(crate) codes: Vec<Vec<Code>>,
    /// Fills the caches that depend on parameters; interpreted.
    pub(crate) prepare_parameters: Staged,
    /// Number of the breaks: times known beforehand at which an equation changes its form.
    pub(crate) breaks: u32,
    /// Number of expressions that time moves other than along straight lines.
    pub(crate) forcings: u32,
    /// Time occurs in the equations.
    pub(crate) timed: bool,
    /// There are derivatives of the equations by time.
    pub(crate) has_slopes: bool,
    /// Events and switches, which the integrator monitors.
    pub(crate) watched: Watched,
    pub(crate) statistics: CompileStatistics,
}
