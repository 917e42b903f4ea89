//! Checks of unused declarations, and lints.

pub(in crate::elaborate) mod alternatives;
pub(in crate::elaborate) mod balances;
pub(in crate::elaborate) mod derivative;
pub(in crate::elaborate) mod lints;
pub(in crate::elaborate) mod unused;
