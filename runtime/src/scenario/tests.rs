//! Scenarios and what is wrong with them.

use super::*;

fn parse(text: &str) -> Result<Scenario, (String, usize, usize, Option<String>)> {
    let mut sources = SourceMap::new();
    let file = sources.add("s.yaml", text);
    Scenario::parse(&sources, file).map_err(|d| {
        let at = sources.locate(d.primary.span);
        (d.message.clone(), at.line, at.column, d.help.clone())
    })
}

#[test]
fn all_keys_of_the_contract_are_read() {
    let text = "parameters: {k_0: 7.2e10}\nsettings:\n  paa_schedule: minutes\n  disturbances: false\nvariants: [a, b=c, {d: e}]\ngrid: {n_z: 30}\ninitial: {h: 0.5}\n\
                disturbances: {z: [0.1, 0.2]}\nreward: r\nobservation: full\nnoise: {T: 0.1}\nsolver: {rtol: 1.0e-6}\nmax_steps: 101\n";
    let scenario = parse(text).expect("valid");
    assert_eq!(scenario.parameters["k_0"], Value::Number(7.2e10));
    assert_eq!(scenario.settings["disturbances"], Value::Flag(false));
    let variants: Vec<_> = scenario.variants.iter().map(|v| (v.name.as_str(), v.option.as_deref())).collect();
    assert_eq!(variants, [("a", None), ("b", Some("c")), ("d", Some("e"))]);
    assert_eq!((scenario.grid["n_z"], scenario.max_steps, scenario.solver.rtol), (30, Some(101), Some(1e-6)));
}

#[test]
fn an_unknown_key_is_refused_at_its_place_with_a_suggestion() {
    let (message, line, column, help) = parse("# scenario\nmax_steps: 3\nparamters: {a: 1}\n").unwrap_err();
    assert_eq!((message.as_str(), line, column), ("unknown key `paramters`", 3, 1));
    assert_eq!(help.as_deref(), Some("did you mean `parameters`?"));
    let (message, line, column, _) = parse("solver:\n  rtoll: 1\n").unwrap_err();
    assert_eq!((message.as_str(), line, column), ("unknown key `rtoll` in `solver`", 2, 3));
}

#[test]
fn what_is_given_twice_is_refused_at_the_second_place() {
    for (text, line, column) in [
        ("parameters:\n  k: 1\n  q: 3\n  k: 2\n", 4, 3),
        ("noise: {T: 0.1, T: 0.2}\n", 1, 17),
        ("# k: 0\nsolver: {rtol: 1.0e-6, rtol: 1.0e-3}\n", 2, 24),
        ("disturbances:\n  z: 1\n  z: [1, 2]\n", 3, 3),
        ("max_steps: 3\nmax_steps: 4\n", 2, 1),
    ] {
        let (message, ..) = parse(text).map(|_| ()).unwrap_err();
        let found = parse(text).map(|_| ()).unwrap_err();
        assert!(message.contains("twice"), "{message}");
        assert_eq!((found.1, found.2), (line, column), "{text}");
    }
}

#[test]
fn numbers_that_nothing_can_mean_are_refused_where_they_stand() {
    for (text, name, line, column) in [
        ("noise: true\nsolver: {rtol: 1.0e10}\n", "rtol", 2, 10),
        ("solver:\n  rtol: 1.0e-20\n", "rtol", 2, 3),
        ("solver:\n  atol_factor: -1\n", "atol_factor", 2, 3),
        ("solver: {max_order: 99}\n", "max_order", 1, 10),
        ("max_steps: 5\nsolver: {max_steps: 0}\n", "max_steps", 2, 10),
        ("solver: {max_step: 0}\n", "max_step", 1, 10),
        ("solver: {max_step: -1}\n", "max_step", 1, 10),
        ("max_steps: 0\n", "max_steps", 1, 1),
        ("parameters: {T: 1}\nnoise:\n  T: -0.1\n", "T", 3, 3),
        ("disturbances: {z: [.nan]}\n", "z", 1, 16),
        ("disturbances: {z: []}\n", "z", 1, 16),
        ("initial: {h: .inf}\n", "h", 1, 11),
    ] {
        let (message, found_line, found_column, _) = parse(text).map(|_| ()).unwrap_err();
        assert!(message.contains(&format!("`{name}`")), "{message}");
        assert_eq!((found_line, found_column), (line, column), "{text}: {message}");
    }
}

#[test]
fn a_disturbance_that_is_to_hold_says_so() {
    let scenario = parse("disturbances: {z: {values: [1, 2], hold: true}, w: 3}\n").expect("valid");
    let Some(Disturbances::Values(values)) = scenario.disturbances else { panic!("values") };
    assert_eq!(values["z"], Recorded::Sequence { values: vec![1.0, 2.0], hold: true });
    assert_eq!(values["w"], Recorded::Constant(3.0));
}

#[test]
fn a_value_of_the_wrong_kind_is_refused() {
    for (text, line) in [("max_steps: 1\nnoise: [1]\n", 2), ("grid: {}\ndisturbances:\n  z: many\n", 3), ("parameters:\n  k: {a: 1}\n", 2)]
    {
        let (message, found, ..) = parse(text).map(|_| ()).unwrap_err();
        assert!(message.contains(" is ") && message.contains(", not ") && found == line, "{text}: {found}: {message}");
    }

    for (text, expected) in [
        ("solver: 3\n", "`solver` is a mapping from solver settings to values, not 3"),
        ("solver: [1]\n", "`solver` is a mapping from solver settings to values, not a list"),
        ("solver: {rtol: small}\n", "`solver.rtol` is a number, not \"small\""),
        ("solver: {rtol: {a: 1}}\n", "`solver.rtol` is a number, not a mapping"),
        ("solver: {max_events: 0}\n", "`solver.max_events` is a whole number from 1 on, not 0"),
        ("solver: {max_order: 1.5}\n", "`solver.max_order` is a whole number that is not negative, not 1.5"),
        ("solver: {algebraic_error_control: 1}\n", "`solver.algebraic_error_control` is true or false, not 1"),
        ("solver: {linear_solver: [klu]}\n", "`solver.linear_solver` is a text, not a list"),
        ("solver: {linear_solver: foo}\n", "`solver.linear_solver` is auto, dense, block or klu, not foo"),
        ("solver: {method: 3}\n", "`solver.method` is ida, rosenbrock, explicit or auto, not 3"),
        ("max_steps: -4\n", "`max_steps` is a whole number that is not negative, not -4"),
        ("max_steps: many\n", "`max_steps` is a whole number that is not negative, not \"many\""),
        ("grid: {n: few}\n", "`grid.n` is a whole number that is not negative, not \"few\""),
        ("grid: 3\n", "`grid` is a mapping from names to values, not 3"),
        ("variants: {a: b}\n", "`variants` is a list, not a mapping"),
        ("reward: [r]\n", "`reward` is a text, not a list"),
        ("parameters: {k: [a]}\n", "`parameters.k[0]` is a number, not \"a\""),
        ("disturbances: {z: {values: 3}}\n", "`disturbances.z.values` is a list, not 3"),
        ("[1, 2]\n", "a scenario is a mapping of keys with values, not a list"),
        ("reactor\n", "a scenario is a mapping of keys with values, not \"reactor\""),
    ] {
        let (message, ..) = parse(text).map(|_| ()).unwrap_err();
        assert_eq!(message, expected, "{text}");
    }
    let (message, _, _, help) = parse("disturbances: {z: {valus: 3}}\n").map(|_| ()).unwrap_err();
    assert_eq!((message.as_str(), help.as_deref()), ("unknown key `valus` in a disturbance", Some("did you mean `values`?")));
    assert!(parse("max_steps: many\n").is_err());
    assert!(parse("parameters: [1, 2]\n").is_err());
    assert!(parse(": : :\n  - x\n y").is_err());
}

/// The reader would take minutes.
#[test]
fn a_hundred_thousand_brackets_are_refused_at_the_first_too_many() {
    for open in ["[", "{a: "] {
        let text = format!("max_steps: 3\nparameters: {}", open.repeat(100_000));
        let (message, line, column, _) = parse(&text).unwrap_err();
        assert_eq!(message, "brackets inside one another, more than 100 deep");
        assert_eq!((line, column), (2, "parameters: ".len() + 100 * open.len() + 1));
    }
    assert!(parse(&format!("parameters: {{{}}}", (0..1000).map(|i| format!("p{i}: [[1]], ")).collect::<String>())).is_err());
}

#[test]
fn an_empty_file_is_the_default_scenario() {
    assert_eq!(parse("# nothing\n\n").map(|s| s.variants.len()), Ok(0));
}

#[test]
fn a_name_stands_beside_the_model_and_a_path_for_itself() {
    assert_eq!(find_file(Path::new("models/reactor.eq"), "legacy"), Path::new("models/reactor.legacy.yaml"));
    assert_eq!(find_file(Path::new("models/reactor.eq"), "my/s.yaml"), Path::new("my/s.yaml"));
}
