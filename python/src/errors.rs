//! Exceptions, and what becomes one.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use smpl_runtime::environment::{ResetError, StepError};
use smpl_runtime::setup::SetupError;
use smpl_runtime::start::StartFailure;

create_exception!(smpl, CompileError, PyException, "The model is invalid; `diagnostics` has places and reasons.");
create_exception!(smpl, ScenarioError, PyValueError, "The scenario, a variant or a setting is invalid.");
create_exception!(smpl, SimulationError, PyRuntimeError, "The equations could not be solved where there is no episode that could fail.");

/// One finding of the compiler; positions are 1-based and count characters.
#[pyclass(frozen, get_all, module = "smpl")]
#[derive(Clone, Debug)]
pub struct Diagnostic {
    /// File of the finding.
    pub file: String,
    /// First line and column, last line and the column after the last character.
    pub line: usize,
    /// See `line`.
    pub column: usize,
    /// See `line`.
    pub end_line: usize,
    /// See `line`.
    pub end_column: usize,
    /// Identifier of the kind of finding.
    pub code: String,
    /// `error` or `warning`.
    pub severity: String,
    /// Message.
    pub message: String,
    /// Correction.
    pub help: Option<String>,
    /// Further facts.
    pub notes: Vec<String>,
    /// Other places that belong to the finding.
    pub related: Vec<RelatedPlace>,
}

/// Another place that belongs to a finding; positions are 1-based and count characters.
#[pyclass(frozen, get_all, module = "smpl")]
#[derive(Clone, Debug)]
pub struct RelatedPlace {
    /// Description of the place; may be empty.
    pub message: String,
    /// File of the place.
    pub file: String,
    /// First line and column, last line and the column after the last character.
    pub line: usize,
    /// See `line`.
    pub column: usize,
    /// See `line`.
    pub end_line: usize,
    /// See `line`.
    pub end_column: usize,
}

#[pymethods]
impl RelatedPlace {
    fn __repr__(&self) -> String {
        format!("<RelatedPlace {}:{}:{}: {}>", self.file, self.line, self.column, self.message)
    }
}

impl Diagnostic {
    /// A finding about a file as a whole: it cannot be read.
    pub fn of_file(file: &str, message: &str) -> Self {
        Self {
            file: file.to_owned(),
            line: 1,
            column: 1,
            end_line: 1,
            end_column: 1,
            code: smpl_runtime::load::UNREADABLE.to_owned(),
            severity: "error".to_owned(),
            message: message.to_owned(),
            help: None,
            notes: Vec::new(),
            related: Vec::new(),
        }
    }
}

#[pymethods]
impl Diagnostic {
    fn __str__(&self) -> String {
        format!("{}:{}:{}: {} [{}]", self.file, self.line, self.column, self.message, self.code)
    }

    fn __repr__(&self) -> String {
        format!("<Diagnostic {}>", self.__str__())
    }
}

/// The exception of an invalid model.
pub fn compile_error(py: Python<'_>, diagnostics: Vec<Diagnostic>) -> PyErr {
    let with_notes = |d: &Diagnostic| {
        let notes = d.notes.iter().map(|note| format!("\n  note: {note}")).collect::<String>();
        d.__str__() + &notes
    };
    let text: Vec<String> = diagnostics.iter().map(with_notes).collect();
    let error = CompileError::new_err(text.join("\n"));
    match error.value(py).setattr("diagnostics", diagnostics) {
        Ok(()) => error,
        Err(other) => other,
    }
}

/// The exception of a step that was not taken.
pub fn step_error(error: &StepError) -> PyErr {
    match error {
        StepError::EpisodeOver | StepError::Interrupted => SimulationError::new_err(error.to_string()),
        StepError::Length { .. } | StepError::NotANumber { .. } | StepError::RecordEnded { .. } => PyValueError::new_err(error.to_string()),
    }
}

/// The exception of an environment that cannot be made.
pub fn setup_error(error: &SetupError) -> PyErr {
    match error {
        SetupError::UnknownName(_) | SetupError::Parameter(_) | SetupError::Value { .. } => ScenarioError::new_err(error.to_string()),
        SetupError::Method { .. } => PyValueError::new_err(error.to_string()),
        _ => SimulationError::new_err(error.to_string()),
    }
}

/// The exception of an episode that cannot begin; its attribute `start` has the report of a start
/// without a solution.
pub fn reset_error(error: &ResetError) -> PyErr {
    match error {
        ResetError::Inconsistent { start: Some(failure), .. } => Python::attach(|py| {
            let exception = SimulationError::new_err(error.to_string());
            match report(py, failure).and_then(|report| exception.value(py).setattr("start", report)) {
                Ok(()) => exception,
                Err(other) => other,
            }
        }),
        ResetError::Steady(_) | ResetError::Cyclic { .. } | ResetError::Inconsistent { .. } | ResetError::Interrupted => {
            SimulationError::new_err(error.to_string())
        }
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// The report of a start without a solution as a mapping.
fn report<'py>(py: Python<'py>, failure: &StartFailure) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("block", failure.block)?;
    let unknowns = failure.unknowns.iter().map(|u| {
        let item = PyDict::new(py);
        item.set_item("name", &u.name)?;
        item.set_item("unit", &u.unit)?;
        item.set_item("guess", u.guess)?;
        item.set_item("value", u.value)?;
        item.set_item("bounds", (u.low, u.high))?;
        Ok(item)
    });
    out.set_item("unknowns", unknowns.collect::<PyResult<Vec<_>>>()?)?;
    let equations = failure.equations.iter().map(|e| {
        let item = PyDict::new(py);
        item.set_item("equation", &e.text)?;
        item.set_item("residual", e.residual)?;
        Ok(item)
    });
    out.set_item("equations", equations.collect::<PyResult<Vec<_>>>()?)?;
    let tried = failure.tried.iter().map(|t| {
        let item = PyDict::new(py);
        item.set_item("method", &t.way)?;
        item.set_item("iterations", t.iterations)?;
        item.set_item("residual", t.residual)?;
        item.set_item("outside_bounds", t.solved)?;
        Ok(item)
    });
    out.set_item("tried", tried.collect::<PyResult<Vec<_>>>()?)?;
    out.set_item("at_bounds", &failure.at_bounds)?;
    out.set_item("badly_scaled", &failure.badly_scaled)?;
    out.set_item("other_solutions", failure.outside.iter().map(|x| x.to_vec()).collect::<Vec<_>>())?;
    out.set_item("help", &failure.help)?;
    Ok(out)
}

/// Runs `work`; a panic in it becomes an exception.
pub fn guarded<T>(work: impl FnOnce() -> T) -> PyResult<T> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|cause| panicked(cause.as_ref()))
}

/// A panic as an exception.
pub fn panicked(cause: &(dyn Any + Send)) -> PyErr {
    let text = cause.downcast_ref::<String>().map(String::as_str);
    fault(text.or_else(|| cause.downcast_ref::<&str>().copied()).unwrap_or("unknown cause"))
}

/// Errors that the caller did not cause.
pub fn fault(text: &str) -> PyErr {
    SimulationError::new_err(format!("internal error of smpl, please report it: {text}"))
}
