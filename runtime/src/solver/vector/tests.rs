//! Every operation against a plain loop, through SUNDIALS' own functions, for lengths around those
//! of blocks.

use sundials_sys::*;

use super::*;

const LENGTHS: [usize; 10] = [1, 3, 7, 8, 9, 31, 32, 33, 64, 427];

struct Setting {
    context: Context,
    operations: Operations,
}

/// Calls `test` with both compilations and every length.
fn for_all(test: impl Fn(&Setting, usize)) {
    let context = Context::new().expect("a context");
    for operations in [Operations::PORTABLE, Operations::detect()] {
        for length in LENGTHS {
            test(&Setting { context: context.clone(), operations }, length);
        }
    }
}

impl Setting {
    /// Numbers without a pattern, of both signs.
    fn vector(&self, length: usize, seed: f64) -> Vector {
        let mut vector = Vector::zeros(length, self.operations, &self.context);
        vector.entries_mut().iter_mut().enumerate().for_each(|(i, x)| *x = (seed + 3.7 * i as f64).sin() + 0.1);
        vector
    }
}

fn assert_near(got: &[f64], expected: impl Iterator<Item = f64>) {
    for (got, expected) in got.iter().zip(expected) {
        assert!((got - expected).abs() <= 1e-14 * (1.0 + expected.abs()), "{got} {expected}");
    }
}

fn wrms(x: &[f64], w: &[f64]) -> f64 {
    (x.iter().zip(w).map(|(x, w)| (x * w).powi(2)).sum::<f64>() / x.len() as f64).sqrt()
}

#[test]
fn sums_products_and_scales_are_those_of_plain_loops() {
    for_all(|setting, n| {
        let (x, y) = (setting.vector(n, 1.0), setting.vector(n, 2.0));
        let pairs = || x.entries().iter().zip(y.entries());
        let z = setting.vector(n, 3.0);
        for (a, b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (0.3, 1.0), (1.0, 0.3), (2.0, -0.7)] {
            // SAFETY: vectors of one family.
            unsafe { N_VLinearSum(a, x.raw(), b, y.raw(), z.raw()) };
            assert_near(z.entries(), pairs().map(|(x, y)| a * x + b * y));
        }
        // SAFETY: vectors of one family.
        unsafe { N_VProd(x.raw(), y.raw(), z.raw()) };
        assert_near(z.entries(), pairs().map(|(x, y)| x * y));
        // SAFETY: vectors of one family.
        unsafe { N_VDiv(x.raw(), y.raw(), z.raw()) };
        assert_near(z.entries(), pairs().map(|(x, y)| x / y));
        // SAFETY: vectors of one family.
        unsafe { N_VScale(-0.6, x.raw(), z.raw()) };
        assert_near(z.entries(), x.entries().iter().map(|x| -0.6 * x));
        // SAFETY: vectors of one family.
        unsafe { N_VAbs(x.raw(), z.raw()) };
        assert_near(z.entries(), x.entries().iter().map(|x| x.abs()));
        // SAFETY: vectors of one family.
        unsafe { N_VInv(x.raw(), z.raw()) };
        assert_near(z.entries(), x.entries().iter().map(|x| 1.0 / x));
        // SAFETY: vectors of one family.
        unsafe { N_VAddConst(x.raw(), 4.0, z.raw()) };
        assert_near(z.entries(), x.entries().iter().map(|x| x + 4.0));
        // SAFETY: vectors of one family.
        unsafe { N_VConst(2.5, z.raw()) };
        assert_near(z.entries(), x.entries().iter().map(|_| 2.5));
    });
}

#[test]
fn norms_and_extremes_are_those_of_plain_loops() {
    for_all(|setting, n| {
        let (x, w) = (setting.vector(n, 1.0), setting.vector(n, 2.0));
        let (x_entries, w_entries) = (x.entries(), w.entries());
        // SAFETY: vectors of one family.
        let all = unsafe {
            [
                N_VDotProd(x.raw(), w.raw()),
                N_VWrmsNorm(x.raw(), w.raw()),
                N_VWL2Norm(x.raw(), w.raw()),
                N_VL1Norm(x.raw()),
                N_VMaxNorm(x.raw()),
                N_VMin(x.raw()),
            ]
        };
        let expected = [
            x_entries.iter().zip(w_entries).map(|(x, w)| x * w).sum(),
            wrms(x_entries, w_entries),
            wrms(x_entries, w_entries) * (n as f64).sqrt(),
            x_entries.iter().map(|x| x.abs()).sum(),
            x_entries.iter().fold(0.0, |most: f64, x| most.max(x.abs())),
            x_entries.iter().fold(f64::MAX, |least: f64, x| least.min(*x)),
        ];
        for (got, expected) in all.into_iter().zip(expected) {
            assert!((got - expected).abs() <= 1e-12 * (1.0 + expected.abs()), "{got} {expected}");
        }
    });
}

#[test]
fn operations_on_several_vectors_are_those_of_plain_loops() {
    for_all(|setting, n| {
        let x: Vec<Vector> = (0..6).map(|k| setting.vector(n, f64::from(k))).collect();
        let mut raw: Vec<N_Vector> = x.iter().map(|x| x.raw()).collect();
        let mut c = [0.5, -1.0, 2.0, 0.1, 0.0, 3.0];
        let z = setting.vector(n, 9.0);
        let factors = c;
        let combined = |x: &[Vec<f64>], i: usize| factors.iter().zip(x).map(|(c, x)| c * x[i]).sum::<f64>();
        let copies: Vec<Vec<f64>> = x.iter().map(|x| x.entries().to_vec()).collect();
        // SAFETY: vectors of one family.
        assert_eq!(unsafe { N_VLinearCombination(6, c.as_mut_ptr(), raw.as_mut_ptr(), z.raw()) }, 0);
        assert_near(z.entries(), (0..n).map(|i| combined(&copies, i)));
        // As IDA moves its history on: each vector gets the one after it added, the last a vector
        // from outside.
        let outside = setting.vector(n, 11.0);
        let (mut sums, mut addends) = (vec![raw[4], raw[3], raw[2]], vec![outside.raw(), raw[4], raw[3]]);
        // SAFETY: vectors of one family.
        assert_eq!(unsafe { N_VLinearSumVectorArray(3, 1.0, sums.as_mut_ptr(), 1.0, addends.as_mut_ptr(), sums.as_mut_ptr()) }, 0);
        let mut expected = copies.clone();
        let mut running = outside.entries().to_vec();
        for sum in [4, 3, 2] {
            expected[sum].iter_mut().zip(&running).for_each(|(x, y)| *x += y);
            running.clone_from(&expected[sum]);
        }
        x.iter().zip(&expected).for_each(|(x, expected)| assert_near(x.entries(), expected.iter().copied()));
        // And without that pattern.
        let (mut sums, mut others) = (vec![raw[0], raw[1]], vec![raw[4], raw[5]]);
        // SAFETY: vectors of one family.
        assert_eq!(unsafe { N_VLinearSumVectorArray(2, 2.0, sums.as_mut_ptr(), -1.0, others.as_mut_ptr(), sums.as_mut_ptr()) }, 0);
        assert_near(x[0].entries(), (0..n).map(|i| 2.0 * expected[0][i] - expected[4][i]));
        assert_near(x[1].entries(), (0..n).map(|i| 2.0 * expected[1][i] - expected[5][i]));
        let mut factors = [2.0, -3.0];
        // SAFETY: vectors of one family.
        assert_eq!(unsafe { N_VScaleVectorArray(2, factors.as_mut_ptr(), others.as_mut_ptr(), others.as_mut_ptr()) }, 0);
        assert_near(x[4].entries(), expected[4].iter().map(|x| 2.0 * x));
        assert_near(x[5].entries(), expected[5].iter().map(|x| -3.0 * x));
    });
}

#[test]
fn fused_passes_of_newtons_method_are_those_of_plain_loops() {
    for_all(|setting, n| {
        let [delta, mut w, mut sum, y0, mut y, z0, mut z]: [Vector; 7] = std::array::from_fn(|k| setting.vector(n, k as f64));
        let before = sum.entries().to_vec();
        let norm = setting.operations.accumulate(&delta, &w, &mut sum);
        assert_near(&[norm], [wrms(delta.entries(), w.entries())].into_iter());
        assert_near(sum.entries(), before.iter().zip(delta.entries()).map(|(x, d)| x + d));
        setting.operations.correct(0.7, &sum, (&y0, &mut y), (&z0, &mut z));
        assert_near(y.entries(), y0.entries().iter().zip(sum.entries()).map(|(y, x)| y + x));
        assert_near(z.entries(), z0.entries().iter().zip(sum.entries()).map(|(z, x)| z + 0.7 * x));
        let atol = zeroed_blocks(n).iter().map(|_| Block([0.25; LANES])).collect::<Vec<_>>();
        setting.operations.error_weights(1e-3, &y, &atol, &mut w);
        assert_near(w.entries(), y.entries().iter().map(|y| 1.0 / (1e-3 * y.abs() + 0.25)));
    });
}

#[test]
fn a_norm_that_is_kept_is_that_of_the_present_numbers_and_weights() {
    for_all(|setting, n| {
        let shared: Rc<Shared> = Rc::default();
        let sharing = |seed: f64| {
            let mut vector = Vector::sharing(n, setting.operations, &setting.context, &shared);
            vector.entries_mut().iter_mut().enumerate().for_each(|(i, x)| *x = (seed + 1.3 * i as f64).cos());
            vector
        };
        let (x, y, delta, mut z, mut w) = (sharing(1.0), sharing(2.0), sharing(3.0), sharing(4.0), sharing(5.0));
        let check = |z: &Vector, w: &Vector| {
            // SAFETY: vectors of one family.
            assert_near(&[unsafe { N_VWrmsNorm(z.raw(), w.raw()) }], [wrms(z.entries(), w.entries())].into_iter());
        };
        // SAFETY: the weights live until the end of the test, and are as long as the rest.
        unsafe { shared.renew(&w) };
        // SAFETY: vectors of one family.
        unsafe { N_VLinearSum(1.0, x.raw(), -1.0, y.raw(), z.raw()) };
        assert!(z.known_norm(w.address()).is_some());
        check(&z, &w);
        // In place, by Newton's method, and with the numbers changed afterwards.
        // SAFETY: vectors of one family.
        unsafe { N_VLinearSum(1.0, x.raw(), 1.0, z.raw(), z.raw()) };
        check(&z, &w);
        setting.operations.accumulate(&delta, &w, &mut z);
        assert!(z.known_norm(w.address()).is_some());
        check(&z, &w);
        z.entries_mut()[0] += 1.0;
        assert!(z.known_norm(w.address()).is_none());
        check(&z, &w);
        // Other weights, and the same vector of weights set anew.
        // SAFETY: vectors of one family.
        unsafe { N_VLinearSum(1.0, x.raw(), 1.0, y.raw(), z.raw()) };
        check(&z, &x);
        w.entries_mut()[0] *= 3.0;
        // SAFETY: the weights live until the end of the test, and are as long as the rest.
        unsafe { shared.renew(&w) };
        check(&z, &w);
    });
}

#[test]
fn sums_with_the_corrections_are_left_out_where_nobody_reads_them() {
    for_all(|setting, n| {
        let shared: Rc<Shared> = Rc::default();
        let sharing = || Vector::sharing(n, setting.operations, &setting.context, &shared);
        let (mut x, corrections, mut y) = (sharing(), sharing(), sharing());
        x.entries_mut().fill(2.0);
        shared.set_corrections(&corrections);
        y.set_discards(true);
        // SAFETY: vectors of one family.
        unsafe { N_VLinearSum(1.0, x.raw(), 1.0, corrections.raw(), y.raw()) };
        assert_eq!(y.entries(), vec![0.0; n]);
        // SAFETY: vectors of one family.
        unsafe { N_VLinearSum(1.0, x.raw(), 1.0, x.raw(), y.raw()) };
        assert_eq!(y.entries(), vec![4.0; n]);
        y.set_discards(false);
        // SAFETY: vectors of one family.
        unsafe { N_VLinearSum(1.0, x.raw(), 1.0, corrections.raw(), y.raw()) };
        assert_eq!(y.entries(), vec![2.0; n]);
    });
}
