//! Starts far from consistent, and messages and pictures of failed starts and steps.

use std::path::Path;

use smpl_runtime::environment::{Environment, ResetError, ResetOptions};
use smpl_runtime::load::{LoadOptions, load_text};
use smpl_runtime::setup::{EnvironmentOptions, Setup};

fn environment(text: &str) -> Environment {
    let text = format!("model M\ntime t : 1\nepisode {{ step = 1, max_steps = 10 }}\n{text}");
    let loaded = load_text(Path::new("m.eq"), text, &LoadOptions::default()).expect("compiles");
    let setup = Setup::new(loaded.model, EnvironmentOptions::default(), Some(loaded.sources)).expect("a setup");
    Environment::new(setup).expect("an environment")
}

fn started(text: &str) -> Result<Environment, ResetError> {
    let mut environment = environment(text);
    environment.reset(Some(1), &ResetOptions::default())?;
    Ok(environment)
}

/// Whatever the last episode left, and in whichever order they need each other.
#[test]
fn start_values_of_states_read_discrete_variables_disturbances_and_actions() {
    let text = "action u = 3 in 0..10\ndisturbance w = 4 ~ w + 1\ndiscrete V = 2 in 0..10\ndiscrete A = 1 in 0..1e3\n\
        state S = 0 in 0..1e3\nstate R = 0 in 0..1e3\nstate Q = 0 in 0..1e3\n\
        initial S = 10*V\ninitial A = S + 1\ninitial R = 10*u + w\ninitial Q = 2*A + n\n\
        eq d/dt S = 1\neq d/dt R = 0\neq d/dt Q = 0\nat end { next V = V + 1 }\nobserve S in 0..1e3\n";
    let mut environment = environment(text);
    for _ in 0..2 {
        environment.reset(Some(0), &ResetOptions::default()).expect("a start");
        assert_eq!(environment.unknowns()[..3], [20.0, 34.0, 42.0]);
        environment.step(&[7.0]).expect("a step");
    }
    let options = ResetOptions { discrete: [("V".to_owned(), 5.0)].into(), ..ResetOptions::default() };
    environment.reset(Some(0), &options).expect("a start");
    assert_eq!(environment.unknowns()[..3], [50.0, 34.0, 102.0]);
    let circle = text.replace("initial S = 10*V", "initial S = 10*A");
    assert!(started(&circle).err().expect("no start").to_string().contains("need each other"));
}

#[test]
fn a_logarithm_is_found_from_far_above_and_far_below() {
    for guess in [40.0, 300.0, -30.0, 0.0] {
        let text = format!("state x = 2\nvar z = {guess}\neq exp(z) = x\neq d/dt x = -x");
        let environment = started(&text).expect("starts");
        assert!((environment.unknowns()[1] - 2.0_f64.ln()).abs() < 1e-9, "from {guess}: {:?}", environment.unknowns());
    }
}

#[test]
fn a_start_without_a_solution_names_the_equation_and_the_variable_and_no_unit_1() {
    let error = started("state x = -1\nvar y = 1\nvar z = 2\neq y = x + 1\neq z^2 + z = x\neq d/dt x = z - y").err().expect("no real root");
    let text = error.to_string();
    assert!(text.contains("m.eq:8, z,") && text.lines().next().is_some_and(|line| line.ends_with("at t = 0")), "{text}");
}

#[test]
fn a_solution_that_blows_up_names_its_equation_and_its_state() {
    let mut environment = started("state w = 1\nstate x = 0.8\neq d/dt w = -w\neq d/dt x = x^2").expect("starts");
    assert!(!environment.step(&[]).expect("steps").terminated);
    assert!(environment.step(&[]).expect("steps").terminated, "the pole is at t = 1.25");
    let text = environment.failure_message();
    assert!(text.contains("m.eq:7, d/dt x,"), "{text}");
    assert!(text.contains("at t = 1.25") && !text.contains("1.25 1"), "{text}");
}

/// The pole of x' = u x^2 is at 1/u: the second step fails. What is shown then is that of before it, of one moment.
#[test]
fn after_a_failed_step_states_and_algebraic_variables_are_those_before_it() {
    let model = "action u = 0.1 in 0..10\nstate x = 1\nlet q : 1 = u*x\nvar z = 1\neq z^3 = 8*u^3*x^3\neq d/dt x = u*x^2\nobserve x, z";
    let mut environment = started(model).expect("starts");
    environment.step(&[0.1]).expect("steps");
    let names: Vec<String> = environment.catalogue().algebraics.names().map(str::to_owned).collect();
    let (mut before, mut after) = (vec![0.0; names.len()], vec![0.0; names.len()]);
    environment.algebraics(&mut before);
    let failed = environment.step(&[5.0]).expect("steps");
    assert!(failed.terminated);
    assert_eq!([failed.time, environment.time()], [1.0, 1.0], "the time of the state");
    environment.algebraics(&mut after);
    assert_eq!(before, after, "{names:?}");
    let q = names.iter().position(|name| name == "q").expect("an output");
    // x = 1/(1 - 0.1) after the first step.
    assert!((after[q] - 0.1 / 0.9).abs() < 1e-5, "{}", after[q]);
    assert_eq!(environment.actions(), [5.0], "the action that was given");
}

#[test]
fn an_episode_that_is_continued_after_a_failed_step_goes_on_where_its_state_is() {
    let mut environment = started("action u = 0.1 in 0..10\nstate x = 1\neq d/dt x = u*x^2\nobserve x").expect("starts");
    environment.set_keep_going(true);
    environment.step(&[0.1]).expect("steps");
    for action in [5.0, f64::INFINITY, 5.0] {
        let failed = environment.step(&[action]).expect("steps");
        assert_eq!((failed.terminated, failed.time), (true, 1.0), "{action}");
    }
    let result = environment.step(&[0.1]).expect("steps");
    assert_eq!(result.time, 5.0);
    // 1/x falls by 0.1 in a unit of time: four of them have not been integrated before.
    assert!((environment.unknowns()[0] - 1.0 / 0.5).abs() < 1e-4, "{:?}", environment.unknowns());
}
