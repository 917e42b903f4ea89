//! From what Python asks for to a model ready to run.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use pyo3::exceptions::{PyFileNotFoundError, PyIsADirectoryError, PyPermissionError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use smpl_dsl::diagnostic::{self, JsonDiagnostic, JsonPlace, SourceMap, codes};
use smpl_runtime::load::{self, LoadError, LoadOptions};
use smpl_runtime::scenario::{Value, Variant};
use smpl_runtime::solver::Statistics;

pub use smpl_runtime::load::Loaded;

use crate::errors::{Diagnostic, RelatedPlace, ScenarioError, SimulationError, compile_error};
use crate::interrupt::aside;

/// Request of Python; one of `path` and `source` is given.
pub struct Request {
    /// File of the model.
    pub path: Option<String>,
    /// Text of the model.
    pub source: Option<String>,
    /// Name or file of a scenario.
    pub scenario: Option<String>,
    /// `NAME` or `NAME=OPTION`.
    pub variants: Vec<String>,
    /// As the command line would write them.
    pub settings: BTreeMap<String, String>,
    /// Observation level; that of the scenario if none.
    pub level: Option<String>,
    /// Reward; that of the scenario or the model if none.
    pub reward: Option<String>,
    /// Statements that follow those of the model's file.
    pub extra: Option<String>,
}

/// Compiles a model without the interpreter lock.
///
/// # Errors
/// `CompileError`, `ScenarioError`, or `FileNotFoundError`.
pub fn load(py: Python<'_>, request: Request) -> PyResult<Loaded> {
    let options = LoadOptions {
        scenario: request.scenario,
        variants: request.variants.iter().map(|text| Variant::parse(text)).collect(),
        settings: request.settings.iter().map(|(name, text)| (name.clone(), Value::parse(text))).collect(),
        reward: request.reward,
        observation: request.level,
        extra: request.extra,
        ..LoadOptions::default()
    };
    let path = PathBuf::from(request.path.unwrap_or_else(|| "<source>".into()));
    let source = request.source;
    let file = path.clone();
    let result = aside(py, move || match source {
        Some(text) => load::load_text(&file, text, &options),
        None => load::load(&file, &options),
    })?;
    result.map_err(|error| load_error(py, &path, &error))
}

fn load_error(py: Python<'_>, model: &Path, error: &LoadError) -> PyErr {
    match error {
        LoadError::Read { path, kind, .. } if path == model => match kind {
            ErrorKind::NotFound => PyFileNotFoundError::new_err(error.to_string()),
            ErrorKind::IsADirectory => PyIsADirectoryError::new_err(error.to_string()),
            ErrorKind::PermissionDenied => PyPermissionError::new_err(error.to_string()),
            _ => compile_error(py, vec![Diagnostic::of_file(&path.display().to_string(), &error.to_string())]),
        },
        LoadError::Read { .. } | LoadError::Setting { .. } | LoadError::Parameter(_) => ScenarioError::new_err(error.to_string()),
        LoadError::Artefact { .. } => SimulationError::new_err(error.to_string()),
        LoadError::Diagnostics { sources, diagnostics } => {
            let first = diagnostics.iter().find(|d| d.is_error());
            if first.is_some_and(|d| d.code == codes::BAD_SCENARIO) {
                return ScenarioError::new_err(describe(diagnostics.iter().filter(|d| d.is_error()), sources));
            }
            compile_error(py, diagnostics.iter().map(|d| resolve(d, sources)).collect())
        }
    }
}

/// Findings in words: place, message, what to do.
fn describe<'d>(diagnostics: impl Iterator<Item = &'d diagnostic::Diagnostic>, sources: &SourceMap) -> String {
    let texts: Vec<String> = diagnostics
        .map(|d| {
            let found = resolve(d, sources);
            let help = found.help.map(|help| format!(" ({help})")).unwrap_or_default();
            format!("{}:{}:{}: {}{help}", found.file, found.line, found.column, found.message)
        })
        .collect();
    texts.join("\n")
}

/// Warnings of the compiler about a compiled model.
pub fn warnings(loaded: &Loaded) -> Vec<Diagnostic> {
    loaded.warnings.iter().map(|d| resolve(d, &loaded.sources)).collect()
}

/// A finding with its place resolved.
fn resolve(diagnostic: &diagnostic::Diagnostic, sources: &SourceMap) -> Diagnostic {
    let found = JsonDiagnostic::new(diagnostic, sources);
    Diagnostic {
        file: found.file.to_owned(),
        line: found.line,
        column: found.column,
        end_line: found.end_line,
        end_column: found.end_column,
        code: found.code.id().to_owned(),
        severity: format!("{:?}", found.severity).to_lowercase(),
        message: found.message.to_owned(),
        help: found.help.map(str::to_owned),
        notes: found.notes.to_vec(),
        related: found.related.iter().map(related).collect(),
    }
}

fn related(place: &JsonPlace<'_>) -> RelatedPlace {
    RelatedPlace {
        message: place.message.to_owned(),
        file: place.file.to_owned(),
        line: place.line,
        column: place.column,
        end_line: place.end_line,
        end_column: place.end_column,
    }
}

/// Counts of the solver by name.
///
/// # Errors
/// Only when Python is out of memory.
pub fn statistics<'py>(py: Python<'py>, statistics: &Statistics) -> PyResult<Bound<'py, PyDict>> {
    let counts = PyDict::new(py);
    for (name, count) in [
        ("steps", statistics.steps),
        ("residuals", statistics.residuals),
        ("jacobians", statistics.jacobians),
        ("factorisations", statistics.factorisations),
        ("linear_solves", statistics.linear_solves),
        ("error_test_failures", statistics.error_test_failures),
        ("nonlinear_failures", statistics.nonlinear_failures),
        ("retries", statistics.retries),
        ("not_finite", statistics.not_finite),
        ("restarts", statistics.restarts),
    ] {
        counts.set_item(name, count)?;
    }
    Ok(counts)
}
