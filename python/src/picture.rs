//! Classes `Picture` and `Recording`: episodes and saved runs as they are drawn by the command
//! line.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use numpy::PyArrayMethods;
use numpy::{PyArray1, PyArray3};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use smpl_runtime::setup::Setup;
use smpl_runtime::trajectory::Recorder;
use smpl_tools::picture::{self, Format, NominalError, Run, SavedError, heading, items, plan};

use crate::environment::Env;
use crate::errors::{reset_error, setup_error, step_error};
use crate::interrupt::released;
use crate::model::Model;

/// A picture.
#[pyclass(frozen, module = "smpl")]
pub struct Picture {
    picture: picture::Picture,
}

#[pymethods]
impl Picture {
    /// As the text of an SVG file.
    fn svg(&self) -> String {
        self.picture.svg()
    }

    /// As the text of a page of HTML that needs nothing else: it can be pointed at and enlarged.
    fn html(&self) -> String {
        self.picture.html()
    }

    /// As the bytes of a PNG file.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.picture.bytes(Format::Png).map_err(PyValueError::new_err)?))
    }

    /// Red, green and blue: an array of `uint8`, height x width x 3.
    #[pyo3(signature = (scale = 1.0))]
    fn rgb<'py>(&self, py: Python<'py>, scale: f64) -> PyResult<Bound<'py, PyArray3<u8>>> {
        if !(scale > 0.0 && scale <= 8.0) {
            return Err(PyValueError::new_err(format!("scale is {scale}, expected a number above 0 and at most 8")));
        }
        let (bytes, height, width) = self.picture.rgb(scale).map_err(PyValueError::new_err)?;
        PyArray1::from_vec(py, bytes).reshape([height, width, 3])
    }

    /// Writes a file: SVG, PNG, PDF or HTML by its ending.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        check_ending(&path)?;
        self.picture.write(&path).map_err(|error| PyOSError::new_err(error.to_string()))
    }

    /// Names of what the panels show.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.picture.names().map(str::to_owned).collect()
    }

    fn _repr_svg_(&self) -> String {
        self.picture.svg()
    }

    fn _repr_html_(&self) -> String {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let id = format!("smpl-picture-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        self.picture.html_part(&id)
    }

    fn __repr__(&self) -> String {
        let names: Vec<&str> = self.picture.names().collect();
        format!("<smpl.Picture of {}>", names.join(", "))
    }
}

fn check_ending(path: &Path) -> PyResult<()> {
    if Format::of(path).is_some() {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{}: pictures end in .svg, .png, .pdf or .html", path.display())))
}

/// The rows of an episode, to be drawn.
#[derive(Clone)]
#[pyclass(module = "smpl._native")]
pub struct Recording {
    recorder: Recorder,
    setup: Arc<Setup>,
    moved: bool,
}

#[pymethods]
impl Recording {
    /// Begins with the present point of an environment.
    #[new]
    fn new(env: &Env) -> PyResult<Self> {
        env.with_mut(|environment| {
            let mut recorder = Recorder::new(environment);
            recorder.record(environment, None);
            let moved = !items::knows_space(environment.setup(), environment.parameters());
            Self { recorder, setup: Arc::clone(environment.setup()), moved }
        })
    }

    /// Adds the present point of the environment, after a step.
    fn add(&mut self, env: &Env) -> PyResult<()> {
        env.with_mut(|environment| {
            let last = environment.last().copied();
            self.recorder.record(environment, last.as_ref());
        })
    }

    /// Goes back to the point at which the environment is again; whether that is one of those
    /// recorded.
    fn go_back(&mut self, env: &Env) -> PyResult<bool> {
        let rows = env.with_mut(|environment| environment.steps() as usize + 1)?;
        let is_known = rows <= self.recorder.table().len();
        self.recorder.truncate(rows);
        Ok(is_known)
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    /// The picture of what `show` names.
    fn picture(&self, show: Vec<String>, note: String) -> PyResult<Picture> {
        let plans = plan(&items::of_model(&self.setup), &show).map_err(|error| PyValueError::new_err(error.to_string()))?;
        let run = Run::of_table("", self.recorder.table()).with_moved(self.moved);
        let unit = &self.setup.model().interface().time.unit;
        Ok(Picture { picture: picture::Picture::new(&plans, &[run], &heading(&self.setup, note), unit) })
    }

    /// Writes the rows as a table, CSV or Parquet by its ending.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        self.recorder.table().write(&path).map_err(|error| PyOSError::new_err(error.to_string()))
    }
}

/// The picture of saved tables.
#[pyfunction]
pub fn picture_of_tables(py: Python<'_>, paths: Vec<PathBuf>, show: Vec<String>, model: Option<&Model>) -> PyResult<Picture> {
    let setup = model.map(|model| model.setup(py, true, None, None)).transpose()?;
    let drawn = released(py, || picture::of_tables(&paths, &show, setup.as_deref()))?;
    let picture = drawn.map_err(|error| match error {
        SavedError::Data(error @ smpl_runtime::trajectory::DataError::Read { .. }) => PyOSError::new_err(error.to_string()),
        other => PyValueError::new_err(other.to_string()),
    })?;
    Ok(Picture { picture })
}

/// The picture of an episode with the nominal policy.
#[pyfunction]
pub fn nominal_picture(py: Python<'_>, model: &Model, show: Vec<String>, most_steps: u32) -> PyResult<Picture> {
    let setup = model.setup(py, true, None, None)?;
    let drawn = released(py, || picture::nominal(&setup, &show, most_steps))?;
    let picture = drawn.map_err(|error| match error {
        NominalError::Show(error) => PyValueError::new_err(error.to_string()),
        NominalError::Setup(error) => setup_error(&error),
        NominalError::Reset(error) => reset_error(&error),
        NominalError::Step(error) => step_error(&error),
    })?;
    Ok(Picture { picture })
}
