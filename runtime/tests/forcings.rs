//! Terms that depend on time, by each method.
#![expect(clippy::duplicate_mod, reason = "the same cases by each method")]

#[path = "forcings/cases.rs"]
mod auto;
#[path = "forcings/cases.rs"]
mod ida;
#[path = "forcings/cases.rs"]
mod rosenbrock;
