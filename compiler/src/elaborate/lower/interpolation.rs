//! Tables as polynomials between their points: the piece is searched, its coefficients are looked
//! up.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::Expr;
use smpl_dsl::units::Unit;

use crate::elaborate::declare::interpolation::{hermite, monotone_slopes, spline_slopes};
use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::{Lowering, reads};
use crate::elaborate::symbols::{Grid, Outside, SymbolId, SymbolKind};
use crate::ir::{BinaryFn, ExprId, Exprs, Side, UnaryFn};

/// The argument of a table as a number of its unit. A number is taken in that unit; a dimensionless
/// quantity is not a time.
pub(in crate::elaborate) fn table_argument(l: &mut Lowering<'_, '_>, e: &Expr, unit: &Unit, symbol: SymbolId, place: &Place) -> ExprId {
    let (declared, path) = (l.symbols[symbol].span, l.symbols[symbol].path.clone());
    let word = if matches!(l.symbols[symbol].kind, SymbolKind::Surface { .. }) { "argument" } else { "time" };
    let what = format!("the {word} of `{path}`");
    let taken = &mut |s: &mut Lowering<'_, '_>, v: Value, span: Span| s.values().strictly_or_bare(v, unit, span, &what, declared);
    let t = l.declared_value(e, place, taken, unit);
    l.values().strictly_or_bare(t, unit, e.span, &what, declared)
}

/// A curve through points: lines, or monotone cubic polynomials.
pub(in crate::elaborate) fn curve(exprs: &mut Exprs, t: ExprId, points: &[(f64, f64)], cubic: bool, outside: Outside) -> ExprId {
    let (x, y): (Vec<f64>, Vec<f64>) = points.iter().copied().unzip();
    let (Some((&first, &last)), Some((&low, &high))) = (x.first().zip(x.last()), y.first().zip(y.last())) else {
        return exprs.constant(f64::NAN);
    };
    if x.len() == 1 {
        return exprs.constant(low);
    }
    let slopes = match (cubic, outside) {
        (false, _) => Vec::new(),
        (true, Outside::Cyclic) if low == high => periodic_slopes(&x, &y),
        (true, _) => monotone_slopes(&x, &y),
    };
    let piece = |i: usize| {
        let (h, rise) = (x[i + 1] - x[i], y[i + 1] - y[i]);
        if cubic { hermite(h, [y[i], y[i + 1]], [slopes[i], slopes[i + 1]]) } else { [y[i], rise / h, 0.0, 0.0] }
    };
    let mut pieces: Vec<(f64, [f64; 4])> = (0..x.len() - 1).map(|i| (x[i], piece(i))).collect();
    let beyond = |slope: f64| if outside == Outside::Linear { slope } else { 0.0 };
    let end_slope = if cubic { slopes[x.len() - 1] } else { pieces[pieces.len() - 1].1[1] };
    let (before, after) = (beyond(pieces[0].1[1]), beyond(end_slope));
    pieces.insert(0, (first, [low, before, 0.0, 0.0]));
    pieces.push((last, [high, after, 0.0, 0.0]));
    let at = searched(exprs, &x, t);
    let starts: Vec<f64> = pieces.iter().map(|piece| piece.0).collect();
    let start = looked_up(exprs, &starts, at);
    let since = exprs.sub(t, start);
    let coefficients: Vec<Vec<f64>> = (0..4).map(|k| pieces.iter().map(|piece| piece.1[k]).collect()).collect();
    polynomial(exprs, &coefficients, at, since)
}

/// Slopes of monotone polynomials through points that repeat, the last of which is the first of the
/// next period.
fn periodic_slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let (n, period) = (x.len(), x[x.len() - 1] - x[0]);
    let (mut longer, mut values) = (vec![x[n - 2] - period], vec![y[n - 2]]);
    longer.extend(x);
    values.extend(y);
    longer.push(x[1] + period);
    values.push(y[1]);
    monotone_slopes(&longer, &values)[1..=n].to_vec()
}

/// The argument of a table that repeats, between its first point and its last.
pub(in crate::elaborate) fn in_period(exprs: &mut Exprs, t: ExprId, points: &[(f64, f64)]) -> ExprId {
    let (Some(&(first, _)), Some(&(last, _))) = (points.first(), points.last()) else { return t };
    let (first, period) = (exprs.constant(first), exprs.constant(last - first));
    let since = exprs.sub(t, first);
    let ratio = exprs.div(since, period);
    let whole = exprs.unary(UnaryFn::Floor, ratio);
    let passed = exprs.mul(period, whole);
    exprs.sub(t, passed)
}

/// The number of limits that a value has reached.
fn searched(exprs: &mut Exprs, limits: &[f64], t: ExprId) -> ExprId {
    if limits.is_empty() {
        return exprs.constant(0.0);
    }
    let limits = exprs.lists_mut().add_limits(limits);
    exprs.passed(limits, Side::UpTo, t)
}

/// The number of a list at a place.
fn looked_up(exprs: &mut Exprs, numbers: &[f64], at: ExprId) -> ExprId {
    match numbers {
        [first, rest @ ..] if rest.iter().all(|x| x.to_bits() == first.to_bits()) => exprs.constant(*first),
        _ => {
            let list = exprs.lists_mut().add(numbers);
            exprs.entry(list, at)
        }
    }
}

/// A polynomial by its coefficients, lowest power first; powers that no piece has are left out.
fn polynomial(exprs: &mut Exprs, coefficients: &[Vec<f64>], at: ExprId, x: ExprId) -> ExprId {
    let mut value: Option<ExprId> = None;
    for numbers in coefficients.iter().rev() {
        let zero = numbers.iter().all(|c| *c == 0.0);
        let product = value.map(|value| exprs.mul(value, x));
        value = match product {
            None if zero => None,
            Some(product) if zero => Some(product),
            product => {
                let own = looked_up(exprs, numbers, at);
                Some(product.map_or(own, |product| exprs.add(own, product)))
            }
        };
    }
    value.unwrap_or_else(|| exprs.constant(0.0))
}

/// A table over two quantities, read at two expressions.
pub(in crate::elaborate) fn surface(l: &mut Lowering<'_, '_>, span: Span, symbol: SymbolId, arguments: &[Expr], place: &Place) -> Value {
    let path = l.symbols[symbol].path.clone();
    let SymbolKind::Surface { unit, units, cubic, outside, grid } = l.symbols[symbol].kind.clone() else { return l.poison() };
    let [first, second] = arguments else {
        let message = format!("`{path}` takes two arguments, a value in {} and one in {}", units[0], units[1]);
        return l.fault(Diagnostic::error(codes::WRONG_ARGUMENTS, message, span));
    };
    let at = [(first, &units[0]), (second, &units[1])].map(|(e, unit)| table_argument(l, e, unit, symbol, place));
    let ends = [ends(&grid.first), ends(&grid.second)];
    let expr = patch(l.exprs, at, ends, &grid, cubic, outside);
    let expr =
        if outside == Outside::Refused { reads::refused(l, symbol, &[(at[0], ends[0]), (at[1], ends[1])], expr, place) } else { expr };
    Value::of(expr, unit)
}

fn ends(x: &[f64]) -> (f64, f64) {
    x.first().zip(x.last()).map_or((0.0, 0.0), |(first, last)| (*first, *last))
}

/// The polynomial of the rectangle in which the point lies; outside of all the nearest point of the
/// border, and its tangents where the table goes on by lines.
fn patch(exprs: &mut Exprs, at: [ExprId; 2], ends: [(f64, f64); 2], grid: &Grid, cubic: bool, outside: Outside) -> ExprId {
    let inside = [0, 1].map(|k| {
        let (low, high) = (exprs.constant(ends[k].0), exprs.constant(ends[k].1));
        let above = exprs.binary(BinaryFn::Max, at[k], low);
        exprs.binary(BinaryFn::Min, above, high)
    });
    // Bilinear pieces go on as they are.
    let read = if outside == Outside::Linear && !cubic { at } else { inside };
    let (coefficients, [first, second]) = coefficients(grid, cubic);
    let pieces = [(&grid.first, read[0]), (&grid.second, read[1])].map(|(x, t)| {
        let inner = if x.len() > 2 { &x[1..x.len() - 1] } else { &[] };
        searched(exprs, inner, t)
    });
    let width = exprs.constant(grid.second.len().max(2) as f64 - 1.0);
    let row = exprs.mul(pieces[0], width);
    let number = exprs.add(row, pieces[1]);
    let origin = [looked_up(exprs, &first, pieces[0]), looked_up(exprs, &second, pieces[1])];
    let [u, v] = [0, 1].map(|k| exprs.sub(read[k], origin[k]));
    if outside != Outside::Linear || !cubic {
        return power_series(exprs, &coefficients, number, [u, v]);
    }
    let beyond = [0, 1].map(|k| exprs.sub(at[k], inside[k]));
    tangents(exprs, &coefficients, number, [u, v], beyond)
}

/// Starts of the pieces along an axis.
fn starts(x: &[f64]) -> Vec<f64> {
    x[..x.len().max(2) - 1].to_vec()
}

/// Coefficients of the powers of both distances, for each rectangle, and where the rectangles
/// begin.
fn coefficients(grid: &Grid, cubic: bool) -> ([[Vec<f64>; 4]; 4], [Vec<f64>; 2]) {
    let (x, y) = (&grid.first, &grid.second);
    let (n, m) = (x.len(), y.len());
    let value = |i: usize, j: usize| grid.values[i * m + j];
    let slopes = |x: &[f64], z: &[f64]| if cubic { spline_slopes(x, z) } else { vec![0.0; x.len()] };
    let along_second: Vec<Vec<f64>> = (0..n).map(|i| slopes(y, &grid.values[i * m..(i + 1) * m])).collect();
    let column = |list: &dyn Fn(usize) -> f64| slopes(x, &(0..n).map(list).collect::<Vec<_>>());
    let along_first: Vec<Vec<f64>> = (0..m).map(|j| column(&|i| value(i, j))).collect();
    let twisted: Vec<Vec<f64>> = (0..m).map(|j| column(&|i| along_second[i][j])).collect();
    let mut out: [[Vec<f64>; 4]; 4] = Default::default();
    let piece = |h: f64, y: [f64; 2], d: [f64; 2]| {
        if h == 0.0 {
            [y[0], 0.0, 0.0, 0.0]
        } else if cubic {
            hermite(h, y, d)
        } else {
            [y[0], (y[1] - y[0]) / h, 0.0, 0.0]
        }
    };
    for i in 0..n.max(2) - 1 {
        for j in 0..m.max(2) - 1 {
            let (right, up) = ((i + 1).min(n - 1), (j + 1).min(m - 1));
            let (h, k) = (x[right] - x[i], y[up] - y[j]);
            // Along the first argument at both ends of the second one: values, and their slopes
            // along the second one.
            let lines = [j, up].map(|j| piece(h, [value(i, j), value(right, j)], [along_first[j][i], along_first[j][right]]));
            let turns = [j, up].map(|j| piece(h, [along_second[i][j], along_second[right][j]], [twisted[j][i], twisted[j][right]]));
            for (p, row) in out.iter_mut().enumerate() {
                let powers = piece(k, [lines[0][p], lines[1][p]], [turns[0][p], turns[1][p]]);
                row.iter_mut().zip(powers).for_each(|(list, c)| list.push(c));
            }
        }
    }
    (out, [starts(x), starts(y)])
}

/// The sum of all powers.
fn power_series(exprs: &mut Exprs, coefficients: &[[Vec<f64>; 4]; 4], at: ExprId, [u, v]: [ExprId; 2]) -> ExprId {
    let rows = coefficients.iter().map(|row| polynomial(exprs, row, at, v)).collect::<Vec<_>>();
    horner(exprs, &rows, u)
}

fn horner(exprs: &mut Exprs, terms: &[ExprId], x: ExprId) -> ExprId {
    let mut terms = terms.iter().rev();
    let Some(&last) = terms.next() else { return exprs.constant(0.0) };
    terms.fold(last, |value, &term| {
        let product = exprs.mul(value, x);
        exprs.add(term, product)
    })
}

/// The value at the border and its tangents along both arguments.
fn tangents(exprs: &mut Exprs, coefficients: &[[Vec<f64>; 4]; 4], at: ExprId, [u, v]: [ExprId; 2], [du, dv]: [ExprId; 2]) -> ExprId {
    let slope = |numbers: &[Vec<f64>; 4]| -> Vec<Vec<f64>> { (1..4).map(|k| numbers[k].iter().map(|c| *c * k as f64).collect()).collect() };
    let values: Vec<ExprId> = coefficients.iter().map(|row| polynomial(exprs, row, at, v)).collect();
    let slopes: Vec<ExprId> = coefficients.iter().map(|row| polynomial(exprs, &slope(row), at, v)).collect();
    let mut along_first = |terms: &[ExprId]| {
        let value = horner(exprs, terms, u);
        let derived: Vec<ExprId> = (1..4)
            .map(|k| {
                let k_number = exprs.constant(k as f64);
                exprs.mul(k_number, terms[k])
            })
            .collect();
        let slope = horner(exprs, &derived, u);
        let moved = exprs.mul(slope, du);
        exprs.add(value, moved)
    };
    let (value, turned) = (along_first(&values), along_first(&slopes));
    let moved = exprs.mul(turned, dv);
    exprs.add(value, moved)
}
