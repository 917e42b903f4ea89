//! The method that suits a system.

use super::resting::Resting;
use super::{Ida, Integrator, Method, OneStep, Settings, SolveError, System};

/// Unknowns up to which [`Method::Auto`] takes a one-step method whatever the factorisation.
/// Beyond, where that is a large part of a step, IDA takes less time for the same error
/// (`examples/methods.rs`).
const SMALL: usize = 200;

/// An integrator for systems of this one's dimension, pattern and counts, by the method of the
/// settings.
///
/// # Errors
/// A setting out of range, a pattern that does not fit, a system that the method does not take, or
/// SUNDIALS out of memory.
pub fn integrator(system: &dyn System, settings: Settings) -> Result<Box<dyn Integrator>, SolveError> {
    if system.differential().contains(&true) {
        by_method(system, settings)
    } else {
        Ok(Box::new(Resting::new(system, settings, by_method)?))
    }
}

fn by_method(system: &dyn System, settings: Settings) -> Result<Box<dyn Integrator>, SolveError> {
    Ok(match settings.method {
        Method::Ida => Box::new(Ida::new(system, settings)?),
        Method::Rosenbrock | Method::Explicit => Box::new(OneStep::new(system, settings)?),
        Method::Auto => suitable(system, settings)?,
    })
}

fn suitable(system: &dyn System, settings: Settings) -> Result<Box<dyn Integrator>, SolveError> {
    if system.is_explicit() {
        let one_step = OneStep::new(system, settings.clone())?;
        if system.dimension() <= SMALL || one_step.is_cheap() {
            return Ok(Box::new(one_step));
        }
    }
    Ok(Box::new(Ida::new(system, settings)?))
}

#[cfg(test)]
mod tests {
    use super::super::problems::{Problem, tubular_reactor};
    use super::super::{Advance, Pattern, Statistics};
    use super::*;

    const DENSE: usize = SMALL + 10;

    /// Unknowns that all depend on each other: y' = -y - the mean of y.
    fn mixed() -> Problem {
        let pattern = Pattern::full(DENSE);
        let rates = |_: f64, y: &[f64], yp: &[f64], _: &[f64], out: &mut [f64]| {
            let mean = y.iter().sum::<f64>() / y.len() as f64;
            out.iter_mut().zip(y.iter().zip(yp)).for_each(|(out, (y, yp))| *out = -y - mean - yp);
        };
        let jacobian = |_: f64, y: &[f64], cj: f64, _: &[f64], values: &mut [f64]| {
            let n = y.len();
            values.iter_mut().enumerate().for_each(|(at, value)| *value = -1.0 / n as f64 - if at % (n + 1) == 0 { 1.0 + cj } else { 0.0 });
        };
        Problem::ode((0..DENSE).map(|i| i as f64).collect(), vec![], pattern, rates, jacobian)
    }

    fn counts(mut problem: Problem, method: Method) -> Statistics {
        let settings = Settings { method, ..Settings::new(1e-6, vec![1e-8; problem.dimension()]) };
        let mut integrator = integrator(&problem, settings).expect("an integrator");
        let start = problem.start.clone();
        integrator.restart(&mut problem, 0.0, &start, None).expect("starts");
        assert_eq!(integrator.advance(&mut problem, 0.1), Ok(Advance::Reached));
        integrator.statistics()
    }

    #[test]
    fn large_systems_get_rosenbrock_steps_where_a_factorisation_is_cheap_and_ida_elsewhere() {
        let chain = counts(tubular_reactor(100), Method::Auto);
        // Eight substitutions a step; some of the steps may be explicit.
        assert_eq!((chain.factorisations > 0, chain.linear_solves), (true, 8 * chain.factorisations));
        let ida = counts(tubular_reactor(100), Method::Ida);
        assert_ne!(ida.linear_solves, 8 * ida.factorisations);
        assert_eq!(counts(mixed(), Method::Auto), counts(mixed(), Method::Ida));
        assert_ne!(counts(mixed(), Method::Ida), counts(mixed(), Method::Rosenbrock));
    }
}
