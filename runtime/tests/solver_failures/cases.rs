//! Failures are errors that say where and why; nothing hangs, prints or takes the process down.

use smpl_runtime::solver::problems::{self, Problem, Residual};
use smpl_runtime::solver::{Integrator, Method, Pattern, PatternError, Settings, SolveError, System, integrator};

/// The method: this module's name.
fn method() -> Method {
    module_path!().rsplit("::").next().and_then(Method::from_name).expect("the name of a method")
}

/// An integrator by it.
fn new(system: &dyn System, settings: Settings) -> Result<Box<dyn Integrator>, SolveError> {
    integrator(system, Settings { method: method(), ..settings })
}

/// A single unknown with y' = f.
fn scalar(start: f64, residual: Residual) -> Problem {
    Problem::ode(vec![start], vec![], Pattern::full(1), residual, |_, _, cj, _, j| j[0] = -cj)
}

fn fail(problem: &mut Problem, settings: Settings, t_end: f64) -> (SolveError, Box<dyn Integrator>) {
    let mut one = new(problem, settings).expect("valid");
    let start = problem.start.clone();
    let result = one.restart(problem, 0.0, &start, None).and_then(|()| one.advance(problem, t_end));
    (result.expect_err("must fail"), one)
}

#[test]
fn a_square_root_past_its_end_names_the_equation_that_is_not_finite() {
    // y' = -sqrt(y) from 1 reaches zero at t = 2 and would go on.
    let mut problem = scalar(1.0, |_, y, yp, _, out| out[0] = -(y[0] - 1e-3).sqrt() - 0.1 - yp[0]);
    let (error, one) = fail(&mut problem, Settings::new(1e-6, vec![1e-8]), 10.0);
    assert!(matches!(error, SolveError::NotFinite { row: 0, .. }), "{error:?}");
    // The time at which y = 1e-3: with s = sqrt(y - 1e-3), t = 2 (s - 0.1 ln(1 + s / 0.1)).
    let s = (1.0_f64 - 1e-3).sqrt();
    let end = 2.0 * (s - 0.1 * (1.0 + s / 0.1).ln());
    assert!((one.time() - end).abs() < 1e-3, "{} is not {end}", one.time());
    let (steps, residuals) = if method() == Method::Ida { (500, 2000) } else { (1000, 12_000) };
    assert!(one.statistics().steps < steps && one.statistics().residuals < residuals, "{:?}", one.statistics());
}

#[test]
fn a_solution_that_blows_up_ends_at_its_pole() {
    // y' = y² from 1 has its pole at t = 1.
    let mut problem = Problem::ode(
        vec![1.0],
        vec![],
        Pattern::full(1),
        |_, y, yp, _, out| out[0] = y[0] * y[0] - yp[0],
        |_, y, cj, _, j| j[0] = 2.0 * y[0] - cj,
    );
    let (error, one) = fail(&mut problem, Settings::new(1e-6, vec![1e-8]), 2.0);
    assert!((one.time() - 1.0).abs() < 1e-4, "{error:?} at {}", one.time());
}

#[test]
fn a_start_that_is_not_finite_is_refused_with_its_row() {
    let mut problem = scalar(-1.0, |_, y, yp, _, out| out[0] = y[0].ln() - yp[0]);
    let (error, _) = fail(&mut problem, Settings::new(1e-6, vec![1e-8]), 1.0);
    assert_eq!(error, SolveError::NotFinite { time: 0.0, row: 0 });
}

#[test]
fn the_step_limit_is_an_error_with_the_time_reached() {
    let mut problem = problems::van_der_pol();
    let mut settings = Settings::new(1e-8, vec![1e-10; 2]);
    settings.max_steps = 50;
    let (error, one) = fail(&mut problem, settings, 2.0);
    assert!(matches!(error, SolveError::TooManySteps { steps: 50, .. }), "{error:?}");
    assert!(one.time() > 0.0 && one.time() < 2.0);
}

#[test]
fn a_panic_in_the_model_is_an_error_and_the_integrator_can_be_restarted() {
    let mut problem = scalar(1.0, |t, _, yp, u, out| {
        assert!(t < 0.5 || !u.is_empty(), "on purpose");
        out[0] = 1.0 - yp[0];
    });
    let (error, mut one) = fail(&mut problem, Settings::new(1e-6, vec![1e-8]), 1.0);
    assert!(matches!(error, SolveError::Panicked { .. }), "{error:?}");
    problem.inputs.push(0.0);
    one.restart(&mut problem, 0.0, &[1.0], None).expect("consistent");
    one.advance(&mut problem, 1.0).expect("reaches the end");
    assert!((one.state()[0] - 2.0).abs() < 1e-9);
}

#[test]
fn a_singular_newton_matrix_is_an_error() {
    // 0 = y0 + y1 - 1 twice.
    let mut problem =
        Problem::ode(vec![0.5, 0.5], vec![], Pattern::full(2), |_, y, _, _, out| out.fill(y[0] + y[1] - 1.0), |_, _, _, _, j| j.fill(1.0))
            .with_structure(vec![false, false], true);
    if method() == Method::Explicit {
        let refused = new(&problem, Settings::new(1e-6, vec![1e-8; 2])).err();
        return assert_eq!(refused, Some(SolveError::Algebraic { unknown: 0 }));
    }
    let (error, _) = fail(&mut problem, Settings::new(1e-6, vec![1e-8; 2]), 1.0);
    assert!(matches!(error, SolveError::SingularJacobian { column: Some(1), .. }), "{error:?}");
}

#[test]
fn a_jacobian_that_is_not_finite_is_named_by_row_and_column() {
    let mut problem = Problem::ode(
        vec![0.0, 1.0],
        vec![],
        Pattern::full(2),
        |_, y, yp, _, out| out.copy_from_slice(&[y[0].sqrt() - yp[0], -y[1] - yp[1]]),
        |_, y, cj, _, j| j.copy_from_slice(&[0.5 / y[0].sqrt() - cj, 0.0, 0.0, -1.0 - cj]),
    );
    if method() == Method::Explicit {
        // It asks for no Jacobian, and zero stays where it is.
        let mut one = new(&problem, Settings::new(1e-6, vec![1e-8; 2])).expect("valid");
        one.restart(&mut problem, 0.0, &[0.0, 1.0], None).expect("finite");
        one.advance(&mut problem, 1.0).expect("reaches the end");
        return assert_eq!(one.state()[0], 0.0);
    }
    let (error, _) = fail(&mut problem, Settings::new(1e-6, vec![1e-8; 2]), 1.0);
    assert_eq!(error, SolveError::JacobianNotFinite { time: 0.0, row: 0, column: 0 });
}

#[test]
fn wrong_lengths_settings_and_intervals_are_refused() {
    let mut problem = problems::robertson();
    let refused = |settings| new(&problems::robertson(), settings).err();
    assert!(matches!(refused(Settings::new(1e-6, vec![1e-8; 2])), Some(SolveError::Settings { .. })));
    assert!(matches!(refused(Settings::new(f64::NAN, vec![1e-8; 3])), Some(SolveError::Settings { .. })));
    assert!(matches!(refused(Settings::new(1e-6, vec![0.0; 3])), Some(SolveError::Settings { .. })));
    let mut one = new(&problem, Settings::new(1e-6, vec![1e-8; 3])).expect("valid");
    assert_eq!(one.advance(&mut problem, 1.0), Err(SolveError::NotStarted));
    let short = one.restart(&mut problem, 0.0, &[1.0], None);
    assert_eq!(short, Err(SolveError::Length { name: "y", given: 1, expected: 3 }));
    one.restart(&mut problem, 1.0, &[1.0, 0.0, 0.0], None).expect("consistent");
    for end in [0.5, f64::NAN, f64::INFINITY, 1.0 + 1e-16 + f64::EPSILON] {
        assert!(matches!(one.advance(&mut problem, end), Err(SolveError::Interval { .. })), "{end}");
    }
}

#[test]
fn patterns_are_checked() {
    assert_eq!(Pattern::new(vec![0, 1], vec![1]), Err(PatternError::Rows { column: 0, dimension: 1 }));
    assert_eq!(Pattern::new(vec![0, 3], vec![0]), Err(PatternError::ColumnStarts { entries: 1 }));
    assert_eq!(Pattern::new(vec![0, 2, 2], vec![0, 0]), Err(PatternError::Rows { column: 0, dimension: 2 }));
    assert!(Pattern::new(vec![0, 2, 3], vec![0, 1, 1]).is_ok());
}
