//! Models as text of other tools: `smpl export` and `smpl.export`.
//!
//! The compiler writes the text; what it needs of the runtime is the nominal point: parameters at their means with the given ones in
//! place, and the start of an episode that belongs to them.

use std::sync::Arc;

use smpl_compiler::export::{self as targets, ExportError, File, Nominal, Origin, Target};
use smpl_compiler::layout::Region;

use crate::environment::{Environment, ResetOptions, Start};
use crate::load::Loaded;
use crate::setup::{Setup, SetupError};
use crate::steady;

/// Why a model is not exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportFault {
    /// The target cannot carry the model.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// Settings or parameters that the model cannot have.
    #[error(transparent)]
    Setup(#[from] SetupError),
}

/// The files of a model in the form of a target, the main one first; `stem` is the name of its file without the ending.
///
/// # Errors
/// See [`ExportFault`].
pub fn export(loaded: &Loaded, target: Target, stem: Option<&str>) -> Result<Vec<File>, ExportFault> {
    let setup = Setup::without_steady(Arc::clone(&loaded.model), loaded.options.clone(), Some(Arc::clone(&loaded.sources)))?;
    let made_for = loaded.made_for();
    let origin = Origin { made_for: &made_for, stem };
    let mut environment = Environment::new(Arc::clone(&setup))?;
    let mut outputs = vec![f64::NAN; setup.catalogue.algebraics.len()];
    let start = ResetOptions { start: Start::Nominal, ..ResetOptions::default() };
    let (y, mut memory) = match environment.reset(Some(0), &start) {
        Ok(()) => {
            environment.algebraics(&mut outputs);
            (environment.unknowns().to_vec(), environment.memory().clone())
        }
        // A start that cannot be found is no obstacle: the declared values stand for it.
        Err(_) => (steady::guess(&setup.system, &setup.catalogue), setup.system.memory().clone()),
    };
    for action in setup.catalogue.actions.elements() {
        memory.region_mut(Region::Action)[action.at] = action.default;
    }
    let nominal = Nominal { layout: loaded.model.layout(), y: &y, work: memory.all(), outputs: &outputs };
    Ok(targets::export(&loaded.model, &nominal, &origin, target)?)
}
