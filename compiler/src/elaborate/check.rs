//! What is wrong though nothing asks for it, and what is allowed but hardly meant.

pub(in crate::elaborate) mod alternatives;
pub(in crate::elaborate) mod derivative;
pub(in crate::elaborate) mod lints;
pub(in crate::elaborate) mod unused;
