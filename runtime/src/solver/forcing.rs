//! Terms that depend on time alone, sampled over an interval before it is integrated.
//!
//! An error test compares rates at the ends of steps. A forcing may begin and end an interval
//! alike, such as the light of a day. The test misses it if a step is as long as the interval or
//! has grown in the night. Therefore all terms that depend on time are evaluated at some thirty
//! points. If a polynomial of degree four goes through them, the error test suffices; otherwise no
//! step may be longer than the distance of the points. If the values turn often, more points count
//! the turns, and several steps fall between two of them. The points are not evenly spaced, so that
//! a period of the forcing cannot hide in them.

/// Intervals between points.
const PIECES: usize = 32;

/// Points, both ends included.
const POINTS: usize = PIECES + 1;

/// Pieces of finer looks, each taken where the one before had less than [`PIECES_OF_A_TURN`].
const FINER: [usize; 2] = [256, 2048];

/// Pieces between two turns of a forcing that count as enough.
const PIECES_OF_A_TURN: u32 = 8;

/// Degree of the polynomials, plus one.
const TERMS: usize = 5;

/// Largest distance of a smooth forcing from its polynomial, in parts of its range; a way back by
/// less is not a turn.
const SMOOTH: f64 = 0.01;

/// A range below this, in parts of the largest value, is rounding.
const ROUNDING: f64 = 1e-12;

/// Least number of steps where a forcing is not smooth, and of steps between two of its turns: no
/// simple fractions, since those could be a period.
const STEPS: f64 = 33.618_033_988_749_9;
const STEPS_OF_A_TURN: f64 = 3.236_067_977_499_8;

/// First step in parts of the longest one, so that steps of different lengths meet the forcing.
const FIRST_STEP: f64 = 0.125;

/// Course of the forcings over an interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Course {
    /// None changes.
    Flat,
    /// Polynomials follow them.
    Smooth,
    /// One is up and down with so many turns at most.
    Structured(u32),
}

impl Course {
    /// Longest step over an interval; infinite where nothing bounds it.
    pub(crate) fn longest_step(self, interval: f64) -> f64 {
        match self {
            Self::Structured(turns) => interval / STEPS.max(STEPS_OF_A_TURN * f64::from(turns)),
            _ => f64::INFINITY,
        }
    }

    /// Longest first step.
    pub(crate) fn longest_first_step(self, interval: f64) -> f64 {
        FIRST_STEP * self.longest_step(interval)
    }
}

/// The way of one forcing from turn to turn.
#[derive(Clone, Copy, Default)]
struct Way {
    /// Way back that is a turn.
    least: f64,
    /// Furthest value since the last turn.
    furthest: f64,
    /// 1 on the way up, -1 on the way down, 0 before either.
    direction: f64,
    turns: u32,
}

impl Way {
    fn begin(least: f64, value: f64) -> Self {
        Self { least, furthest: value, direction: 0.0, turns: 0 }
    }

    fn go(&mut self, value: f64) {
        let gone = value - self.furthest;
        if gone * self.direction > 0.0 {
            self.furthest = value;
        } else if gone.abs() > self.least {
            self.turns += u32::from(self.direction != 0.0);
            self.direction = gone.signum();
            self.furthest = value;
        }
    }
}

/// Space for the look.
pub(crate) struct Forcing {
    /// Polynomials, orthonormal over the points.
    basis: [[f64; POINTS]; TERMS],
    /// Values of all forcings, point after point.
    samples: Box<[f64]>,
    ways: Box<[Way]>,
}

impl Forcing {
    /// For so many forcings.
    pub(super) fn new(count: usize) -> Self {
        Self { basis: basis(), samples: vec![0.0; count * POINTS].into(), ways: vec![Way::default(); count].into() }
    }

    /// Returns `true` if there is anything to look at.
    pub(super) fn is_empty(&self) -> bool {
        self.ways.is_empty()
    }

    /// Looks at the interval; `evaluate` writes the values of all forcings at a share of it.
    pub(crate) fn look<E>(&mut self, mut evaluate: impl FnMut(f64, &mut [f64]) -> Result<(), E>) -> Result<Course, E> {
        let count = self.ways.len();
        for (k, out) in self.samples.chunks_exact_mut(count).enumerate() {
            evaluate(share(k, PIECES), out)?;
        }
        let mut course = (0..count).map(|number| self.course(number)).max().unwrap_or(Course::Flat);
        for (pieces, before) in FINER.into_iter().zip([PIECES, FINER[0]]) {
            let Course::Structured(turns) = course else { break };
            if turns * PIECES_OF_A_TURN <= before as u32 {
                break;
            }
            let (last, _) = self.samples.split_at_mut(count);
            self.ways.iter_mut().zip(&*last).for_each(|(way, &value)| *way = Way::begin(way.least, value));
            for k in 0..=pieces {
                evaluate(share(k, pieces), last)?;
                self.ways.iter_mut().zip(&*last).for_each(|(way, &value)| way.go(value));
            }
            course = Course::Structured(self.ways.iter().map(|way| way.turns).max().unwrap_or(0).max(turns));
        }
        Ok(course)
    }

    fn course(&mut self, number: usize) -> Course {
        let count = self.ways.len();
        let values: [f64; POINTS] = std::array::from_fn(|point| self.samples[point * count + number]);
        self.ways[number] = Way::begin(f64::INFINITY, values[0]);
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
        if rest.iter().all(|x| x.abs() <= SMOOTH * range) {
            return Course::Smooth;
        }
        let way = &mut self.ways[number];
        *way = Way::begin(SMOOTH * range, values[0]);
        values.iter().for_each(|&value| way.go(value));
        Course::Structured(way.turns)
    }
}

/// Shares of an interval from 0 to 1, one in every piece, at places in it that follow no rule that
/// a forcing could follow too.
fn share(k: usize, pieces: usize) -> f64 {
    if k == 0 || k == pieces {
        return if k == 0 { 0.0 } else { 1.0 };
    }
    (k as f64 + 0.8 * (scattered(k as u64) - 0.5)) / pieces as f64
}

/// A number from 0 to 1 that looks random (the output function of SplitMix64).
fn scattered(k: u64) -> f64 {
    let mut bits = k.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Polynomials orthonormal over the points, by Gram and Schmidt.
fn basis() -> [[f64; POINTS]; TERMS] {
    let mut basis = [[0.0; POINTS]; TERMS];
    for degree in 0..TERMS {
        let mut polynomial: [f64; POINTS] = std::array::from_fn(|k| (2.0 * share(k, PIECES) - 1.0).powi(degree as i32));
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
        for periods in 1..400 {
            let omega = std::f64::consts::TAU * f64::from(periods);
            for course in [course(|s| (omega * s).cos()), course(|s| (omega * s).sin().max(0.0))] {
                let Course::Structured(turns) = course else { panic!("{periods} periods are {course:?}") };
                assert!(turns.abs_diff(2 * periods) <= 3 + periods / 5, "{periods} periods have {turns} turns");
            }
        }
    }

    #[test]
    fn a_bump_of_a_tenth_is_seen_wherever_it_is() {
        for at in 0..100 {
            let middle = f64::from(at) / 100.0;
            let seen = course(|s| s + 0.2 * (-((s - middle) / 0.05).powi(2)).exp());
            assert!(matches!(seen, Course::Structured(_)), "at {middle}");
        }
    }
}
