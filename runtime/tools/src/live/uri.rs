//! `file:` URIs and paths.

use std::path::{Path, PathBuf};

/// The path of a `file:` URI of this machine.
pub(crate) fn path_of(uri: &str) -> Option<PathBuf> {
    let encoded = uri.strip_prefix("file://")?;
    let encoded = encoded.strip_prefix("localhost").unwrap_or(encoded);
    let text = decoded(encoded)?;
    let drive = text.as_bytes().get(2) == Some(&b':');
    let path = PathBuf::from(if drive { &text[1..] } else { text.as_str() });
    (path.is_absolute() && !text.contains('\0')).then_some(path)
}

/// The `file:` URI of an absolute path.
pub(crate) fn uri_of(path: &Path) -> String {
    let text = path.to_string_lossy().replace('\\', "/");
    let mut uri = String::from(if text.starts_with('/') { "file://" } else { "file:///" });
    for byte in text.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' | b':' => uri.push(char::from(byte)),
            _ => uri.push_str(&format!("%{byte:02X}")),
        }
    }
    uri
}

fn decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let mut digit = || rest.next().and_then(|b| char::from(b).to_digit(16));
        bytes.push((digit()? * 16 + digit()?) as u8);
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_survive_the_way_through_a_uri() {
        for text in ["/a/b.eq", "/a b/°C.eq", "/a%20/b#.eq"] {
            assert_eq!(path_of(&uri_of(Path::new(text))).as_deref(), Some(Path::new(text)));
        }
        assert_eq!(uri_of(Path::new("/a b")), "file:///a%20b");
    }

    #[test]
    fn what_is_not_a_local_file_has_no_path() {
        for uri in ["http://x/a.eq", "file://host/a.eq", "a.eq", "file:///a%zz.eq", "file:///a%"] {
            assert_eq!(path_of(uri), None, "{uri}");
        }
    }
}
