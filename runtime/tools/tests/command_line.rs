//! The command line from outside: exit status, what goes where, no panic on any input.

mod shell;

use std::path::PathBuf;
use std::process::{Command, Stdio};

use shell::{COOLER, beside, file, name, smpl, status, text};

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
        &["simulate", "m.eq", "--plot", "p.gif"],
        &["simulate", "m.eq", "--out", "t.xlsx"],
        &["simulate", "m.eq", "--summary", "t.json"],
        &["simulate", "m.eq", "--show", "x"],
        &["simulate", "m.eq", "--episodes", "0"],
        &["simulate", "m.eq", "--sweep", "k"],
        &["simulate", "m.eq", "--sweep", "k=1..2"],
        &["simulate", "m.eq", "--sweep", "k=0..2:3log"],
        &["plot", "t.csv"],
        &["plot", "-o", "p.svg"],
        &["plot", "t.csv", "-o", "p.bmp"],
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
fn json_diagnostics_have_notes_and_related_places() {
    let path = file(
        "notes",
        "ring.eq",
        "model M\nstate x = 1\nstate y = 0\neq d/dt x = -x / 1 [s]\neq d/dt y = -y / 1 [s]\neq x^2 + y^2 = 1\n\
         episode { step = 1 [s], max_steps = 2 }\n",
    );
    let output = smpl(&["check", "--format", "json", path.to_str().expect("utf-8")]);
    let objects: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let [fault] = objects.as_array().expect("an array").as_slice() else { panic!("{objects}") };
    let notes: Vec<&str> = fault["notes"].as_array().expect("notes").iter().filter_map(|n| n.as_str()).collect();
    assert_eq!(notes, ["its time derivative is `eq 2*x*d/dt x + 2*y*d/dt y = 0`"]);
    let path = file("related", "twice.eq", "model M\nstate x = 1\nstate x = 2\neq d/dt x = 0\n");
    let output = smpl(&["check", "--format", "json", path.to_str().expect("utf-8")]);
    let objects: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let related = &objects[0]["related"][0];
    assert_eq!((related["line"].as_u64(), related["column"].as_u64()), (Some(2), Some(7)));
    assert!(related["message"].as_str().is_some_and(|text| !text.is_empty()), "{related}");
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

/// The stack was so large that no thread could be started, and nothing was reported.
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

#[test]
fn results_never_replace_what_is_read() {
    let model = file("replace", "m.eq", format!("use \"part.eqn\"\n{COOLER}"));
    file("replace", "part.eqn", "def twice_of(x) = 2*x\n");
    let scenario = file("replace", "m.s.yaml", "max_steps: 4\n");
    let data = file("replace", "a.csv", "F,w,T\n1,0,10\n");
    let link = beside(&model, "link.csv");
    let _ = std::fs::remove_file(&link);
    #[cfg(unix)]
    std::os::unix::fs::symlink("m.eq", &link).expect("a link");
    #[cfg(not(unix))]
    std::fs::hard_link(&model, &link).expect("a link");
    let texts = || [&model, &scenario, &data, &beside(&model, "part.eqn")].map(|f| std::fs::read(f).expect("it is there"));
    let before = texts();
    let (m, import) = (name(&model), beside(&model, "part.eqn"));
    let cases: Vec<Vec<&str>> = vec![
        vec!["compile", m, "-o", m],
        vec!["compile", m, "-o", name(&link)],
        vec!["compile", m, "-o", name(&import)],
        vec!["compile", m, "--emit", "ast", "-o", name(&import)],
        vec!["compile", m, "--emit", "json", "-o", m],
        vec!["doc", m, "-o", m],
        vec!["steady", m, "--out", m],
        vec!["simulate", m, "--out", m],
        vec!["simulate", m, "--out", name(&link)],
        vec!["simulate", m, "--out", name(&import)],
        vec!["simulate", m, "--plot", name(&link)],
        vec!["simulate", m, "--scenario", name(&scenario), "--out", name(&scenario)],
        vec!["compile", m, "--scenario", name(&scenario), "--emit", "json", "-o", name(&scenario)],
        vec!["compile", m, "--scenario", "s", "--emit", "asm", "-o", name(&scenario)],
        vec!["doc", m, "--scenario", "s", "-o", name(&scenario)],
        vec!["simulate", m, "--actions", name(&data), "--out", name(&data)],
        vec!["simulate", m, "--disturbances", name(&data), "--out", name(&data)],
        vec!["simulate", m, "--init", name(&data), "--out", name(&data)],
    ];
    for mut case in cases {
        if case.contains(&"--plot") {
            let svg = case.len() - 1;
            // The name of a picture has the ending of its kind.
            let _ = std::fs::remove_file(beside(&model, "link.svg"));
            std::fs::hard_link(&model, beside(&model, "link.svg")).expect("a link");
            let picture = beside(&model, "link.svg");
            case.remove(svg);
            let mut case: Vec<String> = case.into_iter().map(str::to_owned).collect();
            case.push(name(&picture).to_owned());
            let output = smpl(&case.iter().map(String::as_str).collect::<Vec<_>>());
            assert_eq!(status(&output), 1, "{case:?}");
            continue;
        }
        let output = smpl(&case);
        assert_eq!(status(&output), 1, "{case:?}: {}", text(&output.stderr));
        assert!(text(&output.stderr).contains("would be overwritten"), "{case:?}: {}", text(&output.stderr));
    }
    assert!(before == texts());
    let both = smpl(&["simulate", m, "--out", name(&beside(&model, "both")), "--plot", name(&beside(&model, "both"))]);
    assert_eq!(status(&both), 1, "{}", text(&both.stderr));
}

#[cfg(target_os = "linux")]
mod devices {
    use super::*;
    use std::os::unix::fs::{FileTypeExt, PermissionsExt};

    /// A copy of a device in a new folder: the real ones are never put at risk. `None` where devices cannot be made.
    fn device(folder: &std::path::Path, kind: &str, numbers: Option<[&str; 2]>) -> Option<PathBuf> {
        let path = folder.join(kind);
        let _ = std::fs::remove_file(&path);
        let mut command = match numbers {
            Some([major, minor]) => {
                let mut command = Command::new("mknod");
                command.arg(&path).args(["c", major, minor]);
                command
            }
            None => {
                let mut command = Command::new("mkfifo");
                command.arg(&path);
                command
            }
        };
        let made = command.stderr(Stdio::null()).status().is_ok_and(|status| status.success());
        // A container may make devices that cannot be opened.
        let opens = numbers.is_none() || std::fs::OpenOptions::new().write(true).open(&path).is_ok();
        (made && opens).then_some(path)
    }

    #[test]
    fn devices_and_pipes_are_written_into() {
        let model = file("devices", "m.eq", COOLER);
        let folder = model.parent().expect("a folder").to_owned();
        if let Some(null) = device(&folder, "null", Some(["1", "3"])) {
            for arguments in [&["simulate", name(&model), "--out", name(&null)][..], &["compile", name(&model), "-o", name(&null)]] {
                assert_eq!(status(&smpl(arguments)), 0, "{arguments:?}");
                assert!(std::fs::symlink_metadata(&null).expect("there").file_type().is_char_device(), "{arguments:?}");
            }
        }
        if let Some(full) = device(&folder, "full", Some(["1", "7"])) {
            let output = smpl(&["simulate", name(&model), "--out", name(&full)]);
            assert_eq!(status(&output), 1);
            assert!(text(&output.stderr).contains("No space left"), "{}", text(&output.stderr));
            assert!(std::fs::symlink_metadata(&full).expect("there").file_type().is_char_device());
        }
        if let Some(pipe) = device(&folder, "pipe", None) {
            let reader = pipe.clone();
            let reader = std::thread::spawn(move || std::fs::read_to_string(reader).expect("text"));
            assert_eq!(status(&smpl(&["simulate", name(&model), "--out", name(&pipe)])), 0);
            assert!(reader.join().expect("read").starts_with("step,time,T,"));
            assert!(std::fs::symlink_metadata(&pipe).expect("there").file_type().is_fifo());
        }
    }

    #[test]
    fn what_may_never_end_is_not_read() {
        let model = file("endless", "m.eq", COOLER);
        let folder = model.parent().expect("a folder").to_owned();
        let devices = [device(&folder, "zero", Some(["1", "5"])), device(&folder, "pipe", None)];
        for path in devices.iter().flatten().map(|path| name(path)) {
            let scenario = format!("{path}.yaml");
            let _ = std::fs::remove_file(&scenario);
            std::os::unix::fs::symlink(path, &scenario).expect("a link");
            let importing = file("endless", "i.eq", format!("use \"{}\"\n{COOLER}", path.rsplit('/').next().expect("a name")));
            let m = name(&model);
            for arguments in [
                &["check", path][..],
                &["fmt", path],
                &["doc", path],
                &["compile", path],
                &["compile", "--emit", "ast", path],
                &["check", name(&importing)],
                &["simulate", m, "--scenario", &scenario],
                &["simulate", m, "--actions", path],
                &["simulate", m, "--init", path],
                &["simulate", m, "--disturbances", path],
            ] {
                let output = smpl(arguments);
                assert_eq!(status(&output), 1, "{arguments:?}");
                assert!(!output.stderr.is_empty(), "{arguments:?}");
            }
        }
    }

    #[test]
    fn links_are_followed_and_permissions_are_kept() {
        let model = file("links", "m.eq", "model   M\nparam a:1=1\n");
        let mode = |path: &std::path::Path, mode| std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("its mode");
        let of = |path: &std::path::Path| std::fs::metadata(path).expect("there").permissions().mode() & 0o777;
        mode(&model, 0o600);
        let link = beside(&model, "link.eq");
        let _ = std::fs::remove_file(&link);
        std::os::unix::fs::symlink("m.eq", &link).expect("a link");
        assert_eq!(status(&smpl(&["fmt", name(&link)])), 0);
        assert!(std::fs::symlink_metadata(&link).expect("there").is_symlink());
        assert_eq!((of(&model), std::fs::read_to_string(&model).expect("text").starts_with("model M\n")), (0o600, true));

        let cooler = file("links", "c.eq", COOLER);
        let dangling = beside(&cooler, "dangling.csv");
        let _ = std::fs::remove_file(&dangling);
        let _ = std::fs::remove_file(beside(&cooler, "behind.csv"));
        std::os::unix::fs::symlink("behind.csv", &dangling).expect("a link");
        assert_eq!(status(&smpl(&["simulate", name(&cooler), "--out", name(&dangling)])), 0);
        assert!(std::fs::symlink_metadata(&dangling).expect("there").is_symlink());
        assert!(std::fs::read_to_string(beside(&cooler, "behind.csv")).expect("text").starts_with("step,"));
        let around = beside(&cooler, "around.csv");
        let _ = std::fs::remove_file(&around);
        std::os::unix::fs::symlink("around.csv", &around).expect("a link");
        assert_eq!(status(&smpl(&["simulate", name(&cooler), "--out", name(&around)])), 1);
    }

    /// The part file of the old kind had a name that could be foreseen: links in its place were followed.
    #[test]
    fn part_files_have_names_that_nobody_foresees_and_are_not_left_behind() {
        let model = file("parts", "m.eq", COOLER);
        let victim = file("parts", "victim", "untouched");
        let out = beside(&model, "t.csv");
        let mut child = Command::new("sh")
            .args(["-c", "for i in $(seq 0 3); do ln -sf victim \".t.csv.$$.part\"; done; exec \"$0\" simulate m.eq --out t.csv"])
            .arg(env!("CARGO_BIN_EXE_smpl"))
            .current_dir(model.parent().expect("a folder"))
            .stdout(Stdio::null())
            .spawn()
            .expect("a shell");
        assert!(child.wait().expect("ends").success());
        assert_eq!(std::fs::read_to_string(&victim).expect("text"), "untouched");
        assert!(std::fs::symlink_metadata(&out).expect("there").is_file());
        let left = std::fs::read_dir(model.parent().expect("a folder")).expect("a folder").flatten();
        let parts = left.filter(|e| e.file_name().to_string_lossy().ends_with(".part") && !e.path().is_symlink());
        assert_eq!(parts.count(), 0);
    }
}

#[test]
fn a_minus_is_the_standard_output() {
    let model = file("minus", "m.eq", COOLER);
    for out in ["-", "/dev/stdout"] {
        let output = smpl(&["simulate", name(&model), "--out", out]);
        assert_eq!(status(&output), 0);
        let lines: Vec<String> = text(&output.stdout).lines().map(str::to_owned).collect();
        assert_eq!(lines.len(), 7, "{lines:?}");
        assert!(lines[0].starts_with("step,time,T,") && text(&output.stderr).contains("5 steps"), "{}", text(&output.stderr));
    }
    assert!(text(&smpl(&["steady", name(&model), "--out", "-"]).stdout).starts_with("name,unit,value\n"));
}

/// x = 0.5 + 0.4 at rest, and a step there adds 1 - 0.9 to I.
#[test]
fn a_steady_state_says_which_discrete_variables_a_step_would_change() {
    let loop_with = |rate: &str| {
        format!(
            "model M\ntime t : s\nstate x = 3\ndiscrete I = 0\ndiscrete v : m = 0.4\nat start {{ next I = I + {rate}; next v = v + 2*I*1 [m] }}
             eq d/dt x = (0.5 + value(v) - x)/1 [s]\nepisode {{ step = 1 [s], max_steps = 5 }}\n"
        )
    };
    let moving = text(&smpl(&["steady", name(&file("steady_moving", "m.eq", loop_with("1 - x")))]).stdout);
    assert!(moving.contains("x = 0.9\n") && moving.contains("a control step change them here: I = 0, next 0.1\n"), "{moving}");
    let resting = text(&smpl(&["steady", name(&file("steady_resting", "m.eq", loop_with("0")))]).stdout);
    assert!(resting.contains("x = 0.9\n") && !resting.contains("held at"), "{resting}");
}
