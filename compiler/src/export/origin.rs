//! Source of an export.

use crate::artefact::Circumstances;

/// Description of an export in addition to its model.
pub struct Origin<'a> {
    /// Scenario, variants and settings in words; empty for the unchanged model.
    pub made_for: &'a str,
    /// The same for programs: JSON holds it.
    pub circumstances: &'a Circumstances,
    /// Name of the main file without its ending, where there is one: C takes it for the prefix of
    /// its names.
    pub stem: Option<&'a str>,
}
