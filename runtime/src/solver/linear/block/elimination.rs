//! The factorisation of a large block as a list of sums, four at a time where they have as many
//! terms.
//!
//! Row by row, the processor waits at nearly every product for the one before: each is added to a
//! number that has just been stored. But an entry of L or U waits only for the entries of its sum,
//! a_ij − Σ l_ik u_kj (Crout's form of Gaussian elimination). Entries that do not wait for each
//! other form a level; those of a level with as many terms are done side by side.

use super::reciprocal;

/// Entries done side by side.
const LANES: usize = 4;

/// An entry of the matrix and where it goes.
#[derive(Clone, Copy)]
pub(super) struct Move {
    pub entry: u32,
    pub to: u32,
}

/// The rows of a block before places are known, columns counted from its beginning.
pub(super) struct Rows<'a> {
    /// Entries of the matrix, by columns.
    pub entries: Vec<Vec<Move>>,
    /// Columns of L without its diagonal, fill included.
    pub lower: &'a [Vec<u32>],
    /// Columns of U without its diagonal.
    pub upper: &'a [Vec<u32>],
    /// Places of factors: those of L, row by row,
    pub lower_places: Vec<Vec<u32>>,
    /// those of U,
    pub upper_places: Vec<Vec<u32>>,
    /// and the reciprocals of pivots.
    pub inverse_places: Vec<u32>,
}

impl Rows<'_> {
    /// Products of a factorisation.
    pub(super) fn products(&self) -> usize {
        self.lower.iter().flatten().map(|&column| self.upper[column as usize].len()).sum()
    }

    /// Entries of both factors without their diagonals.
    pub(super) fn entries(&self) -> usize {
        self.lower.iter().chain(self.upper).map(Vec::len).sum()
    }
}

/// Kind of a number. L and the pivots have places among the factors.
#[derive(Clone, Copy, PartialEq, Eq)]
enum FactorEntry {
    /// Minus an entry of L; the pivot of its column, its place.
    Lower(u32, u32),
    Upper,
    /// The reciprocal of a pivot; its place.
    Pivot(u32),
}

/// A number to be computed.
struct Number {
    kind: FactorEntry,
    /// The entry of the matrix, unless it is one of the fill.
    entry: Option<u32>,
    /// Pairs of numbers of L and U.
    terms: Vec<(u32, u32)>,
    level: u32,
}

impl Number {
    /// Those that agree in it are done side by side.
    fn shape(&self) -> (u32, u8, bool, usize) {
        let kind = match self.kind {
            FactorEntry::Lower(..) => 0,
            FactorEntry::Upper => 1,
            FactorEntry::Pivot(_) => 2,
        };
        (self.level, kind, self.entry.is_none(), self.terms.len())
    }
}

/// Numbers done side by side.
struct Chunk {
    kind: FactorEntry,
    /// They are not entries of the matrix.
    fill: bool,
    /// One, or four.
    single: bool,
    terms: u32,
}

/// L U = D with a diagonal of ones in L.
pub(super) struct Elimination {
    chunks: Box<[Chunk]>,
    /// For each chunk, of each of its numbers: the entry of the matrix, unless it is fill; both
    /// factors of each term. The reciprocal of the pivot and the place, if it is of L; the place,
    /// if it is a pivot.
    places: Box<[u32]>,
    /// Minus L, U and the reciprocals of the pivots, in the order of the chunks.
    numbers: Box<[f64]>,
    /// Rows of U: the pivot, and the end of the row's
    rows: Box<[(u32, u32)]>,
    /// numbers and places.
    upper: Box<[(u32, u32)]>,
}

impl Elimination {
    pub(crate) fn new(rows: &Rows) -> Self {
        let (numbers, upper, pivots) = list(rows);
        let mut order: Vec<u32> = (0..numbers.len() as u32).collect();
        order.sort_by_key(|&at| numbers[at as usize].shape());
        let mut slots = vec![0; numbers.len()];
        let (mut chunks, mut places, mut end) = (Vec::new(), Vec::new(), 0);
        let same = |a: &u32, b: &u32| numbers[*a as usize].shape() == numbers[*b as usize].shape();
        for group in order.chunk_by_mut(same) {
            // Neighbours read adjacent values.
            group.sort_by_cached_key(|&at| operands(&numbers[at as usize], &slots));
            for lanes in group.chunks(LANES) {
                let first = &numbers[lanes[0] as usize];
                let single = lanes.len() == 1;
                chunks.push(Chunk { kind: first.kind, fill: first.entry.is_none(), single, terms: first.terms.len() as u32 });
                // A lane without a number repeats the last one.
                let width = if single { 1 } else { LANES };
                let lanes: Vec<u32> = (0..width).map(|lane| lanes[lane.min(lanes.len() - 1)]).collect();
                write(&lanes, &numbers, &slots, &mut places);
                lanes.iter().zip(end..).for_each(|(&at, slot)| slots[at as usize] = slot);
                end += width as u32;
            }
        }
        let slot = |at: u32| slots[at as usize];
        let mut row_end = 0;
        let mut row = |(pivot, row): (&u32, &Vec<u32>)| {
            row_end += row.len() as u32;
            (slot(*pivot), row_end)
        };
        Self {
            chunks: chunks.into(),
            places: places.into(),
            numbers: vec![0.0; end as usize].into(),
            rows: pivots.iter().zip(rows.upper).map(&mut row).collect(),
            upper: upper.iter().zip(rows.upper_places.iter().flatten()).map(|(&at, &place)| (slot(at), place)).collect(),
        }
    }

    /// Factorises the block and sets its factors; false where a pivot does not serve.
    ///
    /// # Safety
    /// `values` and `factors` have the lengths for which the structure was made.
    #[inline(always)]
    pub(crate) unsafe fn run(&mut self, values: &[f64], factors: &mut [f64]) -> bool {
        let mut places = self.places.as_ptr();
        let numbers = self.numbers.as_mut_ptr();
        let mut result = numbers;
        // SAFETY: `new` wrote as many places as are read here, of entries and factors that exist by
        // the contract, and of numbers of earlier chunks.
        unsafe {
            for chunk in &self.chunks {
                let served = if chunk.single {
                    step::<1>(chunk, values, factors, numbers, &mut result, &mut places)
                } else {
                    step::<LANES>(chunk, values, factors, numbers, &mut result, &mut places)
                };
                if !served {
                    return false;
                }
            }
            let mut begin = 0;
            for &(pivot, end) in &self.rows {
                let inverse = -*numbers.add(pivot as usize);
                for &(number, place) in self.upper.get_unchecked(begin..end as usize) {
                    *factors.get_unchecked_mut(place as usize) = inverse * *numbers.add(number as usize);
                }
                begin = end as usize;
            }
        }
        true
    }
}

/// All numbers, each behind those of its terms; those of U and the pivots, row by row.
fn list(rows: &Rows) -> (Vec<Number>, Vec<u32>, Vec<u32>) {
    let (mut numbers, mut upper, mut pivots) = (Vec::<Number>::new(), Vec::new(), Vec::<u32>::new());
    let mut upper_starts = vec![];
    // The number at each column of the row.
    let mut at = vec![u32::MAX; rows.lower.len()];
    for (row, (left, right)) in rows.lower.iter().zip(rows.upper).enumerate() {
        let first = numbers.len() as u32;
        let new = |kind| Number { kind, entry: None, terms: Vec::new(), level: 0 };
        numbers.extend(
            left.iter().zip(&rows.lower_places[row]).map(|(&column, &place)| new(FactorEntry::Lower(pivots[column as usize], place))),
        );
        numbers.push(new(FactorEntry::Pivot(rows.inverse_places[row])));
        numbers.extend(right.iter().map(|_| new(FactorEntry::Upper)));
        pivots.push(first + left.len() as u32);
        upper_starts.push(upper.len());
        upper.extend(first + left.len() as u32 + 1..numbers.len() as u32);
        left.iter().chain([&(row as u32)]).chain(right).zip(first..).for_each(|(&column, number)| at[column as usize] = number);
        rows.entries[row].iter().for_each(|item| numbers[at[item.to as usize] as usize].entry = Some(item.entry));
        for (&column, number) in left.iter().zip(first..) {
            finish(&mut numbers, number);
            let columns = &rows.upper[column as usize];
            for (&target, &other) in columns.iter().zip(&upper[upper_starts[column as usize]..]) {
                numbers[at[target as usize] as usize].terms.push((number, other));
            }
        }
        (first + left.len() as u32..numbers.len() as u32).for_each(|number| finish(&mut numbers, number));
    }
    (numbers, upper, pivots)
}

/// Sets the level of a number whose terms are known.
fn finish(numbers: &mut [Number], number: u32) {
    let Number { kind, terms, .. } = &numbers[number as usize];
    let pivot = if let FactorEntry::Lower(pivot, _) = *kind { Some(pivot) } else { None };
    let before = terms.iter().flat_map(|&(l, u)| [l, u]).chain(pivot);
    numbers[number as usize].level = before.map(|before| numbers[before as usize].level + 1).max().unwrap_or(0);
}

/// Places of the operands of a number.
fn operands(number: &Number, slots: &[u32]) -> (Vec<(u32, u32)>, Option<u32>, Option<u32>) {
    let slot = |at: u32| slots[at as usize];
    let pivot = if let FactorEntry::Lower(pivot, _) = number.kind { Some(slot(pivot)) } else { None };
    (number.terms.iter().map(|&(l, u)| (slot(l), slot(u))).collect(), pivot, number.entry)
}

/// Writes the places that the numbers of a chunk need.
fn write(lanes: &[u32], numbers: &[Number], slots: &[u32], places: &mut Vec<u32>) {
    let lanes = || lanes.iter().map(|&at| &numbers[at as usize]);
    places.extend(lanes().filter_map(|number| number.entry));
    for term in 0..lanes().next().map_or(0, |number| number.terms.len()) {
        places.extend(lanes().map(|number| slots[number.terms[term].0 as usize]));
        places.extend(lanes().map(|number| slots[number.terms[term].1 as usize]));
    }
    places.extend(
        lanes().filter_map(|number| if let FactorEntry::Lower(pivot, _) = number.kind { Some(slots[pivot as usize]) } else { None }),
    );
    places.extend(lanes().filter_map(|number| match number.kind {
        FactorEntry::Lower(_, place) | FactorEntry::Pivot(place) => Some(place),
        FactorEntry::Upper => None,
    }));
}

/// Reads so many places.
///
/// # Safety
/// There are as many.
#[inline(always)]
unsafe fn take<const N: usize>(places: &mut *const u32) -> [usize; N] {
    // SAFETY: by the contract.
    unsafe {
        let taken = *places.cast::<[u32; N]>();
        *places = places.add(N);
        taken.map(|place| place as usize)
    }
}

/// Computes the numbers of a chunk; false where a pivot does not serve.
///
/// # Safety
/// The places are those of this chunk, and numbers at them were computed.
#[inline(always)]
unsafe fn step<const N: usize>(
    chunk: &Chunk,
    values: &[f64],
    factors: &mut [f64],
    numbers: *const f64,
    result: &mut *mut f64,
    places: &mut *const u32,
) -> bool {
    // SAFETY: by the contract.
    unsafe {
        let entries: [f64; N] = if chunk.fill { [0.0; N] } else { take(places).map(|place| *values.get_unchecked(place)) };
        let mut sums = entries;
        for _ in 0..chunk.terms {
            let (l, u): ([usize; N], [usize; N]) = (take(places), take(places));
            for lane in 0..N {
                sums[lane] = (*numbers.add(l[lane])).mul_add(*numbers.add(u[lane]), sums[lane]);
            }
        }
        match chunk.kind {
            FactorEntry::Upper => {}
            FactorEntry::Lower(..) => {
                let inverses: [usize; N] = take(places);
                for lane in 0..N {
                    sums[lane] = -sums[lane] * *numbers.add(inverses[lane]);
                }
            }
            FactorEntry::Pivot(_) => {
                for lane in 0..N {
                    let Some(inverse) = reciprocal(sums[lane], entries[lane]) else { return false };
                    sums[lane] = inverse;
                }
            }
        }
        if chunk.kind != FactorEntry::Upper {
            let to: [usize; N] = take(places);
            for lane in 0..N {
                *factors.get_unchecked_mut(to[lane]) = sums[lane];
            }
        }
        *result.cast::<[f64; N]>() = sums;
        *result = result.add(N);
    }
    true
}
