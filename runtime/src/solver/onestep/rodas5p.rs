//! Coefficients of Rodas5P, a stiffly accurate, L-stable Rosenbrock method of order 5 for systems
//! of index 1, with embedded method and dense output of order 4.
//!
//! G. Steinebach, Construction of Rosenbrock–Wanner method Rodas5P and numerical benchmarks within
//! the Julia Differential Equations package, *BIT Numer. Math.* 63 (2023) 27. The form needs no
//! product with the Jacobian (Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd
//! edition (Springer, 1996), section IV.7). The stages U solve (M/(hγ) − J) Uᵢ = f(t + cᵢ h, y + Σ
//! aᵢⱼ Uⱼ) + M Σ Cᵢⱼ Uⱼ / h + h dᵢ ∂f/∂t.
//!
//! Stage 7 begins at that of stage 6 plus U₆, stage 8 at that plus U₇, the step ends at that plus
//! U₈, which is the estimate of the error.

/// The diagonal coefficient.
pub(crate) const GAMMA: f64 = 0.211_937_563_194_290_14;

/// Nodes cᵢ.
pub(crate) const NODES: [f64; 8] =
    [0.0, 0.635_812_689_582_870_4, 0.409_579_839_339_753_5, 0.976_930_672_506_071_6, 0.428_840_360_955_866_4, 1.0, 1.0, 1.0];

/// Coefficients dᵢ of the derivative by time; zero for the last three stages.
pub(crate) const SLOPES: [f64; 5] =
    [0.211_937_563_194_290_14, -0.423_875_126_388_580_27, -0.338_462_712_623_592_4, 1.804_645_287_288_273_4, 2.325_825_639_765_069];

/// Coefficients aᵢⱼ of stage 2.
pub(crate) const A2: [f64; 1] = [3.0];

/// Coefficients aᵢⱼ of stage 3.
pub(crate) const A3: [f64; 2] = [2.849_394_379_747_939, 0.458_422_422_044_639_23];

/// Coefficients aᵢⱼ of stage 4.
pub(crate) const A4: [f64; 3] = [-6.954_028_509_809_101, 2.489_845_061_869_568, -10.358_996_098_473_584];

/// Coefficients aᵢⱼ of stage 5.
pub(crate) const A5: [f64; 4] = [2.802_998_627_562_896_4, 0.507_246_473_622_820_6, -0.398_831_254_177_052_4, -0.047_211_872_304_046_41];

/// Coefficients aᵢⱼ of stage 6.
pub(crate) const A6: [f64; 5] =
    [-7.502_846_399_306_121, 2.561_846_144_803_919, -11.627_539_656_261_098, -0.182_687_676_599_422_56, 0.030_198_172_008_377_946];

/// Coefficients Cᵢⱼ of stage 2.
pub(crate) const C2: [f64; 1] = [-14.155_112_264_123_755];

/// Coefficients Cᵢⱼ of stage 3.
pub(crate) const C3: [f64; 2] = [-17.972_960_358_859_52, -2.859_693_295_451_294];

/// Coefficients Cᵢⱼ of stage 4.
pub(crate) const C4: [f64; 3] = [147.121_502_757_117_16, -1.412_214_027_182_13, 71.689_402_513_023_58];

/// Coefficients Cᵢⱼ of stage 5.
pub(crate) const C5: [f64; 4] = [165.435_170_248_716_76, -0.459_282_345_649_112_6, 42.909_383_369_586_03, -5.961_986_721_573_306];

/// Coefficients Cᵢⱼ of stage 6.
pub(crate) const C6: [f64; 5] =
    [24.854_864_614_690_072, -3.000_922_700_283_218_6, 47.493_111_002_076_8, 5.581_419_782_155_812_5, -0.661_069_182_524_947_1];

/// Coefficients Cᵢⱼ of stage 7.
pub(crate) const C7: [f64; 6] = [
    30.912_732_140_285_99,
    -3.120_824_334_993_797_4,
    77.799_546_460_708_92,
    34.286_460_282_947_83,
    -19.097_331_116_725_623,
    -28.087_943_162_872_662,
];

/// Coefficients Cᵢⱼ of stage 8.
pub(crate) const C8: [f64; 7] = [
    37.802_771_233_905_63,
    -3.257_196_902_907_227_6,
    112.269_188_494_963_27,
    66.934_723_124_404_7,
    -40.066_189_370_910_02,
    -54.667_802_628_779_68,
    -9.488_616_523_096_27,
];

/// The dense output: with Kᵢ = Σ Hᵢⱼ Uⱼ it is (1 − θ) y₀ + θ (y₁ + (1 − θ) (K₁ + θ (K₂ + θ K₃))) at
/// the share θ of the step.
pub(crate) const H: [[f64; 8]; 3] = [
    [
        25.948_786_856_663_858,
        -2.557_972_484_584_623_5,
        10.433_815_404_888_879,
        -2.367_925_102_268_520_4,
        0.524_948_541_321_073,
        1.124_108_831_045_040_4,
        0.427_287_619_443_187_4,
        -0.172_022_210_701_554_93,
    ],
    [
        -9.915_688_506_951_71,
        -0.968_994_459_411_515_4,
        3.043_803_724_297_845_3,
        -24.495_224_566_215_796,
        20.176_138_334_709_044,
        15.980_663_614_246_51,
        -6.789_040_303_419_874,
        -6.710_236_069_923_372,
    ],
    [
        11.419_903_575_922_262,
        2.887_964_514_613_699_4,
        72.921_379_959_960_29,
        80.125_118_346_226_43,
        -52.072_871_366_152_654,
        -59.789_936_252_667_29,
        -0.155_826_842_827_519_13,
        4.883_087_185_713_722,
    ],
];
