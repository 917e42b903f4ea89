//! Reads of tables that are refused outside of their points.

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::symbols::SymbolId;
use crate::ir::{BinaryFn, Compare, ExprId, LoopVar, ReduceFn};

/// Reads of tables, as far as a failure watches them.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Reads {
    /// The table, and by how much an argument is outside of its points.
    pub list: Vec<(SymbolId, ExprId)>,
    /// The failures are made: what is read later is not a number outside.
    pub closed: bool,
}

/// The value of a table that is refused outside: it is watched there, or it is not a number.
pub(in crate::elaborate) fn refused(
    l: &mut Lowering<'_, '_>,
    symbol: SymbolId,
    arguments: &[(ExprId, (f64, f64))],
    value: ExprId,
    place: &Place,
) -> ExprId {
    let mut excess: Option<ExprId> = None;
    for &(t, (low, high)) in arguments {
        let (low, high) = (l.exprs.constant(low), l.exprs.constant(high));
        for beyond in [l.exprs.sub(low, t), l.exprs.sub(t, high)] {
            excess = Some(excess.map_or(beyond, |known| l.exprs.binary(BinaryFn::Max, known, beyond)));
        }
    }
    let Some(mut excess) = excess else { return value };
    if place.site == Site::Reset || place.site == Site::Disturb || l.ledger.speculation.reads.closed {
        let zero = l.exprs.constant(0.0);
        let inside = l.exprs.compare(Compare::Le, excess, zero);
        let nan = l.exprs.constant(f64::NAN);
        return l.exprs.select(inside, value, nan);
    }
    // Where it is watched, the value goes on as at the border: the solver steps over it once.
    for depth in (0..place.depth).rev() {
        let passes = l.loops.frames.get(depth as usize).map_or(1, |frame| frame.passes);
        excess = l.exprs.reduce(ReduceFn::Max, LoopVar(depth), passes as u32, excess);
    }
    let read = (symbol, excess);
    if !l.ledger.speculation.reads.list.contains(&read) {
        l.ledger.speculation.reads.list.push(read);
    }
    value
}
