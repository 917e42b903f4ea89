//! One-step methods against published reference values, closed solutions and SciPy.

use smpl_runtime::solver::problems::{self, Problem};
use smpl_runtime::solver::{
    Advance, Carried, Integrator, Method, OneStep, Pattern, RootKind, RootRole, Settings, SolveError, Statistics, System, integrator,
};

fn made(problem: &dyn System, method: Method, settings: Settings) -> OneStep {
    OneStep::new(problem, Settings { method, ..settings }).expect("settings are valid")
}

/// Integrates from the problem's start at time 0 to `t_end`.
fn integrate(problem: &mut Problem, method: Method, settings: Settings, t_end: f64) -> OneStep {
    let mut one = made(problem, method, settings);
    let start = problem.start.clone();
    one.restart(problem, 0.0, &start, None).expect("a consistent start exists");
    assert_eq!(one.advance(problem, t_end), Ok(Advance::Reached), "{method}");
    assert_eq!(one.time(), t_end);
    one
}

fn assert_close(found: &[f64], expected: &[f64], relative: f64) {
    assert_eq!(found.len(), expected.len());
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!((f - e).abs() <= relative * e.abs(), "entry {i}: {f} is not {e}");
    }
}

/// *Test Set for IVP Solvers*, release 2.4, problem ROBER, t = 1e11.
const ROBERTSON_1E11: [f64; 3] = [0.2083340149701255e-7, 0.8333360770334713e-13, 0.999999979166505];

#[test]
fn robertson_reaches_the_test_set_reference_at_1e11_with_an_algebraic_unknown_or_without() {
    for mut problem in [problems::robertson(), problems::robertson_dae()] {
        for method in [Method::Rosenbrock, Method::Auto] {
            let one = integrate(&mut problem, method, Settings::new(1e-8, vec![1e-14, 1e-18, 1e-14]), 1e11);
            assert_close(one.state(), &ROBERTSON_1E11, 1e-5);
            assert!(one.statistics().steps < 1100, "{:?}", one.statistics());
        }
    }
}

#[test]
fn van_der_pol_and_hires_reach_the_test_set_reference() {
    for method in [Method::Rosenbrock, Method::Auto] {
        let one = integrate(&mut problems::van_der_pol(), method, Settings::new(1e-8, vec![1e-10; 2]), 2.0);
        assert_close(one.state(), &[0.1706167732170483e1, -0.8928097010247975], 1e-6);
        assert!(one.statistics().steps < 4000, "{:?}", one.statistics());
        let one = integrate(&mut problems::hires(), method, Settings::new(1e-9, vec![1e-13; 8]), 321.8122);
        let reference = [
            0.7371312573325668e-3,
            0.1442485726316185e-3,
            0.5888729740967575e-4,
            0.1175651343283149e-2,
            0.2386356198831331e-2,
            0.6238968252742796e-2,
            0.2849998395185769e-2,
            0.2850001604814231e-2,
        ];
        assert_close(one.state(), &reference, 1e-6);
        assert!(one.statistics().steps < 1750, "{:?}", one.statistics());
    }
}

/// Distribution function of Erlang's distribution: 1 − e^{−x} Σ_{j<i} x^j / j!.
fn erlang(i: usize, x: f64) -> f64 {
    let (mut term, mut sum) = ((-x).exp(), 0.0);
    for j in 0..i {
        sum += term;
        term *= x / (j + 1) as f64;
    }
    1.0 - sum
}

#[test]
fn large_systems_use_the_sparse_linear_solvers() {
    let (n, t) = (1700, 0.3);
    let one = integrate(&mut problems::tanks_in_series(n), Method::Rosenbrock, Settings::new(1e-6, vec![1e-8; n]), t);
    for i in (0..n).step_by(10) {
        let expected = erlang(i + 1, n as f64 * t);
        assert!((one.state()[i] - expected).abs() < 1e-5, "tank {i}: {} is not {expected}", one.state()[i]);
    }
}

/// SciPy 1.17, `solve_ivp(method="DOP853", atol=1e-4*rtol)`: tolerance, evaluations and largest error of the end of Arenstorf's orbit, which is its start.
const SCIPY_ARENSTORF: [(f64, u64, f64); 4] = [(1e-4, 794, 0.1005), (1e-6, 1346, 6.05e-3), (1e-8, 2054, 4.79e-5), (1e-10, 3350, 4.92e-7)];

/// The same of predators and preys at t = 40, against a run at 3e-14.
const SCIPY_PREDATORS: [(f64, u64, f64); 4] = [(1e-4, 818, 7.28e-4), (1e-6, 1346, 6.68e-6), (1e-8, 2246, 7.28e-8), (1e-10, 3494, 4.87e-10)];
const PREDATORS_AT_40: [f64; 2] = [0.14887179971618394, 1.3142897493152266];

/// Error at the end over that of SciPy, and evaluations over its.
fn beside_scipy(problem: &Problem, exact: &[f64], end: f64, (rtol, evaluations, error): (f64, u64, f64)) -> [f64; 2] {
    let n = problem.dimension();
    let one = integrate(&mut problem.clone(), Method::Explicit, Settings::new(rtol, vec![1e-4 * rtol; n]), end);
    let found = one.state().iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    [found / error, one.statistics().residuals as f64 / evaluations as f64]
}

#[test]
fn orbits_take_no_more_evaluations_and_are_no_less_right_than_with_scipy() {
    let mut products = vec![];
    for case in SCIPY_ARENSTORF {
        let orbit = problems::arenstorf();
        products.push(beside_scipy(&orbit, &orbit.start, 17.065_216_560_157_964, case));
    }
    for case in SCIPY_PREDATORS {
        products.push(beside_scipy(&problems::predator_prey(), &PREDATORS_AT_40, 40.0, case));
    }
    eprintln!("{products:?}");
    // Errors scatter by a factor of a few at equal work.
    assert!(products.iter().all(|[error, evaluations]| *evaluations < 1.05 && *error < 3.0), "{products:?}");
    let mean = |k: usize| products.iter().map(|p| p[k].ln()).sum::<f64>() / products.len() as f64;
    assert!(mean(0) < 0.1 && mean(1) < 0.0, "{products:?}");
}

/// y' = −y, z = (y² + t)^(1/3).
fn slaved() -> Problem {
    Problem::ode(
        vec![1.0, 5.0],
        vec![],
        Pattern::full(2),
        |t, y, yp, _, out| {
            out[0] = -y[0] - yp[0];
            out[1] = y[0] * y[0] + t - y[1].powi(3);
        },
        |_, y, cj, _, j| j.copy_from_slice(&[-1.0 - cj, 2.0 * y[0], 0.0, -3.0 * y[1] * y[1]]),
    )
    .with_structure(vec![true, false], true)
}

#[test]
fn algebraic_unknowns_are_consistent_at_both_ends_and_so_are_derivatives() {
    let mut problem = slaved();
    let mut one = made(&problem, Method::Rosenbrock, Settings::new(1e-8, vec![1e-10; 2]));
    one.restart(&mut problem, 0.5, &[2.0, 40.0], None).expect("consistent");
    assert!((one.state()[1] - 4.5_f64.cbrt()).abs() < 1e-9);
    assert_eq!(one.derivative()[0], -2.0);
    one.advance(&mut problem, 1.5).expect("reaches the end");
    let y = 2.0 * (-1.0_f64).exp();
    let z = (y * y + 1.5).cbrt();
    assert_close(one.state(), &[y, z], 1e-7);
    // z' = (1 - 2 y²) / (3 z²).
    assert!((one.derivative()[1] - (1.0 - 2.0 * y * y) / (3.0 * z * z)).abs() < 1e-4, "{:?}", one.derivative());
    let residual = y_residual(one.state(), 1.5);
    assert!(residual.abs() < 1e-12, "{residual}");
}

fn y_residual(state: &[f64], t: f64) -> f64 {
    state[0] * state[0] + t - state[1].powi(3)
}

#[test]
fn what_a_method_does_not_take_is_refused_by_name() {
    let implicit = problems::robertson().with_structure(vec![true; 3], false);
    let settings = |method| Settings { method, ..Settings::new(1e-6, vec![1e-8; 3]) };
    for method in [Method::Rosenbrock, Method::Explicit] {
        assert_eq!(integrator(&implicit, settings(method)).err(), Some(SolveError::Implicit { method }));
    }
    assert_eq!(integrator(&problems::robertson_dae(), settings(Method::Explicit)).err(), Some(SolveError::Algebraic { unknown: 2 }));
    // What the others do not take is IDA's.
    assert!(integrator(&implicit, settings(Method::Auto)).is_ok());
}

#[test]
fn auto_takes_the_method_that_serves() {
    let one = integrate(&mut problems::arenstorf(), Method::Auto, Settings::new(1e-8, vec![1e-12; 4]), 17.0);
    assert_eq!(one.stepping(), Method::Explicit);
    let one = integrate(&mut problems::robertson(), Method::Auto, Settings::new(1e-8, vec![1e-14, 1e-18, 1e-14]), 1e6);
    assert_eq!(one.stepping(), Method::Rosenbrock);
    // Van der Pol's oscillator is mild for a while and stiff afterwards: none of the two alone is as cheap.
    let one = integrate(&mut problems::van_der_pol(), Method::Auto, Settings::new(1e-6, vec![1e-8; 2]), 2.0);
    assert_eq!(one.stepping(), Method::Rosenbrock);
}

/// A pendulum of small swings, x'' = -x from x = 0 at speed 1, with roots where it passes the lowest and half of the highest point.
struct Pendulum(Pattern);

impl System for Pendulum {
    fn differential(&self) -> &[bool] {
        &[true, true]
    }
    fn is_explicit(&self) -> bool {
        true
    }
    fn pattern(&self) -> &Pattern {
        &self.0
    }
    fn forcing_count(&self) -> usize {
        0
    }
    fn residual(&mut self, _: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[y[1] - yp[0], -y[0] - yp[1]]);
    }
    fn jacobian(&mut self, _: f64, _: &[f64], _: &[f64], cj: f64, values: &mut [f64]) {
        values.copy_from_slice(&[-cj, -1.0, 1.0, -cj]);
    }
    fn root_count(&self) -> usize {
        2
    }
    fn roots(&mut self, _: f64, y: &[f64], _: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[y[0], y[0] - 0.5]);
    }
    fn root_kinds(&self) -> &[RootKind] {
        const { &[RootKind { strict: false, both: true, role: RootRole::Event, bounded: false }; 2] }
    }
    fn quadrature_count(&self) -> usize {
        1
    }
    fn quadratures(&mut self, _: f64, y: &[f64], _: &[f64], out: &mut [f64]) {
        out[0] = y[1];
    }
}

#[test]
fn events_are_found_to_the_tolerance_in_steps_of_any_length() {
    let pi = std::f64::consts::PI;
    let exact = [(0.0, [1, 0]), (pi / 6.0, [0, 1]), (5.0 * pi / 6.0, [0, -1]), (pi, [-1, 0]), (2.0 * pi, [1, 0])];
    for method in [Method::Rosenbrock, Method::Explicit, Method::Auto] {
        for length in [0.1, 0.7, 10.0] {
            let mut pendulum = Pendulum(Pattern::full(2));
            let mut one = made(&pendulum, method, Settings::new(1e-8, vec![1e-10; 2]));
            let (mut t, mut state, mut found) = (0.0, vec![0.0, 1.0], vec![]);
            while t < 10.0 {
                let end = ((t / length + 1e-9_f64).floor() + 1.0) * length;
                one.restart(&mut pendulum, t, &state, None).expect("consistent");
                let before = state[0];
                if one.advance(&mut pendulum, end).expect("gets on") == Advance::Event {
                    found.push((one.time(), one.events().to_vec()));
                }
                // The integral of the speed is the way.
                assert!((one.quadratures()[0] - (one.state()[0] - before)).abs() < 1e-7);
                (t, state) = (one.time(), one.state().to_vec());
            }
            for ((t, found), (at, expected)) in found.iter().filter(|(_, events)| *events != [0, 0]).zip(exact) {
                assert!((t - at).abs() < 1e-7 && *found == expected, "{method} {length}: {t} {found:?}");
            }
            assert!(found.len() >= exact.len());
        }
    }
}

/// Control steps of the stirred tank, the coolant's temperature changed at each; what is carried is handed on by the caller.
fn tank(one: &mut OneStep, steps: std::ops::Range<u32>, mut state: Vec<f64>, mut carried: Carried) -> (Vec<f64>, Carried, Statistics) {
    let mut problem = problems::stirred_tank();
    let mut sum = Statistics::default();
    for step in steps {
        problem.inputs[0] = 295.0 + f64::from(step % 7);
        one.forget();
        one.carry(carried);
        one.restart(&mut problem, 0.0, &state, None).expect("consistent");
        one.advance(&mut problem, 0.1).expect("reaches the end");
        state.copy_from_slice(one.state());
        carried = one.carried();
        sum.steps += one.statistics().steps;
        sum.error_test_failures += one.statistics().error_test_failures;
    }
    (state, carried, sum)
}

#[test]
fn the_step_that_fits_is_carried_and_is_all_that_there_is_to_restore() {
    let start = problems::stirred_tank().start;
    for method in [Method::Rosenbrock, Method::Explicit, Method::Auto] {
        let new = || made(&problems::stirred_tank(), method, Settings::new(1e-8, vec![1e-10; 3]));
        let (whole, carried, _) = tank(&mut new(), 0..20, start.clone(), Carried::default());
        let (half, kept, _) = tank(&mut new(), 0..10, start.clone(), Carried::default());
        // Another instance, used for something else before, goes on with the same bits.
        let mut other = new();
        tank(&mut other, 3..9, start.clone(), Carried::default());
        assert_eq!(
            tank(&mut other, 10..20, half, kept),
            (whole, carried, tank(&mut new(), 10..20, tank(&mut new(), 0..10, start.clone(), Carried::default()).0, kept).2)
        );
        assert!(carried.step > 0.0);
    }
}

#[test]
fn a_limit_of_the_step_is_kept_and_many_small_ones_are_not_needed() {
    let mut settings = Settings::new(1e-6, vec![1e-8; 3]);
    settings.max_step = 0.01;
    let one = integrate(&mut problems::stirred_tank(), Method::Rosenbrock, settings.clone(), 1.0);
    assert!((100..=110).contains(&one.statistics().steps), "{:?}", one.statistics());
    settings.max_step = f64::INFINITY;
    let one = integrate(&mut problems::stirred_tank(), Method::Rosenbrock, settings, 1.0);
    assert!(one.statistics().steps < 20, "{:?}", one.statistics());
}
