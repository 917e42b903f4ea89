//! Structure of a factorisation without numbers, and the factorisation of one block by it.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::ops::Range;

use super::super::substitution::{Places, Source, Substitution};
use super::elimination::{Elimination, Move, Rows};
use super::order::{Order, places};
use super::rowwise::RowWise;
use super::{LANES, SMALL, serves};
use crate::solver::{Pattern, SolveError};

/// Diagonal blocks.
pub(super) enum BlockStep {
    /// To be inverted: blocks of one dimension, one or [`LANES`] of them side by side.
    Small { size: u8, single: bool },
    /// To be factorised.
    Large(Box<Large>),
}

/// Small blocks, in the order of their steps. With D the block and B what is before it, x = D⁻¹ b −
/// D⁻¹ B x_before. Of adjacent blocks, items come in turns.
#[derive(Default)]
pub(super) struct Small {
    /// Number of entries of D, and of columns of B that are not zero, of each block or of blocks
    /// side by side.
    counts: Vec<(u32, u32)>,
    /// Entries of D, to places of the full block by rows.
    inside: Vec<Move>,
    /// Number of entries of each column of B.
    columns: Vec<u32>,
    /// Entries of B column by column, to rows of the block.
    outside: Vec<Move>,
    /// Places of the factors: D⁻¹ by rows, then D⁻¹ B by columns.
    places: Vec<u32>,
}

/// Position in [`Small`].
pub(super) struct Cursor<'a> {
    counts: std::slice::Iter<'a, (u32, u32)>,
    inside: &'a [Move],
    columns: &'a [u32],
    outside: &'a [Move],
    places: &'a [u32],
}

impl Small {
    pub(crate) fn cursor(&self) -> Cursor<'_> {
        Cursor { counts: self.counts.iter(), inside: &self.inside, columns: &self.columns, outside: &self.outside, places: &self.places }
    }
}

/// Takes the first `count` items off.
///
/// # Safety
/// There are as many.
#[inline(always)]
unsafe fn take<'a, T>(from: &mut &'a [T], count: usize) -> &'a [T] {
    // SAFETY: there are `count` items, by the contract.
    unsafe {
        let taken = from.get_unchecked(..count);
        *from = from.get_unchecked(count..);
        taken
    }
}

impl Cursor<'_> {
    /// Inverts the next blocks, of dimension `N`, and sets their factors; false where a pivot does
    /// not serve.
    ///
    /// # Safety
    /// `values` and `factors` have the lengths for which the structure was made, and the next `L`
    /// blocks are adjacent and have dimension `N`.
    #[inline(always)]
    pub(crate) unsafe fn invert<const N: usize, const L: usize>(&mut self, values: &[f64], factors: &mut [f64]) -> bool {
        // SAFETY: places and entries are those of the structure, whose lengths `values` and
        // `factors` have by the contract. Blocks are taken in the order in which the structure was
        // written, so that a next one with as many items is there.
        unsafe {
            let &(entries, columns) = self.counts.next().unwrap_unchecked();
            let mut block = [[[0.0_f64; L]; N]; N];
            for items in take(&mut self.inside, entries as usize * L).as_chunks::<L>().0 {
                *block.as_flattened_mut().get_unchecked_mut(items[0].to as usize) = read(items, values);
            }
            if !invert(&mut block) {
                return false;
            }
            for value in block.as_flattened() {
                self.set(value, factors);
            }
            for &entries in take(&mut self.columns, columns as usize) {
                let mut products = [[0.0_f64; L]; N];
                for items in take(&mut self.outside, entries as usize * L).as_chunks::<L>().0 {
                    let value = read(items, values);
                    for (row, product) in block.iter().zip(&mut products) {
                        subtract(product, row.get_unchecked(items[0].to as usize), &value);
                    }
                }
                for product in &products {
                    self.set(product, factors);
                }
            }
        }
        true
    }

    /// Sets a factor of each block.
    ///
    /// # Safety
    /// The next places are those of these factors.
    #[inline(always)]
    unsafe fn set<const L: usize>(&mut self, value: &[f64; L], factors: &mut [f64]) {
        // SAFETY: by the contract.
        unsafe {
            for (&place, &value) in take(&mut self.places, L).iter().zip(value) {
                *factors.get_unchecked_mut(place as usize) = value;
            }
        }
    }
}

/// An entry of each block.
///
/// # Safety
/// There are such entries.
#[inline(always)]
unsafe fn read<const L: usize>(items: &[Move; L], values: &[f64]) -> [f64; L] {
    // SAFETY: by the contract.
    items.map(|item| unsafe { *values.get_unchecked(item.entry as usize) })
}

/// `from -= a * b`, block by block.
#[inline(always)]
fn subtract<const L: usize>(from: &mut [f64; L], a: &[f64; L], b: &[f64; L]) {
    for lane in 0..L {
        from[lane] = (-a[lane]).mul_add(b[lane], from[lane]);
    }
}

/// Gauss–Jordan elimination in place, pivots on the diagonal, of blocks side by side; false where
/// one does not serve.
#[inline(always)]
fn invert<const N: usize, const L: usize>(a: &mut [[[f64; L]; N]; N]) -> bool {
    let diagonal: [[f64; L]; N] = std::array::from_fn(|i| a[i][i]);
    let mut serve = true;
    for k in 0..N {
        let mut inverse = [0.0; L];
        for lane in 0..L {
            inverse[lane] = 1.0 / a[k][k][lane];
            serve &= serves(a[k][k][lane], inverse[lane], diagonal[k][lane]);
        }
        a[k][k] = [1.0; L];
        a[k].iter_mut().for_each(|entry| entry.iter_mut().zip(&inverse).for_each(|(entry, inverse)| *entry *= inverse));
        let pivot_row = a[k];
        for i in (0..N).filter(|&i| i != k) {
            let factor = std::mem::replace(&mut a[i][k], [0.0; L]);
            for (entry, pivot) in a[i].iter_mut().zip(&pivot_row) {
                subtract(entry, &factor, pivot);
            }
        }
    }
    serve
}

/// Products for each entry of the factors up to which they are listed.
const LISTED: usize = 16;

/// Factorisation of a large block.
enum Factorisation {
    Levels(Elimination),
    Rows(RowWise),
}

/// A large block: L U = D. With B what is before it, w = b − B x_before − L w and x = U⁻¹ w.
pub(super) struct Large {
    /// Entries of B, to places.
    outside: Box<[Move]>,
    factorisation: Factorisation,
    products: usize,
    /// Places of the factors that stay one.
    ones: Box<[u32]>,
}

impl Large {
    /// Products of a factorisation.
    pub(super) fn products(&self) -> usize {
        self.products
    }

    /// Factorises the block and sets its factors; false where a pivot does not serve.
    ///
    /// # Safety
    /// `values` and `factors` have the lengths for which the structure was made.
    #[inline(always)]
    pub(crate) unsafe fn eliminate(&mut self, values: &[f64], factors: &mut [f64]) -> bool {
        // SAFETY: entries and places are those of the structure, whose lengths `values` and
        // `factors` have by the contract.
        unsafe {
            for item in &self.outside {
                *factors.get_unchecked_mut(item.to as usize) = -*values.get_unchecked(item.entry as usize);
            }
            match &mut self.factorisation {
                Factorisation::Levels(elimination) => elimination.run(values, factors),
                Factorisation::Rows(rows) => rows.run(values, factors),
            }
        }
    }
}

/// Entries of the matrix in the order of elimination.
struct Entries {
    /// Row by row: entry and column.
    rows: Vec<Vec<Move>>,
    order: Order,
}

impl Entries {
    fn new(pattern: &Pattern) -> Result<Self, SolveError> {
        let mut order = Order::new(pattern)?;
        order.spread(pattern);
        let (row_places, column_places) = (places(&order.rows), places(&order.columns));
        let mut rows = vec![Vec::new(); pattern.dimension()];
        for (column, &place) in column_places.iter().enumerate() {
            for entry in pattern.column(column) {
                rows[row_places[pattern.rows()[entry]] as usize].push(Move { entry: entry as u32, to: place });
            }
        }
        rows.iter_mut().for_each(|row| row.sort_unstable_by_key(|m| m.to));
        Ok(Self { rows, order })
    }

    /// The entries of a row before its block, and those of its block.
    fn split(&self, row: u32, start: u32) -> (&[Move], &[Move]) {
        let row = &self.rows[row as usize];
        row.split_at(row.partition_point(|m| m.to < start))
    }
}

/// A block before places are known.
enum Draft {
    Small {
        block: Range<u32>,
        /// Columns of B with their entries, to rows of the block.
        columns: Vec<Vec<Move>>,
        /// The sum of each unknown.
        sums: Range<u32>,
    },
    Large {
        block: Range<u32>,
        lower: Vec<Vec<u32>>,
        upper: Vec<Vec<u32>>,
        /// For each row, the sum of w; those of x follow, from the last row to the first.
        sums: Range<u32>,
    },
}

/// A factorisation and the substitution that goes with it.
pub(super) struct Structure {
    /// The blocks, one after the other.
    pub steps: Box<[BlockStep]>,
    pub small: Small,
    pub substitution: Substitution,
}

/// Finds the structure for matrices of this pattern.
pub(super) fn analyse(pattern: &Pattern) -> Result<Structure, SolveError> {
    let entries = Entries::new(pattern)?;
    let mut sums: Vec<Vec<Source>> = Vec::new();
    // The sum that is the unknown at each place.
    let mut unknowns = vec![0_u32; pattern.dimension()];
    let blocks: Vec<_> = entries.order.blocks().collect();
    let drafts: Vec<Draft> = blocks
        .into_iter()
        .map(|block| match block.len() {
            1..=SMALL => draft_small(&entries, block, &mut sums, &mut unknowns),
            _ => draft_large(&entries, block, &mut sums, &mut unknowns),
        })
        .collect();
    let mut by_column = vec![0; unknowns.len()];
    entries.order.columns.iter().zip(&unknowns).for_each(|(&column, &sum)| by_column[column as usize] = sum);
    let (mut substitution, places) = Substitution::new(&sums, &by_column);
    let mut small = Small::default();
    let large = drafts.iter().filter_map(|draft| draft.place(&entries, &places));
    let steps: Box<[BlockStep]> = large.chain(place_small(&drafts, &entries, &places, &mut small)).collect();
    for step in &steps {
        if let BlockStep::Large(large) = step {
            large.ones.iter().for_each(|&place| substitution.factors_mut()[place as usize] = 1.0);
        }
    }
    Ok(Structure { steps, small, substitution })
}

fn draft_small(entries: &Entries, block: Range<u32>, sums: &mut Vec<Vec<Source>>, unknowns: &mut [u32]) -> Draft {
    let mut columns: BTreeMap<u32, Vec<Move>> = BTreeMap::new();
    for row in block.clone() {
        for item in entries.split(row, block.start).0 {
            columns.entry(item.to).or_default().push(Move { entry: item.entry, to: row - block.start });
        }
    }
    let first = sums.len() as u32;
    let right = block.clone().map(|row| Source::Right(entries.order.rows[row as usize]));
    let before = columns.keys().map(|&place| Source::Sum(unknowns[place as usize]));
    let terms: Vec<Source> = right.chain(before).collect();
    for row in block.clone() {
        unknowns[row as usize] = sums.len() as u32;
        sums.push(terms.clone());
    }
    Draft::Small { block, columns: columns.into_values().collect(), sums: first..sums.len() as u32 }
}

fn draft_large(entries: &Entries, block: Range<u32>, sums: &mut Vec<Vec<Source>>, unknowns: &mut [u32]) -> Draft {
    let (mut lower, mut upper) = (Vec::new(), Vec::<Vec<u32>>::new());
    let first = sums.len() as u32;
    let mut seen = vec![u32::MAX; block.len()];
    for row in block.clone() {
        let (before, inside) = entries.split(row, block.start);
        let (left, right) = filled(row - block.start, inside.iter().map(|m| m.to - block.start), &upper, &mut seen);
        let mut terms = vec![Source::Right(entries.order.rows[row as usize])];
        terms.extend(before.iter().map(|m| Source::Sum(unknowns[m.to as usize])));
        terms.extend(left.iter().map(|&column| Source::Sum(first + column)));
        sums.push(terms);
        lower.push(left);
        upper.push(right);
    }
    for row in block.clone().rev() {
        let local = row - block.start;
        let mut terms = vec![Source::Sum(first + local)];
        terms.extend(upper[local as usize].iter().map(|&column| Source::Sum(unknowns[(block.start + column) as usize])));
        unknowns[row as usize] = sums.len() as u32;
        sums.push(terms);
    }
    Draft::Large { block, lower, upper, sums: first..sums.len() as u32 }
}

/// Columns of a row of L and U, fill included, from its entries and the rows of U above. `seen`
/// holds the last row that each column was found in.
fn filled(row: u32, entries: impl Iterator<Item = u32>, upper: &[Vec<u32>], seen: &mut [u32]) -> (Vec<u32>, Vec<u32>) {
    let (mut waiting, mut left, mut right) = (BinaryHeap::new(), Vec::new(), Vec::new());
    let mut take = |column: u32, waiting: &mut BinaryHeap<Reverse<u32>>| {
        if std::mem::replace(&mut seen[column as usize], row) == row || column == row {
            return;
        }
        if column < row {
            waiting.push(Reverse(column));
        } else {
            right.push(column);
        }
    };
    entries.for_each(|column| take(column, &mut waiting));
    while let Some(Reverse(column)) = waiting.pop() {
        upper[column as usize].iter().for_each(|&next| take(next, &mut waiting));
        left.push(column);
    }
    right.sort_unstable();
    (left, right)
}

impl Draft {
    /// A large block with its places.
    fn place(&self, entries: &Entries, places: &Places) -> Option<BlockStep> {
        let Self::Large { block, lower, upper, sums } = self else { return None };
        Some(BlockStep::Large(Box::new(place_large(entries, places, block, (lower, upper), sums))))
    }

    /// A small block with its places.
    fn items(&self, entries: &Entries, places: &Places) -> Option<Items> {
        let Self::Small { block, columns, sums } = self else { return None };
        let size = block.len();
        let inside = block.clone().flat_map(|row| {
            let to = move |column: u32| (row - block.start) * size as u32 + column - block.start;
            entries.split(row, block.start).1.iter().map(move |m| Move { entry: m.entry, to: to(m.to) })
        });
        let of_inverse = sums.clone().flat_map(|sum| &places.of(sum)[..size]).copied();
        let of_columns = (size..size + columns.len()).flat_map(|number| sums.clone().map(move |sum| places.of(sum)[number]));
        Some(Items {
            size: size as u8,
            inside: inside.collect(),
            columns: columns.iter().map(|column| column.len() as u32).collect(),
            outside: columns.iter().flatten().copied().collect(),
            places: of_inverse.chain(of_columns).collect(),
        })
    }
}

/// Data of a block in [`Small`].
struct Items {
    size: u8,
    inside: Vec<Move>,
    columns: Vec<u32>,
    outside: Vec<Move>,
    places: Vec<u32>,
}

impl Items {
    /// Those that agree in it can be adjacent.
    fn shape(&self) -> (u8, Vec<u32>, Vec<u32>, Vec<u32>) {
        let to = |moves: &[Move]| moves.iter().map(|item| item.to).collect();
        (self.size, to(&self.inside), self.columns.clone(), to(&self.outside))
    }
}

/// Small blocks, those of one shape side by side: an inversion waits for a division at each pivot,
/// and meanwhile does those of other blocks.
fn place_small(drafts: &[Draft], entries: &Entries, places: &Places, small: &mut Small) -> Vec<BlockStep> {
    let mut shapes: BTreeMap<_, Vec<Items>> = BTreeMap::new();
    for items in drafts.iter().filter_map(|draft| draft.items(entries, places)) {
        shapes.entry(items.shape()).or_default().push(items);
    }
    let mut steps = Vec::new();
    for blocks in shapes.values() {
        let (several, rest) = blocks.as_chunks::<LANES>();
        steps.extend(several.iter().map(|blocks| small.push(blocks)));
        steps.extend(rest.iter().map(|block| small.push(std::slice::from_ref(block))));
    }
    steps
}

impl Small {
    /// Appends blocks side by side.
    fn push(&mut self, blocks: &[Items]) -> BlockStep {
        let first = &blocks[0];
        self.counts.push((first.inside.len() as u32, first.columns.len() as u32));
        self.columns.extend(&first.columns);
        (0..first.inside.len()).for_each(|at| self.inside.extend(blocks.iter().map(|block| block.inside[at])));
        (0..first.outside.len()).for_each(|at| self.outside.extend(blocks.iter().map(|block| block.outside[at])));
        (0..first.places.len()).for_each(|at| self.places.extend(blocks.iter().map(|block| block.places[at])));
        BlockStep::Small { size: first.size, single: blocks.len() == 1 }
    }
}

fn place_large(
    entries: &Entries,
    places: &Places,
    block: &Range<u32>,
    (lower, upper): (&[Vec<u32>], &[Vec<u32>]),
    sums: &Range<u32>,
) -> Large {
    let (mut outside, mut ones) = (Vec::new(), Vec::new());
    let mut rows = Rows { entries: vec![], lower, upper, lower_places: vec![], upper_places: vec![], inverse_places: vec![] };
    for row in block.clone() {
        let local = row - block.start;
        let (before, inside) = entries.split(row, block.start);
        let (one, rest) = first(places.of(sums.start + local));
        let (inverse, right) = first(places.of(sums.end - 1 - local));
        let (left_of, left) = rest.split_at(before.len());
        ones.push(one);
        outside.extend(before.iter().zip(left_of).map(|(m, &to)| Move { entry: m.entry, to }));
        rows.entries.push(inside.iter().map(|m| Move { entry: m.entry, to: m.to - block.start }).collect());
        rows.lower_places.push(left.to_vec());
        rows.upper_places.push(right.to_vec());
        rows.inverse_places.push(inverse);
    }
    let products = rows.products();
    let few = products <= LISTED * rows.entries();
    let factorisation = if few { Factorisation::Levels(Elimination::new(&rows)) } else { Factorisation::Rows(RowWise::new(&rows)) };
    Large { outside: outside.into(), factorisation, products, ones: ones.into() }
}

/// The place of a sum's first term, which there always is, and those of the others.
fn first(places: &[u32]) -> (u32, &[u32]) {
    places.split_first().map_or((0, &[]), |(first, rest)| (*first, rest))
}
