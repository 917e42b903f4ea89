//! The staged program of the Jacobian: entries over loops, stored at their positions in the
//! compressed columns.

use super::staged::{Staged, row_major};
use crate::differentiate::Entry;
use crate::differentiate::pattern::{Pattern, each, each_place};
use crate::ir::{Affine, Exprs, MAX_DEPTH, Nest, Place, Store, Target};

/// The staged program that writes the values of all entries in the order of the pattern; position
/// tables are appended to `tables`.
#[must_use]
pub(crate) fn of_entries(entries: &[Entry], pattern: &Pattern, exprs: &mut Exprs, tables: &mut Vec<u32>) -> Staged {
    let zero = exprs.constant(0.0);
    let mut taken = vec![false; pattern.nonzeros()];
    let (mut cleared, mut stored, mut added) = (vec![], vec![], vec![]);
    for entry in entries {
        let mut slots = vec![];
        // Along a loop, entries are usually as far apart as the two before.
        let (mut last, mut distance) = (0_usize, 0_usize);
        each_place(entry, |row, column| {
            let position = pattern.position_near(last.wrapping_add(distance), row, column).unwrap_or(0);
            distance = position.wrapping_sub(last);
            last = position;
            slots.push(position as u32);
        });
        let mut shared = false;
        for &slot in &slots {
            shared |= std::mem::replace(&mut taken[slot as usize], true);
        }
        let nest = |target, value| Nest { loops: entry.loops.clone(), stores: vec![Store { target, value }] };
        if shared {
            // Another entry writes to one of these places: all is added to zeros.
            let (table, index) = (tables.len() as u32, row_major(&entry.loops));
            tables.extend(&slots);
            let placed = |add| Target { place: Place::Table { table, plus: Affine::default(), add }, at: index };
            cleared.push(nest(placed(false), zero));
            added.push(nest(placed(true), entry.value));
        } else {
            stored.push(nest(target(&entry.loops, &slots, tables), entry.value));
        }
    }
    Staged { stages: [cleared, stored, added].into_iter().filter(|s| !s.is_empty()).collect(), in_place: false }
}

/// The cheapest target that hits the slots: affine in all counters, affine in the innermost one, or
/// a table.
fn target(loops: &[(u8, u32)], slots: &[u32], tables: &mut Vec<u32>) -> Target {
    let order = row_major(loops);
    let slot = |i: i64| slots.get(i as usize).map_or(0, |&s| i64::from(s));
    let mut affine = Affine::constant(slot(0));
    for &(counter, _) in loops.iter().filter(|l| l.1 > 1) {
        affine.strides[counter as usize] = slot(order.strides[counter as usize]) - slot(0);
    }
    if matches(loops, slots, |counters| affine.at(counters)) {
        return Target::out(affine);
    }
    let table = tables.len() as u32;
    if let Some((&(inner, extent), outer)) = loops.split_last() {
        let mut plus = Affine::default();
        plus.strides[inner as usize] = affine.strides[inner as usize];
        let index = row_major(outer);
        let starts: Vec<u32> = slots.iter().step_by(extent as usize).copied().collect();
        let start = |counters: &[i64; MAX_DEPTH]| i64::from(starts[index.at(counters) as usize]);
        if !outer.is_empty() && matches(loops, slots, |counters| start(counters) + plus.at(counters)) {
            tables.extend(starts);
            return Target { place: Place::Table { table, plus, add: false }, at: index };
        }
    }
    tables.extend(slots);
    Target { place: Place::Table { table, plus: Affine::default(), add: false }, at: order }
}

fn matches(loops: &[(u8, u32)], slots: &[u32], at: impl Fn(&[i64; MAX_DEPTH]) -> i64) -> bool {
    let (mut i, mut same) = (0, true);
    each(loops, |counters| {
        same &= slots.get(i).is_some_and(|&s| i64::from(s) == at(counters));
        i += 1;
    });
    same
}
