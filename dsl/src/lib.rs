//! smpl-dsl: the text of a model. Grammar, syntax tree with spans, diagnostics, formatter, units of measure.

pub mod span;
pub mod syntax;
