//! Functional Mock-up Units: the archive, with a binary for this machine where a C compiler is
//! found.

use std::process::Command;

use smpl_compiler::export::Package;

use super::archive;

/// An FMU.
pub struct Fmu {
    /// The archive.
    pub bytes: Vec<u8>,
    /// Reason why it has no binary, if it has none.
    pub without_binary: Option<String>,
}

/// Packs an FMU; `compile` is whether to make a binary.
pub(super) fn pack(package: Package, compile: bool) -> Fmu {
    let binary = if compile { build(&package) } else { Err("none was asked for".to_owned()) };
    let mut files: Vec<(String, Vec<u8>)> = package.files.into_iter().map(|(path, text)| (path, text.into_bytes())).collect();
    let without_binary = match binary {
        Ok(bytes) => {
            files.push((format!("binaries/x86_64-linux/{}.so", package.identifier), bytes));
            None
        }
        Err(why) => Some(why),
    };
    Fmu { bytes: archive::zip(&files), without_binary }
}

/// The shared library of the sources.
fn build(package: &Package) -> Result<Vec<u8>, String> {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        return Err("binaries are made on Linux on x86_64 only".into());
    }
    let compiler = std::env::var("CC").ok().filter(|name| !name.trim().is_empty()).unwrap_or_else(|| "cc".into());
    let folder = tempfile::tempdir().map_err(|error| format!("no temporary folder: {error}"))?;
    let mut sources = vec![];
    for (path, text) in &package.files {
        let Some(name) = path.strip_prefix("sources/") else { continue };
        std::fs::write(folder.path().join(name), text).map_err(|error| format!("cannot write the sources: {error}"))?;
        if name.ends_with(".c") {
            sources.push(name.to_owned());
        }
    }
    // Without contractions the binary computes what the machine code computes.
    let flags = ["-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-o", "model.so"];
    let done = Command::new(&compiler).current_dir(folder.path()).args(flags).args(&sources).arg("-lm").output();
    match done {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Err(format!("there is no C compiler `{compiler}`")),
        Err(error) => Err(format!("the C compiler `{compiler}` does not run: {error}")),
        Ok(output) if !output.status.success() => {
            let text = String::from_utf8_lossy(&output.stderr);
            let first = text.lines().find(|line| line.contains("error")).unwrap_or_default();
            Err(format!("the C compiler `{compiler}` refuses the sources: {first}"))
        }
        Ok(_) => std::fs::read(folder.path().join("model.so")).map_err(|error| format!("the C compiler made no file: {error}")),
    }
}
