//! Python module `smpl._native`.
