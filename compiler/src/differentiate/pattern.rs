//! From entries over loops to compressed columns.

use serde::{Deserialize, Serialize};

use super::Entry;
use crate::generate::schedule::{Job, Sink, Task};
use crate::ir::{Affine, Exprs, MAX_DEPTH};

/// Positions of the non-zeros of a matrix, column after column.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pattern {
    /// Start of each column in `row_indices`, and its length at the end.
    pub column_pointers: Vec<usize>,
    /// Row of each non-zero, ascending in each column.
    pub row_indices: Vec<usize>,
}

impl Pattern {
    /// Number of non-zeros.
    #[must_use]
    pub fn nonzeros(&self) -> usize {
        self.row_indices.len()
    }

    /// Position of an entry among the values.
    #[must_use]
    pub fn position(&self, row: usize, column: usize) -> Option<usize> {
        let (start, end) = (*self.column_pointers.get(column)?, *self.column_pointers.get(column + 1)?);
        self.row_indices[start..end].binary_search(&row).ok().map(|i| start + i)
    }

    /// As [`position`](Self::position), looked for at `guess` first.
    fn position_near(&self, guess: usize, row: usize, column: usize) -> Option<usize> {
        let (start, end) = (*self.column_pointers.get(column)?, *self.column_pointers.get(column + 1)?);
        if (start..end).contains(&guess) && self.row_indices[guess] == row { Some(guess) } else { self.position(row, column) }
    }

    /// The pattern of entries in a matrix of `columns` columns.
    #[must_use]
    pub fn new(entries: &[Entry], columns: usize) -> Pattern {
        let mut counts = vec![0usize; columns + 1];
        for entry in entries {
            each_place(entry, |_, column| counts[column + 1] += 1);
        }
        for c in 0..columns {
            counts[c + 1] += counts[c];
        }
        let mut next = counts.clone();
        let mut rows = vec![0u32; counts[columns]];
        for entry in entries {
            each_place(entry, |row, column| {
                let place = &mut next[column];
                rows[*place] = row as u32;
                *place += 1;
            });
        }
        let mut pattern = Pattern { column_pointers: vec![0], row_indices: Vec::with_capacity(rows.len()) };
        for c in 0..columns {
            let column = &mut rows[counts[c]..counts[c + 1]];
            column.sort_unstable();
            let mut last = None;
            for &row in column.iter().filter(|&&r| last.replace(r) != Some(r)) {
                pattern.row_indices.push(row as usize);
            }
            pattern.column_pointers.push(pattern.row_indices.len());
        }
        pattern
    }
}

/// Calls `visit` with row and column of every pass, the last loop fastest.
fn each_place(entry: &Entry, mut visit: impl FnMut(usize, usize)) {
    let Some((&(inner, extent), outer)) = entry.loops.split_last() else {
        let none = [0; MAX_DEPTH];
        return visit(entry.row.at(&none) as usize, entry.column.at(&none) as usize);
    };
    let (row_stride, column_stride) = (entry.row.strides[inner as usize], entry.column.strides[inner as usize]);
    each(outer, |counters| {
        let (mut row, mut column) = (entry.row.at(counters), entry.column.at(counters));
        for _ in 0..extent {
            visit(row as usize, column as usize);
            row += row_stride;
            column += column_stride;
        }
    });
}

/// Calls `visit` with the counters of every pass, the last loop fastest.
pub(crate) fn each(loops: &[(u8, u32)], mut visit: impl FnMut(&[i64; MAX_DEPTH])) {
    let mut counters = [0i64; MAX_DEPTH];
    if loops.iter().any(|&(_, extent)| extent == 0) {
        return;
    }
    loop {
        visit(&counters);
        let mut d = loops.len();
        loop {
            let Some(&(counter, extent)) = d.checked_sub(1).and_then(|d| loops.get(d)) else {
                return;
            };
            d -= 1;
            let here = &mut counters[counter as usize];
            *here += 1;
            if *here < i64::from(extent) {
                break;
            }
            *here = 0;
        }
    }
}

/// The job that writes the values of all entries in the order of the pattern; position tables are appended to `tables`.
#[must_use]
pub fn job(entries: &[Entry], pattern: &Pattern, exprs: &mut Exprs, tables: &mut Vec<u32>) -> Job {
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
        let task = |sink, value| Task { loops: entry.loops.clone(), stores: vec![(sink, value)] };
        if shared {
            // Another entry writes to one of these places: all is added to zeros.
            let (table, index) = (tables.len() as u32, row_major(&entry.loops));
            tables.extend(&slots);
            let placed = |add| Sink::Table { table, index, plus: Affine::default(), add };
            cleared.push(task(placed(false), zero));
            added.push(task(placed(true), entry.value));
        } else {
            stored.push(task(sink(&entry.loops, &slots, tables), entry.value));
        }
    }
    Job { stages: [cleared, stored, added].into_iter().filter(|s| !s.is_empty()).collect(), in_place: false }
}

/// Number of a pass as a function of the counters.
pub(crate) fn row_major(loops: &[(u8, u32)]) -> Affine {
    let mut at = Affine::default();
    let mut stride = 1;
    for &(counter, extent) in loops.iter().rev() {
        at.strides[counter as usize] = stride;
        stride *= i64::from(extent);
    }
    at
}

/// The cheapest sink that hits the slots: affine in all counters, affine in the innermost one, or a table.
fn sink(loops: &[(u8, u32)], slots: &[u32], tables: &mut Vec<u32>) -> Sink {
    let order = row_major(loops);
    let slot = |i: i64| slots.get(i as usize).map_or(0, |&s| i64::from(s));
    let mut affine = Affine::constant(slot(0));
    for &(counter, _) in loops.iter().filter(|l| l.1 > 1) {
        affine.strides[counter as usize] = slot(order.strides[counter as usize]) - slot(0);
    }
    if matches(loops, slots, |counters| affine.at(counters)) {
        return Sink::Out(affine);
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
            return Sink::Table { table, index, plus, add: false };
        }
    }
    tables.extend(slots);
    Sink::Table { table, index: order, plus: Affine::default(), add: false }
}

fn matches(loops: &[(u8, u32)], slots: &[u32], at: impl Fn(&[i64; MAX_DEPTH]) -> i64) -> bool {
    let (mut i, mut same) = (0, true);
    each(loops, |counters| {
        same &= slots.get(i).is_some_and(|&s| i64::from(s) == at(counters));
        i += 1;
    });
    same
}
