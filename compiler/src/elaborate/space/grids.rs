//! Positions of the cells of domains, for users of a model.

use crate::elaborate::lower::loops::Cell;
use crate::elaborate::lower::{Lowering, defaults};
use crate::elaborate::space::grid;
use crate::elaborate::symbols::DomainId;
use crate::ir::{Affine, ExprId, Flavour, VarId};
use crate::model::Grid;

/// Positions of the cells of every domain, as far as parameters determine them. An invalid model
/// has none: the faults of its grids were reported.
pub(in crate::elaborate) fn grids(l: &mut Lowering<'_, '_>) -> Vec<Grid> {
    if l.ledger.reports.has_errors() {
        return Vec::new();
    }
    let domains: Vec<DomainId> = l.symbols.domains.keys().collect();
    domains.into_iter().map(|domain| grid(l, domain)).collect()
}

fn grid(l: &mut Lowering<'_, '_>, domain: DomainId) -> Grid {
    let (unit, low, high) = grid::ends(l, domain);
    let cells = l.symbols.domains[domain].cells;
    let places: Vec<ExprId> = match l.symbols.is_uniform(domain) {
        true => vec![low, high],
        false => (0..=cells).map(|face| grid::face_position(l, domain, Cell::single(face))).collect(),
    };
    let known: Option<Vec<f64>> = places.iter().map(|&place| defaults::constant_value(l, place)).collect();
    let faces = match known.as_deref() {
        Some(&[low, high]) => (0..=cells).map(|i| low + (high - low) * i as f64 / cells as f64).collect(),
        Some(faces) => faces.to_vec(),
        None => Vec::new(),
    };
    let increase = faces.windows(2).all(|pair| pair[0] < pair[1]) && faces.iter().all(|x| x.is_finite());
    let parameters = if increase { grid_parameters(l, &places) } else { None };
    let (name, unit) = (l.symbols.domains[domain].name.clone(), unit.to_string());
    match parameters {
        Some(parameters) => Grid { name, unit, faces, parameters },
        None => Grid { name, unit, ..Grid::default() },
    }
}

/// The elements of parameters that places depend on, with their values.
fn grid_parameters(l: &mut Lowering<'_, '_>, places: &[ExprId]) -> Option<Vec<(VarId, u32, f64)>> {
    let mut elements: Vec<(VarId, i64)> = Vec::new();
    for &place in places {
        elements.extend(l.symbols.parameters_in(l.exprs, place).into_iter().map(|(var, at)| (var, at.offset)));
    }
    elements.sort_unstable();
    elements.dedup();
    let mut value = |(var, at): (VarId, i64)| {
        let load = l.exprs.load(var, Flavour::Value, Affine::constant(at));
        Some((var, at as u32, defaults::constant_value(l, load)?))
    };
    elements.into_iter().map(&mut value).collect()
}
