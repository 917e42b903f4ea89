//! Diagnostics as the objects that `smpl check --format json` prints.

use serde::Serialize;

use super::{Code, Diagnostic, Label, Severity, SourceMap};

/// One diagnostic with its place resolved; lines and columns count from 1, columns in characters.
#[derive(Clone, Debug, Serialize)]
pub struct JsonDiagnostic<'a> {
    /// Stable identifier.
    pub code: Code,
    /// `error`, `warning` or `info`.
    pub severity: Severity,
    /// The message.
    pub message: &'a str,
    /// Name of the file.
    pub file: &'a str,
    /// Line of the first character.
    pub line: usize,
    /// Column of the first character.
    pub column: usize,
    /// Line of the end.
    pub end_line: usize,
    /// Column one past the last character.
    pub end_column: usize,
    /// Correction; `null` if unknown.
    pub help: Option<&'a str>,
    /// Further facts.
    pub notes: &'a [String],
    /// Other places that belong to the fault.
    pub related: Vec<JsonPlace<'a>>,
}

/// Another place that belongs to a diagnostic.
#[derive(Clone, Debug, Serialize)]
pub struct JsonPlace<'a> {
    /// Description of the place; may be empty.
    pub message: &'a str,
    /// Name of the file.
    pub file: &'a str,
    /// Line of the first character.
    pub line: usize,
    /// Column of the first character.
    pub column: usize,
    /// Line of the end.
    pub end_line: usize,
    /// Column one past the last character.
    pub end_column: usize,
}

impl<'a> JsonPlace<'a> {
    fn new(label: &'a Label, sources: &'a SourceMap) -> Self {
        let at = sources.locate(label.span);
        let (line, column, end_line, end_column) = (at.line, at.column, at.end_line, at.end_column);
        Self { message: &label.text, file: sources.name(label.span.file), line, column, end_line, end_column }
    }
}

impl<'a> JsonDiagnostic<'a> {
    /// Resolves the place of a diagnostic.
    #[must_use]
    pub fn new(diagnostic: &'a Diagnostic, sources: &'a SourceMap) -> Self {
        let at = sources.locate(diagnostic.primary.span);
        Self {
            code: diagnostic.code,
            severity: diagnostic.severity,
            message: &diagnostic.message,
            file: sources.name(diagnostic.primary.span.file),
            line: at.line,
            column: at.column,
            end_line: at.end_line,
            end_column: at.end_column,
            help: diagnostic.help.as_deref(),
            notes: &diagnostic.notes,
            related: diagnostic.secondary.iter().map(|label| JsonPlace::new(label, sources)).collect(),
        }
    }
}
