//! `smpl export`

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

use clap::Args;
use smpl_compiler::export::{File, Target};

use super::report::Failed;
use super::{ModelArguments, outputs, say};
use crate::export::{export, export_fmu};
use smpl_runtime::files::{is_standard_output, write_whole};
use smpl_runtime::load;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  smpl export models/reactor.eq --to json -o reactor.json
  smpl export models/reactor.eq --to c -o reactor.c
  smpl export models/mab.eq --to casadi --scenario legacy -o mab_casadi.py
  smpl export models/pensim.eq --to fmu -o pensim.fmu")]
pub(super) struct ExportArguments {
    /// Model
    #[arg(value_name = "FILE.eq")]
    file: PathBuf,
    #[arg(long, value_name = "TARGET", value_parser = target, help = format!("The form: {}", Target::names()))]
    to: Target,
    #[command(flatten)]
    model: ModelArguments,
    /// Output file; further files of the form are next to it (default: standard output)
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// Most internal steps within the dead times of `delay(...)`, in an FMU (default: 10000) or
    /// kernel (default: 500)
    #[arg(long, value_name = "N")]
    history: Option<NonZeroU32>,
}

fn target(name: &str) -> Result<Target, String> {
    name.parse().map_err(|error: smpl_compiler::export::ExportError| error.to_string())
}

/// Writes all files of an export, or none.
pub(super) fn run(arguments: &ExportArguments) -> Result<(), Failed> {
    let paths = match &arguments.output {
        Some(main) => paths(main, arguments.to)?,
        None => vec![],
    };
    let given = || paths.iter().map(|path| Some(path.as_path())).collect::<Vec<_>>();
    outputs::check(&given(), load::files_of(&arguments.file).into_iter())?;
    let loaded = arguments.model.load(&arguments.file)?;
    outputs::check(&given(), outputs::names(&loaded.sources).chain([arguments.file.clone()]))?;
    if let (Target::Fmu, Some(main)) = (arguments.to, &arguments.output) {
        return write_fmu(&loaded, main, arguments.history);
    }
    let stem = arguments.output.as_ref().and_then(|path| path.file_stem()?.to_str());
    let files = export(&loaded, arguments.to, stem, arguments.history).map_err(|error| Failed::Message(error.to_string()))?;
    write(&files, &paths)
}

/// Writes an archive; says so where it has no binary.
fn write_fmu(loaded: &load::Loaded, main: &Path, history: Option<NonZeroU32>) -> Result<(), Failed> {
    let fmu = export_fmu(loaded, true, history).map_err(|error| Failed::Message(error.to_string()))?;
    write_whole(main, |out| out.write_all(&fmu.bytes))?;
    let binary = fmu.without_binary.map_or_else(String::new, |why| format!("; it holds sources only and no binary: {why}"));
    outputs::conclude(&format!("written to {}{binary}\n", main.display()), &[Some(main)])
}

fn write(files: &[File], paths: &[PathBuf]) -> Result<(), Failed> {
    let Some(main) = paths.first() else {
        return say(files.iter().map(|file| file.text.as_str()).collect::<String>());
    };
    // The main file last: where it is, all are.
    for (file, path) in files.iter().zip(paths).rev() {
        write_whole(path, |out| out.write_all(file.text.as_bytes()))?;
    }
    let written = paths.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ");
    outputs::conclude(&format!("written to {written}\n"), &[Some(main)])
}

/// The main file and those next to it.
fn paths(main: &Path, target: Target) -> Result<Vec<PathBuf>, Failed> {
    let endings = target.endings();
    if endings.len() == 1 {
        return Ok(vec![main.to_owned()]);
    }
    if is_standard_output(main) || main.extension().is_none_or(|ending| ending != endings[0]) {
        let (name, main) = (target.name(), main.display());
        return Err(Failed::Message(format!("`--to {name}` makes several files: name the first one `NAME.{}`, not {main}", endings[0])));
    }
    Ok(endings.iter().map(|ending| main.with_extension(ending)).collect())
}
