//! Places of the faults of a scenario and of settings.

use std::collections::BTreeSet;

use smpl_dsl::diagnostic::{Diagnostic, SourceMap, codes};
use smpl_dsl::span::{FileId, Span};

use super::LoadOptions;
use crate::scenario::{self, Scenario};

/// Variants and settings of the call as a text, for messages that point into it.
pub(super) fn settings_as_text(sources: &mut SourceMap, options: &LoadOptions) -> Option<FileId> {
    let variants = options.variants.iter().map(|v| format!("{v}\n"));
    let settings = options.settings.iter().map(|(name, value)| format!("{name}={value}\n"));
    let text: String = variants.chain(settings).collect();
    (!text.is_empty()).then(|| sources.add("settings", text))
}

/// The front end knows names and values of a scenario and of settings, but not their places. Each
/// diagnostic is moved to the name in the scenario's file or in the settings, and reported once.
pub(super) fn place_scenario_faults(diagnostics: &mut Vec<Diagnostic>, scenario: &Scenario, sources: &SourceMap, settings: Option<FileId>) {
    let mut seen = BTreeSet::new();
    diagnostics.retain(|d| d.code != codes::BAD_SCENARIO || seen.insert(d.message.clone()));
    for diagnostic in diagnostics.iter_mut().filter(|d| d.code == codes::BAD_SCENARIO && d.primary.span == Span::default()) {
        let name = diagnostic.asked.as_deref();
        let line = |name| settings.and_then(|file| setting_line(sources, file, name));
        let place = name.and_then(line).or_else(|| scenario.place_of(sources, name?));
        if let Some(span) = place.or_else(|| scenario.start().filter(|_| settings.is_none())) {
            diagnostic.primary.span = span;
        }
        diagnostic.message = scenario::shortened_names(&diagnostic.message);
    }
}

/// The line of the settings that a name begins.
fn setting_line(sources: &SourceMap, file: FileId, name: &str) -> Option<Span> {
    let mut start = 0;
    for line in sources.file(file)?.text().lines() {
        if line.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('=')) {
            return Some(Span { file, start, end: start + line.len() as u32 });
        }
        start += line.len() as u32 + 1;
    }
    None
}
