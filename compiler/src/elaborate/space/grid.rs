//! Grids: ends, faces, centres, areas, measures.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::Expr;
use smpl_dsl::units::Unit;

use crate::elaborate::lower::loops::Cell;
use crate::elaborate::lower::place::{Bound, Place, Site};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, units};
use crate::elaborate::symbols::{DomainId, Geometry};
use crate::ir::{BinaryFn, ExprId};
impl Lowering<'_, '_> {
    /// Works out the ends of all domains: those that nothing needs may be at fault too.
    pub(in crate::elaborate) fn check_ends(&mut self) {
        let domains: Vec<DomainId> = self.symbols.domains.keys().collect();
        for domain in domains {
            self.ends(domain);
        }
    }

    /// Unit and ends of a domain.
    pub(in crate::elaborate) fn ends(&mut self, domain: DomainId) -> (Unit, ExprId, ExprId) {
        if let Some(ends) = self.grids.ends(domain) {
            return ends.clone();
        }
        let declaration = self.symbols.domains[domain].declaration;
        let place = Place::new(self.symbols.domains[domain].scope, Site::Dynamics);
        let (low, high) = (self.value(&declaration.range.0, &place), self.value(&declaration.range.1, &place));
        let unit = match (&low.unit, &high.unit) {
            (_, Measure::Of(u)) | (Measure::Of(u), _) => u.clone(),
            _ => Unit::one(),
        };
        let low = self.values().in_unit(low, &unit, declaration.range.0.span, "the end of the domain", declaration.range.1.span);
        let high = self.values().in_unit(high, &unit, declaration.range.1.span, "the end of the domain", declaration.range.0.span);
        self.check_fixed(low, declaration.range.0.span);
        self.check_fixed(high, declaration.range.1.span);
        let ends = (unit, low, high);
        self.grids.set(domain, ends.clone());
        ends
    }

    /// A grid rests: it depends on parameters only.
    fn check_fixed(&mut self, e: ExprId, span: Span) {
        if let Some(what) = self.symbols.varying(self.exprs, e) {
            self.ledger.report(
                Diagnostic::error(codes::WRONG_KIND, format!("the grid cannot depend on {what}: it does not move"), span)
                    .label("changes while the model runs")
                    .help("use parameters; for a moving boundary transform to a fixed coordinate"),
            );
        }
    }

    /// Width of every cell of a uniform grid.
    pub(in crate::elaborate) fn spacing(&mut self, domain: DomainId) -> ExprId {
        let (_, low, high) = self.ends(domain);
        let length = self.exprs.sub(high, low);
        let n = self.exprs.constant(self.symbols.domains[domain].cells as f64);
        self.exprs.div(length, n)
    }

    /// An expression of the grid in the number `k` of a face or cell.
    fn prescribed(&mut self, domain: DomainId, e: &Expr, k: ExprId, unit: &Unit) -> ExprId {
        let place = Place::new(self.symbols.domains[domain].scope, Site::Dynamics).bind("k", Bound::Number(k));
        let v = self.value(e, &place);
        let expr = self.values().in_unit(v, unit, e.span, "the grid", e.span);
        self.check_fixed(expr, e.span);
        expr
    }

    /// Position of a face.
    pub(in crate::elaborate) fn face_position(&mut self, domain: DomainId, face: Cell) -> ExprId {
        let (unit, low, high) = self.ends(domain);
        let declaration = self.symbols.domains[domain].declaration;
        let k = self.values().number(face, 0.0);
        if let Some(e) = &declaration.faces {
            return self.prescribed(domain, e, k, &unit);
        }
        if let Some(q) = &declaration.stretch {
            // Widths grow by the ratio q from cell to cell: x_k = low + length (q^k - 1)/(q^n - 1).
            let place = Place::new(self.symbols.domains[domain].scope, Site::Dynamics);
            let v = self.value(q, &place);
            let q = self.values().in_unit(v, &Unit::one(), q.span, "the ratio of neighbouring cells", q.span);
            let n = self.exprs.constant(self.symbols.domains[domain].cells as f64);
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

    pub(in crate::elaborate) fn centre(&mut self, domain: DomainId, cell: Cell) -> ExprId {
        if self.symbols.is_uniform(domain) {
            let (_, low, _) = self.ends(domain);
            let h = self.spacing(domain);
            let k = self.values().number(cell, 0.5);
            let x = self.exprs.mul(k, h);
            return self.exprs.add(low, x);
        }
        let (a, b) = (self.face_position(domain, cell), self.face_position(domain, cell.shifted(1)));
        let half = self.exprs.constant(0.5);
        let sum = self.exprs.add(a, b);
        self.exprs.mul(half, sum)
    }

    /// Centre of a cell: what `z` means as a number.
    pub(in crate::elaborate) fn cell_centre(&mut self, domain: DomainId, cell: Cell) -> Value {
        let unit = self.ends(domain).0;
        let expr = self.centre(domain, cell);
        Value::of(expr, unit)
    }

    /// Position of a face: what `z` means as a number inside a flux.
    pub(in crate::elaborate) fn face_position_value(&mut self, domain: DomainId, face: Cell) -> Value {
        let unit = self.ends(domain).0;
        let expr = self.face_position(domain, face);
        Value::of(expr, unit)
    }

    /// `width(z)`
    pub(in crate::elaborate) fn cell_width(&mut self, domain: DomainId, cell: Cell) -> Value {
        let unit = self.ends(domain).0;
        let expr = if self.symbols.is_uniform(domain) {
            self.spacing(domain)
        } else {
            let (a, b) = (self.face_position(domain, cell), self.face_position(domain, cell.shifted(1)));
            self.exprs.sub(b, a)
        };
        Value::of(expr, unit)
    }

    /// Area of a face without the angular factor (1, x, x²).
    pub(in crate::elaborate) fn area(&mut self, domain: DomainId, face: Cell) -> ExprId {
        if let Some(e) = &self.symbols.domains[domain].declaration.areas {
            let k = self.values().number(face, 0.0);
            let unit = self.area_unit(domain);
            return self.prescribed(domain, e, k, &unit);
        }
        match self.symbols.domains[domain].geometry {
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
        if let Some(e) = &self.symbols.domains[domain].declaration.areas {
            let k = self.exprs.constant(1.0);
            let place = Place::new(self.symbols.domains[domain].scope, Site::Dynamics).bind("k", Bound::Number(k));
            return self.value(e, &place).unit.unit();
        }
        let unit = self.ends(domain).0;
        let power = match self.symbols.domains[domain].geometry {
            Geometry::Planar => 0.0,
            Geometry::Cylindrical => 1.0,
            Geometry::Spherical => 2.0,
        };
        units::power(&unit, power).unwrap_or_else(Unit::one)
    }

    /// Measure of a cell without the angular factor.
    pub(in crate::elaborate) fn measure(&mut self, domain: DomainId, cell: Cell) -> ExprId {
        if let Some(e) = &self.symbols.domains[domain].declaration.volumes {
            let k = self.values().number(cell, 1.0);
            let unit = {
                let area = self.area_unit(domain);
                units::times(&area, &self.ends(domain).0)
            };
            return self.prescribed(domain, e, k, &unit);
        }
        let power = match self.symbols.domains[domain].geometry {
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
    pub(in crate::elaborate) fn cell_volume(&mut self, domain: DomainId, cell: Cell) -> Value {
        let unit = {
            let area = self.area_unit(domain);
            units::times(&area, &self.ends(domain).0)
        };
        let m = self.measure(domain, cell);
        let angle = match self.symbols.domains[domain].geometry {
            Geometry::Planar => 1.0,
            Geometry::Cylindrical => 2.0 * std::f64::consts::PI,
            Geometry::Spherical => 4.0 * std::f64::consts::PI,
        };
        let angle = self.exprs.constant(angle);
        let expr = self.exprs.mul(angle, m);
        Value::of(expr, unit)
    }
}
