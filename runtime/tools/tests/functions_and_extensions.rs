//! Values of functions with structure, of extended components, levels and variants, and of successes at events: against manually computed numbers.

mod shell;

use shell::{beside, file, name, smpl, status, text};

/// Runs the tests of a text.
fn passes(test: &str, source: &str) {
    let path = file(test, "m.eq", source);
    let output = smpl(&["test", name(&path)]);
    assert_eq!(status(&output), 0, "{}{}", text(&output.stdout), text(&output.stderr));
}

#[test]
fn functions_take_arrays_and_indices_over_sets_ranges_and_cells() {
    passes("functions", include_str!("functions.eq"));
}

#[test]
fn extended_components_levels_and_variants_replace_what_has_their_name() {
    passes("extends", include_str!("extends.eq"));
    let path = file("extends_level", "m.eq", include_str!("extends.eq"));
    let out = beside(&path, "out.csv");
    let script = "observation: more\n";
    std::fs::write(beside(&path, "m.more.yaml"), script).expect("a scenario");
    assert_eq!(status(&smpl(&["simulate", name(&path), "--scenario", "more", "--out", name(&out)])), 0);
    let header = std::fs::read_to_string(&out).expect("a table").lines().next().expect("a header").to_owned();
    let observed: Vec<&str> = header.split(',').filter(|column| column.starts_with("obs.")).collect();
    // Of the file first, then of the instances; a level adds its own behind those that it extends.
    assert_eq!(observed, ["obs.u", "obs.w", "obs.z", "obs.T1.V", "obs.T2.V", "obs.T3.V"]);
}

#[test]
fn a_success_at_an_event_stops_the_step_there_by_every_method() {
    // Closed form: h = 0.3 t is 1 at t = 10/3.
    let source = include_str!("success_event.eq");
    passes("success", source);
    let path = file("success_methods", "m.eq", source);
    for method in ["ida", "rosenbrock", "explicit", "auto"] {
        let out = beside(&path, "out.csv");
        let output = smpl(&["simulate", name(&path), "--method", method, "--out", name(&out)]);
        assert!(text(&output.stdout).contains("success"), "{}", text(&output.stdout));
        let rows = std::fs::read_to_string(&out).expect("rows");
        let last: Vec<&str> = rows.lines().last().expect("a row").split(',').collect();
        let (time, reward): (f64, f64) = (last[1].parse().expect("a time"), last[last.len() - 4].parse().expect("a reward"));
        assert!((time - 10.0 / 3.0).abs() < 1e-9, "{method}: {time}");
        assert_eq!((reward, &last[last.len() - 2..]), (100.0, &["true", "false"][..]), "{rows}");
    }
    let json = beside(&path, "m.json");
    assert_eq!(status(&smpl(&["export", name(&path), "--to", "json", "-o", name(&json)])), 0);
    assert!(text(&smpl(&["simulate", name(&json)]).stdout).contains("success"));
    let failing = file("success_fails", "m.eq", source.replace("h >= 3 [m]", "h >= 1 [m]"));
    assert!(text(&smpl(&["simulate", name(&failing)]).stdout).contains("failed: over"), "a failure at the same instant wins");
}
