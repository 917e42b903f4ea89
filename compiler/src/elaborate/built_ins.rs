//! Declarations that take the place of built-in names.
//!
//! Declared names precede built-in ones, so that a model may call a parameter `n`. The built-in
//! meaning is then hidden in the scope of the declaration, with a report.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Ident, Statement, StatementKind, TimeTable};

use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::builtins;
use crate::elaborate::select::items::Item;

/// Names that stand for something without being declared, what that is, and another way to write
/// it.
const NAMES: &[(&str, &str, Option<&str>)] = &[
    ("pi", "the ratio of a circle's circumference to its diameter", Some("acos(-1)")),
    ("e", "Euler's number", Some("exp(1)")),
    ("inf", "infinity", None),
    ("n", "the number of completed steps", None),
    ("step", "the sampling interval", None),
    ("clock", "the time since the start of the episode", None),
    ("success", "whether the step ended in success", None),
    ("failure", "whether the step ended in failure", None),
    ("timeout", "whether the step was the last one", None),
    ("reward", "the chosen reward", None),
    ("error_reward", "the reward of a failing step", None),
    ("states", "all states", None),
    ("actions", "all actions", None),
    ("observations", "all observations", None),
    ("phase_time", "the time since the phase began", None),
];

/// Names that are built in, with their meanings.
pub fn built_in_names() -> impl Iterator<Item = (&'static str, &'static str)> {
    NAMES.iter().map(|(name, meaning, _)| (*name, *meaning))
}

fn built_in(name: &str) -> Option<&'static (&'static str, &'static str, Option<&'static str>)> {
    NAMES.iter().find(|(n, ..)| *n == name)
}

/// Returns `true` if a name or a function of that name is built in.
#[must_use]
pub fn is_built_in(name: &str) -> bool {
    built_in(name).is_some() || builtins::find(name).is_some()
}

/// Note of a fault if a declared name is used like a built-in one.
pub(in crate::elaborate) fn note(diagnostic: Diagnostic, name: &str) -> Diagnostic {
    match built_in(name) {
        Some((_, meaning, _)) => diagnostic.note(format!("the declaration takes the place of the built-in name for {meaning}")),
        None => diagnostic,
    }
}

impl Ledger {
    /// Refuses units with the name of something built in: `value(x, pi)` would have two meanings.
    pub(in crate::elaborate) fn check_unit_names(&mut self, list: &[Item<'_>]) {
        for item in list {
            let Item::Other(Statement { kind: StatementKind::Unit { name, .. }, .. }) = item else { continue };
            if is_built_in(&name.text) {
                let message = format!("`{}` is a built-in name and cannot be a unit", name.text);
                self.report(Diagnostic::error(codes::DUPLICATE_NAME, message, name.span).help("choose another symbol"));
            }
        }
    }

    /// Warns of declarations of a block that take the place of built-in names. An array and other
    /// values do not: without an index they are faults with their own reports.
    pub(in crate::elaborate) fn check_built_ins(&mut self, list: &[Item<'_>]) {
        for item in list {
            match item {
                Item::Declare(_, d) if d.indices.is_empty() => self.warn_of_name(&d.name),
                Item::Other(statement) => match &statement.kind {
                    StatementKind::Time { name, .. } => self.warn_of_name(name),
                    StatementKind::Def { name, .. } | StatementKind::TimeTable(TimeTable { name, .. }) => self.warn_of_function(name),
                    _ => {}
                },
                _ => {}
            }
        }
    }

    /// A name of another kind hides no function: `min` by itself and `min(a, b)` are distinct.
    pub(in crate::elaborate) fn warn_of_name(&mut self, name: &Ident) {
        let Some((_, meaning, other)) = built_in(&name.text) else { return };
        self.warn_of_built_in(name, &format!("built-in name for {meaning}"), *other);
    }

    fn warn_of_function(&mut self, name: &Ident) {
        if builtins::find(&name.text).is_some() {
            self.warn_of_built_in(name, "built-in function of that name", None);
        } else {
            self.warn_of_name(name);
        }
    }

    fn warn_of_built_in(&mut self, name: &Ident, what: &str, other: Option<&str>) {
        let help = match other {
            Some(other) => format!("rename it, or write `{other}` where the built-in meaning is wanted"),
            None => "rename it, so that the built-in meaning stays".to_owned(),
        };
        let message = format!("`{}` takes the place of the {what}", name.text);
        self.report(Diagnostic::warning(codes::HIDDEN_BUILT_IN, message, name.span).help(help));
    }
}
