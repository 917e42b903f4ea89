//! Regular instants and controllers: several rates inside of a step, by every method and in every form of a model.

mod shell;

use shell::{beside, file, name, smpl, status, text};

const SOURCE: &str = include_str!("regular_instants.eq");

/// Runs the tests of a text.
fn passes(test: &str, source: &str) {
    let path = file(test, "m.eq", source);
    let output = smpl(&["test", name(&path)]);
    assert_eq!(status(&output), 0, "{}{}", text(&output.stdout), text(&output.stderr));
}

#[test]
fn regular_instants_and_controllers_have_the_values_of_closed_forms_by_every_method() {
    for method in ["ida", "rosenbrock", "explicit", "auto"] {
        passes(&format!("regular_{method}"), &SOURCE.replace("rtol = 1e-10", &format!("rtol = 1e-10, method = {method}")));
    }
}

#[test]
fn regular_instants_do_not_depend_on_the_step() {
    // The last values are those of 60 s; the set-point changes at 30 s.
    for (step, first) in [("30 [s]", 1), ("1.5 [s]", 20), ("0.7 [s]", 0), ("3 [s]", 10)] {
        let tests = SOURCE.find("# Number of instants").expect("tests");
        let head = SOURCE[..tests].replace("step = 10 [s], max_steps = 100", &format!("step = {step}, max_steps = 1000"));
        let test = match first {
            0 => "test \"t\" { start nominal; steps 100; expect a within 0 of 24; expect b within 0 of 1203 }\n".to_owned(),
            n => format!("test \"t\" {{ start nominal; steps {n}; r = 2; steps {n}; expect y within 1e-7 of 1.9985465586501348 }}\n"),
        };
        passes(&format!("regular_step_{n}", n = first), &(head + &test));
    }
}

#[test]
fn more_regular_instants_than_the_limit_of_events_are_no_failure() {
    let source = "time t : s\nstate x = 0\ndiscrete a = 0\neq d/dt x = a / 1 [s]\nat every 1 [s] { next a = a + 1 }\naction u = 0 in 0..1\n\
                  observe x in 0..1e9\nreward r default = x\nepisode { step = 5000 [s], max_steps = 2 }\n\
                  test \"many\" { start nominal; steps 1; expect a within 0 of 5000; expect x within 1e-3 of 12502500 }\n";
    passes("regular_many", source);
}

#[test]
fn an_instant_happens_once_however_short_the_steps_are() {
    for (every, step) in [("1 [h]", "1e-3 [s]"), ("7 [d]", "0.5 [s]"), ("1 [d]", "0.05 [s]")] {
        let source = format!(
            "time t : s\nstate x = 0\ndiscrete m = 0\neq d/dt x = 1 [1/s]\nat every {every} {{ next m = m + 1 }}\n\
             observe x in 0..99\nepisode {{ step = {step}, max_steps = 100 }}\n\
             test \"once\" {{ start nominal; steps 20; expect m within 0 of 1 }}\n"
        );
        passes("regular_once", &source);
    }
}

#[test]
fn phases_that_end_at_an_instant_precede_it_by_any_step() {
    // Instants in `a` at 0 and 1 s, in `b` at 2 s, in `a` at 3 s: 1 + 1 + 100 + 1 is 103.
    // The event at 3 s precedes the fourth instant.
    for (step, steps) in [("0.2", 16), ("0.25", 13), ("0.3", 11), ("0.4", 8), ("0.5", 7), ("0.6", 6), ("0.7", 5), ("3.9", 1)] {
        let source = format!(
            "time t : s\nstate x = 0\ndiscrete m = 0\ndiscrete c = 0\ndiscrete k = 0\neq d/dt x = 1 [1/s]\n\
             phase a for 2 [s] then b\nphase b for 1 [s] then a\n\
             at every 1 [s] {{ next m = m + (if phase == a then 1 else 100) ; next c = c + 1 }}\n\
             event e when x >= 3\nat e {{ next k = c }}\n\
             observe x in 0..99\nepisode {{ step = {step} [s], max_steps = 1000 }}\n\
             test \"order\" {{ start nominal; steps {steps}; expect m within 0 of 103; expect k within 0 of 3 }}\n"
        );
        passes("regular_order", &source);
    }
}

#[test]
fn a_model_as_json_has_its_regular_instants() {
    let path = file("regular_json", "m.eq", SOURCE);
    let json = beside(&path, "m.json");
    assert_eq!(status(&smpl(&["export", name(&path), "--to", "json", "-o", name(&json)])), 0);
    let run = |path| text(&smpl(&["simulate", path, "--steps", "7", "--out", "-"]).stdout).to_owned();
    let tables = [&path, &json].map(|path| {
        let out = beside(path, "out.csv");
        assert_eq!(status(&smpl(&["simulate", name(path), "--steps", "7", "--out", name(&out)])), 0, "{}", run(name(path)));
        std::fs::read_to_string(&out).expect("rows")
    });
    assert_eq!(tables[0], tables[1]);
}
