//! Cyclic starts: the state to which a period returns, against closed forms.

mod shell;

use std::f64::consts::PI;

use shell::{columns, file, name, smpl, status, text};

const CYCLIC: &[&str] = &["--start", "cyclic"];

fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() < tolerance, "{found} is not {expected}");
}

#[test]
fn a_slow_store_starts_on_the_orbit_of_its_daily_course_and_only_its_meter_goes_on() {
    // d/dt x = a (5 sin(w t) + 1 - x): the orbit of a lag with a time constant of 20 days.
    let source = "time t : h\naction u = 1 in 0..2\nparam a : 1/h = 0.05/24\nstate x = 30 in 0..100\nstate meter : h = 3\n\
                  discrete days = 7\neq d/dt x = a*(5*sin(2*pi*t/24 [h]) + u - x)\neq d/dt meter = x\nat end { next days = days + step/24 [h] }\n\
                  episode { step = 2 [h], max_steps = 24, cycle = 24 [h] }\nsolver { rtol = 1e-9 }\n";
    let path = file("daily", "m.eq", source);
    let (a, w) = (0.05 / 24.0, 2.0 * PI / 24.0);
    let orbit = |t: f64| 1.0 + 5.0 * a * (a * (w * t).sin() - w * (w * t).cos()) / (a * a + w * w);
    for method in ["ida", "rosenbrock", "explicit", "auto"] {
        let found = columns(&path, &["x", "meter", "days"], &[CYCLIC, &["--method", method]].concat());
        found[0].iter().enumerate().for_each(|(step, x)| near(*x, orbit(2.0 * step as f64), 1e-6));
        near(found[1][0], 3.0, f64::EPSILON);
        near(found[2][0], 7.0, f64::EPSILON);
    }
}

#[test]
fn a_tank_that_is_filled_and_emptied_by_a_schedule_keeps_what_is_conserved() {
    // Two tanks exchange: their sum stays 5, their difference follows the schedule.
    let source = "time t : min\nstate p = 4\nstate q = 1\nphase left for 3 [min] then right\nphase right for 2 [min] then left\n\
                  let pull : 1 = if phase == left then 1 else -1\neq d/dt p = (pull - (p - q))/10 [min]\neq d/dt q = -(pull - (p - q))/10 [min]\n\
                  observe p, q, phase\nepisode { step = 0.5 [min], max_steps = 20, cycle = 5 [min] }\nsolver { rtol = 1e-10 }\n";
    let found = columns(&file("schedule", "m.eq", source), &["p", "q", "phase"], CYCLIC);
    // d/dt s = (pull - s)/5 min: s(0) is the fixed point of the map of a period.
    let map = |s: f64| -1.0 + ((1.0 + (s - 1.0) * (-0.6_f64).exp()) + 1.0) * (-0.4_f64).exp();
    let s = map(0.0) / (1.0 - (map(1.0) - map(0.0)));
    near(found[0][0] + found[1][0], 5.0, 1e-8);
    near(found[0][0] - found[1][0], s, 1e-8);
    for step in [10, 20] {
        near(found[0][step], found[0][0], 1e-7);
        assert_eq!(found[2][step], found[2][0]);
    }
}

#[test]
fn a_count_that_does_not_move_in_the_first_period_is_found_later() {
    // The tank starts below its orbit: the first lot leaves in the second period.
    let source = "time t : min\nstate V : L = 30 in 0..200\nstate T : K = 300 in 0..999\nstate lots = 2\nevent full when V >= 60 [L]\n\
                  at full { reset V = V - 25 [L]; reset lots = lots + 1 }\neq d/dt V = 2.5 [L/min]\neq d/dt lots = 0\n\
                  eq d/dt T = 2.5 [L/min]/V*(290 [K] - T) + 1 [K/min]\n\
                  episode { step = 1 [min], max_steps = 20, cycle = 10 [min] }\nsolver { rtol = 1e-10 }\n";
    let found = columns(&file("lots", "m.eq", source), &["V", "T", "lots"], CYCLIC);
    // With m = V (T - 290 K) between two lots d/dt m = V; a lot takes 25 of 60 L and of m with it.
    let m = |m0: f64| (m0 + 115.0) * 35.0 / 60.0 + 35.0 * 8.0 + 2.5 * 32.0;
    let orbit = m(0.0) / (1.0 - (m(1.0) - m(0.0)));
    near(found[0][0], 55.0, 1e-8);
    near(found[1][0], 290.0 + orbit / 55.0, 1e-6);
    assert_eq!([found[2][0], found[2][10], found[2][20]], [2.0, 3.0, 4.0]);
    near(found[1][20], found[1][0], 1e-6);
}

#[test]
fn an_integral_controller_starts_with_its_integral() {
    // A sampled integral controller that has to hold the mean of a disturbed level.
    let source = "time t : s\nstate x = 0 in -9..9\ndiscrete u = 0 in -9..9\nlet load : 1 = 2 + cos(2*pi*t/10 [s])\n\
                  eq d/dt x = (u - load - x)/4 [s]\ncontrol u from x setpoint 0.5 gain 0.4 reset 5 [s] every 1 [s]\n\
                  episode { step = 2 [s], max_steps = 10, cycle = 10 [s] }\nsolver { rtol = 1e-10 }\n";
    let path = file("integral", "m.eq", source);
    let found = columns(&path, &["x", "u"], CYCLIC);
    let plain = columns(&file("long", "m.eq", source.replace("max_steps = 10", "max_steps = 400")), &["x", "u"], &["--start", "nominal"]);
    for step in 0..=10 {
        near(found[0][step], plain[0][390 + step], 1e-6);
        near(found[1][step], plain[1][390 + step], 1e-6);
    }
}

/// A bed that adsorbs from one end and is purged from the other.
const SWING_BED: &str = r#"time t : s
domain z in 0 [m]..1 [m] cells 15 scheme upwind
state c[z] : mol/m^3 = 0 in 0..inf
state q[z] : mol/m^3 = 0 in 0..inf
state made : mol/m^2 = 0
phase load for 20 [s] then purge
phase purge for 15 [s] then load
let v : m/s = if phase == load then 0.12 else -0.2
let feed : mol/(m^2 s) = if phase == load then 0.12 [m/s]*8 [mol/m^3] else v*c[z.first]
let purge_gas : mol/(m^2 s) = if phase == load then v*c[z.last] else -0.2 [m/s]*0.2 [mol/m^3]
flux J[z] = v*c[z], low = feed, high = purge_gas
let r[z] : mol/(m^3 s) = 0.06 [1/s]*(40*c[z]/(5 [mol/m^3] + c[z]) * 1 [mol/m^3] - q[z])
eq d/dt c[z] = -div(J[z]) - r[z] for z
eq d/dt q[z] = r[z] for z
eq d/dt made = if phase == load then v*c[z.last] else 0
episode { step = 5 [s], max_steps = 7, cycle = 35 [s] }
solver { rtol = 1e-9 }
"#;

#[test]
fn a_bed_of_alternating_flow_starts_where_214_periods_of_scipy_end() {
    // SciPy's LSODA with rtol 1e-10, period after period until the changes are below 1e-11.
    let scipy = [2.2085593817442515, 0.3045162127028129, 18.430816060533576, 7.430776713458159];
    for method in ["ida", "rosenbrock", "auto"] {
        let wanted = ["c[1]", "c[15]", "q[1]", "q[15]", "made"];
        let found = columns(&file("bed", "m.eq", SWING_BED), &wanted, &[CYCLIC, &["--method", method]].concat());
        for (column, expected) in found.iter().zip(scipy) {
            near(column[0], expected, 1e-6);
            near(column[7], expected, 1e-6);
        }
        near(found[4][0], 0.0, f64::EPSILON);
        near(found[4][7], 8.189280699008597, 1e-6);
    }
}

#[test]
fn tests_of_a_model_start_on_their_cycle() {
    let source = "time t : s\nstate x = 9\neq d/dt x = (cos(2*pi*t/4 [s]) - x)/1 [s]\nepisode { step = 1 [s], max_steps = 8, cycle = 4 [s] }\n\
                  test \"returns\" {\n  start cyclic\n  expect x within 1e-5 of 1/(1 + (pi/2)^2)\n  steps 4\n  expect x within 1e-5 of 1/(1 + (pi/2)^2)\n}\n";
    let output = smpl(&["test", name(&file("text", "m.eq", source))]);
    assert_eq!(status(&output), 0, "{}{}", text(&output.stdout), text(&output.stderr));
}

#[test]
fn what_has_no_cyclic_start_is_named() {
    let model = |equation: &str, episode: &str| {
        format!("time t : s\nstate x = 1\n{equation}\nepisode {{ step = 1 [s], max_steps = 3{episode} }}\n")
    };
    for (source, message) in [
        (model("eq d/dt x = -x/1 [s]", ""), "the model has no period: add `cycle = 24 [h]` to `episode`"),
        (model("eq d/dt x = (1 - delay(x, 2 [s]))/9 [s]", ", cycle = 4 [s]"), "a model with dead times has no cyclic start"),
        (model("eq d/dt x = x*x/1 [s]", ", cycle = 4 [s]"), "a step of the period failed"),
        (model("eq d/dt x = 1/1 [s]\nstate y = 0\neq d/dt y = (x - y)/1 [s]", ", cycle = 4 [s]"), "`x` does not return to its value"),
        (model("eq d/dt x = -x/1 [s]", ", cycle = 2.5 [s]"), "`cycle` must be a multiple of the step of 1, it is 2.5"),
    ] {
        let output = smpl(&["simulate", name(&file("none", "m.eq", &source)), "--start", "cyclic"]);
        let told = text(&output.stderr);
        assert!(status(&output) == 1 && told.contains(message), "{source}\n{told}");
    }
}
