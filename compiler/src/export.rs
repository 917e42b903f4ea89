//! A checked model as text of other tools: JSON, C, Python modules for CasADi and JAX.
//!
//! [`Families`] names every number of a model in declaration order, and says where it is kept. Each
//! target is a printer and a line of the table of exporters. They share the [`sheet`], the
//! functions of a model with the arrays that they read and write. There are two ways to walk it: as
//! loops ([`loops`]) and as operations on whole arrays ([`arrays`]). Nothing is scalarised.

mod arrays;
mod c;
mod casadi;
mod elements;
mod error;
mod fmu;
mod functions;
mod jacobian;
mod jax;
mod module;
mod origin;
mod python;
mod sheet;
mod spelling;

use std::str::FromStr;

use crate::compiled::CompiledModel;
use crate::json;
use crate::model::Model;

pub use elements::{Element, Families, Nominal};
pub use error::ExportError;
pub use fmu::{Package, Settings};
pub use origin::Origin;

/// Printer of the files of a target, the main file first.
type Print = fn(&Model, &Nominal<'_>, &Origin<'_>, &Settings) -> Result<Vec<String>, ExportError>;

/// Makes the targets of the table. A line has the name on the command line, the endings of the
/// files, the printer, and whether the files keep the past of delays. The first ending is that of
/// the main file.
macro_rules! exporters {
    ($($(#[$about:meta])* $target:ident: $name:literal, $endings:expr, $print:expr, $past:literal;)*) => {
        /// Target of an export.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Target {
            $($(#[$about])* $target,)*
        }

        impl Target {
            /// All of them with their names.
            pub const ALL: &[(&str, Target)] = &[$(($name, Target::$target)),*];

            /// Endings of the files that it makes, the first that of the file that is asked for.
            #[must_use]
            pub fn endings(self) -> &'static [&'static str] {
                match self {
                    $(Target::$target => &$endings,)*
                }
            }

            fn print(self) -> Print {
                match self {
                    $(Target::$target => $print,)*
                }
            }

            fn keeps_past(self) -> bool {
                match self {
                    $(Target::$target => $past,)*
                }
            }
        }
    };
}

exporters! {
    /// A Python module that builds CasADi functions.
    Casadi: "casadi", ["py"], |model, nominal, origin, _| Ok(vec![casadi::print(model, nominal, origin)?]), false;
    /// A Python module of pure functions for JAX.
    Jax: "jax", ["py"], |model, nominal, origin, _| Ok(vec![jax::print(model, nominal, origin)?]), false;
    /// C99 without dependencies: a source and its header.
    C: "c", ["c", "h"], |model, nominal, origin, _| c::print(model, nominal, origin), false;
    /// C99 of many instances at once with an integrator, which NVRTC compiles for a GPU.
    Kernel: "kernel", ["c"], |model, nominal, origin, settings| Ok(vec![fmu::kernel(model, nominal, origin, settings)?]), true;
    /// The checked model as a tree, with a schema.
    Json: "json", ["json"], |model, nominal, origin, _| Ok(vec![json::print(model, nominal, origin)?]), true;
    /// An archive for simulators, see [`package`].
    Fmu: "fmu", ["fmu"], |_, _, _, _| Err(ExportError::Archive), true;
}

impl Target {
    /// The names of all of them, for messages.
    #[must_use]
    pub fn names() -> String {
        Self::ALL.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
    }

    /// The name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, target)| *target == self).map_or("", |(name, _)| name)
    }
}

impl FromStr for Target {
    type Err = ExportError;

    fn from_str(name: &str) -> Result<Target, ExportError> {
        let found = Self::ALL.iter().find(|(known, _)| *known == name).map(|(_, target)| *target);
        found.ok_or_else(|| ExportError::UnknownTarget { name: name.to_owned(), known: Self::names() })
    }
}

/// A file of an export: what follows the name of the main one, and its text.
pub struct File {
    /// Ending without the dot.
    pub ending: &'static str,
    /// Content.
    pub text: String,
}

/// The files of a model in the form of a target; the first is the main one.
///
/// # Errors
/// See [`ExportError`].
pub fn export(
    model: &CompiledModel,
    nominal: &Nominal<'_>,
    origin: &Origin<'_>,
    settings: &Settings,
    target: Target,
) -> Result<Vec<File>, ExportError> {
    refuse_delays(model, target)?;
    let texts = target.print()(model.model(), nominal, origin, settings)?;
    Ok(target.endings().iter().zip(texts).map(|(ending, text)| File { ending, text }).collect())
}

/// Content of an FMU of a model without its binary.
///
/// # Errors
/// See [`ExportError`].
pub fn package(model: &CompiledModel, nominal: &Nominal<'_>, origin: &Origin<'_>, settings: &Settings) -> Result<Package, ExportError> {
    fmu::package(model.model(), nominal, origin, settings)
}

/// Refuses models with a past for targets that do not keep one.
fn refuse_delays(model: &CompiledModel, target: Target) -> Result<(), ExportError> {
    match model.model().delays.first() {
        Some(delay) if !target.keeps_past() => Err(ExportError::Delay { delay: delay.name.clone() }),
        _ => Ok(()),
    }
}
