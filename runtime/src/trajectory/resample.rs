//! Recorded columns on the steps of a run, by their times.

/// Course of a recorded input between its samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Between {
    /// A value holds until the next one.
    #[default]
    Hold,
    /// A straight line from one value to the next.
    Linear,
}

/// Steps of the run that a table is read for.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    /// Sampling interval, in the unit of the column `time`.
    pub step: f64,
    /// Course of the inputs between the times of a table.
    pub between: Between,
    /// Most steps that are needed.
    pub most: usize,
}

/// Interval to which a held value belongs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Holds {
    /// The one that begins at its time; the last value holds until this time.
    After(f64),
    /// The one that ends at its time, as in the tables that a simulation writes.
    Before,
}

/// A column on the steps of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct OnSteps {
    /// A value for each step; where the input changes within a step, its mean over the step.
    pub values: Vec<f64>,
    /// Number of steps that the samples cover to their end: all, or all but the last one.
    pub whole: usize,
    /// First step, from 0, within which a held input changes.
    pub split: Option<usize>,
}

/// Times within this part of a step are one time.
pub(super) const SAME: f64 = 1e-6;

/// A column without samples at some steps.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ResampleError {
    /// There is no value at the start.
    #[error("the first value is at {0}; one is needed at 0, the start of the run")]
    Late(f64),
    /// There is no sample.
    #[error("there is no value")]
    Empty,
}

/// A piece of the course: from, to, and the values at both ends.
type Piece = [f64; 4];

/// Means of a recorded input over the steps of a run that begins at time 0. `times` increase.
///
/// # Errors
/// See [`ResampleError`].
pub fn on_steps(times: &[f64], values: &[f64], clock: Clock, holds: Holds) -> Result<OnSteps, ResampleError> {
    let Clock { step, between, most } = clock;
    let pieces = match (between, holds) {
        (Between::Linear, _) => lines(times, values),
        (Between::Hold, Holds::After(end)) => after(times, values, end),
        (Between::Hold, Holds::Before) => before(times, values),
    };
    let (Some(first), Some(last)) = (pieces.first(), pieces.last()) else { return Err(ResampleError::Empty) };
    if first[0] > SAME * step {
        return Err(ResampleError::Late(first[0]));
    }
    let end = last[1];
    let count = ((end / step - SAME).ceil().max(0.0) as usize).min(most);
    let whole = ((end / step + SAME).floor().max(0.0) as usize).min(count);
    let (mut found, mut split, mut from) = (Vec::with_capacity(count), None, 0);
    for k in 0..count {
        let (low, high) = (k as f64 * step, ((k + 1) as f64 * step).min(end));
        while from + 1 < pieces.len() && pieces[from][1] <= low + SAME * step {
            from += 1;
        }
        let (value, changes) = mean(&pieces[from..], low, high, SAME * step);
        if changes && between == Between::Hold {
            split = split.or(Some(k));
        }
        found.push(value);
    }
    Ok(OnSteps { values: found, whole, split })
}

fn lines(times: &[f64], values: &[f64]) -> Vec<Piece> {
    let pairs = times.windows(2).zip(values.windows(2));
    pairs.map(|(t, v)| [t[0], t[1], v[0], v[1]]).collect()
}

fn after(times: &[f64], values: &[f64], end: f64) -> Vec<Piece> {
    let ends = times.iter().skip(1).chain([&end]);
    times.iter().zip(ends).zip(values).map(|((&a, &b), &v)| [a, b, v, v]).collect()
}

fn before(times: &[f64], values: &[f64]) -> Vec<Piece> {
    let begins = [0.0].into_iter().chain(times.iter().copied());
    let pieces = begins.zip(times).zip(values).map(|((a, &b), &v)| [a, b, v, v]);
    pieces.filter(|piece| piece[1] > piece[0]).collect()
}

/// Mean of the course from `low` to `high`, and whether more than one piece has a part in it.
fn mean(pieces: &[Piece], low: f64, high: f64, same: f64) -> (f64, bool) {
    let (mut sum, mut width, mut last, mut changes) = (0.0, 0.0, None, false);
    for &[from, to, a, b] in pieces.iter().take_while(|piece| piece[0] < high - same) {
        let (begin, end) = (from.max(low), to.min(high));
        if end - begin <= same && width > 0.0 {
            continue;
        }
        let at = |t: f64| if a == b { a } else { a + (b - a) * (t - from) / (to - from) };
        let value = if a == b { a } else { f64::midpoint(at(begin), at(end)) };
        changes |= last.is_some_and(|before| before != value);
        (sum, width, last) = (sum + value * (end - begin), width + (end - begin), Some(value));
    }
    // One value is itself, to the last bit.
    let value = if changes { sum / width } else { last.unwrap_or(f64::NAN) };
    (value, changes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(step: f64, between: Between) -> Clock {
        Clock { step, between, most: 1000 }
    }

    fn held(times: &[f64], values: &[f64], step: f64, holds: Holds) -> OnSteps {
        on_steps(times, values, clock(step, Between::Hold), holds).unwrap()
    }

    #[test]
    fn a_slow_log_holds_its_values_over_the_steps_between() {
        let found = held(&[0.0, 10.0, 20.0], &[1.0, 2.0, 4.0], 5.0, Holds::After(30.0));
        assert_eq!(found, OnSteps { values: vec![1.0, 1.0, 2.0, 2.0, 4.0, 4.0], whole: 6, split: None });
        let found = held(&[10.0, 20.0], &[1.0, 2.0], 5.0, Holds::Before);
        assert_eq!(found, OnSteps { values: vec![1.0, 1.0, 2.0, 2.0], whole: 4, split: None });
    }

    /// Mean of 1 over a third of the step and 4 over the rest: 3.
    #[test]
    fn a_change_within_a_step_gives_the_mean_and_is_reported() {
        let found = held(&[0.0, 7.0, 9.0], &[1.0, 4.0, 4.0], 3.0, Holds::After(11.0));
        assert_eq!(found.values[..2], [1.0, 1.0]);
        assert!((found.values[2] - 3.0).abs() < 1e-12, "{found:?}");
        assert_eq!((found.whole, found.split), (3, Some(2)));
    }

    /// The line t from 0 to 4: its means over the steps of 2 are 1 and 3.
    #[test]
    fn linear_resampling_keeps_the_integral() {
        let found = on_steps(&[0.0, 1.0, 4.0], &[0.0, 1.0, 4.0], clock(2.0, Between::Linear), Holds::Before).unwrap();
        assert_eq!(found.split, None);
        assert!(found.values.iter().zip([1.0, 3.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }

    #[test]
    fn a_value_for_each_step_is_kept_to_the_last_bit() {
        let (step, values): (f64, Vec<f64>) = (0.1, (0..50).map(|k| 1.0 / f64::from(k + 3)).collect());
        let times: Vec<f64> = (1..=50).map(|k| f64::from(k) * step).collect();
        assert_eq!(held(&times, &values, step, Holds::Before).values, values);
        let times: Vec<f64> = (0..50).map(|k| f64::from(k) * step).collect();
        assert_eq!(held(&times, &values, step, Holds::After(5.0)).values, values);
    }

    #[test]
    fn a_record_that_begins_late_is_refused() {
        assert_eq!(on_steps(&[5.0, 6.0], &[1.0, 1.0], clock(1.0, Between::Hold), Holds::After(7.0)), Err(ResampleError::Late(5.0)));
    }
}
