//! Triangular substitution as a list of sums, four at a time where they look alike.
//!
//! Substitution is a set of sums, each over the right-hand side and the results of other sums. Sums
//! that do not wait for each other form a level (Anderson & Saad, *Solving sparse triangular linear
//! systems on parallel computers*, Int. J. High Speed Computing 1, 1989). Cells of a grid and rows
//! of a block give sums of the same form in the same level. Four of them make a chunk, whose
//! adjacent results are the four operands of later chunks: one load instead of four.

mod schedule;

use super::columns::{Columns, each_piece, with_fma};
use schedule::{Chunk, LANES, Schedule};
pub(super) use schedule::{Places, Source};

/// Sums in levels. The structure is fixed; the factors are set again and again.
pub(super) struct Substitution {
    chunks: Box<[Chunk]>,
    /// Places of the operands of each chunk, in the order of its turns.
    operands: Box<[u32]>,
    /// A factor for each lane of each turn.
    factors: Box<[f64]>,
    /// The right-hand side, the results of the chunks, and space for a load past the last one.
    operand: Box<[f64]>,
    /// Place of each unknown among the operands.
    results: Box<[u32]>,
    /// For many right-hand sides: where the result of each sum is, and the end of its terms.
    rows: Vec<(u32, u32)>,
    /// Places of the operand and of the factor of each term.
    terms: Vec<(u32, u32)>,
}

with_fma! {
    /// The sums for many right-hand sides.
    fn many(substitution: &Substitution, width: usize, b: &mut [f64], space: &mut [f64]) = many_portable
}

#[inline(always)]
fn many_portable(substitution: &Substitution, width: usize, b: &mut [f64], space: &mut [f64]) {
    let Substitution { rows, terms, factors, results, .. } = substitution;
    space[..b.len()].copy_from_slice(b);
    let mut begin = 0;
    for &(result, end) in rows {
        let terms = &terms[begin as usize..end as usize];
        begin = end;
        each_piece(width, &mut Sum { result: result as usize, terms, factors, width, space });
    }
    for (row, &place) in b.chunks_exact_mut(width).zip(results) {
        each_piece(width, &mut Copy { from: &space[place as usize * width..(place as usize + 1) * width], to: row });
    }
}

/// A copy of a row of a few numbers.
struct Copy<'a> {
    from: &'a [f64],
    to: &'a mut [f64],
}

impl Columns for Copy<'_> {
    #[inline(always)]
    fn piece<const B: usize>(&mut self, first: usize) {
        self.to[first..first + B].copy_from_slice(&self.from[first..first + B]);
    }
}

/// A sum for many right-hand sides.
struct Sum<'a> {
    result: usize,
    terms: &'a [(u32, u32)],
    factors: &'a [f64],
    width: usize,
    space: &'a mut [f64],
}

impl Sum<'_> {
    /// Adds a term in some columns.
    #[inline(always)]
    fn add<const B: usize>(&self, first: usize, (place, factor): (u32, u32), sum: &mut [f64; B]) {
        let (factor, from) = (self.factors[factor as usize], place as usize * self.width + first);
        // A factor of zero fills a turn up.
        if factor != 0.0 {
            let row = &self.space[from..from + B];
            sum.iter_mut().zip(row).for_each(|(sum, x)| *sum = factor.mul_add(*x, *sum));
        }
    }
}

impl Columns for Sum<'_> {
    #[inline(always)]
    fn piece<const B: usize>(&mut self, first: usize) {
        // Two sums, whose terms do not wait for each other.
        let (mut sum, mut other) = ([0.0; B], [0.0; B]);
        let (pairs, rest) = self.terms.as_chunks::<2>();
        for &[one, two] in pairs {
            self.add(first, one, &mut sum);
            self.add(first, two, &mut other);
        }
        rest.iter().for_each(|&term| self.add(first, term, &mut sum));
        sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
        let to = self.result * self.width + first;
        self.space[to..to + B].copy_from_slice(&sum);
    }
}

impl Substitution {
    /// From the terms of each sum, of which each uses earlier sums only, and the sum that each
    /// unknown is.
    pub(super) fn new(sums: &[Vec<Source>], unknowns: &[u32]) -> (Self, Places) {
        let Schedule { chunks, operands, factors, slots, end, places } = Schedule::new(sums, unknowns.len());
        let substitution = Self {
            chunks: chunks.into(),
            operands: operands.into(),
            factors: vec![0.0; factors].into(),
            operand: vec![0.0; end as usize + LANES].into(),
            results: unknowns.iter().map(|&sum| slots[sum as usize]).collect(),
            rows: Vec::new(),
            terms: Vec::new(),
        };
        (substitution, places)
    }

    /// All factors, to be written at their [`Places`].
    pub(crate) fn factors_mut(&mut self) -> &mut [f64] {
        &mut self.factors
    }

    /// Number of terms, those that fill chunks up included.
    pub(super) fn terms(&self) -> usize {
        self.factors.len()
    }

    /// Takes `factor` times a right-hand side.
    pub(super) fn load(&mut self, factor: f64, b: &[f64]) {
        self.operand[..self.results.len()].iter_mut().zip(b).for_each(|(operand, b)| *operand = factor * b);
    }

    /// Replaces a matrix of `width` right-hand sides, row after row, by the unknowns. `space` is
    /// working memory.
    pub(crate) fn run_many(&mut self, width: usize, b: &mut [f64], space: &mut Vec<f64>) {
        if self.rows.is_empty() {
            self.list_rows();
        }
        space.resize(self.operand.len() * width, 0.0);
        many(self, width, b, space);
    }

    /// Lists the sums one by one.
    fn list_rows(&mut self) {
        let (mut result, mut factor, mut place) = (self.results.len(), 0, 0);
        for chunk in &self.chunks {
            let first = self.terms.len();
            let lanes = if chunk.single != 0 { 1 } else { LANES };
            for lane in 0..lanes {
                let (mut factor, mut place) = (factor, place);
                let mut turns = |count: u32, used: usize, at: &dyn Fn(&[u32]) -> u32| {
                    for _ in 0..count {
                        self.terms.push((at(&self.operands[place..]), (factor + lane) as u32));
                        factor += lanes;
                        place += used;
                    }
                };
                turns(chunk.single, 1, &|places| places[0]);
                if chunk.single == 0 {
                    turns(chunk.gathers, LANES, &|places| places[lane]);
                    turns(chunk.broadcasts, 1, &|places| places[0]);
                    turns(chunk.runs, 1, &|places| places[0] + lane as u32);
                }
                self.rows.push((result as u32, self.terms.len() as u32));
                result += 1;
            }
            factor += self.terms.len() - first;
            let several = if chunk.single == 0 { LANES * chunk.gathers as usize } else { 0 };
            place += several + (chunk.single + if chunk.single == 0 { chunk.broadcasts + chunk.runs } else { 0 }) as usize;
        }
    }

    /// Writes the unknowns for the right-hand side taken last.
    pub(super) fn run(&mut self, x: &mut [f64]) {
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2,fma")]
            unsafe fn fused(substitution: &mut Substitution, x: &mut [f64]) {
                substitution.run_portable(x);
            }
            if is_x86_feature_detected!("fma") && is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has the features.
                return unsafe { fused(self, x) };
            }
        }
        self.run_portable(x);
    }

    /// The same without the instructions that only some processors have; same results.
    #[inline(always)]
    pub(crate) fn run_portable(&mut self, x: &mut [f64]) {
        let mut results = self.operand.as_mut_ptr();
        let operand = results;
        let mut factors = self.factors.as_ptr().cast::<[f64; LANES]>();
        let mut places = self.operands.as_ptr();
        // SAFETY: `Schedule` made turns that add up to the number of factors and places. Operands
        // were written before, or are followed by `LANES` numbers, and results follow the
        // right-hand side in the order of the chunks.
        unsafe {
            results = results.add(self.results.len());
            for chunk in &self.chunks {
                if chunk.single != 0 {
                    let mut sum = 0.0;
                    for k in 0..chunk.single as usize {
                        sum = (*factors.cast::<f64>().add(k)).mul_add(*operand.add(*places.add(k) as usize), sum);
                    }
                    *results = sum;
                    results = results.add(1);
                    factors = factors.cast::<f64>().add(chunk.single as usize).cast();
                    places = places.add(chunk.single as usize);
                    continue;
                }
                let mut sums = [0.0_f64; LANES];
                let mut turn = |values: [f64; LANES]| {
                    let factor = *factors;
                    for lane in 0..LANES {
                        sums[lane] = factor[lane].mul_add(values[lane], sums[lane]);
                    }
                    factors = factors.add(1);
                };
                for _ in 0..chunk.gathers {
                    let from = *places.cast::<[u32; LANES]>();
                    turn(from.map(|place| *operand.add(place as usize)));
                    places = places.add(LANES);
                }
                for _ in 0..chunk.broadcasts {
                    turn([*operand.add(*places as usize); LANES]);
                    places = places.add(1);
                }
                for _ in 0..chunk.runs {
                    turn(*operand.add(*places as usize).cast::<[f64; LANES]>());
                    places = places.add(1);
                }
                *results.cast::<[f64; LANES]>() = sums;
                results = results.add(LANES);
            }
            for (x, &place) in x.iter_mut().zip(&self.results) {
                *x = *operand.add(place as usize);
            }
        }
    }
}
