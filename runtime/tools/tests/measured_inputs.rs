//! Disturbances that follow data over time: values against closed forms and SciPy, scenarios, faults with their places.

mod shell;

use shell::{beside, columns, file, name, smpl, status, text};

/// A first-order lag behind a measured temperature, with steps that do not meet the points of the data.
const LAG: &str = "time t : min\ndisturbance T_amb : degC from \"weather.csv\" linear in -50..60\nstate T : degC = 12 in -50..100\n\
                   eq d/dt T = (T_amb - T)/2 [min]\nobserve T, T_amb\nepisode { step = 0.7 [min], max_steps = 12 }\nsolver { rtol = 1e-9 }\n";
/// The same course in other units: 10 degC at 0 min, 30 degC at 4 min and at 6 min.
const WEATHER: &str = "# hourly\nt [s],wind [m/s],T_amb [degF]\n0,1,50\n240,2,86\n360,3,86\n";

/// A model with its data.
fn model(test: &str, source: &str, data: &str) -> std::path::PathBuf {
    let path = file(test, "m.eq", source);
    std::fs::write(beside(&path, "weather.csv"), data).expect("data");
    path
}

fn near(found: &[f64], expected: impl Fn(f64) -> f64, step: f64, tolerance: f64) {
    for (i, found) in found.iter().enumerate() {
        let expected = expected(step * i as f64);
        assert!((found - expected).abs() < tolerance, "step {i}: {found} is not {expected}");
    }
}

/// Closed form of the lag: the response to a ramp of 5 K/min over 4 min, and to the constant behind it.
fn lag(t: f64) -> f64 {
    let ramp = |t: f64| 10.0 + 5.0 * (t - 2.0) + 12.0 * (-t / 2.0).exp();
    if t <= 4.0 { ramp(t) } else { 30.0 + (ramp(4.0) - 30.0) * (-(t - 4.0) / 2.0).exp() }
}

#[test]
fn a_measured_temperature_moves_within_a_step_whatever_the_method() {
    let path = model("ramp", LAG, WEATHER);
    for method in ["ida", "rosenbrock", "explicit", "auto"] {
        let found = columns(&path, &["T", "T_amb", "obs.T_amb"], &["--method", method]);
        near(&found[0], lag, 0.7, 1e-5);
        near(&found[1], |t| 10.0 + 5.0 * t.min(4.0), 0.7, 1e-11);
        assert_eq!(found[1], found[2]);
    }
}

#[test]
fn a_measured_input_of_steps_jumps_at_its_points() {
    let source = "time t : h\ndisturbance q : L/h from \"weather.csv\" step\nstate V : L = 0\neq d/dt V = q\n\
                  episode { step = 1 [h], max_steps = 5 }\n";
    let path = model("steps", source, "t,q [L/min]\n0,1\n1.25,0\n2.5,2\n");
    for method in ["ida", "rosenbrock", "explicit", "auto"] {
        let found = columns(&path, &["V"], &["--method", method]);
        near(&found[0], |t| 60.0 * t.min(1.25) + 120.0 * (t - 2.5).max(0.0), 1.0, 1e-6);
    }
}

#[test]
fn a_cyclic_cubic_course_is_the_interpolant_of_scipy_through_repeated_points() {
    let source = "time t : s\ndisturbance u from \"weather.csv\" cubic outside cyclic\nstate z = 0\neq d/dt z = 0\n\
                  episode { step = 0.5 [s], max_steps = 32 }\n";
    let path = model("cyclic", source, "t [s],u\n0,2\n1,5\n3,1\n4,0\n6,2\n");
    let found = columns(&path, &["u"], &[]);
    near(&found[0], |t| SCIPY_PERIODIC[(2.0 * t) as usize % 12], 0.5, 1e-12);
}

#[test]
fn a_cyclic_course_with_different_ends_jumps_back_at_each_period() {
    let source = "time t : s\ndisturbance u from \"weather.csv\" linear outside cyclic\nstate z = 0\neq d/dt z = u/1 [s]\n\
                  episode { step = 1 [s], max_steps = 9 }\n";
    let path = model("saw", source, "t,u\n1,0\n3.5,5\n");
    // Slope 2 in periods of 2.5 s that begin at 1 s; the integral of a whole period is 6.25.
    let since = |t: f64| (t - 1.0).rem_euclid(2.5);
    let saw = |t: f64| 6.25 * ((t - 1.0) / 2.5).floor() + since(t).powi(2) + 6.25 - since(0.0).powi(2);
    for method in ["ida", "rosenbrock", "explicit", "auto"] {
        let found = columns(&path, &["u", "z"], &["--method", method]);
        near(&found[0], |t| 2.0 * since(t), 1.0, 1e-9);
        near(&found[1], saw, 1.0, 1e-5);
    }
}

#[test]
fn the_end_of_refused_data_is_a_failure_with_the_name_of_the_disturbance() {
    let path = model("refused", &LAG.replace("linear", "linear outside refused"), WEATHER);
    let out = beside(&path, "out.csv");
    let output = smpl(&["simulate", name(&path), "--out", name(&out)]);
    assert!(text(&output.stdout).contains("failed: T_amb"), "{}", text(&output.stdout));
    let rows = std::fs::read_to_string(&out).expect("rows");
    let time: f64 = rows.lines().last().expect("a row").split(',').nth(1).expect("a cell").parse().expect("a time");
    assert!((time - 6.0).abs() < 1e-9, "{time}");
}

#[test]
fn a_scenario_names_other_data_or_a_constant() {
    let path = model("scenario", LAG, WEATHER);
    std::fs::write(beside(&path, "cold.csv"), "t [min],T_amb [degC]\n0,-10\n2,-5\n").expect("data");
    let scenario = |kind: &str, text: &str| std::fs::write(beside(&path, &format!("m.{kind}.yaml")), text).expect("a scenario");
    scenario("cold", "disturbances: {T_amb: {from: cold.csv}}\n");
    scenario("night", "disturbances: {T_amb: {from: cold.csv, reading: step, outside: cyclic}}\n");
    scenario("flat", "disturbances: {T_amb: -3.5}\n");
    scenario("still", "disturbances: false\n");
    let found = |kind: &str| columns(&path, &["T_amb"], &["--scenario", kind]).remove(0);
    near(&found("cold"), |t| (-10.0 + 2.5 * t).min(-5.0), 0.7, 1e-12);
    near(&found("night"), |_| -10.0, 0.7, 1e-12);
    near(&found("flat"), |_| -3.5, 0.7, 1e-12);
    near(&found("still"), |t| 10.0 + 5.0 * t.min(4.0), 0.7, 1e-11);
    for (text_of, message) in [
        ("disturbances: {T_amb: [1, 2]}\n", "follows data over time, not one value a step"),
        ("disturbances: {T_amb: {from: cold.csv, reading: often}}\n", "unknown reading `often`"),
        ("disturbances: {T_amb: {from: cold.csv, outside: never}}\n", "unknown reading outside of the data `never`"),
        ("disturbances: {T_amb: {from: none.csv}}\n", "the file `none.csv` cannot be read"),
        ("disturbances: {T_amb: {from: ../m.eq}}\n", "cannot be read in the folder"),
        ("disturbances: {T_amb: {hold: true}}\n", "`values`, or `from`"),
        ("disturbances: {T_abm: {from: cold.csv}}\n", "T_amb"),
    ] {
        scenario("bad", text_of);
        let output = smpl(&["simulate", name(&path), "--scenario", "bad"]);
        let shown = text(&output.stderr);
        assert!(status(&output) == 1 && shown.contains(message) && shown.contains("m.bad.yaml"), "{text_of}{shown}");
    }
}

#[test]
fn rules_updates_and_starts_read_measured_inputs() {
    let source = "time t : min\ndisturbance u from \"weather.csv\" linear\ndisturbance w = 1 ~ 2*u\nstate x = u\ndiscrete d = 0\n\
                  eq d/dt x = 0\nat start { next d = u }\nlet before : 1 = previous(u)\nlet first : 1 = initial(u)\n\
                  reward r default = previous(u)\nepisode { step = 1 [min], max_steps = 3 }\n";
    let path = model("reads", source, "t,u\n0,3\n3,9\n");
    let found = columns(&path, &["x", "w", "d", "first"], &[]);
    assert_eq!(found[0], [3.0; 4]);
    assert_eq!(found[1], [1.0, 6.0, 10.0, 14.0]);
    assert_eq!(found[2], [0.0, 3.0, 5.0, 7.0]);
    assert_eq!(found[3], [3.0; 4]);
}

#[test]
fn data_of_a_disturbance_are_part_of_the_model_and_of_its_json() {
    let path = model("identity", LAG, WEATHER);
    let (compiled, json) = (beside(&path, "m.smplc"), beside(&path, "other.json"));
    assert_eq!(status(&smpl(&["compile", name(&path), "-o", name(&compiled)])), 0);
    assert_eq!(status(&smpl(&["export", name(&path), "--to", "json", "-o", name(&json)])), 0);
    near(&columns(&compiled, &["T"], &[])[0], lag, 0.7, 1e-5);
    std::fs::write(beside(&path, "weather.csv"), WEATHER.replace("240,2", "250,2")).expect("data");
    near(&columns(&json, &["T"], &[])[0], lag, 0.7, 1e-5);
    let output = smpl(&["simulate", name(&compiled)]);
    assert!(status(&output) == 1 && text(&output.stderr).contains("changed"), "{}", text(&output.stderr));
}

#[test]
fn faults_of_measured_inputs_have_their_place_and_a_way_out() {
    for (line, data, message) in [
        ("param p from \"weather.csv\" linear", WEATHER, "`p` is not a disturbance, and only disturbances follow a file"),
        ("disturbance wind : m/s from \"weather.csv\" linear = 3", WEATHER, "has no other value"),
        ("disturbance wind[i in 1..2] : m/s from \"weather.csv\" linear", WEATHER, "has no indices"),
        ("disturbance wnid : m/s from \"weather.csv\" linear", WEATHER, "did you mean `wind`?"),
        ("disturbance wind from \"weather.csv\" linear", WEATHER, "velocity"),
        ("disturbance wind : m/s from \"weather.csv\" step outside linear", WEATHER, "has no slope outside"),
        ("disturbance wind : m/s from \"weather.csv\" linear outside cyclic", "t,wind\n0,1\n", "has one point"),
        ("disturbance wind : m/s from \"weather.csv\" linear", "t [K],wind\n0,1\n", "the argument is time"),
        ("disturbance wind : m/s from \"weather.csv\" linear", "t [h],wind\n0,1\n0,1\n", "must increase"),
        ("disturbance wind : m/s from \"other.csv\" linear", WEATHER, "`other.csv` cannot be read"),
        (
            "disturbance wind : m/s from \"weather.csv\" linear\ntest \"calm\" { wind = 0 for 1 [s]; expect z > -1 }",
            WEATHER,
            "{from: other.csv}",
        ),
    ] {
        let path = model("faults", &format!("{line}\nstate z = 0\neq d/dt z = 0\n"), data);
        let output = smpl(&["check", name(&path)]);
        let shown = text(&output.stderr);
        assert!(status(&output) == 1 && shown.contains(message), "{line}\n{shown}");
        assert_eq!(shown.matches('×').count(), 1, "one cause is one diagnostic: {shown}");
    }
    let path = model("bounds", &LAG.replace("in -50..60", "in -50..20"), WEATHER);
    let shown = text(&smpl(&["check", name(&path)]).stderr);
    assert!(shown.contains("the data of `T_amb` leave its bounds -50..20: 30.0") && shown.contains(" at 4 min"), "{shown}");
}

#[test]
fn measured_inputs_are_not_replaced_as_parameters_or_sequences() {
    let path = model("replaced", LAG, WEATHER);
    let steps = file("replaced", "d.csv", "T_amb\n1\n2\n");
    for (arguments, message) in [
        (["--set", "T_amb=3"], "`T_amb` is a disturbance that follows a file, not a parameter or setting"),
        (["--disturbances", name(&steps)], "`T_amb` follows data over time; a scenario names another file"),
    ] {
        let output = smpl(&[&["simulate", name(&path)], &arguments[..]].concat());
        let shown = text(&output.stderr);
        assert!(status(&output) != 0 && shown.contains(message), "{shown}");
    }
}

/// `PchipInterpolator` of SciPy 1.17.1 through (0, 2), (1, 5), (3, 1), (4, 0), (6, 2) and the same points a period before
/// and behind, at 0, 0.5, ..., 5.5.
const SCIPY_PERIODIC: [f64; 12] = [
    2.0,
    3.6985294117647056,
    5.0,
    4.495535714285714,
    3.321428571428571,
    1.9866071428571428,
    1.0,
    0.3392857142857143,
    0.0,
    0.1636029411764706,
    0.6029411764705883,
    1.2408088235294117,
];
