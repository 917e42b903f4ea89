//! The polynomial versions: branch-free, so that a loop over them becomes vector code.
//!
//! Errors are below one unit in the last place for `exp`, `ln`, `log10` and `pow`, below two for
//! `tanh`. `ln` and `pow` carry the logarithm as an unevaluated sum of two numbers (Dekker 1971),
//! about 65 bits.

use std::f64::consts::{LN_2, LOG2_E};

/// ln 2 minus its nearest double.
const LN_2_TAIL: f64 = 2.319_046_813_846_299_6e-17;
/// Adding this rounds to an integer and leaves it in the low bits.
const ROUNDER: f64 = 6_755_399_441_055_744.0;
/// 2^52, whose low bits hold an integer as they are.
const INTEGER_HOLDER: u64 = 0x4330_0000_0000_0000;
/// Bits of sqrt(1/2): mantissas are taken from there to sqrt(2).
const SQRT_HALF_BITS: u64 = 0x3FE6_A09E_667F_3BCD;
/// log10(e) and its tail.
const LOG10_E: f64 = std::f64::consts::LOG10_E;
const LOG10_E_TAIL: f64 = 1.098_319_650_216_765e-17;

/// `(exp(r) - 1 - r) / r²` for |r| <= ln(2)/2: interpolation at ten Chebyshev nodes, error of
/// `exp(r)` 1.7e-17.
#[inline(always)]
fn exp_tail(r: f64) -> f64 {
    const C: [f64; 10] = [
        0.500_000_000_000_000_1,
        0.166_666_666_666_666_69,
        0.041_666_666_666_623_99,
        0.008_333_333_333_330_051,
        0.001_388_888_891_728_179_4,
        0.000_198_412_698_631_059_68,
        2.480_152_119_021_773e-5,
        2.755_726_837_868_419_2e-6,
        2.762_013_871_973_399_4e-7,
        2.510_042_415_700_506_7e-8,
    ];
    // Estrin's scheme: short chains of dependent operations.
    let (r2, pair) = (r * r, |i: usize| r.mul_add(C[i + 1], C[i]));
    let r4 = r2 * r2;
    let low = r2.mul_add(pair(2), pair(0));
    let middle = r2.mul_add(pair(6), pair(4));
    r4.mul_add(r4.mul_add(pair(8), middle), low)
}

/// 2^n for a whole n in -1022..=1023 given as a shifted integer.
#[inline(always)]
fn power_of_two(n: i64) -> f64 {
    f64::from_bits((n.wrapping_add(1023) as u64) << 52)
}

/// `p · 2^n` in two steps, so that subnormal results round once and large ones overflow.
#[inline(always)]
fn scale(p: f64, n: i64) -> f64 {
    // A logical shift: there is no arithmetic one of 64 bits in AVX2.
    let half = ((n.wrapping_add(4096) as u64) >> 1) as i64 - 2048;
    p * power_of_two(half) * power_of_two(n.wrapping_sub(half))
}

/// Nearest whole number of x/ln 2, as a number and as an integer.
#[inline(always)]
fn halvings(x: f64) -> (f64, i64) {
    let shifted = x.mul_add(LOG2_E, ROUNDER);
    (shifted - ROUNDER, shifted.to_bits().wrapping_sub(ROUNDER.to_bits()) as i64)
}

/// The number, or the bound that it passes; NaN stays.
#[inline(always)]
fn clamp(x: f64, low: f64, high: f64) -> f64 {
    let x = if x > high { high } else { x };
    if x < low { low } else { x }
}

/// `e^(x + tail)`
#[inline(always)]
fn exp_sum(x: f64, tail: f64) -> f64 {
    let (n, shift) = halvings(x);
    let r = (-n).mul_add(LN_2, x) + (-n).mul_add(LN_2_TAIL, tail);
    scale(1.0 + (r * r).mul_add(exp_tail(r), r), shift)
}

/// Up to here `e^x` and `e^-x` are normal numbers with room to spare.
const NORMAL: f64 = 708.0;

/// Negative unless `|x| <=` [`NORMAL`]. As an integer, since a loop can gather that sign bit by
/// bit.
#[inline(always)]
pub(super) fn exp_room(x: f64) -> i64 {
    NORMAL.to_bits().wrapping_sub(x.abs().to_bits()) as i64
}

/// `e^x` where [`exp_room`] is not negative: the same bits as [`exp`] with less work.
#[inline(always)]
pub(super) fn exp_normal(x: f64) -> f64 {
    let (n, shift) = halvings(x);
    let r = (-n).mul_add(LN_2, x) + (-n) * LN_2_TAIL;
    (1.0 + (r * r).mul_add(exp_tail(r), r)) * power_of_two(shift)
}

/// `e^x`
#[inline(always)]
pub(super) fn exp(x: f64) -> f64 {
    if x.abs() <= NORMAL { exp_normal(x) } else { exp_sum(clamp(x, -760.0, 720.0), 0.0) }
}

/// `e^x` for a loop that takes either way for all.
#[inline(always)]
pub(super) fn exp_any(x: f64) -> f64 {
    exp_sum(clamp(x, -760.0, 720.0), 0.0)
}

/// `tanh x` from `e^(2|x|) - 1`, exact near 0, 1 beyond 22.
#[inline(always)]
pub(super) fn tanh(x: f64) -> f64 {
    let a = clamp(x.abs(), 0.0, 22.0) * 2.0;
    let (n, shift) = halvings(a);
    let r = (-n).mul_add(LN_2_TAIL, (-n).mul_add(LN_2, a));
    // e = e^a - 1 and its tail.
    let (two_n, w) = (power_of_two(shift), r * r * exp_tail(r));
    let m = r + w;
    let (whole, part) = (two_n - 1.0, two_n * m);
    let e = whole + part;
    let e_tail = two_n.mul_add((r - m) + w, part - (e - whole));
    // The quotient e/(e + 2), corrected by its remainder.
    let d = e + 2.0;
    let b = d - e;
    let d_tail = (e - (d - b)) + (2.0 - b) + e_tail;
    let inverse = 1.0 / d;
    let q = e * inverse;
    let remainder = (-q).mul_add(d, e) + (-q).mul_add(d_tail, e_tail);
    remainder.mul_add(inverse, q).copysign(x)
}

/// `ln x` of a positive normal number as a sum of two.
#[inline(always)]
fn ln_sum(x: f64) -> (f64, f64) {
    let bits = x.to_bits();
    let biased = bits.wrapping_sub(SQRT_HALF_BITS).wrapping_add(1024 << 52) >> 52;
    let k = f64::from_bits(biased | INTEGER_HOLDER) - (4_503_599_627_370_496.0 + 1024.0);
    let m = f64::from_bits(bits.wrapping_sub(biased.wrapping_sub(1024) << 52));
    // ln m = 2 artanh s, s = (m - 1)/(m + 1)
    let (f, t) = (m - 1.0, m + 1.0);
    let (t_tail, inverse) = (m - (t - 1.0), 1.0 / t);
    let s = f * inverse;
    let s_tail = (-s).mul_add(t_tail, (-s).mul_add(t, f)) * inverse;
    let z = s * s;
    let z_tail = s.mul_add(s, -z) + 2.0 * s * s_tail;
    let (third, third_tail) = (2.0 / 3.0, 3.700_743_415_417_188e-17);
    let a = third * z;
    let a_tail = f64::mul_add(third, z, -a) + third_tail * z + third * z_tail + z * z * artanh_tail(z);
    let q = 2.0 + a;
    let q_tail = (a - (q - 2.0)) + a_tail;
    let l = s * q;
    let l_tail = s.mul_add(q, -l) + (s * q_tail + s_tail * q);
    let p = k * LN_2;
    let p_tail = k.mul_add(LN_2, -p) + k * LN_2_TAIL;
    let sum = p + l;
    let tail = (l - (sum - p)) + (p_tail + l_tail);
    let high = sum + tail;
    (high, tail - (high - sum))
}

/// `2/5 + 2/7 z + 2/9 z² + …` for z <= 0.0295; remainder 2e-20 of the whole logarithm.
#[inline(always)]
fn artanh_tail(z: f64) -> f64 {
    const C: [f64; 11] =
        [2.0 / 5.0, 2.0 / 7.0, 2.0 / 9.0, 2.0 / 11.0, 2.0 / 13.0, 2.0 / 15.0, 2.0 / 17.0, 2.0 / 19.0, 2.0 / 21.0, 2.0 / 23.0, 2.0 / 25.0];
    let (z2, pair) = (z * z, |i: usize| z.mul_add(C[i + 1], C[i]));
    let z4 = z2 * z2;
    let low = z2.mul_add(pair(2), pair(0));
    let middle = z2.mul_add(pair(6), pair(4));
    let high = z2.mul_add(C[10], pair(8));
    z4.mul_add(z4.mul_add(high, middle), low)
}

/// Puts the values of a logarithm at 0, below, at infinity and at NaN.
#[inline(always)]
fn logarithm(x: f64, of_normal: impl Fn(f64, f64) -> f64) -> f64 {
    let subnormal = x < f64::MIN_POSITIVE;
    // 2^54 brings every subnormal number into the normal range.
    let scaled = if subnormal { x * 18_014_398_509_481_984.0 } else { x };
    let (high, tail) = ln_sum(scaled);
    let back = if subnormal { 54.0 } else { 0.0 };
    let p = back * LN_2;
    let p_tail = f64::mul_add(back, LN_2, -p) + back * LN_2_TAIL;
    let sum = high - p;
    let value = of_normal(sum, (high - (sum + p)) + (tail - p_tail));
    let value = if x == f64::INFINITY { x } else { value };
    let value = if x == 0.0 { f64::NEG_INFINITY } else { value };
    if x >= 0.0 { value } else { f64::NAN }
}

/// Natural logarithm.
#[inline(always)]
pub(super) fn ln(x: f64) -> f64 {
    logarithm(x, |high, tail| high + tail)
}

/// Decimal logarithm.
#[inline(always)]
pub(super) fn log10(x: f64) -> f64 {
    logarithm(x, |high, tail| {
        let p = high * LOG10_E;
        p + (high.mul_add(LOG10_E, -p) + (high * LOG10_E_TAIL + tail * LOG10_E))
    })
}

/// Returns `true` if [`pow_ordinary`] holds.
#[inline(always)]
#[expect(clippy::manual_range_contains, reason = "no branches: this is part of a vector loop")]
pub(super) fn is_ordinary(x: f64, y: f64) -> bool {
    (x >= f64::MIN_POSITIVE) & (x < f64::INFINITY) & (y.abs() < 1e300)
}

/// `x^y` for a positive normal x and a y that is not huge.
#[inline(always)]
pub(super) fn pow_ordinary(x: f64, y: f64) -> f64 {
    let (high, tail) = ln_sum(x);
    let p = y * high;
    let p_tail = y.mul_add(high, -p) + y * tail;
    let clamped = clamp(p, -760.0, 720.0);
    exp_sum(clamped, if clamped == p { p_tail } else { 0.0 })
}

/// `x^y`
#[inline(always)]
pub(super) fn pow(x: f64, y: f64) -> f64 {
    if is_ordinary(x, y) {
        return pow_ordinary(x, y);
    }
    if x < 0.0 && is_ordinary(-x, y) {
        let half = y * 0.5;
        return match (y.trunc() == y, half.trunc() == half) {
            (false, _) => f64::NAN,
            (true, true) => pow_ordinary(-x, y),
            (true, false) => -pow_ordinary(-x, y),
        };
    }
    libm::pow(x, y)
}

/// The nearest number of single precision.
#[inline(always)]
pub(super) fn single(x: f64) -> f64 {
    f64::from(x as f32)
}

/// -1, 0 or 1; NaN and the sign of zero stay.
#[inline(always)]
pub(super) fn sign(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        x
    }
}
