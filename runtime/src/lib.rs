//! smpl-runtime
