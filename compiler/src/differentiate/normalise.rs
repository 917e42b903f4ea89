//! Rows before they are differentiated: each reduction has its own counter, short ones are
//! unrolled.

use super::{ColumnOf, DifferentiateError};
use crate::ir::{Affine, BinaryFn, Expr, ExprId, Exprs, LoopVar, MAX_DEPTH, ReduceFn, UnaryFn};

/// Reductions other than sums are unrolled up to this many iterations to be differentiated; longer
/// ones stay loops.
const LONGEST_UNROLLED: u32 = 64;
/// Counters in addition to its own that the derivative of a long reduction needs.
const TWINS: u8 = 2;
/// Sums are unrolled up to this many iterations, if the result stays small.
const SHORT_SUM: u32 = 8;
/// Largest number of nodes of a sum that is unrolled.
const SHORT_SUM_NODES: usize = 256;

/// Brings the reductions of a row into the form that [`super::entries`] needs. Each binds a counter
/// that is free in its surroundings; short sums and other reductions over what depends on the
/// columns are unrolled.
///
/// # Errors
/// If loops nest too deeply or a reduction is too long to be unrolled.
pub fn normalise(exprs: &mut Exprs, depth: usize, value: ExprId, column_of: &ColumnOf<'_>) -> Result<ExprId, DifferentiateError> {
    let mut map = [0; MAX_DEPTH];
    map.iter_mut().zip(0..).for_each(|(m, d)| *m = d);
    renumber(exprs, value, map, depth as u8, column_of)
}

fn renumber(
    exprs: &mut Exprs,
    value: ExprId,
    map: [u8; MAX_DEPTH],
    next: u8,
    column_of: &ColumnOf<'_>,
) -> Result<ExprId, DifferentiateError> {
    let identity = map.iter().zip(0..).all(|(&m, d)| m == d);
    let mut failure = None;
    let renamed = exprs.rewrite(value, &mut crate::ir::Rewritten::default(), &mut |exprs, node| match node {
        Expr::Counter(v) if !identity => Some(exprs.counter(LoopVar(map[v.0 as usize]))),
        Expr::Load { var, flavour, at } if !identity => {
            let mut moved = Affine::constant(at.offset);
            for (d, stride) in at.strides.into_iter().enumerate() {
                moved.strides[map[d] as usize] += stride;
            }
            Some(exprs.load(var, flavour, moved))
        }
        Expr::Reduce { op, depth, extent, body } => match renumber_reduce(exprs, (op, depth, extent, body), map, next, column_of) {
            Ok(reduced) => Some(reduced),
            Err(error) => {
                failure = Some(error);
                Some(body)
            }
        },
        // Later code does not read it.
        Expr::Unary(UnaryFn::Smooth, a) => match renumber(exprs, a, map, next, column_of) {
            Ok(inner) => Some(inner),
            Err(error) => {
                failure = Some(error);
                Some(a)
            }
        },
        _ => None,
    });
    failure.map_or(Ok(renamed), Err)
}

fn renumber_reduce(
    exprs: &mut Exprs,
    (op, depth, extent, body): (ReduceFn, LoopVar, u32, ExprId),
    mut map: [u8; MAX_DEPTH],
    next: u8,
    column_of: &ColumnOf<'_>,
) -> Result<ExprId, DifferentiateError> {
    if usize::from(next) >= MAX_DEPTH {
        return Err(DifferentiateError::TooDeep);
    }
    map[depth.0 as usize] = next;
    let written = body;
    let body = renumber(exprs, written, map, next + 1, column_of)?;
    let (size, depends) = survey(exprs, body, column_of);
    let short = op == ReduceFn::Sum && extent <= SHORT_SUM && size * extent as usize <= SHORT_SUM_NODES;
    if extent == 0 || !(short || (op != ReduceFn::Sum && depends)) {
        return Ok(exprs.reduce(op, LoopVar(next), extent, body));
    }
    if extent > LONGEST_UNROLLED {
        // Its derivative needs two more reductions over the same elements.
        let inner = next + 1 + TWINS;
        if usize::from(inner) > MAX_DEPTH {
            return Err(DifferentiateError::TooDeep);
        }
        let body = renumber(exprs, written, map, inner, column_of)?;
        return Ok(exprs.reduce(op, LoopVar(next), extent, body));
    }
    let combine = match op {
        ReduceFn::Sum => BinaryFn::Add,
        ReduceFn::Product => BinaryFn::Mul,
        ReduceFn::Min => BinaryFn::Min,
        ReduceFn::Max => BinaryFn::Max,
    };
    let first = exprs.shift(body, LoopVar(next), 0);
    Ok((1..extent).fold(first, |sum, i| {
        let item = exprs.shift(body, LoopVar(next), i64::from(i));
        exprs.binary(combine, sum, item)
    }))
}

/// Number of nodes, and whether any is a load of a column.
fn survey(exprs: &Exprs, root: ExprId, column_of: &ColumnOf<'_>) -> (usize, bool) {
    let (mut count, mut depends) = (0, false);
    for e in exprs.below([root]) {
        count += 1;
        if let Expr::Load { var, flavour, .. } = exprs.node(e) {
            depends |= column_of(var, flavour).is_some();
        }
    }
    (count, depends)
}
