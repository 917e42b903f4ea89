//! Declaring and looking up names: all that it needs of the elaboration.

use crate::elaborate::Elaborator;
use crate::elaborate::declare::symbols::Symbols;
use crate::elaborate::ledger::Ledger;

/// The symbols, and where faults go.
pub(in crate::elaborate) struct Naming<'n, 'a> {
    /// The symbols.
    pub symbols: &'n mut Symbols<'a>,
    /// Faults.
    pub ledger: &'n mut Ledger,
}

impl<'a> Elaborator<'a> {
    /// What declaring and looking up needs.
    pub(in crate::elaborate) fn naming(&mut self) -> Naming<'_, 'a> {
        Naming { symbols: &mut self.symbols, ledger: &mut self.ledger }
    }
}
