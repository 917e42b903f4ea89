//! Ranges of cells and faces, and loops that are split on demand.

use std::collections::BTreeSet;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::loops::{Cell, Loop};
use crate::elaborate::lower::place::Place;
use crate::ir::{LoopVar, MAX_DEPTH};

/// Most passes of loops inside one another: each evaluation of the model would take seconds.
const MOST_PASSES: i64 = 1_000_000_000;

impl Lowering<'_, '_> {
    /// Elaborates `body` over the cells `low..=high` as few loops as its stencils allow; gives back
    /// the pieces in order.
    pub(in crate::elaborate) fn cells<T>(
        &mut self,
        low: i64,
        high: i64,
        span: Span,
        place: &Place,
        body: &mut dyn FnMut(&mut Self, Cell, &Place) -> T,
    ) -> Vec<(Cell, T)> {
        let mut starts = BTreeSet::from([low]);
        'again: loop {
            let mut pieces = Vec::new();
            let bounds: Vec<i64> = starts.iter().copied().chain([high + 1]).collect();
            for pair in bounds.windows(2) {
                let (first, count) = (pair[0], pair[1] - pair[0]);
                if count <= 0 {
                    continue;
                }
                if count == 1 {
                    let cell = Cell::single(first);
                    let result = body(self, cell, place);
                    pieces.push((cell, result));
                    continue;
                }
                if !self.may_nest(count, span, place) {
                    return Vec::new();
                }
                let mut inner = place.clone();
                inner.depth += 1;
                let cell = Cell::run(first, count, LoopVar(place.depth));
                // A loop's frame is at its depth; consecutive reductions reuse it.
                self.loops.frames.truncate(place.depth as usize);
                self.loops.frames.push(Loop { passes: count, cuts: BTreeSet::new() });
                let before = (self.ledger.speculation.is_active()).then(|| self.ledger.trace());
                let result = body(self, cell, &inner);
                let cuts = match self.loops.frames.get(place.depth as usize) {
                    Some(frame) => frame.cuts.clone(),
                    None => BTreeSet::new(),
                };
                self.loops.frames.truncate(place.depth as usize);
                if !cuts.is_empty() {
                    before.into_iter().for_each(|before| self.ledger.roll_back(before, self.expansions));
                    starts.extend(cuts.iter().map(|pass| first + pass));
                    continue 'again;
                }
                pieces.push((cell, result));
            }
            return pieces;
        }
    }

    /// Returns `true` if a loop of so many passes is allowed here; reports if it is not.
    fn may_nest(&mut self, count: i64, span: Span, place: &Place) -> bool {
        if place.depth as usize >= MAX_DEPTH {
            self.ledger.report(Diagnostic::error(codes::TOO_LARGE, format!("more than {MAX_DEPTH} loops inside one another"), span));
            return false;
        }
        let around = self.loops.frames.iter().take(place.depth.into()).fold(1, |n: i64, l| n.saturating_mul(l.passes));
        if around.saturating_mul(count) > MOST_PASSES {
            let fault = Diagnostic::error(codes::TOO_LARGE, "loops inside one another with more than a billion passes", span);
            self.ledger.report(fault.help("sum over fewer indices: a product of sums instead of a sum of products"));
            return false;
        }
        true
    }

    /// Returns `true` if the cell is number `v` in all passes or in none; `None` after asking for a
    /// cut where it is so in some.
    pub(in crate::elaborate) fn is_number(&mut self, cell: Cell, v: i64) -> Option<bool> {
        let Some(along) = cell.along else { return Some(cell.first == v) };
        let (lowest, highest) = cell.ends();
        if v < lowest || v > highest {
            return Some(false);
        }
        self.cut(along, cell.turn(v));
        self.cut(along, cell.turn(v + 1));
        None
    }

    /// Asks for a cut of a loop before a pass.
    pub(in crate::elaborate) fn cut(&mut self, along: LoopVar, pass: i64) {
        if let Some(frame) = self.loops.frames.get_mut(along.0 as usize)
            && (1..frame.passes).contains(&pass)
        {
            frame.cuts.insert(pass);
        }
    }
}
