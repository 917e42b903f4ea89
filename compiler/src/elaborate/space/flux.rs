//! Fluxes at faces, and their divergence.

use smpl_dsl::diagnostic::{Diagnostic, Label, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind, Flux};
use smpl_dsl::units::Unit;

use crate::elaborate::lower::loops::{Cell, Face};
use crate::elaborate::lower::place::{Bound, Place};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, units};
use crate::elaborate::symbols::{Axis, DomainId, SymbolId, SymbolKind};
impl Lowering<'_, '_> {
    /// A flux at a face, with its leading indices bound.
    fn flux_at(&mut self, symbol: SymbolId, leading: &[Bound], face: Face, place: &Place) -> Value {
        // It may stand in another flux, whose face values are not its own.
        let (faces, averaging) = (self.fluxes.faces.take(), std::mem::take(&mut self.fluxes.averaging));
        let v = self.own_flux_at(symbol, leading, face, place);
        (self.fluxes.faces, self.fluxes.averaging) = (faces, averaging);
        v
    }

    fn own_flux_at(&mut self, symbol: SymbolId, leading: &[Bound], face: Face, place: &Place) -> Value {
        let SymbolKind::Flux { flux, binders, .. } = self.symbols[symbol].kind.clone() else { return self.poison() };
        self.expansions.note_use(symbol);
        let n = self.symbols.domains[face.domain].cells;
        let (Some(low), Some(high)) = (self.is_number(face.at, 0), self.is_number(face.at, n)) else {
            return self.poison();
        };
        let mut inner = place.clone();
        inner.scope = self.symbols[symbol].scope;
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
            if self.symbols.is_directed(face) {
                v = self.entering(v, flux, low, &at_face);
            }
            return self.flux_in_unit(v, flux, e.span, &inner);
        }
        let v =
            if self.symbols.is_directed(face) && !low && !high { self.directed(flux, &at_face) } else { self.value(&flux.inner, &at_face) };
        self.flux_in_unit(v, flux, flux.inner.span, &inner)
    }

    /// A value of a flux in the unit that it declares.
    fn flux_in_unit(&mut self, v: Value, flux: &Flux, span: Span, place: &Place) -> Value {
        let Some(written) = &flux.unit else { return v };
        if v.is_poison() {
            return v;
        }
        let Some(unit) = self.unit(written, place) else { return self.poison() };
        let reports = self.ledger.reports.diagnostics.len();
        let expr = self.values().strictly_in(v, &unit, span, &format!("the flux `{}`", flux.name.text), flux.name.span);
        if self.ledger.reports.diagnostics.len() > reports { self.poison() } else { Value::of(expr, unit) }
    }

    /// `J[i, z.low]`, `J[i, z.high]`: the flux at an end.
    pub(in crate::elaborate) fn flux_at_end(&mut self, symbol: SymbolId, index: &[Expr], span: Span, place: &Place) -> Value {
        let Some((axes, last)) = self.naming().flux_axes(symbol, index, span) else { return self.poison() };
        let Axis::Domain(domain) = axes[axes.len() - 1] else { return self.poison() };
        let end = match &last.kind {
            ExprKind::Member(base, end) if self.symbols.domain_of(base, place) == Some(domain) => match end.text.as_str() {
                "low" => Some(0),
                "high" => Some(self.symbols.domains[domain].cells),
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

    /// The flux that `div` takes; a fault where it is none.
    fn flux_named(&mut self, span: Span, e: &Expr, base: &Expr, place: &Place) -> Result<SymbolId, Value> {
        let symbol = match self.resolve(base, place) {
            crate::elaborate::lower::place::Target::Symbol(symbol) => symbol,
            crate::elaborate::lower::place::Target::Value(v) if v.is_poison() => return Err(v),
            crate::elaborate::lower::place::Target::Nothing => return Err(self.poison()),
            crate::elaborate::lower::place::Target::Value(_) => {
                return Err(self.fault(Diagnostic::error(codes::WRONG_KIND, "`div` takes a flux", span)));
            }
        };
        if matches!(self.symbols[symbol].kind, SymbolKind::Faulty) {
            return Err(self.poison());
        }
        if !matches!(self.symbols[symbol].kind, SymbolKind::Flux { .. }) {
            let path = self.symbols[symbol].path.clone();
            let declared = self.symbols[symbol].span;
            return Err(self.fault(
                Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is no flux"), e.span)
                    .secondary(declared, "declared here")
                    .help("declare `flux J[z] = v*c[z]` and write `div(J[z])`"),
            ));
        }
        Ok(symbol)
    }

    /// `div(J[i, z])`: what leaves the cell, over its measure.
    pub(in crate::elaborate) fn divergence(&mut self, span: Span, e: &Expr, place: &Place) -> Value {
        let ExprKind::Index(base, index) = &e.kind else {
            return self.fault(Diagnostic::error(codes::WRONG_KIND, "`div` takes a flux with its indices", span).help("`div(J[z])`"));
        };
        let symbol = match self.flux_named(span, e, base, place) {
            Ok(symbol) => symbol,
            Err(fault) => return fault,
        };
        let Some((axes, last)) = self.naming().flux_axes(symbol, index, span) else { return self.poison() };
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
        let SymbolKind::Flux { flux, .. } = &self.symbols[symbol].kind else { return self.poison() };
        // The inner faces say what the flux is; a boundary value must agree with them.
        let last = self.symbols.domains[domain].cells - 1;
        let low_end = flux.low.as_ref().filter(|_| cell.first == 0 && cell.count == 1);
        let high_end = flux.high.as_ref().filter(|_| cell.first == last && cell.count == 1);
        let (inner_span, low_span) = (flux.inner.span, low_end.map_or(flux.inner.span, |e| e.span));
        let high_span = high_end.map_or(inner_span, |e| e.span);
        let (first, second) = if high_end.is_some() { (&inflow.unit, &outflow.unit) } else { (&outflow.unit, &inflow.unit) };
        let unit = match (first, second) {
            (Measure::Of(u), _) | (_, Measure::Of(u)) => u.clone(),
            _ => Unit::one(),
        };
        let what = format!("the flux `{}`", self.symbols[symbol].path);
        let inflow = self.values().strictly_in(inflow, &unit, low_span, &what, inner_span);
        let outflow = self.values().strictly_in(outflow, &unit, high_span, &what, inner_span);
        let (a, b) = (self.area(domain, cell), self.area(domain, cell.shifted(1)));
        let (inflow, outflow) = (self.exprs.mul(a, inflow), self.exprs.mul(b, outflow));
        let net = self.exprs.sub(outflow, inflow);
        let measure = self.measure(domain, cell);
        let expr = self.values().over_fixed(net, measure);
        let length = self.ends(domain).0;
        Value::of(expr, units::over(&unit, &length))
    }

    /// Names with units that do not fit in derivatives over space the domain whose ends have none.
    pub(in crate::elaborate) fn blame_lengths(&mut self, before: usize, parts: &[&Expr]) {
        let mut over_space = false;
        let is_derivative = |e: &Expr| matches!(&e.kind, ExprKind::Call { function, .. } if matches!(&*function.text, "div" | "grad"));
        parts.iter().for_each(|e| e.walk(&mut |e| over_space |= is_derivative(e)));
        if self.ledger.reports.diagnostics.len() == before || !over_space {
            return;
        }
        let is_bare = |domain: &DomainId| self.grids.ends(*domain).is_some_and(|(unit, ..)| unit.is_one());
        let Some(domain) = self.symbols.domains.keys().find(is_bare) else { return };
        let domain = &self.symbols.domains[domain];
        let (name, (low, high)) = (&domain.name, &domain.declaration.range);
        let span = Span { end: high.span.end, ..low.span };
        for fault in self.ledger.reports.diagnostics.iter_mut().skip(before).filter(|d| d.code == codes::UNIT_MISMATCH) {
            fault.secondary.push(Label { span, text: format!("`{name}` is a pure number") });
            fault.notes.push(format!("if `{name}` is a length, its ends need the unit: `domain {name} in 0 [m]..1 [m]`"));
        }
    }
}
