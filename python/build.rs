//! Copies the models into the output folder, from which the wheel takes them (`include` of
//! `pyproject.toml`).

use std::path::{Path, PathBuf};
use std::{env, fs, io};

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-changed=../models");
    let Some(out) = env::var_os("OUT_DIR") else {
        return Ok(());
    };
    let target = PathBuf::from(out).join("models");
    if target.exists() {
        fs::remove_dir_all(&target)?;
    }
    copy_models(Path::new("../models"), &target)
}

/// Copies model and scenario files, folder by folder.
fn copy_models(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let path = entry?.path();
        let Some(name) = path.file_name() else {
            continue;
        };
        if path.is_dir() {
            copy_models(&path, &to.join(name))?;
        } else if path.extension().is_some_and(|e| e == "eq" || e == "yaml") {
            fs::copy(&path, to.join(name))?;
        }
    }
    Ok(())
}
