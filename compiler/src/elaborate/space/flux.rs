//! Fluxes at faces, and their divergence.

use smpl_dsl::diagnostic::{Diagnostic, Label, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind, Flux};
use smpl_dsl::units::Unit;

use crate::elaborate::lower::loops::{Cell, Face};
use crate::elaborate::lower::place::{Bound, Place};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, indices, paths, units};
use crate::elaborate::space::{field, grid, transport};
use crate::elaborate::symbols::{Axis, DomainId, SymbolId, SymbolKind};
/// A flux at a face, with its leading indices bound.
fn flux_at(l: &mut Lowering<'_, '_>, symbol: SymbolId, leading: &[Bound], face: Face, place: &Place) -> Value {
    // It may be part of another flux, whose face values are not its own.
    let (faces, averaging) = (l.fluxes.faces.take(), std::mem::take(&mut l.fluxes.averaging));
    let v = own_flux_at(l, symbol, leading, face, place);
    (l.fluxes.faces, l.fluxes.averaging) = (faces, averaging);
    v
}

fn own_flux_at(l: &mut Lowering<'_, '_>, symbol: SymbolId, leading: &[Bound], face: Face, place: &Place) -> Value {
    let SymbolKind::Flux { flux, binders, .. } = l.symbols[symbol].kind.clone() else { return l.poison() };
    l.expansions.note_use(symbol);
    let Some(face) = grid::one_seam(l, face) else { return l.poison() };
    let Some((low, high)) = field::ends_at(l, face) else { return l.poison() };
    let mut inner = place.clone();
    inner.scope = l.symbols[symbol].scope;
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
        let mut v = l.value(e, &inner);
        if l.symbols.is_directed(face) {
            v = transport::entering(l, (v, e, &inner), flux, low, &at_face);
        }
        return flux_in_unit(l, v, flux, e.span, &inner);
    }
    let v =
        if l.symbols.is_directed(face) && !low && !high { transport::directed(l, flux, &at_face) } else { l.value(&flux.inner, &at_face) };
    flux_in_unit(l, v, flux, flux.inner.span, &inner)
}

/// A value of a flux in the unit that it declares.
fn flux_in_unit(l: &mut Lowering<'_, '_>, v: Value, flux: &Flux, span: Span, place: &Place) -> Value {
    let Some(written) = &flux.unit else { return v };
    if v.is_poison() {
        return v;
    }
    let Some(unit) = units::unit(l, written, place) else { return l.poison() };
    let reports = l.ledger.reports.diagnostics.len();
    let expr = l.values().strictly_in(v, &unit, span, &format!("the flux `{}`", flux.name.text), flux.name.span);
    if l.ledger.reports.diagnostics.len() > reports { l.poison() } else { Value::of(expr, unit) }
}

/// `J[i, z.low]`, `J[i, z.high]`: the flux at an end.
pub(in crate::elaborate) fn flux_at_end(l: &mut Lowering<'_, '_>, symbol: SymbolId, index: &[Expr], span: Span, place: &Place) -> Value {
    let Some((axes, last)) = l.naming().flux_axes(symbol, index, span) else { return l.poison() };
    let Axis::Domain(domain) = axes[axes.len() - 1] else { return l.poison() };
    let end = match &last.kind {
        ExprKind::Member(base, end) if l.symbols.domain_of(base, place) == Some(domain) => match end.text.as_str() {
            "low" => Some(0),
            "high" => Some(l.symbols.domains[domain].cells),
            _ => None,
        },
        _ => None,
    };
    let Some(number) = end else {
        return l.fault(
            Diagnostic::error(codes::WRONG_KIND, "a flux has values at faces, not in cells", span)
                .help("take its divergence, `div(J[z])`, or its value at an end, `J[z.low]`, `J[z.high]`"),
        );
    };
    let Some((_, leading)) = indices::address(l, symbol, &axes[..axes.len() - 1], &index[..index.len() - 1], span, place) else {
        return l.poison();
    };
    let mut outer = place.clone();
    outer.face = None;
    flux_at(l, symbol, &leading, Face { domain, at: Cell::single(number) }, &outer)
}

/// The flux that `div` takes; a fault if it is not a flux.
fn flux_named(l: &mut Lowering<'_, '_>, span: Span, e: &Expr, base: &Expr, place: &Place) -> Result<SymbolId, Value> {
    let symbol = match paths::resolve(l, base, place) {
        crate::elaborate::lower::place::Target::Symbol(symbol) => symbol,
        crate::elaborate::lower::place::Target::Value(v) if v.is_poison() => return Err(v),
        crate::elaborate::lower::place::Target::Nothing => return Err(l.poison()),
        crate::elaborate::lower::place::Target::Value(_) => {
            return Err(l.fault(Diagnostic::error(codes::WRONG_KIND, "`div` takes a flux", span)));
        }
    };
    if matches!(l.symbols[symbol].kind, SymbolKind::Faulty) {
        return Err(l.poison());
    }
    if !matches!(l.symbols[symbol].kind, SymbolKind::Flux { .. }) {
        let path = l.symbols[symbol].path.clone();
        let declared = l.symbols[symbol].span;
        return Err(l.fault(
            Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is not a flux"), e.span)
                .secondary(declared, "declared here")
                .help("declare `flux J[z] = v*c[z]` and write `div(J[z])`"),
        ));
    }
    Ok(symbol)
}

/// `div(J[i, z])`: what leaves the cell, over its measure.
pub(in crate::elaborate) fn divergence(l: &mut Lowering<'_, '_>, span: Span, e: &Expr, place: &Place) -> Value {
    let ExprKind::Index(base, index) = &e.kind else {
        return l.fault(Diagnostic::error(codes::WRONG_KIND, "`div` takes a flux with its indices", span).help("`div(J[z])`"));
    };
    let symbol = match flux_named(l, span, e, base, place) {
        Ok(symbol) => symbol,
        Err(fault) => return fault,
    };
    let Some((axes, last)) = l.naming().flux_axes(symbol, index, span) else { return l.poison() };
    let Some(&Axis::Domain(domain)) = axes.last() else { return l.poison() };
    let Some((_, bounds)) = indices::address(l, symbol, &axes, index, last.span, place) else { return l.poison() };
    let Some(Bound::Cell(_, cell)) = bounds.last().cloned() else { return l.poison() };
    let leading = &bounds[..bounds.len() - 1];
    let mut outer = place.clone();
    outer.face = None;
    let inflow = flux_at(l, symbol, leading, Face { domain, at: cell }, &outer);
    let outflow = flux_at(l, symbol, leading, Face { domain, at: cell.shifted(1) }, &outer);
    if inflow.is_poison() || outflow.is_poison() {
        return l.poison();
    }
    let SymbolKind::Flux { flux, .. } = &l.symbols[symbol].kind else { return l.poison() };
    // The inner faces say what the flux is; a boundary value must agree with them.
    let last = l.symbols.domains[domain].cells - 1;
    let low_end = flux.low.as_ref().filter(|_| cell.first == 0 && cell.count == 1);
    let high_end = flux.high.as_ref().filter(|_| cell.first == last && cell.count == 1);
    let (inner_span, low_span) = (flux.inner.span, low_end.map_or(flux.inner.span, |e| e.span));
    let high_span = high_end.map_or(inner_span, |e| e.span);
    let (first, second) = if high_end.is_some() { (&inflow.unit, &outflow.unit) } else { (&outflow.unit, &inflow.unit) };
    let unit = match (first, second) {
        (Measure::Of(u), _) | (_, Measure::Of(u)) => u.clone(),
        _ => Unit::one(),
    };
    let what = format!("the flux `{}`", l.symbols[symbol].path);
    let inflow = l.values().strictly_in(inflow, &unit, low_span, &what, inner_span);
    let outflow = l.values().strictly_in(outflow, &unit, high_span, &what, inner_span);
    let (a, b) = (grid::area(l, domain, cell), grid::area(l, domain, cell.shifted(1)));
    let (inflow, outflow) = (l.exprs.mul(a, inflow), l.exprs.mul(b, outflow));
    let net = l.exprs.sub(outflow, inflow);
    let measure = grid::measure(l, domain, cell);
    let expr = l.values().over_fixed(net, measure);
    let length = grid::ends(l, domain).0;
    Value::of(expr, units::over(&unit, &length))
}

/// Names with units that do not fit in derivatives over space the domain whose ends have none.
pub(in crate::elaborate) fn blame_lengths(l: &mut Lowering<'_, '_>, before: usize, parts: &[&Expr]) {
    let mut over_space = false;
    let is_derivative = |e: &Expr| matches!(&e.kind, ExprKind::Call { function, .. } if matches!(&*function.text, "div" | "grad"));
    parts.iter().for_each(|e| e.walk(&mut |e| over_space |= is_derivative(e)));
    if l.ledger.reports.diagnostics.len() == before || !over_space {
        return;
    }
    let length = |unit: &Unit| Unit::named("m").is_some_and(|metre| unit.commensurable(&metre));
    let other = |domain: DomainId| l.grids.ends(domain).map(|(unit, ..)| unit.clone()).filter(|unit| !length(unit));
    let Some((domain, unit)) = l.symbols.domains.keys().find_map(|domain| Some((domain, other(domain)?))) else { return };
    let domain = &l.symbols.domains[domain];
    let (name, (low, high)) = (&domain.name, &domain.declaration.range);
    let span = Span { end: high.span.end, ..low.span };
    for fault in l.ledger.reports.diagnostics.iter_mut().skip(before).filter(|d| d.code == codes::UNIT_MISMATCH) {
        let what = if unit.is_one() { "a pure number".to_owned() } else { units::describe(&unit) };
        fault.secondary.push(Label { span, text: format!("`{name}` is {what}") });
        fault.notes.push(format!("if `{name}` is a length, its ends need the unit: `domain {name} in 0 [m]..1 [m]`"));
        if !unit.is_one() {
            fault.help = None;
        }
    }
}
