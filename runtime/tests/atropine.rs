//! Atropine against its published steady state and trajectories (section 10 of its specification), in all three scenarios.

mod support;

use std::collections::BTreeMap;

use support::reference;
use support::replay::{Replay, Worst};

/// Allowed errors with the model's own tolerances, and with tight ones.
fn bound(kind: &str, tight: bool) -> f64 {
    let (own, strict) = match kind {
        "E" => (1e-6, 1e-9),
        "tracking" => (2e-5, 2e-8),
        "R.out" | "SEP.c" => (1e-6, 1e-8),
        "R.sum" => (1e-5, 1e-7),
        "SEP.F_AQ" => (1e-8, 1e-10),
        "SEP.F_OR" => (1e-12, 1e-13),
        "SEP.Q" => (1e-9, 1e-12),
        "xe" => (1e-6, 1e-9),
        other => panic!("no bound for {other}"),
    };
    if tight { strict } else { own }
}

fn cells(scenario: &str) -> usize {
    if scenario == "default" { 40 } else { 39 }
}

fn steady_state(scenario: &str) {
    let Some(table) = text_table("atropine_steady.csv") else { return };
    let mut replay = Replay::new("atropine.eq", scenario, None);
    replay.start(BTreeMap::new());
    let column = if scenario == "default" { 3 } else { 2 };
    let mut worst = Worst::default();
    for row in &table[1..] {
        let expected: f64 = row[column].parse().expect("a number");
        // The page lists flows of the mixers in mL/min.
        let unit = if row[1] == "mL/min" { 1e3 } else { 1.0 };
        let value = unit * replay.get(&row[0]);
        if expected.abs() > 1e-20 {
            worst.add("relative", (value / expected - 1.0).abs(), || row[0].clone());
        }
    }
    worst.assert_within(&format!("steady state, {scenario}"), |_| 1e-11);
}

fn text_table(name: &str) -> Option<Vec<Vec<String>>> {
    let path = reference::path(name)?;
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_path(path).expect("a table");
    Some(reader.records().map(|r| r.expect("a row").iter().map(str::to_owned).collect()).collect())
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn steady_states_are_the_published_ones() {
    for scenario in ["default", "coupled39", "legacy"] {
        steady_state(scenario);
    }
}

/// Kind of a column, and its value in the model.
fn column(replay: &Replay, name: &str, scenario: &str) -> Option<(&'static str, f64)> {
    let (head, member) = name.split_once('[').map_or((name, ""), |(h, m)| (h, m.trim_end_matches(']')));
    let last = cells(scenario);
    Some(match head {
        "E" => ("E", replay.get("E")),
        "tracking" => ("tracking", replay.get("reward.tracking")),
        "xe1" | "xe2" => ("xe", replay.get(name)),
        "SEP.F_OR" => ("SEP.F_OR", replay.get(name)),
        "SEP.F_AQ" => ("SEP.F_AQ", replay.get(name)),
        "SEP.Q_OR" | "SEP.Q_AQ" => ("SEP.Q", replay.get(name)),
        "SEP.c" => ("SEP.c", replay.get(name)),
        _ => {
            let (reactor, what) = head.split_once('.')?;
            match what {
                "out" => ("R.out", replay.get(&format!("{reactor}.c[{member},{last}]"))),
                "sum" => {
                    let inlet = replay.get(&format!("M{}.c[{member}]", &reactor[1..]));
                    let cells: f64 = (1..=last).map(|l| replay.get(&format!("{reactor}.c[{member},{l}]"))).sum();
                    ("R.sum", inlet + cells)
                }
                _ => return None,
            }
        }
    })
}

/// Replays a file and compares every column of the suffix.
fn trajectory(file: &str, suffix: &str, scenario: &str, tolerance: Option<(f64, f64)>) {
    let Some(table) = reference::table(file) else { return };
    let mut start = BTreeMap::new();
    if file.contains("_2") {
        let init = reference::table("atropine_2_init.csv").expect("it is next to the others");
        start.extend(init.names().map(|n| (n.to_owned(), init.get(0, n))));
    }
    let mut replay = Replay::new("atropine.eq", scenario, tolerance);
    replay.start(start);
    let names: Vec<String> = table.names().filter_map(|n| Some(n.strip_suffix(suffix)?.to_owned())).collect();
    let mut worst = Worst::default();
    for row in 0..table.len() {
        if row > 0 {
            let result = replay.step(&table, row);
            assert_eq!(result.failure, None, "{file}: step {row}");
            let limit = if scenario == "legacy" { 61 } else { 60 };
            assert_eq!(result.truncated, row >= limit, "{file}: step {row}");
        }
        for name in &names {
            let expected = table.get(row, &format!("{name}{suffix}"));
            // What a held coupling sends before the first step belongs to the steady state or to the start, as one likes.
            if scenario == "legacy" && row == 0 && name.contains(".sum[") {
                continue;
            }
            let Some((kind, value)) = column(&replay, name, scenario).filter(|_| expected.is_finite()) else { continue };
            let size = if kind == "E" { expected.abs() } else { 1.0 };
            worst.add(kind, (value - expected).abs() / size, || format!("{name}, step {row}"));
        }
    }
    worst.assert_within(&format!("{file}, {scenario}"), |kind| bound(kind, tolerance.is_some()));
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn continuous_coupling_follows_the_references() {
    trajectory("atropine_1_full.csv", ".full", "default", None);
    trajectory("atropine_1_coupled.csv", ".coupled", "coupled39", None);
    trajectory("atropine_2_coupled.csv", ".coupled", "coupled39", None);
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn held_coupling_follows_the_references() {
    trajectory("atropine_1.csv", ".tight", "legacy", None);
    trajectory("atropine_2.csv", ".tight", "legacy", None);
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn tight_tolerances_follow_the_references_tightly() {
    trajectory("atropine_1_full.csv", ".full", "default", Some((1e-11, 0.01)));
    trajectory("atropine_2.csv", ".tight", "legacy", Some((1e-11, 0.01)));
}

#[test]
fn the_nominal_action_keeps_the_steady_state() {
    let mut replay = Replay::new("atropine.eq", "default", None);
    replay.start(BTreeMap::new());
    for _ in 0..5 {
        let result = replay.environment.step(&[0.0; 4]).expect("a finite action");
        assert!(result.reward.abs() < 1e-9, "{}", result.reward);
    }
}
