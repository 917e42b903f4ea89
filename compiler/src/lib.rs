//! smpl-compiler: from the syntax tree to machine code.
//!
//! Text becomes a model that runs, pass by pass, each a module:
//!
//! 1. [`front`] parses the file and what it imports, and drives the next two;
//! 2. [`elaborate`]: names, units, shapes, spatial schemes; out come equations over indexed expressions ([`ir`]);
//! 3. [`structure`]: which equation determines which unknown; substitution; the flat [`model`];
//! 4. [`differentiate`], [`hoist`], [`layout`], [`generate`]: derivatives, caches, memory, machine code;
//! 5. [`compiled`]: the result, with [`interpret`] for what runs rarely; [`export`] writes it for other tools.

pub mod artefact;
pub mod compiled;
pub mod differentiate;
pub mod elaborate;
pub mod emit;
mod explicit_time;
pub mod export;
pub mod front;
pub mod generate;
pub mod hoist;
pub mod interpret;
pub mod ir;
pub mod kernels;
pub mod layout;
pub mod model;
pub mod structure;
