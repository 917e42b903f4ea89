//! Names of elementary functions in the language of an export.

use crate::ir::UnaryFn;

/// Name of an elementary function in a language.
pub(super) struct Spelling {
    /// The function; empty where the language writes nothing.
    pub name: &'static str,
    /// Its definition, where the language does not have it.
    pub definition: &'static str,
}

/// Names of all elementary functions in a language.
pub(super) type Spellings = fn(UnaryFn) -> Spelling;

impl Spelling {
    /// A function that the language has, or that other parts of an export define.
    pub(super) const fn known(name: &'static str) -> Spelling {
        Spelling { name, definition: "" }
    }

    /// The function of an operand; operators have no parentheses.
    pub(super) fn applied(&self, operand: &str) -> String {
        let is_operator = self.name.ends_with(['-', ')']);
        if is_operator { format!("{}{operand}", self.name) } else { format!("{}({operand})", self.name) }
    }
}

/// Definitions of the functions that a language does not have.
pub(super) fn definitions(spellings: Spellings) -> String {
    let texts = UnaryFn::ALL.iter().map(|&f| spellings(f).definition);
    texts.filter(|text| !text.is_empty()).map(|text| format!("\n{text}")).collect()
}
