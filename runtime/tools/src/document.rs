//! A model as a page to read: the whole of its text in reading order, equations typeset, with a
//! flowsheet and a picture of a run.
//!
//! [`Source`] is the text with what it imports. The page says first what the model is in numbers,
//! then follows the text statement after statement ([`statements`]): declarations become tables,
//! equations displays, components separate chapters. `# ---- Title ----` is a heading, other
//! comments are prose. Variants and options that are not in force come after it, then every name as
//! it is seen from outside ([`names`]).

mod control;
mod declarations;
mod equations;
mod flowsheet;
mod markdown;
mod names;
mod reduction;
mod statements;

use std::collections::HashMap;
use std::path::Path;

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::model::Interface;
use smpl_compiler::read::{Read, read};
use smpl_dsl::diagnostic::SourceMap;
use smpl_dsl::syntax::File;

pub(crate) use equations::latex;
pub(crate) use flowsheet::flowsheet;

use crate::reduction::Summary;
use markdown::prose;
use smpl_runtime::files::read_text;

/// The text of a model and of what it imports.
pub(crate) struct Source {
    files: Vec<File>,
    imports: HashMap<String, usize>,
    texts: SourceMap,
}

impl Source {
    /// Reads a model's file (of a compiled model the text next to it); `None` where there is no
    /// text.
    #[must_use]
    pub(crate) fn read(path: &Path) -> Option<Self> {
        let path = if path.extension().is_some_and(|e| e == smpl_runtime::load::ARTEFACT_EXTENSION) {
            path.with_extension("eq")
        } else {
            path.into()
        };
        let mut texts = SourceMap::new();
        let main = texts.add(path.display().to_string(), read_text(&path).ok()?);
        let folder = path.parent().map(Path::to_owned).unwrap_or_default();
        let Read { files, imports, faults, .. } = read(&mut texts, main, None, &[], &mut |name| smpl_runtime::load::import(&folder, name));
        faults.is_empty().then_some(Self { files, imports, texts })
    }
}

/// A picture on a page: what it shows, and where it is.
pub(crate) struct Figure {
    /// Description.
    pub text: String,
    /// Its path from the page.
    pub path: String,
}

/// The page of a model in Markdown, mathematics between dollar signs. Without the text, only what
/// is known from outside.
#[must_use]
pub(crate) fn markdown(model: &CompiledModel, source: Option<&Source>, figures: &[Figure]) -> String {
    let interface = model.interface();
    let mut page = format!("# {}\n\n{}\n", prose(&interface.name), prose(&interface.text));
    page.push_str(&facts(interface));
    for figure in figures {
        page.push_str(&format!("\n![{}]({})\n", prose(&figure.text), figure.path));
    }
    if let Some(source) = source {
        page.push_str(&statements::page(source, interface));
    }
    page.push_str(&Summary::of(interface).map(|summary| reduction::page(&summary)).unwrap_or_default());
    let policies: Vec<&str> = model.model().programs.policies.iter().map(|(name, _)| name.as_str()).collect();
    page.push_str(&names::page(interface, &policies));
    page
}

/// The size of the model and of its episodes in a sentence or two.
fn facts(interface: &Interface) -> String {
    let count = |list: &[smpl_compiler::model::Quantity]| list.iter().map(smpl_compiler::model::Quantity::len).sum::<usize>();
    let plural = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let mut parts = vec![plural(count(&interface.quantities.states), "state"), plural(count(&interface.quantities.actions), "action")];
    parts.push(plural(interface.finish.observations.len(), "observation"));
    let phases = if interface.phases.is_empty() { String::new() } else { format!(", {} phases", interface.phases.len()) };
    let (episode, unit) = (&interface.episode, markdown::unit(&interface.time.unit));
    let (step, end) = (smpl_runtime::failure::Short(episode.step), if episode.end_is_success { "a batch" } else { "an episode at most" });
    format!("\n{}{phases}. Time is in {unit}; a step is {step} {unit}, {end} {} steps.\n", parts.join(", "), episode.max_steps)
}
