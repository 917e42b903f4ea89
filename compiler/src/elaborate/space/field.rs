//! Values of fields at faces and in adjacent cells.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind};
use smpl_dsl::units::Unit;

use crate::elaborate::lower::loops::{Cell, Face};
use crate::elaborate::lower::place::{Bound, Place};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, units};
use crate::elaborate::space::faces::FaceValue;
use crate::elaborate::space::flow::{Direction, forward};
use crate::elaborate::space::marks::{MARK, is_odd};
use crate::elaborate::space::{grid, marks};
use crate::elaborate::symbols::{Axis, DomainId, Scheme, SymbolId};
use crate::ir::{Affine, Compare, Expr as Node, ExprId, Flavour, UnaryFn};

/// Value of a field at the face of a flux; `None` where the indices do not mean the face.
pub(in crate::elaborate) fn face_value<'m, 'a>(
    l: &mut Lowering<'m, 'a>,
    symbol: SymbolId,
    axes: &[Axis],
    index: &[Expr],
    span: Span,
    face: Face,
    place: &Place,
) -> Option<Value> {
    face_index(axes, index, face.domain, place)?;
    let Some((at_low, at_high)) = ends_at(l, face) else { return Some(l.poison()) };
    let at = |s: &mut Lowering<'m, 'a>, by: i64| in_cell(s, symbol, index, span, face.at.shifted(by), face.domain, place);
    let is_marked = l.fluxes.faces.is_some() && l.symbols.is_directed(face);
    if l.fluxes.averaging || is_marked {
        let beside = at(l, if at_low { 0 } else { -1 });
        let marked = if is_marked { marked(l, (symbol, index, span), face, place, &beside, l.fluxes.averaging) } else { beside.clone() };
        if !l.fluxes.averaging || at_low || at_high {
            return Some(if l.fluxes.averaging { beside } else { marked });
        }
        let above = at(l, 0);
        let expr = interpolate(l, face, beside.expr, above.expr);
        return Some(Value { expr, unit: beside.unit });
    }
    if at_low {
        return Some(at(l, 0));
    }
    if at_high {
        return Some(at(l, -1));
    }
    Some(match l.symbols.domains[face.domain].scheme {
        Scheme::Upwind | Scheme::Upwind2 | Scheme::Limited => value_from_side(l, face, true, &mut |s, by| at(s, by)),
        Scheme::Downwind => at(l, 0),
        Scheme::Central => {
            let (left, right) = (at(l, -1), at(l, 0));
            let expr = interpolate(l, face, left.expr, right.expr);
            Value { expr, unit: left.unit }
        }
    })
}

/// A value at an inner face by the domain's scheme, from below or from above; `cell` gives it in
/// the cell so many above the face.
pub(in crate::elaborate) fn value_from_side<'m, 'a>(
    l: &mut Lowering<'m, 'a>,
    face: Face,
    below: bool,
    cell: &mut dyn FnMut(&mut Lowering<'m, 'a>, i64) -> Value,
) -> Value {
    // The cell on that side, the one behind it, and the one across the face.
    let (near, behind, across) = if below { (-1, -2, 0) } else { (0, 1, -1) };
    let scheme = l.symbols.domains[face.domain].scheme;
    if !matches!(scheme, Scheme::Upwind2 | Scheme::Limited) {
        return cell(l, near);
    }
    let only = if below { 1 } else { l.symbols.domains[face.domain].cells - 1 };
    let is_only = if l.symbols.is_periodic(face.domain) { Some(false) } else { l.is_number(face.at, only) };
    let Some(is_only) = is_only else { return l.poison() };
    let left = cell(l, near);
    if is_only {
        // Only one cell lies on that side: first order here.
        return left;
    }
    let (before, right) = (cell(l, behind), cell(l, across));
    let expr = if scheme == Scheme::Upwind2 {
        let share = beyond(l, face, near, behind);
        l.values().extrapolate(before.expr, left.expr, share)
    } else {
        l.values().limited(before.expr, left.expr, right.expr)
    };
    Value { expr, unit: left.unit }
}

/// Distance of a face from the centre of the cell near it, over the distance of that centre from
/// the one behind.
fn beyond(l: &mut Lowering<'_, '_>, face: Face, near: i64, behind: i64) -> ExprId {
    if l.symbols.is_uniform(face.domain) {
        return l.exprs.constant(0.5);
    }
    let x = grid::face_position(l, face.domain, face.at);
    let [near, behind] = [near, behind].map(|by| grid::centre(l, face.domain, face.at.shifted(by)));
    let (part, whole) = (l.exprs.sub(x, near), l.exprs.sub(near, behind));
    l.exprs.div(part, whole)
}

/// Returns whether a face is the low and the high end of its domain, which a periodic one does not
/// have; `None` after asking for a cut of the loop.
pub(in crate::elaborate::space) fn ends_at(l: &mut Lowering<'_, '_>, face: Face) -> Option<(bool, bool)> {
    if l.symbols.is_periodic(face.domain) {
        return Some((false, false));
    }
    let n = l.symbols.domains[face.domain].cells;
    let (low, high) = (l.is_number(face.at, 0), l.is_number(face.at, n));
    Some((low?, high?))
}

/// The cells that neighbours of the cells of a domain are: beyond an end of a periodic one those at
/// the other end. Asks for a cut of a loop that passes an end, whose result is dropped.
pub(in crate::elaborate) fn neighbours(l: &mut Lowering<'_, '_>, domain: DomainId, cell: Cell) -> Cell {
    if !l.symbols.is_periodic(domain) {
        return cell;
    }
    let n = l.symbols.domains[domain].cells;
    let (low, high) = cell.ends();
    let round = low.div_euclid(n);
    if round == high.div_euclid(n) {
        return cell.shifted(-round * n);
    }
    cell.along.into_iter().for_each(|along| (round..=high.div_euclid(n)).for_each(|k| l.cut(along, cell.turn(k * n))));
    Cell::single(0)
}

/// Position of the axis whose index is the face of `domain`.
fn face_index(axes: &[Axis], index: &[Expr], domain: DomainId, place: &Place) -> Option<usize> {
    axes.iter().zip(index).position(|(axis, e)| {
        *axis == Axis::Domain(domain)
            && matches!(&e.kind, ExprKind::Name(n) if matches!(place.bound(&n.text), Some(Bound::Face(d, _)) if *d == domain))
    })
}

/// The field in one cell, with the face's index bound to it.
pub(in crate::elaborate) fn in_cell(
    l: &mut Lowering<'_, '_>,
    symbol: SymbolId,
    index: &[Expr],
    span: Span,
    cell: Cell,
    domain: DomainId,
    place: &Place,
) -> Value {
    let mut inner = place.clone();
    inner.face = None;
    let cell = neighbours(l, domain, cell);
    for e in index {
        if let ExprKind::Name(n) = &e.kind
            && matches!(place.bound(&n.text), Some(Bound::Face(d, _)) if *d == domain)
        {
            inner = inner.bind(&n.text, Bound::Cell(domain, cell));
        }
    }
    l.symbol_value(symbol, index, span, &inner)
}

pub(in crate::elaborate) fn interpolate(l: &mut Lowering<'_, '_>, face: Face, left: ExprId, right: ExprId) -> ExprId {
    if l.symbols.is_uniform(face.domain) {
        let half = l.exprs.constant(0.5);
        let sum = l.exprs.add(left, right);
        return l.exprs.mul(half, sum);
    }
    let x = grid::face_position(l, face.domain, face.at);
    let (a, b) = (grid::centre(l, face.domain, face.at.shifted(-1)), grid::centre(l, face.domain, face.at));
    let (part, whole) = (l.exprs.sub(x, a), l.exprs.sub(b, a));
    let weight = l.exprs.div(part, whole);
    let difference = l.exprs.sub(right, left);
    let step = l.exprs.mul(weight, difference);
    l.exprs.add(left, step)
}

/// `grad(c[i, z])` inside a flux.
pub(in crate::elaborate) fn gradient(l: &mut Lowering<'_, '_>, span: Span, e: &Expr, place: &Place) -> Value {
    let Some(face) = place.face else {
        return l.fault(
            Diagnostic::error(codes::MISPLACED_FUNCTION, "a gradient lives on the faces: `grad` has a meaning inside a `flux` only", span)
                .help("declare `flux J[z] = -D*grad(c[z])` and use `div(J[z])`"),
        );
    };
    let Some((low, high)) = ends_at(l, face) else { return l.poison() };
    let unit = grid::ends(l, face.domain).0;
    let right = beside(l, face, if high { -1 } else { 0 }, e, place);
    if right.is_poison() {
        return right;
    }
    let gradient_unit = match &right.unit {
        Measure::Of(u) => units::over(&units::difference(u), &unit),
        _ => units::over(&Unit::one(), &unit),
    };
    if low || high {
        let expr = l.exprs.constant(0.0);
        return Value::of(expr, gradient_unit);
    }
    let left = beside(l, face, -1, e, place);
    let difference = l.exprs.sub(right.expr, left.expr);
    let distance = if l.symbols.is_uniform(face.domain) {
        grid::spacing(l, face.domain)
    } else {
        let (a, b) = (grid::centre(l, face.domain, face.at.shifted(-1)), grid::centre(l, face.domain, face.at));
        l.exprs.sub(b, a)
    };
    let expr = l.values().over_fixed(difference, distance);
    Value::of(expr, gradient_unit)
}

/// An expression in a cell next to the face: -1 the one below, 0 the one above.
fn beside(l: &mut Lowering<'_, '_>, face: Face, by: i64, e: &Expr, place: &Place) -> Value {
    let mut inner = place.clone();
    inner.face = None;
    let cell = neighbours(l, face.domain, face.at.shifted(by));
    for (name, bound) in place.all_bound() {
        if matches!(bound, Bound::Face(domain, _) if *domain == face.domain) {
            inner = inner.bind(name, Bound::Cell(face.domain, cell));
        }
    }
    l.value(e, &inner)
}

/// `upwind(v, c[z])`: the field from the side that the flow comes from, by the domain's scheme
/// where that is a directed one.
pub(in crate::elaborate) fn upwind<'m, 'a>(l: &mut Lowering<'m, 'a>, span: Span, velocity: &Expr, field: &Expr, place: &Place) -> Value {
    let Some(face) = place.face else {
        return l.fault(Diagnostic::error(codes::MISPLACED_FUNCTION, "`upwind` has a meaning inside a `flux` only", span));
    };
    let Some((low, high)) = ends_at(l, face) else { return l.poison() };
    let averaging = std::mem::replace(&mut l.fluxes.averaging, true);
    let v = l.value(velocity, place);
    l.fluxes.averaging = averaging;
    if v.is_poison() {
        return v;
    }
    if low || high {
        let value = beside(l, face, if low { 0 } else { -1 }, field, place);
        return told(l, value, v.expr, (span, face, place));
    }
    let sign = marks::reading(l).interval(v.expr);
    let side = |s: &mut Lowering<'m, 'a>, below: bool| value_from_side(s, face, below, &mut |s, by| beside(s, face, by, field, place));
    if sign.has_sign() {
        return side(l, sign.is_not_negative());
    }
    let (left, right) = (side(l, true), side(l, false));
    if left.is_poison() || right.is_poison() {
        return l.poison();
    }
    let zero = l.exprs.constant(0.0);
    let forward = l.exprs.compare(Compare::Le, zero, v.expr);
    let expr = l.exprs.select(forward, left.expr, right.expr);
    Value { expr: l.exprs.unary(UnaryFn::Smooth, expr), unit: left.unit }
}

/// A mark for what a call of `upwind` carries at an end, where its velocity may turn and something
/// asks which way it flows.
fn told(l: &mut Lowering<'_, '_>, beside: Value, velocity: ExprId, (span, face, place): (Span, Face, &Place)) -> Value {
    let Direction::When(holds) = forward(l, velocity) else { return beside };
    let Some(count) = l.fluxes.faces.as_ref().map(Vec::len).filter(|_| !beside.is_poison() && l.symbols.is_directed(face)) else {
        return beside;
    };
    let loads = l.exprs.below([beside.expr]).filter_map(|e| match l.exprs.node(e) {
        Node::Load { var, at, .. } => Some((*l.symbols.of_var.get(&var)?, at)),
        _ => None,
    });
    let loads: Vec<(SymbolId, Affine)> = loads.collect();
    let Some(&(symbol, first)) = loads.first() else { return beside };
    // With the counters of the loops around: the mark is another one in each pass.
    let along = loads.iter().map(|(_, at)| *at).find(|at| !at.is_constant()).unwrap_or(first);
    let range = marks::reading(l).interval(beside.expr);
    let odd = is_odd(&beside.unit.unit());
    let mark = l.exprs.load(l.hidden.builtins, Flavour::Value, Affine { offset: MARK + count as i64, ..along });
    let (index, place) = (Vec::new(), place.clone());
    let known = FaceValue { symbol, index, span, face, place, beside: beside.expr, mark, range, odd, velocity: false, told: Some(holds) };
    l.fluxes.faces.get_or_insert_default().push(known);
    Value { expr: mark, unit: beside.unit }
}

/// A mark for a field's value at a face; `beside` is the field in the cell below, or at the end.
fn marked(
    l: &mut Lowering<'_, '_>,
    (symbol, index, span): (SymbolId, &[Expr], Span),
    face: Face,
    place: &Place,
    beside: &Value,
    velocity: bool,
) -> Value {
    let Node::Load { var, flavour, at } = l.exprs.node(beside.expr) else { return beside.clone() };
    let range = marks::reading(l).declared_range(var, flavour, at);
    let Some(faces) = &mut l.fluxes.faces else { return beside.clone() };
    if let Some(known) = faces.iter_mut().find(|f| f.beside == beside.expr) {
        known.velocity |= velocity;
        return Value { expr: known.mark, unit: beside.unit.clone() };
    }
    let mark = Affine { offset: MARK + faces.len() as i64, ..at };
    let mark = l.exprs.load(l.hidden.builtins, Flavour::Value, mark);
    let odd = is_odd(&beside.unit.unit());
    let index = index.to_vec();
    let place = place.clone();
    faces.push(FaceValue { symbol, index, span, face, place, beside: beside.expr, mark, range, odd, velocity, told: None });
    Value { expr: mark, unit: beside.unit.clone() }
}
