//! Parameters that resets give: elements, arrays, members, draws, and values that are refused.

use std::collections::BTreeMap;
use std::path::Path;

use smpl_runtime::environment::{Environment, ResetOptions};
use smpl_runtime::load::{LoadOptions, load_text};
use smpl_runtime::scenario::Value;
use smpl_runtime::setup::Setup;

const MODEL: &str = "model M\ntime t : 1\nset s = 1..3\nparam n = 2\nset r = 1..n\nparam c[s] : m = 1 in 0..5\n\
    param k = 1 ~ uniform(0.5, 1.5)\nparam twice = 2*k in 0..4\n\
    component Tank { param V : m = 1 in 1..2 }\nuse Tank as A(V = 1.5 [m])\n\
    state x[r] = 0\neq d/dt x[i] = k for i in r\nobserve x[1] in 0..1e3\nepisode { step = 1, max_steps = 10 }\n";

fn environment(settings: &[(&str, Value)]) -> Environment {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    let options = LoadOptions { settings, ..LoadOptions::default() };
    let loaded = load_text(Path::new("m.eq"), MODEL.to_owned(), &options).expect("compiles");
    let setup = Setup::new(loaded.model, loaded.options, Some(loaded.sources)).expect("a setup");
    Environment::new(setup).expect("an environment")
}

fn given(parameters: &[(&str, f64)]) -> ResetOptions {
    let parameters: BTreeMap<String, f64> = parameters.iter().map(|(name, x)| ((*name).to_owned(), *x)).collect();
    ResetOptions { parameters, ..ResetOptions::default() }
}

fn values(environment: &Environment, names: &[&str]) -> Vec<f64> {
    let at = |name: &&str| environment.catalogue().parameters.find(name).expect("a parameter").at;
    names.iter().map(|name| environment.parameters()[at(name)]).collect()
}

const C: [&str; 3] = ["c[1]", "c[2]", "c[3]"];

#[test]
fn a_reset_overrides_settings_element_by_element() {
    let mut env = environment(&[("c", Value::List(vec![2.0, 3.0, 4.0])), ("c[3]", Value::Number(5.0))]);
    for (parameters, expected) in [
        (given(&[]), [2.0, 3.0, 5.0]),
        (given(&[("c[2]", 0.0)]), [2.0, 0.0, 5.0]),
        (given(&[("c", 1.5)]), [1.5, 1.5, 1.5]),
        (given(&[("c", 1.5), ("c[1]", 0.5)]), [0.5, 1.5, 1.5]),
        (given(&[("c[ 3 ]", 0.25), ("c", 0.75)]), [0.75, 0.75, 0.25]),
        (given(&[]), [2.0, 3.0, 5.0]),
    ] {
        env.reset(Some(1), &parameters).expect("a start");
        assert_eq!(values(&env, &C), expected, "{parameters:?}");
    }
}

#[test]
fn a_reset_sets_a_parameter_of_a_member() {
    let mut env = environment(&[]);
    env.reset(Some(1), &given(&[("A.V", 2.0)])).expect("a start");
    assert_eq!(values(&env, &["A.V"]), [2.0]);
    env.reset(Some(1), &given(&[])).expect("a start");
    assert_eq!(values(&env, &["A.V"]), [1.5]);
}

#[test]
fn a_given_value_of_a_drawn_parameter_holds_and_what_follows_from_it_is_computed() {
    let mut env = environment(&[]);
    let mut drawn = Vec::new();
    for seed in 0..4 {
        env.reset(Some(seed), &given(&[])).expect("a start");
        drawn.push(values(&env, &["k"])[0]);
        env.reset(Some(seed), &given(&[("k", 0.125)])).expect("a start");
        assert_eq!(values(&env, &["k", "twice"]), [0.125, 0.25]);
    }
    assert!(drawn.iter().all(|k| (0.5..=1.5).contains(k)) && drawn.windows(2).all(|pair| pair[0] != pair[1]), "{drawn:?}");
}

#[test]
fn values_that_a_parameter_cannot_have_are_refused_by_one_wording() {
    let mut env = environment(&[]);
    for (parameters, message) in [
        (("c[2]", 6.0), "parameter `c[2]` = 6 is outside its bounds 0..5 m"),
        (("c", -1.0), "parameter `c[1]` = -1 is outside its bounds 0..5 m"),
        (("A.V", 3.0), "parameter `A.V` = 3 is outside its bounds 1..2 m"),
        (("k", 3.0), "parameter `twice` = 6 is outside its bounds 0..4; it was computed or drawn"),
        (("c[1]", f64::NAN), "parameter `c[1]` must be finite"),
        (("n", 3.0), "`n` shapes the model, compiled with 2"),
        (("c[4]", 1.0), "unknown parameter `c[4]`; did you mean"),
        (("A.W", 1.0), "unknown parameter `A.W`; did you mean `A.V`?"),
    ] {
        let error = env.reset(Some(1), &given(&[parameters])).expect_err("refused").to_string();
        assert!(error.starts_with(message), "{error}");
    }
    // An overridden value has no effect.
    env.reset(Some(1), &given(&[("c", 9.0), ("c[1]", 1.0), ("c[2]", 1.0), ("c[3]", 1.0)])).expect("a start");
    assert_eq!(values(&env, &C), [1.0; 3]);
}
