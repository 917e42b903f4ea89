//! Errors of a text.

use thiserror::Error;

use crate::verify::Violation;

/// Reason why a text is not a model.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ReadError {
    /// It is not JSON.
    #[error("not JSON: {0}")]
    Syntax(String),
    /// Another form, or another version of it.
    #[error("version {found} of the form; this program reads version {expected}: export the model again")]
    Version {
        /// The version in the text.
        found: String,
        /// That of this program.
        expected: u32,
    },
    /// A part is not as it has to be.
    #[error("{path}: {message}")]
    Place {
        /// Path of the part, `programs.start.nests[2].extents`.
        path: String,
        /// Error.
        message: String,
    },
}

impl From<Violation> for ReadError {
    fn from(Violation { place: path, message }: Violation) -> Self {
        ReadError::Place { path, message }
    }
}

/// Error at a part.
pub(super) fn fault(path: impl Into<String>, message: impl Into<String>) -> ReadError {
    ReadError::Place { path: path.into(), message: message.into() }
}
