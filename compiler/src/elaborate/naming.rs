//! Looking up names: the symbols, and where faults go.

use crate::elaborate::ledger::Ledger;
use crate::elaborate::symbols::Symbols;

/// All that looking up needs.
pub(in crate::elaborate) struct Naming<'n, 'a> {
    /// The symbols.
    pub symbols: &'n Symbols<'a>,
    /// Faults.
    pub ledger: &'n mut Ledger,
}
