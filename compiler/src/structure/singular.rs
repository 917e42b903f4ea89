//! Loops of equations that do not determine their unknowns, whatever the numbers: `a = 1 + b`, `b =
//! a - 1`.
//!
//! Matching gives each unknown its own equation, but a loop of them may be redundant. Each strongly
//! connected part of the single (not looped) equations is differentiated at random numbers: sums,
//! products and quotients exactly, every other function as an arbitrary one. A matrix of
//! derivatives that is singular at several points is then singular everywhere, except with
//! probability zero. Matrices that are singular at special points only are left to the solver.

use std::hash::{Hash, Hasher};

use smpl_dsl::diagnostic::{Diagnostic, codes};

use super::common::element_name;
use crate::graph::connected;
use crate::ir::{BinaryFn, Expr, ExprId, Exprs, FastMap, Flavour, Role, UnaryFn, VarId};
use crate::model::{Model, Row};

/// Unknowns of a part beyond which it is not looked at.
const LARGE_PART: usize = 60;
/// Nodes times unknowns of a part, likewise.
const LARGE_WORK: usize = 2_000_000;
/// Points at which a part must be singular.
const POINTS: u64 = 3;
/// Pivot of a matrix with rows and columns of size 1 that counts as none.
const NONE: f64 = 1e-10;
/// Sum, relative to its terms, that counts as none.
const ROUNDING: f64 = 1e-13;

/// An unknown of an equation: an algebraic value or a derivative.
type Unknown = (VarId, Flavour, i64);

/// Looks for parts that are singular.
///
/// # Errors
/// The parts that are.
pub(crate) fn refuse_singular_loops(model: &Model) -> Result<(), Vec<Diagnostic>> {
    let faults = singular_loops(model, &model.rows);
    if faults.is_empty() { Ok(()) } else { Err(faults) }
}

fn singular_loops(model: &Model, rows: &[Row]) -> Vec<Diagnostic> {
    let single: Vec<&Row> = rows.iter().filter(|row| row.extents.is_empty() && row.at.is_constant() && !is_rate(model, row)).collect();
    let unknowns: Vec<Unknown> = single.iter().map(|row| unknown(model, row)).collect();
    let numbers: FastMap<Unknown, usize> = unknowns.iter().copied().zip(0..).collect();
    let needs: Vec<Vec<usize>> = single.iter().map(|row| needs(model, row, &numbers)).collect();
    let place = |&i: &usize| (single[i].span.file, single[i].span.start);
    let mut parts = connected(&needs);
    parts.iter_mut().for_each(|part| part.sort_by_key(place));
    parts.sort_by_key(|part| part.first().map(place));
    parts
        .iter()
        .filter(|part| is_singular(&model.exprs, part, &single, &unknowns))
        .map(|part| report(model, part, &single, &unknowns))
        .collect()
}

/// Returns `true` if an equation is `f - x'` with f free of derivatives: it determines x'.
fn is_rate(model: &Model, row: &Row) -> bool {
    let exprs = &model.exprs;
    let Expr::Binary(BinaryFn::Sub, value, own) = exprs.node(row.residual) else { return false };
    !exprs.has_derivative(value) && exprs.node(own) == Expr::Load { var: row.var, flavour: Flavour::Derivative, at: row.at }
}

fn unknown(model: &Model, row: &Row) -> Unknown {
    let flavour = if model.vars[row.var].role == Role::State { Flavour::Derivative } else { Flavour::Value };
    (row.var, flavour, row.at.offset)
}

/// Unknowns of single equations in the equation of one.
fn needs(model: &Model, row: &Row, numbers: &FastMap<Unknown, usize>) -> Vec<usize> {
    let found = model.exprs.loads(row.residual, |_, flavour| matches!(flavour, Flavour::Value | Flavour::Derivative));
    found
        .into_iter()
        .filter(|l| l.2.is_constant())
        .filter_map(|(var, flavour, at)| numbers.get(&(var, flavour, at.offset)).copied())
        .collect()
}

fn is_singular(exprs: &Exprs, part: &[usize], rows: &[&Row], unknowns: &[Unknown]) -> bool {
    if part.len() > LARGE_PART {
        return false;
    }
    let residuals: Vec<ExprId> = part.iter().map(|&i| rows[i].residual).collect();
    // What a sum over elements of unknowns depends on is not worked out.
    let own = |var: VarId| part.iter().any(|&i| unknowns[i].0 == var);
    let in_sums = |&e: &ExprId| exprs.loads(e, |var, _| own(var)).iter().any(|(_, _, at)| !at.is_constant());
    if residuals.iter().any(in_sums) {
        return false;
    }
    let nodes = exprs.below_in_order(residuals.iter().copied());
    let columns: FastMap<Unknown, usize> = part.iter().map(|&i| unknowns[i]).zip(0..).collect();
    nodes.len() * part.len() <= LARGE_WORK
        && (0..POINTS).all(|point| is_singular_matrix(Point { exprs, point, columns: &columns }.derivatives(&nodes, &residuals)))
}

/// A random point.
struct Point<'m> {
    exprs: &'m Exprs,
    point: u64,
    columns: &'m FastMap<Unknown, usize>,
}

/// A value and its derivatives, none where it depends on no unknown.
type Dual = (f64, Vec<f64>);

impl Point<'_> {
    /// The derivatives of some nodes; `nodes` are all below them.
    fn derivatives(&self, nodes: &[ExprId], roots: &[ExprId]) -> Vec<Vec<f64>> {
        let mut known: FastMap<ExprId, Dual> = FastMap::default();
        for &e in nodes {
            let dual = self.dual(e, &known);
            known.insert(e, dual);
        }
        let zero = || vec![0.0; self.columns.len()];
        roots.iter().map(|e| known.get(e).map(|d| d.1.clone()).filter(|d| !d.is_empty()).unwrap_or_else(zero)).collect()
    }

    fn dual(&self, e: ExprId, known: &FastMap<ExprId, Dual>) -> Dual {
        let node = self.exprs.node(e);
        let of = |e: ExprId| known.get(&e).map_or((f64::NAN, &[][..]), |d| (d.0, &d.1[..]));
        let (value, derivative) = match node {
            Expr::Const(bits) => (f64::from_bits(bits), vec![]),
            Expr::Load { var, flavour, at } => {
                let column = at.is_constant().then(|| self.columns.get(&(var, flavour, at.offset))).flatten();
                let unit = |&c: &usize| (0..self.columns.len()).map(|i| f64::from(u8::from(i == c))).collect();
                // Two copies of an element are two numbers, equal elements one.
                (self.random(&(var, flavour, at), e), column.map(unit).unwrap_or_default())
            }
            Expr::Unary(UnaryFn::Neg, a) => (-of(a).0, combined(&[(-1.0, of(a).1)])),
            Expr::Binary(BinaryFn::Add, a, b) => (of(a).0 + of(b).0, combined(&[(1.0, of(a).1), (1.0, of(b).1)])),
            Expr::Binary(BinaryFn::Sub, a, b) => (of(a).0 - of(b).0, combined(&[(1.0, of(a).1), (-1.0, of(b).1)])),
            Expr::Binary(BinaryFn::Mul, a, b) => (of(a).0 * of(b).0, combined(&[(of(b).0, of(a).1), (of(a).0, of(b).1)])),
            Expr::Binary(BinaryFn::Div, a, b) => {
                let ((x, dx), (y, dy)) = (of(a), of(b));
                (x / y, combined(&[(1.0 / y, dx), (-x / (y * y), dy)]))
            }
            // Any function of its operands.
            _ => (f64::NAN, vec![]),
        };
        let is_known = value.is_finite() && derivative.iter().all(|d| d.is_finite());
        if is_known { (value, derivative) } else { self.any_function(e, known) }
    }

    /// A function that could be any: a random value, random derivatives for its operands.
    fn any_function(&self, e: ExprId, known: &FastMap<ExprId, Dual>) -> Dual {
        let parts: Vec<(f64, &[f64])> =
            self.exprs.operands(e).zip(0_u64..).filter_map(|(o, k)| Some((self.random(&k, e), &known.get(&o)?.1[..]))).collect();
        (self.random(&"value", e), combined(&parts))
    }

    /// A number between 0.5 and 1.5 that belongs to the point and a thing; for all but loads to a
    /// node too.
    fn random<T: Hash + 'static>(&self, thing: &T, e: ExprId) -> f64 {
        let mut hasher = std::hash::DefaultHasher::new();
        (self.point, thing).hash(&mut hasher);
        if !matches!(self.exprs.node(e), Expr::Load { .. }) {
            e.hash(&mut hasher);
        }
        0.5 + (hasher.finish() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A sum of derivatives with factors; what cancels to rounding is zero.
fn combined(parts: &[(f64, &[f64])]) -> Vec<f64> {
    let length = parts.iter().map(|p| p.1.len()).max().unwrap_or(0);
    let entry = |i: usize| {
        let terms = parts.iter().filter_map(|(factor, derivative)| Some(factor * derivative.get(i)?));
        let (sum, size) = terms.fold((0.0, 0.0), |(sum, size), x| (sum + x, size + x.abs()));
        if sum.abs() <= ROUNDING * size { 0.0 } else { sum }
    };
    (0..length).map(entry).collect()
}

/// Elimination with full pivoting, rows and columns scaled before.
fn is_singular_matrix(mut rows: Vec<Vec<f64>>) -> bool {
    let n = rows.len();
    let largest = |values: &mut dyn Iterator<Item = f64>| values.map(f64::abs).fold(0.0, f64::max);
    for row in &mut rows {
        let size = largest(&mut row.iter().copied());
        row.iter_mut().filter(|_| size > 0.0).for_each(|x| *x /= size);
    }
    for column in 0..n {
        let size = largest(&mut rows.iter().map(|row| row[column]));
        rows.iter_mut().filter(|_| size > 0.0).for_each(|row| row[column] /= size);
    }
    for k in 0..n {
        let places = (k..n).flat_map(|i| (k..n).map(move |j| (i, j)));
        let Some((i, j)) = places.max_by(|a, b| rows[a.0][a.1].abs().total_cmp(&rows[b.0][b.1].abs())) else { return false };
        if rows[i][j].abs() < NONE {
            return true;
        }
        rows.swap(k, i);
        rows.iter_mut().for_each(|row| row.swap(k, j));
        let (above, below) = rows.split_at_mut(k + 1);
        for row in below {
            let factor = row[k] / above[k][k];
            row.iter_mut().zip(&above[k]).skip(k).for_each(|(x, pivot)| *x -= factor * pivot);
        }
    }
    false
}

fn report(model: &Model, part: &[usize], rows: &[&Row], unknowns: &[Unknown]) -> Diagnostic {
    const SHOWN: usize = 4;
    let name = |&i: &usize| {
        let (var, flavour, at) = unknowns[i];
        let name = element_name(model, var, at);
        if flavour == Flavour::Derivative { format!("`d/dt {name}`") } else { format!("`{name}`") }
    };
    let names: Vec<String> = part.iter().take(SHOWN).map(name).collect();
    let more = if part.len() > SHOWN { format!(" and {} more", part.len() - SHOWN) } else { String::new() };
    let message = match names.as_slice() {
        [name] => format!("the equation of {name} holds for any value of it or for none: it drops out of its loop"),
        _ => format!("the equations of {}{more} hold for many values or for none: their loop is singular", names.join(", ")),
    };
    let first = part.first().map(|&i| rows[i].span).unwrap_or_default();
    let mut out = Diagnostic::error(codes::UNDERDETERMINED, message, first)
        .help("one of them follows from the others or contradicts them: put another equation in its place, or make what is free a `param`");
    for &i in part.iter().skip(1).take(SHOWN) {
        out = out.secondary(rows[i].span, "in the same loop");
    }
    out
}
