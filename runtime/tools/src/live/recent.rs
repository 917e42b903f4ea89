//! Files that were opened before, kept in the user's folder for the state of programs.

use std::path::{Path, PathBuf};

use smpl_runtime::files;

/// Most files that are kept.
const MOST: usize = 10;

/// The list's own file; `None` where the user has no folder for it.
fn place() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let state = set("XDG_STATE_HOME").or_else(|| Some(set("HOME")?.join(".local/state"))).or_else(|| set("LOCALAPPDATA"))?;
    Some(state.join("smpl").join("recent.json"))
}

/// The files, the last one first.
pub(crate) fn list() -> Vec<PathBuf> {
    let text = place().and_then(|path| files::read_text(&path).ok()).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

/// Puts a file first. A list that cannot be written is left alone.
pub(crate) fn note(path: &Path) {
    let Some(place) = place().filter(|_| path.extension().is_some_and(|ending| ending == "eq")) else { return };
    let mut paths = list();
    if paths.first().is_some_and(|first| first == path) {
        return;
    }
    paths.retain(|known| known != path);
    paths.insert(0, path.to_owned());
    paths.truncate(MOST);
    let Ok(text) = serde_json::to_string(&paths) else { return };
    if let Some(folder) = place.parent()
        && std::fs::create_dir_all(folder).is_ok()
    {
        let _ = files::write_whole(&place, |out| out.write_all(text.as_bytes()));
    }
}
