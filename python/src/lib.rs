//! Python module `smpl._native`: compiled models, environments and batches for the package `smpl`.
//!
//! The classes are thin. Names are checked and documented by the package. Here arrays are taken and
//! made, the interpreter lock is released around everything that computes, signals are looked at
//! meanwhile, and errors become exceptions. Results are fresh arrays; nothing else is allocated in
//! a step. No panic leaves the module: it becomes a `SimulationError`.

mod arrays;
mod batch;
mod environment;
mod equations;
mod errors;
mod exclusive;
mod info;
mod interrupt;
mod load;
mod model;
mod picture;
mod role;
mod rollout;
mod rules;
mod sensitivity;
mod snapshot;
mod start;

use pyo3::prelude::*;

/// Runs the command line; `arguments` begin with the program's name. Returns the exit status.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<String>) -> PyResult<i32> {
    interrupt::released(py, || smpl_tools::cli::run(arguments.into_iter().map(Into::into)))
}

/// The compiled part of the package `smpl`.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    interrupt::install();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("CompileError", py.get_type::<errors::CompileError>())?;
    module.add("ScenarioError", py.get_type::<errors::ScenarioError>())?;
    let simulation_error = py.get_type::<errors::SimulationError>();
    simulation_error.setattr("start", py.None())?;
    module.add("SimulationError", simulation_error)?;
    module.add_function(wrap_pyfunction!(rules::on_steps, module)?)?;
    module.add_class::<errors::Diagnostic>()?;
    module.add_class::<errors::RelatedPlace>()?;
    module.add_class::<model::Model>()?;
    module.add_class::<start::Start>()?;
    module.add_class::<environment::Env>()?;
    module.add_class::<snapshot::Snapshot>()?;
    module.add_class::<batch::Batch>()?;
    module.add_class::<picture::Picture>()?;
    module.add_class::<picture::Recording>()?;
    module.add_function(wrap_pyfunction!(picture::picture_of_tables, module)?)?;
    module.add_function(wrap_pyfunction!(picture::nominal_picture, module)?)?;
    module.add_function(wrap_pyfunction!(main, module)?)
}
