//! Grids that run backwards are refused.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;

use crate::elaborate::lower::{Lowering, defaults, units};
use crate::elaborate::space::grid;
use crate::elaborate::symbols::{DomainId, Geometry};

/// Computes the ends of all domains: unused ones may also have faults.
pub(in crate::elaborate) fn check_grids(l: &mut Lowering<'_, '_>) {
    let domains: Vec<DomainId> = l.symbols.domains.keys().collect();
    for domain in domains {
        let reports = l.ledger.reports.diagnostics.len();
        grid::ends(l, domain);
        if l.ledger.reports.diagnostics.len() == reports {
            check_order(l, domain);
        }
    }
}

/// Refuses a grid that runs backwards with the parameters' defaults.
fn check_order(l: &mut Lowering<'_, '_>, domain: DomainId) {
    let (unit, low, high) = grid::ends(l, domain);
    let declaration = l.symbols.domains[domain].declaration;
    let (name, cells) = (l.symbols.domains[domain].name.clone(), l.symbols.domains[domain].cells);
    let refuse = |l: &mut Lowering<'_, '_>, span: Span, message: String| {
        l.ledger.report(Diagnostic::error(codes::EMPTY_SET, message, span));
    };
    if let [Some(low), Some(high)] = [low, high].map(|e| defaults::constant_value(l, e)) {
        if high <= low {
            return refuse(l, declaration.range.1.span, format!("`{name}` ends at {high}, not above its beginning {low}"));
        }
        if !(high - low).is_finite() {
            let span = declaration.range.0.span.to(declaration.range.1.span);
            return refuse(l, span, format!("`{name}` has finite ends, not {low}..{high}"));
        }
        if let Some(word) = declaration.periodic.filter(|_| l.symbols.domains[domain].geometry != Geometry::Planar) {
            return refuse(l, word, format!("`{name}` is a radius, which is not periodic"));
        }
        if low < 0.0 && l.symbols.domains[domain].geometry != Geometry::Planar {
            return refuse(l, declaration.range.0.span, format!("`{name}` is a radius, which does not begin at {low}"));
        }
    }
    if let Some(e) = &declaration.stretch {
        let ratio = grid::ratio(l, domain, e);
        if let Some(ratio) = defaults::constant_value(l, ratio).filter(|&q| q <= 0.0) {
            return refuse(l, e.span, format!("neighbouring cells have a positive ratio of widths, not {ratio}"));
        }
    }
    let area = grid::area_unit(l, domain);
    let volume = units::times(&area, &unit);
    let prescribed = [(&declaration.faces, unit, 0), (&declaration.areas, area, 0), (&declaration.volumes, volume, 1)];
    for (what, (text, unit, first)) in ["faces", "areas", "volumes"].into_iter().zip(prescribed) {
        let Some(text) = text else { continue };
        let mut before = if what == "volumes" { 0.0 } else { f64::NEG_INFINITY };
        for k in samples(first, cells) {
            let number = l.exprs.constant(k as f64);
            let e = grid::prescribed(l, domain, text, number, &unit);
            let Some(x) = defaults::constant_value(l, e) else { break };
            let is_wrong = if what == "areas" { x < 0.0 } else { x <= before };
            if is_wrong {
                let must = match what {
                    "faces" => "a face lies above the one before",
                    "areas" => "an area is not negative",
                    _ => "a volume is positive",
                };
                return refuse(l, text.span, format!("{must}: number {k} of the {what} of `{name}` is {x}"));
            }
            if what == "faces" {
                before = x;
            }
        }
    }
}

/// Numbers from `first` to `last`: all of few, else some evenly apart.
fn samples(first: i64, last: i64) -> impl Iterator<Item = i64> {
    const MOST: i64 = 64;
    let stride = ((last - first) / MOST).max(1);
    (first..=last).step_by(stride as usize)
}
