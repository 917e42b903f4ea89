//! Attempts to keep a range of numbers a loop: begun, then committed or rolled back without a
//! trace.

use super::budget::Budget;
use super::expansions::{Expansion, Expansions};
use super::lower::reads::Reads;
use super::reports::{Mark, Reports};

/// Most passes of all loops over ranges together: more are refused, since an evaluation would take
/// too long, and unrolled loops take longer.
const MOST_PASSES: i64 = 20_000_000;

/// The state of attempts.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Speculation {
    /// Ranges of numbers may stay loops.
    pub enabled: bool,
    /// A range stayed a loop.
    pub looped: bool,
    /// Passes of such loops.
    passes: i64,
    /// Attempts, one inside another.
    depth: u32,
    /// The present attempt asked for more than a loop can give.
    refused: bool,
    /// Expansions made since the outermost attempt began.
    remembered: Vec<Expansion>,
    /// Reads of tables that are refused outside of their points.
    pub reads: Reads,
}

/// Data that an attempt may change.
#[derive(Clone, Copy, Debug)]
pub(in crate::elaborate) struct Trace {
    reports: Mark,
    written_out: u32,
    passes: i64,
    remembered: usize,
    reads: usize,
    refused: bool,
}

impl Speculation {
    /// Returns `true` if something is being attempted.
    pub(in crate::elaborate) fn is_active(&self) -> bool {
        self.depth > 0
    }

    /// Counts the passes of one more loop; `false` where they are too many.
    pub(in crate::elaborate) fn may_loop(&mut self, passes: i64) -> bool {
        self.passes = self.passes.saturating_add(passes);
        self.passes <= MOST_PASSES
    }

    /// Notes that the range of the present attempt has to be unrolled.
    pub(in crate::elaborate) fn refuse(&mut self) {
        self.refused = true;
    }

    /// State before an attempt that may be undone.
    pub(in crate::elaborate) fn trace(&self, reports: &Reports, budget: &Budget) -> Trace {
        Trace {
            reports: reports.mark(),
            written_out: budget.written_out(),
            passes: self.passes,
            remembered: self.remembered.len(),
            reads: self.reads.list.len(),
            refused: self.refused,
        }
    }

    /// Begins an attempt.
    pub(in crate::elaborate) fn begin(&mut self) {
        self.refused = false;
        self.depth += 1;
    }

    /// Enters something that may be forgotten, without its own verdict.
    pub(in crate::elaborate) fn enter(&mut self) {
        self.depth += 1;
    }

    /// Ends an attempt or what [`Self::enter`] entered.
    pub(in crate::elaborate) fn end(&mut self) {
        self.depth -= 1;
    }

    /// Returns `true` if an attempt that has ended gave what was wanted.
    pub(in crate::elaborate) fn succeeded(&self, since: &Trace, reports: &Reports) -> bool {
        !self.refused && reports.is_unchanged(since.reports)
    }

    /// Notes an expansion that an attempt made.
    pub(in crate::elaborate) fn remember(&mut self, expansion: &Expansion) {
        if self.is_active() {
            self.remembered.push(expansion.clone());
        }
    }

    /// Keeps what an attempt has made.
    pub(in crate::elaborate) fn commit(&mut self, since: &Trace, reports: &mut Reports) {
        self.refused = since.refused;
        self.looped = true;
        self.settle(reports);
    }

    /// Outside of all attempts nothing has to be taken back any more.
    pub(in crate::elaborate) fn settle(&mut self, reports: &mut Reports) {
        if self.depth == 0 {
            self.remembered.clear();
            reports.commit();
        }
    }

    /// Removes what was left since.
    pub(in crate::elaborate) fn roll_back(&mut self, to: Trace, reports: &mut Reports, budget: &mut Budget, expansions: &mut Expansions) {
        reports.roll_back(to.reports);
        budget.roll_back(to.written_out);
        self.passes = to.passes;
        self.refused = to.refused;
        self.reads.list.truncate(to.reads);
        for key in self.remembered.drain(to.remembered..) {
            expansions.forget(&key);
        }
    }
}
