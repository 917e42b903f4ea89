//! Tables over quantities: points in the text and in files, values against SciPy, faults with their places.

mod shell;

use shell::{beside, file, name, smpl, status, text};

/// Points whose interpolants SciPy 1.17.1 has computed for the tests below.
const POINTS: &str = "# source: made up\nT [degC],other,k [1/min]\n0,7,0\n1,7,2\n3,7,3\n4,7,3\n7,7,1\n";

/// A model that reads a table at the time, without a state of interest.
fn model(table: &str, read: &str) -> String {
    format!("time t : s\n{table}\nstate z = 0\neq d/dt z = 0\nlet y : 1 = {read}\nepisode {{ step = 0.5 [s], max_steps = 16 }}\n")
}

/// Values of `y` at the steps of a run.
fn run(test: &str, content: &str, table: &str, read: &str) -> Vec<f64> {
    let path = file(test, "m.eq", model(table, read));
    std::fs::write(beside(&path, "k.csv"), content).expect("a table");
    let out = beside(&path, "out.csv");
    let output = smpl(&["simulate", name(&path), "--out", name(&out)]);
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
    let table = std::fs::read_to_string(&out).expect("a table");
    let column = table.lines().next().expect("a header").split(',').position(|c| c == "y").expect("the output");
    table.lines().skip(1).map(|row| row.split(',').nth(column).expect("a cell").parse().expect("a number")).collect()
}

fn near(found: &[f64], expected: &[f64]) {
    assert!(found.len() >= expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
    }
}

#[test]
fn a_cubic_table_is_the_monotone_interpolant_of_scipy() {
    let found = run("cubic", POINTS, "table k over T : degC from \"k.csv\" cubic", "k(celsius(273.15 [K] + t*1 [K/s]))*1 [min]");
    let inline = run("cubic_text", POINTS, "table k over x : 1 cubic { 0: 0, 1: 2, 3: 3, 4: 3, 7: 1 }", "k(t/1 [s])");
    near(&inline, &SCIPY_PCHIP);
    near(&found, &SCIPY_PCHIP);
}

#[test]
fn steps_and_lines_of_a_file_hold_as_in_the_text() {
    let read = "k(celsius(273.15 [K] + t*1 [K/s]))*1 [min]";
    let lines = run("lines", POINTS, "table k over T : degC from \"k.csv\" linear", read);
    near(&lines, &[0.0, 1.0, 2.0, 2.25, 2.5, 2.75, 3.0, 3.0, 3.0, 3.0 - 1.0 / 3.0]);
    let beyond = run("beyond", POINTS, "table k over T : degC from \"k.csv\" linear outside linear", read);
    assert!((beyond[16] - (1.0 - 2.0 / 3.0)).abs() < 1e-12);
    let steps = run("steps", POINTS, "table k over T : degC from \"k.csv\" step", read);
    near(&steps[..8], &[0.0, 0.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0]);
}

#[test]
fn units_of_the_header_are_those_of_the_table_or_convert() {
    let content = "x [ms],k [1/h]\n0,0\n1000,3600\n";
    let read = |unit: &str| run("units", content, &format!("table k{unit} over x : s from \"k.csv\" linear"), "k(t)*1 [s]");
    near(&read(""), &[0.0, 0.5, 1.0, 1.0]);
    near(&read(" : 1/s"), &[0.0, 0.5, 1.0, 1.0]);
    let bare = run("bare", "x,k\n0,0\n1,2\n", "table k : 1/min over x : s from \"k.csv\" linear", "k(t)*1 [min]");
    near(&bare, &[0.0, 1.0, 2.0]);
}

#[test]
fn a_table_over_two_quantities_is_that_of_scipy() {
    // Computed manually: bilinear between 0, 10; 100, 110.
    let grid = "table h over (T : s, p : 1) linear {\n  columns: 1, 2\n  0: 0, 10\n  4: 100, 110\n}";
    near(&run("bilinear", "", grid, "h(t, 1.25)"), &[2.5, 15.0, 27.5]);
    let outside = run("bilinear_outside", "", &grid.replace("linear {", "linear outside linear {"), "h(t, 3)");
    near(&outside, &[20.0, 32.5]);
    // A not-a-knot spline through a bicubic surface is the surface.
    let surface = |x: f64, y: f64| x * x * y - 0.5 * y * y * x + 0.25 * x * x * x + 2.0;
    let (xs, ys) = ([0.0, 1.0, 2.0, 4.0, 8.0], [0.0, 1.0, 3.0, 4.0]);
    let mut content = String::from("T/p,0,1,3,4\n");
    for x in xs {
        let cells: Vec<String> = ys.iter().map(|y| surface(x, *y).to_string()).collect();
        content.push_str(&format!("{x},{}\n", cells.join(",")));
    }
    let found = run("bicubic", &content, "table k over (T : s, p : 1) from \"k.csv\" cubic", "k(t, t/2 [s])");
    let expected: Vec<f64> = (0..16).map(|i| surface(f64::from(i) * 0.5, f64::from(i) * 0.25)).collect();
    found.iter().zip(expected).for_each(|(found, expected)| assert!((found - expected).abs() < 1e-12 * expected.abs().max(1.0)));
}

#[test]
fn leaving_a_refused_table_is_a_failure_at_its_end() {
    // Closed form: T = 100*(1.2*exp(0.3 t) - 1) is 100 degC at t = ln(2/1.2)/0.3 min.
    let source = "time t : min\ntable k over T : degC from \"k.csv\" linear outside refused\nstate T : degC = 20 in -100..1000\n\
                  eq d/dt T = k(T)*30 [K]\nreward r default = k(T)/1 [1/min]\nepisode { step = 1 [min], max_steps = 20 }\n";
    let path = file("refused", "m.eq", source);
    std::fs::write(beside(&path, "k.csv"), "T [degF],k [1/h]\n32,60\n212,120\n").expect("a table");
    for method in ["ida", "rosenbrock", "explicit", "auto"] {
        let out = beside(&path, "out.csv");
        let output = smpl(&["simulate", name(&path), "--method", method, "--out", name(&out)]);
        assert!(text(&output.stdout).contains("failed: k: the table `k` is read outside of its points"), "{}", text(&output.stdout));
        let rows = std::fs::read_to_string(&out).expect("rows");
        let cells: Vec<&str> = rows.lines().last().expect("a row").split(',').collect();
        let time: f64 = cells[1].parse().expect("a time");
        assert!((time - (2.0_f64 / 1.2).ln() / 0.3).abs() < 1e-6, "{method}: {time}");
    }
}

#[test]
fn faults_of_files_have_their_place() {
    let table = "table k over T : degC from \"k.csv\" linear";
    let read = "k(20 [degC])*1 [min]";
    for (content, table, message) in [
        ("T [degC],kk [1/min]\n0,1\n", table, "`k.csv` has no column `k`"),
        ("T [degC],k [1/min]\n0,1\n0,2\n", table, "k.csv:3:1"),
        ("T [degC],k [1/min]\n0,1\n0,2\n", table, "the arguments of a table must increase: 0 follows 0"),
        ("T [degC],k [1/min]\n0,1\n5,\n", table, "a cell of the table is empty"),
        ("T [degC],k [1/min]\n0,1\n5,abc\n", table, "k.csv:3:3"),
        ("T [degC],k [1/min]\n0,1\n5,NaN\n", table, "`NaN` is not a finite number"),
        ("T [degC],k [1/min]\n0,1\n5,2,3\n", table, "this row has 3 cells, the header 2"),
        ("T [degC],k [1/min]\n", table, "`k.csv` has no rows below its header"),
        ("T [degC],k [1/minn]\n0,1\n", table, "unknown unit `minn`"),
        ("T [degC],k [1/min\n0,1\n", table, "is not a column with its unit"),
        ("T [bar],k [1/min]\n0,1\n", table, "the argument is temperature [degC], but this is pressure [bar]"),
        ("T [degC],k [K]\n0,1\n", "table k : 1/min over T : degC from \"k.csv\" linear", "the table is rate"),
        ("T [degC],k [1/min]\n0,1\n", "table k over T : degC from \"../k.csv\" linear", "cannot be read in the folder of the model"),
        ("T [degC],k [1/min]\n0,1\n", "table k over T : degC from \"no.csv\" linear", "cannot be read in the folder of the model"),
        ("T [degC],k [1/min]\n0,1\n", "table k over T : degC from \"k.csv\" step outside linear", "has no slope outside"),
        (
            "T [degC],k [1/min]\n0,1\n",
            "table k over T : degC from \"k.csv\" linear outside never",
            "unknown reading outside of a table `never`",
        ),
    ] {
        let path = file("faults", "m.eq", model(table, read));
        std::fs::write(beside(&path, "k.csv"), content).expect("a table");
        std::fs::write(path.parent().and_then(std::path::Path::parent).expect("a folder").join("k.csv"), content).expect("a table");
        let output = smpl(&["check", name(&path)]);
        let shown = text(&output.stderr);
        assert!(status(&output) == 1 && shown.contains(message), "{content}{table}\n{shown}");
        assert_eq!(shown.matches('×').count(), 1, "one cause is one diagnostic: {shown}");
    }
}

#[cfg(unix)]
#[test]
fn a_link_out_of_the_folder_is_not_followed() {
    let path = file("links", "m.eq", model("table k over T : degC from \"k.csv\" linear", "k(20 [degC])*1 [min]"));
    let secret = file("links_elsewhere", "secret.csv", POINTS);
    let _ = std::fs::remove_file(beside(&path, "k.csv"));
    std::os::unix::fs::symlink(&secret, beside(&path, "k.csv")).expect("a link");
    let output = smpl(&["check", name(&path)]);
    assert!(status(&output) == 1 && text(&output.stderr).contains("links that lead out of it are refused"));
}

#[test]
fn the_content_of_a_table_is_part_of_the_model() {
    let table = "table k over T : degC from \"k.csv\" linear";
    let path = file("identity", "m.eq", model(table, "k(20 [degC])*1 [min]"));
    let compiled = beside(&path, "m.smplc");
    std::fs::write(beside(&path, "k.csv"), POINTS).expect("a table");
    assert_eq!(status(&smpl(&["compile", name(&path), "-o", name(&compiled)])), 0);
    assert_eq!(status(&smpl(&["simulate", name(&compiled), "--steps", "1"])), 0);
    std::fs::write(beside(&path, "k.csv"), POINTS.replace("1,7,2", "1,7,2.5")).expect("a table");
    let output = smpl(&["simulate", name(&compiled), "--steps", "1"]);
    assert!(status(&output) == 1 && text(&output.stderr).contains("changed"), "{}", text(&output.stderr));
}

/// `PchipInterpolator([0, 1, 3, 4, 7], [0, 2, 3, 3, 1])` at 0, 0.5, ..., 7 of SciPy 1.17.1.
const SCIPY_PCHIP: [f64; 15] = [
    0.0,
    1.2053571428571428,
    2.0,
    2.3973214285714284,
    2.7142857142857144,
    2.924107142857143,
    3.0,
    3.0,
    3.0,
    2.9328703703703702,
    2.740740740740741,
    2.4375,
    2.037037037037037,
    1.553240740740741,
    1.0000000000000002,
];
