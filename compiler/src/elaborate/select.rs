//! From files to one list of statements: imports, variants, choices. Pure functions of what was
//! read and asked for.

pub(in crate::elaborate) mod imports;
pub(in crate::elaborate) mod items;
pub(in crate::elaborate) mod variants;

use std::collections::HashMap;

use smpl_dsl::syntax;

use crate::elaborate::options::Options;
use crate::read::Data;
use items::Selection;

/// Statements to elaborate.
pub(in crate::elaborate) struct Input<'a> {
    /// The main file, and what it imports.
    pub files: &'a [syntax::File],
    /// File of a `use "path"`.
    pub imports: &'a HashMap<String, usize>,
    /// Files of data by their paths.
    pub data: &'a Data,
    /// Options in addition to the text.
    pub options: &'a Options,
    /// Variants and choices in force.
    pub selection: Selection,
}
