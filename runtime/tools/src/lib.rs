//! smpl-tools: the command `smpl` and the documents, pictures and files that it makes.
//!
//! [`cli`] is the command. [`picture`] draws trajectories, [`export`] writes models for other
//! tools, [`import`] reads models of other tools, [`lsp`] serves editors.

#![warn(unreachable_pub)]

pub mod cli;
pub(crate) mod document;
pub mod export;
pub(crate) mod import;
pub mod lint;
pub(crate) mod live;
pub mod lsp;
pub mod picture;
pub(crate) mod policy;
pub(crate) mod reduction;
pub(crate) mod sweep;
pub(crate) mod trial;
