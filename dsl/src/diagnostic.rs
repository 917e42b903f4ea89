//! Diagnostics as data: what is wrong, where, and what to do about it.
//!
//! A [`Diagnostic`] has one *primary* label: if only one thing can be shown, it is the primary
//! message at the primary place. *Secondary* labels show what the fault conflicts with (the opening
//! bracket, the first declaration). `help` is an instruction to the author; `notes` are facts.
//! Rendering belongs to the caller; this module knows places and text only.
//!
//! ```
//! use smpl_dsl::diagnostic::{Diagnostic, codes};
//! use smpl_dsl::span::Span;
//!
//! let fault = Diagnostic::error(codes::UNKNOWN_NAME, "unknown name `k0`", Span::default())
//!     .label("not declared")
//!     .help("did you mean `k_0`?");
//! assert_eq!(fault.code.id(), "E0201-unknown-name");
//! ```

pub mod codes;
mod faults;
mod json;
mod printable;
mod source_map;
mod suggest;

use serde::Serialize;

pub use codes::Code;
pub use faults::{Faults, SHOWN};
pub use json::{JsonDiagnostic, JsonPlace};
pub use printable::printable;
pub use source_map::{Location, SourceFile, SourceMap};
pub use suggest::{did_you_mean, suggest};

use crate::span::Span;

/// Severity of a diagnostic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Something worth knowing.
    Info,
    /// Suspicious, yet the model means something.
    Warning,
    /// The model cannot be compiled.
    Error,
}

/// A place and the message about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    /// The place.
    pub span: Span,
    /// The text shown next to it; may be empty.
    pub text: String,
}

/// One fault of a source text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Stable identifier of the kind of fault.
    pub code: Code,
    /// Severity.
    pub severity: Severity,
    /// One sentence, without a full stop, that can be alone.
    pub message: String,
    /// Place of the fault.
    pub primary: Label,
    /// Other places that belong to the fault.
    pub secondary: Vec<Label>,
    /// Correction.
    pub help: Option<String>,
    /// Further facts.
    pub notes: Vec<String>,
    /// The invalid name of a request, without a place in the text of a model; a caller that knows
    /// the place adds it.
    pub asked: Option<String>,
}

impl Diagnostic {
    /// An error at `span`.
    #[must_use]
    pub fn error(code: Code, message: impl Into<String>, span: Span) -> Self {
        Self::new(code, Severity::Error, message, span)
    }

    /// A warning at `span`.
    #[must_use]
    pub fn warning(code: Code, message: impl Into<String>, span: Span) -> Self {
        Self::new(code, Severity::Warning, message, span)
    }

    fn new(code: Code, severity: Severity, message: impl Into<String>, span: Span) -> Self {
        Self {
            code,
            severity,
            message: message.into(),
            primary: Label { span, text: String::new() },
            secondary: Vec::new(),
            help: None,
            notes: Vec::new(),
            asked: None,
        }
    }

    /// Sets the text next to the primary place.
    #[must_use]
    pub fn label(mut self, text: impl Into<String>) -> Self {
        self.primary.text = text.into();
        self
    }

    /// Adds a secondary place.
    #[must_use]
    pub fn secondary(mut self, span: Span, text: impl Into<String>) -> Self {
        self.secondary.push(Label { span, text: text.into() });
        self
    }

    /// Adds secondary places, each with its text.
    #[must_use]
    pub fn secondaries(mut self, places: impl IntoIterator<Item = (String, Span)>) -> Self {
        self.secondary.extend(places.into_iter().map(|(text, span)| Label { span, text }));
        self
    }

    /// Says what to do.
    #[must_use]
    pub fn help(mut self, text: impl Into<String>) -> Self {
        self.help = Some(text.into());
        self
    }

    /// Says what to do, where something is known.
    #[must_use]
    pub fn maybe_help(mut self, text: Option<String>) -> Self {
        if text.is_some() {
            self.help = text;
        }
        self
    }

    /// Sets the invalid name of the request.
    #[must_use]
    pub fn asked(mut self, name: impl Into<String>) -> Self {
        self.asked = Some(name.into());
        self
    }

    /// Adds a fact.
    #[must_use]
    pub fn note(mut self, text: impl Into<String>) -> Self {
        self.notes.push(text.into());
        self
    }

    /// Returns `true` if this is an error.
    #[must_use]
    pub fn is_error(&self) -> bool {
        self.severity == Severity::Error
    }
}
