//! Inputs of runs: tables that are replayed, sweeps, scenarios with repeated entries.

mod shell;

use std::process::Output;

use shell::{COOLER, beside, file, name, smpl, status, text};

/// Another seed would draw others: what is the same was replayed, each value in its step.
#[test]
fn a_run_is_replayed_from_its_own_table_step_by_step() {
    let walk = "model Walk\ntime t : min\nstate T = 10 in 0..100\naction F = 1 in 0..2\ndisturbance w = 3 ~ 0.5*w + normal(0, 1)\n\
                eq d/dt T = (F + w - T)/1 [min]\nreward r default = -T\nobserve T\nepisode { step = 1 [min], max_steps = 8 }\n";
    let model = file("replayed", "m.eq", walk);
    let m = name(&model);
    for ending in ["csv", "parquet"] {
        let table = beside(&model, &format!("t.{ending}"));
        let t = name(&table);
        let columns = |output: &Output, names: &[&str]| -> Vec<Vec<String>> {
            assert!(status(output) == 0 && text(&output.stderr).lines().count() == 1, "{}", text(&output.stderr));
            let lines = text(&output.stdout);
            let rows: Vec<Vec<&str>> = lines.lines().map(|line| line.split(',').collect()).collect();
            let at = |name: &&str| rows[0].iter().position(|n| n == name).expect("a column");
            rows[1..].iter().map(|row| names.iter().map(|name| row[at(name)].to_owned()).collect()).collect()
        };
        let first = ["simulate", m, "--policy", "random", "--seed", "1", "--out"];
        assert_eq!(status(&smpl(&[&first[..], &[t]].concat())), 0);
        let original = columns(&smpl(&[&first[..], &["-"]].concat()), &["step", "T", "w", "F"]);
        assert_eq!(original.len(), 9);
        let both = smpl(&["simulate", m, "--seed", "2", "--actions", t, "--disturbances", t, "--out", "-"]);
        assert_eq!(columns(&both, &["step", "T", "w", "F"]), original);
        let alone = columns(&smpl(&["simulate", m, "--seed", "2", "--disturbances", t, "--out", "-"]), &["w"]);
        assert_eq!(alone, original.iter().map(|row| vec![row[2].clone()]).collect::<Vec<_>>());
    }
    // T after one step from 10 with F = 1: w is that of step 1, T = 1 + w + (9 - w) / e.
    for (data, w) in [("step,w\n0,7\n1,2\n", 2.0), ("step,w\n1,2\n", 2.0), ("w\n7\n2\n", 7.0), ("time,w\n0,7\n1,2\n", 7.0)] {
        let table = file("replayed", "d.csv", data);
        let output = smpl(&["simulate", m, "--steps", "1", "--rtol", "1e-10", "--disturbances", name(&table), "--out", "-"]);
        let row = text(&output.stdout).lines().nth(2).expect("a step").split(',').nth(2).expect("T").parse::<f64>().expect("a number");
        assert!((row - (1.0 + w + (9.0 - w) * (-1.0_f64).exp())).abs() < 1e-7, "{data}: {row}");
    }
}

#[test]
fn tables_that_do_not_count_the_steps_of_one_run_are_refused() {
    let model = file("counted", "m.eq", COOLER);
    let all = beside(&model, "all.csv");
    assert_eq!(status(&smpl(&["simulate", name(&model), "--episodes", "2", "--steps", "2", "--out", name(&all)])), 0);
    for option in ["--actions", "--disturbances"] {
        let output = smpl(&["simulate", name(&model), option, name(&all)]);
        let shown = text(&output.stderr);
        assert!(status(&output) == 1 && shown.contains("all.csv:5") && shown.contains("`step` says 0 where 3 is expected"), "{shown}");
        let cases = [
            ("step,F,w\n2,1,1\n", "says 2 where 0, the start, or 1 is expected"),
            ("step,F,w\n1,1,1\n3,1,1\n", "says 3 where 2 is expected"),
            ("step,F,w\n0,,1\n", "the only row is that of the start"),
            ("step,F,w\nfirst,1,1\n", "column `step`: `first` is not a finite number"),
        ];
        for (data, expected) in cases {
            let output = smpl(&["simulate", name(&model), option, name(&file("counted", "d.csv", data))]);
            assert!(status(&output) == 1 && text(&output.stderr).contains(expected), "{}", text(&output.stderr));
        }
    }
    let early = file("counted", "a.csv", "step,F\n0,1\n1,1\n");
    let output = smpl(&["simulate", name(&model), "--actions", name(&early)]);
    assert!(status(&output) == 1 && text(&output.stderr).contains("count the steps from 1"), "{}", text(&output.stderr));
}

/// The start is not a step of a model without actions either.
#[test]
fn a_model_without_actions_takes_as_many_steps_as_its_table_has() {
    let decay = "model Decay\ntime t : min\nstate x = 1 in 0..2\neq d/dt x = -x/1 [min]\nreward r default = -x\nobserve x\n\
                 episode { step = 1 [min], max_steps = 3 }\n";
    let model = file("no-actions", "m.eq", decay);
    let table = beside(&model, "t.csv");
    assert_eq!(status(&smpl(&["simulate", name(&model), "--out", name(&table)])), 0);
    let output = smpl(&["simulate", name(&model), "--steps", "9", "--actions", name(&table)]);
    assert!(text(&output.stderr).contains("the actions end after step 3 of 9"), "{}", text(&output.stderr));
}

const BOUNDED: &str = "model Bounded\ntime t : min\nset s = 1..2\nparam k = 1 in 0..2\nparam c[s] = 1 in 0..2\nchoice mode = plain | other\nvariant fast { param k = 2 in 0..2 }\n\
                       state x : m = 1 in 0..5\ndiscrete q = 1 in 0..2\naction u = 1 in 0..2\ndisturbance w : m = 0 in -1..1\n\
                       eq d/dt x = (k*u*q*c[1]*1 [m] + w - x)/1 [min]\nwhen mode = other { reward other = x/1 [m] }\nreward r default = -x/1 [m]\nobserve x in 0..5\n\
                       episode { step = 1 [min], max_steps = 2 }\n";

/// As under `initial` of a scenario, and as a parameter.
#[test]
fn a_sweep_beyond_bounds_is_no_run_whatever_it_sweeps() {
    let model = file("sweep-bounds", "m.eq", BOUNDED);
    let cases = [
        ("x=9,1", "initial value `x` = 9 is outside its bounds 0..5 m", vec![true, false]),
        ("q=1,2.5,-1", "initial value `q` = 2.5 is outside its bounds 0..2", vec![false, true, true]),
        ("k=1,3", "parameter `k` = 3 is outside its bounds 0..2", vec![false, true]),
        ("c[1]=1,3", "parameter `c[1]` = 3 is outside its bounds 0..2", vec![false, true]),
        ("x=0,5", "", vec![false, false]),
        ("q=0,2", "", vec![false, false]),
    ];
    for (sweep, message, broken) in cases {
        let table = beside(&model, "s.csv");
        let output = smpl(&["simulate", name(&model), "--sweep", sweep, "--summary", name(&table)]);
        assert!(status(&output) == 0 && text(&output.stderr).contains(message), "{}", text(&output.stderr));
        let summary = std::fs::read_to_string(table).expect("a summary");
        assert_eq!(summary.lines().skip(1).map(|row| row.contains("no run")).collect::<Vec<_>>(), broken, "{summary}");
        assert!(summary.contains(message), "{summary}");
    }
    let scenario = file("sweep-bounds", "i.yaml", "initial: {x: 9}\n");
    let output = smpl(&["simulate", name(&model), "--scenario", name(&scenario)]);
    assert!(status(&output) == 1 && text(&output.stderr).contains("`x` = 9 is outside its bounds 0..5 m"), "{}", text(&output.stderr));
}

#[test]
fn a_name_that_is_swept_twice_is_refused() {
    let model = file("swept-twice", "m.eq", BOUNDED);
    for (first, second) in [("k=1,2", "k=0..1:3"), ("x=1", " x =1"), ("scenario=default", "scenario=default")] {
        let output = smpl(&["simulate", name(&model), "--sweep", first, "--sweep", "u=1", "--sweep", second]);
        let twice = first.split_once('=').expect("a name").0;
        let expected = format!("--sweep {twice} is given twice: give all of its values in one");
        assert!(status(&output) == 1 && text(&output.stderr).contains(&expected), "{}", text(&output.stderr));
    }
}

#[test]
fn a_disturbance_beyond_its_bounds_is_refused_in_a_scenario_and_warned_of_in_a_table() {
    let model = file("outside", "m.eq", BOUNDED);
    for given in ["1.5", "[0, 1.5]", "{values: [1, 1.5, -7], hold: true}"] {
        let scenario = file("outside", "s.yaml", format!("max_steps: 2\ndisturbances:\n  w: {given}\n"));
        let output = smpl(&["simulate", name(&model), "--scenario", name(&scenario)]);
        let shown = text(&output.stderr);
        assert!(
            status(&output) == 1 && shown.contains("`w` = 1.5 is outside its bounds -1..1 m") && shown.contains("s.yaml:3:3"),
            "{shown}"
        );
    }
    let scenario = file("outside", "s.yaml", "disturbances: {w: [-1, 1]}\n");
    let output = smpl(&["simulate", name(&model), "--scenario", name(&scenario)]);
    assert!(status(&output) == 0 && output.stderr.is_empty(), "{}", text(&output.stderr));
    let table = file("outside", "w.csv", "w\n0\n-1.5\n");
    let output = smpl(&["simulate", name(&model), "--disturbances", name(&table)]);
    let shown = text(&output.stderr);
    assert!(status(&output) == 0 && shown.contains("w.csv: `w` = -1.5 is outside its bounds -1..1 m"), "{shown}");
}

#[test]
fn what_a_scenario_says_twice_under_two_keys_is_refused() {
    let model = file("said-twice", "m.eq", BOUNDED);
    let cases = [
        ("parameters: {k: 1}\nsettings: {k: 2}\n", "k", "2:12"),
        ("variants: [mode=other, mode=plain]\n", "mode", "1:12"),
        ("variants: [fast, {fast: true}]\n", "fast", "1:12"),
        ("variants: [mode=other]\nsettings: {mode: plain}\n", "mode", "2:12"),
        ("max_steps: 1\nsettings: {max_steps: 2}\n", "max_steps", "2:12"),
        ("solver: {rtol: 1e-5}\nsettings: {rtol: 1e-6}\n", "rtol", "2:12"),
        ("solver: {max_steps: 50}\nsettings: {max_internal_steps: 60}\n", "max_internal_steps", "2:12"),
    ];
    for (scenario, twice, place) in cases {
        let scenario = file("said-twice", "s.yaml", scenario);
        let output = smpl(&["simulate", name(&model), "--scenario", name(&scenario)]);
        let shown = text(&output.stderr);
        assert!(status(&output) == 1 && shown.contains(&format!("`{twice}` is given twice")) && shown.contains(place), "{shown}");
    }
    let apart = "variants: [fast, mode=other]\nparameters: {\"c[1]\": 2, c: 1}\nsolver: {max_steps: 50}\nsettings: {max_steps: 2}\n";
    let scenario = file("said-twice", "s.yaml", apart);
    let output = smpl(&["simulate", name(&model), "--scenario", name(&scenario)]);
    assert!(status(&output) == 0, "{}", text(&output.stderr));
}
