//! The command line from outside: exit status, what goes where, no panic on any input.

use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

fn smpl(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_smpl")).args(arguments).output().expect("smpl runs")
}

fn status(output: &Output) -> i32 {
    output.status.code().expect("ends by itself")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A file in a folder of its own.
fn file(test: &str, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("smpl-cli-{}-{test}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let path = folder.join(name);
    std::fs::write(&path, content).expect("a file");
    path
}

#[test]
fn a_wrong_command_line_is_status_2() {
    for arguments in [
        &["simulate"][..],
        &["frobnicate"],
        &["simulate", "m.eq", "--set", "k_0"],
        &["simulate", "m.eq", "--steps", "0"],
        &["simulate", "m.eq", "--rtol", "-1"],
        &["steady", "m.eq", "--action", "T=hot"],
        &["check", "--format", "xml", "m.eq"],
    ] {
        let output = smpl(arguments);
        assert_eq!(status(&output), 2, "{arguments:?}");
        assert!(output.stdout.is_empty() && !output.stderr.is_empty(), "{arguments:?}");
    }
}

#[test]
fn help_and_version_are_status_0_and_show_examples() {
    let output = smpl(&["--help"]);
    assert_eq!(status(&output), 0);
    assert!(text(&output.stdout).contains("smpl simulate models/reactor.eq"));
    assert_eq!(status(&smpl(&["simulate", "--help"])), 0);
    assert_eq!(status(&smpl(&["--version"])), 0);
}

#[test]
fn a_missing_file_is_status_1_and_named() {
    for command in ["check", "compile", "simulate", "steady", "fmt", "doc"] {
        let output = smpl(&[command, "no/such.eq"]);
        assert_eq!(status(&output), 1, "{command}");
        assert!(text(&output.stderr).contains("no/such.eq: no such file"), "{command}: {}", text(&output.stderr));
    }
}

#[test]
fn a_syntax_error_is_shown_at_its_place() {
    let path = file("syntax", "bad.eq", "model M\nstate x : m = = 1\neq d/dt x = -x\n");
    let output = smpl(&["check", path.to_str().expect("utf-8")]);
    assert_eq!(status(&output), 1);
    let shown = text(&output.stderr);
    assert!(shown.contains("bad.eq:2:") && shown.contains("state x : m = = 1"), "{shown}");
}

#[test]
fn json_diagnostics_have_the_fields_of_the_contract() {
    let path = file("json", "bad.eq", "model M\nstate x : m = = 1\n");
    let output = smpl(&["check", "--format", "json", path.to_str().expect("utf-8")]);
    assert_eq!(status(&output), 1);
    let objects: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let first = &objects.as_array().expect("an array")[0];
    for key in ["code", "severity", "message", "file", "line", "column", "end_line", "end_column", "help"] {
        assert!(first.get(key).is_some(), "{key}");
    }
    assert_eq!((first["severity"].as_str(), first["line"].as_u64()), (Some("error"), Some(2)));
}

#[test]
fn an_unknown_scenario_lists_those_there_are() {
    let path = file("scenario", "m.eq", "model M\n");
    file("scenario", "m.legacy.yaml", "max_steps: 3\n");
    let output = smpl(&["check", path.to_str().expect("utf-8"), "--scenario", "legasy"]);
    assert_eq!(status(&output), 1);
    let shown = text(&output.stderr);
    assert!(shown.contains("did you mean `legacy`?") && shown.contains("default, legacy"), "{shown}");
}

#[test]
fn a_fault_in_a_scenario_is_underlined() {
    let path = file("fault", "m.eq", "model M\n");
    file("fault", "m.s.yaml", "max_step: 3\n");
    let output = smpl(&["check", path.to_str().expect("utf-8"), "--scenario", "s"]);
    assert_eq!(status(&output), 1);
    let shown = text(&output.stderr);
    assert!(shown.contains("unknown key `max_step`") && shown.contains("m.s.yaml:1:1"), "{shown}");
    assert!(shown.contains("did you mean `max_steps`?"), "{shown}");
}

#[test]
fn no_input_makes_it_panic() {
    let deep = format!("model M\nlet x = {}1{}\n", "(".repeat(20_000), ")".repeat(20_000));
    let inputs: [&[u8]; 5] = [b"", b"\xff\xfe\x00", b"{{{{", deep.as_bytes(), b"model \n\"\n"];
    for (i, input) in inputs.iter().enumerate() {
        let path = file(&format!("any{i}"), "m.eq", input);
        for command in ["check", "simulate", "steady", "doc", "fmt", "compile"] {
            let output = smpl(&[command, path.to_str().expect("utf-8")]);
            assert!((0..=2).contains(&status(&output)), "{command} on input {i}");
            let shown = text(&output.stderr);
            assert!(!shown.contains("panicked") && !shown.contains("internal error"), "{command} on input {i}: {shown}");
        }
    }
}

#[test]
fn a_reader_that_goes_away_is_no_fault() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_smpl"))
        .arg("check")
        .args(["--format", "json", "no/such.eq"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("smpl runs");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("ends");
    assert!(!text(&output.stderr).contains("panicked"));
    assert!(output.status.code().is_some());
}

#[test]
fn formatting_checks_without_changing() {
    let path = file("fmt", "m.eq", "model   M\nparam a:1=1\n");
    let name = path.to_str().expect("utf-8");
    let output = smpl(&["fmt", "--check", name]);
    assert_eq!(status(&output), 1);
    assert_eq!(std::fs::read_to_string(&path).expect("reads"), "model   M\nparam a:1=1\n");
    assert_eq!(status(&smpl(&["fmt", name])), 0);
    assert_eq!(status(&smpl(&["fmt", "--check", name])), 0);
}
