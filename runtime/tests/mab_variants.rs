//! Effect of each choice of MAb (section 7 of its specification), one of them corrected and all else as in the original. The choices of the column are in
//! `mab.rs`: they show in the breakthrough.

mod support;

use std::collections::BTreeMap;

use smpl_runtime::environment::{ResetOptions, StepResult};
use smpl_runtime::failure::Failure;
use smpl_runtime::load::LoadOptions;
use smpl_runtime::scenario::{Value, Variant};
use support::replay::Replay;

/// `legacy` with one choice as by default, or `legacy` itself.
fn legacy(corrected: Option<&str>, settings: &[(&str, f64)]) -> Replay {
    let variants = corrected.into_iter().map(|name| Variant { name: name.into(), option: Some("default".into()) }).collect();
    let settings = settings.iter().map(|&(n, v)| (n.to_owned(), Value::Number(v))).collect();
    Replay::with("mab.eq", &LoadOptions { scenario: Some("legacy".into()), variants, settings, ..LoadOptions::default() }, None)
}

fn nominal(replay: &Replay) -> Vec<f64> {
    replay.environment.catalogue().actions.elements().iter().map(|a| a.default).collect()
}

/// The first step from the steady state, with some states and actions changed.
fn first(replay: &mut Replay, states: &[(&str, f64)], actions: &[(usize, f64)]) -> StepResult {
    replay.start(states.iter().map(|&(n, v)| (n.to_owned(), v)).collect());
    let mut action = nominal(replay);
    actions.iter().for_each(|&(at, value)| action[at] = value);
    replay.step_with(&action)
}

#[test]
fn every_choice_of_the_specification_is_there() {
    let choices = [
        "jacket_unit",
        "film_unit",
        "axial_scheme",
        "axial_cells",
        "bead_cells",
        "bead_porosity",
        "productivity_unit",
        "yield_window",
        "switch_books",
        "steps",
        "start_clip",
        "box_test",
        "tank_guard",
        "float32",
    ];
    for name in choices {
        let result = first(&mut legacy(Some(name), &[]), &[], &[]);
        assert_eq!(result.failure, None, "{name}");
    }
    for name in ["wide_bounds", "recycle_limit", "tank_height", "ph_factor", "unclipped_rules"] {
        let asked = LoadOptions { variants: vec![Variant { name: name.into(), option: None }], ..LoadOptions::default() };
        let mut replay = Replay::with("mab.eq", &asked, None);
        let result = first(&mut replay, &[], &[]);
        assert_eq!(result.failure, None, "{name}");
        assert_eq!(result.cost > 0.0, name == "recycle_limit", "{name}: the nominal recycle could not carry its cells");
    }
}

#[test]
fn the_unit_of_the_jacket_shows_in_the_temperature() {
    for (corrected, expected) in [(None, 37.00000036795219), (Some("jacket_unit"), 37.000000422)] {
        let mut replay = legacy(corrected, &[]);
        replay.start(BTreeMap::new());
        assert!((replay.get("T") - expected).abs() < 1e-9, "{}", replay.get("T"));
    }
}

#[test]
fn the_unit_of_the_separator_shows_in_the_reward() {
    for (corrected, expected) in [(None, 1349.4987), (Some("productivity_unit"), 2419.42)] {
        let result = first(&mut legacy(corrected, &[]), &[], &[]);
        assert!((result.reward - expected).abs() < 6e-3, "{corrected:?}: {}", result.reward);
    }
}

#[test]
fn the_yield_counts_the_step_or_its_end() {
    for corrected in [None, Some("yield_window")] {
        let mut replay = legacy(corrected, &[]);
        replay.start(BTreeMap::new());
        let action = nominal(&replay);
        for _ in 0..30 {
            replay.step_with(&action);
        }
        let made = replay.get("mAb1") * action[1] + replay.get("mAb2") / 200.0 * action[3];
        // At constant inflow the share of the step is what the column bound over what it was fed.
        let share = match corrected {
            None => 1.0 - replay.get("col.c[150]") / (replay.get("col.c[1]") + 1e-8),
            Some(_) => replay.get("reward.captured") / (action[7] * replay.get("c_buf")),
        };
        assert!(share < 0.95 && (replay.get("reward.yield") / (made * share) - 1.0).abs() < 1e-7, "{corrected:?}: {share}");
    }
}

#[test]
fn the_accumulator_is_a_balance_or_a_rule() {
    let mut replay = legacy(Some("switch_books"), &[]);
    first(&mut replay, &[], &[]);
    // 60 min of 21.689 L/min with 49.578 mg/L, in mg.
    assert!((replay.get("acc") / (60.0 * 21.689197033088462 * 49.57757365045033) - 1.0).abs() < 1e-6, "{}", replay.get("acc"));
    assert!((replay.get("acc") / replay.get("m_col") - 1.0).abs() < 1e-6);
    let mut replay = legacy(None, &[]);
    first(&mut replay, &[], &[]);
    let rule = 60.0 * (replay.get("col.c[1]") - replay.get("col.c[150]"));
    assert!((replay.get("acc") / rule - 1.0).abs() < 1e-12, "{}", replay.get("acc"));
}

#[test]
fn an_episode_has_200_steps_or_201() {
    assert_eq!(legacy(None, &[]).environment.setup().max_steps(), 201);
    assert_eq!(legacy(Some("steps"), &[]).environment.setup().max_steps(), 200);
}

#[test]
fn a_wide_start_is_clipped_into_the_box_or_not() {
    let outside = |corrected| {
        let mut replay = legacy(corrected, &[("spread", 0.1)]);
        let starts = (0..40).filter(|&seed| {
            replay.environment.reset(Some(seed), &ResetOptions::default()).expect("a start");
            replay.collect();
            // The legal volumes reach 5 % above 3000 L.
            ["V1", "V2"].iter().any(|v| replay.get(v) > 3150.0)
        });
        starts.count()
    };
    // V1 and V2 lie within (1 - 0.1, 1 + 0.1) of 3000 and 2977 L: nearly a half of all starts has one above 3150 L.
    assert!((8..=30).contains(&outside(None)), "{}", outside(None));
    assert_eq!(outside(Some("start_clip")), 0);
}

#[test]
fn the_box_has_a_tolerance_or_not() {
    // 1e-8 below the bound, where the volume stays.
    let state = [("V1", 2400.0 * (1.0 - 1e-8))];
    assert_eq!(first(&mut legacy(Some("box_test"), &[]), &state, &[]).failure, None);
    assert!(matches!(first(&mut legacy(None, &[]), &state, &[]).failure, Some(Failure::Declared(_))));
}

#[test]
fn the_tank_is_guarded_or_runs_dry() {
    for (corrected, level) in [(None, 1e-6), (Some("tank_guard"), 0.1)] {
        let mut replay = legacy(corrected, &[]);
        let result = first(&mut replay, &[], &[(3, 18.0), (7, 49.0)]);
        assert!(result.failure.is_some(), "{corrected:?}");
        assert!((replay.get("h") - level).abs() < 1e-6, "{corrected:?}: {}", replay.get("h"));
    }
}

#[test]
fn actions_are_rounded_to_single_precision_or_not() {
    let volume = |corrected| {
        let mut replay = legacy(corrected, &[]);
        first(&mut replay, &[("V1", 2500.0)], &[(0, 21.7), (1, 21.7 + 0.0050014)]);
        replay.get("V1")
    };
    let single = |x: f64| f64::from((x / 50.0) as f32) * 50.0;
    let exact = 2500.0 + 60.0 * (21.7 + 0.005001423553539404 - 21.7050014);
    let rounded = 2500.0 + 60.0 * (single(21.7) + single(0.005001423553539404) - single(21.7050014));
    assert!((rounded - exact).abs() > 1e-6);
    assert!(
        (volume(None) - rounded).abs() < 1e-9 && (volume(Some("float32")) - exact).abs() < 1e-9,
        "{} {}",
        volume(None),
        volume(Some("float32"))
    );
}
