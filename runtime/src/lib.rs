//! smpl-runtime: compiled models in motion.
//!
//! [`solver`] integrates; [`environment`] turns a compiled model into episodes with actions,
//! rewards and failures. [`batch`] runs many instances on several threads, [`rollout`] many action
//! sequences from given states; [`sensitivity`] differentiates steps. [`steady`], [`linearize`] and
//! [`spectrum`] find and describe points of rest; [`start`] solves for the start of an episode.
//! [`trajectory`] reads and writes tables, [`files`] writes anything; [`load`] goes from a file to
//! a model ready to run; [`parameters`] resolves given values; [`interrupt`] stops long
//! computations.
//!
//! What all instances share is a [`setup::Setup`]; what changes is an [`environment::Environment`].

#![warn(unreachable_pub)]

pub mod batch;
pub mod catalogue;
pub mod diagnose;
pub mod environment;
pub mod failure;
pub mod files;
pub mod interrupt;
mod inverse;
pub mod linearize;
pub mod load;
mod newton;
pub mod observe;
pub mod parameters;
pub mod past;
pub mod pool;
pub mod random;
pub mod rollout;
pub mod rules;
pub mod scenario;
pub mod sensitivity;
pub mod setup;
pub mod solver;
pub mod spectrum;
pub mod start;
pub mod steady;
pub mod system;
pub mod trajectory;
