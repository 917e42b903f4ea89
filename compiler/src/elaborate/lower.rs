//! Expressions: names, indices, calls, reductions and units, from the text to nodes.

pub(in crate::elaborate) mod binders;
pub(in crate::elaborate) mod builtins;
pub(in crate::elaborate) mod cells;
pub(in crate::elaborate) mod expression;
pub(in crate::elaborate) mod functions;
pub(in crate::elaborate) mod indices;
pub(in crate::elaborate) mod place;
pub(in crate::elaborate) mod random_and_tables;
pub(in crate::elaborate) mod ranges;
pub(in crate::elaborate) mod reductions;
pub(in crate::elaborate) mod units;
pub(in crate::elaborate) mod value;
pub(in crate::elaborate) mod values;
