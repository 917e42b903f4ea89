//! Random numbers that depend on what they are for, never on what was drawn before.
//!
//! A number is addressed by (seed, stream name, episode, step, element). The address goes through
//! Philox4x32-10 (Salmon, Moraes, Dror, Shaw: Parallel random numbers: as easy as 1, 2, 3; SC
//! 2011). So an episode is the same in any batch, on any number of threads. Uniforms are 52-bit
//! midpoints of (0, 1); normals are Wichura's AS 241 inverse of the cumulative distribution. Only
//! the basic operations and the square root are used, which IEEE 754 rounds alike everywhere: the
//! same bits on every machine.

use serde::{Deserialize, Serialize};

/// Step number of what is drawn at reset.
pub(crate) const AT_RESET: u32 = u32::MAX;

/// Key of the random numbers of one episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct EpisodeKey {
    /// The seed given to `reset`.
    pub seed: u64,
    /// Number of resets since that seed was given.
    pub episode: u64,
}

impl EpisodeKey {
    /// The first episode of a seed.
    #[must_use]
    pub fn seeded(seed: u64) -> Self {
        Self { seed, episode: 0 }
    }

    /// The episode after this one.
    #[must_use]
    pub fn next(self) -> Self {
        Self { episode: self.episode.wrapping_add(1), ..self }
    }
}

/// The numbers of one name in one episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    key: [u32; 2],
}

impl Stream {
    /// The stream `name` of an episode.
    #[must_use]
    pub fn new(key: EpisodeKey, name: &str) -> Self {
        Self::from_hash(key, hash(name))
    }

    /// The stream whose name has the hash `name_hash` (see [`hash`]).
    #[must_use]
    pub(crate) fn from_hash(key: EpisodeKey, name_hash: u64) -> Self {
        let [name_low, name_high] = halves(name_hash);
        let [episode_low, episode_high] = halves(key.episode);
        let block = philox([name_low, name_high, episode_low, episode_high], halves(key.seed));
        Self { key: [block[0], block[1]] }
    }

    /// Uniform on the open interval (0, 1).
    #[must_use]
    pub fn uniform(&self, step: u32, element: u32) -> f64 {
        let block = philox([element, step, 0, 0], self.key);
        let bits = u64::from(block[0]) | u64::from(block[1]) << 32;
        ((bits >> 12) as f64 + 0.5) * 2.0_f64.powi(-52)
    }

    /// Standard normal.
    #[must_use]
    pub(crate) fn normal(&self, step: u32, element: u32) -> f64 {
        normal_quantile(self.uniform(step, element))
    }
}

/// FNV-1a of a stream's name.
#[must_use]
pub fn hash(name: &str) -> u64 {
    name.bytes().fold(0xcbf2_9ce4_8422_2325, |h, byte| (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

fn halves(x: u64) -> [u32; 2] {
    [x as u32, (x >> 32) as u32]
}

/// Philox4x32 with ten rounds.
#[must_use]
pub(crate) fn philox(counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
    let (mut c, mut k) = (counter, key);
    for round in 0..10 {
        if round > 0 {
            k = [k[0].wrapping_add(0x9E37_79B9), k[1].wrapping_add(0xBB67_AE85)];
        }
        let a = u64::from(c[0]) * 0xD251_1F53;
        let b = u64::from(c[2]) * 0xCD9E_8D57;
        c = [(b >> 32) as u32 ^ c[1] ^ k[0], b as u32, (a >> 32) as u32 ^ c[3] ^ k[1], a as u32];
    }
    c
}

/// Value below which a standard normal lies with probability `p`, 0 < p < 1 (Wichura, Applied
/// Statistics 37 (1988) 477-484, algorithm AS 241, PPND16: relative error about 1e-16).
#[must_use]
pub(crate) fn normal_quantile(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        return q * horner(&CENTRE_UP, r) / horner(&CENTRE_DOWN, r);
    }
    let tail = if q < 0.0 { p } else { 1.0 - p };
    let r = (-ln(tail)).sqrt();
    let x = if r <= 5.0 {
        horner(&MIDDLE_UP, r - 1.6) / horner(&MIDDLE_DOWN, r - 1.6)
    } else {
        horner(&FAR_UP, r - 5.0) / horner(&FAR_DOWN, r - 5.0)
    };
    if q < 0.0 { -x } else { x }
}

/// Polynomial with the lowest coefficient first.
fn horner(coefficients: &[f64; 8], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Natural logarithm of a positive normal number from basic operations alone: the libraries of
/// different systems differ in the last bit.
fn ln(x: f64) -> f64 {
    let bits = x.to_bits();
    let mut exponent = ((bits >> 52) & 0x7ff) as i32 - 1023;
    let mut mantissa = f64::from_bits(bits & 0x000f_ffff_ffff_ffff | 0x3ff0_0000_0000_0000);
    if mantissa > std::f64::consts::SQRT_2 {
        mantissa *= 0.5;
        exponent += 1;
    }
    // ln m = 2 artanh s; s^2 < 0.0295, so that the term s^25 is beyond the last bit.
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let s2 = s * s;
    let series = (0..12).rev().fold(0.0, |sum, k| sum * s2 + 1.0 / f64::from(2 * k + 1));
    f64::from(exponent) * std::f64::consts::LN_2 + 2.0 * s * series
}

const CENTRE_UP: [f64; 8] = [
    3.387_132_872_796_366_5,
    133.141_667_891_784_38,
    1_971.590_950_306_551_3,
    13_731.693_765_509_46,
    45_921.953_931_549_87,
    67_265.770_927_008_7,
    33_430.575_583_588_13,
    2_509.080_928_730_122_7,
];
const CENTRE_DOWN: [f64; 8] = [
    1.0,
    42.313_330_701_600_91,
    687.187_007_492_057_9,
    5_394.196_021_424_751,
    21_213.794_301_586_597,
    39_307.895_800_092_71,
    28_729.085_735_721_943,
    5_226.495_278_852_854,
];
const MIDDLE_UP: [f64; 8] = [
    1.423_437_110_749_683_5,
    4.630_337_846_156_546,
    5.769_497_221_460_691,
    3.647_848_324_763_204_5,
    1.270_458_252_452_368_4,
    0.241_780_725_177_450_6,
    0.022_723_844_989_269_184,
    7.745_450_142_783_414e-4,
];
const MIDDLE_DOWN: [f64; 8] = [
    1.0,
    2.053_191_626_637_759,
    1.676_384_830_183_803_8,
    0.689_767_334_985_1,
    0.148_103_976_427_480_08,
    0.015_198_666_563_616_457,
    5.475_938_084_995_345e-4,
    1.050_750_071_644_416_9e-9,
];
const FAR_UP: [f64; 8] = [
    6.657_904_643_501_103,
    5.463_784_911_164_114,
    1.784_826_539_917_291_3,
    0.296_560_571_828_504_87,
    0.026_532_189_526_576_124,
    0.001_242_660_947_388_078_4,
    2.711_555_568_743_487_6e-5,
    2.010_334_399_292_288_1e-7,
];
const FAR_DOWN: [f64; 8] = [
    1.0,
    0.599_832_206_555_888,
    0.136_929_880_922_735_8,
    0.014_875_361_290_850_615,
    7.868_691_311_456_133e-4,
    1.846_318_317_510_054_7e-5,
    1.421_511_758_316_446e-7,
    2.044_263_103_389_939_8e-15,
];

#[cfg(test)]
mod tests {
    use super::*;

    /// `kat_vectors` of the Random123 distribution, philox4x32 with 10 rounds.
    #[test]
    fn philox_gives_the_published_known_answers() {
        assert_eq!(philox([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(philox([u32::MAX; 4], [u32::MAX; 2]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
        assert_eq!(
            philox([0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344], [0xa409_3822, 0x299f_31d0]),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }

    /// Values of the standard normal quantile: 0.975 and 1e-10 from tables, the others by symmetry.
    #[test]
    fn the_normal_quantile_agrees_with_tables() {
        let cases = [
            (0.5, 0.0),
            (0.975, 1.959_963_984_540_054),
            (0.025, -1.959_963_984_540_054),
            (0.841_344_746_068_542_9, 1.0),
            (1e-10, -6.361_340_902_404_056),
            (1e-20, -9.262_340_089_798_408),
        ];
        for (p, expected) in cases {
            assert!((normal_quantile(p) - expected).abs() < 4e-15 * (1.0 + f64::abs(expected)), "{p}: {} {expected}", normal_quantile(p));
        }
    }

    #[test]
    fn the_logarithm_is_that_of_the_library_to_the_last_bits() {
        for k in 1..2000 {
            let x = f64::from(k) * 1e-3 + 1e-17;
            assert!((ln(x) - x.ln()).abs() <= 3e-16 * (1.0 + x.ln().abs()), "{x}");
        }
    }

    #[test]
    fn moments_are_those_of_the_distributions() {
        let stream = Stream::new(EpisodeKey::seeded(7), "moments");
        let n = 100_000;
        let uniform = (0..n).map(|i| stream.uniform(3, i)).sum::<f64>() / f64::from(n);
        let (mean, square) = (0..n).map(|i| stream.normal(4, i)).fold((0.0, 0.0), |(m, s), x| (m + x, s + x * x));
        assert!((uniform - 0.5).abs() < 0.004);
        assert!((mean / f64::from(n)).abs() < 0.013 && (square / f64::from(n) - 1.0).abs() < 0.02);
    }

    #[test]
    fn each_part_of_the_address_changes_the_number() {
        let key = EpisodeKey::seeded(1);
        let base = Stream::new(key, "T").uniform(1, 0);
        let others = [
            Stream::new(EpisodeKey::seeded(2), "T").uniform(1, 0),
            Stream::new(key.next(), "T").uniform(1, 0),
            Stream::new(key, "h").uniform(1, 0),
            Stream::new(key, "T").uniform(2, 0),
            Stream::new(key, "T").uniform(1, 1),
        ];
        assert!(others.iter().all(|x| *x != base && *x > 0.0 && *x < 1.0));
    }
}
