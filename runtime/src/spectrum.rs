//! Eigenvalues of linearised processes.
//!
//! The matrices of flowsheets are sparse, badly scaled and mostly cascades: what happens downstream
//! does not act upstream. Four measures make the QR iteration safe and quick for them:
//!
//! * the strongly connected parts of the pattern (Tarjan, SIAM J. Comput. 1 (1972) 146-160) are the
//!   diagonal blocks of a block triangular form, which has the same eigenvalues. A reactor of 1700
//!   cells in a row has blocks of a few species;
//! * each block is scaled so that states that act on each other do so about equally. A bed in which
//!   convection outweighs dispersion is similar to a symmetric matrix by factors that grow from
//!   cell to cell, without which rounding moves its eigenvalues by percents;
//! * each block is balanced by powers of two (Parlett and Reinsch, Numer. Math. 13 (1969) 293-304);
//! * a block with more than [`DENSE`] states is treated by Arnoldi's method on its inverse (Saad,
//!   Numerical Methods for Large Eigenvalue Problems, chapter 6). It finds only the eigenvalues
//!   nearest to zero, which decide on stability; [`Spectrum::omitted`] counts the others.

use nalgebra::{Complex, DMatrix, DVector, Schur};
use smpl_compiler::graph::connected;

use crate::inverse::Inverse;

/// Largest block whose eigenvalues are all computed.
pub const DENSE: usize = 500;
/// Dimension of the Krylov space of a larger block.
const KRYLOV: usize = 120;
/// Residual, relative to the eigenvalue of the inverse, at which an eigenvalue counts as found.
const FOUND: f64 = 1e-8;

/// Eigenvalues of a matrix.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spectrum {
    /// The eigenvalues, those with the largest real part first.
    pub values: Vec<Complex<f64>>,
    /// Number of eigenvalues that were not computed: of blocks with more than [`DENSE`] states, all
    /// but those nearest to zero.
    pub omitted: usize,
}

/// Eigenvalues of A; `None` where A is not finite or an iteration does not end.
#[must_use]
pub fn eigenvalues(a: &DMatrix<f64>) -> Option<Spectrum> {
    if a.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let mut spectrum = Spectrum::default();
    for block in blocks(a) {
        let mut part = DMatrix::from_fn(block.len(), block.len(), |i, j| a[(block[i], block[j])]);
        symmetrise(&mut part);
        balance(&mut part);
        let found = if block.len() > DENSE { nearest_zero(&part)? } else { all(part)? };
        spectrum.omitted += block.len() - found.len();
        spectrum.values.extend(found);
    }
    spectrum.values.sort_by(|p, q| q.re.total_cmp(&p.re).then(q.im.total_cmp(&p.im)));
    Some(spectrum)
}

/// All eigenvalues of a block by the QR iteration.
fn all(block: DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    let n = block.nrows();
    if n == 1 {
        return Some(vec![Complex::new(block[(0, 0)], 0.0)]);
    }
    // An entry below the diagonal counts as zero if it is small compared with its neighbours on the
    // diagonal. Where these are small themselves (a block with nearly nilpotent parts) it never is;
    // shifted by the norm it is, at the accuracy that the iteration has anyway.
    let shift = block.norm();
    let most = 100 * n;
    let (schur, shift) = match Schur::try_new(block.clone(), f64::EPSILON, most) {
        Some(schur) => (schur, 0.0),
        None => (Schur::try_new(block + DMatrix::identity(n, n) * shift, f64::EPSILON, most)?, shift),
    };
    Some(schur.complex_eigenvalues().iter().map(|value| value - shift).collect())
}

/// The eigenvalues of a large block that are nearest to zero: Arnoldi's method on the inverse of
/// the block, shifted a little so that a singular block has one.
fn nearest_zero(block: &DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    let n = block.nrows();
    let shift = 1e-9 * block.norm() / (n as f64).sqrt();
    let mut inverse = Inverse::new(&(block - DMatrix::identity(n, n) * shift))?;
    let dimension = KRYLOV.min(n);
    // Any start will do that is not orthogonal to what is looked for; this one has no pattern.
    let mut basis = vec![DVector::from_fn(n, |i, _| (1.0 + i as f64 * 0.754_877_666_246_692_7).fract() + 0.1).normalize()];
    let mut small = DMatrix::zeros(dimension, dimension);
    let mut beyond = 0.0;
    for k in 0..dimension {
        let mut next = basis[k].clone();
        inverse.solve(next.as_mut_slice());
        // Twice, so that the basis stays orthogonal.
        for _ in 0..2 {
            for (j, direction) in basis.iter().enumerate() {
                let part = direction.dot(&next);
                small[(j, k)] += part;
                next.axpy(-part, direction, 1.0);
            }
        }
        beyond = next.norm();
        if beyond <= f64::EPSILON * small.column(k).norm() {
            small = small.view((0, 0), (k + 1, k + 1)).clone_owned();
            beyond = 0.0;
            break;
        }
        if k + 1 < dimension {
            small[(k + 1, k)] = beyond;
            basis.push(next / beyond);
        }
    }
    let values = all(small.clone())?;
    let found = values.into_iter().filter(|&value| residual(&small, value, beyond) <= FOUND * value.norm());
    Some(found.map(|value| value.inv() + shift).collect())
}

/// Residual of an eigenvalue of the Krylov space: the last component of its eigenvector times what
/// leads out of the space.
fn residual(small: &DMatrix<f64>, value: Complex<f64>, beyond: f64) -> f64 {
    let n = small.nrows();
    // One step of inverse iteration near the eigenvalue gives the eigenvector.
    let shifted = small.map(|x| Complex::new(x, 0.0)) - DMatrix::identity(n, n) * (value * (1.0 + 1e-13));
    let vector = shifted.lu().solve(&DVector::from_element(n, Complex::new(1.0, 0.0)));
    vector.map_or(0.0, |vector| beyond * vector[n - 1].norm() / vector.norm())
}

/// Scales by powers of two so that entries on either side of the diagonal are as equal as possible.
/// The logarithms x of the factors minimise the sum of (x_i - x_j - log2|a_ij / a_ji|/2)^2 over the
/// pairs of states that act on each other. The eigenvalues stay. A matrix that would grow by it
/// stays as it is.
fn symmetrise(a: &mut DMatrix<f64>) {
    let n = a.nrows();
    // The normal equations; the small multiple of one chooses among factors that are common to all.
    let mut normal = DMatrix::identity(n, n) * 1e-12;
    let mut logarithms = vec![0.0; n];
    for (i, j) in (0..n).flat_map(|j| (0..j).map(move |i| (i, j))) {
        if a[(i, j)] != 0.0 && a[(j, i)] != 0.0 {
            let half = (a[(i, j)].abs().log2() - a[(j, i)].abs().log2()) / 2.0;
            normal[(i, i)] += 1.0;
            normal[(j, j)] += 1.0;
            normal[(i, j)] -= 1.0;
            normal[(j, i)] -= 1.0;
            logarithms[i] += half;
            logarithms[j] -= half;
        }
    }
    let Some(mut inverse) = Inverse::new(&normal) else { return };
    inverse.solve(&mut logarithms);
    let scaled = DMatrix::from_fn(n, n, |i, j| match a[(i, j)] {
        0.0 => 0.0,
        entry => entry * (logarithms[j].round() - logarithms[i].round()).exp2(),
    });
    if scaled.norm() < a.norm() {
        *a = scaled;
    }
}

/// Scales rows and columns by powers of two until they have about the same norms; the eigenvalues
/// stay.
fn balance(a: &mut DMatrix<f64>) {
    const ROUNDS: usize = 100;
    for _ in 0..ROUNDS {
        let mut changed = false;
        for i in 0..a.nrows() {
            let norm = |sum: f64, at: usize, x: f64| if at == i { sum } else { sum + x.abs() };
            let mut column = a.column(i).iter().enumerate().fold(0.0, |sum, (at, &x)| norm(sum, at, x));
            let row = a.row(i).iter().enumerate().fold(0.0, |sum, (at, &x)| norm(sum, at, x));
            if column == 0.0 || row == 0.0 {
                continue;
            }
            let before = column + row;
            let mut factor = 1.0;
            while column < row / 2.0 {
                factor *= 2.0;
                column *= 4.0;
            }
            while column > row * 2.0 {
                factor /= 2.0;
                column /= 4.0;
            }
            if factor != 1.0 && (column + row) / factor < 0.95 * before {
                changed = true;
                a.row_mut(i).scale_mut(1.0 / factor);
                a.column_mut(i).scale_mut(factor);
            }
        }
        if !changed {
            break;
        }
    }
}

/// The strongly connected parts of the pattern, as sorted lists of rows.
fn blocks(a: &DMatrix<f64>) -> Vec<Vec<usize>> {
    let n = a.nrows();
    // A step from j leads to the rows with an entry in column j.
    let next: Vec<Vec<usize>> = (0..n).map(|j| (0..n).filter(|&i| i != j && a[(i, j)] != 0.0).collect()).collect();
    connected(&next)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn real(mut values: Vec<f64>) -> Vec<f64> {
        values.sort_by(|a, b| b.total_cmp(a));
        values
    }

    #[test]
    fn a_cascade_has_the_eigenvalues_of_its_parts() {
        // Companion matrix of (x + 1)(x + 2)(x + 3), feeding a rotation with eigenvalues -1 +- 2i,
        // feeding two integrators.
        let rows: [[f64; 7]; 7] = [
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            [-6.0, -11.0, -6.0, 0.0, 0.0, 0.0, 0.0],
            [5.0, 0.0, 0.0, -1.0, 2.0, 0.0, 0.0],
            [0.0, 7.0, 0.0, -2.0, -1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0, 3.0, 0.0],
        ];
        let spectrum = eigenvalues(&DMatrix::from_fn(7, 7, |i, j| rows[i][j])).expect("converges");
        let expected = [(0.0, 0.0), (0.0, 0.0), (-1.0, 2.0), (-1.0, 0.0), (-1.0, -2.0), (-2.0, 0.0), (-3.0, 0.0)];
        assert_eq!(spectrum.omitted, 0);
        for (re, im) in expected {
            assert!(spectrum.values.iter().any(|v| (v.re - re).abs() < 1e-9 && (v.im - im).abs() < 1e-9), "{re} {im}: {spectrum:?}");
        }
    }

    #[test]
    fn scales_that_differ_by_many_orders_do_no_harm() {
        // Similar to [[-1, 1], [1, -3]] by scaling: eigenvalues -2 +- sqrt(2).
        let a = DMatrix::from_row_slice(2, 2, &[-1.0, 1e12, 1e-12, -3.0]);
        let values = eigenvalues(&a).expect("converges").values;
        assert!((values[0].re + 2.0 - 2.0_f64.sqrt()).abs() < 1e-14 && (values[1].re + 2.0 + 2.0_f64.sqrt()).abs() < 1e-14);
    }

    #[test]
    fn a_long_cascade_of_equal_cells_does_not_smear_its_multiple_eigenvalue() {
        // A Jordan block of 60: the QR iteration alone scatters its eigenvalues by 60 sqrt-th roots
        // of rounding, 0.5.
        let a = DMatrix::from_fn(60, 60, |i, j| if i == j { -1.0 } else { f64::from(u8::from(i == j + 1)) });
        assert!(eigenvalues(&a).expect("converges").values.iter().all(|v| v.re == -1.0 && v.im == 0.0));
    }

    #[test]
    fn convection_that_outweighs_dispersion_leaves_the_eigenvalues_real() {
        // A row of cells: b from the one before, c from the one after. Eigenvalues a + 2 sqrt(b c)
        // cos(k pi/(n + 1)); the eigenvectors grow as (b/c)^(i/2), so that of the matrix as it
        // stands rounding makes a cloud of complex numbers.
        for n in [300, DENSE + 100] {
            let (a, b, c) = (-2.2, 1.6, 0.6_f64);
            let matrix = DMatrix::from_fn(n, n, |i, j| match (i as i64) - (j as i64) {
                0 => a,
                1 => b,
                -1 => c,
                _ => 0.0,
            });
            let spectrum = eigenvalues(&matrix).expect("converges");
            let expected = (1..=n).map(|k| a + 2.0 * (b * c).sqrt() * (k as f64 * std::f64::consts::PI / (n + 1) as f64).cos());
            for (value, exact) in spectrum.values.iter().zip(expected).take(20) {
                assert!(value.im == 0.0 && (value.re - exact).abs() < 1e-10, "{n}: {value} {exact}");
            }
        }
    }

    #[test]
    fn of_a_large_connected_part_those_nearest_to_zero_are_found() {
        // Diffusion between closed ends: eigenvalues -4 sin^2(k pi / (2 n)), k = 0 .. n - 1.
        let n = DENSE + 1;
        let a = DMatrix::from_fn(n, n, |i, j| match i.abs_diff(j) {
            0 => -f64::from(u8::from(i > 0)) - f64::from(u8::from(i + 1 < n)),
            1 => 1.0,
            _ => 0.0,
        });
        let spectrum = eigenvalues(&a).expect("converges");
        assert_eq!(spectrum.values.len() + spectrum.omitted, n);
        assert!(spectrum.values.len() >= 20, "{}", spectrum.values.len());
        let expected = (0..n).map(|k| -4.0 * (k as f64 * std::f64::consts::PI / (2 * n) as f64).sin().powi(2));
        for (value, exact) in real(spectrum.values.iter().map(|v| v.re).collect()).into_iter().zip(expected).take(20) {
            assert!((value - exact).abs() < 1e-9 * exact.abs().max(1e-4), "{value} {exact}");
        }
    }
}
