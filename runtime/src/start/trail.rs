//! Record of the tries at one block.

/// One try.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tried {
    /// Method and guess.
    pub way: String,
    /// Iterations.
    pub iterations: u32,
    /// Largest residual at its end.
    pub residual: f64,
    /// It found a solution, which is outside of the bounds.
    pub solved: bool,
    /// Place in `y` of the unknown at the end of its bounds, or outside.
    pub at_bound: Option<usize>,
}

/// All that was tried.
#[derive(Default)]
pub(super) struct Trail {
    pub tried: Vec<Tried>,
    /// Solutions outside of the bounds.
    pub outside: Vec<Vec<f64>>,
    /// Point with the smallest equations, and that size.
    pub nearest: Option<(f64, Vec<f64>)>,
    /// The equations are not finite at the guess.
    pub not_finite: bool,
    /// Unknown whose column had no pivot at the guess.
    pub singular: Option<usize>,
}
