//! Nests of loops over binders.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Binder, Expr};

use crate::elaborate::lower::loops::{Cell, Piece};
use crate::elaborate::lower::place::{BinderValue, Bound, Place};
use crate::elaborate::lower::{Lowering, binders};
use crate::elaborate::symbols::{Axis, Symbols};
use crate::ir::{Affine, Expr as Node, ExprId, LoopVar, VarId};

/// Elaborates `body` for everything that the binders run over: sets unrolled, cells as loops.
pub(in crate::elaborate) fn nest<'m, 'a, T>(
    l: &mut Lowering<'m, 'a>,
    binders: &[Binder],
    place: &Place,
    body: &mut dyn FnMut(&mut Lowering<'m, 'a>, &Place) -> T,
) -> Vec<Piece<T>> {
    nest_of(l, binders, place, false, body)
}

/// As [`Self::nest`], with ranges of numbers as loops where `body` does not [refuse](Self::refuse).
pub(in crate::elaborate) fn looped_nest<'m, 'a, T>(
    l: &mut Lowering<'m, 'a>,
    binders: &[Binder],
    place: &Place,
    body: &mut dyn FnMut(&mut Lowering<'m, 'a>, &Place) -> T,
) -> Vec<Piece<T>> {
    nest_of(l, binders, place, true, body)
}

fn nest_of<'m, 'a, T>(
    l: &mut Lowering<'m, 'a>,
    binders: &[Binder],
    place: &Place,
    runs: bool,
    body: &mut dyn FnMut(&mut Lowering<'m, 'a>, &Place) -> T,
) -> Vec<Piece<T>> {
    let Some((binder, rest)) = binders.split_first() else {
        return vec![Piece { extents: Vec::new(), value: body(l, place) }];
    };
    let mut pass = |l: &mut Lowering<'m, 'a>, inner: &Place| match &binder.condition {
        Some(condition) if !is_included(l, condition, inner) => Vec::new(),
        _ => nest_of(l, rest, inner, runs, body),
    };
    if runs
        && let Some(range) = l.run_of(binder, place)
        && let Some(pieces) = l.attempt(|s| looped(s, binder, range, Bound::Run, place, &mut pass))
    {
        return pieces;
    }
    let mut out = Vec::new();
    for value in binders::bindings_of(l, binder, place) {
        if !l.ledger.may_write_out(binder.span) {
            break;
        }
        let (low, high) = match &value {
            BinderValue::One(bound) => {
                let inner = place.bind(&binder.name.text, bound.clone());
                out.extend(pass(l, &inner));
                continue;
            }
            BinderValue::Cells(_, low, high) => (*low, *high),
            BinderValue::Elements(_, len) => (0, len - 1),
        };
        let bound = |cell: Cell| match &value {
            BinderValue::Elements(symbol, _) => Bound::Element(*symbol, cell.affine()),
            BinderValue::Cells(domain, ..) => Bound::Cell(*domain, cell),
            BinderValue::One(bound) => bound.clone(),
        };
        out.extend(looped(l, binder, (low, high), bound, place, &mut pass));
    }
    out
}

/// Value of the condition on the indices of a statement.
fn is_included(l: &mut Lowering<'_, '_>, condition: &Expr, place: &Place) -> bool {
    let Some(expr) = l.sound_condition(condition, place) else { return false };
    if let Node::Truth(holds) = l.exprs.node(expr) {
        return holds;
    }
    let message = "a condition on indices must be known to the compiler";
    let fault = Diagnostic::error(codes::WRONG_KIND, message, condition.span);
    l.ledger.report(fault.help("compare indices and whole numbers, `if i != j`; a value that changes belongs into the expression"));
    false
}

/// The pieces of a loop, with what `body` makes in it.
fn looped<'m, 'a, T>(
    l: &mut Lowering<'m, 'a>,
    binder: &Binder,
    (low, high): (i64, i64),
    bound: impl Fn(Cell) -> Bound,
    place: &Place,
    body: &mut dyn FnMut(&mut Lowering<'m, 'a>, &Place) -> Vec<Piece<T>>,
) -> Vec<Piece<T>> {
    let mut out = Vec::new();
    let pieces = l.cells(low, high, binder.span, place, &mut |s, cell, inner| body(s, &inner.bind(&binder.name.text, bound(cell))));
    for (cell, list) in pieces {
        for piece in list {
            let mut extents = Vec::with_capacity(piece.extents.len() + 1);
            extents.extend(cell.along.map(|_| cell.count as u32));
            extents.extend(piece.extents);
            out.push(Piece { extents, value: piece.value });
        }
    }
    out
}

impl Symbols<'_> {
    /// Address of the element that bound index names mean.
    pub(in crate::elaborate) fn bound_address(&self, axes: &[Axis], indices: &[Binder], place: &Place) -> Affine {
        let mut at = Affine::default();
        for (&axis, binder) in axes.iter().zip(indices) {
            let part = match place.bound(&binder.name.text) {
                Some(Bound::Member(_, i)) => Affine::constant(*i as i64),
                Some(Bound::Cell(_, c)) => c.affine(),
                Some(Bound::Run(numbers)) => match axis {
                    Axis::Set(set) => numbers.shifted(-self.sets[set].first.unwrap_or(0)).affine(),
                    Axis::Domain(_) => numbers.shifted(-1).affine(),
                },
                _ => Affine::default(),
            };
            at = at.times(self.axis_len(axis)).plus(part);
        }
        at
    }

    /// One value for all elements of a variable.
    pub(in crate::elaborate) fn whole(&self, var: VarId, value: ExprId) -> Piece<(Affine, ExprId)> {
        match self.vars[var].len {
            1 => Piece { extents: Vec::new(), value: (Affine::default(), value) },
            len => Piece { extents: vec![len], value: (Affine::along(0, LoopVar(0), 1), value) },
        }
    }
}

/// Calls `f` with the address of every pass of a nest.
pub(crate) fn for_each_element(extents: &[u32], at: Affine, f: &mut dyn FnMut(i64)) {
    fn pass(extents: &[u32], depth: usize, at: i64, strides: &[i64], f: &mut dyn FnMut(i64)) {
        match extents.get(depth) {
            None => f(at),
            Some(&n) => {
                for i in 0..i64::from(n) {
                    pass(extents, depth + 1, at + i * strides[depth], strides, f);
                }
            }
        }
    }
    pass(extents, 0, at.offset, &at.strides, f);
}
