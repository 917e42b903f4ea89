//! The page's own files: embedded when they were there at the build, or those of a folder.

use std::borrow::Cow;
use std::path::PathBuf;

include!(concat!(env!("OUT_DIR"), "/live_bundle.rs"));

/// Source of the files.
#[derive(Clone, Debug)]
pub(crate) enum Bundle {
    /// The program itself.
    Embedded,
    /// A folder, for work on the page.
    Folder(PathBuf),
}

impl Bundle {
    /// The folder of `SMPL_LIVE_DIST`, else what was embedded; `None` where the program was built
    /// without the page.
    pub(crate) fn of_program() -> Option<Self> {
        match std::env::var_os("SMPL_LIVE_DIST").filter(|folder| !folder.is_empty()) {
            Some(folder) => Some(Self::Folder(folder.into())),
            None => (!FILES.is_empty()).then_some(Self::Embedded),
        }
    }

    /// Type and content of a file.
    pub(crate) fn file(&self, name: &str) -> Option<(&'static str, Cow<'static, [u8]>)> {
        let is_plain = !name.starts_with('.') && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"._-".contains(&b));
        if !is_plain {
            return None;
        }
        let content: Cow<'static, [u8]> = match self {
            Self::Embedded => Cow::Borrowed(FILES.iter().find(|(known, _)| *known == name)?.1),
            Self::Folder(folder) => Cow::Owned(smpl_runtime::files::read(&folder.join(name)).ok()?),
        };
        Some((kind(name), content))
    }
}

fn kind(name: &str) -> &'static str {
    match name.rsplit_once('.').map_or("", |(_, ending)| ending) {
        "html" => "text/html; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "svg" => "image/svg+xml",
        "woff2" => "font/woff2",
        "png" => "image/png",
        "json" | "map" => "application/json",
        _ => "application/octet-stream",
    }
}
