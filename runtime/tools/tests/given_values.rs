//! Arguments of the command at the edge of validity: files, values, names, outputs.

use std::path::PathBuf;
use std::process::{Command, Output};

/// A folder of a test's own with a model in it, where the command runs.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str, model: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("smpl-given-{}-{test}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).expect("a folder");
        let folder = Self(folder);
        folder.file("m.eq", model);
        folder
    }

    fn file(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.0.join(name), content).expect("a file");
    }

    fn smpl(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_smpl")).args(arguments).current_dir(&self.0).output().expect("smpl runs")
    }

    /// Exit status and standard error, without the frames of diagnostics.
    fn errors(&self, arguments: &[&str]) -> (i32, String) {
        let output = self.smpl(arguments);
        let shown = String::from_utf8_lossy(&output.stderr).into_owned();
        let unwrapped = shown.lines().map(|line| line.trim_start_matches([' ', '│', '×'])).collect::<Vec<_>>().join(" ");
        (output.status.code().expect("ends by itself"), unwrapped)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

const TANK: &str = "model Tank\ntime t : min\nparam k : 1/min = 0.5 in 0..4\nparam n_c = 2\ndomain z in 0..1 cells n_c\nstate T : K = 10 in 0..100\n\
    state c[z] = 1 in 0..9\ndiscrete d = 0 in 0..5\naction F : K/min = 1 in 0..2\neq d/dt T = F - k*T\neq d/dt c[z] = -c[z]/1 [min] for z\n\
    reward r default = -T/1 [K]\nobserve T\nepisode { step = 1 [min], max_steps = 2 }\n";

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn a_key_that_is_written_in_other_characters_is_placed_in_the_scenario() {
    let folder = Folder::new("escapes", TANK);
    for (content, place) in [
        ("parameters: {\"\\x1b[31mk\": 1}\n", "s.yaml:1:1"),
        ("max_steps: 1\nsettings:\n  \"\\x71\": 1\n", "s.yaml:2:1"),
        ("max_steps: 1\ngrid: {\"\\u0071\": 1}\n", "s.yaml:2:1"),
        ("max_steps: 1\nvariants: [\"\\u0071\"]\n", "s.yaml:1:1"),
    ] {
        folder.file("s.yaml", content);
        let (status, shown) = folder.errors(&["check", "m.eq", "--scenario", "s.yaml"]);
        assert!(status == 1 && shown.contains(place) && !shown.contains("m.eq"), "{content}: {shown}");
    }
}

#[test]
fn a_name_of_a_hundred_thousand_letters_is_not_repeated() {
    let folder = Folder::new("long", TANK);
    let long = "k".repeat(100_000);
    for key in ["", "parameters: ", "settings: ", "grid: ", "initial: ", "noise: ", "disturbances: ", "solver: "] {
        let value = if key == "initial: " || key == "settings: " { "text" } else { "1" };
        folder.file("s.yaml", if key.is_empty() { format!("{long}: 1\n") } else { format!("{key}{{{long}: {value}}}\n") });
        let output = folder.smpl(&["check", "m.eq", "--scenario", "s.yaml"]);
        assert_eq!(output.status.code(), Some(1), "{key}");
        assert!(output.stderr.len() < 4000, "{key}: {} bytes", output.stderr.len());
    }
    folder.file("s.yaml", format!("max_steps: {long}\n"));
    assert!(folder.smpl(&["check", "m.eq", "--scenario", "s.yaml"]).stderr.len() < 2000);
}

#[test]
fn a_parameter_that_is_no_number_of_cells_is_refused_under_grid() {
    let folder = Folder::new("grid", TANK);
    folder.file("s.yaml", "grid: {n_c: 3, k: 3}\n");
    let (status, shown) = folder.errors(&["check", "m.eq", "--scenario", "s.yaml"]);
    assert!(status == 1 && shown.contains("`k` is not a number of cells") && shown.contains("s.yaml:1:16"), "{shown}");
    folder.file("s.yaml", "grid: {n_c: 3}\n");
    let output = folder.smpl(&["simulate", "m.eq", "--scenario", "s.yaml", "--out", "-"]);
    assert!(stdout(&output).contains(",c[3],"), "{}", stdout(&output));
}

#[test]
fn a_table_that_is_not_utf_8_has_the_code_and_the_place_of_a_table() {
    let folder = Folder::new("utf8", TANK);
    folder.file("a.csv", b"F,note\n1,\xe9t\xe9\n1,b\n");
    let (status, shown) = folder.errors(&["simulate", "m.eq", "--actions", "a.csv"]);
    assert!(status == 1 && shown.contains("E0702") && shown.contains("a.csv:2:3") && shown.contains("not UTF-8"), "{shown}");
}

#[test]
#[cfg(unix)]
fn two_results_for_one_file_that_is_not_there_yet_are_refused_however_it_is_named() {
    let folder = Folder::new("twice", TANK);
    std::fs::create_dir(folder.0.join("sub")).expect("a folder");
    std::os::unix::fs::symlink("new.csv", folder.0.join("link.csv")).expect("a link");
    std::os::unix::fs::symlink("sub", folder.0.join("other")).expect("a link");
    let absolute = folder.0.join("new.csv");
    let absolute = absolute.to_str().expect("utf-8");
    for (out, summary) in [
        ("new.csv", "sub/../new.csv"),
        ("./new.csv", "new.csv"),
        (absolute, "new.csv"),
        ("link.csv", "new.csv"),
        ("other/../new.csv", "link.csv"),
        ("sub/new.csv", "other/new.csv"),
    ] {
        let (status, shown) = folder.errors(&["simulate", "m.eq", "--out", out, "--episodes", "2", "--summary", summary]);
        assert!(status == 1 && shown.contains("is to hold two results"), "{out} {summary}: {shown}");
        assert!(!folder.0.join("new.csv").exists(), "{out} {summary}");
    }
    let (status, shown) = folder.errors(&["simulate", "m.eq", "--out", "sub/new.csv", "--plot", "new.svg"]);
    assert_eq!(status, 0, "{shown}");
}

#[test]
fn start_values_outside_of_their_bounds_are_warned_of() {
    let folder = Folder::new("bounds", TANK);
    folder.file("i.csv", "T,\"c[1]\",d\n-3,2,7\n");
    let (status, shown) = folder.errors(&["simulate", "m.eq", "--init", "i.csv"]);
    assert_eq!(status, 0, "{shown}");
    assert!(shown.contains("warning: i.csv: `T` = -3 is outside its bounds 0..100 K"), "{shown}");
    assert!(shown.contains("warning: i.csv: `d` = 7 is outside its bounds 0..5") && !shown.contains("c[1]"), "{shown}");
    let (status, shown) = folder.errors(&["steady", "m.eq", "--fix", "T=101", "--fix", "c[1]=8", "--action", "F=3"]);
    assert_eq!(status, 0, "{shown}");
    assert!(shown.contains("warning: --fix: `T` = 101 is outside") && !shown.contains("c[1]"), "{shown}");
    assert!(shown.contains("warning: --action: `F` = 3 is outside its bounds 0..2 K/min"), "{shown}");
}

/// z^3 = z has the roots -1, 0 and 1 whatever x is.
#[test]
fn steady_states_that_differ_in_algebraic_variables_alone_are_told_apart() {
    let folder =
        Folder::new("twins", "model M\ntime t : s\nstate x = 1 in -9..9\nvar z = 0.9 in -9..9\neq z^3 = z\neq d/dt x = (2 - x)/1 [s]\n");
    let shown = stdout(&folder.smpl(&["steady", "m.eq"]));
    let mut others: Vec<&str> = shown.lines().filter(|line| line.starts_with("another")).collect();
    others.sort_unstable();
    assert_eq!(others.len(), 2, "{shown}");
    assert!(shown.contains("\nz = 1\n") && others[0].ends_with(": x = 2, z = -1") && others[1].ends_with(": x = 2, z = 0"), "{shown}");
}

#[test]
fn what_is_held_away_from_rest_is_counted_by_its_kind() {
    let text = "model M\ntime t : s\nstate A = 1, B = 1, x = 1, y = 1\neq d/dt A = (2*B - A + 1)/1 [s]\neq d/dt B = (A - 2*B)/1 [s]\n\
                eq d/dt x = (1 - x)/1 [s]\neq d/dt y = (1 - y)/1 [s]\n";
    let folder = Folder::new("held", text);
    folder.file("sum.eq", format!("{text}steady {{ A + B = 6 }}\n"));
    for (arguments, wording) in [
        (&["m.eq", "--fix", "A=2", "--fix", "x=1.5"][..], "2 states are held at given values and not all at rest, the largest rate: d/dt "),
        (&["sum.eq"], "1 condition is held at a given value and not at rest: d/dt "),
        (&["sum.eq", "--fix", "x=1.5"], "1 state and 1 condition are held at given values and not all at rest, the largest rate: d/dt "),
        (&["sum.eq", "--fix", "x=3", "--fix", "y=2"], "2 states and 1 condition are held at given values"),
    ] {
        let shown = stdout(&folder.smpl(&[&["steady"], arguments].concat()));
        assert!(shown.contains(wording), "{arguments:?}: {shown}");
    }
}

#[test]
fn a_seed_beyond_64_bits_is_refused_with_the_largest() {
    let folder = Folder::new("seed", TANK);
    for seed in ["18446744073709551616", "-1", "1.5", "x"] {
        let (status, shown) = folder.errors(&["simulate", "m.eq", "--seed", seed]);
        assert!(status == 2 && shown.contains("from 0 to 2^64 - 1 = 18446744073709551615"), "{seed}: {shown}");
    }
    assert_eq!(folder.errors(&["simulate", "m.eq", "--seed", "18446744073709551615"]).0, 0);
}

/// The pole of x' = x^2 from 0.8 is at 1.25.
#[test]
fn the_last_row_after_a_failure_of_the_solver_has_the_time_of_its_state() {
    let folder = Folder::new(
        "pole",
        "model M\ntime t : 1\nstate x = 0.8\neq d/dt x = x^2\nobserve x\nreward r default = x\nepisode { step = 1, max_steps = 9 }\n",
    );
    let shown = stdout(&folder.smpl(&["simulate", "m.eq", "--out", "-"]));
    let rows: Vec<Vec<&str>> = shown.lines().map(|line| line.split(',').take(3).collect()).collect();
    assert_eq!(rows[0], ["step", "time", "x"]);
    assert_eq!((rows.len(), rows[3][0]), (4, "2"), "{shown}");
    assert_eq!(rows[3][1..], rows[2][1..], "{shown}");
}

#[test]
fn the_later_of_an_array_and_its_elements_applies_in_results_and_exports() {
    let model = "time t : s\nparam k[i in 1..3] named \"k{}\" : 1/s = 1\nstate x = 1 in 0..1000\neq d/dt x = sum(k[i] for i in 1..3)\n\
                 observe x\nreward r default = x\nepisode { step = 1 [s], max_steps = 1 }\n";
    let folder = Folder::new("layers", model);
    // x after 1 s is 1 plus the sum of the parameters.
    let end = |file: &str, more: &[&str]| {
        let output = folder.smpl(&[&["simulate", file, "--out", "o.csv"], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let table = std::fs::read_to_string(folder.0.join("o.csv")).expect("a table");
        let last = table.lines().last().expect("a row").split(',').nth(2).map(str::parse::<f64>);
        last.expect("a cell").expect("a number").round()
    };
    let defaults = |more: &[&str]| {
        let output = stdout(&folder.smpl(&[&["export", "m.eq", "--to", "json"], more].concat()));
        let json: serde_json::Value = serde_json::from_str(&output).expect("JSON");
        json["quantities"]["parameters"][0]["default"].to_string()
    };
    folder.file("element.yaml", "parameters: {k2: 50}\n");
    folder.file("array.yaml", "parameters: {k: [7, 8, 9]}\n");
    folder.file("both.yaml", "parameters: {k2: 50, k: [7, 8, 9]}\n");
    for (scenario, set, expected, values) in [
        ("element.yaml", "k=[7, 8, 9]", 25.0, "[7.0,8.0,9.0]"),
        ("element.yaml", "k=2", 7.0, "[2.0]"),
        ("array.yaml", "k2=50", 67.0, "[7.0,50.0,9.0]"),
        ("both.yaml", "k3=10", 68.0, "[7.0,50.0,10.0]"),
    ] {
        let asked = ["--scenario", scenario, "--set", set];
        assert_eq!((end("m.eq", &asked), defaults(&asked).as_str()), (expected, values), "{scenario} {set}");
    }
    folder.file("made.json", stdout(&folder.smpl(&["export", "m.eq", "--to", "json", "--set", "k2=50"])));
    assert_eq!(end("made.json", &["--set", "k=[7, 8, 9]"]), 25.0);
}
