//! Limits of the work that a model may cause.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;

/// Most terms, elements and calls that are unrolled in one model.
const MAX_WRITTEN_OUT: u32 = 1_000_000;

/// Most expressions that are elaborated in one model, those of attempts that fail included.
const MAX_WORK: u32 = 20_000_000;

/// Weight of a report in expressions: its text takes longer than they do.
const REPORT: u32 = 50;

/// Most nodes of the expressions of one model.
const MAX_NODES: usize = 4_000_000;

/// Deepest nest of expressions, definitions expanded; each level takes two kilobytes of stack.
const MAX_NESTING: u32 = 500;

/// Most members of all sets of numbers together: each has a label.
const MAX_MEMBERS: i64 = 2_000_000;

/// Most numbers that are observed or in boxes: each has a name.
const MAX_NAMED: usize = 1_000_000;

/// Used work.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Budget {
    /// Expressions inside one another, definitions expanded.
    nesting: u32,
    /// Members of sets of numbers so far.
    members: i64,
    /// Numbers that are observed or in boxes so far.
    named: usize,
    /// Terms, elements and calls unrolled so far.
    written_out: u32,
    /// Expressions elaborated so far.
    work: u32,
    /// Place where the limit was exceeded: nothing is elaborated or reported from there on.
    exhausted: Option<Span>,
    /// Set when the result is no longer needed.
    pub(in crate::elaborate) cancelled: Option<Arc<AtomicBool>>,
}

/// True if something may be unrolled.
pub(in crate::elaborate) enum Verdict {
    /// It may.
    Granted,
    /// It may not, which must be reported.
    Refused(Box<Diagnostic>),
    /// It may not, which was reported.
    Spent,
}

/// Returns `true` if so much work leaves nothing for more.
pub(in crate::elaborate) fn is_spent(work: u32) -> bool {
    work > MAX_WORK
}

impl Budget {
    /// Counts something that is unrolled: a term, an element, a call. Refused once if the model
    /// exceeds the budget. In an `attempt` to keep a loop the model is given up, since a pass that
    /// is too large for a loop is also too large without it.
    pub(in crate::elaborate) fn write_out(&mut self, span: Span, attempt: bool) -> Verdict {
        if self.exhausted.is_some() {
            return Verdict::Spent;
        }
        if self.written_out < MAX_WRITTEN_OUT {
            self.written_out += 1;
            return Verdict::Granted;
        }
        if attempt {
            self.give_up(span);
            return Verdict::Spent;
        }
        if self.written_out > MAX_WRITTEN_OUT {
            return Verdict::Spent;
        }
        self.written_out += 1;
        let fault = Diagnostic::error(codes::TOO_LARGE, "more than a million terms and elements would be written out", span);
        Verdict::Refused(Box::new(fault.help("use a `domain` instead of a large set: its cells stay a loop")))
    }

    /// From here on nothing is elaborated or reported.
    pub(in crate::elaborate) fn give_up(&mut self, span: Span) {
        self.exhausted.get_or_insert(span);
    }

    /// Returns `true` if one more expression may be elaborated, where there are so many nodes. What
    /// an attempt took is not given back.
    pub(in crate::elaborate) fn may_elaborate(&mut self, span: Span, nodes: usize) -> bool {
        self.work = self.work.saturating_add(1);
        let cancelled = || self.cancelled.as_ref().is_some_and(|flag| flag.load(Ordering::Relaxed));
        if self.work > MAX_WORK || nodes > MAX_NODES || self.work.is_multiple_of(256) && cancelled() {
            self.give_up(span);
        }
        self.exhausted.is_none()
    }

    /// Expressions elaborated so far, reports among them.
    pub(in crate::elaborate) fn work(&self) -> u32 {
        self.work
    }

    /// Begins where another elaboration has left off.
    pub(in crate::elaborate) fn begin_at(&mut self, work: u32) {
        self.work = work;
    }

    /// Counts a report; `false` if reports have ended.
    pub(in crate::elaborate) fn may_report(&mut self) -> bool {
        self.work = self.work.saturating_add(REPORT);
        self.exhausted.is_none()
    }

    /// Goes one level deeper; `false` where that is too deep.
    pub(in crate::elaborate) fn enter(&mut self) -> bool {
        let may = self.nesting < MAX_NESTING;
        self.nesting += u32::from(may);
        may
    }

    /// Comes back from where [`Self::enter`] led.
    pub(in crate::elaborate) fn leave(&mut self) {
        self.nesting -= 1;
    }

    /// Counts members of sets of numbers; `false` where they are beyond reason.
    pub(in crate::elaborate) fn may_hold(&mut self, members: i64) -> bool {
        self.members = self.members.saturating_add(members.max(0));
        self.members <= MAX_MEMBERS
    }

    /// Counts numbers that get a name each; `false` where they are beyond reason.
    pub(in crate::elaborate) fn may_name(&mut self, numbers: usize) -> bool {
        self.named = self.named.saturating_add(numbers);
        self.named <= MAX_NAMED
    }

    /// Returns `true` if nothing more may be unrolled.
    pub(in crate::elaborate) fn is_full(&self) -> bool {
        self.written_out > MAX_WRITTEN_OUT || self.exhausted.is_some()
    }

    /// Unrolled expressions so far.
    pub(in crate::elaborate) fn written_out(&self) -> u32 {
        self.written_out
    }

    /// Takes back what an attempt has unrolled.
    pub(in crate::elaborate) fn roll_back(&mut self, written_out: u32) {
        self.written_out = written_out;
    }

    /// Final message where the compiler stopped.
    pub(in crate::elaborate) fn fault(&self) -> Option<Diagnostic> {
        let span = self.exhausted.filter(|_| self.written_out <= MAX_WRITTEN_OUT)?;
        let fault = Diagnostic::error(codes::TOO_LARGE, "the model is too large: it has tens of millions of terms", span);
        Some(
            fault
                .label("so far the compiler came")
                .help("use a `domain` instead of a large set, and name with `let` what is used again and again"),
        )
    }
}
