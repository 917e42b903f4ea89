//! smpl-compiler: from the syntax tree to machine code.

pub mod elaborate;
pub mod ir;
pub mod model;
