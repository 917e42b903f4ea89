//! Arithmetic with units: all that it needs of the elaboration.

use smpl_dsl::diagnostic::Diagnostic;

use crate::elaborate::Elaborator;
use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::value::{Measure, Value};
use crate::ir::Exprs;

/// Nodes, and where faults go.
pub(in crate::elaborate) struct Values<'e> {
    /// The nodes.
    pub exprs: &'e mut Exprs,
    /// Faults.
    pub ledger: &'e mut Ledger,
}

impl Elaborator<'_> {
    /// What arithmetic needs.
    pub(in crate::elaborate) fn values(&mut self) -> Values<'_> {
        Values { exprs: &mut self.exprs, ledger: &mut self.ledger }
    }

    /// What stands where a fault was reported: it fits everywhere.
    pub(in crate::elaborate) fn poison(&mut self) -> Value {
        self.values().poison()
    }

    /// Reports a fault; poison.
    pub(in crate::elaborate) fn fault(&mut self, diagnostic: Diagnostic) -> Value {
        self.values().fault(diagnostic)
    }
}

impl Values<'_> {
    pub(in crate::elaborate) fn poison(&mut self) -> Value {
        Value { expr: self.exprs.constant(f64::NAN), unit: Measure::Poison }
    }

    pub(in crate::elaborate) fn fault(&mut self, diagnostic: Diagnostic) -> Value {
        self.ledger.report(diagnostic);
        self.poison()
    }
}
