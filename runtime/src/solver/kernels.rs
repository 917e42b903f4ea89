//! Loops over vectors, written once and compiled for several processors.
//!
//! Data live in [`Block`]s of eight numbers on separate cache lines; the last block is filled up
//! with zeros, so that no loop has a tail. Each loop is `#[inline(always)]` and takes on the
//! instruction set of the function that calls it. Every product that is summed goes through
//! [`f64::mul_add`], which rounds once with or without hardware support. Every sum runs over the
//! same 32 partial sums in the same order: the results are the same bits on every processor.
//!
//! Operands may be the same vector as the result: a block is read whole before it is written.

use std::array::from_fn;

/// Numbers in a [`Block`].
pub(crate) const LANES: usize = 8;

/// Independent blocks of partial sums in a reduction; hides the latency of the additions.
const ACCUMULATORS: usize = 4;

/// Eight neighbouring entries of a vector.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Block(pub [f64; LANES]);

impl Block {
    /// Eight zeros.
    pub(super) const ZERO: Self = Self([0.0; LANES]);

    #[inline(always)]
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self(from_fn(|lane| f(self.0[lane])))
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self(from_fn(|lane| f(self.0[lane], other.0[lane])))
    }

    /// `factor * self + addend`, rounded once.
    #[inline(always)]
    fn scaled_plus(self, factor: f64, addend: Self) -> Self {
        self.zip(addend, |x, y| factor.mul_add(x, y))
    }

    /// The squares added to `addend`, rounded once.
    #[inline(always)]
    fn squared_plus(self, addend: Self) -> Self {
        self.zip(addend, |x, y| x.mul_add(x, y))
    }

    /// Sum of the eight entries in a fixed order.
    #[inline(always)]
    fn sum(self) -> f64 {
        let l = self.0;
        ((l[0] + l[4]) + (l[2] + l[6])) + ((l[1] + l[5]) + (l[3] + l[7]))
    }
}

/// `z = f(x)` entry by entry.
///
/// # Safety
/// `x` and `z` point to `blocks` blocks each.
#[inline(always)]
pub(crate) unsafe fn map(blocks: usize, x: *const Block, z: *mut Block, f: impl Fn(f64) -> f64) {
    for i in 0..blocks {
        // SAFETY: `i` is below `blocks`, for which the caller vouches.
        unsafe { z.add(i).write(x.add(i).read().map(&f)) };
    }
}

/// `z = f(x, y)` entry by entry.
///
/// # Safety
/// `x`, `y` and `z` point to `blocks` blocks each.
#[inline(always)]
pub(crate) unsafe fn zip(blocks: usize, x: *const Block, y: *const Block, z: *mut Block, f: impl Fn(f64, f64) -> f64) {
    for i in 0..blocks {
        // SAFETY: as in `map`.
        unsafe { z.add(i).write(x.add(i).read().zip(y.add(i).read(), &f)) };
    }
}

/// `z = a x + b y`.
///
/// # Safety
/// `x`, `y` and `z` point to `blocks` blocks each.
#[inline(always)]
pub(crate) unsafe fn linear_sum(blocks: usize, (a, x): (f64, *const Block), (b, y): (f64, *const Block), z: *mut Block) {
    // A factor of one (IDA's usual case) is exact either way round: the other product is the one to
    // fuse.
    let ((a, x), (b, y)) = if b.abs() == 1.0 { ((b, y), (a, x)) } else { ((a, x), (b, y)) };
    // SAFETY: the caller vouches for what `zip` asks.
    unsafe { zip(blocks, x, y, z, |x, y| b.mul_add(y, a * x)) };
}

/// The same for factors of one or minus one; returns the sum of `(z w)^2`.
///
/// # Safety
/// As for [`linear_sum`]; `w` points to `blocks` blocks too, other than `z`.
#[inline(always)]
pub(crate) unsafe fn linear_sum_and_norm(
    blocks: usize,
    (a, x): (f64, *const Block),
    (b, y): (f64, *const Block),
    z: *mut Block,
    w: *const Block,
) -> f64 {
    // SAFETY: `reduce_blocks` gives numbers below `blocks` only.
    reduce_blocks(blocks, |i, partial| unsafe {
        let sum = y.add(i).read().scaled_plus(b, x.add(i).read().map(|x| a * x));
        z.add(i).write(sum);
        sum.zip(w.add(i).read(), |z, w| z * w).squared_plus(partial)
    })
}

/// `z = sum over k of c[k] x[k]`, in the order of `k`.
///
/// # Safety
/// `z` and each of `x` point to `blocks` blocks; `c` and `x` have the same length, at least one.
#[inline(always)]
pub(crate) unsafe fn linear_combination(blocks: usize, c: &[f64], x: &[*const Block], z: *mut Block) {
    // Several blocks at a time, for each of which a factor is fetched once.
    let whole = blocks - blocks % ACCUMULATORS;
    let mut first = 0;
    while first < whole {
        let mut sums = [Block::ZERO; ACCUMULATORS];
        for (&c, &x) in c.iter().zip(x) {
            for (k, sum) in sums.iter_mut().enumerate() {
                // SAFETY: `first + k` is below `whole`, and so below `blocks`.
                *sum = unsafe { x.add(first + k).read() }.scaled_plus(c, *sum);
            }
        }
        for (k, sum) in sums.into_iter().enumerate() {
            // SAFETY: as above.
            unsafe { z.add(first + k).write(sum) };
        }
        first += ACCUMULATORS;
    }
    for i in whole..blocks {
        let mut sum = Block::ZERO;
        for (&c, &x) in c.iter().zip(x) {
            // SAFETY: `i` is below `blocks`.
            sum = unsafe { x.add(i).read() }.scaled_plus(c, sum);
        }
        // SAFETY: as above.
        unsafe { z.add(i).write(sum) };
    }
}

/// Sum over all entries of `term(x, y, partial)`, which adds the entry's term to a partial sum.
///
/// # Safety
/// `x` and `y` point to `blocks` blocks each.
#[inline(always)]
pub(crate) unsafe fn reduce(blocks: usize, x: *const Block, y: *const Block, term: impl Fn(f64, f64, f64) -> f64) -> f64 {
    reduce_blocks(blocks, |i, sum| {
        // SAFETY: `reduce_blocks` gives numbers below `blocks` only.
        let (x, y) = unsafe { (x.add(i).read(), y.add(i).read()) };
        Block(from_fn(|lane| term(x.0[lane], y.0[lane], sum.0[lane])))
    })
}

/// Sum over all blocks of what `add(block, partial)` adds to a partial sum.
#[inline(always)]
fn reduce_blocks(blocks: usize, mut add: impl FnMut(usize, Block) -> Block) -> f64 {
    if blocks == 1 {
        return add(0, Block::ZERO).sum(); // the other partial sums would be zero
    }
    let mut sums = [Block::ZERO; ACCUMULATORS];
    let whole = blocks - blocks % ACCUMULATORS;
    let mut first = 0;
    while first < whole {
        for (k, sum) in sums.iter_mut().enumerate() {
            *sum = add(first + k, *sum);
        }
        first += ACCUMULATORS;
    }
    for (k, sum) in sums.iter_mut().enumerate() {
        if whole + k < blocks {
            *sum = add(whole + k, *sum);
        }
    }
    total_of(sums)
}

/// Sum of partial sums, in a fixed order.
#[inline(always)]
fn total_of(sums: [Block; ACCUMULATORS]) -> f64 {
    let plus = |x: f64, y: f64| x + y;
    sums[0].zip(sums[2], plus).zip(sums[1].zip(sums[3], plus), plus).sum()
}

/// Sum of `(x w)^2`.
///
/// # Safety
/// `x` and `w` point to `blocks` blocks each.
#[inline(always)]
pub(crate) unsafe fn weighted_square_sum(blocks: usize, x: *const Block, w: *const Block) -> f64 {
    // SAFETY: the caller vouches for `x` and `w`.
    unsafe {
        reduce(blocks, x, w, |x, w, sum| {
            let product = x * w;
            product.mul_add(product, sum)
        })
    }
}

/// `sum += delta`; returns the sums of `(delta w)^2` and of `(sum w)^2`.
///
/// # Safety
/// `delta`, `w` and `sum` point to `blocks` blocks each, `sum` to others than the rest.
#[inline(always)]
pub(crate) unsafe fn accumulate(blocks: usize, delta: *const Block, w: *const Block, sum: *mut Block) -> (f64, f64) {
    let mut totals = [Block::ZERO; ACCUMULATORS];
    // SAFETY: `reduce_blocks` gives numbers below `blocks` only, and `sum` is not one of the
    // others.
    let square = reduce_blocks(blocks, |i, partial| unsafe {
        let (delta, w) = (delta.add(i).read(), w.add(i).read());
        let total = sum.add(i).read().zip(delta, |x, d| x + d);
        sum.add(i).write(total);
        let of_totals = &mut totals[i % ACCUMULATORS];
        *of_totals = total.zip(w, |x, w| x * w).squared_plus(*of_totals);
        delta.zip(w, |d, w| d * w).squared_plus(partial)
    });
    (square, total_of(totals))
}

/// `y = y0 + x` and `z = z0 + c x`.
///
/// # Safety
/// All point to `blocks` blocks, `y` and `z` to others than the rest.
#[inline(always)]
pub(crate) unsafe fn correct(
    blocks: usize,
    c: f64,
    x: *const Block,
    (y0, y): (*const Block, *mut Block),
    (z0, z): (*const Block, *mut Block),
) {
    for i in 0..blocks {
        // SAFETY: `i` is below `blocks`.
        unsafe {
            let x = x.add(i).read();
            y.add(i).write(x.zip(y0.add(i).read(), |x, y0| y0 + x));
            z.add(i).write(x.scaled_plus(c, z0.add(i).read()));
        }
    }
}

/// `x[0] += first`, then `x[1] += x[0]`, `x[2] += x[1]` and so on, in one pass.
///
/// # Safety
/// `first` and each of `x` point to `blocks` blocks, all different.
#[inline(always)]
pub(crate) unsafe fn cumulate(blocks: usize, first: *const Block, x: &[*mut Block]) {
    for i in 0..blocks {
        // SAFETY: `i` is below `blocks`.
        let mut sum = unsafe { first.add(i).read() };
        for &x in x {
            // SAFETY: as above; the pointers are different, so that nothing is read that was to be
            // written.
            sum = sum.zip(unsafe { x.add(i).read() }, |sum, x| x + sum);
            // SAFETY: as above.
            unsafe { x.add(i).write(sum) };
        }
    }
}

/// Returns `true` if all entries are finite.
///
/// # Safety
/// `x` points to `blocks` blocks.
#[inline(always)]
pub(crate) unsafe fn all_finite(blocks: usize, x: *const Block) -> bool {
    // 0 * x is zero for finite x and NaN otherwise.
    // SAFETY: the caller vouches for `x`.
    unsafe { reduce(blocks, x, x, |x, _, sum| x.mul_add(0.0, sum)) == 0.0 }
}

/// Error weights `w = 1 / (rtol |y| + atol)`.
///
/// # Safety
/// `y`, `atol` and `w` point to `blocks` blocks each.
#[inline(always)]
pub(crate) unsafe fn error_weights(blocks: usize, rtol: f64, y: *const Block, atol: *const Block, w: *mut Block) {
    // SAFETY: the caller vouches for all three.
    unsafe { zip(blocks, y, atol, w, |y, atol| 1.0 / rtol.mul_add(y.abs(), atol)) };
}
