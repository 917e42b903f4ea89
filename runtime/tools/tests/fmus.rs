//! Functional Mock-up Units: what is packed, that it compiles without a warning, and what is refused by name.

use std::path::{Path, PathBuf};
use std::process::Command;

use smpl_runtime::load::{LoadOptions, load};
use smpl_tools::export::{Fmu, export_fmu};

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

fn made(path: &Path) -> Result<Fmu, String> {
    let loaded = load(path, &LoadOptions::default()).expect("a model");
    export_fmu(&loaded, false, None).map_err(|fault| fault.to_string())
}

/// The files of an archive, by the local headers.
fn files(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let number = |at: usize, length: usize| bytes[at..at + length].iter().rev().fold(0, |sum, &byte| (sum << 8) | usize::from(byte));
    let (mut at, mut found) = (0, vec![]);
    while bytes[at..].starts_with(b"PK\x03\x04") {
        let (packed, whole, name, extra) = (number(at + 18, 4), number(at + 22, 4), number(at + 26, 2), number(at + 28, 2));
        let start = at + 30 + name + extra;
        let path = String::from_utf8(bytes[at + 30..at + 30 + name].to_vec()).expect("a name");
        let text = miniz_oxide::inflate::decompress_to_vec(&bytes[start..start + packed]).expect("deflated");
        assert_eq!(text.len(), whole, "{path}");
        found.push((path, text));
        at = start + packed;
    }
    found
}

#[test]
fn an_fmu_holds_its_description_and_sources_in_one_order() {
    let fmu = made(&models().join("reactor.eq")).expect("an FMU");
    assert_eq!(fmu.without_binary.as_deref(), Some("none was asked for"));
    let files = files(&fmu.bytes);
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names[..3], ["modelDescription.xml", "resources/elements.csv", "sources/buildDescription.xml"]);
    assert!(names[3..].iter().all(|name| name.starts_with("sources/")) && names[3..].is_sorted(), "{names:?}");
    let text = |name: &str| String::from_utf8(files.iter().find(|f| f.0 == name).expect("there").1.clone()).expect("text");
    let description = text("modelDescription.xml");
    roxmltree::Document::parse(&description).expect("XML");
    let token = description.split("instantiationToken=\"").nth(1).and_then(|rest| rest.split('"').next()).expect("a token");
    assert!(text("sources/tables.h").contains(&format!("#define SMPL_TOKEN \"{token}\"")));
}

#[test]
fn the_same_model_gives_the_same_bytes_and_another_one_another_token() {
    let [first, second] = [(); 2].map(|()| made(&models().join("beer.eq")).expect("an FMU").bytes);
    assert_eq!(first, second);
}

#[test]
fn the_sources_compile_without_a_warning() {
    let problem = models().join("../tests/problems/robertson_dae.eq");
    for path in [models().join("reactor.eq"), models().join("pensim.eq"), problem] {
        let folder = tempfile::tempdir().expect("a folder");
        let mut sources = vec![];
        for (path, text) in files(&made(&path).expect("an FMU").bytes) {
            let Some(name) = path.strip_prefix("sources/") else { continue };
            std::fs::write(folder.path().join(name), text).expect("written");
            if name.ends_with(".c") {
                sources.push(name.to_owned());
            }
        }
        let flags = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O2", "-fPIC", "-shared", "-o", "model.so"];
        let done = Command::new("cc").current_dir(folder.path()).args(flags).args(&sources).arg("-lm").output().expect("cc runs");
        assert!(done.status.success(), "{}: {}", path.display(), String::from_utf8_lossy(&done.stderr));
    }
}

/// A tank with a formula for its observed level.
fn tank(more: &str) -> Result<Fmu, String> {
    let folder = tempfile::tempdir().expect("a folder");
    let text = format!(
        "model Tank \"a tank\"\ntime t : s\nstate h : m = 1 \"level\"\naction q : m/s = 0.1 in 0..1 \"inflow\"\n\
         eq der(h) = q - 0.1 [1/s] * h\nobserve h\nreward r = 0\n{more}\nepisode {{ step = 1 [s], max_steps = 10 }}\n"
    );
    let path = folder.path().join("tank.eq");
    std::fs::write(&path, text).expect("written");
    made(&path)
}

#[test]
fn what_an_fmu_does_not_have_is_refused_by_name() {
    assert!(tank("").is_ok());
    let message = tank("observe total = integral(h) in 0..100").err().expect("refused");
    assert_eq!(message, "`observations` reads an integral over the step, which an FMU does not have");
    // A reward is not part of an FMU, and may read one.
    assert!(tank("reward total = integral(h) / 1 [m s]").is_ok());
}
