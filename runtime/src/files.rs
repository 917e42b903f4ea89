//! Files: what is read is a regular file, and what is written is there whole or not at all.
//!
//! A file is written next to its destination, under an unpredictable name, and renamed when it is
//! complete. Links are followed, and a file that is not regular (a device, a pipe) is written
//! directly.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// Most bytes of a file that is read whole.
const MAX_BYTES: u64 = 1 << 30;

/// Most links from one to the next.
const MAX_LINKS: usize = 40;

/// A file that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {}", path.display(), plain(source))]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// Reason.
    pub source: io::Error,
}

/// Opens a regular file. A device may never end, and a pipe may wait for ever.
///
/// # Errors
/// If it is missing, or cannot be opened.
pub fn open(path: &Path) -> io::Result<File> {
    let metadata = fs::metadata(path)?;
    if metadata.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    if !metadata.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "is a device or a pipe; write its content into a file and give that"));
    }
    File::open(path)
}

/// Reads a regular file whole.
///
/// # Errors
/// As [`open`], and where the file is beyond reason.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let too_large = || io::Error::new(io::ErrorKind::FileTooLarge, "is larger than a gigabyte");
    let file = open(path)?;
    if file.metadata()?.len() > MAX_BYTES {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    // What the system makes up as it is read has no length.
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_BYTES { Err(too_large()) } else { Ok(bytes) }
}

/// Reads a regular file of text.
///
/// # Errors
/// As [`read`], and `InvalidData` where it is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    String::from_utf8(read(path)?).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, not_utf8(error.as_bytes())))
}

/// `not UTF-8 at line 3, column 7`, of bytes that are not.
pub fn not_utf8(bytes: &[u8]) -> String {
    let valid = std::str::from_utf8(bytes).map_or_else(|error| error.valid_up_to(), str::len);
    let before = String::from_utf8_lossy(&bytes[..valid]);
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    format!("not UTF-8 at line {line}, column {column}")
}

/// Returns `true` if two paths lead to one file.
#[must_use]
pub fn is_same(a: &Path, b: &Path) -> bool {
    match (fs::metadata(a), fs::metadata(b)) {
        (Ok(x), Ok(y)) => same_metadata(&x, &y).unwrap_or_else(|| fs::canonicalize(a).ok() == fs::canonicalize(b).ok()),
        _ => false,
    }
}

/// Returns `true` if what is written to two paths goes into one file, whether it is there or not.
#[must_use]
pub fn is_same_destination(a: &Path, b: &Path) -> bool {
    is_same(a, b) || matches!((plain_name(a), plain_name(b)), (Some(a), Some(b)) if a == b)
}

/// The one name of a file that may not be there: without links and turns. `None` where its folder
/// is not there either.
fn plain_name(path: &Path) -> Option<PathBuf> {
    let path = std::path::absolute(followed(path).ok()?).ok()?;
    Some(path.parent()?.canonicalize().ok()?.join(path.file_name()?))
}

#[cfg(unix)]
fn same_metadata(a: &Metadata, b: &Metadata) -> Option<bool> {
    use std::os::unix::fs::MetadataExt;
    Some((a.dev(), a.ino()) == (b.dev(), b.ino()))
}

#[cfg(not(unix))]
fn same_metadata(_: &Metadata, _: &Metadata) -> Option<bool> {
    None
}

/// Returns `true` if a path means the standard output.
#[must_use]
pub fn is_standard_output(path: &Path) -> bool {
    ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"].iter().any(|name| path == Path::new(name))
}

/// Destination of a file.
enum Destination {
    Output,
    Errors,
    /// A special file.
    InPlace(PathBuf),
    /// A file, with what is known of the one that it replaces.
    File(PathBuf, Option<Metadata>),
}

impl Destination {
    fn of(path: &Path) -> io::Result<Self> {
        if is_standard_output(path) {
            return Ok(Self::Output);
        }
        if path == Path::new("/dev/stderr") {
            return Ok(Self::Errors);
        }
        match fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => Err(io::ErrorKind::IsADirectory.into()),
            Ok(metadata) if !metadata.is_file() => Ok(Self::InPlace(path.to_owned())),
            Ok(metadata) => Ok(Self::File(followed(path)?, Some(metadata))),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Self::File(followed(path)?, None)),
            Err(error) => Err(error),
        }
    }
}

/// Target of a link, which may be missing; any other path unchanged.
fn followed(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        if !fs::symlink_metadata(&path).is_ok_and(|metadata| metadata.is_symlink()) {
            return Ok(path);
        }
        let target = fs::read_link(&path)?;
        path = path.parent().unwrap_or(Path::new("")).join(target);
    }
    Err(io::Error::other("too many links"))
}

/// Writes a file whole or not at all. Links are followed, files that are not regular are written
/// directly, `-` is the standard output. A file that is replaced hands its permissions on.
///
/// # Errors
/// [`WriteError`] with the path; nothing is left behind then.
pub fn write_whole(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), WriteError> {
    let done = Destination::of(path).and_then(|destination| match destination {
        Destination::Output => write_into(io::stdout().lock(), fill),
        Destination::Errors => write_into(io::stderr().lock(), fill),
        Destination::InPlace(path) => OpenOptions::new().write(true).open(path).and_then(|file| write_into(file, fill)),
        Destination::File(path, replaced) => replace(&path, replaced.as_ref(), fill),
    });
    done.map_err(|source| WriteError { path: path.to_owned(), source })
}

fn write_into(sink: impl Write, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut out = BufWriter::new(sink);
    fill(&mut out)?;
    out.flush()
}

/// Writes a file next to `path` and renames it when it is complete.
fn replace(path: &Path, replaced: Option<&Metadata>, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    if replaced.is_some() {
        // What may not be written is not replaced either, whatever its folder allows.
        OpenOptions::new().write(true).open(path)?;
    }
    let name = path.file_name().ok_or(io::ErrorKind::IsADirectory)?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut prefix = std::ffi::OsString::from(".");
    prefix.push(name);
    prefix.push(".");
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(".part");
    // New files are as open as the user wishes all of them to be.
    #[cfg(unix)]
    builder.permissions(<fs::Permissions as std::os::unix::fs::PermissionsExt>::from_mode(0o666));
    let mut part = builder.tempfile_in(folder)?;
    write_into(part.as_file_mut(), fill)?;
    if let Some(replaced) = replaced {
        hand_on(replaced, part.as_file())?;
    }
    part.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Gives a file the owner and the permissions of the one that it replaces.
fn hand_on(replaced: &Metadata, file: &File) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let present = file.metadata()?;
        if (present.uid(), present.gid()) != (replaced.uid(), replaced.gid()) {
            // Only the superuser may give files away; for all others the new file is theirs, as any
            // other that they write.
            let _ = std::os::unix::fs::fchown(file, Some(replaced.uid()), Some(replaced.gid()));
        }
    }
    file.set_permissions(replaced.permissions())
}

/// The error without the operating system's number.
pub fn plain(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "no such file".into(),
        std::io::ErrorKind::PermissionDenied => "permission denied".into(),
        std::io::ErrorKind::IsADirectory => "is a directory".into(),
        _ => error.to_string(),
    }
}
