//! The integrator against published reference values and closed solutions.

use smpl_runtime::solver::problems::{self, Problem};
use smpl_runtime::solver::{
    Advance, Ida, Integrator, LinearMethod, LinearSolver, Pattern, Quadratures, RootKind, RootRole, Settings, SolveError, Statistics,
    System,
};

/// Integrates from the problem's start at time 0 to `t_end`.
fn integrate(problem: &mut Problem, settings: Settings, t_end: f64) -> Ida {
    let mut ida = Ida::new(problem, settings).expect("settings are valid");
    let start = problem.start.clone();
    ida.restart(problem, 0.0, &start, None).expect("a consistent start exists");
    assert_eq!(ida.advance(problem, t_end), Ok(Advance::Reached));
    assert_eq!(ida.time(), t_end);
    ida
}

fn assert_close(found: &[f64], expected: &[f64], relative: f64) {
    assert_eq!(found.len(), expected.len());
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!((f - e).abs() <= relative * e.abs(), "entry {i}: {f} is not {e}");
    }
}

fn assert_at_most(found: Statistics, bound: Statistics) {
    assert!(found.steps <= bound.steps, "{found:?}");
    assert!(found.residuals <= bound.residuals, "{found:?}");
    assert!(found.jacobians <= bound.jacobians, "{found:?}");
    assert!(found.error_test_failures <= bound.error_test_failures, "{found:?}");
}

/// Lawrence Livermore's IDA example idaRoberts_dns prints these to four digits at t = 40 and t = 4e10.
const ROBERTSON_40: [f64; 3] = [7.158e-1, 9.185e-6, 2.842e-1];

/// *Test Set for IVP Solvers*, release 2.4, problem ROBER, t = 1e11.
const ROBERTSON_1E11: [f64; 3] = [0.2083340149701255e-7, 0.8333360770334713e-13, 0.999999979166505];

#[test]
fn robertson_ode_reaches_the_test_set_reference_at_1e11() {
    let mut problem = problems::robertson();
    let settings = Settings::new(1e-8, vec![1e-14, 1e-18, 1e-14]);
    let ida = integrate(&mut problem, settings, 1e11);
    assert_close(ida.state(), &ROBERTSON_1E11, 2e-5);
    let bound = Statistics { steps: 2300, residuals: 2800, jacobians: 140, error_test_failures: 42, ..Default::default() };
    assert_at_most(ida.statistics(), bound);
}

#[test]
fn robertson_dae_reaches_the_test_set_reference_at_1e11_with_all_linear_solvers() {
    for (choice, method) in
        [(LinearSolver::Dense, LinearMethod::Dense), (LinearSolver::Block, LinearMethod::Block), (LinearSolver::Klu, LinearMethod::Klu)]
    {
        let mut problem = problems::robertson_dae();
        let mut settings = Settings::new(1e-8, vec![1e-14, 1e-18, 1e-14]);
        settings.linear_solver = choice;
        let ida = integrate(&mut problem, settings, 1e11);
        assert_eq!(ida.method(), method);
        assert_close(ida.state(), &ROBERTSON_1E11, 2e-5);
    }
}

#[test]
fn robertson_dae_agrees_with_the_published_example_at_40() {
    let mut problem = problems::robertson_dae();
    let ida = integrate(&mut problem, Settings::new(1e-6, vec![1e-8, 1e-14, 1e-6]), 40.0);
    assert_close(ida.state(), &ROBERTSON_40, 1e-3);
}

#[test]
fn van_der_pol_reaches_the_test_set_reference() {
    let mut problem = problems::van_der_pol();
    let ida = integrate(&mut problem, Settings::new(1e-8, vec![1e-10; 2]), 2.0);
    assert_close(ida.state(), &[0.1706167732170483e1, -0.8928097010247975], 1e-5);
    let bound = Statistics { steps: 3200, residuals: 4600, jacobians: 190, error_test_failures: 60, ..Default::default() };
    assert_at_most(ida.statistics(), bound);
}

#[test]
fn hires_reaches_the_test_set_reference() {
    let mut problem = problems::hires();
    let ida = integrate(&mut problem, Settings::new(1e-9, vec![1e-13; 8]), 321.8122);
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
    assert_close(ida.state(), &reference, 1e-5);
    let bound = Statistics { steps: 1550, residuals: 2050, jacobians: 75, error_test_failures: 28, ..Default::default() };
    assert_at_most(ida.statistics(), bound);
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
fn tanks_in_series_follow_erlangs_distribution() {
    // The exponential of -x underflows beyond x = 745, so that the time is chosen short.
    let (n, t) = (1700, 0.3);
    let mut problem = problems::tanks_in_series(n);
    let ida = integrate(&mut problem, Settings::new(1e-7, vec![1e-9; n]), t);
    assert_eq!(ida.method(), LinearMethod::Block);
    for i in (0..n).step_by(10) {
        let expected = erlang(i + 1, n as f64 * t);
        assert!((ida.state()[i] - expected).abs() < 2e-5, "tank {i}: {} is not {expected}", ida.state()[i]);
    }
}

#[test]
fn stirred_tank_rests_at_its_published_steady_state() {
    let mut problem = problems::stirred_tank();
    let ida = integrate(&mut problem, Settings::new(1e-8, vec![1e-10; 3]), 200.0);
    // Printed with three digits: c = 0.878 kmol/m3, T = 324.5 K, h = 0.659 m.
    assert_close(ida.state(), &[0.878, 324.5, 0.659], 1e-3);
}

#[test]
fn tubular_reactor_conserves_atoms_along_its_length() {
    // At steady state A + C and B + C are what the inlet brings in, 1 and 0.8.
    let mut problem = problems::tubular_reactor(100);
    let ida = integrate(&mut problem, Settings::new(1e-8, vec![1e-10; 400]), 30.0);
    for cell in ida.state().chunks_exact(4) {
        assert!((cell[0] + cell[2] - 1.0).abs() < 1e-6 && (cell[1] + cell[2] - 0.8).abs() < 1e-6);
    }
}

#[test]
fn jacobians_agree_with_difference_quotients() {
    let all = [
        problems::robertson(),
        problems::robertson_dae(),
        problems::van_der_pol(),
        problems::hires(),
        problems::stirred_tank(),
        problems::tanks_in_series(5),
        problems::tubular_reactor(3),
        problems::arenstorf(),
        problems::predator_prey(),
    ];
    for mut problem in all {
        let n = problem.dimension();
        let y: Vec<f64> = problem.start.iter().enumerate().map(|(i, y)| y + 0.1 + 0.01 * i as f64).collect();
        let (yp, cj) = (vec![0.5; n], 3.0);
        let mut values = vec![0.0; problem.pattern().entries()];
        problem.jacobian(0.0, &y, &yp, cj, &mut values);
        for column in 0..n {
            let (mut plus, mut minus) = (vec![0.0; n], vec![0.0; n]);
            let step = 1e-6 * (1.0 + y[column].abs());
            for (sign, out) in [(1.0, &mut plus), (-1.0, &mut minus)] {
                let (mut y, mut yp) = (y.clone(), yp.clone());
                y[column] += sign * step;
                yp[column] += sign * step * cj;
                problem.residual(0.0, &y, &yp, out);
            }
            let mut exact = vec![0.0; n];
            for entry in problem.pattern().column(column) {
                exact[problem.pattern().rows()[entry]] = values[entry];
            }
            let scale = exact.iter().fold(1.0, |m: f64, x| m.max(x.abs()));
            for row in 0..n {
                let quotient = (plus[row] - minus[row]) / (2.0 * step);
                assert!((exact[row] - quotient).abs() < 1e-6 * scale, "row {row}, column {column}");
            }
        }
    }
}

/// y' = −y, z = y² + t: z follows the differential unknown and the time.
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
fn a_restart_makes_algebraic_unknowns_and_their_derivatives_consistent() {
    let mut problem = slaved();
    let mut ida = Ida::new(&problem, Settings::new(1e-8, vec![1e-10; 2])).expect("valid");
    ida.restart(&mut problem, 0.5, &[2.0, 40.0], None).expect("consistent");
    let z = 4.5_f64.cbrt();
    assert!((ida.state()[1] - z).abs() < 1e-9);
    assert_eq!(ida.derivative()[0], -2.0);
    ida.advance(&mut problem, 1.5).expect("reaches the end");
    let y = 2.0 * (-1.0_f64).exp();
    assert_close(ida.state(), &[y, (y * y + 1.5).cbrt()], 1e-6);
}

#[test]
fn an_unsolvable_algebraic_equation_is_an_error_of_the_restart() {
    let mut problem = Problem::ode(
        vec![1.0, 1.0],
        vec![],
        Pattern::full(2),
        |_, y, yp, _, out| {
            out[0] = -y[0] - yp[0];
            out[1] = y[1] * y[1] + 1.0;
        },
        |_, y, cj, _, j| j.copy_from_slice(&[-1.0 - cj, 0.0, 0.0, 2.0 * y[1]]),
    )
    .with_structure(vec![true, false], true);
    let mut ida = Ida::new(&problem, Settings::new(1e-6, vec![1e-8; 2])).expect("valid");
    let error = ida.restart(&mut problem, 0.0, &[1.0, 3.0], None).expect_err("there is no root");
    assert!(matches!(error, SolveError::InitialConditions { .. } | SolveError::SingularJacobian { .. }), "{error}");
    assert_eq!(ida.advance(&mut problem, 1.0), Err(SolveError::NotStarted));
}

#[test]
fn an_implicit_system_finds_its_derivatives() {
    // 2 y0' + y1' = -3 y0, y0' + y1' = -2 y0 + y2, 0 = y2 - y1 and therefore y0' = -y0 - y1 and y1' = -y0 + 2 y1.
    let mut problem = Problem::ode(
        vec![1.0, 0.5, 0.0],
        vec![],
        Pattern::full(3),
        |_, y, yp, _, out| {
            out[0] = 2.0 * yp[0] + yp[1] + 3.0 * y[0];
            out[1] = yp[0] + yp[1] + 2.0 * y[0] - y[2];
            out[2] = y[2] - y[1];
        },
        |_, _, cj, _, j| j.copy_from_slice(&[2.0 * cj + 3.0, cj + 2.0, 0.0, cj, cj, -1.0, 0.0, -1.0, 1.0]),
    )
    .with_structure(vec![true, true, false], false);
    let mut ida = Ida::new(&problem, Settings::new(1e-9, vec![1e-11; 3])).expect("valid");
    let start = problem.start.clone();
    ida.restart(&mut problem, 0.0, &start, None).expect("consistent");
    assert!((ida.derivative()[0] + 1.5).abs() < 1e-6 && ida.derivative()[1].abs() < 1e-6);
    assert_close(&ida.state()[2..], &[0.5], 1e-6);
    ida.advance(&mut problem, 0.5).expect("reaches the end");
    // Closed solution of the 2 x 2 system: eigenvalues (1 ± √13) / 2, by the formula for its exponential.
    let (mean, root, t) = (0.5_f64, 13.0_f64.sqrt() / 2.0, 0.5);
    let (c, s) = ((root * t).cosh(), (root * t).sinh() / root);
    let e = (mean * t).exp();
    let exact = [e * (c * 1.0 + s * ((-1.0 - mean) * 1.0 - 0.5)), e * (c * 0.5 + s * (-1.0 + (2.0 - mean) * 0.5))];
    assert_close(&ida.state()[..2], &exact, 1e-6);
}

/// y' = inputs[0], with a root where y is 1 and an integral of y.
struct Ramp {
    pattern: Pattern,
    slope: f64,
}

impl System for Ramp {
    fn differential(&self) -> &[bool] {
        &[true]
    }
    fn is_explicit(&self) -> bool {
        true
    }
    fn pattern(&self) -> &Pattern {
        &self.pattern
    }
    fn residual(&mut self, _: f64, _: &[f64], yp: &[f64], out: &mut [f64]) {
        out[0] = self.slope - yp[0];
    }
    fn jacobian(&mut self, _: f64, _: &[f64], _: &[f64], cj: f64, values: &mut [f64]) {
        values[0] = -cj;
    }
    fn root_count(&self) -> usize {
        2
    }
    fn roots(&mut self, _: f64, y: &[f64], _: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[y[0] - 1.0, -2.0 - y[0]]);
    }
    fn root_kinds(&self) -> &[RootKind] {
        const { &[RootKind { strict: false, both: true, role: RootRole::Event, bounded: false }] }
    }
    fn quadrature_count(&self) -> usize {
        1
    }
    fn quadratures(&mut self, _: f64, y: &[f64], _: &[f64], out: &mut [f64]) {
        out[0] = y[0];
    }
}

#[test]
fn events_stop_with_their_direction_and_quadratures_begin_at_zero() {
    // A linear solution is stepped over at once, so that unchecked quadratures need a bound on the step.
    let checked = Quadratures::Checked { rtol: 1e-8, atol: 1e-10 };
    for (quadratures, max_step) in [(Quadratures::Unchecked, 1e-4), (checked, f64::INFINITY)] {
        let mut ramp = Ramp { pattern: Pattern::full(1), slope: 0.5 };
        let mut settings = Settings::new(1e-8, vec![1e-10]);
        settings.quadratures = quadratures;
        settings.max_step = max_step;
        settings.max_steps = 200_000;
        let mut ida = Ida::new(&ramp, settings).expect("valid");
        ida.restart(&mut ramp, 0.0, &[0.0], None).expect("consistent");
        assert_eq!(ida.advance(&mut ramp, 10.0), Ok(Advance::Event));
        assert_close(&[ida.time(), ida.state()[0], ida.quadratures()[0]], &[2.0, 1.0, 1.0], 1e-4);
        assert_eq!(ida.events(), &[1, 0]);
        ida.restart(&mut ramp, 2.0, &[1.0], None).expect("consistent");
        assert_eq!(ida.advance(&mut ramp, 4.0), Ok(Advance::Reached));
        assert_close(ida.quadratures(), &[3.0], 1e-4);
        ramp.slope = -1.0;
        ida.restart(&mut ramp, 4.0, &[2.0], None).expect("consistent");
        assert_eq!(ida.quadratures(), &[0.0]);
        assert_eq!(ida.advance(&mut ramp, 10.0), Ok(Advance::Event));
        assert_eq!(ida.events(), &[-1, 0]);
        assert_close(&[ida.time(), ida.quadratures()[0]], &[5.0, 1.5], 1e-4);
    }
}

/// A pendulum of small swings, x'' = -x from x = 0 at speed 1, and the integral of its speed. Roots are where it passes the lowest
/// and half of the highest point.
struct Pendulum {
    pattern: Pattern,
    /// Requires the derivatives for the root functions.
    looks_at_derivatives: bool,
}

impl System for Pendulum {
    fn differential(&self) -> &[bool] {
        &[true, true]
    }
    fn is_explicit(&self) -> bool {
        true
    }
    fn pattern(&self) -> &Pattern {
        &self.pattern
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
    fn roots_use_derivatives(&self) -> bool {
        self.looks_at_derivatives
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

impl Pendulum {
    fn swinging(looks_at_derivatives: bool) -> (Self, Ida) {
        let pendulum = Self { pattern: Pattern::full(2), looks_at_derivatives };
        let ida = Ida::new(&pendulum, Settings::new(1e-8, vec![1e-10; 2])).expect("valid");
        (pendulum, ida)
    }
}

/// Control steps of `length` up to t = 10; times, events and bits at their ends and at the events between.
fn swings(looks_at_derivatives: bool, length: f64) -> Vec<(f64, Vec<i32>, Vec<u64>)> {
    let (mut pendulum, mut ida) = Pendulum::swinging(looks_at_derivatives);
    let (mut t, mut state, mut found) = (0.0, vec![0.0, 1.0], vec![]);
    while t < 10.0 {
        let end = ((t / length + 1e-9).floor() + 1.0) * length;
        ida.restart(&mut pendulum, t, &state, None).expect("consistent");
        let outcome = ida.advance(&mut pendulum, end).expect("gets on");
        (t, state) = (ida.time(), ida.state().to_vec());
        let events = if outcome == Advance::Event { ida.events().to_vec() } else { vec![0, 0] };
        found.push((t, events, state.iter().chain(ida.quadratures()).map(|x| x.to_bits()).collect()));
    }
    found
}

#[test]
fn events_are_found_in_steps_of_any_length_and_the_same_with_derivatives() {
    for length in [0.1, 0.7, 10.0] {
        let found = swings(false, length);
        assert_eq!(found, swings(true, length));
        // sin t is at least 0 from the start on, 1/2 at π/6 and 5π/6, and 0 at π and 2π.
        let events: Vec<_> = found.iter().filter(|(_, events, _)| *events != [0, 0]).take(5).collect();
        let pi = std::f64::consts::PI;
        let exact = [(0.0, [1, 0]), (pi / 6.0, [0, 1]), (5.0 * pi / 6.0, [0, -1]), (pi, [-1, 0]), (2.0 * pi, [1, 0])];
        assert_eq!(events.len(), exact.len());
        for ((t, found, _), (at, expected)) in events.into_iter().zip(exact) {
            assert!((t - at).abs() < 1e-6 && *found == expected, "{t} {found:?}");
        }
    }
}

#[test]
fn events_are_watched_on_from_advance_to_advance() {
    let (mut pendulum, mut ida) = Pendulum::swinging(false);
    for expected in [Advance::Event, Advance::Reached] {
        // What holds at the start is an event there, once.
        ida.restart(&mut pendulum, 0.1, &[0.1_f64.sin(), 0.1_f64.cos()], None).expect("consistent");
        assert_eq!(ida.advance(&mut pendulum, 0.1), Ok(expected));
    }
    let mut end: f64 = 0.2;
    while ida.advance(&mut pendulum, end).expect("gets on") == Advance::Reached {
        assert!((ida.quadratures()[0] - (end.sin() - 0.1_f64.sin())).abs() < 1e-6);
        end += 0.1;
    }
    assert!((ida.time() - std::f64::consts::FRAC_PI_6).abs() < 1e-6);
    assert_eq!(ida.events(), &[0, 1]);
    // What was integrated before the event counts.
    assert!((ida.quadratures()[0] - (0.5 - 0.1_f64.sin())).abs() < 1e-6);
    let (t, state) = (ida.time(), ida.state().to_vec());
    assert!(ida.advance(&mut pendulum, 3.0).is_err(), "an event requires a restart");
    ida.restart(&mut pendulum, t, &state, None).expect("consistent");
    assert_eq!(ida.advance(&mut pendulum, 3.0), Ok(Advance::Event));
    assert!((ida.time() - 5.0 * std::f64::consts::FRAC_PI_6).abs() < 1e-6);
}

#[test]
fn klu_solves_systems_without_a_diagonal() {
    // y' = -z1, 0 = z2 - y, 0 = z1 - 2 z2: the algebraic rows are crosswise; y = exp(-2 t).
    let pattern = Pattern::new(vec![0, 2, 4, 6], vec![0, 1, 0, 2, 1, 2]).expect("a pattern");
    let mut problem = Problem::ode(
        vec![1.0, 0.0, 0.0],
        vec![],
        pattern,
        |_, y, yp, _, out| {
            out.copy_from_slice(&[-y[1] - yp[0], y[2] - y[0], y[1] - 2.0 * y[2]]);
        },
        |_, _, cj, _, j| j.copy_from_slice(&[-cj, -1.0, -1.0, 1.0, 1.0, -2.0]),
    )
    .with_structure(vec![true, false, false], true);
    let mut settings = Settings::new(1e-8, vec![1e-10; 3]);
    settings.linear_solver = LinearSolver::Klu;
    let ida = integrate(&mut problem, settings, 1.0);
    let y = (-2.0_f64).exp();
    assert_close(ida.state(), &[y, 2.0 * y, y], 1e-6);
}
