//! Snapshots of environments.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyType};
use smpl_runtime::environment;

/// All that an environment would go on from.
#[pyclass(frozen, module = "smpl._native")]
pub struct Snapshot {
    snapshot: environment::Snapshot,
}

impl From<environment::Snapshot> for Snapshot {
    fn from(snapshot: environment::Snapshot) -> Self {
        Self { snapshot }
    }
}

impl Snapshot {
    /// The snapshot of the runtime.
    pub fn inner(&self) -> &environment::Snapshot {
        &self.snapshot
    }
}

#[pymethods]
impl Snapshot {
    /// A snapshot from its bytes.
    #[new]
    fn new(bytes: &[u8]) -> PyResult<Self> {
        let snapshot = environment::Snapshot::from_bytes(bytes).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(Self { snapshot })
    }

    /// The snapshot as bytes, for another process.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = self.snapshot.to_bytes().map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(PyBytes::new(py, &bytes))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyType>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Self>(), (self.to_bytes(py)?,)))
    }

    // It never changes, so that a copy may be the same object.
    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __deepcopy__(slf: Py<Self>, _memo: Bound<'_, PyAny>) -> Py<Self> {
        slf
    }
}
