//! smpl-compiler
