//! Cuts long straight code into segments between which values pass through memory.
//!
//! The register allocator's time grows faster than the number of values that are alive at once, and
//! what does not fit into registers ends in memory anyway. So a value lives in registers within one
//! segment only. What a later segment needs is stored once where it is computed and loaded again
//! where it is used; elements of variables are simply loaded again. Without it, code generation of
//! models with some thousand operations takes a quarter longer for code of the same speed.

use crate::ir::{BinaryFn, Expr, ExprId, Exprs, FastMap};
use crate::schedule::{BlockId, Item, Schedule, is_immediate};

/// Functions with fewer items outside of loops stay whole.
const SHORTEST: usize = 64;
/// Computations of a segment.
const LENGTH: usize = 64;

/// The segments of the code outside of loops; each loop is one more.
#[derive(Default)]
pub(super) struct Segments {
    /// Items whose operands are the last uses of a segment and whose result is the first value of
    /// the next, ascending.
    ends: Vec<usize>,
    /// Items after which a piece ends, a subset of `ends`; nothing stays in registers there.
    pieces: Vec<usize>,
    /// Places in memory of the values that live longer than their segment.
    slots: FastMap<ExprId, u32>,
    active: bool,
}

impl Segments {
    /// The segments of a schedule, a new piece begun once `piece` items are in one.
    pub(super) fn new(schedule: &Schedule, exprs: &Exprs, piece: usize) -> Segments {
        let root = &schedule.blocks[0];
        if !is_long(schedule) {
            return Segments::default();
        }
        let mut segments = Segments { active: true, ..Segments::default() };
        let mut defined: FastMap<ExprId, u32> = FastMap::default();
        let (mut segment, mut length) = (0, 0);
        for (i, item) in root.items.iter().enumerate() {
            segments.note_uses(schedule, exprs, (0, *item), &defined, segment);
            let expr = match *item {
                Item::Eval(expr) | Item::Reduce { expr, .. } if !is_load(exprs.node(expr)) => expr,
                _ => continue,
            };
            length += 1;
            // A call leaves nothing in the registers of numbers but its result.
            if length >= LENGTH || is_call(exprs.node(expr)) || matches!(item, Item::Reduce { .. }) {
                segments.ends.push(i);
                (segment, length) = (segment + 1, 0);
            }
            defined.insert(expr, segment);
            if length == 0 && i >= piece * (segments.pieces.len() + 1) {
                segments.pieces.push(i);
                segment += 1;
            }
        }
        for &child in &root.children {
            segment += 1;
            schedule.each_item(child, &mut |block, item| segments.note_uses(schedule, exprs, (block, item), &defined, segment));
        }
        segments
    }

    fn note_uses(
        &mut self,
        schedule: &Schedule,
        exprs: &Exprs,
        (block, item): (BlockId, Item),
        defined: &FastMap<ExprId, u32>,
        segment: u32,
    ) {
        schedule.each_use(exprs, block, item, &mut |from, expr| {
            let outside = !is_immediate(exprs.node(expr)) && schedule.home(exprs, from, expr) == 0;
            if outside && defined.get(&expr).is_some_and(|&s| s < segment) {
                let next = self.slots.len() as u32;
                self.slots.entry(expr).or_insert(next);
            }
        });
    }

    /// Returns `true` if the code is cut at all.
    pub(super) fn is_active(&self) -> bool {
        self.active
    }

    /// Returns `true` if the result of an item outside of loops is the first value of a segment.
    pub(super) fn ends_at(&self, item: usize) -> bool {
        self.ends.binary_search(&item).is_ok()
    }

    /// Items after which a piece ends, ascending.
    pub(super) fn pieces(&self) -> &[usize] {
        &self.pieces
    }

    /// Place in memory of a value that lives longer than its segment.
    pub(super) fn slot(&self, expr: ExprId) -> Option<u32> {
        self.slots.get(&expr).copied()
    }

    /// Number of places in memory.
    pub(super) fn len(&self) -> u32 {
        self.slots.len() as u32
    }
}

/// Returns `true` if the code outside of loops is worth cutting.
fn is_long(schedule: &Schedule) -> bool {
    schedule.blocks[0].items.len() >= SHORTEST
}

/// Returns `true` if a node is an element of a variable.
pub(super) fn is_load(node: Expr) -> bool {
    matches!(node, Expr::Load { .. })
}

/// Returns `true` if a node calls a kernel.
fn is_call(node: Expr) -> bool {
    match node {
        Expr::Unary(f, _) => f.kernel().is_some(),
        Expr::Binary(f, ..) => matches!(f, BinaryFn::Pow | BinaryFn::Atan2),
        Expr::Passed(..) | Expr::Entry(..) => true,
        _ => false,
    }
}
