//! Files that the page may see: those of the opened folder, of the library, and those that were
//! opened before.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde_json::{Value, json};
use smpl_runtime::files;

use super::recent;
use super::uri::{path_of, uri_of};
use super::wire::{Answer, Fault, FaultKind};

/// Most bytes of a text.
pub(crate) const MOST_BYTES: usize = 4 << 20;
/// Most files that are listed.
const MOST_FILES: usize = 500;
/// Most files and folders that are looked at for that list.
const MOST_ENTRIES: usize = 20_000;
/// Depth to which folders are listed.
const DEPTH: usize = 4;
/// The model that `smpl new` writes.
const TEMPLATE: &str = include_str!("../cli/new.eq");
/// Folders without models of the user.
const SKIPPED: [&str; 4] = ["target", "node_modules", "site", "__pycache__"];

/// The opened folder.
#[derive(Clone, Debug)]
pub(crate) struct Folder {
    /// Its path without links.
    pub(crate) root: PathBuf,
    /// The folder of the shipped models.
    pub(crate) library: Option<PathBuf>,
    /// The file of the command line.
    pub(crate) opened: Option<PathBuf>,
    /// Files that were opened before, which may be outside of the folder.
    pub(crate) recent: Vec<PathBuf>,
}

/// A file that the page may see.
pub(crate) struct Allowed {
    /// Its path without links; the last part may not exist.
    pub(crate) path: PathBuf,
    /// The path as the page gives it, by which open texts are known.
    pub(crate) asked: PathBuf,
    /// It must not be written.
    pub(crate) read_only: bool,
}

impl Folder {
    /// The file of a URI, if the page may see it.
    ///
    /// # Errors
    /// [`FaultKind::Forbidden`].
    pub(crate) fn allowed(&self, uri: &str) -> Result<Allowed, Fault> {
        let refused = || Fault::new(FaultKind::Forbidden, format!("`{uri}` is outside of the opened folder"));
        let asked = path_of(uri).ok_or_else(refused)?;
        if !has_ending(&asked) {
            return Err(Fault::new(FaultKind::Forbidden, "only files that end in .eq or .yaml can be opened"));
        }
        let path = plain(&asked).ok_or_else(refused)?;
        if path.starts_with(&self.root) || self.opened.as_ref() == Some(&path) || self.recent.contains(&path) {
            return Ok(Allowed { path, asked, read_only: false });
        }
        let in_library = self.library.as_ref().is_some_and(|library| path.starts_with(library));
        if in_library { Ok(Allowed { path, asked, read_only: true }) } else { Err(refused()) }
    }

    /// The text of a file with its digest.
    ///
    /// # Errors
    /// The page may not see it, or it cannot be read.
    pub(crate) fn read(&self, uri: &str) -> Answer {
        let Allowed { path, read_only, .. } = self.allowed(uri)?;
        let (text, digest) = content(&path)?;
        if !read_only {
            recent::note(&path);
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(json!({"uri": uri_of(&path), "text": text, "digest": digest, "read_only": read_only, "name": name}))
    }

    /// Writes a text, unless the file has changed since the version of `digest`.
    ///
    /// # Errors
    /// [`FaultKind::Conflict`], a path that may not be written, or a failure to write.
    pub(crate) fn save(&self, uri: &str, text: &str, digest: Option<&str>, force: bool) -> Answer {
        let Allowed { path, read_only, .. } = self.allowed(uri)?;
        if read_only {
            return Err(Fault::new(FaultKind::Forbidden, "a shipped model is read only; save it under another name in the opened folder"));
        }
        if text.len() > MOST_BYTES {
            return Err(too_large());
        }
        let present = if path.exists() { Some(content(&path)?) } else { None };
        if !force && present.as_ref().map(|(_, digest)| digest.as_str()) != digest {
            let (message, data) = match present {
                Some((text, digest)) => ("the file on disk has changed", json!({"text": text, "digest": digest})),
                None => ("the file on disk was removed", json!({"text": null, "digest": null})),
            };
            return Err(Fault { data: Some(data), ..Fault::new(FaultKind::Conflict, message) });
        }
        files::write_whole(&path, |out| out.write_all(text.as_bytes())).map_err(|error| Fault::new(FaultKind::File, error.to_string()))?;
        recent::note(&path);
        Ok(json!({"uri": uri_of(&path), "digest": digest_of(text)}))
    }

    /// Files of the folder, shipped models, templates and files of before.
    pub(crate) fn files(&self) -> Value {
        let paths = models_in(&self.root, DEPTH);
        let shown = |path: &PathBuf| {
            let relative = path.strip_prefix(&self.root).unwrap_or(path).to_string_lossy().into_owned();
            json!({"uri": uri_of(path), "path": relative, "title": title(path)})
        };
        let recent = |path: &PathBuf| json!({"uri": uri_of(path), "path": path.to_string_lossy(), "title": title(path)});
        json!({
            "version": env!("CARGO_PKG_VERSION"),
            "protocol": 1,
            "folder": self.root.to_string_lossy(),
            "folder_uri": uri_of(&self.root),
            "open": self.opened.as_deref().map(uri_of),
            "files": paths.iter().map(shown).collect::<Vec<Value>>(),
            "models": self.shipped(),
            "templates": [{"name": "tank", "title": "a tank with a level to control", "text": TEMPLATE.replacen("NAME", "Tank", 1).replace("FILE", "tank.eq")}],
            "recent": self.recent.iter().filter(|path| path.is_file()).map(recent).collect::<Vec<Value>>(),
        })
    }

    /// Returns whether there is a model to open.
    pub(crate) fn has_models(&self) -> bool {
        !models_in(&self.root, DEPTH).is_empty()
    }

    fn shipped(&self) -> Vec<Value> {
        let Some(library) = &self.library else { return Vec::new() };
        let paths = models_in(library, 0);
        let shown = |path: &PathBuf| {
            let name = path.file_stem()?.to_string_lossy().into_owned();
            Some(json!({"name": name, "title": title(path)?, "uri": uri_of(path)}))
        };
        paths.iter().filter_map(shown).collect()
    }
}

/// The folder of the shipped models: `SMPL_LIBRARY`, else that of the checkout from which the
/// program runs.
pub(crate) fn library() -> Option<PathBuf> {
    let set = std::env::var_os("SMPL_LIBRARY").map(PathBuf::from);
    let beside = || {
        let program = std::env::current_exe().ok()?;
        program.ancestors().skip(2).take(3).map(|folder| folder.join("models")).find(|models| models.join("reactor.eq").is_file())
    };
    set.or_else(beside).and_then(|folder| folder.canonicalize().ok())
}

fn has_ending(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "eq" || ending == "yaml" || ending == "yml")
}

/// A path without links and turns, whether its last part exists or not.
fn plain(path: &Path) -> Option<PathBuf> {
    match path.canonicalize() {
        Ok(path) => Some(path),
        // A link that leads nowhere may lead out of the folder when it is written through.
        Err(_) if path.is_symlink() => None,
        Err(_) => Some(path.parent()?.canonicalize().ok()?.join(path.file_name()?)),
    }
}

/// The text and the digest of a file.
///
/// # Errors
/// One sentence on what is wrong.
pub(crate) fn content(path: &Path) -> Result<(String, String), Fault> {
    let fault = |message: String| Fault::new(FaultKind::File, format!("{}: {message}", path.display()));
    let size = std::fs::metadata(path).map_err(|error| fault(files::plain(&error)))?.len();
    if size > MOST_BYTES as u64 {
        return Err(Fault::new(FaultKind::TooLarge, format!("{}: {}", path.display(), too_large().message)));
    }
    let text = files::read_text(path).map_err(|error| fault(files::plain(&error)))?;
    if text.contains('\0') {
        return Err(fault("is not a text".into()));
    }
    let digest = digest_of(&text);
    Ok((text, digest))
}

/// The error of a text beyond the limit.
pub(crate) fn too_large() -> Fault {
    Fault::new(FaultKind::TooLarge, format!("the text is larger than {} MB", MOST_BYTES >> 20))
}

/// The digest of a text.
pub(crate) fn digest_of(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex().as_str()[..32].to_owned()
}

/// The models in a folder, and in those in it down to a depth, by name.
fn models_in(folder: &Path, depth: usize) -> Vec<PathBuf> {
    let (mut paths, mut looked_at) = (Vec::new(), 0);
    walk(folder, depth, &mut looked_at, &mut paths);
    paths
}

fn walk(folder: &Path, depth: usize, looked_at: &mut usize, out: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().flatten().take(MOST_ENTRIES).collect();
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        *looked_at += 1;
        let (name, path) = (entry.file_name().to_string_lossy().into_owned(), entry.path());
        let Ok(kind) = entry.file_type() else { continue };
        if out.len() >= MOST_FILES || *looked_at > MOST_ENTRIES || name.starts_with('.') {
            continue;
        }
        if kind.is_dir() && depth > 0 && !SKIPPED.contains(&name.as_str()) {
            walk(&path, depth - 1, looked_at, out);
        } else if kind.is_file() && path.extension().is_some_and(|ending| ending == "eq") {
            out.push(path);
        }
    }
}

/// `Reactor: a stirred tank`, from the statement `model`; `None` for a file without one.
fn title(path: &Path) -> Option<String> {
    use std::io::Read;
    let mut start = Vec::new();
    std::fs::File::open(path).ok()?.take(16 << 10).read_to_end(&mut start).ok()?;
    let text = String::from_utf8_lossy(&start);
    let line = text.lines().find_map(|line| line.trim_start().strip_prefix("model "))?;
    let name = line.split_whitespace().next()?;
    match line.split('"').nth(1) {
        Some(text) => Some(format!("{name}: {text}")),
        None => Some(name.to_owned()),
    }
}

/// Open files, watched for changes by others.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    files: BTreeMap<PathBuf, Seen>,
}

#[derive(Debug, Clone, PartialEq)]
struct Seen {
    stamp: Option<(SystemTime, u64)>,
    digest: Option<String>,
}

fn stamp(path: &Path) -> Option<(SystemTime, u64)> {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}

impl Watch {
    /// Watches a file from now on.
    pub(crate) fn open(&mut self, path: &Path) {
        let digest = content(path).ok().map(|(_, digest)| digest);
        self.files.insert(path.to_owned(), Seen { stamp: stamp(path), digest });
    }

    /// Watches it no longer.
    pub(crate) fn close(&mut self, path: &Path) {
        self.files.remove(path);
    }

    /// Notes what this page has written itself.
    pub(crate) fn written(&mut self, path: &Path, digest: &str) {
        if let Some(seen) = self.files.get_mut(path) {
            *seen = Seen { stamp: stamp(path), digest: Some(digest.to_owned()) };
        }
    }

    /// The files that have changed since they were looked at last, as parameters of `smpl/changed`.
    pub(crate) fn changes(&mut self) -> Vec<Value> {
        let mut changes = Vec::new();
        for (path, seen) in &mut self.files {
            let now = stamp(path);
            if now == seen.stamp {
                continue;
            }
            seen.stamp = now;
            let found = content(path).ok();
            let digest = found.as_ref().map(|(_, digest)| digest.clone());
            if digest != seen.digest {
                seen.digest.clone_from(&digest);
                changes.push(json!({"uri": uri_of(path), "digest": digest, "text": found.map(|(text, _)| text)}));
            }
        }
        changes
    }
}
