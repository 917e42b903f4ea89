//! Events: when they fire, what they see, how they end; and values that are not finite.

use std::collections::BTreeMap;
use std::path::Path;

use smpl_runtime::environment::{Environment, ResetError, ResetOptions, StateInput, StepResult};
use smpl_runtime::load::{LoadOptions, load_text};
use smpl_runtime::setup::Setup;
use smpl_runtime::solver::Method;

/// The method: this module's name.
fn method() -> Method {
    module_path!().rsplit("::").next().and_then(Method::from_name).expect("the name of a method")
}

/// An environment of a model's text, at its start.
struct Running(Environment);

impl Running {
    fn unstarted(text: &str) -> Environment {
        let loaded = load_text(Path::new("m.eq"), format!("model M\n{text}\n"), &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        let mut options = loaded.options;
        options.solver.method = Some(method());
        let setup = Setup::new(loaded.model, options, Some(loaded.sources)).expect("a setup");
        Environment::new(setup).expect("the solver takes it")
    }

    fn new(text: &str) -> Self {
        let mut environment = Self::unstarted(text);
        environment.reset(Some(0), &ResetOptions::default()).expect("a start");
        Self(environment)
    }

    fn step(&mut self) -> StepResult {
        self.step_with(&[])
    }

    fn step_with(&mut self, action: &[f64]) -> StepResult {
        self.0.step(action).expect("a step")
    }

    fn discrete(&self, name: &str) -> f64 {
        self.0.discretes()[self.0.catalogue().discretes.find(name).expect("there").at]
    }

    fn state(&self, name: &str) -> f64 {
        self.0.unknowns()[self.0.catalogue().states.find(name).expect("there").at]
    }
}

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found}, expected {expected}");
}

const TANK: &str = "time t : h\nparam low : m = 0.3\nparam high : m = 0.8\nparam start : m = 0.2\n\
    state h : m = start in -10..10\ndiscrete pump = 0\ndiscrete starts = 0\neq d/dt h = (pump*0.5 - 0.2)*1 [m/h]\n\
    event is_low when h <= low\nevent is_high when h >= high\nat is_low { next pump = 1 ; next starts = starts + 1 }\n\
    at is_high { next pump = 0 }\nobserve h in -10..10\nepisode { step = 0.5 [h], max_steps = 40 }";

fn tank(parameters: &[(&str, f64)]) -> Running {
    let mut environment = Running::unstarted(TANK);
    let parameters = parameters.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    environment.reset(Some(0), &ResetOptions { parameters, ..ResetOptions::default() }).expect("a start");
    Running(environment)
}

#[test]
fn a_tank_that_starts_below_its_low_level_is_filled() {
    let mut tank = tank(&[]);
    // Up at 0.3 from 0.2 to 0.8 in 2 h, down at 0.2 in 2.5 h, up again in 5/3 h.
    for (hours, level, pump) in
        [(1.0, 0.5, 1.0), (3.0, 0.6, 0.0), (4.0, 0.4, 0.0), (5.0, 0.45, 1.0), (6.0, 0.75, 1.0), (7.0, 0.8 - 0.2 * 5.0 / 6.0, 0.0)]
    {
        while tank.0.time() < hours {
            assert_eq!(tank.step().failure, None);
        }
        close(tank.state("h"), level, 1e-8);
        assert_eq!(tank.discrete("pump"), pump, "at {hours}");
    }
    assert_eq!(tank.discrete("starts"), 2.0);
}

#[test]
fn a_state_that_is_set_beyond_a_threshold_is_an_event_at_once_and_only_once() {
    let mut running = Running::new(
        "time t : s\naction u = 0 in -1..1\nstate x = 1 in -9..9\ndiscrete n = 0\ndiscrete m = 0\neq d/dt x = 0 [1/s]\n\
         event below when x <= 0\nevent pushed when u >= 0.5\nat below { next n = n + 1 }\nat pushed { next m = m + 1 ; reset x = -1 }\nobserve x in -9..9",
    );
    for (u, counts) in [(0.0, [0.0, 0.0]), (1.0, [1.0, 1.0]), (1.0, [1.0, 1.0]), (0.0, [1.0, 1.0]), (0.5, [1.0, 2.0])] {
        assert_eq!(running.step_with(&[u]).failure, None);
        assert_eq!([running.discrete("n"), running.discrete("m")], counts);
    }
    let options = ResetOptions { state: StateInput::Named(BTreeMap::from([("x".into(), 0.0)])), ..ResetOptions::default() };
    running.0.reset(Some(0), &options).expect("a start");
    running.step_with(&[0.0]);
    assert_eq!(running.discrete("n"), 1.0, "true at the threshold itself");
}

/// The compared value may jump: the instant is as clear as for a continuous one, within a step (20.5) and at its end (20).
#[test]
fn conditions_that_jump_are_found() {
    for (start, rate) in [(20.5, -3.0), (20.0, -3.0), (-4.5, 3.0), (-4.0, 3.0)] {
        let below = if rate < 0.0 { "D < 8" } else { "not (D > 8)" };
        let conditions = [("1", "-1", "> 0"), ("1", "-1", ">= 0"), ("3", "-0.5", "> 0"), ("0.25", "-1e6", ">= 0")];
        for (yes, no, sign) in conditions {
            let (yes, no) = if rate < 0.0 { (yes, no) } else { (no, yes) };
            let mut running = Running::new(&format!(
                "time t : h\nstate D = {start:?} in -50..50\nstate T : h = 0\ndiscrete n = 0\neq d/dt D = {rate:?}/1 [h]\neq d/dt T = 0 [1]\n\
                 event e when (if {below} then {yes} else {no}) {sign}\nat e {{ next n = n + 1 ; reset T = t }}\nobserve D in -50..50\n\
                 episode {{ step = 1 [h], max_steps = 9 }}"
            ));
            for _ in 0..6 {
                assert_eq!(running.step().failure, None);
            }
            assert_eq!(running.discrete("n"), 1.0, "{start} {yes} {no} {sign}");
            close(running.state("T"), (8.0 - start) / rate, 1e-7);
        }
    }
}

#[test]
fn conditions_are_remembered_by_snapshots() {
    let mut tank = tank(&[]);
    tank.step();
    let snapshot = tank.0.snapshot();
    let other = smpl_runtime::environment::Snapshot::from_bytes(&snapshot.to_bytes().expect("bytes")).expect("a snapshot");
    tank.0.restore(&other).expect("fits");
    tank.step();
    assert_eq!(tank.discrete("starts"), 1.0);
}

#[test]
fn equal_thresholds_end_as_a_failure_that_names_both() {
    for start in [0.2, 1.2] {
        let mut tank = tank(&[("low", 0.8), ("start", start)]);
        let failed = (0..40).map(|_| tank.step()).find(|r| r.failure.is_some()).expect("a failure");
        let reached = if start < 0.8 { 2.0 } else { (start - 0.8) / 0.2 };
        close(failed.time, reached, 1e-9);
        let message = tank.0.failure_message();
        assert!(message.starts_with("events: ") && message.contains("`is_low`") && message.contains("`is_high`"), "{message}");
    }
}

/// A ball that falls from 1 m above a floor; time at which the bounces have come to their end.
fn ball(floor: f64, restitution: f64, rtol: f64) -> (Running, f64) {
    let text = format!(
        "time t : s\nstate h : m = {} in {}..{}\nstate v : m/s = 0 in -10..10\ndiscrete n = 0\neq d/dt h = v\neq d/dt v = -9.81 [m/s^2]\n\
         event hit when h <= {floor} [m]\nat hit {{ reset v = -{restitution}*v ; next n = n + 1 }}\nobserve h in -1000..1000\n\
         solver {{ rtol = {rtol}, atol_factor = 1e-3 }}\nepisode {{ step = 0.5 [s], max_steps = 100 }}",
        floor + 1.0,
        floor - 1.0,
        floor + 2.0,
    );
    let fall = (2.0 / 9.81_f64).sqrt();
    (Running::new(&text), fall * (1.0 + 2.0 * restitution / (1.0 - restitution)))
}

#[test]
fn a_bouncing_ball_never_falls_through_the_floor() {
    for (floor, restitution) in [(0.0, 0.8), (10.0, 0.8), (-3.3, 0.5), (0.7, 0.1), (10.0, 0.95)] {
        let (mut running, end) = ball(floor, restitution, 1e-10);
        let mut result = running.step();
        while result.failure.is_none() {
            assert!(running.state("h") > floor - 1e-9, "{floor} {restitution}");
            result = running.step();
        }
        // Bounces lower than the tolerance are not distinguished.
        close(result.time, end, 1e-2);
        close(running.state("h"), floor, 1e-9);
        let message = running.0.failure_message();
        assert!(message.starts_with("events: ") && message.contains("`hit`"), "{message}");
    }
}

#[test]
fn bounces_follow_the_closed_form() {
    let (mut running, _) = ball(0.0, 0.8, 1e-10);
    let fall = (2.0 / 9.81_f64).sqrt();
    for _ in 0..6 {
        running.step();
        let (mut begin, mut speed, mut bounces) = (fall, 9.81 * fall * 0.8, 1.0);
        while begin + 2.0 * speed / 9.81 < running.0.time() {
            (begin, speed, bounces) = (begin + 2.0 * speed / 9.81, 0.8 * speed, bounces + 1.0);
        }
        let flight = running.0.time() - begin;
        if flight >= 0.0 {
            close(running.state("h"), speed * flight - 9.81 / 2.0 * flight * flight, 1e-6);
            close(running.state("v"), speed - 9.81 * flight, 1e-6);
            assert_eq!(running.discrete("n"), bounces);
        }
    }
}

#[test]
fn equations_that_lead_back_to_a_threshold_from_both_sides_fail_with_the_name_of_its_event() {
    let mut running = Running::new(
        "time t : s\nstate x = 0.5 in -10..10\nstate far = 3 in -10..10\ndiscrete n = 0\neq d/dt x = (if x < 1 then 1 else -2) / 1 [s]\n\
         eq d/dt far = 1 / 1 [s]\nevent other when far > 9\nevent top when x > 1\nat top { next n = n + 1 }\nobserve x\n\
         episode { step = 1 [s], max_steps = 2 }",
    );
    assert!(running.step().failure.is_some());
    let message = running.0.failure_message();
    let beginning = if method() == Method::Ida { "solver: " } else { "events: " };
    assert!(message.starts_with(beginning) && message.contains("`top`") && !message.contains("`other`"), "{message}");
    assert!(message.contains("t = 0.5"), "{message}");
}

/// The state of the first switch has a start from which both reach their thresholds at about the
/// same time, and nothing leads on from there.
#[test]
fn two_switches_that_both_lead_back_to_their_thresholds_fail_by_their_names() {
    let mut running = Running::new(
        "time t : s\nstate d1 = 0.1 in 0..100\nstate d2 = 0.15 in 0..100\n\
         eq d/dt d1 = 0.3 [1/s] - (if d1 > 0.2 then 1e8 [1/s]*d1 else 0 [1/s])\n\
         eq d/dt d2 = 0.3 [1/s] + 0.1 [1/s]*d1 - (if d2 > 0.2 then 1e8 [1/s]*d2 else 0 [1/s])\n\
         observe d1\nepisode { step = 1 [s], max_steps = 30 }",
    );
    assert!(running.step().failure.is_some());
    let message = running.0.failure_message();
    assert!(message.starts_with("solver: ") && message.contains("`d2` = 0.2 "), "{message}");
    assert!(message.contains("t = 0.160") && message.contains("both sides"), "{message}");
}

/// Each of 150 states passes its switch once, all within a thousandth of the step, and y' is 2
/// before and 1 after it.
#[test]
fn many_switches_at_about_the_same_time_are_passed() {
    let mut running = Running::new(
        "time t : s\nset i = 1..150\nstate x[i] = 0\nstate y[i] = 0\neq d/dt x[k] = 1 [1/s] for k in i\n\
         eq d/dt y[k] = (if x[k] > 0.5 + k*4e-6 then 1 else 2)/1 [s] for k in i\n\
         observe y[1]\nepisode { step = 1 [s], max_steps = 3 }",
    );
    assert_eq!(running.step().failure, None);
    for k in [1, 75, 150] {
        close(running.state(&format!("y[{k}]")), 1.5 + f64::from(k) * 4e-6, 1e-5);
    }
}

#[test]
fn the_limit_of_events_can_be_set() {
    // 10 events a second.
    let text = |limit: &str| {
        format!(
            "time t : s\nstate x = 0 in -1..2\ndiscrete n = 0\neq d/dt x = 10 [1/s]\nevent full when x >= 1\n\
             at full {{ reset x = 0 ; next n = n + 1 }}\nobserve x in -1..2\nepisode {{ step = 2.05 [s], max_steps = 2 }}\n{limit}"
        )
    };
    for (limit, fails) in [("", false), ("solver { max_events = 20 }", true), ("solver { max_events = 21 }", false)] {
        let mut running = Running::new(&text(limit));
        let result = running.step();
        assert_eq!(result.failure.is_some(), fails, "{limit}");
        if fails {
            close(result.time, 2.0, 1e-6);
            let message = running.0.failure_message();
            assert!(message.contains("more than 20") && message.contains("max_events"), "{message}");
        } else {
            assert_eq!(running.discrete("n"), 20.0);
        }
    }
}

#[test]
fn a_condition_that_ceases_to_hold_does_not_stop_the_integration() {
    let restarts = |events: &str| {
        let mut running = Running::new(&format!(
            "time t : s\nstate x = 0 in -9..9\nstate y = 1 in -9..9\ndiscrete n = 0\neq d/dt x = y*1 [1/s]\neq d/dt y = -x*1 [1/s]\nobserve x in -9..9\n\
             episode {{ step = 6.2 [s], max_steps = 2 }}\n{events}"
        ));
        assert_eq!(running.step().failure, None);
        running.0.statistics().restarts
    };
    // x is above 0.5 from pi/6 to 5 pi/6; without anything at it, both mark a switch.
    let none = restarts("");
    assert_eq!(restarts("event up when x >= 0.5\nat up { next n = n + 1 }"), none + 1);
    assert_eq!(restarts("event up when x >= 0.5"), none + 2);
}

#[test]
fn the_clock_of_an_event_is_its_time_and_so_is_that_of_its_condition() {
    let mut running = Running::new(
        "time t : h\nstate x = 0 in 0..100\ndiscrete c : h = 0\ndiscrete d : h = 0\neq d/dt x = 1 [1/h]\nevent half when x >= 2.5\nat half { next c = clock }\n\
         event late when clock >= 3.25 [h]\nat late { next d = clock }\nobserve x in 0..100\nepisode { step = 1 [h], max_steps = 9 }",
    );
    for _ in 0..4 {
        running.step();
    }
    close(running.discrete("c"), 2.5, 1e-9);
    close(running.discrete("d"), 3.25, 1e-9);
}

#[test]
fn after_a_failing_event_everything_is_of_its_time_and_the_next_step_goes_on_there() {
    let mut running = Running::new(
        "time t : h\nstate x = 0 in 0..100\neq d/dt x = 1 [1/h]\nlet w : h = t\nfail over event x >= 2.25\nobserve x in 0..100, seen : h = t in 0..100\n\
         reward r default = integral(1 [1])/1 [h]\nepisode { step = 1 [h], max_steps = 9 }",
    );
    running.0.set_keep_going(true);
    for time in [1.0, 2.0, 2.25, 4.0, 5.0] {
        let result = running.step();
        close(result.time, time, 1e-9);
        close(running.0.time(), time, 1e-9);
        close(running.state("x"), time, 1e-8);
        let mut seen = [0.0; 2];
        running.0.observe(false, &mut seen);
        close(seen[1], time, 1e-9);
        let mut w = [0.0];
        running.0.algebraics(&mut w);
        close(w[0], time, 1e-9);
        assert_eq!(result.failure.is_some(), time > 2.1);
    }
}

#[test]
fn algebraic_unknowns_follow_a_reset_at_the_end_of_a_step() {
    // z^3 + z = x; x comes to 2 at the end of the step, and is put to 10 there.
    let mut running = Running::new(
        "time t : s\nstate x = 0 in 0..100\nvar z = 1\neq z^3 + z = x\neq d/dt x = 2 [1/s]\nevent two when x >= 2\nat two { reset x = 10 }\nobserve z in 0..9\n\
         episode { step = 1 [s], max_steps = 2 }",
    );
    running.step();
    if running.state("x") < 5.0 {
        running.step();
    }
    let mut z = [0.0_f64];
    running.0.observe(false, &mut z);
    close(z[0].powi(3) + z[0], running.state("x"), 1e-7);
}

const PLAIN: &str = "time t : s\nstate x = 0.5 in -100..100\nstate y = 1 in -100..100\ndiscrete k = 0\neq d/dt x = -1 [1/s]\neq d/dt y = 0 [1/s]\n\
    observe p = x in -10..10\nreward r default = 1\nepisode { step = 1 [s], max_steps = 3 }\n";

#[test]
fn what_is_not_finite_is_a_failure_that_names_it() {
    for (statement, named) in [
        ("observe q = sqrt(x) in 0..1", "the observation `q`"),
        ("observe q = 1/max(0, x) in 0..1", "the observation `q`"),
        ("reward other = ln(x)", "the reward `other`"),
        ("fail over when sqrt(x) > 3", "the condition of the failure `over`"),
        ("success done when not (sqrt(x) > 0)", "the condition of the success `done`"),
        ("success done when sqrt(x) != 1", "the condition of the success `done`"),
        ("success done when (if sqrt(x) > 1 then 1 else 2) > 1.5", "the condition of the success `done`"),
        ("success done when any(sqrt(i*x) > 3 for i in 1..20)", "the condition of the success `done`"),
        ("success done when all(sqrt(i*x) > -1 for i in 1..20)", "the condition of the success `done`"),
        ("constraint limit when sqrt(x) > 2", "the constraint `limit`"),
        ("at end { clamp y at sqrt(x) when y > 0 }", "the state `y`"),
        ("at end { clamp y at 2 when sqrt(x) > 0 }", "the state `y`"),
        ("at end { next k = sqrt(x) }", "the discrete variable `k`"),
        ("event low when x <= 0.25\nat low { reset y = ln(-x) }", "the state `y`"),
        ("event high when sqrt(x) >= 3\nat high { next k = 1 }", "the condition of the event `high`"),
        ("fail high event sqrt(x) >= 3", "the condition of the event `high`"),
    ] {
        let mut running = Running::new(&format!("{PLAIN}{statement}"));
        let result = running.step();
        assert!(result.terminated && !result.success && result.cost.is_finite(), "{statement}: {result:?}");
        assert_eq!(running.0.failure_message(), format!("not_finite: {named} is not finite"), "{statement}");
        assert!(running.0.rewards().iter().all(|r| *r == -1000.0), "{statement}");
        let mut seen = vec![0.0_f64; running.0.observation_len()];
        running.0.observe(false, &mut seen);
        assert!(seen.iter().all(|x| x.is_finite()), "{statement}");
        if statement.starts_with("observe q = sqrt") {
            // The last reading, not the lower bound.
            close(seen[1], 0.5_f64.sqrt(), 1e-12);
            assert_eq!(running.0.missing_readings(), [false, true]);
        }
    }
}

#[test]
fn a_guard_decides_what_its_other_side_does_not_know() {
    for statement in [
        "success done when x > 0 and sqrt(x) > 3",
        "fail over when x > 0 and sqrt(x) > 3",
        "success done when not (x < 0 or sqrt(x) > 0.1) and x < 0",
        "success done when all(x > i or sqrt(i*x) > 3 for i in 1..20) and x > 0",
        "constraint limit when x > 0 and ln(x) > 3",
        "at end { clamp y at 2 when x > 0 and sqrt(x) > 0 }",
    ] {
        let mut running = Running::new(&format!("{PLAIN}{statement}"));
        let result = running.step();
        assert_eq!((result.failure, result.success), (None, false), "{statement}: {}", running.0.failure_message());
    }
}

#[test]
fn a_start_that_is_not_finite_is_refused_with_its_name() {
    for (statement, named) in [("observe q = 1/(x - 0.5) in 0..1", "the observation `q`"), ("initial y = sqrt(-x)", "the state `y`")] {
        let error = Running::unstarted(&format!("{PLAIN}{statement}")).reset(Some(0), &ResetOptions::default());
        assert!(matches!(&error, Err(ResetError::NotFinite { what }) if what.contains(named)), "{error:?}");
    }
}

#[test]
fn a_phase_that_ends_within_a_step_begins_the_next_one_there_though_its_end_has_come_already() {
    // `fill` ends at 0.7; the condition of `hold` holds then; `drain` lasts no time.
    let mut running = Running::new(
        "time t : s\nphase fill until x >= 0.7 then hold\nphase hold until x >= 0.5 then drain\nphase drain for 0 [s] then done\nphase done\n\
         state x = 0 in 0..9\neq d/dt x = 1 [1/s]\nobserve x in 0..9\nepisode { step = 1 [s], max_steps = 3 }",
    );
    assert_eq!(running.step().failure, None);
    assert_eq!(running.discrete("phase"), 4.0);
    close(running.discrete("phase_start"), 0.7, 1e-9);
}

#[test]
fn what_happens_at_the_instant_of_a_failing_event_is_done() {
    let text = |first: &str, second: &str| {
        format!(
            "time t : s\nstate x = 0 in -1..9\ndiscrete k = 0\neq d/dt x = 1 [1/s]\n{first}\n{second}\nat a {{ next k = k + 1 }}\nobserve x\n\
             episode {{ step = 1 [s], max_steps = 5 }}"
        )
    };
    let (event, fail) = ("event a when x >= 1.5", "fail f event x >= 1.5");
    for text in [text(event, fail), text(fail, event)] {
        let mut running = Running::new(&text);
        running.step();
        let failed = running.step();
        assert!(failed.failure.is_some(), "{failed:?}");
        close(failed.time, 1.5, 1e-9);
        close(running.discrete("k"), 1.0, 0.0);
    }
}

#[test]
fn a_failing_event_at_the_end_of_a_step_fails_that_step() {
    // Three steps of 0.7 s end at 2.0999999999999996 s.
    for condition in ["x >= 2.1", "x > 2.1", "t >= 2.1 [s]", "1 - x <= -1.1"] {
        let text = format!(
            "time t : s\nstate x = 0 in -1..9\neq d/dt x = 1 [1/s]\nfail f event {condition}\nobserve x\nepisode {{ step = 0.7 [s], max_steps = 9 }}"
        );
        let mut running = Running::new(&text);
        let failed: Vec<bool> = (0..3).map(|_| running.step().failure.is_some()).collect();
        assert_eq!(failed, [false, false, true], "{condition}");
        close(running.0.time(), 2.1, 1e-11);
    }
}

#[test]
fn a_phase_that_ends_with_a_step_is_over_after_it() {
    let mut running = Running::new(
        "time t : h\nphase a for 2.1 [h] then b\nphase b for 2.8 [h] then c\nphase c\nstate x = 0 in -1..9\neq d/dt x = 1 [1/h]\nobserve x\n\
         episode { step = 0.7 [h], max_steps = 20 }",
    );
    let phases: Vec<f64> = (0..9)
        .map(|_| {
            running.step();
            running.discrete("phase")
        })
        .collect();
    assert_eq!(phases, [1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0]);
}
