//! Tells the tests whether the reference trajectories are there.

include!("../references.rs");

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    tell_of_references();
}
