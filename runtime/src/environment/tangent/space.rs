//! Space that steps with derivatives keep, so that they allocate nothing.

/// Before and behind an event or a break.
pub(super) const BEFORE: usize = 0;
pub(super) const BEHIND: usize = 1;

/// Numbers of the present event, break or solution.
#[derive(Default)]
pub(super) struct Space {
    /// Right side and solution for rates and algebraic unknowns.
    pub column: Vec<f64>,
    /// The unknowns before updates, or a little aside of the present time, with no rates.
    pub before: Vec<f64>,
    pub still: Vec<f64>,
    /// Conditions that became true.
    pub fired: Vec<usize>,
    /// Rates of the unknowns and integrands, before and behind.
    pub rates: [Vec<f64>; 2],
    pub integrands: [Vec<f64>; 2],
    /// Derivatives of the time of one condition along each direction, and of that of the next
    /// break.
    pub motion: Vec<f64>,
    pub next_break: Vec<f64>,
    /// Something jumps at the next break, as far as is known beforehand.
    pub jumps: bool,
    /// Cells of parameters and directions with the derivatives.
    pub columns: Vec<(usize, usize, f64)>,
}
