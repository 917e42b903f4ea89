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
        &["simulate", "m.eq", "--rtol", "1e-20"],
        &["simulate", "m.eq", "--rtol", "2"],
        &["simulate", "m.eq", "--seed", "-1"],
        &["simulate", "m.eq", "--set", "=1"],
        &["simulate", "m.eq", "--plot", "p.png"],
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
fn of_many_faults_the_first_are_shown_and_the_rest_is_counted() {
    let model = (0..1234).map(|i| format!("let a{i} = nope{i}\n")).collect::<String>() + "state x = 1\neq d/dt x = 0\n";
    let path = file("many", "many.eq", model);
    let output = smpl(&["check", "--format", "json", path.to_str().expect("utf-8")]);
    assert_eq!(status(&output), 1);
    let objects: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let list = objects.as_array().expect("an array");
    assert_eq!((list.len(), list[49]["line"].as_u64()), (51, Some(50)));
    assert_eq!((list[50]["code"].as_str(), list[50]["severity"].as_str()), (Some("E0115-more-faults"), Some("info")));
    assert_eq!(list[50]["message"].as_str(), Some("1184 more faults are not shown"));
}

/// The stack was so large that no thread could be started, and nothing was said.
#[cfg(target_os = "linux")]
#[test]
fn it_runs_in_little_address_space() {
    let path = file("little", "little.eq", "model M\ntime t : s\nstate x = 1\neq d/dt x = -x / 1 [s]\n");
    let limited = "ulimit -v 400000; exec \"$0\" check \"$1\"";
    let output = Command::new("sh").args(["-c", limited, env!("CARGO_BIN_EXE_smpl")]).arg(path).output().expect("sh runs");
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
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

const TANK: &str = "model Tank\ntime t : min\nparam k : 1/min = 2\nstate x : 1 = 1 in 0..2\nstate y : 1 = 1 in 0..2\naction u : 1 = 1 in 0..2\nlet rate : 1/min = k * x \"decay\"\n\
                    eq d/dt x = u * k - rate\neq d/dt y = u * k - rate\nsteady { u = 1, y = 0.5 }\nreward r default = -x\nobserve x\n";

#[test]
fn tables_that_say_a_thing_twice_or_never_end_it_are_refused() {
    let model = file("tables", "m.eq", TANK);
    let cases = [("u,u\n1,1\n", "two columns are named `u`", "a.csv:1:1"), ("u,note\n1,\"open\n1,x\n", "never closed", "a.csv:2:1")];
    for (content, message, place) in cases {
        let actions = file("tables", "a.csv", content);
        let output = smpl(&["simulate", model.to_str().expect("utf-8"), "--actions", actions.to_str().expect("utf-8")]);
        let shown = text(&output.stderr);
        assert!(status(&output) == 1 && shown.contains(message) && shown.contains(place), "{shown}");
    }
    let actions = file("tables", "z.csv", "z\n1\n");
    let output = smpl(&["simulate", model.to_str().expect("utf-8"), "--disturbances", actions.to_str().expect("utf-8")]);
    assert!(status(&output) == 1 && text(&output.stderr).contains("declares no disturbances"), "{}", text(&output.stderr));
}

#[test]
fn a_setting_that_is_no_finite_number_is_refused_once() {
    let model = file("settings", "m.eq", TANK);
    for value in ["nan", "1e999", "hot"] {
        let output = smpl(&["check", model.to_str().expect("utf-8"), "--set", &format!("k={value}")]);
        let shown = text(&output.stderr);
        assert_eq!((status(&output), shown.matches("`k`").count()), (1, 1), "{shown}");
    }
}

#[test]
fn an_unknown_policy_lists_each_policy_once() {
    let model = file("policy", "m.eq", TANK);
    let output = smpl(&["simulate", model.to_str().expect("utf-8"), "--policy", "foo"]);
    let shown = text(&output.stderr);
    assert!(status(&output) == 1 && shown.matches("nominal").count() == 1, "{shown}");
}

/// x and y have the same rate: with y fixed and x at rest y is at rest too; with x fixed at 0.5 it is not, and the command says so.
#[test]
fn the_residual_norm_is_that_of_the_equations_that_were_solved() {
    let model = file("steady", "m.eq", TANK);
    let name = model.to_str().expect("utf-8");
    let first = text(&smpl(&["steady", name]).stdout);
    assert!(!first.contains("held at given values"), "{first}");
    let second = text(&smpl(&["steady", name, "--fix", "x=0.5"]).stdout);
    assert!(second.contains("residual norm 0.000e0") && second.contains("= 1.000e0 is the largest rate"), "{second}");
}

#[test]
fn a_definition_counts_as_an_algebraic_variable_and_every_phase_has_its_time() {
    let model = file("count", "m.eq", TANK);
    let shown = text(&smpl(&["compile", model.to_str().expect("utf-8")]).stdout);
    assert!(shown.contains("1 declared, 0 solved, 1 substituted"), "{shown}");
    for phase in ["text to equations", "differentiation", "hoisting, layout", "code generation"] {
        assert!(shown.contains(phase), "{shown}");
    }
}

#[test]
fn a_stage_of_the_compilation_goes_where_it_is_asked_to() {
    let model = file("emit", "m.eq", TANK);
    let (name, out) = (model.to_str().expect("utf-8"), model.with_file_name("m.json"));
    assert_eq!(status(&smpl(&["compile", name, "--emit", "json", "-o", out.to_str().expect("utf-8")])), 0);
    let written: serde_json::Value = serde_json::from_slice(&std::fs::read(&out).expect("a file")).expect("JSON");
    assert_eq!(written["states"].as_array().map(Vec::len), Some(2));
}

#[test]
fn json_stays_json_when_invariants_are_asked_for() {
    let model = file("invariants", "m.eq", format!("{TANK}invariant same = x - y rate 0 [1/min]\n"));
    let output = smpl(&["check", "--format", "json", "--invariants", model.to_str().expect("utf-8")]);
    assert!(serde_json::from_slice::<serde_json::Value>(&output.stdout).is_ok(), "{}{}", text(&output.stdout), text(&output.stderr));
}
