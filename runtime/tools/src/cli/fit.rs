//! `smpl fit`: parameters from recorded runs. The work is done by the Python package, which this
//! command starts.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use clap::Args;

use super::report::Failed;

/// The module that does the work.
const MODULE: &str = "smpl.fit";

#[derive(Debug, Args)]
pub(super) struct FitArguments {
    /// Those of the Python command: FILE --data RUN.csv --parameters NAME,... ; --help lists all
    #[arg(value_name = "ARGUMENTS", trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<OsString>,
}

/// Starts the first Python that has the package, and ends as it does.
pub(super) fn run(arguments: &FitArguments) -> Result<(), Failed> {
    let (mut tried, mut found) = (Vec::new(), None);
    for python in interpreters() {
        if has_package(&python) {
            found = Some(python);
            break;
        }
        tried.push(python.display().to_string());
    }
    let Some(python) = found else { return Err(Failed::Message(missing(&tried))) };
    let status = Command::new(&python).arg("-m").arg(MODULE).args(&arguments.arguments).status();
    match status {
        Ok(status) if status.success() => Ok(()),
        // Python has reported the error.
        Ok(status) => Err(Failed::Quiet(status.code().unwrap_or(1))),
        Err(error) => Err(Failed::Message(format!("{} cannot be started: {error}", python.display()))),
    }
}

fn missing(tried: &[String]) -> String {
    format!(
        "smpl fit is done by the Python package `smpl-process`, which none of these has: {}; install it and SciPy there, or name a \
         Python that has them: SMPL_PYTHON=/path/to/python",
        tried.join(", ")
    )
}

/// Pythons in the order in which they are asked: the one named by `SMPL_PYTHON` alone; else that
/// next to this command, that of the active environment, those of the path.
fn interpreters() -> Vec<PathBuf> {
    if let Some(named) = std::env::var_os("SMPL_PYTHON") {
        return vec![named.into()];
    }
    let names = if cfg!(windows) { ["python.exe", "python3.exe"] } else { ["python3", "python"] };
    let beside = std::env::current_exe().ok().and_then(|own| Some(own.parent()?.to_owned()));
    let folder = if cfg!(windows) { "Scripts" } else { "bin" };
    let active = std::env::var_os("VIRTUAL_ENV").map(|root| PathBuf::from(root).join(folder));
    let there = [beside, active].into_iter().flatten().flat_map(|place| names.map(|name| place.join(name)));
    there.filter(|file| file.is_file()).chain(names.map(PathBuf::from)).collect()
}

/// Returns `true` if a Python finds the package, without loading it.
fn has_package(python: &PathBuf) -> bool {
    let ask = "import sys, importlib.util as u; sys.exit(u.find_spec('smpl') is None or u.find_spec('smpl.fit') is None)";
    let mut command = Command::new(python);
    command.args(["-c", ask]).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}
