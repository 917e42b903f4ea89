//! The method that suits a system.

use super::{Ida, Integrator, Method, OneStep, Settings, SolveError, System};

/// Unknowns up to which [`Method::Auto`] takes a one-step method: beyond, a stiff control step takes IDA less time (`examples/methods.rs`).
const SMALL: usize = 200;

/// An integrator for systems of this one's dimension, pattern and counts, by the method of the settings.
///
/// # Errors
/// A setting out of range, a pattern that does not fit, a system that the method does not take, or SUNDIALS out of memory.
pub fn integrator(system: &dyn System, settings: Settings) -> Result<Box<dyn Integrator>, SolveError> {
    let one_step = match settings.method {
        Method::Ida => false,
        Method::Rosenbrock | Method::Explicit => true,
        Method::Auto => system.is_explicit() && system.dimension() <= SMALL,
    };
    Ok(if one_step { Box::new(OneStep::new(system, settings)?) } else { Box::new(Ida::new(system, settings)?) })
}
