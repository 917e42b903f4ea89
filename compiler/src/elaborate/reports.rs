//! Reported faults, each once.

use std::cell::Cell;
use std::collections::BTreeSet;

use smpl_dsl::diagnostic::{Code, Diagnostic, Faults, Label, Severity, codes, did_you_mean};
use smpl_dsl::span::Span;

use crate::ir::{FastMap, FastSet};

/// Most names that are compared with unknown ones.
const MAX_COMPARED: usize = 3_000_000;

/// Code and place of a fault, and its message where calls lead there.
type Reported = (Code, Span, Option<String>);

/// Diagnostics, and the keys that distinguish new ones from reported ones.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Reports {
    /// All of them.
    pub diagnostics: Faults,
    /// Calls of functions that are being expanded.
    pub calls: Vec<Span>,
    /// The equation that is being elaborated.
    pub statement: Span,
    reported: FastSet<Reported>,
    /// Calls through which the places of faults in functions were reached.
    reached_by: FastMap<Reported, BTreeSet<Span>>,
    /// Index names reported as not bound, by statement.
    unbound: FastSet<(Span, String)>,
    /// Additions to `reported` and `unbound` since the outermost attempt began.
    recent: Vec<Reported>,
    recent_unbound: Vec<(Span, String)>,
    /// Names that were compared with unknown ones so far.
    compared: Cell<usize>,
}

/// Amount before an attempt.
#[derive(Clone, Copy, Debug)]
pub(in crate::elaborate) struct Mark {
    diagnostics: usize,
    recent: usize,
    unbound: usize,
}

impl Reports {
    /// Returns `true` if there is an error.
    pub(in crate::elaborate) fn has_errors(&self) -> bool {
        self.diagnostics.iter().any(|d| d.severity == Severity::Error)
    }

    /// Reports a fault once: the same fault at the same place, met again in another cell, instance
    /// or call, is not repeated. What is reported in an `attempt` may be taken back.
    pub(in crate::elaborate) fn report(&mut self, diagnostic: Diagnostic, attempt: bool) {
        let call = self.calls.first().copied().filter(|c| !c.contains(diagnostic.primary.span));
        let key = reported(&diagnostic, call.is_some());
        if let Some(call) = call {
            self.reached_by.entry(key.clone()).or_default().insert(call);
        }
        if self.reported.insert(key.clone()) {
            if attempt {
                self.recent.push(key);
            }
            self.diagnostics.push(diagnostic);
        }
    }

    /// Reports a fault of a name that was asked for. Several may share the place (none): their text
    /// distinguishes them.
    pub(in crate::elaborate) fn scenario_fault(&mut self, name: &str, message: String, help: Option<String>) {
        self.diagnostics.push(scenario_fault(name, message, help));
    }

    /// Returns `true` if an index name that is not bound is met for the first time in the present
    /// statement.
    pub(in crate::elaborate) fn is_first_unbound(&mut self, name: &str, attempt: bool) -> bool {
        if self.statement == Span::default() {
            return true;
        }
        let key = (self.statement, name.to_owned());
        let first = self.unbound.insert(key.clone());
        if first && attempt {
            self.recent_unbound.push(key);
        }
        first
    }

    /// Shows with faults in functions the calls that led there: of many, the first.
    pub(in crate::elaborate) fn name_calls(&mut self) {
        for diagnostic in self.diagnostics.iter_mut() {
            let Some(calls) = self.reached_by.get(&reported(diagnostic, true)) else { continue };
            diagnostic.secondary.extend(calls.first().map(|&span| Label { span, text: "in this call".to_owned() }));
            match calls.len() - 1 {
                0 => {}
                1 => diagnostic.notes.push("another call leads here too".to_owned()),
                more => diagnostic.notes.push(format!("{more} more calls lead here")),
            }
        }
    }

    /// Returns `true` if one more diagnostic would be shown, so that a search for suggestions is
    /// worth its time.
    pub(in crate::elaborate) fn may_suggest(&self) -> bool {
        self.diagnostics.has_room() && self.compared.get() < MAX_COMPARED
    }

    /// "did you mean `k_0`?", where that would be shown.
    pub(in crate::elaborate) fn did_you_mean<'n>(&self, name: &str, known: impl IntoIterator<Item = &'n str>) -> Option<String> {
        let count = |_: &&str| self.compared.set(self.compared.get() + 1);
        if self.may_suggest() { did_you_mean(name, known.into_iter().inspect(count)) } else { None }
    }

    /// Amount.
    pub(in crate::elaborate) fn mark(&self) -> Mark {
        Mark { diagnostics: self.diagnostics.len(), recent: self.recent.len(), unbound: self.recent_unbound.len() }
    }

    /// Returns `true` if nothing was reported since.
    pub(in crate::elaborate) fn is_unchanged(&self, since: Mark) -> bool {
        self.diagnostics.len() == since.diagnostics
    }

    /// Takes back what an attempt has reported.
    pub(in crate::elaborate) fn roll_back(&mut self, to: Mark) {
        self.diagnostics.truncate(to.diagnostics);
        for key in self.recent.drain(to.recent..) {
            self.reported.remove(&key);
        }
        for key in self.recent_unbound.drain(to.unbound..) {
            self.unbound.remove(&key);
        }
    }

    /// Nothing can be taken back any more.
    pub(in crate::elaborate) fn commit(&mut self) {
        self.recent.clear();
        self.recent_unbound.clear();
    }
}

/// Key of a reported fault: in a function, where each call may have its own faults, the message
/// belongs to it.
fn reported(diagnostic: &Diagnostic, in_call: bool) -> Reported {
    (diagnostic.code, diagnostic.primary.span, in_call.then(|| diagnostic.message.clone()))
}

/// A fault of a requested name, which has no place in a text.
pub(in crate::elaborate) fn scenario_fault(name: &str, message: String, help: Option<String>) -> Diagnostic {
    Diagnostic::error(codes::BAD_SCENARIO, message, Span::default()).maybe_help(help).asked(name)
}
