//! `smpl import`

use std::path::PathBuf;

use clap::Args;

use super::report::{self, Failed};
use super::{outputs, say};
use crate::import::sbml;
use smpl_runtime::files::{plain, read_text, write_whole};

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  smpl import model.xml -o model.eq
  smpl import BIOMD0000000012.xml | less")]
pub(super) struct ImportArguments {
    /// Model in SBML, Level 2 or 3
    #[arg(value_name = "FILE.xml")]
    file: PathBuf,
    /// File of the model (default: standard output)
    #[arg(short, long, value_name = "OUT.eq")]
    output: Option<PathBuf>,
}

/// Writes a model of another form as text of the language.
pub(super) fn run(arguments: &ImportArguments) -> Result<(), Failed> {
    let file = arguments.file.display().to_string();
    let given = arguments.output.as_deref();
    outputs::check(&[given], [arguments.file.clone()].into_iter())?;
    let xml = read_text(&arguments.file).map_err(|error| Failed::Message(format!("{file}: {}", plain(&error))))?;
    let name = arguments.file.file_name().map_or_else(|| file.clone(), |name| name.to_string_lossy().into_owned());
    let imported = sbml(&xml, &name).map_err(|error| Failed::Message(format!("{file}: {error}")))?;
    if let Some(why) = &imported.without_units {
        report::note(&format!("note: units are in descriptions only: {why}\n"));
    }
    match &arguments.output {
        None => say(imported.text),
        Some(path) => {
            write_whole(path, |out| out.write_all(imported.text.as_bytes()))?;
            outputs::conclude(&format!("written to {}\n", path.display()), &[Some(path)])
        }
    }
}
