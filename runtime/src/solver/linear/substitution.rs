//! Triangular substitution as a list of sums, four at a time.
//!
//! Substitution is a set of sums, each over the right-hand side and the results of other sums. Sums that do not wait for each
//! other form a level (Anderson & Saad, *Solving sparse triangular linear systems on parallel computers*, Int. J. High Speed
//! Computing 1, 1989); four of a level make a chunk, whose results stand side by side. Walking along a
//! chain of cells row by row, a processor waits for the last sum at every row; here it works on several of them. Where a level
//! has hardly any sums, as in a block that is nearly full, the terms of one sum are spread over the four lanes instead.

/// Sums in a chunk, or terms of a spread sum that are added at a time.
const LANES: usize = 4;

/// Sums of a level that are worth a chunk.
const FEW: usize = 2;

/// Terms of a sum that are worth being spread.
const LONG: usize = 4;

/// Four lanes that take terms together.
#[derive(Clone, Copy)]
struct Chunk {
    /// Number of times that all lanes take a term.
    length: u32,
    /// Whether the lanes belong to one sum.
    spread: bool,
}

/// What a term of a sum is multiplied with.
#[derive(Clone, Copy)]
pub(super) enum Source {
    /// This row of the right-hand side.
    Right(u32),
    /// The result of this sum.
    Sum(u32),
}

/// Sums in levels. The structure is fixed; the factors are set again and again.
pub(super) struct Substitution {
    chunks: Box<[Chunk]>,
    /// For each turn of each chunk, where its four operands stand.
    operands: Box<[[u32; LANES]]>,
    factors: Box<[[f64; LANES]]>,
    /// The right-hand side, the chunks' results, and a zero.
    operand: Box<[f64]>,
    /// Where each unknown stands among the operands.
    results: Box<[u32]>,
}

/// Where the factors of sums stand.
pub(super) struct Places(Vec<Vec<u32>>);

impl Places {
    /// Places of the terms of a sum, in their order.
    pub fn of(&self, sum: u32) -> &[u32] {
        &self.0[sum as usize]
    }
}

impl Substitution {
    /// From the terms of each sum, of which each uses earlier sums only, and the sum that each unknown is.
    pub fn new(sums: &[Vec<Source>], unknowns: &[u32]) -> (Self, Places) {
        let n = unknowns.len();
        let mut level = vec![0_u32; sums.len()];
        for (sum, terms) in sums.iter().enumerate() {
            let waits =
                terms.iter().filter_map(|term| if let Source::Sum(before) = term { Some(level[*before as usize] + 1) } else { None });
            level[sum] = waits.max().unwrap_or(0);
        }
        let mut order: Vec<usize> = (0..sums.len()).collect();
        order.sort_by_key(|&sum| (level[sum], sums[sum].len()));
        let mut slots = vec![0_u32; sums.len()];
        let mut chunks = Vec::new();
        let mut members: Vec<&[usize]> = Vec::new();
        for one_level in order.chunk_by(|&a, &b| level[a] == level[b]) {
            let spread = one_level.len() <= FEW && one_level.iter().any(|&sum| sums[sum].len() >= LONG);
            for chunk in one_level.chunks(if spread { 1 } else { LANES }) {
                for (lane, &sum) in chunk.iter().enumerate() {
                    slots[sum] = (n + chunks.len() * LANES + lane) as u32;
                }
                let longest = chunk.iter().map(|&sum| sums[sum].len()).max().unwrap_or(0);
                let length = if spread { longest.div_ceil(LANES) } else { longest } as u32;
                chunks.push(Chunk { length, spread });
                members.push(chunk);
            }
        }
        let zero = (n + chunks.len() * LANES) as u32;
        let total = chunks.iter().map(|chunk| chunk.length as usize).sum();
        let mut operands = vec![[zero; LANES]; total];
        let mut places: Vec<Vec<u32>> = sums.iter().map(|terms| vec![0; terms.len()]).collect();
        let mut start = 0;
        for (members, chunk) in members.iter().zip(&chunks) {
            for (lane, &sum) in members.iter().enumerate() {
                // What was computed last is needed last.
                let mut terms: Vec<usize> = (0..sums[sum].len()).collect();
                let age = |&term: &usize| if let Source::Sum(before) = sums[sum][term] { level[before as usize] + 1 } else { 0 };
                terms.sort_by_key(age);
                for (number, term) in terms.into_iter().enumerate() {
                    let (turn, lane) = if chunk.spread { (number / LANES, number % LANES) } else { (number, lane) };
                    operands[start + turn][lane] = match sums[sum][term] {
                        Source::Right(row) => row,
                        Source::Sum(before) => slots[before as usize],
                    };
                    places[sum][term] = ((start + turn) * LANES + lane) as u32;
                }
            }
            start += chunk.length as usize;
        }
        let substitution = Self {
            chunks: chunks.into(),
            factors: vec![[0.0; LANES]; total].into(),
            operands: operands.into(),
            operand: vec![0.0; zero as usize + 1].into(),
            results: unknowns.iter().map(|&sum| slots[sum as usize]).collect(),
        };
        (substitution, Places(places))
    }

    /// All factors, to be written at their [`Places`].
    pub fn factors_mut(&mut self) -> &mut [f64] {
        self.factors.as_flattened_mut()
    }

    /// Number of terms, those that fill chunks up included.
    #[cfg(test)]
    pub fn terms(&self) -> usize {
        self.factors.len() * LANES
    }

    /// Takes `factor` times a right-hand side.
    pub fn load(&mut self, factor: f64, b: &[f64]) {
        self.operand[..self.results.len()].iter_mut().zip(b).for_each(|(operand, b)| *operand = factor * b);
    }

    /// Writes the unknowns for the right-hand side taken last.
    pub fn run(&mut self, x: &mut [f64]) {
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
    pub fn run_portable(&mut self, x: &mut [f64]) {
        let operand = &mut self.operand[..];
        let mut slot = self.results.len();
        let mut start = 0;
        for chunk in &self.chunks {
            let end = start + chunk.length as usize;
            let mut sums = [0.0_f64; LANES];
            // SAFETY: `new` made lengths that add up to the number of terms, operands below the length of `operand`, and
            // `LANES` results a chunk after the right-hand side.
            unsafe {
                for (factors, places) in self.factors.get_unchecked(start..end).iter().zip(self.operands.get_unchecked(start..end)) {
                    for lane in 0..LANES {
                        sums[lane] = factors[lane].mul_add(*operand.get_unchecked(places[lane] as usize), sums[lane]);
                    }
                }
                if chunk.spread {
                    sums = [(sums[0] + sums[2]) + (sums[1] + sums[3]), 0.0, 0.0, 0.0];
                }
                operand.get_unchecked_mut(slot..slot + LANES).copy_from_slice(&sums);
            }
            start = end;
            slot += LANES;
        }
        for (x, &place) in x.iter_mut().zip(&self.results) {
            // SAFETY: as above.
            *x = unsafe { *operand.get_unchecked(place as usize) };
        }
    }
}
