//! Direction of a flux: the cells from which its face values come.
//!
//! If a domain has a directed scheme, the inner expression of a flux is first elaborated with a
//! *mark* for each face value. It is taken apart into terms, a product of *factors* without marks
//! and of a rest with marks. The sign of the factors says from which side the values of the rest
//! come. If bounds and constants show that all come from below, every trace of this is removed and
//! the flux is elaborated with those cells at once. Otherwise the marks are replaced by the values
//! of one side, or by a choice.

use smpl_dsl::diagnostic::Diagnostic;
use smpl_dsl::syntax::{Expr, Flux};

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::loops::Face;
use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::value::Value;
use crate::elaborate::space::flow::Direction;
use crate::elaborate::space::{directions, placed};
use crate::elaborate::symbols::{Scheme, Symbols};

/// Result of the elaboration with marks.
enum MarkedFlux {
    /// As if all came from below; also where there are faults, which the usual way reports.
    Plain,
    Built(Value),
    Fault(Diagnostic),
}

/// The inner expression of a flux at a face between two cells.
pub(in crate::elaborate) fn directed(l: &mut Lowering<'_, '_>, flux: &Flux, place: &Place) -> Value {
    let outcome = with_marks(l, |s| {
        let v = s.value(&flux.inner, place);
        let flow = match directions::flow(s, v.expr, flux.inner.span) {
            Ok(flow) => flow,
            Err(fault) => return MarkedFlux::Fault(*fault),
        };
        if v.is_poison() || flow.directions.iter().all(|d| *d == Direction::Below) {
            return MarkedFlux::Plain;
        }
        placed::placed(s, v, &flow).map_or(MarkedFlux::Plain, MarkedFlux::Built)
    });
    match outcome {
        MarkedFlux::Plain => l.value(&flux.inner, place),
        MarkedFlux::Built(v) => v,
        MarkedFlux::Fault(fault) => l.fault(fault),
    }
}

/// The flux given at an end, where the flow may turn: what is carried in holds while the flow
/// enters, else the cell's own value.
///
/// `text` is the argument, `outer` its surroundings: outside of the flux's own index.
pub(in crate::elaborate) fn entering(
    l: &mut Lowering<'_, '_>,
    (given, text, outer): (Value, &Expr, &Place),
    flux: &Flux,
    is_low: bool,
    place: &Place,
) -> Value {
    if given.is_poison() {
        return given;
    }
    let outcome = with_marks(l, |s| {
        let v = s.value(&flux.inner, place);
        let Ok(flow) = directions::flow(s, v.expr, flux.inner.span) else { return MarkedFlux::Plain };
        if v.is_poison() {
            return MarkedFlux::Plain;
        }
        placed::turning(s, (&given, text, outer), v, &flow, is_low).map_or(MarkedFlux::Plain, MarkedFlux::Built)
    });
    match outcome {
        MarkedFlux::Built(v) => v,
        MarkedFlux::Plain | MarkedFlux::Fault(_) => given,
    }
}

/// Elaborates something with marks for face values; leaves no trace unless it is what was wanted.
fn with_marks<'m, 'a>(l: &mut Lowering<'m, 'a>, body: impl FnOnce(&mut Lowering<'m, 'a>) -> MarkedFlux) -> MarkedFlux {
    let before = l.ledger.trace();
    let (nodes, diagnostics) = (l.exprs.len(), l.ledger.reports.diagnostics.len());
    let drawn = l.hidden.len();
    let outer = l.fluxes.faces.replace(Vec::new());
    l.ledger.speculation.enter();
    let mut outcome = body(l);
    l.ledger.speculation.end();
    l.fluxes.faces = outer;
    if l.ledger.reports.diagnostics.len() > diagnostics {
        outcome = MarkedFlux::Plain;
    }
    if matches!(outcome, MarkedFlux::Built(_)) {
        l.ledger.speculation.settle(&mut l.ledger.reports);
    } else {
        l.ledger.roll_back(before, l.expansions);
        // What was drawn in there keeps its node.
        if drawn == l.hidden.len() {
            l.exprs.truncate(nodes);
        }
    }
    outcome
}

impl<'a> Symbols<'a> {
    /// Returns `true` if the scheme of a domain looks where the flow comes from.
    pub(in crate::elaborate) fn is_directed(&self, face: Face) -> bool {
        matches!(self.domains[face.domain].scheme, Scheme::Upwind | Scheme::Upwind2 | Scheme::Limited)
    }
}
