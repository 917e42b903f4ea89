//! Ends of domains, once they were worked out.

use smpl_dsl::units::Unit;

use crate::elaborate::symbols::DomainId;
use crate::ir::{ExprId, FastMap};

/// Unit and values of both ends.
pub(in crate::elaborate) type Ends = (Unit, ExprId, ExprId);

/// Of each domain that something asked for.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Grids {
    ends: FastMap<DomainId, Ends>,
}

impl Grids {
    /// The ends of a domain.
    pub(crate) fn ends(&self, domain: DomainId) -> Option<&Ends> {
        self.ends.get(&domain)
    }

    /// Notes them.
    pub(crate) fn set(&mut self, domain: DomainId, ends: Ends) {
        self.ends.insert(domain, ends);
    }
}
