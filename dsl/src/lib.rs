//! smpl-dsl
