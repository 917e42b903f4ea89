//! Consistent starts inside of the declared bounds; the roots are those of the products of their linear factors.

use std::path::Path;

use smpl_runtime::environment::{Environment, ResetOptions, StateInput};
use smpl_runtime::load::{LoadOptions, load_text};
use smpl_runtime::setup::{EnvironmentOptions, Setup};
use smpl_runtime::solver::Method;

const METHODS: [Method; 3] = [Method::Ida, Method::Rosenbrock, Method::Auto];

fn environment(text: &str, method: Method) -> Environment {
    let text = format!("model M\ntime t : s\nepisode {{ step = 1 [s], max_steps = 10 }}\n{text}");
    let loaded = load_text(Path::new("m.eq"), text, &LoadOptions::default()).expect("compiles");
    let mut options = EnvironmentOptions::default();
    options.solver.method = Some(method);
    let setup = Setup::new(loaded.model, options, Some(loaded.sources)).expect("a setup");
    Environment::new(setup).expect("an environment")
}

/// The value of the solved variable `v` at the start, or the reason of its absence.
fn started(text: &str, method: Method) -> Result<f64, String> {
    let mut environment = environment(text, method);
    environment.reset(Some(0), &ResetOptions::default()).map_err(|error| error.to_string())?;
    Ok(value(&environment, "v"))
}

fn value(environment: &Environment, name: &str) -> f64 {
    let catalogue = environment.catalogue();
    let at = catalogue.solved.find(name).or_else(|| catalogue.states.find(name)).expect("there").at;
    environment.unknowns()[at]
}

fn cubic(guess: f64, bounds: &str) -> String {
    format!(
        "state x = 0\nvar v = {guess} {bounds}\neq d/dt x = (v - x)*1[1/s]\neq (v - 3)*(v + 10)*(v - 15) = 0\nobserve x\nreward r = x\n"
    )
}

#[test]
fn a_start_takes_the_root_inside_of_the_bounds() {
    for method in METHODS {
        for (guess, bounds) in [(9.0, "in 0..10"), (14.0, "in 0..5"), (9.9, "in -5..10"), (0.0, "in 0..14"), (-20.0, "in -9..14")] {
            let found = started(&cubic(guess, bounds), method).expect("a start");
            assert!((found - 3.0).abs() < 1e-6, "{method} from {guess} {bounds}: {found}");
        }
        let found = started(&cubic(14.0, "in 10..20"), method).expect("a start");
        assert!((found - 15.0).abs() < 1e-6, "{found}");
    }
}

#[test]
fn a_start_without_a_root_inside_of_the_bounds_is_refused_by_name() {
    for method in METHODS {
        let refused = started(&cubic(5.0, "in 4..9"), method).expect_err("no root");
        assert!(refused.contains("`v`") || refused.contains(" v"), "{refused}");
        assert!(refused.contains("4..9") && refused.contains("m.eq:"), "{refused}");
    }
}

/// Newton's method alone goes from 9 to -10, as without bounds.
#[test]
fn a_variable_without_bounds_takes_the_root_that_newton_finds() {
    let found = started(&cubic(9.0, ""), Method::Auto).expect("a start");
    assert!((found + 10.0).abs() < 1e-6, "{found}");
}

#[test]
fn bounds_in_another_unit_and_of_array_elements_hold_too() {
    let text = "state x : m = 0 [m]
                var w[i in 1..2] : mm = 9000 [mm] in 0 [mm]..10000 [mm]
                eq d/dt x = (w[1] + w[2])*1[1/s] - x*1[1/s]
                eq (w[i] - 3 [m])*(w[i] + 10 [m])*(w[i] - 15 [m]) = 0 [m^3] for i in 1..2
                observe x
                reward r = x/1[m]\n";
    for method in METHODS {
        let mut environment = environment(text, method);
        environment.reset(Some(0), &ResetOptions::default()).expect("a start");
        for name in ["w[1]", "w[2]"] {
            assert!((value(&environment, name) - 3000.0).abs() < 1e-3, "{method}: {}", value(&environment, name));
        }
    }
}

/// The smallest positive root of x (1 + x) (x - 0.2) + 1/1000, by bisection.
const SMALL: f64 = 0.005_104_905;

#[test]
fn a_rate_without_a_value_at_the_guess_is_evaluated_at_the_solution() {
    let text = "state m = 0 in 0..1e6
                var v = 0 in 0..1
                eq v*(1 + v)*(v - 0.2) + 1e-3 = 0
                eq d/dt m = 1/v*1[1/s]
                observe m
                reward r = m\n";
    for method in METHODS {
        let mut environment = environment(text, method);
        environment.reset(Some(0), &ResetOptions::default()).expect("a start");
        environment.step(&[]).expect("a step");
        let rate = 1.0 / value(&environment, "v");
        assert!((value(&environment, "v") - SMALL).abs() < 1e-6, "{}", value(&environment, "v"));
        assert!((value(&environment, "m") - rate).abs() < 1e-4 * rate, "{method}: {}", value(&environment, "m"));
    }
}

/// v = sqrt(u) is a root, and the only one that is positive; from 3 Newton's method goes to -1e-4 at u = 100.
#[test]
fn a_restart_keeps_the_branch_inside_of_the_bounds() {
    let text = "action u = 9 in 0.01..100
                state x = 0
                var v = 3 in 0..20
                eq d/dt x = (v - x)*1[1/s]
                eq v*v*v - u*v + 1e-3*(v - sqrt(u)) = 0
                observe x
                reward r = x\n";
    for method in METHODS {
        let mut environment = environment(text, method);
        environment.reset(Some(0), &ResetOptions::default()).expect("a start");
        for u in [100.0, 0.01] {
            environment.step(&[u]).expect("a step");
            assert!((value(&environment, "v") - u.sqrt()).abs() < 1e-4, "{method} at {u}: {}", value(&environment, "v"));
        }
    }
}

/// States that the caller gives may belong to a root outside of the bounds: an episode goes on there.
#[test]
fn given_states_are_simulated_as_they_are() {
    let text = "state x = 1\nvar v = 1 in 0..2\neq d/dt x = -v*1[1/s]\neq v + 1e-3*v*v*v = x\nobserve x\nreward r = x\n";
    let mut environment = environment(text, Method::Auto);
    let options = ResetOptions { state: StateInput::Array(vec![5.0]), ..ResetOptions::default() };
    environment.reset(Some(0), &options).expect("a start");
    let v = value(&environment, "v");
    assert!((v + 1e-3 * v.powi(3) - 5.0).abs() < 1e-6, "{v}");
}

/// After a jump of u the quadratic in v has its roots 1 and 5 moved to 8 and 12: neither is in 0..6.
fn moved(form: &str) -> String {
    format!(
        "action u = 0 in 0..7
         state x = 0
         state z = 0
         var v = 1.5 in 0..6
         {form}
         eq (v - u - 1)*(v - u - 5) = 0
         observe x
         reward r = x\n"
    )
}

#[test]
fn a_restart_without_a_root_inside_of_the_bounds_fails_by_name() {
    let explicit = "eq d/dt x = (v - x)*1[1/s]\neq d/dt z = -z*1[1/s]";
    let implicit = "eq d/dt x + v*d/dt z = (v - x)*1[1/s]\neq d/dt x - d/dt z = z*1[1/s]";
    for (form, methods) in [(explicit, &METHODS[..]), (implicit, &METHODS[..1])] {
        for &method in methods {
            let mut environment = environment(&moved(form), method);
            environment.reset(Some(0), &ResetOptions::default()).expect("a start");
            assert!(!environment.step(&[0.0]).expect("a step").terminated);
            assert!((value(&environment, "v") - 1.0).abs() < 1e-6, "{method}");
            let step = environment.step(&[7.0]).expect("a step");
            let failure = environment.failure_message();
            assert!(step.terminated && failure.contains("v, has no solution inside of the declared bounds"), "{method}: {failure}");
        }
    }
}

/// v = 1 + u leaves its bounds by a hundredth of their range at a time.
#[test]
fn a_root_that_leaves_its_bounds_in_small_steps_is_followed() {
    let text = moved("eq d/dt x = (v - x)*1[1/s]\neq d/dt z = -z*1[1/s]");
    for method in METHODS {
        let mut environment = environment(&text.replace("in 0..6", "in 0..1.02"), method);
        environment.reset(Some(0), &ResetOptions::default()).expect("a start");
        for u in [0.01, 0.02, 0.03, 0.04] {
            assert!(!environment.step(&[u]).expect("a step").terminated, "{method} at {u}");
            assert!((value(&environment, "v") - 1.0 - u).abs() < 1e-6, "{method} at {u}");
        }
    }
}

fn values_at_the_start<const N: usize>(text: &str, names: [&str; N]) -> [f64; N] {
    let mut environment = environment(text, Method::Auto);
    environment.reset(Some(0), &ResetOptions::default()).expect("a start");
    names.map(|name| value(&environment, name))
}

/// p = 2 T + 1e-6 a with a = 1 is 700 at T = 350 - 5e-7.
#[test]
fn a_condition_determines_the_state_that_moves_it_most() {
    let text = "state a = 1\nstate T = 300\nvar p = 1\neq d/dt a = 0\neq d/dt T = 0\neq p = 2*T + 1e-6*a\ninitial eq p = 700";
    let [a, temperature] = values_at_the_start(text, ["a", "T"]);
    assert!(a == 1.0 && (temperature - 350.0 + 5e-7).abs() < 1e-9, "{a}, {temperature}");
}

/// p^3 + p = 2 a + c/1000 = 10 and q = 2 b - c/1000 = 6 with c = 1: p = 2, a = 4.9995, b = 3.0005.
#[test]
fn two_conditions_leave_a_state_that_hardly_matters() {
    let text = "state c = 1\nstate b = 1\nstate a = 1\nvar p = 1\nvar q = 1\neq d/dt a = 0\neq d/dt b = 0\neq d/dt c = 0\n\
                eq p^3 + p = 2*a + 1e-3*c\neq q = 2*b - 1e-3*c\ninitial eq p = 2\ninitial eq q = 6";
    let [a, b, c] = values_at_the_start(text, ["a", "b", "c"]);
    assert!(c == 1.0 && (a - 4.9995).abs() < 1e-9 && (b - 3.0005).abs() < 1e-9, "{a}, {b}, {c}");
}

/// p = a + b: both move it alike, so that the first one or the one after `free` follows.
#[test]
fn states_that_move_a_condition_alike_are_taken_in_their_order() {
    let text = "state a = 1\nstate b = 2\nvar p = 1\neq d/dt a = 0\neq d/dt b = 0\neq p = a + b\ninitial eq p = 10";
    assert_eq!(values_at_the_start(text, ["a", "b"]), [8.0, 2.0]);
    assert_eq!(values_at_the_start(&format!("{text} free b"), ["a", "b"]), [1.0, 9.0]);
}
