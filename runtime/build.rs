//! Links KLU: the system's shared library, or with the feature `vendored` the static ones. Tells the tests whether the reference trajectories are there.

use std::path::PathBuf;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    // sundials-sys declares KLU's functions but leaves the linking to SUNDIALS' own KLU module, which is not used.
    match std::env::var_os("CARGO_FEATURE_VENDORED") {
        None => println!("cargo:rustc-link-lib=klu"),
        Some(_) => {
            for library in ["klu", "amd", "colamd", "btf", "suitesparseconfig"] {
                println!("cargo:rustc-link-lib=static:-bundle={library}");
            }
        }
    }
    tell_of_references();
}

/// `cfg(references)`: without them the tests that need them are ignored, not passed.
fn tell_of_references() {
    println!("cargo:rustc-check-cfg=cfg(references)");
    println!("cargo:rerun-if-env-changed=SMPL_REFERENCE");
    let beside = || PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default()).join("../../shared/reference");
    if std::env::var_os("SMPL_REFERENCE").map_or_else(beside, PathBuf::from).is_dir() {
        println!("cargo:rustc-cfg=references");
    }
}
