//! Cuts functions into pieces of machine code that are called one after another.
//!
//! The time of code generation grows faster than the length of what is generated at once, and
//! pieces can be generated side by side. Between pieces values pass through memory, as between the
//! segments that they are made of.

use std::ops::Range;

use super::segments::Segments;
use crate::ir::Exprs;
use crate::schedule::{BlockId, Item, Schedule};

/// Items of a piece, about; shorter functions stay whole.
const PIECE: usize = 400;
/// Shorter loops stay scalar.
const SHORTEST_WIDE: u32 = 4;
/// Loops with fewer items share a piece.
const LONG: usize = 64;

/// A function ready to be written.
pub(crate) struct Plan {
    pub(super) schedules: Vec<(Schedule, Segments)>,
    pub(super) in_place: bool,
    pieces: Vec<Piece>,
}

/// Unit of generation.
pub(crate) struct Piece {
    pub(super) parts: Vec<ScheduleSlice>,
    /// All of it is long, and straight or in loops of lanes: there is nothing for Cranelift's
    /// mid-end to move.
    pub(super) lean: bool,
    size: usize,
}

/// A part of a schedule.
#[derive(Clone)]
pub(super) struct ScheduleSlice {
    pub(super) schedule: usize,
    /// Items outside of loops.
    pub(super) items: Range<usize>,
    /// Loops, outermost.
    pub(super) loops: Vec<BlockId>,
}

impl Plan {
    pub(super) fn new(schedules: Vec<Schedule>, exprs: &Exprs, in_place: bool) -> Plan {
        let size = schedules.iter().map(items).sum::<usize>();
        let piece = if size > 3 * PIECE / 2 { PIECE } else { usize::MAX };
        let segments = |schedule: &Schedule| if in_place { Segments::default() } else { Segments::new(schedule, exprs, piece) };
        let schedules: Vec<_> = schedules.into_iter().map(|schedule| (segments(&schedule), schedule)).map(|(a, b)| (b, a)).collect();
        let mut pieces: Vec<Vec<ScheduleSlice>> = vec![vec![]];
        for (i, (schedule, segments)) in schedules.iter().enumerate() {
            for part in parts(i, schedule, segments, piece) {
                let alone = piece < usize::MAX && size_of(schedule, &part) >= LONG;
                let joins = pieces.last().is_some_and(|last| !alone && last.iter().all(|p| size_of(&schedules[p.schedule].0, p) < LONG));
                match pieces.last_mut() {
                    Some(last) if joins || last.is_empty() || piece == usize::MAX => last.push(part),
                    _ => pieces.push(vec![part]),
                }
            }
        }
        let piece = |parts: Vec<ScheduleSlice>| Piece {
            lean: !in_place && parts.iter().all(|p| is_lean(&schedules[p.schedule].0, p)),
            size: parts.iter().map(|p| size_of(&schedules[p.schedule].0, p)).sum(),
            parts,
        };
        let pieces = pieces.into_iter().filter(|parts| !parts.is_empty()).map(piece).collect();
        Plan { schedules, in_place, pieces }
    }

    /// The pieces, to be called in this order.
    #[must_use]
    pub(crate) fn pieces(&self) -> &[Piece] {
        &self.pieces
    }
}

impl Piece {
    /// Number of items, by which the time of code generation may be guessed.
    #[must_use]
    pub(crate) fn size(&self) -> usize {
        self.size
    }
}

/// The parts of a schedule: its straight code cut at pieces, then its loops.
fn parts(number: usize, schedule: &Schedule, segments: &Segments, piece: usize) -> Vec<ScheduleSlice> {
    let root = &schedule.blocks[0];
    if piece == usize::MAX || !segments.is_active() {
        return vec![ScheduleSlice { schedule: number, items: 0..root.items.len(), loops: root.children.clone() }];
    }
    let ends: Vec<usize> = segments.pieces().iter().map(|end| end + 1).chain([root.items.len()]).collect();
    let starts = std::iter::once(0).chain(ends.iter().copied());
    let straight = starts.zip(&ends).map(|(start, &end)| ScheduleSlice { schedule: number, items: start..end, loops: vec![] });
    let loops = root.children.iter().map(|&child| ScheduleSlice { schedule: number, items: 0..0, loops: vec![child] });
    straight.chain(loops).collect()
}

fn items(schedule: &Schedule) -> usize {
    schedule.blocks.iter().map(|block| block.items.len()).sum()
}

fn size_of(schedule: &Schedule, part: &ScheduleSlice) -> usize {
    let mut size = part.items.len();
    part.loops.iter().for_each(|&block| schedule.each_item(block, &mut |_, _| size += 1));
    size
}

/// Returns `true` if there is only long code, straight or in loops of lanes.
fn is_lean(schedule: &Schedule, part: &ScheduleSlice) -> bool {
    let has_reduction = |items: &[Item]| items.iter().any(|item| matches!(item, Item::Reduce { .. }));
    let straight = &schedule.blocks[0].items[part.items.clone()];
    let is_long = |items: &[Item]| items.is_empty() || items.len() >= LONG && !has_reduction(items);
    is_long(straight) && part.loops.iter().all(|&block| is_wide(schedule, block) && is_long(&schedule.blocks[block].items))
}

/// Returns `true` if a block of a function without storing in place is a loop written in lanes.
pub(super) fn is_wide(schedule: &Schedule, block: BlockId) -> bool {
    let here = &schedule.blocks[block];
    here.leaf && here.children.is_empty() && here.extent >= SHORTEST_WIDE
}
