//! `smpl test`: tests in the text of a model.

mod shell;

use shell::{file, name, smpl, status, text};

/// A tank whose level falls as `(sqrt(h) - k/(2 A) t)^2` without inflow.
const TANK: &str = "\
time t : min
param A : m^2 = 0.5 in 0.01..100
param k : m^2.5/min = 0.1 in 0..1
action q : m^3/min = 0.1 in 0..0.3
disturbance w : m^3/min = 0 ~ normal(0, 0.01) in -1..1
state h : m = 1 in 0..2
eq d/dt h = (q - k*sqrt(h) + w) / A
observe h
reward r default = -h / 1 [m]
fail overflow when outside bounds(h)
success low when h < 0.05 [m]
episode { step = 1 [min], max_steps = 5, error_reward = -100 }
";

fn run(tests: &str, more: &[&str]) -> (i32, String, String) {
    let path = file("test_blocks", "tank.eq", format!("{TANK}{tests}"));
    let output = smpl(&[&["test", name(&path)], more].concat());
    (status(&output), text(&output.stdout).to_owned(), text(&output.stderr).to_owned())
}

#[test]
fn expectations_in_order_see_the_state_of_their_time() {
    // Closed form: sqrt(h) falls by 0.1 a minute from 1.
    let (status, out, _) = run(
        "test \"drains\" {\n  start nominal\n  w = 0\n  q = 0\n  expect h within 0 of 1\n  steps 2\n  expect h within 1e-7 of 0.64\n  \
         for 60 [s]\n  expect h within 1e-7 of 49 [cm]\n  expect h < 0.5 [m]\n}\n",
        &[],
    );
    assert_eq!(status, 0, "{out}");
    assert!(out.contains("ok   ") && out.contains("drains (") && out.ends_with("1 test, 1 passed, 0 failed\n"), "{out}");
}

#[test]
fn parameters_states_and_disturbances_of_a_test_are_those_of_the_run() {
    // Closed form: without an outlet the level rises by (q + w)/A a minute.
    let tests = "test \"rises\" { start nominal; A = 2; k = 0; h = 0.5; q = 0.2 [m^3/min]; w = 0.1; steps 1; expect h within 1e-9 of 0.65; \
                 w = -0.2 for 2 [min]; expect h within 1e-9 of 0.65 }\n";
    let (status, out, _) = run(tests, &[]);
    assert_eq!(status, 0, "{out}");
}

#[test]
fn a_test_of_more_steps_than_an_episode_moves_the_limit() {
    let (status, out, _) = run("test \"rests\" { start nominal; w = 0; expect steady; steps 20; expect h within 1e-6 of 1 }\n", &[]);
    assert_eq!(status, 0, "{out}");
}

#[test]
fn an_expectation_that_does_not_hold_shows_what_was_found() {
    let tests = "test \"wrong\" { start nominal; w = 0; k = 0; q = 0.3; steps 1; expect h within 1e-3 of 1.7; expect h > 165 [cm] }\n";
    let (status, out, _) = run(tests, &[]);
    assert_eq!(status, 1);
    assert!(out.contains("FAIL ") && out.contains("1 test, 0 passed, 1 failed"), "{out}");
    assert!(out.contains("line 13: `expect h within 1e-3 of 1.7`: found 1.6 [m], expected 1.7 [m], 0.1 [m] apart at t = 1 [min]"), "{out}");
    assert!(out.contains("`expect h > 165 [cm]`: found 1.6 [m] on the left and 1.65 [m] on the right at t = 1 [min]"), "{out}");
}

#[test]
fn ends_of_episodes_are_expected_or_faults() {
    let tests = "\
test \"a\" { start nominal; w = 0; k = 0; q = 0.3 for 5 [min]; expect failure overflow }
test \"b\" { start nominal; w = 0; h = 0.2; q = 0 for 5 [min]; expect success low }
test \"c\" { start nominal; w = 0; k = 0; q = 0.3 for 5 [min]; expect h > 0 }
test \"d\" { start nominal; w = 0; h = 0.2; q = 0 for 5 [min]; expect failure }
test \"e\" { start nominal; w = 0; q = 0.5 for 1 [min]; expect failure action_box }
";
    let (status, out, _) = run(tests, &[]);
    assert_eq!(status, 1);
    let lines: Vec<&str> = out.lines().filter(|line| !line.starts_with(' ')).map(|line| &line[..4]).collect();
    assert_eq!(lines[..5], ["ok  ", "ok  ", "FAIL", "FAIL", "ok  "], "{out}");
    assert!(out.contains("the episode ended after 2 steps, 3 before the last one of the test: the failure overflow"), "{out}");
    assert!(out.contains("`expect failure`: found the success low at t = 3 [min]"), "{out}");
}

#[test]
fn faults_of_tests_are_placed_and_status_1() {
    for (tests, code, message) in [
        ("test \"a\" { steps 3 }\n", "E0606", "expects nothing"),
        ("test \"a\" { }\n", "E0606", "expects nothing"),
        ("test \"a\" { start hot; expect h > 0 }\n", "E0606", "unknown start `hot`"),
        ("test \"a\" { steps 2; start nominal; expect h > 0 }\n", "E0606", "`start` after steps were taken"),
        ("test \"a\" { steps 2; h = 1; expect h > 0 }\n", "E0606", "`h` is set after steps were taken"),
        ("test \"a\" { steps 0; expect h > 0 }\n", "E0606", "a run of 0 steps"),
        ("test \"a\" { for 90 [s]; expect h > 0 }\n", "E0603", "not a multiple of the step"),
        ("test \"a\" { step 2; expect h > 0 }\n", "E0107", "`step` begins no statement of a test"),
        ("test \"a\" { param z = 2; expect h > 0 }\n", "E0107", "`param` does not belong in a test"),
        ("expect h > 0\n", "E0107", "`expect` outside of a test"),
        ("test \"a\" { expect h }\n", "E0204", "a condition is needed here"),
        ("test \"a\" { expect h within 1 [s] of 2 }\n", "E0302", "the tolerance is length"),
        ("test \"a\" { expect h within 1 of 2 [K] }\n", "E0302", "the expected value is length"),
        ("test \"a\" { expect failure overflw }\n", "E0201", "unknown failure `overflw`"),
        ("test \"a\" { expect success }\ntest \"a\" { expect success }\n", "E0202", "two tests are called `a`"),
        ("test \"a\" { hh = 1; expect h > 0 }\n", "E0201", "unknown name `hh`"),
        ("test \"a\" { q = h * 1 [m^2/min]; expect h > 0 }\n", "E0504", "must be known when the model is compiled"),
        ("test \"a\" { expect steady 3 }\n", "E0106", "expected"),
        ("variant v { test \"a\" { expect h > 0 } }\ntest \"b\" { variant v; expect h > 0 }\n", "E0606", "is inside of another block"),
        ("test \"a\" { scenario nowhere; expect h > 0 }\n", "error", "unknown scenario `nowhere`"),
    ] {
        let (status, out, err) = run(tests, &[]);
        assert_eq!(status, 1, "{tests}{out}{err}");
        assert!(err.contains(code) && err.contains(message), "{tests}{err}");
    }
}

#[test]
fn check_finds_faults_of_tests() {
    let path = file("test_blocks_checked", "tank.eq", format!("{TANK}test \"a\" {{ expect h within 1 [s] of 2 }}\n"));
    let output = smpl(&["check", name(&path)]);
    assert!(status(&output) == 1 && text(&output.stderr).contains("the tolerance is length"));
}

#[test]
fn a_filter_selects_tests_and_results_are_written_for_other_tools() {
    let tests = "test \"one <1>\" { start nominal; expect h > 0 }\ntest \"two\" { start nominal; expect h > 9 [m] }\n";
    let (status_one, out, _) = run(tests, &["--filter", "one"]);
    assert!(status_one == 0 && out.contains("1 test, 1 passed"), "{out}");
    let path = file("test_blocks_junit", "tank.eq", format!("{TANK}{tests}"));
    let xml = path.with_file_name("out.xml");
    assert_eq!(status(&smpl(&["test", name(&path), "--junit", name(&xml)])), 1);
    let written = std::fs::read_to_string(&xml).expect("the results");
    assert!(written.contains("tests=\"2\" failures=\"1\" errors=\"0\"") && written.contains("name=\"one &lt;1&gt;\""), "{written}");
    assert!(written.contains("<failure message=\"line 14: `expect h &gt; 9 [m]`"), "{written}");
}

#[test]
fn variants_and_scenarios_of_a_test_are_compiled_for_it() {
    let tests = "variant leaky { param leak : m^3/min = 0.2; eq d/dt h = (q - leak) / A }\n\
                 test \"leaks\" { variant leaky; start nominal; leak = 0.3; steps 1; expect h within 1e-9 of 0.6 }\n\
                 test \"holds\" { scenario wide; start nominal; w = 0; k = 0; q = 0 for 1 [min]; expect A within 0 of 4; expect h within 1e-12 of 1 }\n";
    let path = file("test_blocks_variants", "tank.eq", format!("{TANK}{tests}"));
    std::fs::write(path.with_file_name("tank.wide.yaml"), "parameters: {A: 4}\n").expect("a scenario");
    let output = smpl(&["test", name(&path)]);
    assert_eq!(status(&output), 0, "{}{}", text(&output.stdout), text(&output.stderr));
}

#[test]
fn tests_of_imported_files_are_not_run() {
    let path = file("test_blocks_imports", "tank.eq", format!("use \"part.eq\"\n{TANK}test \"own\" {{ start nominal; expect h > 0 }}\n"));
    std::fs::write(path.with_file_name("part.eq"), "def twice(x) = 2*x\ntest \"other\" { expect 1 > 2 }\n").expect("a part");
    let output = smpl(&["test", name(&path)]);
    assert!(status(&output) == 0 && text(&output.stdout).contains("1 test, 1 passed"), "{}{}", text(&output.stdout), text(&output.stderr));
}

#[test]
fn coverage_lists_what_the_tests_reach_and_what_not() {
    let more = "variant wide \"a wide tank\" { param A : m^2 = 5 }\nvariant narrow \"a narrow tank\" { param A : m^2 = 0.1 }\n\
                test \"overflows\" { start nominal; w = 0; q = 0.3; k = 0; steps 5; expect failure overflow }\n\
                test \"wide\" { variant wide; start nominal; w = 0; steps 1; expect h > 0.5 [m] }\n";
    let (status, out, error) = run(more, &["--coverage"]);
    assert_eq!(status, 0, "{out}{error}");
    let found: Vec<&str> = out.lines().skip_while(|line| !line.contains("reached by its tests")).skip(1).map(str::trim).collect();
    assert_eq!(
        found,
        ["failures  1 of 1", "successes 0 of 1, not reached: low", "variants  1 of 2, not reached: narrow", "2 tests, 2 passed, 0 failed"]
    );
}

#[test]
fn coverage_counts_events_phases_and_switches_of_each_compilation() {
    let text = "time t : s\naction u = 0 in -1..1\nstate x = 0 in -9..9\neq d/dt x = (if x < 0.5 then 1 else 0.5)/1 [s] + u/1 [s]\n\
                discrete n_hit = 0 in 0..9\nevent hit when x > 0.7\nevent never when x < -5\nat hit { next n_hit = n_hit + 1 }\n\
                at never { next n_hit = 0 }\nobserve x\nreward r = x\nepisode { step = 0.2 [s], max_steps = 20 }\n\
                test \"short\" { start nominal; steps 2; expect x > 0 }\n";
    let path = file("test_blocks", "switch.eq", text);
    let output = smpl(&["test", name(&path), "--coverage"]);
    let out = self::text(&output.stdout);
    assert!(out.contains("events    0 of 2, not reached: hit, never") && out.contains("switches  0 of 1 seen on both sides"), "{out}");
    let path = file("test_blocks", "switch.eq", text.replace("steps 2", "steps 6"));
    let output = smpl(&["test", name(&path), "--coverage"]);
    let out = self::text(&output.stdout);
    assert!(out.contains("events    1 of 2, not reached: never") && out.contains("switches  1 of 1"), "{out}");
}
