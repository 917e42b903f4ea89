//! smpl-compiler: from the syntax tree to machine code.
//!
//! Text becomes a model that runs, pass by pass, each a module:
//!
//! 1. [`read`] parses the file and what it imports;
//! 2. [`elaborate`]: names, units, shapes, spatial schemes; out come equations over indexed
//!    expressions ([`ir`]);
//! 3. [`structure`]: which equation determines which unknown; substitution; the flat [`model`];
//! 4. [`differentiate`]: rows and the entries of the Jacobian; [`explicit_time`]: where time occurs
//!    explicitly; [`switches`]: where equations change their form as unknowns move; [`enclose`]:
//!    bounds of root functions;
//! 5. [`schedule`]: what each function computes ([`functions`]) and in which loop; [`hoist`]: what
//!    can be known before it runs;
//! 6. [`layout`], [`generate`]: memory, machine code;
//! 7. [`compiled`]: the result, with [`interpret`] for what runs rarely; [`export`] writes it for
//!    other tools, [`json`] reads one of the forms back.
//!
//! [`verify`] checks the invariants of the flat model that each pass keeps.
//!
//! [`compile`] is the list of these passes.

#![warn(unreachable_pub)]

pub mod artefact;
pub mod compile;
pub mod compiled;
pub mod differentiate;
pub mod elaborate;
pub mod emit;
mod enclose;
mod explicit_time;
pub mod export;
mod functions;
pub(crate) mod generate;
pub mod graph;
pub(crate) mod hoist;
pub mod interpret;
pub mod ir;
pub mod json;
pub mod kernels;
pub mod layout;
pub mod model;
pub mod read;
pub mod schedule;
pub(crate) mod structure;
mod switches;
pub mod verify;
