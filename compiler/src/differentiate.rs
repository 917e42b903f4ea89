//! Derivatives of expressions with respect to variables, as loops.
//!
//! Forward and symbolic: the derivative of a node is a list of terms, one for each element pattern
//! ([`Leaf`]) of the variables of interest that it depends on. Lists are kept for each node, so
//! that rows share common parts. A sum over a loop whose counter a leaf uses becomes an entry with
//! one more loop: matrices are never scalarised.
//!
//! Where a derivative is infinite (`sqrt(x)` and `x^a`, a < 1, at x = 0) zero is returned. A Newton
//! iteration then continues from the rest of the row instead of failing at once.

use thiserror::Error;

use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, FastSet, Flavour, MAX_DEPTH, ReduceFn, VarId};
use terms::{Differentiator, Leaf, Term, Terms};

mod normalise;
pub mod pattern;
mod reductions;
mod rows;
mod rules;
mod terms;

pub use normalise::normalise;
pub use rows::{jacobian, rows};

/// Failures of differentiation.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum DifferentiateError {
    /// Loops nest too deeply.
    #[error("sums inside of arrays nest deeper than {MAX_DEPTH} loops")]
    TooDeep,
}

/// Rows of a nest: an expression and its place.
#[derive(Clone, Debug)]
pub struct Rows {
    /// Extents of the loops.
    pub extents: Vec<u32>,
    /// The row as a function of the counters.
    pub row: Affine,
    /// Its expression.
    pub value: ExprId,
}

/// Entries of a matrix over a nest of loops; entries of several nests at one place are added.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Counter and iterations of each loop.
    pub loops: Vec<(u8, u32)>,
    /// The row.
    pub row: Affine,
    /// The column.
    pub column: Affine,
    /// The value.
    pub value: ExprId,
}

/// The column of a variable's first element, and what the derivative is multiplied with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// First column.
    pub first: u32,
    /// Factor; `None` for 1.
    pub factor: Option<ExprId>,
}

/// Loads of the derivatives.
pub type ColumnOf<'a> = dyn Fn(VarId, Flavour) -> Option<Column> + 'a;

/// A load: variable, copy, element.
pub(crate) type Loaded = (VarId, Flavour, Affine);

/// The rate of a load along some direction, or of time itself (`None`); `None` where it does not
/// move.
pub(crate) type RateOf<'a> = dyn Fn(&mut Exprs, Option<Loaded>) -> Option<ExprId> + 'a;

/// The matrix of derivatives of normalised rows.
pub fn entries(exprs: &mut Exprs, rows: &[Rows], column_of: &ColumnOf<'_>) -> Vec<Entry> {
    let uses = uses(exprs, rows);
    let mut pass = Differentiator { exprs, column_of, rates: None, known: FastMap::default(), uses, nothing: Terms::new([]) };
    let mut entries = vec![];
    for row in rows {
        let terms = pass.terms(row.value);
        pass.used(row.value);
        for term in pass.expanded(&terms).iter() {
            let mut loops: Vec<(u8, u32)> = (0..).zip(row.extents.iter().copied()).collect();
            loops.extend((0..).zip(term.leaf.bound).filter(|&(_, extent)| extent > 0));
            entries.push(Entry { loops, row: row.row, column: term.leaf.column, value: term.value });
        }
    }
    entries
}

/// The derivatives of normalised rows by time as it occurs in them, unknowns and their rates held;
/// none where an extremum or a product over a loop moves with it.
pub fn by_time(exprs: &mut Exprs, rows: &[Rows]) -> Option<Vec<Rows>> {
    if reduces_time(exprs, rows) {
        return None;
    }
    let uses = uses(exprs, rows);
    let zero = exprs.constant(0.0);
    let mut pass = Differentiator {
        exprs,
        column_of: &|_, _| None,
        rates: Some(&time_alone),
        known: FastMap::default(),
        uses,
        nothing: Terms::new([]),
    };
    let mut slope = |row: &Rows| {
        let terms = pass.terms(row.value);
        pass.used(row.value);
        let value = pass.expanded(&terms).first().map_or(zero, |term| term.value);
        Rows { value, ..row.clone() }
    };
    Some(rows.iter().map(&mut slope).collect())
}

/// Time moves, and nothing else does.
fn time_alone(exprs: &mut Exprs, load: Option<Loaded>) -> Option<ExprId> {
    load.is_none().then(|| exprs.constant(1.0))
}

/// The derivative of an expression inside of `depth` loops along a direction: each load and time
/// move at the rates that `rate_of` gives.
///
/// # Errors
/// If reductions nest too deeply.
pub(crate) fn total(exprs: &mut Exprs, depth: usize, value: ExprId, rate_of: &RateOf<'_>) -> Result<ExprId, DifferentiateError> {
    let column_of = |_: VarId, flavour: Flavour| (flavour == Flavour::Value).then_some(Column { first: 0, factor: None });
    let value = normalise(exprs, depth, value, &column_of)?;
    let rows = [Rows { extents: Vec::new(), row: Affine::constant(0), value }];
    if reduces_time(exprs, &rows) {
        return Err(DifferentiateError::TooDeep);
    }
    let (known, nothing) = (FastMap::default(), Terms::new([]));
    let mut pass = Differentiator { exprs, column_of: &|_, _| None, rates: Some(rate_of), known, uses: Vec::new(), nothing };
    let terms = pass.terms(value);
    let first = pass.expanded(&terms).first().map(|term| term.value);
    Ok(first.unwrap_or_else(|| exprs.constant(0.0)))
}

/// Returns `true` if time occurs in a reduction that is not a sum: its derivative needs counters
/// that [`normalise`] keeps free for the columns of a matrix only.
fn reduces_time(exprs: &Exprs, rows: &[Rows]) -> bool {
    let (mut seen, mut stack) = (FastSet::default(), vec![]);
    stack.extend(rows.iter().map(|row| (row.value, false)));
    while let Some((expr, reduced)) = stack.pop() {
        if reduced && exprs.node(expr) == Expr::Time {
            return true;
        }
        if seen.insert((expr, reduced)) {
            let reduced = reduced || matches!(exprs.node(expr), Expr::Reduce { op, .. } if op != ReduceFn::Sum);
            stack.extend(exprs.operands(expr).map(|o| (o, reduced)));
        }
    }
    false
}

/// Number of uses of each node as an operand below rows, or as a row.
fn uses(exprs: &Exprs, rows: &[Rows]) -> Vec<u32> {
    let mut uses = vec![0; exprs.len()];
    let mut stack: Vec<ExprId> = rows.iter().map(|row| row.value).collect();
    while let Some(e) = stack.pop() {
        let count: &mut u32 = &mut uses[e.as_u32() as usize];
        *count += 1;
        if *count == 1 {
            stack.extend(exprs.operands(e));
        }
    }
    uses
}

impl Differentiator<'_, '_> {
    /// Derivatives of a node, those of its operands first.
    fn terms(&mut self, root: ExprId) -> Terms {
        let mut stack = vec![(root, false)];
        while let Some((expr, entered)) = stack.pop() {
            if self.known.contains_key(&expr) {
                continue;
            }
            if entered {
                let terms = self.derive(expr);
                self.known.insert(expr, terms);
                // A sum of n terms has n partial sums: their lists together would take the square
                // of it.
                self.exprs.operands(expr).for_each(|o| self.used(o));
            } else {
                stack.push((expr, true));
                stack.extend(self.exprs.operands(expr).map(|o| (o, false)));
            }
        }
        self.of(root)
    }

    fn derive(&mut self, expr: ExprId) -> Terms {
        match self.exprs.node(expr) {
            Expr::Load { var, flavour, at } => self.load(var, flavour, at),
            Expr::Time => self.moving(None),
            Expr::Unary(f, a) => self.unary(expr, f, a),
            Expr::Binary(f, a, b) => self.binary(expr, f, a, b),
            Expr::PowInt(a, n) => {
                let terms = self.of(a);
                if terms.is_empty() {
                    return terms;
                }
                let (power, n) = (self.exprs.powi(a, n - 1), self.exprs.constant(f64::from(n)));
                let factor = self.exprs.mul(n, power);
                self.scaled(&terms, factor)
            }
            Expr::Select(c, a, b) => {
                let (a, b) = (self.of(a), self.of(b));
                self.select(c, &a, &b)
            }
            Expr::Reduce { op, depth, extent, body } => {
                let terms = self.of(body);
                if terms.is_empty() {
                    return terms;
                }
                match op {
                    ReduceFn::Sum => self.sum(depth, extent, &terms),
                    ReduceFn::Min | ReduceFn::Max => self.extremum(op, (depth, extent), body, &terms),
                    ReduceFn::Product => self.product((depth, extent), body, &terms),
                }
            }
            _ => self.nothing.clone(),
        }
    }

    fn load(&mut self, var: VarId, flavour: Flavour, at: Affine) -> Terms {
        if self.rates.is_some() {
            return self.moving(Some((var, flavour, at)));
        }
        let Some(column) = (self.column_of)(var, flavour) else {
            return self.nothing.clone();
        };
        let leaf = Leaf { column: at.plus(Affine::constant(i64::from(column.first))), bound: [0; MAX_DEPTH] };
        let value = column.factor.unwrap_or_else(|| self.exprs.constant(1.0));
        Terms::new([Term { leaf, value }])
    }

    /// The rate of a load, or of time, where derivatives are along a direction.
    fn moving(&mut self, load: Option<Loaded>) -> Terms {
        let rate = self.rates.and_then(|rates| rates(self.exprs, load));
        let rate = rate.filter(|&rate| self.exprs.as_const(rate) != Some(0.0));
        let leaf = Leaf { column: Affine::constant(0), bound: [0; MAX_DEPTH] };
        rate.map_or_else(|| self.nothing.clone(), |value| Terms::new([Term { leaf, value }]))
    }
}
