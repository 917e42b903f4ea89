//! Editors: Neovim with its own client, and the word lists of the set-ups in `docs/editors/`.

use std::path::Path;
use std::process::Command;

const TANK: &str = "\
model Tank \"a tank that drains, 20 °C\"
time t : min
param  A : m^2       = 0.5               \"cross-section 😀²\"
param  k : m^2.5/min = 0.1               \"valve constant\"
action q : m^3/min   = 0.1 in 0..0.3     \"inflow\"
state  h : m         = 1   in 0..2       \"level\"
let    out           = k*sqrt(h)

eq d/dt h = (q - outt) / A

initial h ~ uniform(0.5, 1.5)
observe h
episode { step = 1 [min], max_steps = 50 }
";

fn docs() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/editors")
}

#[test]
fn neovim_shows_diagnostics_hover_completion_rename_and_format() {
    if Command::new("nvim").arg("--version").output().is_err() {
        eprintln!("skipped: neovim_shows_diagnostics_hover_completion_rename_and_format: nvim is not installed");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("tank °.eq");
    std::fs::write(&file, TANK).expect("a file");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/editors/neovim.lua");
    let output = Command::new("nvim")
        .args(["--headless", "-u", "NONE", "-i", "NONE", "-n", "-c"])
        .arg(format!("luafile {}", script.display()))
        .env("SMPL_COMMAND", env!("CARGO_BIN_EXE_smpl"))
        .env("SMPL_SETUP", docs().join("neovim"))
        .env("SMPL_MODEL", &file)
        .env("XDG_CACHE_HOME", folder.path())
        .env("XDG_STATE_HOME", folder.path())
        .output()
        .expect("nvim");
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success() && out.contains("passed") | err.contains("passed"), "{out}\n{err}");
}

#[test]
fn set_ups_know_every_statement_and_function() {
    let files = ["vscode/syntaxes/smpl.tmLanguage.json", "neovim/syntax/smpl.vim", "emacs/smpl-mode.el"];
    for name in files {
        let text = std::fs::read_to_string(docs().join(name)).expect("a file");
        let words: Vec<&str> = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').collect();
        let functions = smpl_compiler::elaborate::BUILTINS.iter().map(|builtin| builtin.name);
        let missing: Vec<&str> = smpl_dsl::words::keywords().chain(functions).filter(|word| !words.contains(word)).collect();
        assert!(missing.is_empty(), "{name} misses {missing:?}");
    }
}
