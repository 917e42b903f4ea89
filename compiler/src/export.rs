//! A checked model as text of other tools: JSON, C, Python modules for CasADi and JAX.
//!
//! [`Families`] names every number of a model in the order of the outside, and says where it is kept. Each target is a printer of its own;
//! what they have in common are the [`sheet`] (the functions of a model with the arrays that they read and write) and the two ways to walk
//! them, as loops ([`loops`]) and as operations on whole arrays ([`arrays`]). Nothing is scalarised.

mod arrays;
mod c;
mod casadi;
mod elements;
mod fmu;
mod functions;
mod jacobian;
mod jax;
mod module;
mod python;
mod sheet;

use std::str::FromStr;

use thiserror::Error;

use crate::artefact::Circumstances;
use crate::compiled::CompiledModel;
use crate::json;

pub use elements::{Element, Families, Nominal};
pub use fmu::{Package, Settings};

/// What a model is exported to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// A Python module that builds CasADi functions.
    Casadi,
    /// A Python module of pure functions for JAX.
    Jax,
    /// C99 without dependencies: a source and its header.
    C,
    /// The checked model as a tree, with a schema.
    Json,
    /// An archive for simulators, see [`package`].
    Fmu,
}

impl Target {
    /// All of them with their names.
    pub const ALL: [(&'static str, Target); 5] =
        [("casadi", Target::Casadi), ("jax", Target::Jax), ("c", Target::C), ("json", Target::Json), ("fmu", Target::Fmu)];

    /// The name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, target)| *target == self).map_or("", |(name, _)| name)
    }

    /// Endings of the files that it makes, the first that of the file that is asked for.
    #[must_use]
    pub fn endings(self) -> &'static [&'static str] {
        match self {
            Target::Casadi | Target::Jax => &["py"],
            Target::C => &["c", "h"],
            Target::Json => &["json"],
            Target::Fmu => &["fmu"],
        }
    }
}

impl FromStr for Target {
    type Err = ExportError;

    fn from_str(name: &str) -> Result<Target, ExportError> {
        let found = Self::ALL.iter().find(|(known, _)| *known == name).map(|(_, target)| *target);
        found.ok_or_else(|| ExportError::UnknownTarget {
            name: name.to_owned(),
            known: Self::ALL.iter().map(|(known, _)| *known).collect::<Vec<_>>().join(", "),
        })
    }
}

/// Why a model cannot be exported.
#[derive(Debug, Error)]
pub enum ExportError {
    /// There is no such target.
    #[error("unknown target `{name}`; known: {known}")]
    UnknownTarget {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// A function of the model reads or writes what no vector of the target holds.
    #[error("`{variable}` is read or written where the target has no place for it; please report it with the model")]
    Unavailable {
        /// The variable.
        variable: String,
    },
    /// A function reads the time derivative of an algebraic variable, which only the solver knows.
    #[error("`{function}` reads the time derivative of an algebraic variable, which a function of x, z, u and p does not have")]
    AlgebraicDerivative {
        /// The function.
        function: String,
    },
    /// A function of an FMU reads an integral over the step, which it does not keep.
    #[error("`{function}` reads an integral over the step, which an FMU does not have")]
    Integral {
        /// The function.
        function: String,
    },
    /// A variable of an FMU has no start value.
    #[error("`{name}` has no value at the nominal point, and an FMU needs a start value")]
    NoStart {
        /// The variable.
        name: String,
    },
    /// An FMU is no text.
    #[error("an FMU is an archive: `smpl export FILE --to fmu -o NAME.fmu` or `smpl.export.fmu(model, path)` writes it")]
    Archive,
    /// An equation cannot be differentiated.
    #[error(transparent)]
    Differentiate(#[from] crate::differentiate::DifferentiateError),
    /// Text could not be made of a value.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
}

/// A file of an export: what follows the name of the main one, and its text.
pub struct File {
    /// Ending without the dot.
    pub ending: &'static str,
    /// Content.
    pub text: String,
}

/// What is said of an export beside its model.
pub struct Origin<'a> {
    /// Scenario, variants and settings in words; empty for the model as it stands.
    pub made_for: &'a str,
    /// The same for programs: JSON holds it.
    pub circumstances: &'a Circumstances,
    /// Name of the main file without its ending, where there is one: C takes it for the prefix of its names.
    pub stem: Option<&'a str>,
}

/// The files of a model in the form of a target; the first is the main one.
///
/// # Errors
/// See [`ExportError`].
pub fn export(model: &CompiledModel, nominal: &Nominal<'_>, origin: &Origin<'_>, target: Target) -> Result<Vec<File>, ExportError> {
    let texts = match target {
        Target::Casadi => vec![casadi::print(model.model(), nominal, origin)?],
        Target::Jax => vec![jax::print(model.model(), nominal, origin)?],
        Target::C => c::print(model.model(), nominal, origin)?,
        Target::Json => vec![json::print(model.model(), nominal, origin)?],
        Target::Fmu => return Err(ExportError::Archive),
    };
    Ok(target.endings().iter().zip(texts).map(|(ending, text)| File { ending, text }).collect())
}

/// What an FMU of a model holds, but for its binary.
///
/// # Errors
/// See [`ExportError`].
pub fn package(model: &CompiledModel, nominal: &Nominal<'_>, origin: &Origin<'_>, settings: &Settings) -> Result<Package, ExportError> {
    fmu::package(model.model(), nominal, origin, settings)
}
