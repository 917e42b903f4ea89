//! Events by each method.
#![expect(clippy::duplicate_mod, reason = "the same cases by each method")]

#[path = "events/cases.rs"]
mod auto;
#[path = "events/cases.rs"]
mod ida;
#[path = "events/cases.rs"]
mod rosenbrock;
