//! Return values of SUNDIALS' functions.

use std::os::raw::c_int;

use super::super::{IdaFlag, SolveError};

/// Turns the return value of a function of SUNDIALS into a result.
pub(crate) fn check(function: &'static str, value: c_int) -> Result<(), SolveError> {
    if value >= 0 {
        return Ok(());
    }
    Err(SolveError::Setup { function, flag: IdaFlag { value, message: String::new() } })
}
