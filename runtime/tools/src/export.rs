//! Models as text of other tools: `smpl export` and `smpl.export`.
//!
//! The compiler writes the text. What it needs of the runtime is the nominal point: parameters at
//! their means with the given ones in place, and the start of an episode that belongs to them.

mod archive;
mod fmu;

use std::num::NonZeroU32;
use std::sync::Arc;

use smpl_compiler::export::{self as targets, ExportError, File, Nominal, Origin, Settings, Target};
use smpl_compiler::layout::Region;

use smpl_runtime::environment::{Environment, ResetOptions, Start};
use smpl_runtime::load::Loaded;
use smpl_runtime::setup::{Setup, SetupError};
use smpl_runtime::steady;

pub use fmu::Fmu;

/// Reason why a model is not exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportFault {
    /// The target cannot carry the model.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// Settings or parameters that the model cannot have.
    #[error(transparent)]
    Setup(#[from] SetupError),
}

/// The files of a model in the form of a target, the main one first.
///
/// `stem` is the name of the main file without the ending, and `history` the most steps that the
/// past of delayed expressions holds.
///
/// # Errors
/// See [`ExportFault`].
pub fn export(loaded: &Loaded, target: Target, stem: Option<&str>, history: Option<NonZeroU32>) -> Result<Vec<File>, ExportFault> {
    let setup = setup(loaded)?;
    at_nominal(loaded, &setup, |nominal| {
        let origin = Origin { made_for: &loaded.made_for(), circumstances: &loaded.circumstances, stem };
        targets::export(&loaded.model, nominal, &origin, &settings(&setup, history), target)
    })
}

/// An FMU of a model; `compile` is whether it shall have a binary for this machine, and `history`
/// the most steps that the past of delayed expressions holds.
///
/// # Errors
/// See [`ExportFault`].
pub fn export_fmu(loaded: &Loaded, compile: bool, history: Option<NonZeroU32>) -> Result<Fmu, ExportFault> {
    let setup = setup(loaded)?;
    let package = at_nominal(loaded, &setup, |nominal| {
        let origin = Origin { made_for: &loaded.made_for(), circumstances: &loaded.circumstances, stem: None };
        targets::package(&loaded.model, nominal, &origin, &settings(&setup, history))
    })?;
    Ok(fmu::pack(package, compile))
}

fn setup(loaded: &Loaded) -> Result<Arc<Setup>, SetupError> {
    Setup::without_steady(Arc::clone(&loaded.model), loaded.options.clone(), Some(Arc::clone(&loaded.sources)))
}

/// Calls a writer with the nominal point.
fn at_nominal<T>(
    loaded: &Loaded,
    setup: &Arc<Setup>,
    write: impl FnOnce(&Nominal<'_>) -> Result<T, ExportError>,
) -> Result<T, ExportFault> {
    let mut environment = Environment::new(Arc::clone(setup))?;
    let mut outputs = vec![f64::NAN; setup.catalogue.algebraics.len()];
    let start = ResetOptions { start: Start::Nominal, ..ResetOptions::default() };
    let (y, mut memory) = match environment.reset(Some(0), &start) {
        Ok(()) => {
            environment.algebraics(&mut outputs);
            (environment.unknowns().to_vec(), environment.memory().clone())
        }
        // A start that cannot be found is not an obstacle: the declared values stand for it.
        Err(_) => (steady::guess(&setup.system, &setup.catalogue), setup.system.memory().clone()),
    };
    for action in setup.catalogue.actions.elements() {
        memory.region_mut(Region::Action)[action.at] = action.default;
    }
    let nominal = Nominal { layout: loaded.model.layout(), y: &y, work: memory.all(), outputs: &outputs };
    Ok(write(&nominal)?)
}

/// Simulation settings of the environment.
fn settings(setup: &Setup, history: Option<NonZeroU32>) -> Settings {
    let (options, declared) = (&setup.options, &setup.model().interface().solver);
    Settings {
        rtol: setup.settings.rtol,
        atol_factor: options.solver.atol_factor.unwrap_or(declared.atol_factor),
        max_step: setup.settings.max_step,
        max_steps: setup.settings.max_steps,
        max_events: setup.max_events,
        episode: setup.max_steps(),
        algebraic_errors: setup.settings.algebraic_error_control,
        history,
    }
}
