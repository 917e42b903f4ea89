//! Answers of the commands about models: settings, steady states, records, places of faults.

mod shell;

use std::process::{Command, Output};

use shell::{COOLER, beside, file, name, smpl, status, text};

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
    // Entries that are not read may be repeated.
    let actions = file("tables", "b.csv", "u,note,note\n1,a,b\n");
    let output = smpl(&["simulate", model.to_str().expect("utf-8"), "--actions", actions.to_str().expect("utf-8")]);
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
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

/// x and y have the same rate: with y fixed and x at rest y is at rest too. With x fixed at 0.5 it is not, and the command reports it.
#[test]
fn the_residual_norm_is_that_of_the_equations_that_were_solved() {
    let model = file("steady", "m.eq", TANK);
    let name = model.to_str().expect("utf-8");
    let first = text(&smpl(&["steady", name]).stdout);
    assert!(!first.contains("held at given values"), "{first}");
    let second = text(&smpl(&["steady", name, "--fix", "x=0.5"]).stdout);
    assert!(
        second.contains("residual norm 0.000e0") && second.contains("2 states are held") && second.contains(" = 1.000e0\n"),
        "{second}"
    );
}

const EXCHANGE: &str =
    "model M\ntime t : s\nstate A = 1 in 0..9, B = 0 in 0..9\neq d/dt A = (2*B - A)/1 [s]\neq d/dt B = (A - 2*B)/1 [s]\n";

#[test]
fn a_conserved_sum_is_asked_for_and_a_state_of_it_can_be_fixed() {
    for block in ["", "steady { }\n"] {
        let model = file("conserved", "m.eq", format!("{EXCHANGE}{block}"));
        let name = model.to_str().expect("utf-8");
        let refused = smpl(&["steady", name]);
        assert_eq!(status(&refused), 1);
        assert!(text(&refused.stderr).contains("A + B (1 at the first guess) is conserved"), "{}", text(&refused.stderr));
        let shown = text(&smpl(&["steady", name, "--fix", "B=1"]).stdout);
        assert!(shown.contains("A = 2\n") && shown.contains("B = 1\n"), "{shown}");
    }
    let model = file("conserved", "n.eq", format!("{EXCHANGE}steady {{ A + B = 6 }}\n"));
    let name = model.to_str().expect("utf-8");
    assert!(text(&smpl(&["steady", name]).stdout).contains("A = 4\nB = 2\n"));
    // A state that is fixed takes the place of the sum that it belongs to.
    assert!(text(&smpl(&["steady", name, "--fix", "B=1"]).stdout).contains("A = 2\nB = 1\n"));
}

/// x' = x - x^3 rests at -1, 0 and 1; max(0, 1 - x) has two slopes at 1.
#[test]
fn a_guess_chooses_the_steady_state_and_the_others_and_one_sided_stability_are_told() {
    let three = "model M\ntime t : s\nstate x = 0.9 in -3..3\nvar z = 0\neq z + z^3 = x\neq d/dt x = (x - x^3)/1 [s]\ninitial x = 0.8\n";
    let model = file("guess", "m.eq", three);
    let name = model.to_str().expect("utf-8");
    let shown = text(&smpl(&["steady", name]).stdout);
    assert!(shown.contains("\nx = 1\n") && shown.contains("\nstable;") && !shown.contains("one-sided"), "{shown}");
    assert!(shown.contains(": x = -1\n") && shown.contains(": x = 0\n"), "{shown}");
    for (guess, rest) in [("x=-2", "x = -1"), ("x=0.01", "x = 0")] {
        let shown = text(&smpl(&["steady", name, "--guess", guess, "--guess", "z=0.1"]).stdout);
        assert!(shown.lines().nth(1).is_some_and(|line| line.starts_with(rest)), "{shown}");
    }
    let table = file("guess", "i.csv", "x\n-2\n");
    let shown = text(&smpl(&["steady", name, "--init", table.to_str().expect("utf-8")]).stdout);
    assert!(shown.contains("\nx = -1\n"), "{shown}");
    let tie = "model M\ntime t : s\nstate x = 0.5\neq d/dt x = (max(0, 1 - x) - 10*max(0, x - 1))/1 [s]\n";
    let model = file("guess", "n.eq", tie);
    let shown = text(&smpl(&["steady", model.to_str().expect("utf-8")]).stdout);
    assert!(shown.contains("one-sided: ") && shown.contains("n.eq:4, d/dt x"), "{shown}");
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

/// A title of the window, a colour, and the introducer of one character: what a terminal would obey is shown as text.
#[test]
fn what_stands_in_texts_and_names_of_files_does_not_reach_the_terminal_as_control() {
    let evil = "\u{1b}]0;title\u{7}\u{1b}[31m\u{9b}31m";
    let model = file("control", &format!("m{evil}.eq"), format!("model M \"{evil}\"\nlet a = nope # {evil}\nlet b = \u{1b}\n"));
    let good = file("control", &format!("good{evil}.eq"), format!("model M \"{evil}\"\n{}", &TANK[TANK.find('\n').unwrap_or(0)..]));
    let missing = format!("{}{evil}", name(&model));
    let artefact = format!("{}c", name(&good));
    for arguments in [
        vec!["check", name(&model)],
        vec!["check", name(&good)],
        vec!["check", &missing],
        vec!["compile", name(&good), "-o", &artefact],
        vec!["simulate", name(&good), "--policy", evil],
        vec!["simulate", name(&good), "--out", "/dev/null"],
    ] {
        let output = smpl(&arguments);
        let shown = text(&output.stdout) + &text(&output.stderr);
        assert!(!shown.is_empty(), "{arguments:?}");
        assert!(!shown.contains(|c: char| c.is_control() && c != '\n'), "{arguments:?}: {shown:?}");
    }
}

#[test]
fn an_episode_that_ends_before_its_limit_is_told_with_its_invariants() {
    let rest = "invariant same = x - x\nfail high event x > 2.5\nepisode { step = 1 [min], max_steps = 9 }\n";
    let model = format!("model M\ntime t : min\nstate x = 0 in 0..9\naction u = 0 in 0..9\neq d/dt x = u/1 [min]\n{rest}");
    let idle = file("early", "idle.eq", &model);
    let driven = file("early", "driven.eq", format!("{model}policy nominal {{ u = 1 }}\n"));
    let shown = |path: &std::path::Path| text(&smpl(&["check", "--invariants", name(path)]).stdout);
    assert!(shown(&idle).contains("over 9 steps") && !shown(&idle).contains("ended"), "{}", shown(&idle));
    // The declared policy is what runs: one in each minute.
    assert!(shown(&driven).contains("the episode ended after 3 of 9 steps: failed: high"), "{}", shown(&driven));
}

/// The last row of a trajectory by column.
fn last_row(output: &Output) -> std::collections::BTreeMap<String, String> {
    let shown = text(&output.stdout);
    let mut lines = shown.lines();
    let heading: Vec<&str> = lines.next().unwrap_or_else(|| panic!("{}", text(&output.stderr))).split(',').collect();
    let last: Vec<&str> = lines.last().expect("a row").split(',').collect();
    heading.into_iter().map(str::to_owned).zip(last.into_iter().map(str::to_owned)).collect()
}

fn number(row: &std::collections::BTreeMap<String, String>, name: &str) -> f64 {
    row[name].parse().unwrap_or_else(|_| panic!("{name}: {row:?}"))
}

/// With one fault at 1 nothing leaves: T rises by F a minute. The closed form without: T' = F - k g 2g T.
#[test]
fn arrays_of_parameters_are_set_by_element_by_one_value_or_by_a_list() {
    let model = file("arrays", "m.eq", COOLER);
    let still = ["--set", "k=0", "--out", "-", "--scenario", "quiet"];
    file("arrays", "m.quiet.yaml", "disturbances: false\n");
    let base = [&["simulate", name(&model)][..], &still].concat();
    assert!((number(&last_row(&smpl(&base)), "T") - 15.0).abs() < 1e-6);
    let with = |more: &[&str]| {
        let quiet = ["simulate", name(&model), "--out", "-", "--scenario", "quiet", "--set", "gain=1"];
        number(&last_row(&smpl(&[&quiet[..], more].concat())), "T")
    };
    let free = 1.0 + 9.0 * (-5.0_f64).exp();
    assert!((with(&[]) - free).abs() < 1e-4, "{}", with(&[]));
    for set in ["fault[1]=1", "fault[3]=1", "fault=1", "fault=[0, 1, 0]"] {
        assert!((with(&["--set", set]) - 15.0).abs() < 1e-6, "{set}: {}", with(&["--set", set]));
    }
    let half = 2.0 + 8.0 * (-2.5_f64).exp();
    assert!((with(&["--set", "fault[2]=0.5"]) - half).abs() < 1e-4);
    assert!((with(&["--set", "fault=0.5", "--set", "fault[1]=1"]) - 15.0).abs() < 1e-6);
    for (i, content) in
        ["parameters: {fault: [0, 0.5, 0]}", "parameters:\n  fault[2]: 0.5", "settings: {\"fault[2]\": 0.5}"].iter().enumerate()
    {
        let scenario = file("arrays", &format!("s{i}.yaml"), format!("disturbances: false\n{content}\n"));
        let output = smpl(&["simulate", name(&model), "--out", "-", "--scenario", name(&scenario), "--set", "gain=1"]);
        assert!((number(&last_row(&output), "T") - half).abs() < 1e-4, "{content}: {}", text(&output.stderr));
        let output = smpl(&["simulate", name(&model), "--out", "-", "--scenario", name(&scenario), "--set", "gain=1", "--set", "fault=0"]);
        assert!((number(&last_row(&output), "T") - free).abs() < 1e-4, "{content}: {}", text(&output.stderr));
    }
}

/// A drawn array: the element that is set stays as it is, the others are drawn.
#[test]
fn an_element_that_is_set_is_not_drawn() {
    let drawn = COOLER.replacen("param fault[side] = 0 in 0..1", "param fault[side] = 0 ~ uniform(0.2, 0.8) in 0..1", 1);
    let model = file("element", "m.eq", drawn);
    for set in ["fault[2]=0.125", "fault[ 2 ]=0.125"] {
        let row = last_row(&smpl(&["simulate", name(&model), "--steps", "1", "--set", set, "--out", "-"]));
        let [one, two, three] = [1, 2, 3].map(|i| number(&row, &format!("param.fault[{i}]")));
        assert!(two == 0.125 && one > 0.2 && three > 0.2 && one != three, "{set}: {row:?}");
    }
}

#[test]
fn what_a_setting_cannot_be_is_said_with_what_can_be() {
    let model = file("unknown", "m.eq", COOLER);
    for (set, wording) in [
        ("fault[4]=1", "fault[1], fault[2], fault[3]"),
        ("fault[x]=1", "not an element of the parameter `fault`"),
        ("fault=[0, 1]", "has 3 elements, not 2"),
        ("F=0.3", "`F` is an action"),
        ("F=0.3", "--actions"),
        ("T=3", "`T` is a state"),
        ("w=3", "`w` is a disturbance"),
        ("rr=3", "k, gain, twice, fault"),
        ("k=5", "`k` = 5 is outside its bounds 0..4 1/min"),
        ("fault[2]=-1", "`fault[2]` = -1 is outside"),
        ("rtol=1e10", "`rtol` must be between 1e-15 and 1, not 10000000000"),
        ("rtol=1e-20", "`rtol` must be between"),
        ("max_order=99", "a whole number from 1 to 5"),
        ("max_steps=0", "from 1 to 4000000000"),
        ("step=0", "a positive number"),
        ("atol_factor=-1", "a positive number"),
        ("linear_solver=foo", "auto, dense, block or klu"),
    ] {
        let output = smpl(&["check", name(&model), "--set", set]);
        let shown = text(&output.stderr);
        assert_eq!(status(&output), 1, "{set}: {shown}");
        let unwrapped = shown.lines().map(|l| l.trim_start_matches([' ', '│', '×', '✖'])).collect::<Vec<_>>().join(" ");
        assert!(unwrapped.contains(wording) && shown.contains("settings:1:1"), "{set}: {shown}");
    }
}

/// Values beyond the range that `docs/solver.md` gives for each setting.
#[test]
fn solver_settings_have_one_range_in_scenarios_and_settings() {
    let model = file("ranges", "m.eq", COOLER);
    for (entry, setting, value, expected) in [
        ("rtol", "rtol", "2", "between 1e-15 and 1, not 2"),
        ("one_step_rtol", "one_step_rtol", "0", "between 1e-15 and 1, not 0"),
        ("atol_factor", "atol_factor", "0", "a positive number, not 0"),
        ("max_order", "max_order", "6", "a whole number from 1 to 5, not 6"),
        ("max_steps", "max_internal_steps", "0", "a whole number from 1 to 4000000000, not 0"),
        ("max_step", "max_step", "-1", "a positive number, not -1"),
    ] {
        let scenario = file("ranges", "s.yaml", format!("solver: {{{entry}: {value}}}\n"));
        let unwrapped = |arguments: &[&str]| {
            let output = smpl(arguments);
            assert_eq!(status(&output), 1, "{entry}");
            text(&output.stderr).lines().map(|l| l.trim_start_matches([' ', '│', '×', '✖'])).collect::<Vec<_>>().join(" ")
        };
        let shown = unwrapped(&["check", name(&model), "--scenario", name(&scenario)]);
        assert!(shown.contains(&format!("`{entry}` must be {expected}")), "{shown}");
        let shown = unwrapped(&["check", name(&model), "--set", &format!("{setting}={value}")]);
        assert!(shown.contains(&format!("`{setting}` must be {expected}")), "{shown}");
    }
    let scenario = file("ranges", "s.yaml", "solver: {max_step: .inf, max_order: 5, max_steps: 1}\n");
    assert_eq!(status(&smpl(&["check", name(&model), "--scenario", name(&scenario)])), 0);
}

#[test]
fn faults_of_a_scenario_stand_where_they_are() {
    let model = file("places", "m.eq", COOLER);
    for (content, wording, place) in [
        (&b"max_steps: 3\ninitial: {nope: 1}\n"[..], "unknown state or discrete variable `nope`", ":2:11"),
        (b"parameters:\n  k: 9\n", "is outside its bounds", ":2:3"),
        (b"initial:\n  T: -5\n", "is outside its bounds", ":2:3"),
        (b"parameters: {T: 3}\n", "is a state", ":1:14"),
        (b"noise:\n  T: 0.1\n  Q: 0.2\n", "unknown observation `Q`", ":3:3"),
        (b"noise: {T: -1}\n", "a standard deviation", ":1:9"),
        (b"disturbances: {z: [1, 2]}\n", "unknown disturbance `z`", ":1:16"),
        (b"max_steps: 7\nsolver: {max_order: 99}\n", "`max_order` must be", ":2:10"),
        (b"parameters: {k: 1, k: 2}\n", "is given twice", ":1:20"),
        (b"max_steps: 3\n# \xff\n", "not UTF-8", ":2:3"),
        (b"initial: {T: \"uniform(0, 1)\\neq d/dt T = 0 [K/min]\"}\n", "one expression", ":1:11"),
        (b"initial: {T: \"uniform(0, 1) ; param q = 1\"}\n", "one expression", ":1:11"),
        (b"initial: {T: \"uniform(0, 1) clip 0..1\"}\n", "one expression", ":1:11"),
        (b"initial: {\"T = 1 ; initial T\": \"uniform(0, 1)\"}\n", "one expression", ":1:1"),
    ] {
        let scenario = file("places", "s.yaml", content);
        let output = smpl(&["check", name(&model), "--scenario", name(&scenario)]);
        let shown = text(&output.stderr);
        assert_eq!(status(&output), 1, "{}: {shown}", String::from_utf8_lossy(content));
        let unwrapped = shown.lines().map(|l| l.trim_start_matches([' ', '│', '×', '✖'])).collect::<Vec<_>>().join(" ");
        assert!(unwrapped.contains(wording) && shown.contains(&format!("s.yaml{place}")), "{}: {shown}", String::from_utf8_lossy(content));
    }
    let scenario = file("places", "right.yaml", "initial: {T: \"uniform(20, 21)\"}\n");
    let row = last_row(&smpl(&["simulate", name(&model), "--scenario", name(&scenario), "--steps", "1", "--set", "k=0", "--out", "-"]));
    let disturbed = number(&row, "T") - 1.0 - number(&row, "w");
    assert!((20.0..21.0).contains(&disturbed), "{row:?}");
}

#[test]
fn what_no_model_can_mean_is_refused_in_its_text() {
    for (wrong, right, wording) in [
        ("= 0.5 in 0..4", "= 5 in 0..4", "is outside its bounds 0..4 1/min"),
        ("= 10 in 0..100", "= 10 in 0..100 scale 0", "scale of `T` must be a positive number"),
        ("= 10 in 0..100", "= 10 in 0..100 scale -1", "scale of `T` must be a positive number"),
        ("step = 1 [min]", "step = inf", "`step` must be finite"),
        ("reward r", "solver { rtol = 1e10 }\nreward r", "`rtol` must be between 1e-15 and 1"),
        ("reward r", "solver { rtol = 1e-20 }\nreward r", "`rtol` must be between 1e-15 and 1"),
        ("reward r", "solver { max_order = 99 }\nreward r", "`max_order` must be a whole number from 1 to 5"),
    ] {
        assert!(COOLER.contains(wrong));
        let model = file("meaning", "m.eq", COOLER.replacen(wrong, right, 1));
        let output = smpl(&["check", name(&model)]);
        assert_eq!(status(&output), 1, "{right}");
        assert!(text(&output.stderr).contains(wording), "{right}: {}", text(&output.stderr));
    }
}

#[test]
fn a_compiled_model_runs_under_what_it_was_compiled_for_and_not_otherwise() {
    let model = file("artefact", "m.eq", format!("use \"part.eqn\"\n{COOLER}"));
    let part = file("artefact", "part.eqn", "def half(x) = x/2\n");
    let scenario = file("artefact", "m.legacy.yaml", "max_steps: 3\ndisturbances: false\nparameters: {k: 0}\n");
    let made = beside(&model, "m.smplc");
    let (m, c) = (name(&model), name(&made));
    let home = beside(&model, "home");
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_smpl"));
        command.args(arguments).env("XDG_DATA_HOME", &home).output().expect("smpl runs")
    };
    let refused = |arguments: &[&str], wording: &str| {
        let output = run(arguments);
        assert_eq!(status(&output), 1, "{arguments:?}");
        assert!(text(&output.stderr).contains(wording), "{arguments:?}: {}", text(&output.stderr));
    };
    assert_eq!(status(&run(&["compile", m])), 0);
    assert_eq!(status(&run(&["simulate", c])), 0);
    refused(&["simulate", c, "--scenario", "legacy"], "`legacy`");
    refused(&["simulate", c, "--set", "rtol=1e-3"], "`rtol` is set where it is compiled");
    refused(&["simulate", c, "--set", "k=9"], "is outside its bounds");
    refused(&["compile", c, "-o", name(&beside(&model, "again.smplc"))], "compiled already");
    // What is imported counts, whatever its name.
    std::fs::write(&part, "def half(x) = x/3\n").expect("written");
    refused(&["simulate", c], "has changed since");
    assert_eq!(status(&run(&["compile", m])), 0);
    // A source that cannot be read is not trusted.
    let text_of_model = std::fs::read(&model).expect("text");
    std::fs::remove_file(&model).expect("removed");
    std::fs::create_dir(&model).expect("a folder in its place");
    refused(&["simulate", c], "cannot be read");
    std::fs::remove_dir(&model).expect("removed");
    assert_eq!(status(&run(&["simulate", c])), 0, "without a source next to it, it is valid alone");
    std::fs::write(&model, &text_of_model).expect("written");

    assert_eq!(status(&run(&["compile", m, "--scenario", "legacy", "--set", "gain=1"])), 0);
    refused(&["simulate", c], "`legacy`");
    let output = run(&["simulate", c, "--scenario", "legacy", "--out", "-"]);
    let row = last_row(&output);
    assert!(number(&row, "step") == 3.0 && number(&row, "w") == 0.0 && (number(&row, "T") - 13.0).abs() < 1e-6, "{row:?}");
    assert!(text(&output.stderr).contains("compiled for scenario legacy, gain = 1"), "{}", text(&output.stderr));
    std::fs::write(&scenario, "max_steps: 2\n").expect("written");
    refused(&["simulate", c, "--scenario", "legacy"], "has changed since");
}

#[test]
fn records_that_end_early_are_said() {
    let model = file("records", "m.eq", COOLER);
    let long = file("records", "long.csv", "F,w\n1,0\n1,0\n1,0\n1,0\n1,0\n");
    let short = file("records", "short.csv", "F,w\n1,0\n1,0.5\n");
    let run = |option: &str, data: &std::path::Path| smpl(&["simulate", name(&model), option, name(data)]);
    assert!(run("--actions", &long).stderr.is_empty() && run("--disturbances", &long).stderr.is_empty());
    let (actions, disturbances) = (run("--actions", &short), run("--disturbances", &short));
    assert!(text(&actions.stderr).contains("short.csv: the actions end after step 2 of 5"), "{}", text(&actions.stderr));
    assert!(text(&disturbances.stderr).contains("short.csv: the disturbance `w` ends after step 2"), "{}", text(&disturbances.stderr));
    let single = file("records", "single.csv", "F,w\n1,0\n");
    let output = run("--disturbances", &single);
    assert!(text(&output.stderr).contains("single.csv: the disturbance `w` ends after step 1"), "{}", text(&output.stderr));
    let scenario = file("records", "h.yaml", "disturbances: {w: {values: [0, 1], hold: true}}\n");
    assert!(smpl(&["simulate", name(&model), "--scenario", name(&scenario)]).stderr.is_empty());
    let scenario = file("records", "s.yaml", "disturbances: {w: [0, 1]}\n");
    let output = smpl(&["simulate", name(&model), "--scenario", name(&scenario)]);
    assert!(status(&output) == 0 && text(&output.stderr).contains("the disturbance `w` ends after step 2"), "{}", text(&output.stderr));
    let scenario = file("records", "c.yaml", "disturbances: {w: 1}\n");
    assert!(smpl(&["simulate", name(&model), "--scenario", name(&scenario)]).stderr.is_empty());
}

/// Without disturbances T follows its closed form with the drawn parameters of the last columns.
#[test]
fn a_trajectory_shows_the_parameters_that_were_drawn() {
    let model = file("drawn", "m.eq", COOLER);
    file("drawn", "m.quiet.yaml", "disturbances: false\n");
    for seed in ["1", "2"] {
        let output = smpl(&["simulate", name(&model), "--scenario", "quiet", "--seed", seed, "--out", "-"]);
        let heading = text(&output.stdout).lines().next().expect("a heading").to_owned();
        assert!(heading.ends_with("terminated,truncated,param.gain,param.twice"), "{heading}");
        let row = last_row(&output);
        let (gain, twice) = (number(&row, "param.gain"), number(&row, "param.twice"));
        assert!((0.5..1.5).contains(&gain) && twice == 2.0 * gain && gain != 1.0, "{row:?}");
        let rate = 0.5 * gain * twice;
        let expected = 1.0 / rate + (10.0 - 1.0 / rate) * (-5.0 * rate).exp();
        assert!((number(&row, "T") - expected).abs() < 1e-4 * expected.abs().max(1.0), "{row:?}, {expected}");
    }
}

#[test]
fn check_warns_of_what_is_hardly_meant() {
    let cases = [
        ("T : K = 10 in 0..100", "T : K = 100.5 in 0..100", "W0602-start-outside-bounds", "`T` starts at 100.5"),
        ("reward r", "initial T = -1 [K]\nreward r", "W0602-start-outside-bounds", "`T` starts at -1"),
        ("disturbance w", "steady { F = 1 }\naction G : K/min = 1 in 0..2\ndisturbance w", "W0603-incomplete-steady", "does not name `G`"),
        ("episode { step = 1 [min], max_steps = 5 }\n", "", "W0604-no-episode", "no `episode` block"),
        ("param twice", "param idle : 1/min = 3 # idle: a word in a comment\nparam twice", "W0202-unused-parameter", "`idle` is not used"),
    ];
    let sound = file("lints", "m.eq", COOLER);
    let output = smpl(&["check", name(&sound)]);
    assert!(status(&output) == 0 && output.stderr.is_empty(), "{}", text(&output.stderr));
    for (before, after, code, wording) in cases {
        assert!(COOLER.contains(before));
        let model = file("lints", "w.eq", COOLER.replacen(before, after, 1));
        let output = smpl(&["check", name(&model)]);
        let shown = text(&output.stderr);
        assert!(status(&output) == 0 && shown.contains(code) && shown.contains(wording), "{after}: {shown}");
        assert_eq!(shown.matches('⚠').count(), 1, "{shown}");
        assert!(smpl(&["simulate", name(&model)]).stderr.is_empty(), "{after}");
    }
}

/// Draws of a normal distribution leave bounds of one standard deviation in a third of all cases.
#[test]
fn a_draw_outside_of_its_bounds_is_no_episode() {
    let run = |drawn: &str, seed: usize| {
        let changed = COOLER.replacen("param gain = 1 ~ uniform(0.5, 1.5)", drawn, 1).replacen(
            "param twice = 2*gain",
            "param twice = 2*gain in 0..3",
            1,
        );
        let model = file("draws", "m.eq", changed);
        smpl(&["simulate", name(&model), "--steps", "1", "--seed", &seed.to_string(), "--out", "-"])
    };
    let (mut refused, mut inside) = (0, 0);
    for seed in 0..20 {
        let output = run("param gain = 1 ~ normal(1, 0.1) in 0.9..1.1", seed);
        match status(&output) {
            0 => {
                inside += 1;
                assert!((0.9..=1.1).contains(&number(&last_row(&output), "param.gain")));
            }
            _ => {
                refused += 1;
                assert!(
                    text(&output.stderr).contains("`gain` = ") && text(&output.stderr).contains("clip bounds"),
                    "{}",
                    text(&output.stderr)
                );
            }
        }
        let clipped = last_row(&run("param gain = 1 ~ normal(1, 0.1) clip bounds in 0.9..1.1", seed));
        assert!((0.9..=1.1).contains(&number(&clipped, "param.gain")));
    }
    assert!(refused > 0 && inside > 0, "{refused} and {inside}");
    let computed = run("param gain = 1 in 0..2", 0);
    assert_eq!(status(&computed), 0, "{}", text(&computed.stderr));
    let model = file("draws", "m.eq", COOLER.replacen("param twice = 2*gain", "param twice = 2*gain in 0..3", 1));
    let output = smpl(&["simulate", name(&model), "--set", "gain=1.6"]);
    assert!(status(&output) == 1 && text(&output.stderr).contains("`twice` = 3.2 is outside"), "{}", text(&output.stderr));
}

#[test]
fn further_statements_follow_those_of_the_file_and_are_named_where_they_are_at_fault() {
    let model = file("extra", "m.eq", "model M \"m\"\ntime t : s\nstate x = 1\neq d/dt x = -x / 1 [s]\n");
    let path = model.to_str().expect("a path");
    let output = smpl(&["check", path, "--extra", "reward size = x"]);
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
    let output = smpl(&["check", path, "--extra", "\nreward size = y"]);
    assert_eq!(status(&output), 1);
    assert!(text(&output.stderr).contains("extra:2:15"), "{}", text(&output.stderr));
    let output = smpl(&["compile", path, "--extra", "reward size = x"]);
    assert_eq!(status(&output), 1);
    assert!(text(&output.stderr).contains("belongs to a file"), "{}", text(&output.stderr));
    assert!(!model.with_extension("smplc").exists());
}

#[test]
fn fitting_without_the_python_package_says_what_is_missing() {
    let command = |python: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_smpl"));
        command.env("SMPL_PYTHON", python).args(["fit", "reactor", "--data", "run.csv", "--parameters", "U"]);
        command.output().expect("smpl runs")
    };
    for python in ["/nowhere/python", env!("CARGO_BIN_EXE_smpl")] {
        let output = command(python);
        assert_eq!(status(&output), 1, "{}", text(&output.stdout));
        let wording = text(&output.stderr);
        assert!(wording.contains(python) && wording.contains("install it and SciPy there") && wording.contains("SMPL_PYTHON"), "{wording}");
    }
}

#[test]
fn commands_of_the_python_package_name_it_where_it_is_missing() {
    for name in ["export-policy", "verify", "serve"] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_smpl"));
        let output = command.env("SMPL_PYTHON", "/nowhere/python").args([name, "reactor", "--help"]).output().expect("smpl runs");
        assert_eq!(status(&output), 1, "{}", text(&output.stdout));
        let wording = text(&output.stderr);
        assert!(
            wording.contains(&format!("smpl {name} is done by the Python package")) && wording.contains("/nowhere/python"),
            "{wording}"
        );
    }
}

/// x' + y' = u - x and x' - y' = 3 at x = u: x' = 1.5, y' = -1.5.
#[test]
fn coupled_rates_of_held_states_are_solved_for() {
    let coupled = "model M\ntime t : s\nstate x = 1 in -10..10\nstate y = 1 in -10..10\naction u = 1 in -5..5\n\
                   eq d/dt x + d/dt y = (u - x)/1[s]\neq d/dt x - d/dt y = 3/1[s]\nobserve x\nreward r = x\nepisode { step = 1 [s], max_steps = 5 }\n";
    let model = file("coupled", "m.eq", coupled);
    let output = smpl(&["steady", model.to_str().expect("utf-8"), "--fix", "y=1"]);
    let shown = text(&output.stdout);
    assert!(shown.contains("d/dt y = -1.500e0") && shown.contains("d/dt x = 1.500e0"), "{shown}{}", text(&output.stderr));
    assert!(shown.contains("not a steady state") && !shown.contains("stable"), "{shown}");
}

/// x = exp(t) reaches exp(20) = 4.85e8 after twenty hours.
#[test]
fn a_run_far_outside_of_the_bounds_of_a_state_is_reported() {
    let grows = "model M\ntime t : h\nstate x = 1 in 0..10\neq d/dt x = x*1[1/h]\nobserve x\nreward r = x\nepisode { step = 1 [h], max_steps = 20 }\n";
    let model = file("grows", "m.eq", grows);
    let name = model.to_str().expect("utf-8");
    let shown = text(&smpl(&["simulate", name]).stderr);
    assert!(shown.contains("`x` leaves its declared bounds") && shown.contains("at t = 20 h is above 10"), "{shown}");
    assert_eq!(shown.lines().count(), 1, "{shown}");
    let many = text(&smpl(&["simulate", name, "--episodes", "3"]).stderr);
    assert!(many.contains("in 3 runs") && many.contains("`x` leaves"), "{many}");
    let short = smpl(&["simulate", name, "--steps", "2"]);
    assert!(short.stderr.is_empty(), "{}", text(&short.stderr));
}

#[test]
fn seeds_of_64_bits_are_written_as_they_are() {
    let drawn = "model M\ntime t : h\nparam k : 1/h = 1 ~ uniform(0.5, 1.5)\nstate x = 1 in 0..10\neq d/dt x = -k*x\nobserve x\nreward r = x\n\
                 episode { step = 1 [h], max_steps = 2 }\n";
    let model = file("seeds", "m.eq", drawn);
    let name = model.to_str().expect("utf-8");
    let summary = beside(&model, "s.csv");
    let written = summary.to_str().expect("utf-8");
    let output = smpl(&["simulate", name, "--seed", "18446744073709551614", "--episodes", "2", "--summary", written]);
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
    let table = std::fs::read_to_string(&summary).expect("written");
    assert!(table.contains("18446744073709551614,") && table.contains("18446744073709551615,") && !table.contains(",-"), "{table}");
    let refused = smpl(&["simulate", name, "--seed", "18446744073709551615", "--episodes", "2"]);
    assert!(status(&refused) == 1 && text(&refused.stderr).contains("--seed"), "{}", text(&refused.stderr));
}
