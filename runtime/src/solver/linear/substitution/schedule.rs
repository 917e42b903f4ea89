//! Grouping and order of sums.

use std::collections::HashMap;

/// Sums in a chunk.
pub(super) const LANES: usize = 4;

/// Factor of a term of a sum.
#[derive(Clone, Copy)]
pub(in super::super) enum Source {
    /// This row of the right-hand side.
    Right(u32),
    /// The result of this sum.
    Sum(u32),
}

/// Places of the factors of sums.
pub(in super::super) struct Places(Vec<Vec<u32>>);

impl Places {
    /// Places of the terms of a sum, in their order.
    pub(crate) fn of(&self, sum: u32) -> &[u32] {
        &self.0[sum as usize]
    }
}

/// Up to four sums that take a term each at a time, in turns of three kinds; or a single one.
#[derive(Clone, Copy, Default)]
pub(super) struct Chunk {
    /// Terms of a single sum; zero if there are several.
    pub single: u32,
    /// Turns whose operands are anywhere: four places each.
    pub gathers: u32,
    /// Turns in which all sums take the same operand: one place each.
    pub broadcasts: u32,
    /// Turns whose operands are adjacent: the first one's place.
    pub runs: u32,
}

/// Processor cycles, roughly: what a chunk costs besides its turns, a turn of one load, and one of
/// four.
const CHUNK: u32 = 6;
const LOAD: u32 = 1;
const GATHER: u32 = 5;

/// A term: where its operand is, and its number in the sum.
type Term = (u32, u32);

/// A turn: the place of the operand of each lane, and the number of the lane's term if it has one.
#[derive(Clone, Copy)]
struct Turn {
    operands: [u32; LANES],
    terms: [Option<u32>; LANES],
}

/// Turns of a chunk by kind.
#[derive(Default)]
struct Turns {
    gathers: Vec<Turn>,
    broadcasts: Vec<Turn>,
    runs: Vec<Turn>,
}

impl Turns {
    /// The terms of up to four sums, number by number. What is read for a lane without a term lies
    /// below `limit`, where everything has been written.
    fn new(lanes: &[&[Term]], limit: u32) -> Self {
        let mut turns = Self::default();
        for number in 0..lanes.iter().map(|terms| terms.len()).max().unwrap_or(0) {
            let mut operands = [None; LANES];
            let mut terms = [None; LANES];
            for (lane, list) in lanes.iter().enumerate() {
                if let Some(&(place, term)) = list.get(number) {
                    (operands[lane], terms[lane]) = (Some(place), Some(term));
                }
            }
            let Some((first, one)) = operands.iter().enumerate().find_map(|(lane, place)| place.map(|p| (lane as u32, p))) else {
                continue;
            };
            let all = |expected: &dyn Fn(u32) -> Option<u32>| {
                operands.iter().zip(0..).all(|(place, lane)| place.is_none_or(|p| Some(p) == expected(lane)))
            };
            let base = one.checked_sub(first).filter(|base| base + LANES as u32 <= limit);
            if all(&|_| Some(one)) {
                turns.broadcasts.push(Turn { operands: [one; LANES], terms });
            } else if let Some(base) = base.filter(|base| all(&|lane| Some(base + lane))) {
                turns.runs.push(Turn { operands: [base; LANES], terms });
            } else {
                turns.gathers.push(Turn { operands: operands.map(|place| place.unwrap_or(one)), terms });
            }
        }
        turns
    }

    fn cost(&self) -> u32 {
        CHUNK + self.gathers.len() as u32 * GATHER + (self.broadcasts.len() + self.runs.len()) as u32 * LOAD
    }
}

/// Cost of separate sums.
fn cost_apart(lists: &[&[Term]]) -> u32 {
    lists.iter().map(|terms| CHUNK + terms.len() as u32 * LOAD).sum()
}

/// The chunks of a substitution, and where everything is.
pub(super) struct Schedule {
    pub chunks: Vec<Chunk>,
    pub operands: Vec<u32>,
    /// Number of factors.
    pub factors: usize,
    /// Place of the result of each sum.
    pub slots: Vec<u32>,
    /// End of the results.
    pub end: u32,
    pub places: Places,
}

impl Schedule {
    /// For a right-hand side of this length.
    pub(super) fn new(sums: &[Vec<Source>], right: usize) -> Self {
        let mut schedule = Self {
            chunks: Vec::new(),
            operands: Vec::new(),
            factors: 0,
            slots: vec![0; sums.len()],
            end: right as u32,
            places: Places(sums.iter().map(|terms| vec![0; terms.len()]).collect()),
        };
        let level = levels(sums);
        let mut order: Vec<usize> = (0..sums.len()).collect();
        order.sort_by_key(|&sum| (level[sum], sums[sum].len()));
        for group in order.chunk_by(|&a, &b| level[a] == level[b] && sums[a].len() == sums[b].len()) {
            schedule.add(group, sums, &level);
        }
        schedule
    }

    /// Adds sums of one level and length.
    fn add(&mut self, group: &[usize], sums: &[Vec<Source>], level: &[u32]) {
        // What was computed last is needed last.
        let terms: HashMap<usize, Vec<Term>> = group.iter().map(|&sum| (sum, self.terms(&sums[sum], level))).collect();
        let places = |sum: usize| terms[&sum].iter().map(|term| term.0);
        let mut alike = group.to_vec();
        alike.sort_by(|&a, &b| places(a).cmp(places(b)));
        // The rows of a block have the same operands: side by side, or those of the same number of
        // several blocks.
        let mut across: Vec<(usize, usize)> = Vec::with_capacity(group.len());
        for block in alike.chunk_by(|&a, &b| places(a).eq(places(b))) {
            across.extend(block.iter().copied().enumerate());
        }
        across.sort_by_key(|&(row, _)| row);
        let across = across.into_iter().map(|(_, sum)| sum).collect::<Vec<_>>();
        let limit = self.end;
        let cost = |order: &[usize]| -> u32 { self::cost(order, &terms, limit) };
        let order = if cost(&across) < cost(&alike) { across } else { alike };
        for lanes in order.chunks(LANES) {
            self.push(lanes, &terms, limit);
        }
    }

    /// Terms of a sum with the places of their operands, the oldest first.
    fn terms(&self, sum: &[Source], level: &[u32]) -> Vec<Term> {
        let mut terms: Vec<(u32, Term)> = sum
            .iter()
            .zip(0..)
            .map(|(source, number)| match *source {
                Source::Right(row) => (0, (row, number)),
                Source::Sum(before) => (level[before as usize] + 1, (self.slots[before as usize], number)),
            })
            .collect();
        terms.sort_unstable();
        terms.into_iter().map(|(_, term)| term).collect()
    }

    fn push(&mut self, lanes: &[usize], terms: &HashMap<usize, Vec<Term>>, limit: u32) {
        let lists: Vec<&[Term]> = lanes.iter().map(|sum| terms[sum].as_slice()).collect();
        let turns = Turns::new(&lists, limit);
        if cost_apart(&lists) <= turns.cost() {
            for &sum in lanes {
                self.push_single(sum, &terms[&sum]);
            }
            return;
        }
        for (&sum, slot) in lanes.iter().zip(self.end..) {
            self.slots[sum] = slot;
        }
        self.end += LANES as u32;
        let count = |turns: &[Turn]| turns.len() as u32;
        let (gathers, broadcasts, runs) = (count(&turns.gathers), count(&turns.broadcasts), count(&turns.runs));
        self.chunks.push(Chunk { single: 0, gathers, broadcasts, runs });
        for turn in &turns.gathers {
            self.operands.extend(turn.operands);
        }
        self.operands.extend(turns.broadcasts.iter().chain(&turns.runs).map(|turn| turn.operands[0]));
        for turn in turns.gathers.iter().chain(&turns.broadcasts).chain(&turns.runs) {
            for (lane, term) in turn.terms.iter().enumerate() {
                if let Some(term) = term {
                    self.places.0[lanes[lane]][*term as usize] = (self.factors + lane) as u32;
                }
            }
            self.factors += LANES;
        }
    }

    fn push_single(&mut self, sum: usize, terms: &[Term]) {
        self.slots[sum] = self.end;
        self.end += 1;
        self.chunks.push(Chunk { single: terms.len() as u32, ..Chunk::default() });
        for &(place, term) in terms {
            self.operands.push(place);
            self.places.0[sum][term as usize] = self.factors as u32;
            self.factors += 1;
        }
    }
}

/// Cost of the sums of a group in this order.
fn cost(order: &[usize], terms: &HashMap<usize, Vec<Term>>, limit: u32) -> u32 {
    let chunk = |lanes: &[usize]| {
        let lists: Vec<&[Term]> = lanes.iter().map(|sum| terms[sum].as_slice()).collect();
        cost_apart(&lists).min(Turns::new(&lists, limit).cost())
    };
    order.chunks(LANES).map(chunk).sum()
}

/// The level of each sum: as early as it can be done or as late as it may be, wherever more others
/// are done.
fn levels(sums: &[Vec<Source>]) -> Vec<u32> {
    let used = |sum: usize| sums[sum].iter().filter_map(|term| if let Source::Sum(before) = term { Some(*before as usize) } else { None });
    let mut early = vec![0_u32; sums.len()];
    for sum in 0..sums.len() {
        early[sum] = used(sum).map(|before| early[before] + 1).max().unwrap_or(0);
    }
    let last = early.iter().copied().max().unwrap_or(0);
    let mut late = vec![last; sums.len()];
    for sum in (0..sums.len()).rev() {
        let here = late[sum];
        for before in used(sum) {
            late[before] = late[before].min(here.saturating_sub(1));
        }
    }
    let width = |levels: &[u32]| {
        let mut width = vec![0_u32; last as usize + 1];
        levels.iter().for_each(|&level| width[level as usize] += 1);
        width
    };
    let (early_width, late_width) = (width(&early), width(&late));
    let mut level = vec![0_u32; sums.len()];
    for sum in 0..sums.len() {
        let (first, last) = (early[sum], late[sum]);
        let choice = if late_width[last as usize] > early_width[first as usize] { last } else { first };
        let ready = used(sum).map(|before| level[before] + 1).max().unwrap_or(0);
        level[sum] = choice.max(ready);
    }
    level
}
