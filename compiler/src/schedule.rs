//! From what a model does to the order in which it is computed.
//!
//! The passes before write expressions over loops; here they become the functions of the back end.
//! A [`Staged`] is what one function does, made of programs, rows and entries of the Jacobian.
//! Stores that differ only in their addresses are [`rerolled`](reroll) into loops. Then each node
//! is placed in a loop: the [`Schedule`], which the interpreter and the code generator walk alike.

mod blocks;
mod jacobian;
mod reroll;
mod staged;

pub use blocks::{Access, Block, BlockId, Item, Schedule, ScheduleError};
pub(crate) use blocks::{is_immediate, schedules};
pub(crate) use jacobian::of_entries;
pub(crate) use reroll::reroll;
pub use staged::Staged;
pub(crate) use staged::row_major;
