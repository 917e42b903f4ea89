//! Reports to the tests whether the reference trajectories exist, and embeds the files of the live page where they were built.

use std::fmt::Write;
use std::path::Path;

include!("../references.rs");

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    tell_of_references();
    embed_page();
}

/// Writes the list of the files in `live/dist`, which `npm run build` in `live/` makes.
fn embed_page() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("live/dist");
    println!("cargo:rerun-if-changed={}", folder.display());
    let mut list = String::from(
        "/// Names and contents of the page's files; empty in a build without the page.\nstatic FILES: &[(&str, &[u8])] = &[\n",
    );
    let entries = std::fs::read_dir(&folder).into_iter().flatten().flatten();
    let mut paths: Vec<_> = entries.map(|entry| entry.path()).filter(|path| path.is_file()).collect();
    paths.sort();
    // A page without its first file was not built to the end.
    let whole = folder.join("index.html").is_file();
    for path in paths.iter().filter(|_| whole) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if !name.starts_with('.') {
            let _ = writeln!(list, "    ({name:?}, include_bytes!({:?})),", path.display().to_string());
        }
    }
    list.push_str("];\n");
    let out = std::env::var_os("OUT_DIR").map(std::path::PathBuf::from).unwrap_or_default();
    if let Err(error) = std::fs::write(out.join("live_bundle.rs"), list) {
        println!("cargo:warning=the list of the page's files cannot be written: {error}");
    }
}
