//! Space: grids, values at faces, fluxes, divergence.
//!
//! Face `k` lies below cell `k` (both counted from 0): faces 0 and `n` are the ends. A flux is evaluated at a face; the divergence of a
//! cell takes the fluxes of its two faces, weighted with their areas, over the cell's measure, so that sums over cells telescope.

use std::rc::Rc;

use smpl_dsl::diagnostic::{Diagnostic, Label, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{self, Expr, ExprKind};
use smpl_dsl::units::Unit;

use super::cells::{Cell, Face};
use super::names::{Axis, DomainId, Geometry, Scheme, SymbolId, SymbolKind};
use super::quantity::{Measure, Value};
use super::{Bound, Elaborator, Place, Site, units};
use crate::ir::{BinaryFn, Compare, ExprId};

impl Elaborator<'_> {
    /// Works out the ends of all domains: those that nothing needs may be at fault too.
    pub(super) fn check_ends(&mut self) {
        let domains: Vec<DomainId> = self.names.domains.keys().collect();
        for domain in domains {
            self.ends(domain);
        }
    }

    /// Unit and ends of a domain.
    pub(super) fn ends(&mut self, domain: DomainId) -> (Unit, ExprId, ExprId) {
        if let Some(ends) = &self.names.domains[domain].ends {
            return ends.clone();
        }
        let declaration = self.names.domains[domain].declaration;
        let place = self.place(self.names.domains[domain].scope, Site::Dynamics);
        let (low, high) = (self.value(&declaration.range.0, &place), self.value(&declaration.range.1, &place));
        let unit = match (&low.unit, &high.unit) {
            (_, Measure::Of(u)) | (Measure::Of(u), _) => u.clone(),
            _ => Unit::one(),
        };
        let low = self.in_unit(low, &unit, declaration.range.0.span, "the end of the domain", declaration.range.1.span);
        let high = self.in_unit(high, &unit, declaration.range.1.span, "the end of the domain", declaration.range.0.span);
        self.check_fixed(low, declaration.range.0.span);
        self.check_fixed(high, declaration.range.1.span);
        let ends = (unit, low, high);
        self.names.domains[domain].ends = Some(ends.clone());
        ends
    }

    /// Names with units that do not fit in derivatives over space the domain whose ends have none.
    pub(super) fn blame_lengths(&mut self, before: usize, parts: &[&Expr]) {
        let mut over_space = false;
        let is_derivative = |e: &Expr| matches!(&e.kind, ExprKind::Call { function, .. } if matches!(&*function.text, "div" | "grad"));
        parts.iter().for_each(|e| e.walk(&mut |e| over_space |= is_derivative(e)));
        if self.diagnostics.len() == before || !over_space {
            return;
        }
        let is_bare = |d: &&super::names::Domain<'_>| d.ends.as_ref().is_some_and(|(unit, ..)| unit.is_one());
        let Some(domain) = self.names.domains.values().find(is_bare) else { return };
        let (name, (low, high)) = (&domain.name, &domain.declaration.range);
        let span = Span { end: high.span.end, ..low.span };
        for fault in self.diagnostics.iter_mut().skip(before).filter(|d| d.code == codes::UNIT_MISMATCH) {
            fault.secondary.push(Label { span, text: format!("`{name}` is a pure number") });
            fault.notes.push(format!("if `{name}` is a length, its ends need the unit: `domain {name} in 0 [m]..1 [m]`"));
        }
    }

    /// A grid rests: it depends on parameters only.
    fn check_fixed(&mut self, e: ExprId, span: Span) {
        if let Some(what) = self.varying(e) {
            self.report(
                Diagnostic::error(codes::WRONG_KIND, format!("the grid cannot depend on {what}: it does not move"), span)
                    .label("changes while the model runs")
                    .help("use parameters; for a moving boundary transform to a fixed coordinate"),
            );
        }
    }

    /// The number of a cell or face as a node.
    fn number(&mut self, cell: Cell, plus: f64) -> ExprId {
        let first = self.exprs.constant(cell.first as f64 + plus);
        match cell.along {
            None => first,
            Some(v) => {
                let counter = self.exprs.counter(v);
                self.exprs.add(counter, first)
            }
        }
    }

    /// Whether all cells have one width.
    fn is_uniform(&self, domain: DomainId) -> bool {
        let d = self.names.domains[domain].declaration;
        d.stretch.is_none() && d.faces.is_none()
    }

    /// Width of every cell of a uniform grid.
    fn spacing(&mut self, domain: DomainId) -> ExprId {
        let (_, low, high) = self.ends(domain);
        let length = self.exprs.sub(high, low);
        let n = self.exprs.constant(self.names.domains[domain].cells as f64);
        self.exprs.div(length, n)
    }

    /// An expression of the grid in the number `k` of a face or cell.
    fn prescribed(&mut self, domain: DomainId, e: &Expr, k: ExprId, unit: &Unit) -> ExprId {
        let place = self.place(self.names.domains[domain].scope, Site::Dynamics).bind("k", Bound::Number(k));
        let v = self.value(e, &place);
        let expr = self.in_unit(v, unit, e.span, "the grid", e.span);
        self.check_fixed(expr, e.span);
        expr
    }

    /// Position of a face.
    fn face_position(&mut self, domain: DomainId, face: Cell) -> ExprId {
        let (unit, low, high) = self.ends(domain);
        let declaration = self.names.domains[domain].declaration;
        let k = self.number(face, 0.0);
        if let Some(e) = &declaration.faces {
            return self.prescribed(domain, e, k, &unit);
        }
        if let Some(q) = &declaration.stretch {
            // Widths grow by the ratio q from cell to cell: x_k = low + length (q^k - 1)/(q^n - 1).
            let place = self.place(self.names.domains[domain].scope, Site::Dynamics);
            let v = self.value(q, &place);
            let q = self.in_unit(v, &Unit::one(), q.span, "the ratio of neighbouring cells", q.span);
            let n = self.exprs.constant(self.names.domains[domain].cells as f64);
            let one = self.exprs.constant(1.0);
            let (a, b) = (self.exprs.binary(BinaryFn::Pow, q, k), self.exprs.binary(BinaryFn::Pow, q, n));
            let (a, b) = (self.exprs.sub(a, one), self.exprs.sub(b, one));
            let share = self.exprs.div(a, b);
            let length = self.exprs.sub(high, low);
            let x = self.exprs.mul(length, share);
            return self.exprs.add(low, x);
        }
        let h = self.spacing(domain);
        let x = self.exprs.mul(k, h);
        self.exprs.add(low, x)
    }

    fn centre(&mut self, domain: DomainId, cell: Cell) -> ExprId {
        if self.is_uniform(domain) {
            let (_, low, _) = self.ends(domain);
            let h = self.spacing(domain);
            let k = self.number(cell, 0.5);
            let x = self.exprs.mul(k, h);
            return self.exprs.add(low, x);
        }
        let (a, b) = (self.face_position(domain, cell), self.face_position(domain, cell.shifted(1)));
        let half = self.exprs.constant(0.5);
        let sum = self.exprs.add(a, b);
        self.exprs.mul(half, sum)
    }

    /// Centre of a cell: what `z` means as a number.
    pub(super) fn cell_centre(&mut self, domain: DomainId, cell: Cell) -> Value {
        let unit = self.ends(domain).0;
        let expr = self.centre(domain, cell);
        Value::of(expr, unit)
    }

    /// Position of a face: what `z` means as a number inside a flux.
    pub(super) fn face_position_value(&mut self, domain: DomainId, face: Cell) -> Value {
        let unit = self.ends(domain).0;
        let expr = self.face_position(domain, face);
        Value::of(expr, unit)
    }

    /// `width(z)`
    pub(super) fn cell_width(&mut self, domain: DomainId, cell: Cell) -> Value {
        let unit = self.ends(domain).0;
        let expr = if self.is_uniform(domain) {
            self.spacing(domain)
        } else {
            let (a, b) = (self.face_position(domain, cell), self.face_position(domain, cell.shifted(1)));
            self.exprs.sub(b, a)
        };
        Value::of(expr, unit)
    }

    /// Area of a face without the angular factor (1, x, x²).
    fn area(&mut self, domain: DomainId, face: Cell) -> ExprId {
        if let Some(e) = &self.names.domains[domain].declaration.areas {
            let k = self.number(face, 0.0);
            let unit = self.area_unit(domain);
            return self.prescribed(domain, e, k, &unit);
        }
        match self.names.domains[domain].geometry {
            Geometry::Planar => self.exprs.constant(1.0),
            Geometry::Cylindrical => self.face_position(domain, face),
            Geometry::Spherical => {
                let x = self.face_position(domain, face);
                self.exprs.powi(x, 2)
            }
        }
    }

    /// Unit of the areas of faces; where they are prescribed, that of the expression.
    fn area_unit(&mut self, domain: DomainId) -> Unit {
        if let Some(e) = &self.names.domains[domain].declaration.areas {
            let k = self.exprs.constant(1.0);
            let place = self.place(self.names.domains[domain].scope, Site::Dynamics).bind("k", Bound::Number(k));
            return self.value(e, &place).unit.unit();
        }
        let unit = self.ends(domain).0;
        let power = match self.names.domains[domain].geometry {
            Geometry::Planar => 0.0,
            Geometry::Cylindrical => 1.0,
            Geometry::Spherical => 2.0,
        };
        units::power(&unit, power).unwrap_or_else(Unit::one)
    }

    /// Measure of a cell without the angular factor.
    fn measure(&mut self, domain: DomainId, cell: Cell) -> ExprId {
        if let Some(e) = &self.names.domains[domain].declaration.volumes {
            let k = self.number(cell, 1.0);
            let unit = {
                let area = self.area_unit(domain);
                units::times(&area, &self.ends(domain).0)
            };
            return self.prescribed(domain, e, k, &unit);
        }
        let power = match self.names.domains[domain].geometry {
            Geometry::Planar => return self.cell_width(domain, cell).expr,
            Geometry::Cylindrical => 2,
            Geometry::Spherical => 3,
        };
        let (a, b) = (self.face_position(domain, cell), self.face_position(domain, cell.shifted(1)));
        let (a, b) = (self.exprs.powi(a, power), self.exprs.powi(b, power));
        let difference = self.exprs.sub(b, a);
        let p = self.exprs.constant(f64::from(power));
        self.exprs.div(difference, p)
    }

    /// `volume(z)`: the measure with the angular factor.
    pub(super) fn cell_volume(&mut self, domain: DomainId, cell: Cell) -> Value {
        let unit = {
            let area = self.area_unit(domain);
            units::times(&area, &self.ends(domain).0)
        };
        let m = self.measure(domain, cell);
        let angle = match self.names.domains[domain].geometry {
            Geometry::Planar => 1.0,
            Geometry::Cylindrical => 2.0 * std::f64::consts::PI,
            Geometry::Spherical => 4.0 * std::f64::consts::PI,
        };
        let angle = self.exprs.constant(angle);
        let expr = self.exprs.mul(angle, m);
        Value::of(expr, unit)
    }

    /// Value of a field at the face of a flux; `None` where the indices do not mean the face.
    pub(super) fn face_value(
        &mut self,
        symbol: SymbolId,
        axes: &[Axis],
        index: &[Expr],
        span: Span,
        face: Face,
        place: &Place,
    ) -> Option<Value> {
        self.face_index(axes, index, face.domain, place)?;
        let n = self.names.domains[face.domain].cells;
        let (at_low, at_high) = (self.is_number(face.at, 0), self.is_number(face.at, n));
        let (Some(at_low), Some(at_high)) = (at_low, at_high) else { return Some(self.poison()) };
        let at = |s: &mut Self, by: i64| s.in_cell(symbol, index, span, face.at.shifted(by), face.domain, place);
        let is_marked = self.faces.is_some() && self.is_directed(face);
        if self.averaging || is_marked {
            let beside = at(self, if at_low { 0 } else { -1 });
            let marked = if is_marked { self.marked((symbol, index, span), face, place, &beside, self.averaging) } else { beside.clone() };
            if !self.averaging || at_low || at_high {
                return Some(if self.averaging { beside } else { marked });
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
        Some(match self.names.domains[face.domain].scheme {
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
    pub(super) fn value_from_side(&mut self, face: Face, below: bool, cell: &mut dyn FnMut(&mut Self, i64) -> Value) -> Value {
        // The cell on that side, the one behind it, and the one across the face.
        let (near, behind, across) = if below { (-1, -2, 0) } else { (0, 1, -1) };
        let scheme = self.names.domains[face.domain].scheme;
        if !matches!(scheme, Scheme::Upwind2 | Scheme::Limited) {
            return cell(self, near);
        }
        let only = if below { 1 } else { self.names.domains[face.domain].cells - 1 };
        let Some(is_only) = self.is_number(face.at, only) else { return self.poison() };
        let l = cell(self, near);
        if is_only {
            // Only one cell lies on that side: first order here.
            return l;
        }
        let (ll, r) = (cell(self, behind), cell(self, across));
        let expr = if scheme == Scheme::Upwind2 { self.extrapolate(ll.expr, l.expr) } else { self.limited(ll.expr, l.expr, r.expr) };
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
    pub(super) fn in_cell(&mut self, symbol: SymbolId, index: &[Expr], span: Span, cell: Cell, domain: DomainId, place: &Place) -> Value {
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

    pub(super) fn interpolate(&mut self, face: Face, l: ExprId, r: ExprId) -> ExprId {
        if self.is_uniform(face.domain) {
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

    fn extrapolate(&mut self, ll: ExprId, l: ExprId) -> ExprId {
        let half = self.exprs.constant(0.5);
        let difference = self.exprs.sub(l, ll);
        let step = self.exprs.mul(half, difference);
        self.exprs.add(l, step)
    }

    /// Van Leer's limiter: the harmonic mean of both differences where they have one sign, else first order.
    fn limited(&mut self, ll: ExprId, l: ExprId, r: ExprId) -> ExprId {
        let (a, b) = (self.exprs.sub(l, ll), self.exprs.sub(r, l));
        let product = self.exprs.mul(a, b);
        let sum = self.exprs.add(a, b);
        let zero = self.exprs.constant(0.0);
        let same_sign = self.exprs.compare(Compare::Lt, zero, product);
        let step = self.exprs.div(product, sum);
        let step = self.exprs.select(same_sign, step, zero);
        self.exprs.add(l, step)
    }

    /// `grad(c[i, z])` inside a flux.
    pub(super) fn gradient(&mut self, span: Span, e: &Expr, place: &Place) -> Value {
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
        let n = self.names.domains[face.domain].cells;
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
        let distance = if self.is_uniform(face.domain) {
            self.spacing(face.domain)
        } else {
            let (a, b) = (self.centre(face.domain, face.at.shifted(-1)), self.centre(face.domain, face.at));
            self.exprs.sub(b, a)
        };
        let expr = self.over_fixed(difference, distance);
        Value::of(expr, gradient_unit)
    }

    /// A quotient by a length of the grid: its reciprocal is known before the solve, and a product takes a tenth of the time.
    fn over_fixed(&mut self, value: ExprId, length: ExprId) -> ExprId {
        let one = self.exprs.constant(1.0);
        let reciprocal = self.exprs.div(one, length);
        self.exprs.mul(value, reciprocal)
    }

    /// An expression in a cell beside the face: -1 the one below, 0 the one above.
    fn beside(&mut self, face: Face, by: i64, e: &Expr, place: &Place) -> Value {
        let mut inner = place.clone();
        inner.face = None;
        let mut bound = place.bindings.as_ref();
        while let Some(b) = bound {
            if matches!(&b.to, Bound::Face(d, _) if *d == face.domain) {
                inner = inner.bind(&b.name, Bound::Cell(face.domain, face.at.shifted(by)));
            }
            bound = b.next.as_ref();
        }
        self.value(e, &inner)
    }

    /// `upwind(v, c[z])`: the field from the side that the flow comes from, by the domain's scheme where that is a directed one.
    pub(super) fn upwind(&mut self, span: Span, velocity: &Expr, field: &Expr, place: &Place) -> Value {
        let Some(face) = place.face else {
            return self.fault(Diagnostic::error(codes::MISPLACED_FUNCTION, "`upwind` has a meaning inside a `flux` only", span));
        };
        let n = self.names.domains[face.domain].cells;
        let (Some(low), Some(high)) = (self.is_number(face.at, 0), self.is_number(face.at, n)) else {
            return self.poison();
        };
        let averaging = std::mem::replace(&mut self.averaging, true);
        let v = self.value(velocity, place);
        self.averaging = averaging;
        if v.is_poison() {
            return v;
        }
        if low || high {
            return self.beside(face, if low { 0 } else { -1 }, field, place);
        }
        let sign = self.interval(v.expr);
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

    /// A flux at a face, with its leading indices bound.
    fn flux_at(&mut self, symbol: SymbolId, leading: &[Bound], face: Face, place: &Place) -> Value {
        // It may stand in another flux, whose face values are not its own.
        let (faces, averaging) = (self.faces.take(), std::mem::take(&mut self.averaging));
        let v = self.own_flux_at(symbol, leading, face, place);
        (self.faces, self.averaging) = (faces, averaging);
        v
    }

    fn own_flux_at(&mut self, symbol: SymbolId, leading: &[Bound], face: Face, place: &Place) -> Value {
        let SymbolKind::Flux { flux, binders, .. } = self.names.symbols[symbol].kind.clone() else { return self.poison() };
        self.expanded.insert(symbol);
        let n = self.names.domains[face.domain].cells;
        let (Some(low), Some(high)) = (self.is_number(face.at, 0), self.is_number(face.at, n)) else {
            return self.poison();
        };
        let mut inner = place.clone();
        inner.scope = self.names.symbols[symbol].scope;
        inner.bindings = None;
        inner.face = None;
        for (name, bound) in binders.iter().zip(leading) {
            inner = inner.bind(name, bound.clone());
        }
        let end = if low {
            flux.low.as_ref()
        } else if high {
            flux.high.as_ref()
        } else {
            None
        };
        let mut at_face = inner.clone();
        if let Some(z) = binders.last() {
            at_face = at_face.bind(z, Bound::Face(face.domain, face.at));
        }
        at_face.face = Some(face);
        if let Some(e) = end {
            let mut v = self.value(e, &inner);
            if self.is_directed(face) {
                v = self.entering(v, flux, low, &at_face);
            }
            return self.flux_in_unit(v, flux, e.span, &inner);
        }
        let v = if self.is_directed(face) && !low && !high { self.directed(flux, &at_face) } else { self.value(&flux.inner, &at_face) };
        self.flux_in_unit(v, flux, flux.inner.span, &inner)
    }

    /// A value of a flux in the unit that it declares.
    fn flux_in_unit(&mut self, v: Value, flux: &syntax::Flux, span: Span, place: &Place) -> Value {
        let Some(written) = &flux.unit else { return v };
        if v.is_poison() {
            return v;
        }
        let Some(unit) = self.unit(written, place) else { return self.poison() };
        let reports = self.diagnostics.len();
        let expr = self.strictly_in(v, &unit, span, &format!("the flux `{}`", flux.name.text), flux.name.span);
        if self.diagnostics.len() > reports { self.poison() } else { Value::of(expr, unit) }
    }

    /// `J[i, z.low]`, `J[i, z.high]`: the flux at an end.
    pub(super) fn flux_at_end(&mut self, symbol: SymbolId, index: &[Expr], span: Span, place: &Place) -> Value {
        let Some((axes, last)) = self.flux_axes(symbol, index, span) else { return self.poison() };
        let Axis::Domain(domain) = axes[axes.len() - 1] else { return self.poison() };
        let end = match &last.kind {
            ExprKind::Member(base, end) if self.domain_of(base, place) == Some(domain) => match end.text.as_str() {
                "low" => Some(0),
                "high" => Some(self.names.domains[domain].cells),
                _ => None,
            },
            _ => None,
        };
        let Some(number) = end else {
            return self.fault(
                Diagnostic::error(codes::WRONG_KIND, "a flux has values at faces, not in cells", span)
                    .help("take its divergence, `div(J[z])`, or its value at an end, `J[z.low]`, `J[z.high]`"),
            );
        };
        let Some((_, leading)) = self.address(symbol, &axes[..axes.len() - 1], &index[..index.len() - 1], span, place) else {
            return self.poison();
        };
        let mut outer = place.clone();
        outer.face = None;
        self.flux_at(symbol, &leading, Face { domain, at: Cell::single(number) }, &outer)
    }

    fn flux_axes<'e>(&mut self, symbol: SymbolId, index: &'e [Expr], span: Span) -> Option<(Rc<[Axis]>, &'e Expr)> {
        let SymbolKind::Flux { axes, .. } = &self.names.symbols[symbol].kind else { return None };
        let axes = axes.clone();
        match index.last() {
            Some(last) if index.len() == axes.len() => Some((axes, last)),
            _ => {
                let path = self.names.symbols[symbol].path.clone();
                let wanted: Vec<&str> = axes.iter().map(|&a| self.names.axis_name(a)).collect();
                let help = format!("write `{path}[{}]`", wanted.join(", "));
                self.report(Diagnostic::error(codes::WRONG_SHAPE, format!("`{path}` needs its indices"), span).help(help));
                None
            }
        }
    }

    /// `div(J[i, z])`: what leaves the cell, over its measure.
    pub(super) fn divergence(&mut self, span: Span, e: &Expr, place: &Place) -> Value {
        let ExprKind::Index(base, index) = &e.kind else {
            return self.fault(Diagnostic::error(codes::WRONG_KIND, "`div` takes a flux with its indices", span).help("`div(J[z])`"));
        };
        let symbol = match self.resolve(base, place) {
            super::indices::Target::Symbol(symbol) => symbol,
            super::indices::Target::Value(v) if v.is_poison() => return v,
            super::indices::Target::Nothing => return self.poison(),
            super::indices::Target::Value(_) => {
                return self.fault(Diagnostic::error(codes::WRONG_KIND, "`div` takes a flux", span));
            }
        };
        if matches!(self.names.symbols[symbol].kind, SymbolKind::Faulty) {
            return self.poison();
        }
        if !matches!(self.names.symbols[symbol].kind, SymbolKind::Flux { .. }) {
            let path = self.names.symbols[symbol].path.clone();
            let declared = self.names.symbols[symbol].span;
            return self.fault(
                Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is no flux"), e.span)
                    .secondary(declared, "declared here")
                    .help("declare `flux J[z] = v*c[z]` and write `div(J[z])`"),
            );
        }
        let Some((axes, last)) = self.flux_axes(symbol, index, span) else { return self.poison() };
        let Some(&Axis::Domain(domain)) = axes.last() else { return self.poison() };
        let Some((_, bounds)) = self.address(symbol, &axes, index, last.span, place) else { return self.poison() };
        let Some(Bound::Cell(_, cell)) = bounds.last().cloned() else { return self.poison() };
        let leading = &bounds[..bounds.len() - 1];
        let mut outer = place.clone();
        outer.face = None;
        let inflow = self.flux_at(symbol, leading, Face { domain, at: cell }, &outer);
        let outflow = self.flux_at(symbol, leading, Face { domain, at: cell.shifted(1) }, &outer);
        if inflow.is_poison() || outflow.is_poison() {
            return self.poison();
        }
        let SymbolKind::Flux { flux, .. } = &self.names.symbols[symbol].kind else { return self.poison() };
        // The inner faces say what the flux is; a boundary value must agree with them.
        let last = self.names.domains[domain].cells - 1;
        let low_end = flux.low.as_ref().filter(|_| cell.first == 0 && cell.count == 1);
        let high_end = flux.high.as_ref().filter(|_| cell.first == last && cell.count == 1);
        let (inner_span, low_span) = (flux.inner.span, low_end.map_or(flux.inner.span, |e| e.span));
        let high_span = high_end.map_or(inner_span, |e| e.span);
        let (first, second) = if high_end.is_some() { (&inflow.unit, &outflow.unit) } else { (&outflow.unit, &inflow.unit) };
        let unit = match (first, second) {
            (Measure::Of(u), _) | (_, Measure::Of(u)) => u.clone(),
            _ => Unit::one(),
        };
        let what = format!("the flux `{}`", self.names.symbols[symbol].path);
        let inflow = self.strictly_in(inflow, &unit, low_span, &what, inner_span);
        let outflow = self.strictly_in(outflow, &unit, high_span, &what, inner_span);
        let (a, b) = (self.area(domain, cell), self.area(domain, cell.shifted(1)));
        let (inflow, outflow) = (self.exprs.mul(a, inflow), self.exprs.mul(b, outflow));
        let net = self.exprs.sub(outflow, inflow);
        let measure = self.measure(domain, cell);
        let expr = self.over_fixed(net, measure);
        let length = self.ends(domain).0;
        Value::of(expr, units::over(&unit, &length))
    }
}
