//! The user's secret.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::{env, process};

use super::ArtefactError;

/// Secret of a user, unknown to others and never printed.
pub struct Key([u8; blake3::KEY_LEN]);

impl Key {
    /// The key of this user at `$XDG_DATA_HOME/smpl/key` or `~/.local/share/smpl/key`, made if it
    /// is missing.
    ///
    /// # Errors
    /// If no home is known, the file cannot be read or made, or others may read it.
    pub(crate) fn of_user() -> Result<Key, ArtefactError> {
        let variable = |name| env::var_os(name).map(PathBuf::from).filter(|p| p.is_absolute());
        let data = variable("XDG_DATA_HOME").or_else(|| variable("HOME").map(|home| home.join(".local/share")));
        Key::at(&data.ok_or(ArtefactError::NoHome)?.join("smpl/key"))
    }

    /// The key in a file, made if it is missing.
    ///
    /// # Errors
    /// If the file cannot be read or made, is not a key, or others may read it.
    pub fn at(path: &Path) -> Result<Key, ArtefactError> {
        let made = || match read(path) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => make(path).and_then(|()| read(path)),
            known => known,
        };
        made().map(Key).map_err(|source| ArtefactError::Key { path: path.to_owned(), source })
    }

    pub(super) fn seal(&self, content: &[u8]) -> blake3::Hash {
        blake3::keyed_hash(&self.0, content)
    }
}

fn read(path: &Path) -> io::Result<[u8; blake3::KEY_LEN]> {
    let mut file = File::open(path)?;
    check_owner(&file)?;
    let mut key = [0; blake3::KEY_LEN];
    file.read_exact(&mut key)?;
    Ok(key)
}

/// A key that others can read or replace proves nothing.
#[cfg(unix)]
fn check_owner(file: &File) -> io::Result<()> {
    use std::os::unix::fs::MetadataExt;
    let metadata = file.metadata()?;
    // SAFETY: a call without arguments that cannot fail.
    let user = unsafe { libc::geteuid() };
    if metadata.uid() == user && metadata.mode() & 0o077 == 0 {
        return Ok(());
    }
    Err(io::Error::new(io::ErrorKind::PermissionDenied, "it must belong to you and be readable by you alone"))
}

#[cfg(not(unix))]
fn check_owner(_: &File) -> io::Result<()> {
    Ok(())
}

/// Makes a key file; if another process makes one at the same time, the first stays.
fn make(path: &Path) -> io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let mut key = [0; blake3::KEY_LEN];
    File::open("/dev/urandom")?.read_exact(&mut key)?;
    let draft = folder.join(format!(".key-{}-{:?}", process::id(), std::thread::current().id()));
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let written = options.open(&draft).and_then(|mut file| file.write_all(&key).and_then(|()| file.sync_all()));
    // A link fails where a key is already, and shows it only when it is whole.
    let linked = written.and_then(|()| match fs::hard_link(&draft, path) {
        Err(e) if e.kind() != io::ErrorKind::AlreadyExists => Err(e),
        _ => Ok(()),
    });
    let _ = fs::remove_file(&draft);
    linked
}
