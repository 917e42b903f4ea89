//! Bounds of unknowns over a part of a step, from the polynomial that the method interpolates with.
//!
//! A polynomial lies between the least and the largest of its coefficients in Bernstein's basis,
//! and the narrower the part, the closer: to second order in its width (R. T. Farouki, *Comput.
//! Aided Geom. Design* 29 (2012) 379, section 5). The coefficients follow from values at
//! equidistant times, which any interpolation gives.

use std::sync::LazyLock;

/// The highest degree of an interpolation.
pub(crate) const MAX_DEGREE: usize = 7;

/// Values at equidistant points to coefficients.
type Matrix = [[f64; MAX_DEGREE + 1]; MAX_DEGREE + 1];

static MATRICES: LazyLock<[Matrix; MAX_DEGREE + 1]> = LazyLock::new(|| std::array::from_fn(matrix));

/// A box of unknowns, with space for what it is found from.
pub(crate) struct Enclosure {
    /// Lower bounds.
    pub least: Box<[f64]>,
    /// Upper bounds.
    pub most: Box<[f64]>,
    /// Values at equidistant times, one time after another.
    samples: Box<[f64]>,
}

impl Enclosure {
    /// For so many unknowns, which may be none.
    pub(crate) fn new(unknowns: usize) -> Self {
        let numbers = |n: usize| vec![0.0; n].into_boxed_slice();
        Self { least: numbers(unknowns), most: numbers(unknowns), samples: numbers(unknowns * (MAX_DEGREE + 1)) }
    }

    /// Bounds from one time to another of polynomials of this degree, of which `sample` writes the
    /// values at a time.
    ///
    /// # Errors
    /// Those of `sample`.
    pub(crate) fn bound<E>(
        &mut self,
        degree: usize,
        (from, to): (f64, f64),
        mut sample: impl FnMut(f64, &mut [f64]) -> Result<(), E>,
    ) -> Result<(), E> {
        let n = self.least.len();
        if n == 0 {
            return Ok(());
        }
        let degree = degree.clamp(1, MAX_DEGREE);
        for (k, values) in self.samples.chunks_exact_mut(n).enumerate().take(degree + 1) {
            let share = k as f64 / degree as f64;
            sample(if k == degree { to } else { from + share * (to - from) }, values)?;
        }
        let matrix = &MATRICES[degree];
        self.least.copy_from_slice(&self.samples[..n]);
        self.most.copy_from_slice(&self.samples[..n]);
        for row in &matrix[1..=degree] {
            for i in 0..n {
                let coefficient: f64 = (0..=degree).map(|k| row[k] * self.samples[k * n + i]).sum();
                // What is not a number stays.
                self.least[i] = if coefficient >= self.least[i] { self.least[i] } else { coefficient };
                self.most[i] = if coefficient <= self.most[i] { self.most[i] } else { coefficient };
            }
        }
        Ok(())
    }
}

/// Bounds of the polynomial through values at the ends of an interval and at its quarters.
pub(crate) fn hull(values: [f64; 5]) -> (f64, f64) {
    let (mut least, mut most) = (values[0].min(values[4]), values[0].max(values[4]));
    for row in &MATRICES[4][1..4] {
        let coefficient: f64 = row.iter().zip(values).map(|(factor, value)| factor * value).sum();
        (least, most) = (least.min(coefficient), most.max(coefficient));
    }
    (least, most)
}

/// Coefficients in Bernstein's basis of a degree by values at equidistant points: the inverse of
/// the basis there.
fn matrix(degree: usize) -> Matrix {
    let mut basis = [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
    let mut inverse = [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
    for (k, (basis, inverse)) in basis.iter_mut().zip(&mut inverse).enumerate().take(degree + 1) {
        let x = k as f64 / degree.max(1) as f64;
        let mut binomial = 1.0;
        for (j, value) in basis.iter_mut().enumerate().take(degree + 1) {
            *value = binomial * x.powi(j as i32) * (1.0 - x).powi((degree - j) as i32);
            binomial *= (degree - j) as f64 / (j + 1) as f64;
        }
        inverse[k] = 1.0;
    }
    // Gauss and Jordan; the basis is totally positive and needs no pivots.
    for pivot in 0..=degree {
        let factor = 1.0 / basis[pivot][pivot];
        basis[pivot].iter_mut().chain(&mut inverse[pivot]).for_each(|x| *x *= factor);
        let (row, other) = (basis[pivot], inverse[pivot]);
        for k in (0..=degree).filter(|&k| k != pivot) {
            let factor = basis[k][pivot];
            basis[k].iter_mut().zip(row).for_each(|(x, by)| *x -= factor * by);
            inverse[k].iter_mut().zip(other).for_each(|(x, by)| *x -= factor * by);
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_hold_the_polynomial_and_approach_its_extrema() {
        for degree in 1..=MAX_DEGREE {
            // A Chebyshev polynomial has its extrema -1 and 1 all over -1..1.
            let polynomial = |t: f64| (degree as f64 * t.clamp(-1.0, 1.0).acos()).cos();
            let mut enclosure = Enclosure::new(1);
            for pieces in [1, 4, 64] {
                let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
                for piece in 0..pieces {
                    let at = |k: i32| -1.0 + 2.0 * f64::from(k) / f64::from(pieces);
                    let bounded: Result<(), ()> = enclosure.bound(degree, (at(piece), at(piece + 1)), |t, out| {
                        out[0] = polynomial(t);
                        Ok(())
                    });
                    assert_eq!(bounded, Ok(()));
                    for k in 0..=20 {
                        let t = at(piece) + (at(piece + 1) - at(piece)) * f64::from(k) / 20.0;
                        let inside = enclosure.least[0] - 1e-12 <= polynomial(t) && polynomial(t) <= enclosure.most[0] + 1e-12;
                        assert!(inside, "degree {degree}, {pieces} pieces, t = {t}");
                    }
                    least = least.min(enclosure.least[0]);
                    most = most.max(enclosure.most[0]);
                }
                if pieces == 64 {
                    assert!(most - least < 2.0 + 1e-2 * f64::from(degree as u32), "degree {degree}: {least}..{most}");
                }
            }
        }
    }
}
