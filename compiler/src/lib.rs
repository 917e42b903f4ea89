//! smpl-compiler: from the syntax tree to machine code.

pub mod elaborate;
pub mod front;
pub mod ir;
pub mod model;
pub mod structure;
