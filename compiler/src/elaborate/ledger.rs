//! Reports, used work, and data that may be undone.

use smpl_dsl::diagnostic::{Diagnostic, Faults, codes};
use smpl_dsl::span::Span;

use crate::elaborate::budget::{Budget, Verdict};
use crate::elaborate::expansions::Expansions;
use crate::elaborate::reports::Reports;
use crate::elaborate::speculation::{Speculation, Trace};
use crate::ir::ExprId;

/// Output of every part of elaboration.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Ledger {
    /// Faults and warnings.
    pub reports: Reports,
    /// Work that the model caused.
    pub budget: Budget,
    /// Attempts to keep ranges loops.
    pub speculation: Speculation,
    /// Expressions whose rates equations read, with their places.
    pub rated: Vec<(ExprId, Span)>,
}

impl Ledger {
    /// Reports a fault, unless it was reported or reports have ended.
    pub(in crate::elaborate) fn report(&mut self, diagnostic: Diagnostic) {
        if self.budget.may_report() {
            self.reports.report(diagnostic, self.speculation.is_active());
        }
    }

    /// Counts something that is unrolled: a term, an element, a call. `false` where the model is
    /// beyond reason, which is reported once.
    pub(in crate::elaborate) fn may_write_out(&mut self, span: Span) -> bool {
        match self.budget.write_out(span, self.speculation.is_active()) {
            Verdict::Granted => true,
            Verdict::Spent => false,
            Verdict::Refused(fault) => {
                self.report(*fault);
                false
            }
        }
    }

    /// Counts numbers that get a name each, for observations and messages; `false` where they are
    /// beyond reason, which is reported.
    pub(in crate::elaborate) fn may_name(&mut self, numbers: usize, span: Span) -> bool {
        let may = self.budget.may_name(numbers);
        if !may {
            let fault = Diagnostic::error(codes::TOO_LARGE, "more than a million numbers would be observed or be in boxes", span);
            self.report(fault.label("each of them has a name").help("name single cells, or what is computed from them"));
        }
        may
    }

    pub(in crate::elaborate) fn missing_value(&mut self, what: &str, span: Span) {
        self.report(
            Diagnostic::error(codes::MISSING_DEFAULT, format!("{what} must be known when the model is compiled"), span)
                .label("depends on something that is not"),
        );
    }

    /// Warnings, where there are no faults.
    pub(in crate::elaborate) fn closed(mut self) -> Result<Faults, Faults> {
        self.budget.fault().into_iter().for_each(|fault| self.reports.diagnostics.push(fault));
        self.reports.name_calls();
        self.reports.diagnostics.sort();
        if self.reports.has_errors() { Err(self.reports.diagnostics) } else { Ok(self.reports.diagnostics) }
    }

    /// State before an attempt that may be undone.
    pub(in crate::elaborate) fn trace(&self) -> Trace {
        self.speculation.trace(&self.reports, &self.budget)
    }

    /// Removes what was left since.
    pub(in crate::elaborate) fn roll_back(&mut self, to: Trace, expansions: &mut Expansions) {
        self.speculation.roll_back(to, &mut self.reports, &mut self.budget, expansions);
    }
}
