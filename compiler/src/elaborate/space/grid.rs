//! Grids: ends, faces, centres, areas, measures.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::Expr;
use smpl_dsl::units::Unit;

use crate::elaborate::lower::loops::{Cell, Face};
use crate::elaborate::lower::place::{Bound, Place, Site};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, units};
use crate::elaborate::symbols::{DomainId, Geometry};
use crate::ir::{BinaryFn, Compare, ExprId, UnaryFn};

/// Ratio of the widths of neighbouring cells.
pub(in crate::elaborate::space) fn ratio(l: &mut Lowering<'_, '_>, domain: DomainId, text: &Expr) -> ExprId {
    let place = Place::new(l.symbols.domains[domain].scope, Site::Dynamics);
    let v = l.value(text, &place);
    let expr = l.values().in_unit(v, &Unit::one(), text.span, "the ratio of neighbouring cells", text.span);
    check_fixed(l, expr, text.span);
    expr
}

/// Share of a graded domain below its face `k`: (q^k - 1)/(q^n - 1), and its limit where q is 1.
fn share_below(l: &mut Lowering<'_, '_>, q: ExprId, k: ExprId, n: ExprId) -> ExprId {
    let one = l.exprs.constant(1.0);
    let (a, b) = (l.exprs.binary(BinaryFn::Pow, q, k), l.exprs.binary(BinaryFn::Pow, q, n));
    let (a, b) = (l.exprs.sub(a, one), l.exprs.sub(b, one));
    let share = l.exprs.div(a, b);
    // k/n (1 + (k - n)/2 (q - 1)), to second order in q - 1.
    let excess = l.exprs.sub(q, one);
    let (half, near) = (l.exprs.constant(0.5), l.exprs.constant(1e-7));
    let (even, behind) = (l.exprs.div(k, n), l.exprs.sub(k, n));
    let slope = l.exprs.mul(half, behind);
    let change = l.exprs.mul(slope, excess);
    let change = l.exprs.add(one, change);
    let limit = l.exprs.mul(even, change);
    let size = l.exprs.unary(UnaryFn::Abs, excess);
    let is_even = l.exprs.compare(Compare::Lt, size, near);
    l.exprs.select(is_even, limit, share)
}

/// Unit and ends of a domain.
pub(in crate::elaborate) fn ends(l: &mut Lowering<'_, '_>, domain: DomainId) -> (Unit, ExprId, ExprId) {
    if let Some(ends) = l.grids.ends(domain) {
        return ends.clone();
    }
    let declaration = l.symbols.domains[domain].declaration;
    let place = Place::new(l.symbols.domains[domain].scope, Site::Dynamics);
    let (low, high) = (l.value(&declaration.range.0, &place), l.value(&declaration.range.1, &place));
    let unit = match (&low.unit, &high.unit) {
        (_, Measure::Of(u)) | (Measure::Of(u), _) => u.clone(),
        _ => Unit::one(),
    };
    let low = l.values().in_unit(low, &unit, declaration.range.0.span, "the end of the domain", declaration.range.1.span);
    let high = l.values().in_unit(high, &unit, declaration.range.1.span, "the end of the domain", declaration.range.0.span);
    check_fixed(l, low, declaration.range.0.span);
    check_fixed(l, high, declaration.range.1.span);
    let ends = (unit, low, high);
    l.grids.set(domain, ends.clone());
    ends
}

/// A grid rests: it depends on parameters only.
fn check_fixed(l: &mut Lowering<'_, '_>, e: ExprId, span: Span) {
    if let Some(what) = l.symbols.varying(l.exprs, e) {
        l.ledger.report(
            Diagnostic::error(codes::WRONG_KIND, format!("the grid cannot depend on {what}: it does not move"), span)
                .label("changes while the model runs")
                .help("use parameters; for a moving boundary transform to a fixed coordinate"),
        );
    }
}

/// Width of every cell of a uniform grid.
pub(in crate::elaborate) fn spacing(l: &mut Lowering<'_, '_>, domain: DomainId) -> ExprId {
    let (_, low, high) = ends(l, domain);
    let length = l.exprs.sub(high, low);
    let n = l.exprs.constant(l.symbols.domains[domain].cells as f64);
    l.exprs.div(length, n)
}

/// An expression of the grid in the number `k` of a face or cell.
pub(in crate::elaborate::space) fn prescribed(l: &mut Lowering<'_, '_>, domain: DomainId, e: &Expr, k: ExprId, unit: &Unit) -> ExprId {
    let place = Place::new(l.symbols.domains[domain].scope, Site::Dynamics).bind("k", Bound::Number(k));
    let v = l.value(e, &place);
    let expr = l.values().in_unit(v, unit, e.span, "the grid", e.span);
    check_fixed(l, expr, e.span);
    expr
}

/// Position of a face.
pub(in crate::elaborate) fn face_position(l: &mut Lowering<'_, '_>, domain: DomainId, face: Cell) -> ExprId {
    let (unit, low, high) = ends(l, domain);
    let declaration = l.symbols.domains[domain].declaration;
    let k = l.values().number(face, 0.0);
    if let Some(e) = &declaration.faces {
        return prescribed(l, domain, e, k, &unit);
    }
    if let Some(q) = &declaration.stretch {
        // Widths grow by the ratio q from cell to cell: x_k = low + length (q^k - 1)/(q^n - 1).
        let q = ratio(l, domain, q);
        let n = l.exprs.constant(l.symbols.domains[domain].cells as f64);
        let share = share_below(l, q, k, n);
        let length = l.exprs.sub(high, low);
        let x = l.exprs.mul(length, share);
        return l.exprs.add(low, x);
    }
    let h = spacing(l, domain);
    let x = l.exprs.mul(k, h);
    l.exprs.add(low, x)
}

/// A face of a periodic domain, whose last face is its first one; `None` after asking for a cut.
pub(in crate::elaborate::space) fn one_seam(l: &mut Lowering<'_, '_>, face: Face) -> Option<Face> {
    if !l.symbols.is_periodic(face.domain) {
        return Some(face);
    }
    let n = l.symbols.domains[face.domain].cells;
    Some(if l.is_number(face.at, n)? { Face { at: Cell::single(0), ..face } } else { face })
}

/// Centre of a cell; of one beyond the end of a periodic domain as if it went on there.
pub(in crate::elaborate) fn centre(l: &mut Lowering<'_, '_>, domain: DomainId, cell: Cell) -> ExprId {
    if l.symbols.is_uniform(domain) {
        let (_, low, _) = ends(l, domain);
        let h = spacing(l, domain);
        let k = l.values().number(cell, 0.5);
        let x = l.exprs.mul(k, h);
        return l.exprs.add(low, x);
    }
    let cells = if l.symbols.is_periodic(domain) { l.symbols.domains[domain].cells } else { 0 };
    let beyond = if cell.last() < 0 { -1 } else { i64::from(cells > 0 && cell.first >= cells) };
    let inside = cell.shifted(-beyond * cells);
    let (a, b) = (face_position(l, domain, inside), face_position(l, domain, inside.shifted(1)));
    let half = l.exprs.constant(0.5);
    let sum = l.exprs.add(a, b);
    let centre = l.exprs.mul(half, sum);
    if cells == 0 || beyond == 0 {
        return centre;
    }
    let (_, low, high) = ends(l, domain);
    let length = if beyond > 0 { l.exprs.sub(high, low) } else { l.exprs.sub(low, high) };
    l.exprs.add(centre, length)
}

/// Centre of a cell: what `z` means as a number.
pub(in crate::elaborate) fn cell_centre(l: &mut Lowering<'_, '_>, domain: DomainId, cell: Cell) -> Value {
    let unit = ends(l, domain).0;
    let expr = centre(l, domain, cell);
    Value::of(expr, unit)
}

/// Position of a face: what `z` means as a number inside a flux.
pub(in crate::elaborate) fn face_position_value(l: &mut Lowering<'_, '_>, domain: DomainId, face: Cell) -> Value {
    let unit = ends(l, domain).0;
    let expr = face_position(l, domain, face);
    Value::of(expr, unit)
}

/// `width(z)`
pub(in crate::elaborate) fn cell_width(l: &mut Lowering<'_, '_>, domain: DomainId, cell: Cell) -> Value {
    let unit = ends(l, domain).0;
    let expr = if l.symbols.is_uniform(domain) {
        spacing(l, domain)
    } else {
        let (a, b) = (face_position(l, domain, cell), face_position(l, domain, cell.shifted(1)));
        l.exprs.sub(b, a)
    };
    Value::of(expr, unit)
}

/// Area of a face without the angular factor (1, x, x²).
pub(in crate::elaborate) fn area(l: &mut Lowering<'_, '_>, domain: DomainId, face: Cell) -> ExprId {
    if let Some(e) = &l.symbols.domains[domain].declaration.areas {
        let seam = l.symbols.is_periodic(domain) && face == Cell::single(l.symbols.domains[domain].cells);
        let k = l.values().number(if seam { Cell::single(0) } else { face }, 0.0);
        let unit = area_unit(l, domain);
        return prescribed(l, domain, e, k, &unit);
    }
    match l.symbols.domains[domain].geometry {
        Geometry::Planar => l.exprs.constant(1.0),
        Geometry::Cylindrical => face_position(l, domain, face),
        Geometry::Spherical => {
            let x = face_position(l, domain, face);
            l.exprs.powi(x, 2)
        }
    }
}

/// Unit of the areas of faces; where they are prescribed, that of the expression.
pub(in crate::elaborate::space) fn area_unit(l: &mut Lowering<'_, '_>, domain: DomainId) -> Unit {
    if let Some(e) = &l.symbols.domains[domain].declaration.areas {
        let k = l.exprs.constant(1.0);
        let place = Place::new(l.symbols.domains[domain].scope, Site::Dynamics).bind("k", Bound::Number(k));
        return l.value(e, &place).unit.unit();
    }
    let unit = ends(l, domain).0;
    let power = match l.symbols.domains[domain].geometry {
        Geometry::Planar => 0.0,
        Geometry::Cylindrical => 1.0,
        Geometry::Spherical => 2.0,
    };
    units::power(&unit, power).unwrap_or_else(Unit::one)
}

/// Measure of a cell without the angular factor.
pub(in crate::elaborate) fn measure(l: &mut Lowering<'_, '_>, domain: DomainId, cell: Cell) -> ExprId {
    if let Some(e) = &l.symbols.domains[domain].declaration.volumes {
        let k = l.values().number(cell, 1.0);
        let unit = {
            let area = area_unit(l, domain);
            units::times(&area, &ends(l, domain).0)
        };
        return prescribed(l, domain, e, k, &unit);
    }
    let power = match l.symbols.domains[domain].geometry {
        Geometry::Planar => return cell_width(l, domain, cell).expr,
        Geometry::Cylindrical => 2,
        Geometry::Spherical => 3,
    };
    let (a, b) = (face_position(l, domain, cell), face_position(l, domain, cell.shifted(1)));
    let (a, b) = (l.exprs.powi(a, power), l.exprs.powi(b, power));
    let difference = l.exprs.sub(b, a);
    let p = l.exprs.constant(f64::from(power));
    l.exprs.div(difference, p)
}

/// `volume(z)`: the measure with the angular factor.
pub(in crate::elaborate) fn cell_volume(l: &mut Lowering<'_, '_>, domain: DomainId, cell: Cell) -> Value {
    let unit = {
        let area = area_unit(l, domain);
        units::times(&area, &ends(l, domain).0)
    };
    let m = measure(l, domain, cell);
    let angle = match l.symbols.domains[domain].geometry {
        Geometry::Planar => 1.0,
        Geometry::Cylindrical => 2.0 * std::f64::consts::PI,
        Geometry::Spherical => 4.0 * std::f64::consts::PI,
    };
    let angle = l.exprs.constant(angle);
    let expr = l.exprs.mul(angle, m);
    Value::of(expr, unit)
}
