//! The integrated system: the equations, as seen by the integrator.

use thiserror::Error;

use super::{Bounds, Nodes};

/// A system F(t, y, y') = 0 of `n` equations in `n` unknowns, index 1 at most.
///
/// Rows come in the order of the unknowns: row i is the equation of unknown i. Time and unknowns
/// are in the model's units. Functions may write NaN or infinity where the model is not defined;
/// the integrator then tries a smaller step. A panic in one of them ends the integration with
/// [`SolveError::Panicked`](super::SolveError::Panicked).
pub trait System {
    /// Number of unknowns, n.
    fn dimension(&self) -> usize {
        self.differential().len()
    }

    /// For each unknown, whether its derivative occurs. The others are algebraic.
    fn differential(&self) -> &[bool];

    /// Returns `true` if derivatives are given explicitly: F = f(t, y) − y' on differential rows,
    /// g(t, y) on algebraic ones.
    fn is_explicit(&self) -> bool;

    /// Bounds of the unknowns, where algebraic ones have any: where an integration begins, their
    /// solution is sought inside.
    fn bounds(&self) -> Option<&Bounds> {
        None
    }

    /// States that are never negative, by their places, rising. The other functions take such a
    /// state as zero where it is negative.
    fn nonnegative(&self) -> &[u32] {
        &[]
    }

    /// Structure of the Jacobian ∂F/∂y + c ∂F/∂y', of the leading unknowns where there are
    /// [`directions`](Self::directions).
    fn pattern(&self) -> &Pattern;

    /// Number of directions, k, along which derivatives of the leading n/(1 + k) unknowns are
    /// integrated with them. The other unknowns are a matrix of k columns, row after row, which
    /// obey [`following`](Self::following). 0 for other systems.
    fn directions(&self) -> usize {
        0
    }

    /// Returns `true` if an integrand reads derivatives of the unknowns.
    fn integrands_read_rates(&self) -> bool {
        true
    }

    /// Writes the residual of the leading unknowns, which are all if there are no directions.
    fn leading(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.residual(t, y, yp, out);
    }

    /// Writes the residual of the derivatives `s` along the directions, with rates `sp`: the sum of
    /// (∂F/∂y) s, (∂F/∂y') sp and the other moving terms. It is at leading unknowns y with rates
    /// y', and `jacobian` holds ∂F/∂y + `cj` ∂F/∂y'.
    fn following(&mut self, at: Following<'_>, (s, sp): (&[f64], &[f64]), out: &mut [f64]) {
        let _ = (at, s, sp, out);
    }

    /// Replaces the known part R of the derivatives' rates sp = `cj` s + R by −(∂F/∂y') R minus the
    /// other moving terms: the right-hand side for s with that Jacobian.
    fn moving(&mut self, at: Following<'_>, rates: &mut [f64]) {
        let _ = (at, rates);
    }

    /// Writes the integrands of the leading unknowns alone.
    fn leading_integrands(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.quadratures(t, y, yp, out);
    }

    /// Writes the derivatives of the integrands along the directions, row after row.
    fn following_integrands(&mut self, t: f64, y: (&[f64], &[f64]), s: (&[f64], &[f64]), out: &mut [f64]) {
        let _ = (t, y, s, out);
    }

    /// Writes F(t, y, y') to `out` (length n).
    fn residual(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]);

    /// Writes ∂F/∂y + `cj` ∂F/∂y' to `values`, in the order of [`pattern`](Self::pattern).
    fn jacobian(&mut self, t: f64, y: &[f64], yp: &[f64], cj: f64, values: &mut [f64]);

    /// The first time from `t` on at which the equations change their form, by a jump or a kink;
    /// otherwise infinite. [`advance`](super::Integrator::advance) stops there and begins anew
    /// behind it.
    fn next_break(&mut self, t: f64) -> f64 {
        let _ = t;
        f64::INFINITY
    }

    /// Returns `true` if time occurs in the equations.
    fn depends_on_time(&self) -> bool {
        true
    }

    /// Writes ∂F/∂t at given unknowns and rates to `out` (length n), as it is from `t` on; whether
    /// it is known. If not, it is taken by differences.
    fn by_time(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) -> bool {
        let _ = (t, y, yp, out);
        false
    }

    /// Number of [`forcings`](Self::forcings): 0 for a system in which time does not occur.
    fn forcing_count(&self) -> usize {
        self.dimension()
    }

    /// Writes everything that time itself moves to `out`, at given unknowns: the integrator looks
    /// at it all over an interval before it chooses its steps. By default the residual.
    fn forcings(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.residual(t, y, yp, out);
    }

    /// Number of root functions.
    fn root_count(&self) -> usize {
        0
    }

    /// Returns `true` if a root function looks at y'. If none does, the values given for y' are
    /// arbitrary.
    fn roots_use_derivatives(&self) -> bool {
        true
    }

    /// Kinds of the root functions, in their order; missing ones have the default kind.
    fn root_kinds(&self) -> &[RootKind] {
        &[]
    }

    /// Writes the root functions to `out`, positive where the condition holds:
    /// [`advance`](super::Integrator::advance) stops where one becomes true.
    fn roots(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let _ = (t, y, yp, out);
    }

    /// The unknowns that root functions read, rising. [`root_bounds`](Self::root_bounds) looks at
    /// no others.
    fn watched_unknowns(&self) -> &[u32] {
        &[]
    }

    /// Number of [`watched_inputs`](Self::watched_inputs); `None` where root functions and their
    /// bounds read the time or rates, too.
    fn watched_input_count(&self) -> Option<usize> {
        None
    }

    /// Writes what root functions and their bounds read besides unknowns to `out`.
    fn watched_inputs(&self, out: &mut [f64]) {
        let _ = out;
    }

    /// Writes bounds of the root functions to `out`, lower ones and then upper ones: from the first
    /// to the second time of `span`, and for unknowns from `least` to `most`. Returns whether they
    /// are known; if not, root functions are looked at only where steps end.
    fn root_bounds(&mut self, span: (f64, f64), least: &[f64], most: &[f64], out: &mut [f64]) -> bool {
        let _ = (span, least, most, out);
        false
    }

    /// Returns `true` if [`advance`](super::Integrator::advance) stops at jumps of the equations,
    /// too; otherwise it goes on behind them.
    fn reports_jumps(&self) -> bool {
        false
    }

    /// Returns `true` if the equations read what unknowns were at earlier times, which the system
    /// records itself by the functions that follow.
    fn has_past(&self) -> bool {
        false
    }

    /// The longest step in which the equations read nothing of the step itself.
    fn longest_step(&self) -> f64 {
        f64::INFINITY
    }

    /// The integration is about to begin anew behind a break.
    fn crosses(&mut self, at: f64) {
        let _ = at;
    }

    /// An integration begins at a time with these unknowns, which may not be consistent yet:
    /// forgets what was recorded later.
    fn begin(&mut self, t: f64, y: &[f64]) {
        let _ = (t, y);
    }

    /// An integration has begun, with consistent unknowns and rates, which tolerance `rtol` bounds.
    fn begun(&mut self, t: f64, y: &[f64], yp: &[f64], rtol: f64) {
        let _ = (t, y, yp, rtol);
    }

    /// Records an accepted step between two times, in which `within` writes unknowns and rates at
    /// any time.
    fn record(&mut self, span: (f64, f64), rtol: f64, within: Within<'_>) {
        let _ = (span, rtol, within);
    }

    /// Records an accepted step of the leading unknowns.
    fn record_leading(&mut self, span: (f64, f64), rtol: f64, within: Within<'_>) {
        self.record(span, rtol, within);
    }

    /// Records an accepted step of the derivatives along the directions, which have steps of their
    /// own.
    fn record_following(&mut self, nodes: &Nodes) {
        let _ = nodes;
    }

    /// Number of quadratures.
    fn quadrature_count(&self) -> usize {
        0
    }

    /// Writes the integrands to `out`: quadratures are their integrals since the last restart.
    fn quadratures(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let _ = (t, y, yp, out);
    }
}

/// Writes unknowns and rates at a time within a step.
pub type Within<'a> = &'a mut dyn FnMut(f64, &mut [f64], &mut [f64]);

/// Leading unknowns that derivatives follow, and their Jacobian.
#[derive(Clone, Copy)]
pub struct Following<'a> {
    /// Time.
    pub t: f64,
    /// Unknowns.
    pub y: &'a [f64],
    /// Their rates.
    pub yp: &'a [f64],
    /// Weight of the derivatives by rates in the Jacobian.
    pub cj: f64,
    /// Its entries.
    pub jacobian: &'a [f64],
}

/// Kind of a root function.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RootKind {
    /// The condition does not hold at zero.
    pub strict: bool,
    /// The integration stops where it ceases to hold as well.
    pub both: bool,
    /// Causes of stops.
    pub role: RootRole,
    /// [`System::root_bounds`] knows bounds of it.
    pub bounded: bool,
}

/// Causes of stops at a zero of a root function.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RootRole {
    /// An event.
    #[default]
    Event,
    /// A jump of the equations.
    Jump,
    /// A kink of the equations, which the error test of a step sees as long as the step meets both
    /// forms. The integration stops only where a step would have passed a form unseen. Kinks of one
    /// group look at one quantity.
    Kink {
        /// The group.
        group: u32,
    },
}

/// Structure of a square sparse matrix by compressed columns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    column_starts: Vec<usize>,
    rows: Vec<usize>,
}

/// An invalid pattern.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PatternError {
    /// `column_starts` must begin with 0, never fall and end with the number of rows given.
    #[error("column starts do not run from 0 to the number of entries, {entries}")]
    ColumnStarts {
        /// Number of entries.
        entries: usize,
    },
    /// Rows within a column must rise and be smaller than the dimension.
    #[error("rows of column {column} do not rise within 0..{dimension}")]
    Rows {
        /// The first invalid column.
        column: usize,
        /// Number of rows of the matrix.
        dimension: usize,
    },
}

impl Pattern {
    /// A pattern from its columns' beginnings (n + 1) and the row of each entry, rising within a
    /// column.
    pub fn new(column_starts: Vec<usize>, rows: Vec<usize>) -> Result<Self, PatternError> {
        let entries = rows.len();
        let bounded = column_starts.first() == Some(&0) && column_starts.last() == Some(&entries);
        if !bounded || !column_starts.is_sorted() {
            return Err(PatternError::ColumnStarts { entries });
        }
        let pattern = Self { column_starts, rows };
        let dimension = pattern.dimension();
        for column in 0..dimension {
            let rows = &pattern.rows[pattern.column(column)];
            let rise = rows.windows(2).all(|pair| pair[0] < pair[1]);
            if !rise || rows.last().is_some_and(|&row| row >= dimension) {
                return Err(PatternError::Rows { column, dimension });
            }
        }
        Ok(pattern)
    }

    /// The pattern of a full matrix.
    pub fn full(dimension: usize) -> Self {
        Self {
            column_starts: (0..=dimension).map(|column| column * dimension).collect(),
            rows: (0..dimension).flat_map(|_| 0..dimension).collect(),
        }
    }

    /// Number of rows and columns.
    pub fn dimension(&self) -> usize {
        self.column_starts.len() - 1
    }

    /// Number of entries.
    pub fn entries(&self) -> usize {
        self.rows.len()
    }

    /// Places of the entries of a column.
    pub fn column(&self, column: usize) -> std::ops::Range<usize> {
        self.column_starts[column]..self.column_starts[column + 1]
    }

    /// Beginning of each column, and the end of the last.
    pub(crate) fn column_starts(&self) -> &[usize] {
        &self.column_starts
    }

    /// Row of each entry.
    pub fn rows(&self) -> &[usize] {
        &self.rows
    }
}
