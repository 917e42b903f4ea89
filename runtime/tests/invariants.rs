//! What models declare as conserved is conserved along trajectories that are far from rest.

use std::path::Path;

use smpl_runtime::environment::{Environment, ResetOptions};
use smpl_runtime::load::{LoadOptions, load};
use smpl_runtime::setup::Setup;

/// The largest drift of each invariant of a model, over its magnitude, after steps with actions all over their boxes from a sampled start.
fn drifts(model: &str, scenario: &str, steps: u32) -> Vec<f64> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models").join(model);
    let asked = LoadOptions { scenario: Some(scenario.into()), ..LoadOptions::default() };
    let loaded = load(&path, &asked).unwrap_or_else(|e| panic!("{model}: {e}"));
    let setup = Setup::new(loaded.model, loaded.options, Some(loaded.sources)).unwrap_or_else(|e| panic!("{model}: {e}"));
    let mut environment = Environment::new(setup).unwrap_or_else(|e| panic!("{model}: {e}"));
    environment.set_keep_going(true);
    environment.reset(Some(1), &ResetOptions::default()).unwrap_or_else(|e| panic!("{model}: {e}"));
    environment.watch_invariants();
    for step in 0..steps {
        let actions = environment.catalogue().actions.elements();
        let share = |i: u32| f64::from((7 * step + 3 * i) % 11) / 10.0;
        let action: Vec<f64> = (0..).zip(actions).map(|(i, a)| a.low + share(i) * (a.high - a.low)).collect();
        environment.step(&action).unwrap_or_else(|e| panic!("{model}: {e}"));
    }
    environment.invariant_drifts().iter().map(|drift| drift.largest / drift.magnitude).collect()
}

#[test]
fn moles_of_the_reactor_are_conserved() {
    let drifts = drifts("reactor.eq", "default", 30);
    assert!(drifts.len() == 1 && drifts[0] < 1e-6, "{drifts:?}");
}

#[test]
fn cells_of_the_fermentation_only_change_their_kind() {
    let drifts = drifts("beer.eq", "default", 150);
    assert!(drifts.len() == 1 && drifts[0] < 1e-5, "{drifts:?}");
}

#[test]
fn skeletons_of_tropine_are_conserved_in_all_reactions() {
    for scenario in ["default", "coupled39", "legacy"] {
        let drifts = drifts("atropine.eq", scenario, 12);
        // The rate is integrated by a fixed rule, which sees little of what happens within seconds.
        assert!(drifts.len() == 1 && drifts[0] < 1e-5, "{scenario}: {drifts:?}");
    }
}
