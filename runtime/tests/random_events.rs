//! Random events by each method.
#![expect(clippy::duplicate_mod, reason = "the same cases by each method")]

#[path = "random_events/cases.rs"]
mod auto;
#[path = "random_events/cases.rs"]
mod ida;
#[path = "random_events/cases.rs"]
mod rosenbrock;
