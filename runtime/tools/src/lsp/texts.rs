//! Open texts over files.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

use smpl_analysis::texts::{Texts, model_of_scenario};
use smpl_runtime::{files, load};

/// Most files that are looked at in a workspace.
const MOST_FILES: usize = 2000;

/// Deepest folder that is looked into.
const DEEPEST: usize = 6;

/// An open text.
#[derive(Clone, Debug)]
pub(super) struct Document {
    pub(super) version: i32,
    pub(super) text: Arc<str>,
}

/// The texts that a client has open, over the files on disk.
#[derive(Debug, Default)]
pub struct OpenTexts {
    documents: RwLock<BTreeMap<PathBuf, Document>>,
    folders: RwLock<Vec<PathBuf>>,
    /// Nothing outside of this folder and the library is read.
    within: Option<PathBuf>,
    library: Option<PathBuf>,
    /// Counts changes of any text.
    generation: AtomicU64,
    /// Models of the workspace, until a file appears or goes.
    listed: RwLock<Option<Arc<Vec<PathBuf>>>>,
}

impl OpenTexts {
    pub(super) fn new(within: Option<PathBuf>, library: Option<PathBuf>) -> Self {
        Self { within, library, ..Self::default() }
    }

    /// The open text of a file, else that on disk.
    #[must_use]
    pub fn text(&self, path: &Path) -> Option<Arc<str>> {
        if let Some(document) = self.read().get(path) {
            return Some(Arc::clone(&document.text));
        }
        self.may_read(path).then(|| files::read_text(path).ok().map(Into::into)).flatten()
    }

    /// Version of an open text.
    #[must_use]
    pub fn version(&self, path: &Path) -> Option<i32> {
        self.read().get(path).map(|document| document.version)
    }

    /// Number of changes so far.
    #[must_use]
    pub fn generation(&self) -> u64 {
        self.generation.load(Ordering::SeqCst)
    }

    /// Open files.
    #[must_use]
    pub fn open(&self) -> Vec<PathBuf> {
        self.read().keys().cloned().collect()
    }

    pub(super) fn set(&self, path: PathBuf, document: Document) {
        let new = self.documents.write().unwrap_or_else(PoisonError::into_inner).insert(path, document).is_none();
        if new {
            self.forget_list();
        }
        self.generation.fetch_add(1, Ordering::SeqCst);
    }

    pub(super) fn close(&self, path: &Path) {
        self.documents.write().unwrap_or_else(PoisonError::into_inner).remove(path);
        self.forget_list();
        self.generation.fetch_add(1, Ordering::SeqCst);
    }

    /// Notes that files have changed on disk.
    pub(super) fn changed_on_disk(&self) {
        self.forget_list();
        self.generation.fetch_add(1, Ordering::SeqCst);
    }

    pub(super) fn set_folders(&self, folders: Vec<PathBuf>) {
        *self.folders.write().unwrap_or_else(PoisonError::into_inner) = folders;
        self.forget_list();
    }

    fn forget_list(&self) {
        *self.listed.write().unwrap_or_else(PoisonError::into_inner) = None;
    }

    fn read(&self) -> std::sync::RwLockReadGuard<'_, BTreeMap<PathBuf, Document>> {
        self.documents.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns whether a file on disk may be read: it is inside of the folder or the library.
    fn may_read(&self, path: &Path) -> bool {
        let Some(within) = &self.within else { return true };
        let Ok(path) = path.canonicalize() else { return false };
        [Some(within), self.library.as_ref()].into_iter().flatten().any(|root| path.starts_with(root))
    }

    fn listed(&self) -> Arc<Vec<PathBuf>> {
        if let Some(list) = &*self.listed.read().unwrap_or_else(PoisonError::into_inner) {
            return Arc::clone(list);
        }
        let mut list = Vec::new();
        let open = self.open();
        let folders = self.folders.read().unwrap_or_else(PoisonError::into_inner).clone();
        let beside = open.iter().filter_map(|path| path.parent()).map(Path::to_owned);
        // Without a workspace the folders of the open files are looked at, one level deep.
        let roots: Vec<(PathBuf, usize)> = if folders.is_empty() {
            let above = open.iter().filter_map(|path| path.parent()?.parent()).map(Path::to_owned);
            beside.chain(above).map(|folder| (folder, 1)).collect()
        } else {
            folders.into_iter().map(|folder| (folder, DEEPEST)).collect()
        };
        roots.iter().for_each(|(folder, depth)| models_in(folder, *depth, &mut list));
        list.extend(open.into_iter().filter(|path| path.extension().is_some_and(|e| e == "eq")));
        list.sort();
        list.dedup();
        let list = Arc::new(list);
        *self.listed.write().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&list));
        list
    }
}

fn models_in(folder: &Path, depth: usize, out: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        if out.len() >= MOST_FILES {
            return;
        }
        let (path, name) = (entry.path(), entry.file_name());
        let Ok(kind) = entry.file_type() else { continue };
        let skipped = name.to_string_lossy().starts_with('.') || matches!(name.to_str(), Some("target" | "node_modules" | "site"));
        if kind.is_dir() && depth > 0 && !skipped {
            models_in(&path, depth - 1, out);
        } else if kind.is_file() && path.extension().is_some_and(|e| e == "eq") {
            out.push(path);
        }
    }
}

impl Texts for OpenTexts {
    fn text(&self, path: &Path) -> Option<Arc<str>> {
        OpenTexts::text(self, path)
    }

    fn import(&self, main: &Path, written: &str) -> Option<PathBuf> {
        let folder = main.parent().unwrap_or(Path::new(""));
        let beside = normal(&folder.join(written));
        if beside.starts_with(folder) && self.read().contains_key(&beside) {
            return Some(beside);
        }
        let (found, _) = load::import(folder, written)?;
        let path = normal(Path::new(&found));
        self.may_read(&path).then_some(path)
    }

    fn models(&self, _: &Path) -> Vec<PathBuf> {
        self.listed().as_ref().clone()
    }

    fn scenarios(&self, model: &Path) -> Vec<PathBuf> {
        let folder = model.parent().map(std::fs::read_dir);
        let files = folder.into_iter().flatten().flatten().flatten().map(|entry| entry.path());
        let mut list: Vec<PathBuf> = files.chain(self.open()).filter(|path| model_of_scenario(path).as_deref() == Some(model)).collect();
        list.sort();
        list.dedup();
        list
    }
}

/// A path without `.` and `..`.
fn normal(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir => {
                out.pop();
            }
            other => out.push(other),
        }
    }
    out
}
