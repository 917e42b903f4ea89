//! Decides which values of a long loop of lanes stay in registers, and when the others leave them.
//!
//! The register allocator's time grows faster than the number of values that are alive at once, and
//! what does not fit into registers ends in memory anyway. In straight code the best choice is
//! known: the value to leave is the one that is needed last (Belady). So at most [`RESIDENT`]
//! values are alive at once. The others are stored once, where they are computed, and loaded again
//! where they are needed; values in memory are simply loaded again.
//!
//! It pays in loops of many values: with 150 species in one loop compilation takes a third less and
//! the residual a fifth, with 40 a twentieth and a tenth. The models of this repository compile and
//! run alike without it.

use crate::ir::{ExprId, FastMap};
use crate::schedule::BlockId;

/// Values that are alive between two items; the registers left over are for operands and
/// intermediate results.
const RESIDENT: usize = 12;
/// Not needed any more.
const NEVER: u32 = u32::MAX;

/// Values of a run of items: what stays where.
#[derive(Default)]
pub(super) struct Residence {
    /// Values that leave the registers after an item, in the order of items.
    leaving: Vec<(u32, ExprId)>,
    /// Places in memory of the values that leave and are needed again.
    slots: FastMap<ExprId, u32>,
}

/// Items in the order in which they are written, with what they use.
#[derive(Default)]
pub(super) struct Course {
    uses: Vec<ExprId>,
    steps: Vec<ItemUses>,
}

struct ItemUses {
    /// Number of the item in its block.
    item: u32,
    /// End of its uses.
    end: u32,
    result: Option<ExprId>,
}

/// A value in a register.
struct Resident {
    expr: ExprId,
    /// Step of its next use.
    next: u32,
}

impl Course {
    /// Appends an item whose uses were noted by [`Course::uses`].
    pub(super) fn step(&mut self, item: usize, result: Option<ExprId>) {
        self.steps.push(ItemUses { item: item as u32, end: self.uses.len() as u32, result });
    }

    /// Notes a use of the item to come.
    pub(super) fn uses(&mut self, expr: ExprId) {
        self.uses.push(expr);
    }

    /// Uses of a step.
    fn range(&self, step: usize) -> std::ops::Range<usize> {
        let start = step.checked_sub(1).map_or(0, |before| self.steps[before].end);
        start as usize..self.steps[step].end as usize
    }

    /// For each use the step of the next one of the same value, for each step that of the first use
    /// of its result.
    fn following(&self) -> (Vec<u32>, Vec<u32>) {
        let mut next: FastMap<ExprId, u32> = FastMap::default();
        let (mut of_use, mut of_result) = (vec![NEVER; self.uses.len()], vec![NEVER; self.steps.len()]);
        for step in (0..self.steps.len()).rev() {
            of_result[step] = self.steps[step].result.and_then(|r| next.get(&r).copied()).unwrap_or(NEVER);
            for i in self.range(step).rev() {
                of_use[i] = next.insert(self.uses[i], step as u32).unwrap_or(NEVER);
            }
        }
        (of_use, of_result)
    }
}

impl Residence {
    /// The residence of a course; what `is_repeated` is in memory anyway.
    pub(super) fn of(course: &Course, is_repeated: impl Fn(ExprId) -> bool) -> Residence {
        let (of_use, of_result) = course.following();
        let mut residence = Residence::default();
        let mut residents: Vec<Resident> = Vec::with_capacity(2 * RESIDENT);
        for (i, step) in course.steps.iter().enumerate() {
            for (&expr, &next) in course.uses[course.range(i)].iter().zip(&of_use[course.range(i)]) {
                match residents.iter_mut().find(|r| r.expr == expr) {
                    Some(resident) => resident.next = next,
                    None => residents.push(Resident { expr, next }),
                }
            }
            residents.retain(|r| r.next != NEVER);
            residents.extend(step.result.filter(|_| of_result[i] != NEVER).map(|expr| Resident { expr, next: of_result[i] }));
            while residents.len() > RESIDENT {
                // A value that is in memory costs no store when it leaves.
                let distance = |r: &Resident| {
                    let stored = is_repeated(r.expr) || residence.slots.contains_key(&r.expr);
                    u64::from(r.next - i as u32) * if stored { 3 } else { 2 }
                };
                let Some(last) = (0..residents.len()).max_by_key(|&k| distance(&residents[k])) else { break };
                let expr = residents.swap_remove(last).expr;
                residence.leave(step.item, expr, &is_repeated);
            }
        }
        residence
    }

    fn leave(&mut self, item: u32, expr: ExprId, is_repeated: impl Fn(ExprId) -> bool) {
        self.leaving.push((item, expr));
        if !is_repeated(expr) {
            let next = self.slots.len() as u32;
            self.slots.entry(expr).or_insert(next);
        }
    }

    /// The values that leave the registers after an item.
    pub(super) fn leaving(&self, item: usize) -> impl Iterator<Item = ExprId> + use<'_> {
        let first = self.leaving.partition_point(|&(at, _)| (at as usize) < item);
        self.leaving[first..].iter().take_while(move |&&(at, _)| at as usize == item).map(|&(_, expr)| expr)
    }

    /// Place in memory of a value that leaves the registers and is needed again.
    pub(super) fn slot(&self, expr: ExprId) -> Option<u32> {
        self.slots.get(&expr).copied()
    }

    /// Number of places in memory.
    pub(super) fn len(&self) -> u32 {
        self.slots.len() as u32
    }
}

/// Values that stay in registers within an iteration of a long loop; everything from outside of it
/// is in memory, in both lanes.
pub(super) struct WideResidence {
    pub(super) block: BlockId,
    pub(super) residence: Residence,
    /// Places of values from outside.
    pub(super) splats: FastMap<(BlockId, ExprId), u32>,
    /// First place of values of the loop.
    pub(super) start: u32,
}

impl WideResidence {
    /// Place of a value of the loop that leaves the registers.
    pub(super) fn slot(&self, expr: ExprId) -> Option<u32> {
        self.residence.slot(expr).map(|slot| self.start + 2 * slot)
    }

    /// Place of a value from outside.
    pub(super) fn splat(&self, home: BlockId, expr: ExprId) -> Option<u32> {
        self.splats.get(&(home, expr)).copied()
    }
}
