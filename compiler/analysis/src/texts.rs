//! Access to texts: open ones over files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Texts of models and scenarios. Implementations decide which files may be read.
pub trait Texts {
    /// The present text of a file; `None` if there is no such file or it may not be read.
    fn text(&self, path: &Path) -> Option<Arc<str>>;

    /// The file that `use "written"` names in a model at `main`.
    fn import(&self, main: &Path, written: &str) -> Option<PathBuf>;

    /// Models (`.eq`) in the workspace or near `path`, in a stable order.
    fn models(&self, path: &Path) -> Vec<PathBuf>;

    /// Scenario files of a model, `NAME.SCENARIO.yaml` in its folder.
    fn scenarios(&self, model: &Path) -> Vec<PathBuf>;
}

/// Texts in memory, for tests and tools without files.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    /// Texts by path.
    pub texts: BTreeMap<PathBuf, Arc<str>>,
}

impl Memory {
    /// Texts of these names.
    pub fn of<'t>(texts: impl IntoIterator<Item = (&'t str, &'t str)>) -> Self {
        Self { texts: texts.into_iter().map(|(path, text)| (path.into(), text.into())).collect() }
    }
}

impl Texts for Memory {
    fn text(&self, path: &Path) -> Option<Arc<str>> {
        self.texts.get(path).cloned()
    }

    fn import(&self, main: &Path, written: &str) -> Option<PathBuf> {
        let path = main.parent().unwrap_or(Path::new("")).join(written);
        self.texts.contains_key(&path).then_some(path)
    }

    fn models(&self, _: &Path) -> Vec<PathBuf> {
        self.texts.keys().filter(|path| path.extension().is_some_and(|e| e == "eq")).cloned().collect()
    }

    fn scenarios(&self, model: &Path) -> Vec<PathBuf> {
        self.texts.keys().filter(|path| model_of_scenario(path).as_deref() == Some(model)).cloned().collect()
    }
}

/// The model that a scenario file belongs to by its name: `reactor.eq` of `reactor.legacy.yaml`.
#[must_use]
pub fn model_of_scenario(path: &Path) -> Option<PathBuf> {
    let stem = path.file_name()?.to_str()?.strip_suffix(".yaml")?;
    let (model, _) = stem.rsplit_once('.')?;
    Some(path.with_file_name(format!("{model}.eq")))
}
