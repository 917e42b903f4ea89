//! Structure analysis: which equation determines which unknown.
//!
//! 0. Loops that go across parts of an array that are defined one by one are cut there. Ranges of
//!    numbers over which algebraic variables are defined element by element are unrolled.
//! 1. Equations that are linear in one derivative are solved for it; derivatives on right sides are
//!    replaced by their rates. Combinations of rates that depend on each other become states.
//! 2. Explicit algebraic variables are substituted, unless keeping one as an unknown makes the
//!    Jacobian sparser, or it closes a loop.
//! 3. What is left is matched: implicit equations to unknowns without an equation. What cannot be
//!    matched is reported by name: unknowns that nothing determines, equations too many, and
//!    equations that bind states only (index above 1).
//! 4. Loops of equations that are singular whatever the numbers are refused.
//!
//! Equations over cells are treated as wholes; the work grows with the text, not with the grid.

mod algebraic;
mod combinations;
mod common;
mod cuts;
mod delays;
mod faults;
mod initial;
mod matching;
mod pade;
mod ports;
mod rates;
mod reads;
mod reduce;
mod repeats;
mod runs;
mod singular;
mod totals;
mod whole;

pub(crate) use algebraic::{plan as plan_algebraic, substitute as substitute_algebraic};
pub(crate) use combinations::combine as combine_rates;
pub(crate) use cuts::cut_at_parts;
pub(crate) use delays::drop_unused as drop_unused_delays;
pub(crate) use initial::order as order_initial;
pub(crate) use matching::rows as match_rows;
pub(crate) use pade::approximate as approximate_delays;
pub(crate) use ports::identify as identify_ports;
pub(crate) use rates::{cover_states, is_explicit, solve_for_derivatives, substitute_derivatives};
pub(crate) use reduce::watch_rates;
pub(crate) use repeats::settle as settle_repeats;
pub(crate) use runs::write_out as write_out_ranges;
pub(crate) use singular::refuse_singular_loops;
pub(crate) use totals::expand as expand_rates;
