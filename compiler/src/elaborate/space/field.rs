//! Values of fields at faces and beside them.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind};
use smpl_dsl::units::Unit;

use crate::elaborate::lower::loops::{Cell, Face};
use crate::elaborate::lower::place::{Bound, Place};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, units};
use crate::elaborate::symbols::{Axis, DomainId, Scheme, SymbolId};
use crate::ir::{Compare, ExprId};
impl Lowering<'_, '_> {
    /// Value of a field at the face of a flux; `None` where the indices do not mean the face.
    pub(in crate::elaborate) fn face_value(
        &mut self,
        symbol: SymbolId,
        axes: &[Axis],
        index: &[Expr],
        span: Span,
        face: Face,
        place: &Place,
    ) -> Option<Value> {
        self.face_index(axes, index, face.domain, place)?;
        let n = self.symbols.domains[face.domain].cells;
        let (at_low, at_high) = (self.is_number(face.at, 0), self.is_number(face.at, n));
        let (Some(at_low), Some(at_high)) = (at_low, at_high) else { return Some(self.poison()) };
        let at = |s: &mut Self, by: i64| s.in_cell(symbol, index, span, face.at.shifted(by), face.domain, place);
        let is_marked = self.fluxes.faces.is_some() && self.symbols.is_directed(face);
        if self.fluxes.averaging || is_marked {
            let beside = at(self, if at_low { 0 } else { -1 });
            let marked =
                if is_marked { self.marked((symbol, index, span), face, place, &beside, self.fluxes.averaging) } else { beside.clone() };
            if !self.fluxes.averaging || at_low || at_high {
                return Some(if self.fluxes.averaging { beside } else { marked });
            }
            let above = at(self, 0);
            let expr = self.interpolate(face, beside.expr, above.expr);
            return Some(Value { expr, unit: beside.unit });
        }
        if at_low {
            return Some(at(self, 0));
        }
        if at_high {
            return Some(at(self, -1));
        }
        Some(match self.symbols.domains[face.domain].scheme {
            Scheme::Upwind | Scheme::Upwind2 | Scheme::Limited => self.value_from_side(face, true, &mut |s, by| at(s, by)),
            Scheme::Downwind => at(self, 0),
            Scheme::Central => {
                let (l, r) = (at(self, -1), at(self, 0));
                let expr = self.interpolate(face, l.expr, r.expr);
                Value { expr, unit: l.unit }
            }
        })
    }

    /// A value at an inner face by the domain's scheme, from below or from above; `cell` gives it in the cell so many above the face.
    pub(in crate::elaborate) fn value_from_side(
        &mut self,
        face: Face,
        below: bool,
        cell: &mut dyn FnMut(&mut Self, i64) -> Value,
    ) -> Value {
        // The cell on that side, the one behind it, and the one across the face.
        let (near, behind, across) = if below { (-1, -2, 0) } else { (0, 1, -1) };
        let scheme = self.symbols.domains[face.domain].scheme;
        if !matches!(scheme, Scheme::Upwind2 | Scheme::Limited) {
            return cell(self, near);
        }
        let only = if below { 1 } else { self.symbols.domains[face.domain].cells - 1 };
        let Some(is_only) = self.is_number(face.at, only) else { return self.poison() };
        let l = cell(self, near);
        if is_only {
            // Only one cell lies on that side: first order here.
            return l;
        }
        let (ll, r) = (cell(self, behind), cell(self, across));
        let expr = if scheme == Scheme::Upwind2 {
            self.values().extrapolate(ll.expr, l.expr)
        } else {
            self.values().limited(ll.expr, l.expr, r.expr)
        };
        Value { expr, unit: l.unit }
    }

    /// Position of the axis whose index is the face of `domain`.
    fn face_index(&self, axes: &[Axis], index: &[Expr], domain: DomainId, place: &Place) -> Option<usize> {
        axes.iter().zip(index).position(|(axis, e)| {
            *axis == Axis::Domain(domain)
                && matches!(&e.kind, ExprKind::Name(n) if matches!(place.bound(&n.text), Some(Bound::Face(d, _)) if *d == domain))
        })
    }

    /// The field in one cell, with the face's index bound to it.
    pub(in crate::elaborate) fn in_cell(
        &mut self,
        symbol: SymbolId,
        index: &[Expr],
        span: Span,
        cell: Cell,
        domain: DomainId,
        place: &Place,
    ) -> Value {
        let mut inner = place.clone();
        inner.face = None;
        for e in index {
            if let ExprKind::Name(n) = &e.kind
                && matches!(place.bound(&n.text), Some(Bound::Face(d, _)) if *d == domain)
            {
                inner = inner.bind(&n.text, Bound::Cell(domain, cell));
            }
        }
        self.symbol_value(symbol, index, span, &inner)
    }

    pub(in crate::elaborate) fn interpolate(&mut self, face: Face, l: ExprId, r: ExprId) -> ExprId {
        if self.symbols.is_uniform(face.domain) {
            let half = self.exprs.constant(0.5);
            let sum = self.exprs.add(l, r);
            return self.exprs.mul(half, sum);
        }
        let x = self.face_position(face.domain, face.at);
        let (a, b) = (self.centre(face.domain, face.at.shifted(-1)), self.centre(face.domain, face.at));
        let (part, whole) = (self.exprs.sub(x, a), self.exprs.sub(b, a));
        let weight = self.exprs.div(part, whole);
        let difference = self.exprs.sub(r, l);
        let step = self.exprs.mul(weight, difference);
        self.exprs.add(l, step)
    }

    /// `grad(c[i, z])` inside a flux.
    pub(in crate::elaborate) fn gradient(&mut self, span: Span, e: &Expr, place: &Place) -> Value {
        let Some(face) = place.face else {
            return self.fault(
                Diagnostic::error(
                    codes::MISPLACED_FUNCTION,
                    "a gradient lives on the faces: `grad` has a meaning inside a `flux` only",
                    span,
                )
                .help("declare `flux J[z] = -D*grad(c[z])` and use `div(J[z])`"),
            );
        };
        let n = self.symbols.domains[face.domain].cells;
        let (Some(low), Some(high)) = (self.is_number(face.at, 0), self.is_number(face.at, n)) else {
            return self.poison();
        };
        let unit = self.ends(face.domain).0;
        let r = self.beside(face, if high { -1 } else { 0 }, e, place);
        if r.is_poison() {
            return r;
        }
        let gradient_unit = match &r.unit {
            Measure::Of(u) => units::over(&units::difference(u), &unit),
            _ => units::over(&Unit::one(), &unit),
        };
        if low || high {
            let expr = self.exprs.constant(0.0);
            return Value::of(expr, gradient_unit);
        }
        let l = self.beside(face, -1, e, place);
        let difference = self.exprs.sub(r.expr, l.expr);
        let distance = if self.symbols.is_uniform(face.domain) {
            self.spacing(face.domain)
        } else {
            let (a, b) = (self.centre(face.domain, face.at.shifted(-1)), self.centre(face.domain, face.at));
            self.exprs.sub(b, a)
        };
        let expr = self.values().over_fixed(difference, distance);
        Value::of(expr, gradient_unit)
    }

    /// An expression in a cell beside the face: -1 the one below, 0 the one above.
    fn beside(&mut self, face: Face, by: i64, e: &Expr, place: &Place) -> Value {
        let mut inner = place.clone();
        inner.face = None;
        for (name, bound) in place.all_bound() {
            if matches!(bound, Bound::Face(domain, _) if *domain == face.domain) {
                inner = inner.bind(name, Bound::Cell(face.domain, face.at.shifted(by)));
            }
        }
        self.value(e, &inner)
    }

    /// `upwind(v, c[z])`: the field from the side that the flow comes from, by the domain's scheme where that is a directed one.
    pub(in crate::elaborate) fn upwind(&mut self, span: Span, velocity: &Expr, field: &Expr, place: &Place) -> Value {
        let Some(face) = place.face else {
            return self.fault(Diagnostic::error(codes::MISPLACED_FUNCTION, "`upwind` has a meaning inside a `flux` only", span));
        };
        let n = self.symbols.domains[face.domain].cells;
        let (Some(low), Some(high)) = (self.is_number(face.at, 0), self.is_number(face.at, n)) else {
            return self.poison();
        };
        let averaging = std::mem::replace(&mut self.fluxes.averaging, true);
        let v = self.value(velocity, place);
        self.fluxes.averaging = averaging;
        if v.is_poison() {
            return v;
        }
        if low || high {
            return self.beside(face, if low { 0 } else { -1 }, field, place);
        }
        let sign = self.reading().interval(v.expr);
        let side = |s: &mut Self, below: bool| s.value_from_side(face, below, &mut |s, by| s.beside(face, by, field, place));
        if sign.has_sign() {
            return side(self, sign.is_not_negative());
        }
        let (l, r) = (side(self, true), side(self, false));
        if l.is_poison() || r.is_poison() {
            return self.poison();
        }
        let zero = self.exprs.constant(0.0);
        let forward = self.exprs.compare(Compare::Le, zero, v.expr);
        let expr = self.exprs.select(forward, l.expr, r.expr);
        Value { expr, unit: l.unit }
    }
}
