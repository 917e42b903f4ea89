//! The checked model as JSON, both ways, in the form that `docs/schema/model-3.schema.json` fixes.
//!
//! Expressions are one list of nodes, operands before users: trees whose repeated parts are written
//! once. Loops stay loops. The text holds all that the back end needs: [`read`] returns the flat
//! model that [`print`] wrote. It compiles to the same functions and is written again as the same
//! bytes. [`read`] believes nothing: whatever a text holds, it gives a model that the passes behind
//! it can take, or an error that names the place.

mod bounds;
mod cursor;
mod interface;
mod nodes;
mod read;
mod words;
mod write;

pub use cursor::ReadError;
pub use read::{Read, read};
pub(crate) use write::print;

/// Version of the form; what changes the meaning of a file counts it up.
pub const VERSION: u32 = 3;

/// Value of the field `format`.
const FORMAT: &str = "smpl-model";
