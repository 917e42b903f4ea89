//! Links KLU: the system's shared library, or with the feature `vendored` the static ones. Sets a flag for the tests if the reference trajectories are there.

include!("references.rs");

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
