//! Reason why a model cannot be exported.

use thiserror::Error;

/// Reason why a model cannot be exported.
#[derive(Debug, Error)]
pub enum ExportError {
    /// There is no such target.
    #[error("unknown target `{name}`; known: {known}")]
    UnknownTarget {
        /// Requested name.
        name: String,
        /// Available names.
        known: String,
    },
    /// A function of the model reads or writes what no vector of the target holds.
    #[error("`{variable}` is read or written where the target has no place for it; please report it with the model")]
    Unavailable {
        /// The variable.
        variable: String,
    },
    /// A function reads the time derivative of an algebraic variable, which only the solver knows.
    #[error("`{function}` reads the time derivative of an algebraic variable, which a function of x, z, u and p does not have")]
    AlgebraicDerivative {
        /// The function.
        function: String,
    },
    /// A function of an FMU reads an integral over the step, which it does not keep.
    #[error("`{function}` reads an integral over the step, which an FMU does not have")]
    Integral {
        /// The function.
        function: String,
    },
    /// A function reads what was a dead time ago, which only the solver keeps.
    #[error(
        "`{delay}` reads a past that the target does not keep; export a Padé approximation of it, of order 2 by `--set pade=2`, or remove the dead time"
    )]
    Delay {
        /// The call.
        delay: String,
    },
    /// The clock of an FMU jumps at sampling instants, and so would the past.
    #[error("`{delay}` reads a past, and the model integrates another length than its sampling interval; remove `integrate`")]
    Clock {
        /// The call.
        delay: String,
    },
    /// A variable of an FMU has no start value.
    #[error("`{name}` has no value at the nominal point, and an FMU needs a start value")]
    NoStart {
        /// The variable.
        name: String,
    },
    /// The name of a header has characters that C does not read between quotation marks.
    #[error("`{}.h` cannot be included by C: name the file without quotation marks and control characters", name.escape_debug())]
    Header {
        /// The name without its ending.
        name: String,
    },
    /// An FMU is not a text.
    #[error("an FMU is an archive: `smpl export FILE --to fmu -o NAME.fmu` or `smpl.export.fmu(model, path)` writes it")]
    Archive,
    /// An equation cannot be differentiated.
    #[error(transparent)]
    Differentiate(#[from] crate::differentiate::DifferentiateError),
    /// Text could not be made of a value.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
}
