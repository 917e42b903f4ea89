//! Constraints that states are projected to by corrections: with algebraic unknowns, many at once,
//! loops that share states. Values are of minimal coordinates, integrated by SciPy 1.x (`DOP853`,
//! `rtol=1e-12`).

use std::collections::BTreeMap;

use super::*;

/// The force of a pendulum of length 1 by Cartesian coordinates, its angle an algebraic unknown.
const SWING: &str = "state x : m = 1
    state y : m = 0
    state u : m/s = 0
    state v : m/s = 0
    var a = 1.5
    var F : 1/s^2
    eq d/dt x = u
    eq d/dt y = v
    eq d/dt u = -F*x
    eq d/dt v = -F*y - 9.81[m/s^2]
    eq x = sin(a)*1[m]
    eq y = -cos(a)*1[m]";

/// It passes the lowest point, where x no longer follows from y, and the ends, where y does not from
/// x.
#[test]
fn a_pendulum_with_an_angle_swings_through_all_points() {
    let expected = [("x", 0.793_566_195), ("y", -0.608_483_930), ("F", 17.907_682_07)];
    ends_at(SWING, 2.0, &expected, 2e-6);
}

#[test]
fn a_pendulum_with_an_angle_keeps_its_constraints_over_long_times() {
    let found = run(SWING, Method::Auto, (100.0, 500));
    let (x, y, u, v) = (found["x"], found["y"], found["u"], found["v"]);
    assert!((x.hypot(y) - 1.0).abs() < 1e-9 && (x * u + y * v).abs() < 1e-9, "{x} {y} {u} {v}");
    assert!((0.5 * (u * u + v * v) + 9.81 * y).abs() < 1e-4, "{x} {y} {u} {v}");
}

#[test]
fn a_double_pendulum_with_angles_keeps_both_rods() {
    let text = "param g : m/s^2 = 9.81
        state x : m = 1
        state y : m = 0
        state u : m/s = 0
        state v : m/s = 0
        state p : m = 2
        state q : m = 0
        state r : m/s = 0
        state s : m/s = 0
        var a = 1.5
        var b = 1.5
        var F : 1/s^2
        var G : 1/s^2
        eq d/dt x = u
        eq d/dt y = v
        eq d/dt p = r
        eq d/dt q = s
        eq d/dt u = -F*x + G*(p - x)
        eq d/dt v = -F*y + G*(q - y) - g
        eq d/dt r = -G*(p - x)
        eq d/dt s = -G*(q - y) - g
        eq x = sin(a)*1[m]
        eq y = -cos(a)*1[m]
        eq p - x = sin(b)*1[m]
        eq q - y = -cos(b)*1[m]";
    let expected = [("x", -0.994_596_766_902), ("y", 0.103_813_637_194), ("p", -1.969_206_623_126), ("q", -0.120_096_228_938)];
    ends_at(text, 1.5, &expected, 2e-6);
}

/// Crank 1, coupler 2.5, rocker 2.2, ground 2.8: the crank turns 3.77 times and does not follow from
/// the rocker at its dead points.
#[test]
fn a_four_bar_linkage_turns_through_its_dead_points() {
    let text = "state th1 = 0.5
        state w1 : 1/s = 3
        state th3 = 1.619112149123862
        state w3 : 1/s = -0.4578793574197169
        var th2 = 0.7576316374651257
        var F : 1/s^2
        eq d/dt th1 = w1
        eq d/dt th3 = w3
        eq d/dt w1 = 0.4 [1/s^2] + 2.5*F*sin(th2 - th1)
        eq d/dt w3 = -2.5*2.2*F*sin(th2 - th3)
        eq cos(th1) + 2.5*cos(th2) = 2.8 + 2.2*cos(th3)
        eq sin(th1) + 2.5*sin(th2) = 2.2*sin(th3)";
    let (tau, th3) = (std::f64::consts::TAU, -3.952_029_017_984);
    let expected = [("th1", 24.192_635_447_505), ("w1", 4.899_255_416_643), ("th3", th3 + tau), ("w3", -2.039_867_208_037)];
    ends_at(text, 6.0, &expected, 1e-6);
}

/// A rope of links without mass and a mass of 1 kg at each joint, horizontal and at rest.
fn rope(count: u32) -> String {
    let before = count - 1;
    format!(
        "set k = 1..{count}
        param g : 1/s^2 = 9.81
        param l = 1/{count}
        state x[i in k] = i/{count}
        state y[i in k] = 0
        state u[i in k] : 1/s = 0
        state v[i in k] : 1/s = 0
        var F[k] : 1/s^2
        eq d/dt x[i] = u[i] for i in k
        eq d/dt y[i] = v[i] for i in k
        eq d/dt u[1] = -F[1]*x[1] + F[2]*(x[2] - x[1])
        eq d/dt v[1] = -F[1]*y[1] + F[2]*(y[2] - y[1]) - g
        eq d/dt u[i] = -F[i]*(x[i] - x[i-1]) + F[i+1]*(x[i+1] - x[i]) for i in 2..{before}
        eq d/dt v[i] = -F[i]*(y[i] - y[i-1]) + F[i+1]*(y[i+1] - y[i]) - g for i in 2..{before}
        eq d/dt u[{count}] = -F[{count}]*(x[{count}] - x[{before}])
        eq d/dt v[{count}] = -F[{count}]*(y[{count}] - y[{before}]) - g
        eq x[1]^2 + y[1]^2 = l^2
        eq (x[i] - x[i-1])^2 + (y[i] - y[i-1])^2 = l^2 for i in 2..{count}"
    )
}

/// The largest violations of the lengths of links, and of their rates, in parts of a link.
fn violations(found: &BTreeMap<String, f64>, count: u32) -> (f64, f64) {
    let at = |name: &str, i: u32| if i == 0 { 0.0 } else { found[&format!("{name}[{i}]")] };
    let along = |name: &str, i: u32| (at(name, i) - at(name, i - 1)) * f64::from(count);
    let length = |i: u32| (along("x", i).hypot(along("y", i)) - 1.0).abs();
    let rate = |i: u32| (along("x", i) * along("u", i) + along("y", i) * along("v", i)).abs();
    (1..=count).fold((0.0, 0.0), |(a, b): (f64, f64), i| (a.max(length(i)), b.max(rate(i))))
}

#[test]
fn ropes_of_many_links_fall_as_by_their_angles() {
    let short = [("x[10]", -0.913_312_229_406), ("y[10]", -0.149_655_141_419), ("x[5]", -0.467_178_225_619), ("u[10]", 0.146_183_202_557)];
    let long = [("x[40]", 0.791_513_119_031), ("y[40]", -0.441_45), ("x[20]", 0.303_410_769_559), ("u[40]", -2.093_325_925_057)];
    let of_ten = [(Method::Ida, 1), (Method::Ida, 30), (Method::Rosenbrock, 7), (Method::Auto, 2)];
    of_ten.into_iter().for_each(|(method, steps)| falls(10, (method, 1.0, steps), &short));
    [(Method::Ida, 3), (Method::Auto, 1)].into_iter().for_each(|(method, steps)| falls(40, (method, 0.3, steps), &long));
}

/// Compares values at the end of the fall of a rope, and the lengths of its links.
fn falls(count: u32, (method, time, steps): (Method, f64, u32), expected: &[(&str, f64)]) {
    let found = run(&rope(count), method, (time, steps));
    for (name, value) in expected {
        let one = found[*name];
        assert!((one - value).abs() < 1e-6, "{count} links, {method}, {steps} steps: {name} = {one}, not {value}");
    }
    let (length, rate) = violations(&found, count);
    assert!(length < 1e-9 && rate < 1e-9, "{count} links, {method}, {steps} steps: {length} {rate}");
}

#[test]
fn the_code_of_a_rope_does_not_grow_with_its_links() {
    let code = |count: u32| environment(&rope(count), Method::Auto, (1.0, 1)).setup().model().statistics().code_bytes;
    assert!(code(400) < 2 * code(40), "{} and {} bytes", code(40), code(400));
}

/// Thirty pendulums that hang from one cart of 10 kg: a state that all passes of a loop share.
#[test]
fn pendulums_of_a_loop_may_share_a_state() {
    let text = "set k = 1..30
        param g : 1/s^2 = 9.81
        state X = 0
        state U : 1/s = 0
        state x[i in k] = sin(0.1*i)
        state y[i in k] = -cos(0.1*i)
        state u[i in k] : 1/s = 0
        state v[i in k] : 1/s = 0
        var F[k] : 1/s^2
        eq d/dt X = U
        eq 10*d/dt U = sum(F[i]*(x[i] - X) for i in k)
        eq d/dt x[i] = u[i] for i in k
        eq d/dt y[i] = v[i] for i in k
        eq d/dt u[i] = -F[i]*(x[i] - X) for i in k
        eq d/dt v[i] = -F[i]*y[i] - g for i in k
        eq (x[i] - X)^2 + y[i]^2 = 1 for i in k";
    for (method, steps) in [(Method::Ida, 1), (Method::Rosenbrock, 5), (Method::Auto, 40)] {
        let found = run(text, method, (1.0, steps));
        for (name, value) in [("X", 0.974_257_464_375), ("x[30]", 0.438_242_703_065)] {
            assert!((found[name] - value).abs() < 1e-6, "{method}, {steps} steps: {name} = {}, not {value}", found[name]);
        }
    }
}

/// A rope in space, its positions in one array: the plane of the fall is that of `ropes_of...`.
#[test]
fn constraints_over_rows_of_an_array_are_projected() {
    let text = "set k = 1..10
        set c = {a, b, z}
        param g[j in c] : 1/s^2 = if j == b then 9.81 else 0
        state p[i in k, j in c] = if j == a then i/10 else 0
        state w[i in k, j in c] : 1/s = 0
        var F[k] : 1/s^2
        eq d/dt p[i, j] = w[i, j] for i in k, j in c
        eq d/dt w[1, j] = -F[1]*p[1, j] + F[2]*(p[2, j] - p[1, j]) - g[j] for j in c
        eq d/dt w[i, j] = -F[i]*(p[i, j] - p[i-1, j]) + F[i+1]*(p[i+1, j] - p[i, j]) - g[j] for i in 2..9, j in c
        eq d/dt w[10, j] = -F[10]*(p[10, j] - p[9, j]) - g[j] for j in c
        eq sum(p[1, j]^2 for j in c) = 0.01
        eq sum((p[i, j] - p[i-1, j])^2 for j in c) = 0.01 for i in 2..10";
    let found = run(text, Method::Auto, (1.0, 10));
    for (name, value) in [("p[10,a]", -0.913_312_229_406), ("p[10,b]", -0.149_655_141_419), ("p[10,z]", 0.0)] {
        assert!((found[name] - value).abs() < 1e-6, "{name} = {}, not {value}", found[name]);
    }
}

/// At 0.5 s the bob gets 0.1 m/s more along x; what is not along the circle is lost. Steps of Gauss
/// and Newton in NumPy from there, and the angle after them, give x = -0.98010804792. Moves with an
/// unknown angle differ from them by the square of the distance.
#[test]
fn a_reset_off_the_constraints_is_completed() {
    let text = SWING.to_owned() + "\nevent kick when t >= 0.5 [s]\nat kick {\nreset u = u + 0.1 [m/s]\n}\n";
    let first = run(&text, Method::Auto, (1.0, 4))["x"];
    assert!((first + 0.980_108_048).abs() < 1e-5, "{first}");
    for (method, steps) in [(Method::Ida, 1), (Method::Ida, 4), (Method::Rosenbrock, 3), (Method::Auto, 20)] {
        let found = run(&text, method, (1.0, steps));
        assert!((found["x"] - first).abs() < 1e-7, "{method}, {steps} steps: {} and {first}", found["x"]);
        assert!((found["x"].hypot(found["y"]) - 1.0).abs() < 1e-9, "{method}, {steps} steps: {} {}", found["x"], found["y"]);
    }
}

#[test]
fn a_start_off_constraints_with_unknowns_is_refused_by_name() {
    let text = SWING.replace("y : m = 0", "y : m = 0.5");
    let mut environment = environment(&text, Method::Auto, (1.0, 1));
    let error = environment.reset(Some(0), &ResetOptions::default()).expect_err("a start off the circle").to_string();
    assert!(error.contains("inconsistent values") && error.contains("m.eq:"), "{error}");
}
