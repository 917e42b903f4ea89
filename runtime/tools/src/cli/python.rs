//! Commands that start the Python package: `fit`, `export-policy`, `verify`, `serve`.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use clap::Args;

use super::report::Failed;

/// A command with its module.
#[derive(Clone, Copy, Debug)]
pub(super) struct PythonCommand {
    name: &'static str,
    module: &'static str,
}

/// Parameters from recorded runs.
pub(super) const FIT: PythonCommand = PythonCommand { name: "fit", module: "smpl.fit" };
/// Controllers and policies as C, ONNX or FMU.
pub(super) const EXPORT_POLICY: PythonCommand = PythonCommand { name: "export-policy", module: "smpl.deploy.export_command" };
/// Replay of recorded scores.
pub(super) const VERIFY: PythonCommand = PythonCommand { name: "verify", module: "smpl.deploy.verify_command" };
/// The plant behind OPC UA.
pub(super) const SERVE: PythonCommand = PythonCommand { name: "serve", module: "smpl.serve" };

#[derive(Debug, Args)]
pub(super) struct PythonArguments {
    /// Those of the Python command; --help lists all
    #[arg(value_name = "ARGUMENTS", trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<OsString>,
}

/// Starts the first Python that has the package, and ends as it does.
pub(super) fn run(command: PythonCommand, arguments: &PythonArguments) -> Result<(), Failed> {
    let (mut tried, mut found) = (Vec::new(), None);
    for python in interpreters() {
        if has_module(&python, command.module) {
            found = Some(python);
            break;
        }
        tried.push(python.display().to_string());
    }
    let Some(python) = found else { return Err(Failed::Message(missing(command.name, &tried))) };
    let status = Command::new(&python).arg("-m").arg(command.module).args(&arguments.arguments).status();
    match status {
        Ok(status) if status.success() => Ok(()),
        // Python has reported the error.
        Ok(status) => Err(Failed::Quiet(status.code().unwrap_or(1))),
        Err(error) => Err(Failed::Message(format!("{} cannot be started: {error}", python.display()))),
    }
}

fn missing(name: &str, tried: &[String]) -> String {
    let packages = if name == FIT.name { "it and SciPy" } else { "it" };
    format!(
        "smpl {name} is done by the Python package `smpl-process`, which none of these has: {}; install {packages} there, or name a \
         Python that has it: SMPL_PYTHON=/path/to/python",
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

/// Finds out if a Python has the package with a module, without loading the module.
fn has_module(python: &PathBuf, module: &str) -> bool {
    let ask = format!("import sys, importlib.util as u; sys.exit(u.find_spec('smpl') is None or u.find_spec('{module}') is None)");
    let mut command = Command::new(python);
    command.args(["-c", &ask]).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}
