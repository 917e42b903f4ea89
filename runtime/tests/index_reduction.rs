//! Systems of index above 1, and rates of expressions, against closed forms and reduced forms
//! integrated by SciPy 1.x (`DOP853`, `rtol=1e-12`). Every method that takes algebraic unknowns runs
//! in one long step and in many short ones.

use std::collections::BTreeMap;
use std::path::Path;

use smpl_runtime::environment::{Environment, ResetOptions, StateInput};
use smpl_runtime::load::{LoadOptions, load_text};
use smpl_runtime::setup::{EnvironmentOptions, Setup};
use smpl_runtime::solver::Method;

const METHODS: [Method; 3] = [Method::Ida, Method::Rosenbrock, Method::Auto];

fn environment(text: &str, method: Method, (time, steps): (f64, u32)) -> Environment {
    let step = time / f64::from(steps);
    let text = format!(
        "model M\ntime t : s\nepisode {{ step = {step} [s], max_steps = {steps} }}\nsolver {{ rtol = 1e-9, max_steps = 1000000 }}\n{text}\n"
    );
    let loaded = load_text(Path::new("m.eq"), text, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error:?}"));
    let mut options = EnvironmentOptions::default();
    options.solver.method = Some(method);
    let setup = Setup::new(loaded.model, options, Some(loaded.sources)).expect("a setup");
    Environment::new(setup).expect("an environment")
}

/// The values of all unknowns at the end.
fn run(text: &str, method: Method, grid: (f64, u32)) -> BTreeMap<String, f64> {
    let mut environment = environment(text, method, grid);
    environment.reset(Some(0), &ResetOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    let action = vec![0.0; environment.catalogue().actions.len()];
    while environment.is_running() {
        environment.step(&action).expect("a step");
    }
    values(&environment)
}

fn values(environment: &Environment) -> BTreeMap<String, f64> {
    let catalogue = environment.catalogue();
    let all = catalogue.states.elements().iter().chain(catalogue.solved.elements());
    all.map(|element| (element.name.clone(), environment.unknowns()[element.at])).collect()
}

/// Compares values at the end by all methods, in one step and in many.
fn ends_at(text: &str, time: f64, expected: &[(&str, f64)], tolerance: f64) {
    for method in METHODS {
        for steps in [1, 7, 60] {
            let found = run(text, method, (time, steps));
            for (name, value) in expected {
                let one = found.get(*name).unwrap_or_else(|| panic!("no {name} among {:?}", found.keys()));
                assert!((one - value).abs() <= tolerance * value.abs().max(1.0), "{method}, {steps} steps: {name} = {one}, not {value}");
            }
        }
    }
}

const VESSELS: &str = "param R : J/mol/K = 8.314462618
    param T : K = 300
    param V1 : m^3 = 1
    param V2 : m^3 = 2
    param F : mol/s = 1
    state n1 : mol = 1
    state n2 : mol = 2
    var p1 : Pa
    var p2 : Pa
    var w : mol/s
    eq d/dt n1 = F - w
    eq d/dt n2 = w
    eq p1 = n1*R*T/V1
    eq p2 = n2*R*T/V2
    eq p1 = p2";

/// n1/V1 = n2/V2 and n1 + n2 = 3 + t.
#[test]
fn two_vessels_in_contact_share_what_flows_in() {
    ends_at(VESSELS, 3.0, &[("n1", 2.0), ("n2", 4.0), ("w", 2.0 / 3.0)], 1e-10);
}

#[test]
fn a_start_off_a_constraint_is_refused_by_name_and_value() {
    let text = VESSELS.replace("n2 : mol = 2", "n2 : mol = 1");
    let mut environment = environment(&text, Method::Auto, (3.0, 1));
    let refused = environment.reset(Some(0), &ResetOptions::default()).expect_err("inconsistent").to_string();
    for part in ["inconsistent", "`n2`", "1 mol", "2 mol", "m.eq:"] {
        assert!(refused.contains(part), "{refused}");
    }
}

#[test]
fn states_given_by_name_take_those_that_follow_along() {
    let mut environment = environment(VESSELS, Method::Auto, (3.0, 1));
    let given = |list: &[(&str, f64)]| {
        let state = StateInput::Named(list.iter().map(|(name, x)| ((*name).to_owned(), *x)).collect());
        ResetOptions { state, ..ResetOptions::default() }
    };
    environment.reset(Some(0), &given(&[("n1", 5.0)])).expect("n2 follows");
    assert!((values(&environment)["n2"] - 10.0).abs() < 1e-9);
    environment.reset(Some(0), &given(&[("n1", 5.0), ("n2", 10.0)])).expect("both fit");
    let refused = environment.reset(Some(0), &given(&[("n1", 5.0), ("n2", 9.0)])).expect_err("they do not fit").to_string();
    assert!(refused.contains("`n2`"), "{refused}");
    environment.reset(Some(0), &ResetOptions { state: StateInput::Array(vec![2.0]), ..ResetOptions::default() }).expect("states");
    assert!((values(&environment)["n2"] - 4.0).abs() < 1e-9);
}

/// i(t) of each coil alone with v_n = 0, in closed form.
#[test]
fn three_coils_in_a_star_carry_the_currents_of_each_alone() {
    let text = "param L : V s/A = 0.1
        param R : V/A = 1
        param U : V = 100
        param w : 1/s = 314.1592653589793
        state i1 : A = 0
        state i2 : A = 0
        state i3 : A = 0
        var vn : V
        eq L*d/dt i1 = U*sin(w*t) - R*i1 - vn
        eq L*d/dt i2 = U*sin(w*t - 2.0943951023931953) - R*i2 - vn
        eq L*d/dt i3 = U*sin(w*t + 2.0943951023931953) - R*i3 - vn
        eq i1 + i2 + i3 = 0";
    let expected = [("i1", 1.733_410_788_788_8), ("i2", 1.937_723_055_489_3), ("i3", -3.671_133_844_278_1), ("vn", 0.0)];
    ends_at(text, 0.055, &expected, 1e-7);
}

/// Elliptic motion of a pendulum of length 1.
fn pendulum(g: f64, constraint: &str) -> String {
    format!(
        "param g : m/s^2 = {g}
        state x : m = 1
        state y : m = 0
        state u : m/s = 0
        state v : m/s = 0
        var F : 1/s^2
        eq d/dt x = u
        eq d/dt y = v
        eq d/dt u = -F*x
        eq d/dt v = -F*y - g
        eq {constraint}"
    )
}

#[test]
fn a_pendulum_of_index_3_swings_through_its_lowest_point() {
    let text = pendulum(9.81, "x^2 + y^2 = 1 [m^2]");
    ends_at(&text, 2.0, &[("x", 0.793_566_195_343), ("y", -0.608_483_930_444), ("F", 17.907_682_07)], 1e-6);
}

#[test]
fn a_pendulum_of_index_2_swings_through_its_lowest_point() {
    let text = pendulum(1.0, "x*u + y*v = 0 [m^2/s]");
    ends_at(&text, 5.0, &[("x", -0.685_344_871_279), ("y", -0.728_218_653_573), ("F", 2.184_655_860_72)], 1e-6);
}

#[test]
fn a_pendulum_does_not_leave_its_circle() {
    let text = pendulum(9.81, "x^2 + y^2 = 1 [m^2]");
    for method in METHODS {
        for steps in [1, 100] {
            let found = run(&text, method, (100.0, steps));
            let radius = found["x"].hypot(found["y"]);
            let along = found["x"] * found["u"] + found["y"] * found["v"];
            assert!((radius - 1.0).abs() < 1e-9 && along.abs() < 1e-9, "{method}, {steps}: {radius} {along}");
            assert!((found["x"] - 0.181_513_351).abs() < 2e-4, "{method}, {steps}: {}", found["x"]);
        }
    }
}

/// The angle and its rate by the classical method of Runge and Kutta, from the horizontal at rest.
fn angle(g: f64, time: f64) -> (f64, f64) {
    const STEPS: u32 = 20_000;
    let h = time / f64::from(STEPS);
    let rates = |(a, w): (f64, f64)| (w, -g * a.sin());
    let moved = |(a, w): (f64, f64), (da, dw): (f64, f64), by: f64| (a + by * da, w + by * dw);
    (0..STEPS).fold((std::f64::consts::FRAC_PI_2, 0.0), |z, _| {
        let k1 = rates(z);
        let k2 = rates(moved(z, k1, h / 2.0));
        let k3 = rates(moved(z, k2, h / 2.0));
        let k4 = rates(moved(z, k3, h));
        moved(moved(moved(moved(z, k1, h / 6.0), k2, h / 3.0), k3, h / 3.0), k4, h / 6.0)
    })
}

#[test]
fn a_loop_of_pendulums_is_projected_as_a_loop() {
    let text = |count: u32| {
        format!(
            "set k = 1..{count}
            state x[i in k] = 1
            state y[i in k] = 0
            state u[i in k] : 1/s = 0
            state v[i in k] : 1/s = 0
            var F[k] : 1/s^2
            eq d/dt x[i] = u[i] for i in k
            eq d/dt y[i] = v[i] for i in k
            eq d/dt u[i] = -F[i]*x[i] for i in k
            eq d/dt v[i] = -F[i]*y[i] - 0.5[1/s^2]*i for i in k
            eq x[i]^2 + y[i]^2 = 1 for i in k"
        )
    };
    let expected: Vec<(String, f64)> = [1_u32, 7, 20]
        .into_iter()
        .flat_map(|i| {
            let (a, w) = angle(0.5 * f64::from(i), 3.0);
            [(format!("x[{i}]"), a.sin()), (format!("y[{i}]"), -a.cos()), (format!("u[{i}]"), w * a.cos())]
        })
        .collect();
    let expected: Vec<(&str, f64)> = expected.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    ends_at(&text(20), 3.0, &expected, 1e-5);
    let code = |count: u32| environment(&text(count), Method::Auto, (1.0, 1)).setup().model().statistics().code_bytes;
    assert!(code(400) < 2 * code(40), "{} and {} bytes", code(40), code(400));
}

/// With `prefer` x follows from y, until the pendulum passes its lowest point after a quarter of its
/// period of 2.36784194757624 s.
#[test]
fn a_constraint_that_stops_to_determine_a_state_ends_the_episode_by_name() {
    let text = pendulum(9.81, "x^2 + y^2 = 1 [m^2]").replace("y : m = 0", "y : m = 0 prefer");
    for method in METHODS {
        for steps in [1, 60] {
            let mut environment = environment(&text, method, (1.0, steps));
            environment.reset(Some(0), &ResetOptions::default()).expect("a start");
            while environment.is_running() {
                environment.step(&[]).expect("a step");
            }
            let message = environment.failure_message();
            for part in ["no longer determines `x`", "m.eq:"] {
                assert!(message.contains(part), "{method}, {steps} steps: {message:?}");
            }
            assert!(
                (environment.time() - 0.591_960).abs() < 0.02 || message.starts_with("solver"),
                "{method}, {steps}: {}",
                environment.time()
            );
        }
    }
}

#[test]
fn a_double_pendulum_keeps_both_rods() {
    let text = "param g : m/s^2 = 9.81
        state x : m = 1
        state y : m = 0
        state u : m/s = 0
        state v : m/s = 0
        state p : m = 2
        state q : m = 0
        state r : m/s = 0
        state s : m/s = 0
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
        eq x^2 + y^2 = 1 [m^2]
        eq (p - x)^2 + (q - y)^2 = 1 [m^2]";
    let expected = [("x", -0.994_596_766_902), ("y", 0.103_813_637_194), ("p", -1.969_206_623_126), ("q", -0.120_096_228_938)];
    ends_at(text, 1.5, &expected, 2e-5);
}

/// A bead on y = x^2: y follows from x at all times.
#[test]
fn a_bead_on_a_parabola_follows_by_its_own_coordinate() {
    let text = "param g : m/s^2 = 9.81
        state x : m = 1
        state y : m = 1
        state u : m/s = 0
        state v : m/s = 0
        var F : m/s^2
        eq d/dt x = u
        eq d/dt y = v
        eq d/dt u = 2*x*F/1[m]
        eq d/dt v = -F - g
        eq y*1[m] = x^2";
    ends_at(text, 2.0, &[("x", 0.680_720_715_960), ("y", 0.463_380_693_137), ("u", 1.920_843_476_944), ("v", 2.615_115_893_743)], 1e-6);
}

#[test]
fn a_loop_of_capacitors_and_a_source_has_one_state() {
    let text = "param C1 : A s/V = 1
        param C2 : A s/V = 2
        param R1 : V/A = 1
        param R2 : V/A = 3
        state u1 : V = 0
        state u2 : V = 0
        var i : A
        eq C1*d/dt u1 = i - u1/R1
        eq C2*d/dt u2 = i - u2/R2
        eq u1 + u2 = sin(t/1[s])*1[V]";
    ends_at(text, 2.0, &[("u1", 0.415_776_946_904), ("u2", 0.493_520_479_922), ("i", 0.054_589_015_785)], 1e-7);
}

#[test]
fn perfect_level_control_determines_the_outflow() {
    let text = "param A : m^2 = 2
        param set : m = 1
        state h : m = 1
        state c : mol/m^3 = 0
        var F : m^3/s
        var q : m^3/s
        eq F = (1 + 0.5*sin(t/1[s]))*1[m^3/s]
        eq d/dt (A*h) = F - q
        eq d/dt (A*h*c) = F*3[mol/m^3] - q*c
        eq h = set";
    ends_at(text, 3.0, &[("c", 2.592_977_102_326), ("q", 1.070_560_004_030), ("h", 1.0)], 1e-7);
}

#[test]
fn a_sum_of_amounts_kept_with_all_balances_determines_the_flow() {
    let text = "param k : 1/s = 0.7
        state n1 : mol = 1
        state n2 : mol = 2
        state n3 : mol = 3
        var w : mol/s
        eq d/dt n1 = 1[mol/s] - k*n1 - w*n1/6[mol]
        eq d/dt n2 = k*n1 - w*n2/6[mol]
        eq d/dt n3 = 2[mol/s] - w*n3/6[mol]
        eq n1 + n2 + n3 = 6[mol]";
    ends_at(text, 4.0, &[("n1", 0.834_704_96), ("n2", 1.300_630_33), ("n3", 3.864_664_72), ("w", 3.0)], 1e-7);
}

/// Gas at constant pressure: with bounds the temperature follows, without them both states are
/// projected.
#[test]
fn an_energy_balance_of_a_product_keeps_the_pressure() {
    for bounds in ["", " in 200..500"] {
        let text = format!(
            "param R : J/mol/K = 8.314462618
            state n : mol = 0.40090786018  in 0.001..10
            state T : K = 300{bounds}
            var w : mol/s
            eq d/dt n = 0.5[mol/s] - w
            eq d/dt (n*2.5*R*T) = 0.5[mol/s]*3.5*R*300[K] + 200[W] - w*3.5*R*T
            eq n*R*T = 1000[J]"
        );
        ends_at(&text, 10.0, &[("n", 0.383_343_827), ("T", 313.745_381), ("w", 0.500_000_05)], 1e-6);
    }
}

#[test]
fn two_masses_on_a_rod_move_as_one() {
    let text = "state a : m = 0
        state b : m = 1
        state u : m/s = 0
        state v : m/s = 0
        var f : N
        eq d/dt a = u
        eq d/dt b = v
        eq 1[kg]*d/dt u = sin(t/1[s])*1[N] - f
        eq 2[kg]*d/dt v = f - 0.3[N s/m]*v
        eq b - a = 1[m]";
    let expected = [("a", 0.874_487_47), ("b", 1.874_487_47), ("u", 0.575_882_09), ("f", 0.151_668_213_891)];
    ends_at(text, 3.0, &expected, 1e-7);
}

/// z^3 + z = x with x' = -x: z' = -x/(3 z^2 + 1).
#[test]
fn the_rate_of_a_variable_of_an_implicit_equation_is_found() {
    let text = "state x = 2
        var z = 1
        var r : 1/s
        eq d/dt x = -x/1[s]
        eq z^3 + z = x
        eq r = der(z)";
    ends_at(text, 1.5, &[("z", 0.387_896_141_544), ("r", -0.307_470_937_148)], 1e-7);
}

/// rho*V grows by 1.5 t^2 where rho falls by 10 a second.
#[test]
fn the_slope_of_a_table_enters_the_rate_of_a_product() {
    let text = "table rho over t : s linear { 0: 1000, 10: 900, 20: 950 }
        state V : m^3 = 1
        eq d/dt (rho(t)*V) = 3[m^3/s]*t/1[s]";
    ends_at(text, 3.0, &[("V", (1000.0 + 13.5) / 970.0)], 1e-7);
}

fn chain(count: u32) -> String {
    format!(
        "set k = 1..{count}
        set j = 1..{}
        param F : mol/s = 1
        state n[i in k] : mol = 1
        var p[k] : mol
        var w[j] : mol/s
        eq d/dt n[1] = F - w[1]
        eq d/dt n[i] = w[i-1] - w[i] for i in 2..{}
        eq d/dt n[{count}] = w[{}]
        eq p[i] = n[i]*2 for i in k
        eq p[i] = p[i+1] for i in 1..{}",
        count - 1,
        count - 1,
        count - 1,
        count - 1
    )
}

/// All amounts are 1 + t/count, and what flows on from vessel i is 1 - i/count.
#[test]
fn a_chain_of_vessels_stays_a_loop() {
    let code = |count: u32| {
        let environment = environment(&chain(count), Method::Auto, (1.0, 1));
        environment.setup().model().statistics().code_bytes
    };
    assert!(code(400) < 2 * code(40), "{} and {} bytes", code(40), code(400));
    let expected = [("n[1]", 1.075), ("n[40]", 1.075), ("w[10]", 0.75)];
    ends_at(&chain(40), 3.0, &expected, 1e-9);
}

#[test]
fn states_of_an_array_keep_their_names() {
    let mut environment = environment(&chain(40), Method::Auto, (1.0, 1));
    environment.reset(Some(0), &ResetOptions::default()).expect("a start");
    let catalogue = environment.catalogue();
    assert_eq!(catalogue.states.names().collect::<Vec<_>>(), ["n[1]"]);
    assert!(catalogue.algebraics.find("n[2]").is_some() && catalogue.algebraics.find("n[40]").is_some());
    assert!(catalogue.algebraics.find("n[1]").is_none());
}

/// Pressures of all vessels equal to one that nothing else gives: n[i] = 1 + t/count for all of
/// them.
#[test]
fn a_common_unknown_pressure_is_determined_with_the_flows() {
    let text = "set k = 1..20
        state n[i in k] : mol = 1
        var w[k] : mol/s
        var P : mol
        eq d/dt n[i] = w[i] for i in k
        eq n[i] = P for i in k
        eq sum(w[i] for i in k) = 1[mol/s]";
    ends_at(text, 2.0, &[("w[3]", 0.05), ("P", 1.1), ("n[20]", 1.1), ("n[1]", 1.1)], 1e-9);
}

#[test]
fn a_preferred_state_stays_one() {
    let text = VESSELS.replace("n2 : mol = 2", "n2 : mol = 2 prefer");
    let environment = environment(&text, Method::Auto, (3.0, 1));
    assert_eq!(environment.catalogue().states.names().collect::<Vec<_>>(), ["n2"]);
    let text = pendulum(9.81, "x^2 + y^2 = 1 [m^2]").replace("y : m = 0", "y : m = 0 prefer");
    let environment = self::environment(&text, Method::Auto, (0.1, 1));
    assert_eq!(environment.catalogue().states.len(), 2);
}

/// Fractions of 24 cells of three kinds: x = 1/3 all along where nothing but the sum is fed.
#[test]
fn sums_of_fractions_over_cells_are_kept() {
    let text = "set s = {a, b, c}
        domain z in 0..1 cells 24
        state x[s, z] = 1/3
        var w[z] : 1/s
        eq d/dt x[a, z] = 0.3/1[s] - w[z]*x[a, z] for z
        eq d/dt x[b, z] = 0.2/1[s] - w[z]*x[b, z] for z
        eq d/dt x[c, z] = 0.1/1[s] - w[z]*x[c, z] for z
        eq sum(x[i, z] for i in s) = 1 for z";
    let end = (-0.6_f64 * 2.0).exp();
    let expected = [("w[5]", 0.6), ("x[a,7]", 0.5 - end / 6.0), ("x[c,24]", 1.0 / 6.0 + end / 6.0)];
    ends_at(text, 2.0, &expected, 1e-7);
}

/// Numbers between -1 and 1, the same ones in every run.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn matrix(&mut self, rows: usize, columns: usize) -> Vec<Vec<f64>> {
        (0..rows).map(|_| (0..columns).map(|_| self.next()).collect()).collect()
    }
}

/// x' = A x + B z + sin(x) + e cos t with C x = 0, of index 2 where C B is regular.
struct Constrained {
    a: Vec<Vec<f64>>,
    b: Vec<Vec<f64>>,
    c: Vec<Vec<f64>>,
    e: Vec<f64>,
}

impl Constrained {
    fn random(numbers: &mut Numbers, n: usize, m: usize) -> Self {
        let (a, mut b, c) = (numbers.matrix(n, n), numbers.matrix(n, m), numbers.matrix(m, n));
        // C B stays far from singular.
        for (j, row) in c.iter().enumerate() {
            b.iter_mut().zip(row).for_each(|(b, c)| b[j] = 0.3 * b[j] + 2.0 * c);
        }
        let e = (0..n).map(|_| numbers.next()).collect();
        Self { a, b, c, e }
    }

    fn text(&self) -> String {
        let (n, m) = (self.a.len(), self.c.len());
        let sum = |row: &[f64], name: &str| row.iter().enumerate().map(|(j, x)| format!(" + ({x})*{name}{j}")).collect::<String>();
        let mut text: String = (0..n).map(|i| format!("state x{i} = 0\n")).chain((0..m).map(|j| format!("var z{j}\n"))).collect();
        for i in 0..n {
            let (own, forced) = (sum(&self.a[i], "x"), sum(&self.b[i], "z"));
            text += &format!("eq 1[s]*d/dt x{i} = sin(x{i}) + ({})*cos(t/1[s]){own}{forced}\n", self.e[i]);
        }
        for row in &self.c {
            text += &format!("eq 0{} = 0\n", sum(row, "x"));
        }
        text
    }

    /// The rates with the multipliers worked out by elimination, and these.
    fn rates(&self, t: f64, x: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let free: Vec<f64> = (0..x.len()).map(|i| dot(&self.a[i], x) + x[i].sin() + self.e[i] * t.cos()).collect();
        let column = |j: usize| self.b.iter().map(|row| row[j]).collect::<Vec<_>>();
        let m = self.c.len();
        let mut system: Vec<Vec<f64>> =
            self.c.iter().map(|row| (0..m).map(|j| dot(row, &column(j))).chain([-dot(row, &free)]).collect()).collect();
        for k in 0..m {
            let pivot = (k..m).max_by(|&i, &j| system[i][k].abs().total_cmp(&system[j][k].abs())).unwrap();
            system.swap(k, pivot);
            for i in (0..m).filter(|&i| i != k) {
                let factor = system[i][k] / system[k][k];
                let row = system[k].clone();
                system[i].iter_mut().zip(row).skip(k).for_each(|(x, y)| *x -= factor * y);
            }
        }
        let z: Vec<f64> = (0..m).map(|k| system[k][m] / system[k][k]).collect();
        (free.iter().zip(&self.b).map(|(f, b)| f + dot(b, &z)).collect(), z)
    }

    /// The classical method of Runge and Kutta on the reduced form.
    fn reference(&self, time: f64) -> (Vec<f64>, Vec<f64>) {
        const STEPS: u32 = 4000;
        let h = time / f64::from(STEPS);
        let mut x = vec![0.0; self.a.len()];
        for step in 0..STEPS {
            let t = h * f64::from(step);
            let moved = |k: &[f64], by: f64| x.iter().zip(k).map(|(x, k)| x + by * k).collect::<Vec<_>>();
            let k1 = self.rates(t, &x).0;
            let k2 = self.rates(t + h / 2.0, &moved(&k1, h / 2.0)).0;
            let k3 = self.rates(t + h / 2.0, &moved(&k2, h / 2.0)).0;
            let k4 = self.rates(t + h, &moved(&k3, h)).0;
            x = (0..x.len()).map(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])).collect();
        }
        let z = self.rates(time, &x).1;
        (x, z)
    }
}

/// Two states that exchange along an unknown rate: 2 a - b = 0.2 t for every rate.
fn bound(declarations: &str, equation: &str) -> String {
    format!("{declarations}\nstate a = 1\nstate b = 2\nvar w : 1/s\neq d/dt a = 0.1 [1/s] + w\neq d/dt b = w*2\n{equation}")
}

fn refusal(text: &str) -> String {
    let text = format!("model M\ntime t : s\nepisode {{ step = 3 [s], max_steps = 1 }}\n{text}\n");
    let loaded = load_text(Path::new("m.eq"), text.clone(), &LoadOptions::default());
    loaded.err().map_or_else(|| panic!("accepted: {text}"), |error| format!("{error:?}"))
}

/// At a jump only the state that follows would move. With a + b from 3 to 5 that gave a = 1.2 and
/// b = 3.8 after 3 s, but the balance 2 a - b = 0.6 demands a = 5.6/3.
#[test]
fn a_constraint_that_jumps_is_refused_with_the_place_of_the_jump() {
    let long: Vec<String> = (0..40).map(|i| format!("{i}: {}", 3 + i % 2)).collect();
    let cases = [
        ("table h over time : s step { 0: 3, 2: 5 }", "eq a + b = h(t)", "`t` is 2 s"),
        ("table h over time : s from { 0: 3, 2: 5 }", "eq a + b = h(t)", "`t` is 2 s"),
        ("table h over time : s until { 2: 3, 4: 5 }", "eq a + b = h(t)", "`t` is 2 s"),
        (&format!("table h over time : s step {{ {} }}", long.join(", ")), "eq a + b = h(t)", "`t` is 1 s"),
        ("table h over time : s linear outside cyclic { 0: 3, 2: 5 }", "eq a + b = h(t)", "`t` is 2 s"),
        ("", "eq a + b = 3 + floor(t/(1 [s]))", "`t` is 1 s"),
        ("", "eq a + b = 3 + ceil(t/(1 [s]))", "`t` is 1 s"),
        ("", "eq a + b = 3 + round(t/(1 [s]))", "`t` is 0.5 s"),
        ("", "eq a + b = 3 + mod(t/(1 [s]), 2)", "`t` is 2 s"),
        ("", "eq a + b = 3 + sign(t/(1 [s]) - 1)", "`t` is 1 s"),
        ("", "eq a + b = 3 + sign(a - 1.5)", "`a` is 1.5"),
        ("", "eq a + b = if t < 2 [s] then 3 else 5", "`t` is 2 s"),
        ("", "eq a + b = if a > 1.05 then 3.5 else 3", "`a` is 1.05"),
        ("param k = 3", "eq a + b = if 2*a > 2.5 then k*a else k", "`a` is 1.25"),
        ("", "eq a + b = 3 + sum(floor(t/(1 [s]) + i) for i in 1..3)", "`t` is"),
    ];
    for (declarations, equation, place) in cases {
        let found = refusal(&bound(declarations, equation));
        for part in ["E0503", "this equation has to be differentiated, but it jumps", place] {
            assert!(found.contains(part), "{declarations} {equation}: no {part} in {found}");
        }
    }
}

/// With a + b = s: a = (s + 0.2 t)/3, since 2 a - b = 0.2 t.
#[test]
fn a_constraint_with_kinks_only_is_accepted() {
    let cases = [
        ("table h over time : s linear { 0: 3, 1: 3, 2: 5 }", "eq a + b = h(t)", 5.0),
        ("table h over time : s cubic { 0: 3, 1: 4, 2: 3, 3: 5 }", "eq a + b = h(t)", 5.0),
        ("table h over time : s linear outside cyclic { 0: 3, 1: 5, 2: 3 }", "eq a + b = h(t)", 5.0),
        ("", "eq a + b = max(3, 1 + t/(1 [s]))", 4.0),
        ("", "eq a + b = 4 - abs(t/(1 [s]) - 1) + min(0, 2 - t/(1 [s]))", 1.0),
        ("", "eq a + b = if t < 1 [s] then 3 else 2 + t/(1 [s])", 5.0),
        ("param k = 2", "eq a + b = if k*t > k*1 [s] then 2 + t/(1 [s]) else 3", 5.0),
        ("", "eq a + b = 4 + sign(t/(1 [s]) - 1)*abs(t/(1 [s]) - 1)", 6.0),
    ];
    for (declarations, equation, sum) in cases {
        let a = (sum + 0.6) / 3.0;
        ends_at(&bound(declarations, equation), 3.0, &[("a", a), ("b", sum - a)], 1e-7);
    }
}

#[test]
fn random_constrained_systems_follow_their_reduced_forms() {
    let mut numbers = Numbers(7);
    for (case, (n, m)) in
        [(2, 1), (3, 1), (3, 2), (4, 1), (4, 2), (4, 3), (5, 2), (5, 4), (6, 1), (6, 3), (7, 2), (8, 5)].into_iter().enumerate()
    {
        let system = Constrained::random(&mut numbers, n, m);
        let (x, z) = system.reference(1.5);
        for (method, steps) in [(Method::Ida, 1), (Method::Rosenbrock, 9), (Method::Auto, 1)] {
            let found = run(&system.text(), method, (1.5, steps));
            let pairs = x.iter().enumerate().map(|(i, x)| (format!("x{i}"), *x));
            for (name, value) in pairs.chain(z.iter().enumerate().map(|(j, z)| (format!("z{j}"), *z))) {
                let one = found[&name];
                assert!((one - value).abs() < 2e-6 * value.abs().max(1.0), "case {case}, {method}: {name} = {one}, not {value}");
            }
        }
    }
}

/// V*h is 1 + t: at 2 s V would have to jump from 3 to 1.5.
#[test]
fn a_rate_of_an_expression_that_jumps_is_refused_with_its_place() {
    let cases = [
        ("table h over t : s step { 0: 1, 2: 2 }\nstate V = 1\neq d/dt (V*h(t)) = 1 [1/s]", "where `t` is 2 s"),
        ("state V = 1\nvar q\neq q = if t > 2 [s] then 2 else 1\neq d/dt (V*q) = 1 [1/s]", "where `t` is 2 s"),
        ("state V = 1\neq d/dt (V*(1 + floor(t/2 [s]))) = 1 [1/s]", "where `t` is 2 s"),
        ("state V = 1\neq d/dt (V*(1 + mod(t, 2 [s])/1 [s])) = 1 [1/s]", "where `t` is 2 s"),
        ("action u = 1 in 0..10\nstate V = 1\nvar q\neq q = u*2\neq d/dt (V*q) = 1 [1/s]", "`u` in it is an action"),
        ("state V = 1\nstate x = 1\neq d/dt x = -x/1 [s]\neq d/dt (V*(1 + previous(x))) = 1 [1/s]", "value of the step before"),
        ("param c = 0 ~ uniform(0, 1)\nstate V = 1\neq d/dt (V*(if t > 1.5 [s] then 1 + c else 1)) = 1 [1/s]", "where `t` is 1.5 s"),
    ];
    for (text, part) in cases {
        let refused = refusal(text);
        assert!(refused.contains(part), "{text}: {refused}");
    }
}

/// V*h is 1 + t with h = min(1 + t, 3), so that V is 1 until 2 s and 4/3 at 3 s.
#[test]
fn a_rate_of_an_expression_with_a_kink_follows_its_balance() {
    let text = "table h over t : s linear { 0: 1, 2: 3, 4: 3 }\nstate V = 1\neq d/dt (V*h(t)) = 1 [1/s]";
    for method in [Method::Ida, Method::Auto] {
        for steps in [1, 7] {
            let end = run(text, method, (3.0, steps))["V"];
            assert!((end - 4.0 / 3.0).abs() < 1e-6, "{method}, {steps} steps: {end}");
        }
    }
}

/// a = 1 + t/15 and b = 2 - t/15, so that a passes 1.05 at 0.75 s, where the sum jumps by c.
#[test]
fn a_jump_that_depends_on_a_parameter_ends_the_episode_where_it_happens() {
    let text = |c: f64| {
        format!(
            "param c = {c} ~ uniform(-0.5, 0.5)\nstate a = 1\nstate b = 2\nvar w : 1/s\neq d/dt a = 0.1 [1/s] + w\neq d/dt b = 2*w\n\
             eq a + b = if a > 1.05 then 3 + c else 3"
        )
    };
    for method in METHODS {
        for steps in [1, 7] {
            let end = |c: f64| {
                let mut environment = environment(&text(0.0), method, (3.0, steps));
                let options = ResetOptions { parameters: [("c".to_owned(), c)].into(), ..ResetOptions::default() };
                environment.reset(Some(0), &options).expect("a start");
                while environment.is_running() {
                    environment.step(&[]).expect("a step");
                }
                (environment.time(), environment.failure_message(), values(&environment)["a"])
            };
            let (time, message, _) = end(0.25);
            assert!((time - 0.75).abs() < 1e-6 && message.starts_with("jump_by_a: "), "{method}, {steps}: {time} {message}");
            let (_, message, a) = end(0.0);
            assert!(message.is_empty() && (a - 1.2).abs() < 1e-9, "{method}, {steps}: {a} {message}");
        }
    }
}

/// The conditions hold together from b = 1.5 on only, and b is above: the sum jumps at a = 1.05.
#[test]
fn a_jump_behind_two_conditions_ends_the_episode() {
    let text = "state a = 1\nstate b = 2\nvar w : 1/s\neq d/dt a = 0.1 [1/s] + w\neq d/dt b = 2*w\n\
                eq a + b = if a > 1.05 and b > 1.5 then 3.1 else 3";
    for method in METHODS {
        let mut environment = environment(text, method, (3.0, 4));
        environment.reset(Some(0), &ResetOptions::default()).expect("a start");
        while environment.is_running() {
            environment.step(&[]).expect("a step");
        }
        let message = environment.failure_message();
        assert!((environment.time() - 0.75).abs() < 1e-6 && message.starts_with("jump_by_a: "), "{method}: {message}");
    }
}

/// The factor is zero until 20 s, as wherever the forms of the switch are tried. Until then a' is
/// 0.001/1.5, then (0.15 + 0.002)/3, by which a passes 1.05 at 20 s + 11/15.2 s.
#[test]
fn a_jump_with_a_factor_that_is_zero_elsewhere_ends_the_episode() {
    let text = "state a = 1\nstate b = 2\nstate k = 0\nvar w : 1/s\neq d/dt k = 1 [1/s]\n\
                eq d/dt a = 0.001 [1/s] + w\neq d/dt b = 2*w\n\
                eq a + b = 3 + (if a > 1.05 then 1 else 0.15)*max(k - 20, 0)";
    for method in METHODS {
        for steps in [1, 7] {
            let mut environment = environment(text, method, (30.0, steps));
            environment.reset(Some(0), &ResetOptions::default()).expect("a start");
            while environment.is_running() {
                environment.step(&[]).expect("a step");
            }
            let (time, message) = (environment.time(), environment.failure_message());
            assert!((time - 20.0 - 11.0 / 15.2).abs() < 1e-5 && message.starts_with("jump_by_a: "), "{method}, {steps}: {time} {message}");
        }
    }
}

/// V*(1 + c*max(x - 1.5, 0)) = 1 + t with x = t and c = 0.5.
#[test]
fn an_expression_that_is_continuous_for_all_parameters_is_differentiated() {
    let text = "param c = 0.5\nstate x = 0\nstate V = 1\neq d/dt x = 1 [1/s]\n\
                eq d/dt (V*(if x > 1.5 then 1 + c*(x - 1.5) else 1)) = 1 [1/s]";
    for method in [Method::Ida, Method::Rosenbrock, Method::Explicit, Method::Auto] {
        for steps in [1, 7, 60] {
            let end = run(text, method, (3.0, steps))["V"];
            assert!((end - 4.0 / 1.75).abs() < 1e-6, "{method}, {steps} steps: {end}");
        }
    }
}

/// The expression is its value at the start plus t, with x = t.
#[test]
fn rates_behind_a_condition_without_a_rate_are_explicit() {
    let cases = [
        ("param a = 2", "V*(if a > 1 then 2 else 4)", 2.5),
        ("param a = 2", "if a > 1 then V*2 else 4*V + x", 2.5),
        ("param a = 0", "(if a > 1 then V*2 else 4*V + 2*x)/4", 4.0 - 1.5),
        ("", "V*(if x > 1.5 then 1 + (x - 1.5)^2 else 1)", 4.0 / 3.25),
        ("", "V*max(1, x - 0.5)", 4.0 / 2.5),
        ("", "V*(1 + abs(x - 1))", 5.0 / 3.0),
        ("table h over t : s linear { 0: 1, 2: 3, 4: 3 }", "V*h(t)", 4.0 / 3.0),
    ];
    for (declarations, expression, right) in cases {
        let text = format!("{declarations}\nstate x = 0\nstate V = 1\neq d/dt x = 1 [1/s]\neq d/dt ({expression}) = 1 [1/s]");
        for method in [Method::Ida, Method::Rosenbrock, Method::Explicit, Method::Auto] {
            for steps in [1, 7] {
                let end = run(&text, method, (3.0, steps))["V"];
                assert!((end - right).abs() < 1e-6, "{expression}, {method}, {steps} steps: {end}, not {right}");
            }
        }
    }
}

#[path = "index_reduction/corrections.rs"]
mod corrections;
