// Shared by the build scripts of `runtime` and `runtime/tools`: tells tests of the reference trajectories.

/// Sets `cfg(references)` where the reference trajectories are installed: without them the tests that need them are ignored, not passed.
/// `SMPL_REFERENCE` names their folder.
fn tell_of_references() {
    println!("cargo:rustc-check-cfg=cfg(references)");
    println!("cargo:rerun-if-env-changed=SMPL_REFERENCE");
    let manifest = std::path::PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let beside = manifest.ancestors().skip(1).map(|folder| folder.join("../shared/reference")).find(|folder| folder.is_dir());
    let named = std::env::var_os("SMPL_REFERENCE").map(std::path::PathBuf::from);
    if let Some(folder) = named.or(beside).filter(|folder| folder.is_dir()) {
        println!("cargo:rustc-cfg=references");
        println!("cargo:rustc-env=SMPL_REFERENCE_FOLDER={}", folder.display());
    }
}
