//! SUNDIALS' objects as values that own them: its context, and IDA's memory with everything that
//! IDA holds the address of.
//!
//! Raw pointers to these objects are made and freed here and nowhere else; what the rest of the
//! solver does with them is safe. Vectors have a separate file ([`vector`](super::vector)).

mod check;
mod context;
mod inquiry;
mod lent;
mod memory;

pub(crate) use check::check;
pub(crate) use context::Context;
pub(crate) use inquiry::Inquiry;
pub(crate) use lent::{Kept, Lent};
pub(crate) use memory::{IdaCounts, Memory, Task};
