//! Many runs at once, pictures of saved tables and new models, from the command line.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A decay whose end is known: x(3) = x(0) exp(-3 k); k is drawn unless it is given.
const DECAY: &str = "model Decay\nparam k : 1/s = 1 ~ uniform(0.5, 1.5) in 0.1..3\nparam n = 1\nstate x = 1 in 0.001..10\n\
    eq d/dt x = -n * k * x\nreward left default = x\nreward lost = 1 - x\nvariant double {\n  param n = 2\n}\n\
    fail gone when x < 0.01\nepisode { step = 1 [s], max_steps = 3 }\n";

fn folder(test: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("runs-{test}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(folder.join("decay.eq"), DECAY).expect("a model");
    folder
}

fn smpl(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_smpl")).current_dir(folder).args(arguments).output().expect("smpl runs")
}

fn succeeds(folder: &Path, arguments: &[&str]) -> String {
    let output = smpl(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn fails(folder: &Path, arguments: &[&str]) -> String {
    let output = smpl(folder, arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Names and rows of a table.
fn table(path: &Path) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_path(path).expect("a table");
    let names = reader.headers().expect("names").iter().map(str::to_owned).collect();
    let row = |record: Result<csv::StringRecord, csv::Error>| record.expect("a row").iter().map(str::to_owned).collect();
    (names, reader.records().map(row).collect())
}

fn column(path: &Path, name: &str) -> Vec<String> {
    let (names, rows) = table(path);
    let at = names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no column `{name}` among {names:?}"));
    rows.into_iter().map(|row| row[at].clone()).collect()
}

fn numbers(path: &Path, name: &str) -> Vec<f64> {
    column(path, name).iter().map(|text| text.parse().expect("a number")).collect()
}

#[test]
fn episodes_are_the_runs_of_their_seeds_bit_for_bit() {
    let folder = folder("episodes");
    succeeds(&folder, &["simulate", "decay.eq", "--seed", "5", "--episodes", "3", "--out", "all.csv"]);
    let (names, rows) = table(&folder.join("all.csv"));
    assert_eq!(names[..4], ["run", "seed", "step", "time"]);
    for (run, seed) in ["5", "6", "7"].iter().enumerate() {
        succeeds(&folder, &["simulate", "decay.eq", "--seed", seed, "--out", "one.csv"]);
        let (_, single) = table(&folder.join("one.csv"));
        let mine: Vec<Vec<String>> = rows.iter().filter(|row| row[0] == run.to_string()).map(|row| row[2..].to_vec()).collect();
        assert_eq!(mine, single, "seed {seed}");
        assert!(rows.iter().filter(|row| row[0] == run.to_string()).all(|row| row[1] == *seed));
    }
}

#[test]
fn sweeps_are_crossed_and_give_what_the_equations_say() {
    let folder = folder("sweep");
    let sweeps = ["--sweep", "k=0.5..1.5:3", "--sweep", "double=false,true", "--sweep", "x=1,2"];
    let wording = succeeds(&folder, &[&["simulate", "decay.eq", "--summary", "s.csv", "--out", "all.csv"], &sweeps[..]].concat());
    assert!(wording.contains("12 runs"), "{wording}");
    let path = folder.join("all.csv");
    let (k, start, time, x) = (numbers(&path, "k"), numbers(&path, "sweep.x"), numbers(&path, "time"), column(&path, "double"));
    assert_eq!(k.len(), 12 * 4 - said_steps_lost(&folder));
    let (names, rows) = table(&path);
    let state = names.iter().rposition(|name| name == "x").expect("the state");
    for (i, row) in rows.iter().enumerate() {
        let n = if x[i] == "true" { 2.0 } else { 1.0 };
        let exact = start[i] * (-n * k[i] * time[i]).exp();
        let found: f64 = row[state].parse().expect("a number");
        assert!((found / exact - 1.0).abs() < 1e-6, "row {i}: {found}, expected {exact}");
    }
}

/// Rows that runs are shorter because they failed.
fn said_steps_lost(folder: &Path) -> usize {
    numbers(&folder.join("s.csv"), "steps").iter().map(|steps| 3 - *steps as usize).sum()
}

#[test]
fn the_summary_has_returns_ends_and_drawn_parameters() {
    let folder = folder("summary");
    let wording = succeeds(&folder, &["simulate", "decay.eq", "--sweep", "k=0.5,2.5", "--summary", "s.csv"]);
    let path = folder.join("s.csv");
    let sums = numbers(&path, "return");
    // x after each of three steps; with k = 2.5 the second one, exp(-5), is below 0.01 and ends the run.
    let expected = (-0.5_f64).exp() + (-1.0_f64).exp() + (-1.5_f64).exp();
    assert!((sums[0] - expected).abs() < 1e-6, "{sums:?}");
    assert_eq!(column(&path, "end"), ["time limit", "gone"]);
    assert_eq!(column(&path, "steps"), ["3", "2"]);
    assert!(wording.contains("1 gone") && wording.contains("1 time limit"), "{wording}");
    succeeds(&folder, &["simulate", "decay.eq", "--episodes", "4", "--summary", "drawn.csv"]);
    let drawn = numbers(&folder.join("drawn.csv"), "param.k");
    assert!(drawn.iter().all(|k| (0.5..1.5).contains(k)) && drawn.windows(2).all(|pair| pair[0] != pair[1]), "{drawn:?}");
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let folder = folder("threads");
    for threads in ["1", "3"] {
        let (out, summary) = (format!("t{threads}.csv"), format!("s{threads}.csv"));
        let run = ["simulate", "decay.eq", "--episodes", "9", "--policy", "random", "--threads", threads];
        succeeds(&folder, &[&run[..], &["--out", &out, "--summary", &summary]].concat());
    }
    let same = |a: &str, b: &str| std::fs::read(folder.join(a)).expect("a file") == std::fs::read(folder.join(b)).expect("a file");
    assert!(same("t1.csv", "t3.csv") && same("s1.csv", "s3.csv"));
}

#[test]
fn a_run_that_cannot_begin_is_counted_and_the_others_go_on() {
    let folder = folder("broken");
    let output = smpl(&folder, &["simulate", "decay.eq", "--sweep", "k=1,9", "--summary", "s.csv"]);
    assert!(output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("is outside its bounds 0.1..3"));
    assert_eq!(column(&folder.join("s.csv"), "end"), ["time limit", "no run"]);
}

#[test]
fn names_that_cannot_be_swept_are_refused() {
    let folder = folder("names");
    assert!(fails(&folder, &["simulate", "decay.eq", "--sweep", "kk=1,2"]).contains("kk"));
    assert!(fails(&folder, &["simulate", "decay.eq", "--sweep", "k=a,b"]).contains("must be numbers"));
    assert!(fails(&folder, &["simulate", "decay.eq", "--sweep", "policy=nominal,brave"]).contains("unknown policy `brave`"));
    assert!(fails(&folder, &["simulate", "decay.eq", "--sweep", "scenario=default,nope"]).contains("unknown scenario `nope`"));
    assert!(fails(&folder, &["simulate", "decay.eq", "--sweep", "k=1..2:100000", "--sweep", "x=1..2:100000"]).contains("runs"));
}

#[test]
fn pictures_have_the_format_of_their_ending() {
    let folder = folder("formats");
    for (name, first) in [("p.svg", &b"<svg "[..]), ("p.png", b"\x89PNG\r\n"), ("p.pdf", b"%PDF-1."), ("p.html", b"<!DOCTYPE html>")] {
        succeeds(&folder, &["simulate", "decay.eq", "--plot", name]);
        let bytes = std::fs::read(folder.join(name)).expect("a picture");
        assert!(bytes.starts_with(first), "{name}");
    }
    let error = fails(&folder, &["simulate", "decay.eq", "--plot", "p.svg", "--show", "y"]);
    assert!(error.contains("unknown quantity to show `y`") && error.contains("x"), "{error}");
}

#[test]
fn a_picture_changes_nothing_of_the_table() {
    let folder = folder("untouched");
    succeeds(&folder, &["simulate", "decay.eq", "--out", "a.csv"]);
    succeeds(&folder, &["simulate", "decay.eq", "--out", "b.csv", "--plot", "b.svg"]);
    assert_eq!(std::fs::read(folder.join("a.csv")).expect("a"), std::fs::read(folder.join("b.csv")).expect("b"));
}

#[test]
fn saved_tables_are_drawn_over_one_another() {
    let folder = folder("saved");
    succeeds(&folder, &["simulate", "decay.eq", "--seed", "1", "--out", "first.csv"]);
    succeeds(&folder, &["simulate", "decay.eq", "--seed", "2", "--out", "second.csv"]);
    succeeds(&folder, &["plot", "first.csv", "second.csv", "-o", "two.svg", "--show", "x,reward.lost"]);
    let picture = std::fs::read_to_string(folder.join("two.svg")).expect("a picture");
    let tree = roxmltree::Document::parse(&picture).expect("XML");
    let texts: Vec<&str> = tree.descendants().filter(|n| n.has_tag_name("text")).filter_map(|n| n.text()).collect();
    for text in ["first", "second", "x", "reward.lost"] {
        assert!(texts.contains(&text), "`{text}` is not among {texts:?}");
    }
    succeeds(&folder, &["simulate", "decay.eq", "--sweep", "k=0.5,1", "--out", "all.csv", "--plot", "all.png"]);
    succeeds(&folder, &["plot", "all.csv", "-o", "all.svg", "--model", "decay.eq"]);
    assert!(std::fs::read_to_string(folder.join("all.svg")).expect("a picture").contains("k 0.5"));
    assert!(fails(&folder, &["plot", "first.csv", "-o", "two.svg", "--show", "nope"]).contains("`nope`"));
    assert!(fails(&folder, &["plot", "missing.csv", "-o", "two.svg"]).contains("missing.csv: no such file"));
    assert!(fails(&folder, &["plot", "first.csv", "-o", "first.csv.svg", "--model", "missing.eq"]).contains("missing.eq"));
}

#[test]
fn a_new_model_checks_runs_and_is_laid_out() {
    let folder = folder("new");
    let wording = succeeds(&folder, &["new", "tank"]);
    assert!(wording.contains("tank.eq"), "{wording}");
    let checked = smpl(&folder, &["check", "tank.eq"]);
    assert!(checked.status.success() && checked.stderr.is_empty(), "{}", String::from_utf8_lossy(&checked.stderr));
    succeeds(&folder, &["fmt", "--check", "tank.eq"]);
    let run = succeeds(&folder, &["simulate", "tank.eq", "--policy", "hand", "--plot", "run.svg"]);
    assert!(run.starts_with("Tank: 120 steps") && run.contains("time limit"), "{run}");
    assert!(fails(&folder, &["new", "tank.eq"]).contains("exists already"));
    assert!(fails(&folder, &["new", "tank.txt"]).contains("tank.eq"));
}

/// First rows of the columns of a run of a model.
fn first_row(folder: &Path, text: &str, arguments: &[&str], names: &[&str]) -> Vec<f64> {
    std::fs::write(folder.join("m.eq"), text).expect("a model");
    succeeds(folder, &[&["simulate", "m.eq", "--out", "m.csv"], arguments].concat());
    names.iter().map(|name| numbers(&folder.join("m.csv"), name)[0]).collect()
}

/// Of two entries for one element the one for fewer elements holds, in any order of the text; what a variant adds replaces both.
#[test]
fn the_start_of_an_element_holds_against_that_of_its_array() {
    let folder = folder("starts");
    let model = |starts: [&str; 3]| {
        let head = "state c[i in 1..3] = 0 in 0..100\neq d/dt c[i] = 0 [1/s] for i in 1..3\n";
        let tail =
            "variant all { initial c = 9 }\nvariant again { initial c[i] = 8 for i in 1..3 }\nepisode { step = 1 [s], max_steps = 1 }\n";
        format!("{head}{}\n{tail}", starts.join("\n"))
    };
    let [whole, each, one] = ["initial c = 3", "initial c[i] = 7 for i in 1..2", "initial c[1] = 5"];
    let names = ["c[1]", "c[2]", "c[3]"];
    for starts in [[whole, each, one], [one, each, whole], [each, one, whole], [one, whole, each]] {
        let model = model(starts);
        assert_eq!(first_row(&folder, &model, &[], &names), [5.0, 7.0, 3.0], "{starts:?}");
        assert_eq!(first_row(&folder, &model, &["--variant", "all"], &names), [5.0, 7.0, 9.0], "{starts:?}");
        assert_eq!(first_row(&folder, &model, &["--variant", "again"], &names), [8.0, 8.0, 8.0], "{starts:?}");
    }
}

/// A scenario's start of an element holds against its start of the whole array, whichever of them is a number.
#[test]
fn the_start_of_an_element_in_a_scenario_holds_against_that_of_its_array() {
    let folder = folder("scenario-starts");
    let model = |start: &str| {
        format!(
            "set s = {{ a, b }}\nstate c[s] = 0 in 0..100\neq d/dt c[i] = 0 [1/s] for i in s\n{start}\nepisode {{ step = 1 [s], max_steps = 1 }}\n"
        )
    };
    for start in ["", "initial c = 50", "initial c[b] = 50", "initial c[b] = 50\ninitial c[i] = 60 for i in s"] {
        for (whole, element) in
            [("2", "3"), ("2", "\"uniform(3, 3)\""), ("\"uniform(2, 2)\"", "3"), ("\"uniform(2, 2)\"", "\"uniform(3, 3)\"")]
        {
            if start.contains("c[b]") && whole.contains("uniform") {
                continue;
            }
            for initial in [format!("{{c: {whole}, \"c[b]\": {element}}}"), format!("{{\"c[b]\": {element}, c: {whole}}}")] {
                std::fs::write(folder.join("m.x.yaml"), format!("initial: {initial}\n")).expect("a scenario");
                let found = first_row(&folder, &model(start), &["--scenario", "x"], &["c[a]", "c[b]"]);
                assert_eq!(found, [2.0, 3.0], "{start}: {initial}");
            }
        }
    }
}

/// A value for one action overrides a value for all, in policies and at the steady state.
#[test]
fn the_value_of_an_element_holds_in_policies_and_at_rest() {
    let folder = folder("elements");
    let model = "action u[i in 1..2] = 1 in 0..9\nstate x[i in 1..2] = 0\neq d/dt x[i] = (u[i] - x[i]) / 1 [s] for i in 1..2\n\
        initial x[i] = value(steady(x[i])) for i in 1..2\nsteady { u[1] = 4, u = 3 }\nvariant other { steady { u = 6 } }\n\
        policy p { u[1] = 5, u = 2 }\nepisode { step = 1 [s], max_steps = 2 }\n";
    let near = |found: Vec<f64>, expected: [f64; 2]| {
        assert!(found.iter().zip(expected).all(|(x, y)| (x - y).abs() < 1e-9), "{found:?}, {expected:?}");
    };
    near(first_row(&folder, model, &["--policy", "p"], &["x[1]", "x[2]"]), [4.0, 3.0]);
    near(["u[1]", "u[2]"].map(|name| numbers_after_start(&folder.join("m.csv"), name)).to_vec(), [5.0, 2.0]);
    near(first_row(&folder, model, &["--variant", "other"], &["x[1]", "x[2]"]), [6.0, 6.0]);
}

/// The number of the second row.
fn numbers_after_start(path: &Path, name: &str) -> f64 {
    column(path, name)[1].parse().expect("a number")
}

/// A policy of a component is one for each instance, by its path.
#[test]
fn policies_of_components_have_paths() {
    let folder = folder("policies");
    let model = "component T {\n  state x = 0\n  action u = 1 in 0..5\n  eq d/dt x = u / 1 [s]\n  policy fill { u = 3 }\n}\n\
        use T as P[k in 1..2]\nepisode { step = 1 [s], max_steps = 2 }\n";
    for (policy, expected) in [("P[1].fill", [3.0, 1.0]), ("P[2].fill", [1.0, 3.0]), ("nominal", [1.0, 1.0])] {
        first_row(&folder, model, &["--policy", policy], &[]);
        let found = ["P[1].u", "P[2].u"].map(|name| numbers_after_start(&folder.join("m.csv"), name));
        assert_eq!(found, expected, "{policy}");
    }
    assert!(fails(&folder, &["simulate", "m.eq", "--policy", "fill"]).contains("nominal, random, P[1].fill, P[2].fill"));
}

/// A swept start has its own column next to that of its state, and the table can be read back.
#[test]
fn the_column_of_a_swept_start_is_not_that_of_the_state() {
    let folder = folder("swept-start");
    succeeds(&folder, &["simulate", "decay.eq", "--sweep", "x=1,2", "--sweep", "k=1,2", "--out", "all.csv", "--summary", "s.csv"]);
    let all = folder.join("all.csv");
    assert_eq!(table(&all).0[..6], ["run", "sweep.x", "k", "seed", "step", "time"]);
    assert_eq!(table(&folder.join("s.csv")).0[..5], ["run", "x", "k", "seed", "steps"]);
    let starts: Vec<f64> = numbers(&all, "sweep.x").into_iter().step_by(4).collect();
    assert_eq!(starts, [1.0, 1.0, 2.0, 2.0]);
    assert_eq!(numbers(&all, "x").into_iter().step_by(4).collect::<Vec<f64>>(), starts);
    succeeds(&folder, &["plot", "all.csv", "--output", "all.svg"]);
}
