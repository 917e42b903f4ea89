//! Failures by each method.
#![expect(clippy::duplicate_mod, reason = "the same cases by each method")]

#[path = "solver_failures/cases.rs"]
mod explicit;
#[path = "solver_failures/cases.rs"]
mod ida;
#[path = "solver_failures/cases.rs"]
mod rosenbrock;
