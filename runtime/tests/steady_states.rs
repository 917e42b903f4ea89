//! Steady states of small models against closed forms: bounds, conserved sums, conditions, first guesses, blocks that nothing needs.

use std::path::Path;
use std::sync::Arc;

use smpl_runtime::environment::{Environment, ResetOptions, Start};
use smpl_runtime::load::{LoadOptions, load_text};
use smpl_runtime::setup::{EnvironmentOptions, Setup, SetupError};
use smpl_runtime::steady::{self, SteadyError};
use smpl_runtime::system::CompiledSystem;

fn made(text: &str) -> Result<Arc<Setup>, SetupError> {
    let text = format!("model M\ntime t : s\nepisode {{ step = 0.1 [s], max_steps = 10 }}\n{text}");
    let loaded = load_text(Path::new("m.eq"), text, &LoadOptions::default()).expect("compiles");
    Setup::without_steady(loaded.model.clone(), EnvironmentOptions::default(), None)?;
    Setup::new(loaded.model, EnvironmentOptions::default(), None)
}

fn setup(text: &str) -> Arc<Setup> {
    made(text).expect("a setup")
}

/// An instance with its parameters, without a steady state.
fn fresh(setup: &Setup) -> CompiledSystem {
    let mut system = CompiledSystem::new(setup.model().clone()).expect("a system");
    let (model, memory) = system.parts();
    model.parameters(memory);
    model.prepare_parameters(memory);
    system
}

/// The steady state that the block declares, from a first guess.
fn solved(text: &str, guess: Option<&[f64]>) -> Result<Vec<f64>, SteadyError> {
    let setup = setup(text);
    let mut system = fresh(&setup);
    let mut y = steady::guess(&system, &setup.catalogue);
    y.iter_mut().zip(guess.unwrap_or_default()).for_each(|(y, guess)| *y = *guess);
    let (actions, held) = steady::declared(&mut system, &setup.catalogue, &mut y);
    steady::solve_held(&mut system, &setup.catalogue, &actions, &held, &[], &mut y)?;
    Ok(y)
}

fn assert_close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-10 * b.abs().max(1.0)), "{found:?} is not {expected:?}");
}

/// S^2 + 2.1 S - 0.1 = 0 has a root of each sign.
fn chemostat(bounds: &str) -> String {
    format!(
        "state S : g/L = 0.04 {bounds}
         eq d/dt S = 1 [1/s]*(1 [g/L] - S) - 3 [g/(L s)]*S/(0.1 [g/L] + S)"
    )
}

#[test]
fn a_root_is_inside_of_the_bounds_wherever_the_search_begins() {
    let root = (-2.1 + 4.81_f64.sqrt()) / 2.0;
    for guess in [0.0, 0.04, 0.5, 1.0, 3.0, 10.0] {
        assert_close(&solved(&chemostat("in 0..10"), Some(&[guess])).expect("found"), &[root]);
    }
    // Without bounds the guess decides.
    assert_close(&solved(&chemostat(""), Some(&[10.0])).expect("found"), &[(-2.1 - 4.81_f64.sqrt()) / 2.0]);
}

#[test]
fn where_no_root_is_inside_of_the_bounds_the_state_is_named() {
    let error = solved(&chemostat("in 0.5..10"), Some(&[5.0])).expect_err("refused");
    assert!(matches!(&error, SteadyError::Outside { name, below: true, bound: 0.5, .. } if name == "S"), "{error}");
    assert!(error.to_string().contains("S = ") && error.to_string().contains("below 0.5 g/L"), "{error}");
}

#[test]
fn where_there_is_no_rest_the_search_says_how_near_it_came() {
    // x^2 + 2 is 2 at least.
    let error = solved("state x = 1 in -100..100\neq d/dt x = (2 + sq(x)) / 1 [s]", None).expect_err("none");
    let SteadyError::NotFound { residual, aside, .. } = &error else { panic!("{error}") };
    assert!((2.0..2.1).contains(residual) && aside.is_none(), "{error}");
    assert!(error.to_string().ends_with("there may be none, else give a better initial value"), "{error}");
    // exp(-x) falls on until x meets its bound.
    let error = solved("state x : m = 1 in 0..20\neq d/dt x = exp(-x / 1 [m]) * 1 [m/s]", None).expect_err("none");
    let SteadyError::NotFound { residual, .. } = &error else { panic!("{error}") };
    assert!(*residual >= (-20.01_f64).exp(), "{error}");
    assert!(error.to_string().contains("has come to its bound 20 m"), "{error}");
    // What rises whatever the state is says so.
    let error = solved("state x = 1, y = 1\neq d/dt x = 2 / 1 [s]\neq d/dt y = (x - y) / 1 [s]", None).expect_err("none");
    assert!(
        error.to_string().starts_with("there is no steady state with these actions and parameters: d/dt x = 2 1/s, whatever the state"),
        "{error}"
    );
    assert!(error.to_string().contains("no action acts on it"), "{error}");
}

const EXCHANGE: &str = "state A = 1, B = 0\neq d/dt A = -1 [1/s]*A + 2 [1/s]*B\neq d/dt B = 1 [1/s]*A - 2 [1/s]*B\n";

#[test]
fn a_conserved_sum_is_found_and_asked_for() {
    let error = solved(EXCHANGE, None).expect_err("not determined").to_string();
    assert!(error.contains("A + B (1 at the first guess) is conserved") && error.contains("`steady { A + B = 1 }`"), "{error}");
}

#[test]
fn a_conserved_sum_is_given_by_a_condition() {
    assert_close(&solved(&format!("{EXCHANGE}steady {{ A + B = 3 }}"), None).expect("found"), &[2.0, 1.0]);
    assert_close(&solved(&format!("{EXCHANGE}steady {{ B = 3 }}"), None).expect("found"), &[6.0, 3.0]);
    // Any expression of states: with A = 2 B, A^2 + B = 5 is 4 B^2 + B = 5.
    assert_close(&solved(&format!("{EXCHANGE}steady {{ A^2 + B = 5 }}"), None).expect("found"), &[2.0, 1.0]);
}

/// A cycle whose rates add up to zero only to rounding: the sum is found by its null vector, not by a pivot that is zero.
#[test]
fn a_cycle_of_enzymes_with_roundoff_in_its_rates_is_not_reported_as_a_residual() {
    let cycle = "state E0 = 1, E1 = 0, E2 = 0
        param k1 : 1/s = 0.3, k2 : 1/s = 0.7, k3 : 1/s = 1.1
        eq d/dt E0 = -k1*E0 + k3*E2
        eq d/dt E1 = k1*E0 - k2*E1
        eq d/dt E2 = k2*E1 - k3*E2\n";
    let error = solved(cycle, None).expect_err("not determined").to_string();
    assert!(error.contains("E0 + E1 + E2 (1 at the first guess) is conserved"), "{error}");
    // At rest already, where nothing is wrong with the residual.
    let weights = [1.0 / 0.3, 1.0 / 0.7, 1.0 / 1.1];
    let total: f64 = weights.iter().sum();
    let rest: Vec<f64> = weights.iter().map(|w| w / total).collect();
    assert!(matches!(solved(cycle, Some(&rest)), Err(SteadyError::Undetermined(_))));
    assert_close(&solved(&format!("{cycle}steady {{ E0 + E1 + E2 = 1 }}"), None).expect("found"), &rest);
}

#[test]
fn the_sums_of_a_closed_reaction_are_named_all_at_once() {
    let batch = "state E = 1, S = 5, C = 0, P = 0
        eq d/dt E = (-2*E*S + 1.5*C - 0.25*E*P)/1 [s]
        eq d/dt C = (2*E*S - 1.5*C + 0.25*E*P)/1 [s]
        eq d/dt S = (-2*E*S + C)/1 [s]
        eq d/dt P = (0.5*C - 0.25*E*P)/1 [s]\n";
    let error = solved(batch, None).expect_err("not determined").to_string();
    assert!(error.contains("E + C (1 at the first guess) and S + C + P (5 at the first guess) are conserved"), "{error}");
    assert!(error.contains("`--fix E=... --fix S=...`"), "{error}");
    let y = solved(&format!("{batch}steady {{ E + C = 1, S + C + P = 5 }}"), None).expect("found");
    let (e, s, c, p) = (y[0], y[1], y[2], y[3]);
    assert_close(&[e + c, s + c + p, 2.0 * e * s, 0.25 * e * p], &[1.0, 5.0, c, 0.5 * c]);
}

#[test]
fn all_states_that_integrate_are_named_at_once_and_no_others() {
    let tanks = "action F = 1 in 0..2\nstate h1 = 1, c = 0, h2 = 1
        eq d/dt h1 = (F - 1)/1 [s]
        eq d/dt c = (1 - c)*F/h1/1 [s]
        eq d/dt h2 = (1 - F)/1 [s]\n";
    let error = solved(tanks, None).expect_err("not determined").to_string();
    assert!(error.contains("fix 2 states") && error.contains("`--fix h1=... --fix h2=...`"), "{error}");
    assert_close(&solved(&format!("{tanks}steady {{ h1 = 0.5, h2 = 2 }}"), None).expect("found"), &[0.5, 1.0, 2.0]);
}

/// Filled tanks conserve nothing, though 5 a - 3 b would stay: each rises, and the actions that fill them are named.
#[test]
fn what_is_filled_is_not_conserved_and_the_actions_that_fill_it_are_named() {
    let tanks = "action F = 3 in 0..9, G = 5 in 0..9, Q = 1 in 0..2\nstate a : kg = 1, b : g = 1, T = 1
        eq d/dt a = F*1 [kg/s]
        eq d/dt b = (F + G - 3)*1 [g/s]
        eq d/dt T = (Q - T)/1 [s]\n";
    let error = solved(tanks, None).expect_err("none").to_string();
    let wording = "there is no steady state with these actions and parameters: d/dt a = 3 kg/s and d/dt b = 5 g/s, whatever the state; \
                the actions F and G act on them: give them other values; or hold states, `steady { a = ..., b = ... }` in the model, or \
                `--fix a=... --fix b=...`";
    assert_eq!(error, wording);
    // At the actions at which nothing flows, each may have any value: it integrates.
    let resting = tanks.replace("F = 3", "F = 0").replace("G = 5", "G = 3");
    let error = solved(&resting, None).expect_err("not determined").to_string();
    assert!(
        error.starts_with("the steady state is not determined: fix 2 states that integrate, all of them") && !error.contains("conserved"),
        "{error}"
    );
}

#[test]
fn a_state_whose_rate_is_zero_is_conserved() {
    let error = solved("state x : kg = 4, y : kg = 1\neq d/dt x = 0 [kg/s]\neq d/dt y = (x - y)/1 [s]\n", None)
        .expect_err("not determined")
        .to_string();
    assert!(error.starts_with("the steady state is not determined: x (4 kg at the first guess) is conserved: give its value"), "{error}");
}

/// A + B gains what is fed, and C + D nothing: A -> B, C <-> D.
#[test]
fn a_sum_that_is_fed_rises_and_another_is_conserved_beside_it() {
    let reactor = "action F = 2 in 0..9\nstate A = 1, B = 0, C = 1, D = 2
        eq d/dt A = (F - 3*A + B)/1 [s]
        eq d/dt B = (3*A - B)/1 [s]
        eq d/dt C = (D - 1e6*C*A)/1 [s]
        eq d/dt D = (1e6*C*A - D)/1 [s]\n";
    let error = solved(reactor, None).expect_err("none").to_string();
    assert!(error.contains("d/dt (A + B) = 2 1/s, whatever the state; the action F acts on it"), "{error}");
    assert!(error.contains("; C + D (3 at the first guess) is conserved; or hold a state"), "{error}");
}

#[test]
fn the_search_begins_where_the_episode_does() {
    // x' = x - x^3 rests at -1, 0 and 1.
    let model = |initial: f64| format!("state x = 0.9\ninitial x = {initial}\neq d/dt x = (x - x^3)/1 [s]\nsteady {{ }}");
    for (initial, rest) in [(-0.9, -1.0), (0.1, 0.0), (1.2, 1.0)] {
        assert_close(setup(&model(initial)).steady_state(), &[rest]);
    }
}

#[test]
fn other_steady_states_inside_of_the_bounds_are_found() {
    let setup = setup("state x = 0.9 in -0.5..3\neq d/dt x = (x - x^3)/1 [s]\nsteady { }");
    let mut system = smpl_runtime::system::CompiledSystem::new(setup.model().clone()).expect("a system");
    let (model, memory) = system.parts();
    model.prepare_parameters(memory);
    let held = steady::Held::default();
    let mut found: Vec<f64> = steady::others(&system, &setup.catalogue, &[], &held, &[1.0]).iter().map(|y| y[0]).collect();
    found.sort_by(f64::total_cmp);
    assert_close(&found, &[0.0]);
    assert!(steady::kink(&mut system, &setup.catalogue, &[1.0]).is_none());
}

#[test]
fn a_tie_of_max_is_a_kink() {
    let setup = setup("state x = 0.5\neq d/dt x = (max(0, 1 - x) - 10*max(0, x - 1))/1 [s]\nsteady { }");
    assert_close(setup.steady_state(), &[1.0]);
    let mut system = smpl_runtime::system::CompiledSystem::new(setup.model().clone()).expect("a system");
    assert_eq!(steady::kink(&mut system, &setup.catalogue, &[1.0]), Some(0));
    assert_eq!(steady::kink(&mut system, &setup.catalogue, &[0.7]), None);
}

/// x' = 1 + x^2 never rests; x = tan(t + atan 1).
#[test]
fn a_steady_block_without_a_solution_stops_only_what_needs_it() {
    let endless = "state x = 1\neq d/dt x = (1 + x*x)/1 [s]\nsteady { }\n";
    let setup = setup(endless);
    assert!(setup.no_steady().is_some());
    let mut environment = Environment::new(setup).expect("an environment");
    environment.reset(Some(1), &ResetOptions::default()).expect("resets");
    assert!(!environment.step(&[]).expect("steps").terminated);
    let expected = (0.1 + std::f64::consts::FRAC_PI_4).tan();
    assert!((environment.unknowns()[0] - expected).abs() < 1e-4, "{}", environment.unknowns()[0]);
    let start = ResetOptions { start: Start::Steady, ..ResetOptions::default() };
    assert!(environment.reset(Some(1), &start).expect_err("there is none").to_string().starts_with("steady state: no steady state"));
    assert!(matches!(made(&format!("{endless}reward r = -sq(x - steady(x))")), Err(SetupError::Steady(_))));
}

/// At rest the start, the step before and the steady state are the point itself, wherever the search begins.
#[test]
fn what_equations_read_of_other_instants_is_the_state_itself_at_rest() {
    for read in ["steady(x)", "previous(x)", "initial(x)", "previous(3*x)/3", "initial(sq(x))/max(x, 0.1)"] {
        let text = format!(
            "action u = 0.5 in 0..1
             state x = 3 in 0..10
             eq d/dt x = (u - x + 2*({read} - x))/1 [s]
             steady {{ u = 0.5 }}"
        );
        for guess in [0.01, 0.5, 3.0, 9.0] {
            assert_close(&solved(&text, Some(&[guess])).expect("found"), &[0.5]);
        }
        assert_close(setup(&text).steady_state(), &[0.5]);
    }
}

#[test]
fn an_equation_that_reads_other_instants_alone_is_solved_by_them() {
    // b = 1 follows from the first equation, a = b from the second.
    let pair = "state a = 3, b = 2\neq d/dt a = (1 - previous(b))/1 [s]\neq d/dt b = (a - b)/1 [s]";
    assert_close(&solved(pair, None).expect("found"), &[1.0, 1.0]);
    // Algebraic variables: 0.5 - z + z - 2 z = 0, x = z + z^3.
    let solved_for = "state x = 3
        var z = 1
        eq z + z^3 = x
        eq d/dt x = (0.5 - z + previous(z) - 2*initial(z))/1 [s]";
    assert_close(&solved(solved_for, None).expect("found"), &[0.25 + 0.015625, 0.25]);
    // Arrays.
    let array = "state x[k in 1..3] = 5\neq d/dt x[k] = (k - x[k] + 3*(initial(x[4-k]) - x[4-k]))/1 [s] for k in 1..3";
    assert_close(&solved(array, None).expect("found"), &[1.0, 2.0, 3.0]);
    // What reads its own state there has no rate left: any x is at rest.
    let free = "state x = 3\neq d/dt x = (previous(x) - x)/1 [s]";
    assert!(matches!(solved(free, None), Err(SteadyError::Undetermined(_))));
}

#[test]
fn discrete_variables_that_do_not_settle_are_no_steady_state() {
    let text = |gain: f64| format!("discrete I = {gain}*steady(x) + 1\nstate x = 0\neq d/dt x = (I - x)/1 [s]\nsteady {{ }}");
    assert_close(&solved(&text(0.5), None).expect("found"), &[2.0]);
    assert!(matches!(made(&text(2.0)), Err(SetupError::Steady(SteadyError::NotFound { .. }))));
}

#[test]
fn discrete_variables_that_a_step_would_change_are_named() {
    let text = "discrete I = 0, v = 0.4, still = 2, total : s = 0
        state x = 3
        at start { next I = I + (1 - x); next v = 0.3*(1 - x) + 0.1*I; next still = 2*sq(x)/0.81*0.5 + 1 }
        at end { next total = total + integral(x) }
        eq d/dt x = (0.5 + v - x)/1 [s]";
    let setup = setup(text);
    let mut system = fresh(&setup);
    let mut y = steady::guess(&system, &setup.catalogue);
    steady::solve(&mut system, &setup.catalogue, &[], &[], &mut y).expect("found");
    assert_close(&y, &[0.9]);
    steady::rest_at(&mut system, &y);
    let found = steady::changed_by_a_step(&system, &setup.catalogue, &y);
    let names: Vec<&str> = found.iter().map(|f| f.0.name.as_str()).collect();
    assert_eq!(names, ["I", "v", "total"]);
    // The step is of 0.1 s.
    assert_close(&found.iter().map(|f| f.2).collect::<Vec<_>>(), &[0.1, 0.03, 0.09]);
    assert_close(&found.iter().map(|f| f.1).collect::<Vec<_>>(), &[0.0, 0.4, 0.0]);
}
