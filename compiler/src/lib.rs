//! smpl-compiler: from the syntax tree to machine code.

pub mod elaborate;
pub mod front;
pub mod compiled;
pub mod differentiate;
pub mod generate;
pub mod hoist;
pub mod interpret;
pub mod ir;
pub mod kernels;
pub mod layout;
pub mod model;
pub mod structure;
