//! Vectors of unknowns for methods that combine many stages: whole fours of numbers, so that no
//! loop has a tail.
//!
//! Products are rounded before they are summed (no fused multiply-add): every processor gives the
//! same bits.

/// Numbers in a [`Quad`].
const LANES: usize = 4;

/// Four neighbouring entries.
pub(super) type Quad = [f64; LANES];

/// A vector, its last four filled up with zeros.
pub(super) type Quads = Box<[Quad]>;

/// Unknowns from which on wider instructions gain more than it costs to ask for them.
pub(crate) const LONG: usize = 8;

/// Defines a function of a number of unknowns and some arguments that runs another one. With many
/// unknowns it is compiled for AVX2 if the processor has it. Products are rounded before they are
/// summed: same results.
macro_rules! widened {
    (fn $name:ident($($argument:ident: $type:ty),*) $(-> $result:ty)? = $portable:path) => {
        fn $name(unknowns: usize, $($argument: $type),*) $(-> $result)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                unsafe fn wide($($argument: $type),*) $(-> $result)? {
                    $portable($($argument),*)
                }
                if unknowns >= super::numbers::LONG && is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has the feature.
                    return unsafe { wide($($argument),*) };
                }
            }
            $portable($($argument),*)
        }
    };
}
pub(crate) use widened;

/// Zeros for so many entries.
pub(super) fn zeros(length: usize) -> Quads {
    filled(length, 0.0)
}

/// Entries of one value, filled up with the same.
pub(super) fn filled(length: usize, value: f64) -> Quads {
    vec![[value; LANES]; length.div_ceil(LANES)].into()
}

/// A vector with these entries, filled up with `rest`.
pub(super) fn from(entries: impl IntoIterator<Item = f64>, length: usize, rest: f64) -> Quads {
    let mut quads = filled(length, rest);
    quads.as_flattened_mut().iter_mut().zip(entries).for_each(|(to, from)| *to = from);
    quads
}

/// The entries themselves.
#[inline(always)]
pub(super) fn entries(quads: &[Quad], length: usize) -> &[f64] {
    &quads.as_flattened()[..length]
}

/// The entries themselves.
#[inline(always)]
pub(crate) fn entries_mut(quads: &mut [Quad], length: usize) -> &mut [f64] {
    &mut quads.as_flattened_mut()[..length]
}

/// `f(i, lane)` for all entries of all fours.
#[inline(always)]
pub(super) fn set(out: &mut [Quad], mut f: impl FnMut(usize, usize) -> f64) {
    for (i, out) in out.iter_mut().enumerate() {
        for (lane, out) in out.iter_mut().enumerate() {
            *out = f(i, lane);
        }
    }
}

/// Bounds of `(1 - x) first + x last + x (1 - x) inner` for x from 0 to 1, where `inner` gives
/// bounds of what is multiplied there.
#[inline(always)]
pub(super) fn bound_bow((first, last): (&Quad, &Quad), (least, most): (&mut Quad, &mut Quad), mut inner: impl FnMut(usize) -> (f64, f64)) {
    for lane in 0..LANES {
        let (low, high) = inner(lane);
        least[lane] = first[lane].min(last[lane]) + 0.25 * low.min(0.0);
        most[lane] = first[lane].max(last[lane]) + 0.25 * high.max(0.0);
    }
}

/// `out = base + factor * sum over j of factors[j] terms[j]`.
#[inline(always)]
pub(super) fn combine<const N: usize>(out: &mut [Quad], base: &[Quad], factor: f64, factors: &[f64; N], terms: [&Quads; N]) {
    let n = out.len();
    let (base, terms) = (&base[..n], parts(&terms, n));
    for (i, (out, base)) in out.iter_mut().zip(base).enumerate() {
        let mut total = *base;
        add_multiple(&mut total, factor, &weighted(i, factors, &terms));
        *out = total;
    }
}

/// The same for the unknowns at a stage, where the equations have just written the last term. Only
/// a product and a sum wait for it; an additional rounding is harmless there.
#[inline(always)]
pub(super) fn place_stage<const N: usize>(out: &mut [Quad], base: &[Quad], factor: f64, factors: &[f64; N], terms: [&Quads; N]) {
    let n = out.len();
    let (base, terms) = (&base[..n], parts(&terms, n));
    for (i, (out, base)) in out.iter_mut().zip(base).enumerate() {
        let mut sum = [0.0; LANES];
        for (factor, term) in factors.iter().zip(&terms).take(N - 1) {
            add_multiple(&mut sum, *factor, &term[i]);
        }
        let mut total = *base;
        add_multiple(&mut total, factor, &sum);
        let last = if LANES * n <= LONG { fresh(&terms[N - 1][i]) } else { terms[N - 1][i] };
        add_multiple(&mut total, factor * factors[N - 1], &last);
        *out = total;
    }
}

/// Reads numbers one by one that were written one by one a moment ago. A wide read waits until all
/// of them have left the processor's store buffer.
#[inline(always)]
fn fresh(quad: &Quad) -> Quad {
    let mut numbers = [0.0; LANES];
    for (number, from) in numbers.iter_mut().zip(quad) {
        // SAFETY: a reference to a number is valid for reads.
        *number = unsafe { std::ptr::read_volatile(from) };
    }
    numbers
}

/// `sum += factor * term`.
#[inline(always)]
fn add_multiple(sum: &mut Quad, factor: f64, term: &Quad) {
    sum.iter_mut().zip(term).for_each(|(sum, term)| *sum += factor * term);
}

/// So many fours of each term. (`map` of an array is a call, which takes longer than a short sum.)
#[inline(always)]
pub(super) fn parts<'a, const N: usize>(terms: &[&'a Quads; N], n: usize) -> [&'a [Quad]; N] {
    let mut parts: [&[Quad]; N] = [&[]; N];
    for (part, term) in parts.iter_mut().zip(terms) {
        *part = &term[..n];
    }
    parts
}

/// `sum over j of factors[j] terms[j]` in the four `i`.
#[inline(always)]
pub(super) fn weighted<const N: usize>(i: usize, factors: &[f64; N], terms: &[&[Quad]; N]) -> Quad {
    let mut sum = [0.0; LANES];
    for (factor, term) in factors.iter().zip(terms) {
        add_multiple(&mut sum, *factor, &term[i]);
    }
    sum
}

/// Sum over all entries of `f(i, lane)`, in a fixed order.
#[inline(always)]
pub(super) fn sum(n: usize, mut f: impl FnMut(usize, usize) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    for i in 0..n {
        for (lane, sum) in sums.iter_mut().enumerate() {
            *sum += f(i, lane);
        }
    }
    (sums[0] + sums[2]) + (sums[1] + sums[3])
}
