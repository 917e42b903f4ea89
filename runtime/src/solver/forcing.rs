//! What time alone moves, looked at all over an interval before it is integrated.
//!
//! An error test compares rates at the ends of steps. A forcing that begins and ends an interval alike, a day's light in a step of a day, is
//! passed over by a step as long as the interval, and by steps that have grown in the night. Therefore everything that time moves is
//! evaluated at some thirty points. Where a polynomial of degree four goes through them, the error test sees what there is; otherwise
//! no step may be longer than the points are apart. The points are not evenly spaced, so that a period of the forcing cannot hide in them.

/// Intervals between points.
const PIECES: usize = 32;

/// Points, both ends included.
const POINTS: usize = PIECES + 1;

/// Degree of the polynomials, plus one.
const TERMS: usize = 5;

/// Largest distance of a smooth forcing from its polynomial, in parts of its range.
const SMOOTH: f64 = 0.01;

/// A range below this, in parts of the largest value, is rounding.
const ROUNDING: f64 = 1e-12;

/// Longest step over an interval of length 1 where a forcing is not smooth: no simple fraction, since that could be a period.
const LONGEST_STEP: f64 = 1.0 / 33.618_033_988_749_9;

/// First step in parts of the longest one, so that steps of different lengths meet the forcing.
const FIRST_STEP: f64 = 0.125;

/// How the forcings run over an interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Course {
    /// None changes.
    Flat,
    /// Polynomials follow them.
    Smooth,
    /// Steps must not be longer than [`LONGEST_STEP`].
    Structured,
}

impl Course {
    /// Longest step over an interval; infinite where nothing bounds it.
    pub fn longest_step(self, interval: f64) -> f64 {
        if self == Self::Structured { LONGEST_STEP * interval } else { f64::INFINITY }
    }

    /// Longest first step.
    pub fn longest_first_step(self, interval: f64) -> f64 {
        FIRST_STEP * self.longest_step(interval)
    }
}

/// Space for the look.
pub(crate) struct Forcing {
    points: [f64; POINTS],
    /// Polynomials, orthonormal over the points.
    basis: [[f64; POINTS]; TERMS],
    /// Values of all forcings, point after point.
    samples: Box<[f64]>,
    count: usize,
}

impl Forcing {
    /// For so many forcings.
    pub fn new(count: usize) -> Self {
        let points = points();
        Self { points, basis: basis(&points), samples: vec![0.0; count * POINTS].into(), count }
    }

    /// Whether there is anything to look at.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Looks at the interval; `evaluate` writes the values of all forcings at a share of it.
    pub fn look<E>(&mut self, mut evaluate: impl FnMut(f64, &mut [f64]) -> Result<(), E>) -> Result<Course, E> {
        for (&share, out) in self.points.iter().zip(self.samples.chunks_exact_mut(self.count)) {
            evaluate(share, out)?;
        }
        Ok((0..self.count).map(|number| self.course(number)).max().unwrap_or(Course::Flat))
    }

    fn course(&self, number: usize) -> Course {
        let values: [f64; POINTS] = std::array::from_fn(|point| self.samples[point * self.count + number]);
        // What is not defined everywhere cannot be judged: the integrator will find out.
        if !values.iter().all(|x| x.is_finite()) {
            return Course::Smooth;
        }
        let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| (low.min(x), high.max(x)));
        let range = high - low;
        if range <= ROUNDING * low.abs().max(high.abs()) {
            return Course::Flat;
        }
        let mut rest = values.map(|x| x - low);
        for polynomial in &self.basis {
            remove(&mut rest, polynomial);
        }
        let distance = rest.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
        if distance <= SMOOTH * range { Course::Smooth } else { Course::Structured }
    }
}

/// Shares of an interval from 0 to 1, one in every piece, at places in it that follow the golden section.
fn points() -> [f64; POINTS] {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    std::array::from_fn(|k| match k {
        0 => 0.0,
        PIECES => 1.0,
        _ => (k as f64 + 0.6 * ((k as f64 * GOLDEN).fract() - 0.5)) / PIECES as f64,
    })
}

/// Polynomials orthonormal over the points, by Gram and Schmidt.
fn basis(points: &[f64; POINTS]) -> [[f64; POINTS]; TERMS] {
    let mut basis = [[0.0; POINTS]; TERMS];
    for degree in 0..TERMS {
        let mut polynomial = points.map(|x| (2.0 * x - 1.0).powi(degree as i32));
        for lower in &basis[..degree] {
            remove(&mut polynomial, lower);
        }
        let size = polynomial.iter().map(|x| x * x).sum::<f64>().sqrt();
        basis[degree] = polynomial.map(|x| x / size);
    }
    basis
}

/// Takes the part along a unit vector away.
fn remove(values: &mut [f64; POINTS], unit: &[f64; POINTS]) {
    let part: f64 = values.iter().zip(unit).map(|(x, u)| x * u).sum();
    values.iter_mut().zip(unit).for_each(|(x, u)| *x -= part * u);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course(f: impl Fn(f64) -> f64) -> Course {
        let looked: Result<_, ()> = Forcing::new(1).look(|share, out| {
            out[0] = f(share);
            Ok(())
        });
        looked.expect("no fault")
    }

    #[test]
    fn constants_are_flat_and_low_polynomials_smooth() {
        assert_eq!(course(|_| 7.5), Course::Flat);
        assert_eq!(course(|s| s * s * (1.0 - s) * (1.0 - s)), Course::Smooth);
        assert_eq!(course(|s| (0.3 * s).exp()), Course::Smooth);
    }

    #[test]
    fn what_happens_inside_is_seen_however_many_periods_there_are() {
        for periods in 1..500 {
            let omega = std::f64::consts::TAU * f64::from(periods);
            assert_eq!(course(|s| (omega * s).cos()), Course::Structured, "{periods} periods");
            assert_eq!(course(|s| (omega * s).sin().max(0.0)), Course::Structured, "{periods} halves of periods");
        }
    }

    #[test]
    fn a_bump_of_a_tenth_is_seen_wherever_it_is() {
        for at in 0..100 {
            let middle = f64::from(at) / 100.0;
            assert_eq!(course(|s| s + 0.2 * (-((s - middle) / 0.05).powi(2)).exp()), Course::Structured, "at {middle}");
        }
    }
}
