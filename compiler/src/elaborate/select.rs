//! From files to one list of statements: imports, variants, choices. Pure functions of what was read and asked for.

pub(in crate::elaborate) mod imports;
pub(in crate::elaborate) mod items;
pub(in crate::elaborate) mod variants;
