//! smpl-dsl: the text of a model. Grammar, syntax tree with spans, diagnostics, formatter, units of
//! measure.

#![warn(unreachable_pub)]

pub mod diagnostic;
pub mod format;
pub mod latex;
mod layout;
mod parse;
pub mod span;
pub mod stack;
pub mod syntax;
pub mod units;
pub mod words;

pub use parse::{Parsed, parse, parse_unit};
