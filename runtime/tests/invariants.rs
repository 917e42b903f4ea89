//! Declared invariants of models are conserved along trajectories that are far from rest.

use std::path::Path;

use smpl_runtime::environment::{Drift, Environment, ResetOptions};
use smpl_runtime::load::{LoadOptions, load};
use smpl_runtime::scenario::Variant;
use smpl_runtime::setup::Setup;

/// The largest drift of each invariant of a model, over its magnitude, after steps with actions all over their boxes from a sampled start.
fn drifts(model: &str, scenario: &str, steps: u32) -> Vec<f64> {
    let (drifts, _) = run(model, LoadOptions { scenario: Some(scenario.into()), ..LoadOptions::default() }, steps);
    drifts.iter().map(|drift| drift.largest / drift.magnitude).collect()
}

/// The same as drifts, with the environment at the end.
fn run(model: &str, asked: LoadOptions, steps: u32) -> (Vec<Drift>, Environment) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models").join(model);
    let loaded = load(&path, &asked).unwrap_or_else(|e| panic!("{model}: {e}"));
    let setup = Setup::new(loaded.model, loaded.options, Some(loaded.sources)).unwrap_or_else(|e| panic!("{model}: {e}"));
    let mut environment = Environment::new(setup).unwrap_or_else(|e| panic!("{model}: {e}"));
    environment.set_keep_going(true);
    environment.reset(Some(1), &ResetOptions::default()).unwrap_or_else(|e| panic!("{model}: {e}"));
    environment.watch_invariants().expect("watches");
    for step in 0..steps {
        let actions = environment.catalogue().actions.elements();
        let share = |i: u32| f64::from((7 * step + 3 * i) % 11) / 10.0;
        let action: Vec<f64> = (0..).zip(actions).map(|(i, a)| a.low + share(i) * (a.high - a.low)).collect();
        environment.step(&action).unwrap_or_else(|e| panic!("{model}: {e}"));
    }
    (environment.invariant_drifts().to_vec(), environment)
}

/// State of an environment by its name.
fn state(environment: &Environment, name: &str) -> f64 {
    let at = environment.catalogue().states.position(name).unwrap_or_else(|| panic!("no state {name}"));
    let mut states = vec![0.0; environment.catalogue().states.len()];
    environment.state(&mut states);
    states[at]
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

// Of the broth, by Goldrick et al.: d(V a_i)/dt = V (rates of region i) - (discharge/rho) a_i, as d V/dt = F_dil - discharge/rho and every region
// is diluted by F_dil/V. Branching, differentiation, degeneration and autolysis each leave one region for another one; extension alone makes
// biomass. Phenylacetic acid is fed, used for maintenance, harvested, or built into biomass (Y_PAAX) and penicillin (Y_PAAP). A newborn vacuole has
// the volume pi (r_0 + delta_0)^3/6, and both its number and its volume leave the class at the rate k_v.
#[test]
fn biomass_precursor_and_newborn_vacuoles_of_the_penicillin_fermentation_are_conserved() {
    let variant = |name: &str| LoadOptions { variants: vec![Variant::parse(name)], ..LoadOptions::default() };
    let legacy = LoadOptions { scenario: Some("legacy".into()), ..LoadOptions::default() };
    for asked in [LoadOptions::default(), legacy, variant("gross_uptake"), variant("oil_volume")] {
        let name = format!("{:?} {:?}", asked.scenario, asked.variants);
        let (drifts, environment) = run("pensim.eq", asked, 60);
        let [biomass, precursor, vacuoles] = drifts[..] else { panic!("{name}: {drifts:?}") };
        // Growth follows the dissolved oxygen, which settles within seconds: the fixed rule for the rate sees little of that.
        assert!(biomass.largest < 1e-5 * biomass.magnitude, "{name}: {biomass:?}");
        assert!(precursor.largest < 1e-7 * precursor.magnitude, "{name}: {precursor:?}");
        // Linear and without a rate: exact but for rounding and what Newton's method leaves.
        assert!(vacuoles.largest < 1e-11 * state(&environment, "phi0"), "{name}: {vacuoles:?}");
    }
}

#[test]
fn an_invariant_of_what_moves_fast_is_integrated_as_closely_as_the_states() {
    let text = "model M\ntime t : 1\nstate x = 0 in -1..1\nstate y = 1 in -1..1\neq d/dt x = y\neq d/dt y = -200*y\n\
                invariant a = x rate y\nobserve x\nepisode { step = 1, max_steps = 3 }\n";
    let loaded = smpl_runtime::load::load_text(Path::new("m.eq"), text.into(), &LoadOptions::default()).expect("compiles");
    let mut environment = Environment::new(Setup::new(loaded.model, loaded.options, None).expect("a setup")).expect("an environment");
    environment.watch_invariants().expect("watches");
    environment.reset(Some(1), &ResetOptions::default()).expect("resets");
    for _ in 0..3 {
        environment.step(&[]).expect("steps");
    }
    // x moves by 1/200.
    let drift = environment.invariant_drifts()[0];
    assert!(drift.largest < 1e-8 && (drift.magnitude - 0.005).abs() < 1e-8, "{drift:?}");
}
